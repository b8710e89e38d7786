"""What the page needs to run a scenario again, and whether its own run is that of the FMUs."""

import base64
import gzip
import json
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import Browser
from vdfmu.engine.results.results import Results
from vdfmu.study.report import simulation
from vdfmu.study.report.page import write_report
from vdfmu.study.report.shown_run import read_run
from vdfmu.study.report.simulation import ROWS, simulation_of, sliders
from vdfmu.study.run.measure import POWER
from vdfmu.system import program
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("simulation")
    vdfmu.run("planar_tracking", stop=0.2, out=folder, reference=False, parameters={"controller.K_p": 1500})
    return folder


def found_in(folder: Path, **changed: Any) -> tuple[dict[str, Any], dict[str, str]]:
    run, binaries = read_run(folder), dict[str, str]()
    package = changed.pop("package", run.package)
    return simulation_of(run._replace(summary={**run.summary, **changed}, package=package), binaries), binaries


@pytest.mark.heavy
def test_sliders_at_1_have_the_margin_of_the_verdict_and_none_where_it_has_none(planar):
    figures = read_run(planar).summary["key_figures"]
    tracks = [track for slider in found_in(planar)[0]["sliders"] if (track := slider["track"])]
    at_1 = {track["figures"][track["places"].index(0.0)]["margin"]["value"] for track in tracks}
    (margin,) = at_1
    assert margin == pytest.approx(figures["margin"]["value"], abs=1e-5)  # the same rows, five digits
    rest = {name: each for name, each in figures.items() if name != "margin"}
    for changed, why in (
        ({"unstable": figures["margin"]}, "the run itself is unstable"),
        ({"margin": {"value": 0.0, "place": "joint 1", "at_s": 0.15}}, "the run has none at 0.15 s"),
    ):
        described = found_in(planar, key_figures=rest | changed)[0]
        assert all(slider["track"] is None for slider in described["sliders"]) and described["why"] == why


def test_the_page_has_the_program_of_the_run(planar):
    described, binaries = found_in(planar)
    units = {unit["name"]: unit["parameters"] for unit in described["units"]}
    assert [*units] == ["trajectory", "feedforward", "controller", "plant"]
    place, value, least, most = units["controller"]["K_p[2]"]
    assert (value, least, most) == (1500.0, 0.0, None) and described["memory"][place] == 1500.0
    assert (described["steps"], described["last"]) == (200, pytest.approx(1e-3, rel=1e-12))
    assert described["moving"] == ["plant"] and len(described["names"]) == len(described["places"])
    assert "plant: f_s[1]: expected f_s >= f_c." in described["conditions"]
    assert [*binaries] == [described["module"], described["base"]]
    for module in binaries.values():
        assert gzip.decompress(base64.b64decode(module)).startswith(b"\0asm\1\0\0\0")


def test_a_run_with_other_gains_has_the_same_program_with_its_own_values(planar, tmp_path, monkeypatch):
    parameters = {"controller.K_p": 1500, "controller.K_v[1]": 41.0}
    with monkeypatch.context() as patch:
        patch.setattr(program, "page_program", None)  # it is not made again
        vdfmu.run("planar_tracking", stop=0.2, out=tmp_path, reference=False, parameters=parameters)
    described = found_in(tmp_path)[0]
    scenario = replace(load_scenario("planar_tracking"), stop=0.2)
    system = SystemDescription(scenario, system_values(scenario, parameters))
    new = json.loads(json.dumps(program.page_program(program.SystemProgram(system), POWER)))
    assert found_in(planar)[0]["memory"] != new["memory"]
    digest = sha256(new["module"].encode()).hexdigest()[:16]
    assert {key: described[key] for key in new} == new | {"module": digest}
    vdfmu.run("planar_tracking", stop=0.2, out=tmp_path, reference=False, parameters={"feedforward.mode": 1})
    assert found_in(tmp_path)[0]["module"] != described["module"]  # another choice


def test_recorded_rows_are_those_of_the_run_and_separate_solutions_are_judged_by_how_far(planar):
    recorded = found_in(planar)[0]["recorded"]
    results = Results.read(planar / "results.csv")
    values = recorded["values"].reshape(len(recorded["rows"]), -1)
    assert (recorded["judged"], recorded["unit"]) == (["plant.q[1]", "plant.q[2]"], "rad")
    assert len(recorded["rows"]) == ROWS + 1 and recorded["rows"][-1] == 200
    for name, column in zip(recorded["names"], values.T, strict=True):
        np.testing.assert_array_equal(column, results[name][recorded["rows"]])
    assert found_in(planar)[0]["recorded"]["limit"] == simulation.LIMIT
    apart = {"change": 1e-9, "max_position_difference_rad": 1e-3}
    recorded = found_in(planar, separation=apart)[0]["recorded"]
    assert recorded["limit"] == pytest.approx(3e-3, rel=1e-12) and "separate" in recorded["note"]


def test_sliders_are_parameters_of_the_run_and_friction_that_of_the_rotors_too(planar):
    described = found_in(planar)[0]
    shown = {slider["key"]: slider for slider in described["sliders"]}
    assert list(shown) == ["controller.K_p", "controller.K_v", "plant.mass", "plant.K_f0", "plant.f_c", "trajectory.T"]
    gains = shown["controller.K_p"]
    assert (gains["values"], gains["units"]) == ([1500.0, 1500.0], ["N.m/rad", "N.m/rad"])
    assert shown["plant.mass"]["known"] == [
        {"unit": "feedforward", "name": "mass"}, {"unit": "feedforward", "name": "inertia"},
    ]  # fmt: skip
    parameters = {unit["name"]: unit["parameters"] for unit in described["units"]}
    for slider in shown.values():
        for target in (*slider["targets"], *slider["known"]):
            groups = [name.partition("[")[0] for name in parameters[target["unit"]]]
            assert target["name"] in groups
    system = SystemDescription(load_scenario("tracking_split"))
    (friction,) = [slider for slider in sliders(system) if slider["words"] == "Friction"]
    assert [target["name"] for target in friction["targets"]] == ["f_c", "f_s", "f_v", "f_ck"]
    assert {"unit": "feedforward", "name": "f_ck"} in friction["known"]


def test_sliders_of_two_arms_say_of_which_and_each_feedforward_knows_its_own():
    scenario = load_scenario("planar_tracking")
    parts, connections = {}, {}
    for suffix in ("", "_2"):
        end = lambda name, suffix=suffix: name.replace(".", f"{suffix}.")  # noqa: E731
        parts |= {f"{name}{suffix}": part for name, part in scenario.system.parts.items()}
        connections |= {end(start): [*map(end, ends)] for start, ends in scenario.system.connections.items()}
    system = replace(scenario.system, parts=parts, connections=connections, shared={})
    both = SystemDescription(replace(scenario, system=system), {name: {} for name in parts})
    words = [slider["words"] for slider in sliders(both)]
    assert len(words) == len(set(words)) == 12
    assert {"Proportional gains, controller", "Proportional gains, controller_2"} <= set(words)
    masses = [slider for slider in sliders(both) if slider["words"].startswith("Masses")]
    assert [{target["unit"] for target in slider["known"]} for slider in masses] == [{"feedforward"}, {"feedforward_2"}]


def test_a_run_without_references_says_why_its_loop_may_differ(planar):
    recorded = found_in(planar)[0]["recorded"]
    assert recorded["note"] == "" and "Without a reference it is unknown" in recorded["doubt"]
    assert found_in(planar, reference={"sampled": {}})[0]["recorded"]["doubt"] == ""


@pytest.mark.parametrize(("changed", "words"), [
    ({"package": Path("none.ssp")}, "its package, system.ssp, is not in the folder of the results"),
    ({"package": Path(__file__)}, "this cache has no simulation of it"),
])  # fmt: skip
def test_why_a_run_is_not_simulated_is_said(planar, changed, words):
    described, binaries = found_in(planar, **changed)
    assert list(described) == ["reason"] and not binaries
    assert described["reason"].startswith("This run is not simulated here: ")
    assert words in described["reason"]


@pytest.mark.few(1)
@pytest.mark.parametrize(("options", "words"), [
    ({"algorithm": "iterative"}, "algorithm: expected gauss-seidel or jacobi, got iterative"),
    ({"inputs": {"plant.F_e[1]": ([0.0, 1.0], [0.0, 1.0])}}, "some of its inputs come from files"),
])  # fmt: skip
def test_a_system_without_a_program_is_not_simulated(tmp_path, options, words):
    vdfmu.run("planar_tracking", stop=0.01, out=tmp_path, reference=False, **options)
    assert words in found_in(tmp_path)[0]["reason"]


TOLERANCES = {"rad": 1e-9, "m": 1e-9, "1": 1e-9, "rad/s": 1e-7, "N.m": 1e-5, "J": 1e-7}
"""Of angles 1e-9 rad, which is promised; they swing below 100/s, and gains of 3e3 N.m/rad make 3e-6 N.m of it.

Seen: 0 rad, as the same operations are stepped in the same order.
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> Callable[..., Path]:
    """Make the run of a scenario, with a page that can run it again."""

    def make(scenario: str, **options: Any) -> Path:
        folder = tmp_path_factory.mktemp(scenario)
        vdfmu.run(scenario, out=folder, reference=False, simulate=True, **options)
        return folder

    return make


def simulated(browser: Browser, page: Path, changes: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return what the page finds in its worker, every tenth row; it asks for no file but itself."""
    browser.problems.clear()
    browser.requests.clear()
    browser.open(page)
    values_by_name = browser.run(f"""(async () => {{
        const worker = new report.SimulationWorker(report.binaries);
        const found = await worker.run(report.runs[0].simulation, {json.dumps(changes)});
        const thinned = (values) => Array.from(values).filter((_, k) => k % 10 === 0);
        return Object.fromEntries(Array.from(found.signals, ([name, values]) => [name, thinned(values)]));
    }})()""")  # fmt: skip
    assert browser.problems == []
    assert [url for url in browser.requests if not url.startswith(("data:", "blob:"))] == [page.as_uri()]
    return {name: np.array(values) for name, values in values_by_name.items()}


def assert_same(signals: dict[str, np.ndarray], results: Results) -> None:
    compared = [name for name in signals if name in set(results.names)]
    assert {name.split("[")[0] for name in compared} >= {
        "plant.q", "plant.kappa_dot", "controller.tau", "trajectory.q_d",
    }  # fmt: skip
    for name in compared:
        tolerance = TOLERANCES.get(results.units[name], 1e-5)
        np.testing.assert_allclose(signals[name], results[name][::10], rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.heavy
def test_the_page_finds_what_the_fmus_found(pages, browser):
    folder = pages("tracking")
    results = Results.read(folder / "results.csv")
    assert_same(simulated(browser, folder / "report.html", []), results)
    difference = browser.run("""(async () => {
        const worker = new report.SimulationWorker(report.binaries), { simulation } = report.runs[0];
        return report.difference(simulation, await worker.run(simulation)).position;
    })()""")
    assert difference < 1e-9
    # other gains, and links that the feedforward knows to be heavier: against FMUs with these values
    settings = {"controller.K_p": 3000.0}
    settings |= {f"{unit}.mass": [1.5 * m for m in (3.2, 3.2, 2.0, 2.0, 1.2, 1.2)] for unit in ("plant", "feedforward")}
    other = vdfmu.run("tracking", out=folder / "other", reference=False, parameters=settings)
    changes = [{"unit": "controller", "name": "K_p", "value": 3000.0}]
    changes += [{"unit": unit, "name": "mass", "factor": 1.5} for unit in ("plant", "feedforward")]
    signals = simulated(browser, folder / "report.html", changes)
    assert_same(signals, other)
    assert np.ptp(signals["controller.tau[2]"] - results["controller.tau[2]"][::10]) > 1e-2  # it is another run


@pytest.mark.heavy
def test_the_page_of_fmus_of_fmi_3_under_jacobi_finds_what_they_found(pages, browser):
    folder = pages("planar_tracking", fmi_version="3.0", algorithm="jacobi", stop=1.0)
    assert_same(simulated(browser, folder / "report.html", []), Results.read(folder / "results.csv"))


@pytest.mark.heavy
def test_what_a_unit_refuses_is_said_and_a_run_can_be_stopped(planar, browser, tmp_path):
    browser.open(write_report([read_run(planar)], tmp_path / "page.html", simulate=True))
    said = browser.run("""(async () => {
        const worker = new report.SimulationWorker(report.binaries), { simulation } = report.runs[0], said = [];
        const run = (changes) => worker.run(simulation, changes).catch((error) => said.push(error.message, error.name));
        await run([{ unit: "plant", name: "mass[2]", value: -1 }]);
        await run([{ unit: "plant", name: "weight", value: 1 }]);
        const stopped = run([]);
        worker.cancel();
        await stopped;
        said.push((await worker.run(simulation)).time.length);
        return said;
    })()""")
    assert said == [
        "plant: mass[2] must be above 0, got -1.", "Error",
        "plant has no parameter weight.", "Error", "The run was stopped.", "AbortError", 201,
    ]  # fmt: skip
    assert browser.problems == []
