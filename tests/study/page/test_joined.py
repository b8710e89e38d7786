"""The page of FMUs of any tool: diagram, figures by unit of measurement, what the FMUs are, and the verdict."""

from html import escape
from typing import Any

import numpy as np
import pytest

from tests.engine.reference import models
from tests.study.run.conftest import members
from tests.warm import command
from vdfmu.base.files import pack_zip
from vdfmu.base.option import declared
from vdfmu.engine.options import SystemOptions
from vdfmu.engine.run import Interrupted, Simulator, simulate
from vdfmu.study import judgement
from vdfmu.study.joined import run_joined
from vdfmu.study.report.shown_run import read_run


@pytest.fixture(scope="module", name="place")
def _place(tmp_path_factory):
    """Run two FMUs and judge the run; return the folder and the file of the FMU."""
    place = tmp_path_factory.mktemp("joined")
    lag = models.build(models.LAG, "2.0", place)
    words = (
        f"a={lag.name}",
        f"b={lag.name}",
        "--connect",
        "a.x=b.u",
        "--set",
        "a.u=1",
        "--stop",
        "1",
        "--step",
        "0.01",
    )
    done = command("run", *words, "--judge", "5", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "Open results/system/report.html" in done.stdout
    return place, lag


def test_a_page_of_joined_fmus_has_diagram_figures_components_and_verdict(place):
    folder = place[0] / "results" / "system"
    text = (folder / "report.html").read_text(encoding="utf-8")
    run = read_run(folder)
    assert escape(run.summary["verdict"]["headline"]) in text
    assert text.index('class="system"') < text.index('id="figures"')  # the diagram comes first
    for name in ("a", "b"):
        assert f"<td>{name}</td><td>FMI 2.0, co-simulation</td>" in text.replace(' class="name"', "")
    assert run.package == folder / "system.ssp" and run.package.is_file()


def test_the_next_run_replaces_the_page_and_another_file_is_kept(place):
    folder = place[0] / "results" / "one"
    words = ("run", place[1].name, "--stop", "0.1", "--step", "0.01", "--out", folder)
    for _ in range(2):
        assert command(*words, cwd=place[0]).returncode == 0
    (folder / "summary.json").unlink()
    refused = command(*words, cwd=place[0])
    assert refused.returncode == 2 and "report.html" in refused.stderr


GAIN = """from vdfmu.unit import Input, Output, Unit


class Gain(Unit):
    \"\"\"Half of a signal, and 1.\"\"\"

    u = Input("1", text="signal")
    y = Output("1", text="signal")

    def outputs(self) -> None:
        self.y = 0.5 * self.u + 1.0
"""


def test_an_algebraic_loop_is_solved_by_the_algorithm_that_the_message_names(place):
    (place[0] / "gain.py").write_text(GAIN)
    words = ("a=gain.py", "b=gain.py", "--connect", "a.y=b.u", "--connect", "b.y=a.u", "--stop", "1", "--step", "0.1")
    refused = command("run", *words, "--out", "loop", cwd=place[0])
    assert refused.returncode == 2 and "iterative solves it" in refused.stderr
    done = command("run", *words, "--algorithm", "iterative", "--out", "loop", cwd=place[0])
    assert done.returncode == 0, done.stderr
    results = read_run(place[0] / "loop").results
    assert results["a.y"] == pytest.approx(2.0) and results["b.y"] == pytest.approx(2.0)  # y = y/2 + 1


def test_an_fmu_with_a_fault_of_its_file_is_refused_and_runs_anyway(place):
    content = members(place[1])
    faulty = content["modelDescription.xml"].replace(b"<ScalarVariable ", b'<ScalarVariable colour="red" ')
    pack_zip(place[0] / "odd.fmu", content | {"modelDescription.xml": faulty})
    words = ("run", "odd.fmu", "--stop", "1", "--step", "0.1", "--out", "odd")
    refused = command(*words, cwd=place[0])
    assert refused.returncode == 2 and "The FMUs can run in spite of this: --run-anyway." in refused.stderr
    done = command(*words, "--run-anyway", cwd=place[0])
    assert done.returncode == 0 and "odd: resources/odd.fmu: faulty model description" in done.stderr
    plain = command("run", place[1].name, *words[2:-1], "plain", cwd=place[0])
    assert plain.returncode == 0
    assert np.array_equal(read_run(place[0] / "odd").results["odd.x"], read_run(place[0] / "plain").results["Lag_2.x"])
    del content["modelDescription.xml"]
    pack_zip(place[0] / "none.fmu", content)  # nothing can be run
    assert command("run", "none.fmu", "--run-anyway", cwd=place[0]).returncode == 2


def test_a_run_without_connected_signals_is_refused_before_it_runs_if_it_is_to_be_judged(place):
    words = ("run", "gain.py", "--stop", "1e3", "--step", "1e-3", "--judge", "1", "--out", "alone")
    (place[0] / "gain.py").write_text(GAIN)
    command("build", "gain.py", "--out", ".", cwd=place[0])
    done = command(*["Gain.fmu" if word == "gain.py" else word for word in words], cwd=place[0])
    assert done.returncode == 2 and "judge needs connected signals" in done.stderr
    assert not (place[0] / "alone").exists()


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
