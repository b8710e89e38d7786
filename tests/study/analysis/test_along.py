"""The smallest margin over a run, and what grows along it: against 1,000 times and against the run; one for all."""

import dataclasses

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import CosimError
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import packaged
from vdfmu.study.analysis.loops import grown, judged, margins_along, run_along
from vdfmu.study.run.prepare import prepare
from vdfmu.study.verdict import loop_checks, loop_sentences
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.scenario_file import scenario_names

SLOW_WRIST = {
    "controller.K_p": [2e3, 2e3, 2e3, 1e3, 1e3, 500.0],
    "controller.K_v": [50.0, 50.0, 40.0, 30.0, 25.0, 20.0],
}
"""Gains of `tracking` with a small margin where the wrist is slow: its friction falls by 17 of the 20 N.m.s/rad."""
LESS_DAMPED = SLOW_WRIST | {"controller.K_v": [0.75 * K_v for K_v in SLOW_WRIST["controller.K_v"]]}
"""Gains of `tracking` with which the wrist's rotor oscillates where friction falls with speed."""


def on_a_grid(system, times, **options):
    """Return the loops of a system, and those of the same run at so many times, evenly spread."""
    with run_along(system, **options) as (run, grid, _):
        pass
    at = np.linspace(grid.begin, grid.end, times + 1)
    with run_along(system, at=at.tolist(), **options) as (every, _, _):
        pass
    steps = {round((t - grid.begin) / grid.step) for t in at}
    rows = [pose for pose in every.loops.rows if round((pose.time - grid.begin) / grid.step) in steps]
    return run.loops, rows, grid


def agree(loops, rows):
    """Whether the smallest margin is that of a grid; or both have none."""
    least = min(float(pose.loop.modulus.min()) for pose in rows)
    nearest = loops.nearest()
    assert loops.rows[0].time <= nearest.time <= loops.rows[-1].time
    # 0 is a growth that a grid may miss for some milliseconds, as this may: then the margin is a hair's breadth
    return abs(nearest.modulus - least) <= max(0.05 * least, 1e-3)


def test_the_margin_is_the_smallest_of_200_times():
    loops, rows, _ = on_a_grid("planar_tracking", 200)
    assert len(rows) == 201 and agree(loops, rows)


def test_a_loaded_scenario_has_the_margins_of_its_scenario():
    scenario = dataclasses.replace(load_scenario("kr300"), stop=0.5)  # it has inputs, which the package has not
    loaded, along = vdfmu.load(scenario).margins(), margins_along(scenario)
    assert loaded.judged.figures == along.judged.figures and loaded.times == along.times


@pytest.mark.heavy
def test_the_margin_is_the_smallest_over_the_run_where_a_wrist_is_slow():
    # An independent linearisation has 0.163 on the circle of 2 1/s at 9.167 s, and 0.146 on the unit circle at 0.8.
    along = margins_along("tracking", at=[0.8], parameters=SLOW_WRIST)
    nearest = along.judged.loops.nearest()
    assert nearest.name == "plant.tau[6]" and 0.13 < nearest.modulus < 0.15
    assert min(abs(nearest.time - t) for t in (0.84, 9.16)) < 0.02  # the motion is the same from its end
    assert along.margins[0].modulus[5] == pytest.approx(0.146, rel=0.02)  # three digits, of another solver's state


@pytest.mark.heavy
@pytest.mark.parametrize("name", [name for name in scenario_names() if name != "tracking_split"])  # which is chaotic
def test_the_margin_is_the_smallest_of_1000_times(name):
    loops, rows, _ = on_a_grid(name, 1000)
    assert agree(loops, rows)


@pytest.mark.heavy
def test_a_growth_that_the_run_survives_is_told_with_its_times_and_its_factor():
    scenario = dataclasses.replace(prepare("tracking"), stop=1.2)
    with run_along(scenario, parameters=LESS_DAMPED) as (poses, _, _):
        pass
    figures = judged(poses, 0.0, scenario.stop).figures
    checks = {check.key: check for check in loop_checks({"key_figures": figures})}
    growth = grown(poses.loops)
    assert checks["margin"].state == "doubtful" and not figures["margin"]["value"]
    assert checks["margin"].sentence.startswith("modulus margin 0 at joint 6, 0.8")
    assert f"joint 6 is unstable from {growth.begin:.3g} s to {growth.end:.3g} s" in checks["growth"].sentence
    factor = np.exp(growth.exponent)
    assert checks["growth"].value == pytest.approx(factor - 1.0) and checks["growth"].state == "doubtful"
    # the nonlinear run: a push on the tool before the growth begins leaves an oscillation of 11 Hz
    runs = []
    for push in (0.0, -1e-4):
        inputs = {"plant.F_e[6]": ([0.0, 0.62, 0.64, 0.66, 2.0], [0.0, 0.0, push, 0.0, 0.0])}
        with packaged(scenario, LESS_DAMPED) as (package, options):
            with Simulator(package, isolate=False, **(options | {"inputs": inputs})) as simulator:
                runs.append(simulator.run(parameters={"plant.tolerance": 1e-11}, record=["plant.kappa_dot[6]"]))
    apart = np.abs(runs[1]["plant.kappa_dot"] - runs[0]["plant.kappa_dot"]).ravel()
    before, after = (apart[a : a + 95].max() for a in (640, 950))  # a period, of the start and the end of the growth
    # the first window has what grows until 0.73 s, 1.2, and links that swing
    assert 0.5 * factor < after / before <= factor


@pytest.mark.heavy
def test_a_run_that_fails_has_margins_until_then():
    """Twice the gains of `tracking` are unstable with a sample of delay: the run ends at 2.5 s."""
    settings = {"controller.K_v": [100.0, 100.0, 80.0, 60.0, 50.0, 40.0]}
    with pytest.raises(CosimError):
        vdfmu.run("tracking", algorithm="jacobi", parameters=settings, out=False, reference=False)
    margins = margins_along("tracking", algorithm="jacobi", parameters=settings)
    assert loop_sentences(margins.judged.figures)[0] == "failed" and max(margins.times) < 3.0
    assert any("the run fails: plant failed at" in note for note in margins.notes)
