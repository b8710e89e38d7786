"""The page of FMUs of any tool: diagram, figures by unit of measurement, what the FMUs are, and the verdict."""

import math
import re
from html import escape
from typing import Any

import numpy as np
import pytest

from tests.engine.files import members
from tests.engine.reference import models
from tests.study.page.browser import show
from tests.warm import command
from vdfmu.base.errors import UsageError
from vdfmu.base.files import pack_zip
from vdfmu.base.measure import per_cent
from vdfmu.base.option import declared
from vdfmu.engine.options import SystemOptions
from vdfmu.engine.run import Interrupted, Simulator, simulate
from vdfmu.study import judgement
from vdfmu.study.joined import run_joined
from vdfmu.study.report.shown_run import read_run
from vdfmu.study.sweeps.sweep import Sweep, sweep
from vdfmu.system.package.drawing import Coupling


@pytest.fixture(scope="module", name="place")
def _place(tmp_path_factory):
    """Run three FMUs and judge the run; return the folder and the file of the FMU."""
    place = tmp_path_factory.mktemp("joined")
    lag = models.build(models.LAG, "2.0", place)
    words = (
        f"a={lag.name}",
        f"b={lag.name}",
        f"c={lag.name}",
        *("--connect", "a.x=b.u", "--connect", "b.x=c.u"),
        "--set",
        "a.u=1",
        "--stop",
        "1",
        "--step",
        "0.04",
    )
    done = command("run", *words, "--judge", "20", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "Open results/system/report.html" in done.stdout
    return place, lag


def test_a_page_of_joined_fmus_has_diagram_figures_components_and_verdict(place):
    folder = place[0] / "results" / "system"
    text = (folder / "report.html").read_text(encoding="utf-8")
    run = read_run(folder)
    assert escape(run.summary["verdict"]["headline"]) in text
    assert text.index('class="system"') < text.index('id="figures"')  # the diagram comes first
    for name in "abc":
        assert f"<td>{name}</td><td>FMI 2.0, co-simulation</td>" in text.replace(' class="name"', "")
    assert run.package == folder / "system.ssp" and run.package.is_file()


def test_a_run_that_was_not_judged_says_how_far_it_ran_and_how_to_judge_it(place):
    folder, lag = place
    words = (f"filter={lag.name}", f"plant={lag.name}", "--connect", "filter.x=plant.u", "--stop", "1", "--step", "0.1")
    said = command("run", *words, "--out", "unjudged", cwd=folder).stdout
    line = "Ran to 1 s in 10 steps; coupling not judged: add --judge"
    assert said.startswith(f"\u2013 {line}\n")
    text = (folder / "unjudged" / "report.html").read_text(encoding="utf-8")
    assert line in text and "<title>filter and plant</title>" in text and "Joined FMUs, one run of vdfmu" in text
    assert "verdict" not in read_run(folder / "unjudged").summary
    alone = command("run", lag.name, "--stop", "1", "--step", "0.1", "--out", "alone", cwd=folder).stdout
    assert alone.startswith("\u2013 Ran to 1 s in 10 steps; not judged: add --expect\n")
    text = (folder / "alone" / "report.html").read_text(encoding="utf-8")
    assert f"FMU {lag.stem}, one run of vdfmu" in text


def test_an_option_of_scenarios_is_refused_for_fmus_without_a_temporary_path(place):
    folder, lag = place
    axis = (f"a={lag.name}", "--vary", "a.u=1, 2", "--vary", "robot=x")
    for words, said in ((axis[:3], "engine: batch needs a scenario"), (axis, "robot: expected a scenario, got FMUs")):
        engine = ("--engine", "batch")[: 2 * (len(words) == 3)]
        done = command("sweep", *words, *engine, cwd=folder)
        assert done.returncode == 2 and said in done.stderr and "/" not in done.stderr


def test_the_diagram_and_a_table_have_the_coupling_errors_of_a_judged_run(place):
    folder = place[0] / "results" / "system"
    text, summary = (folder / "report.html").read_text(encoding="utf-8"), read_run(folder).summary
    errors = {each["name"]: each for each in summary["judgement"]["signals"]}
    share = errors["b.x"]["error"]
    assert share > 0.01
    assert f'data-error="b.x: coupling error {per_cent(share)} of its range." style="--width: ' in text
    assert "Width: coupling error, 20 % wanted:" in text
    # with errors C h of first order, runs with h and with h / 2 differ from that with h / 4 by 3 / 4 and 1 / 4 of C h;
    # C h^2 is smaller by the step over the time constant, 4 %
    row = errors["b.x"]
    table = [row["error"], row["error"] * row["q"], row["error"] * row["q"] / 2.0]
    runs = [simulate(folder / "system.ssp", step=0.04 / n, stop=1.0, parameters={"a.u": 1.0}) for n in (1, 2, 4)]
    for run, estimated, n in zip(runs, table, (1, 2), strict=False):
        off = np.abs(run["b.x"][::n] - runs[2]["b.x"][::4]).max() / np.ptp(runs[2]["b.x"])
        assert off == pytest.approx(estimated - table[2], rel=0.04)
    cells = "".join(f"<td>{per_cent(each)}</td>" for each in table)
    assert f'<td class="name">b.x</td>{cells}' in text and "Step<br>10 ms" in text


@pytest.mark.heavy
def test_a_wire_is_as_wide_as_its_error_and_a_click_says_it(place, browser):
    folder = place[0] / "results" / "system"
    show(browser, folder / "report.html")
    wire = "document.querySelector('[data-signal=\"b.x\"]')"
    browser.run(f"{wire}.dispatchEvent(new MouseEvent('click'))")
    signals = read_run(folder).summary["judgement"]["signals"]
    error = next(each["error"] for each in signals if each["name"] == "b.x")
    said = f"b.x: coupling error {per_cent(error)} of its range."
    assert said in browser.run("document.querySelector('#system .bar').textContent")
    width = browser.run(f"getComputedStyle({wire}.querySelector('.line')).strokeWidth")
    # a wire that is chosen is 1.5 px wider; the style has two digits
    assert float(width.removesuffix("px")) == pytest.approx(Coupling({}, 0.2).width(error) + 1.5, abs=0.06)


def test_wires_widen_with_the_logarithm_of_their_error():
    coupling = Coupling({}, 0.01)
    widths = [coupling.width(error) for error in (0.0, 1e-4, 1e-3, 1e-2, 0.1, math.inf)]
    steps = np.diff(widths)
    assert widths[0] == widths[1] and steps[1] == pytest.approx(steps[2]) and steps[1] > 1.0  # a decade can be seen
    assert widths[-1] == max(widths) and max(widths) < 8.0  # wires are 18 px apart; half of that stays free


def with_a_fault(place) -> dict[str, bytes]:
    """Write ``odd.fmu``, whose description breaks a rule; return the members of the FMU that is right."""
    content = members(place[1])
    faulty = content["modelDescription.xml"].replace(b"<ScalarVariable ", b'<ScalarVariable colour="red" ')
    pack_zip(place[0] / "odd.fmu", content | {"modelDescription.xml": faulty})
    return content


@pytest.mark.heavy
def test_a_sweep_of_fmus_has_the_options_of_their_run(place):
    with_a_fault(place)
    studied = ("--vary", "odd.u=1, 2", "--measure", "end=final(odd.x)", "--step", "0.01", "--workers", "1")
    span = ("--start", "0.5", "--stop", "1")
    refused = command("sweep", "odd.fmu", *studied, *span, "--out", "study", cwd=place[0])
    assert refused.returncode == 2 and "--run-anyway" in refused.stderr and not (place[0] / "study").exists()
    words = (*span, "--run-anyway", "--out")
    done = command("sweep", "odd.fmu", *studied, *words, "study", cwd=place[0])
    assert done.returncode == 0, done.stderr
    command("run", "odd.fmu", "--set", "odd.u=2", "--step", "0.01", *words, "point", cwd=place[0])
    point = read_run(place[0] / "point").results
    assert point.time[0] == 0.5 and Sweep(place[0] / "study")["end"][1] == point["odd.x"][-1]
    small = command("sweep", "odd.fmu", *studied, *words, "other", "--unpack-limit", "1K", cwd=place[0])
    assert small.returncode == 2 and "limit" in small.stderr


@pytest.mark.heavy
def test_a_sweep_of_a_package_runs_the_variant_that_is_named(place):
    content = members(place[0] / "results" / "system" / "system.ssp")
    cut = re.sub(
        rb"<(?:ssd:)?Connections>.*</(?:ssd:)?Connections>", b"", content["SystemStructure.ssd"], flags=re.DOTALL
    )
    assert cut != content["SystemStructure.ssd"]
    pack_zip(place[0] / "two.ssp", content | {"apart.ssd": cut})
    options = {"measure": ["end=final(b.x)"], "stop": 1.0, "step": 0.01, "workers": 1}
    ends = [
        sweep(place[0] / "two.ssp", {"a.u": [1.0]}, out=place[0] / f"ends_{k}", **options, **chosen)["end"][0]
        for k, chosen in enumerate(({}, {"variant": "apart.ssd"}))
    ]
    assert ends[0] > 0.0 and ends[1] == 0.0  # nothing feeds b
    for wrong in ({"start": 0.5}, {"variant": "apart.ssd"}):
        with pytest.raises(UsageError, match="is only for packages and FMUs, got the scenario planar_tracking"):
            sweep("planar_tracking", {"controller.K_p": [1.0]}, out=place[0] / "no", **wrong)


@pytest.mark.heavy
def test_an_fmu_with_a_fault_of_its_file_is_refused_and_runs_anyway(place):
    content = with_a_fault(place)
    words = ("run", "odd.fmu", "--stop", "1", "--step", "0.1", "--out", "odd")
    refused = command(*words, cwd=place[0])
    assert refused.returncode == 2 and "The FMUs can run despite this: --run-anyway." in refused.stderr
    done = command(*words, "--run-anyway", cwd=place[0])
    assert done.returncode == 0 and "odd: resources/odd.fmu: faulty model description" in done.stderr
    plain = command("run", place[1].name, *words[2:-1], "plain", cwd=place[0])
    assert plain.returncode == 0
    assert np.array_equal(read_run(place[0] / "odd").results["odd.x"], read_run(place[0] / "plain").results["Lag_2.x"])
    del content["modelDescription.xml"]
    pack_zip(place[0] / "none.fmu", content)  # nothing can be run
    assert command("run", "none.fmu", "--run-anyway", cwd=place[0]).returncode == 2


@pytest.mark.heavy
def test_a_run_that_is_stopped_while_it_is_judged_keeps_its_own_rows(place, tmp_path, monkeypatch):
    package = place[0] / "results" / "system" / "system.ssp"
    shorter = simulate(package, stop=0.5, step=0.25)

    class Stopping(Simulator):
        """Runs that a signal stops, at a moment that a test can choose."""

        def run(self, **_: Any) -> Any:
            raise Interrupted(0.5, shorter)

    options: Any = {each.name: each.option.default for each in declared(SystemOptions)} | {"stop": 1.0, "step": 0.01}
    monkeypatch.setattr(judgement, "Simulator", Stopping)
    with pytest.raises(KeyboardInterrupt) as info:
        run_joined(package, "a b", tmp_path, 0.01, None, **options)
    kept = read_run(tmp_path / "partial")
    assert len(kept.results) == 101 and kept.summary["step"] == 0.01
    assert f"The rows so far are in {tmp_path / 'partial' / 'results.csv'}" in "".join(info.value.__notes__)


def test_a_name_stands_for_one_fmu(place):
    done = command("run", f"a={place[1].name}", f"a={place[1].name}", cwd=place[0])
    assert done.returncode == 2 and "a: expected one FMU or unit of this name, got 2" in done.stderr
