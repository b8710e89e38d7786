"""The margins along the sliders of a page, and the causes that it takes away."""

import json
from typing import Any

import numpy as np
import pytest

import vdfmu
from vdfmu.engine.linear.growth import Along, Poses
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import Checked, check_system
from vdfmu.engine.run.simulator import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.analysis.loops import TIED
from vdfmu.study.report.simulation import LESS, causes, sliders, values_of
from vdfmu.study.report.tracks import NOTCHES, factor, tracks
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario

STOP, STEP = 0.4, 1e-3
GAIN = {
    "words": "Loop gain", "gain": True, "values": [1.0], "least": 0.1, "most": 10.0, "known": [],
}  # fmt: skip
"""A slider of the whole gain of a loop, as a gain margin has it."""


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Checked:
    folder = tmp_path_factory.mktemp("tracks")
    vdfmu.run("planar_tracking", stop=0.01, out=folder, reference=False)
    return check_system(load_ssp(folder / "system.ssp"), algorithm="gauss-seidel")


@pytest.fixture(scope="module")
def described() -> SystemDescription:
    return SystemDescription(load_scenario("planar_tracking"))


def margin_at(track: dict[str, Any], place: float) -> float:
    return track["figures"][track["places"].index(place)]["margin"]["value"]


def tracks_of(checked: Checked, chosen: list[dict[str, Any]]) -> list[Any]:
    described = SystemDescription(load_scenario("planar_tracking"))
    return tracks(checked.system.path, "gauss-seidel", chosen, values_of(described), (0.0, STOP, STEP))


def loops_of(checked: Checked, parameters: dict[str, float] | None = None) -> Along:
    """Return the loops of a run with other parameters."""
    with Simulator(checked.system, isolate=False, algorithm="gauss-seidel") as simulator:
        poses = Poses("tau", TIED)
        simulator.run(start=0.0, stop=STOP, step=STEP, record=(), taps=[poses], parameters=parameters)
    return poses.loops


@pytest.mark.heavy
def test_the_limit_of_a_loops_gain_is_its_gain_margin(planar):
    second = {**GAIN, "targets": [{"unit": "controller", "name": name} for name in ("K_p[2]", "K_v[2]")]}
    (track,) = tracks_of(planar, [second])
    loops = loops_of(planar)
    # a track ends at the last place that is found stable, 25 / 16 notches before one that is not; margins lie between
    # frequencies 10^(4 / 400) apart, which is below that
    notches = NOTCHES / 4 / 16
    place = NOTCHES * np.log10(float(loops.margins().gain[1]))
    assert track["limits"][1] == pytest.approx(place - notches / 2.0, abs=notches)
    assert margin_at(track, 0.0) == pytest.approx(loops.nearest().modulus, abs=1e-5)  # five digits


@pytest.mark.heavy
def test_margins_along_a_slider_are_those_of_runs_with_its_gains(planar, described):
    """The least margin moves to another row of the run."""
    (chosen,) = [slider for slider in sliders(described) if slider["key"] == "controller.K_v"]
    (track,) = tracks_of(planar, [chosen])
    gains = {name: value for name, value in values_of(described)["controller"].items() if "K_v[" in name}
    for place in (-NOTCHES, -NOTCHES / 4, NOTCHES / 2):
        by = factor(chosen, place)
        loops = loops_of(planar, {f"controller.{name}": by * value for name, value in gains.items()})
        # the page promises 0.005, with the states of the run before
        assert margin_at(track, place) == pytest.approx(loops.nearest().modulus, abs=0.005)


def test_sliders_of_gains_have_tracks_and_others_none(planar, described):
    chosen = list(sliders(described))
    of = {slider["key"]: each for slider, each in zip(chosen, tracks_of(planar, chosen), strict=True)}
    gains = {"controller.K_p", "controller.K_v"}
    assert {key for key, track in of.items() if track is not None} == gains
    recorded = margin_at(of["controller.K_v"], 0.0)
    for track in (of[key] for key in gains):
        assert margin_at(track, 0.0) == recorded > 0.0
        assert len(track["figures"]) == len(track["places"]) and track["places"] == sorted(track["places"])
        margins = [figures.get("margin", {"value": 0.0})["value"] for figures in track["figures"]]
        assert all(0.0 <= margin <= 1.0 for margin in margins)
        # beyond the limit there is no margin; disturbances then grow, for a while or without end
        beyond = [figures for place, figures in zip(track["places"], track["figures"], strict=True)
                  if track["limits"][1] is not None and place > track["limits"][1]]  # fmt: skip
        assert all(figures.keys() & {"growth", "unstable", "margin"} for figures in beyond)
    assert len(json.dumps(of)) < 12_000  # a page has them as they are
    assert tracks_of(planar, chosen) == list(of.values())  # from the cache


def test_factors_of_a_slider_and_friction_that_excites_itself_is_left_out(described):
    slider = {"least": 0.1, "most": 10.0}
    root = pytest.approx(10**0.5, rel=1e-15)
    assert [factor(slider, place) for place in (-100, 0, 50, 100)] == [0.1, 1.0, root, 10.0]
    assert factor({"least": 0.0, "most": 3.0}, -100) == 0.0
    values = values_of(described)
    assert {"f_c[1]", "f_s[1]", "f_v[1]"} <= values["plant"].keys()
    assert least_dry_friction(values["plant"]) == {f"{name}[{i}]": 0.0 for name in ("f_c", "f_s") for i in (1, 2)}
    assert least_dry_friction(values["controller"]) == {}


def test_causes_are_those_that_the_system_has(described):
    values, chosen = values_of(described), list(sliders(described))
    words = [cause["words"] for cause in causes(values, chosen, True)]
    assert words == [f"Sampled {LESS} times as often", "No friction, and none expected",
                     f"Drives {LESS} times as stiff, and known to be"]  # fmt: skip
    assert len(list(causes(values, chosen, False))) == 2
    heavy = {**values, "plant": {**values["plant"], "mass[2]": 9.0}, "encoder": {"T_d": 1e-3, "bits[1]": 17.0}}
    more = list(causes(heavy, chosen, False))[2:]
    assert [cause["words"] for cause in more] == [
        "No delay of signals", "Encoders of 48 bits", "Masses and inertias known to the feedforward",
    ]  # fmt: skip
    assert more[-1]["changes"] == [{"unit": "feedforward", "name": "mass[2]", "value": 9.0}]
