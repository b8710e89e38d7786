"""The page of FMUs of any tool: diagram, figures by unit of measurement, what the FMUs are, and the verdict."""

from html import escape

import pytest

from tests.engine.reference import models
from tests.warm import command
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
