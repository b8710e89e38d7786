"""The benchmarks' own pieces at tiny sizes: no assertion on any time."""

import io
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks import arms, coupling, engines, fmu_growth, native, verdict, whole, work_precision
from benchmarks.__main__ import main
from benchmarks.chains import random_motion, repeated_link
from benchmarks.importers import PACKAGES, missing
from benchmarks.report import Report, Table
from benchmarks.timing import Case, Clock, measure
from vdfmu.arm.robot import check_robot, load_robot
from vdfmu.base.platforms import native_available
from vdfmu.system.scenario import load_scenario

needs_compiler = pytest.mark.skipif(not native_available(), reason="the compiler of native FMUs is not installed")


@pytest.fixture
def report(tmp_path):
    return Report("sample", "Sample", tmp_path, Console(file=io.StringIO(), width=120))


def test_every_case_gets_samples_and_a_slow_one_one():
    calls = {"a": 0, "b": 0}

    def run(name: str) -> None:
        calls[name] += 1

    cases = [Case(name, lambda name=name: run(name)) for name in calls]
    measure(cases, 3, batch=1e-5)
    for case in cases:
        assert case.samples >= 3
        assert calls[case.name] >= case.calls * 3
        assert 0.0 < case.best < np.inf
    slow = Case("slow", lambda: sum(range(10_000)))
    measure([slow], 5, batch=0.0, limit=0.0)
    assert slow.samples == 1


def test_a_table_is_markdown_without_rows_of_wrong_length():
    table = Table("t", "Title [us]", [("name", ""), ("time [us]", ".1f")], notes=["a note"])
    table.add("x", 1.25)
    table.add("y", None)
    stream = io.StringIO()
    table.show(Console(file=stream, width=80))
    lines = [line.rstrip() for line in stream.getvalue().splitlines() if line.strip()]
    assert lines == [
        "### Title [us]",
        "| name | time [us] |",
        "|------|-----------|",
        "| x    |       1.2 |",
        "| y    |         - |",
        "- a note",
    ]
    with pytest.raises(ValueError, match="t: expected 1 values, got 2"):
        Table("t", "", [("a", "")]).add(1, 2)


def test_repeated_link_is_a_valid_chain_of_equal_links():
    chain = check_robot(repeated_link(5))
    assert chain.n == 5
    assert np.all(chain.inertia == chain.inertia[0])
    assert [a.shape for a in random_motion(5)] == [(5,)] * 3


@pytest.mark.heavy
def test_arms_are_measured_by_their_names_and_the_growth_of_the_fmus(report, monkeypatch):
    arms.run(report, quick=True)
    (table,) = report.tables
    assert [row[:2] for row in table.rows] == [["planar_2dof", 2], ["scara_4dof", 4]]
    assert all(0.0 < row[-1] < 1e-5 for row in table.rows)
    monkeypatch.setattr(fmu_growth, "_JOINTS", (1, 2, 7))
    fmu_growth.run(report, quick=True)
    *_, table = report.tables
    assert [row[0] for row in table.rows] == [1, 2]
    # seconds of the builds, C, times of a step
    assert all(value > 0.0 for row in table.rows for value in row[1:])
    assert table.rows[0][2] < table.rows[1][2]


def test_least_of_blocks_leaves_out_what_disturbed_a_round_and_the_clock_divides_by_the_steps():
    rounds = [np.array([1.0, 9.0, 2.0]), np.array([5.0, 1.0, 2.0]), np.array([1.0, 1.0, 3.0])]
    assert native.Native({"case": rounds}).least("case") == 4.0
    clock = Clock()
    for done in (0, 50, 100):
        clock.progress(done, 100)
    assert clock.blocks.shape == (2,)
    assert clock.blocks.sum() * 100 == pytest.approx(clock.marks[-1][1] - clock.marks[0][1], rel=1e-9)


@needs_compiler
@pytest.mark.heavy
def test_native(report):
    pytest.importorskip("vdfmu.extras.container")
    timings = native.study(
        load_scenario("planar_tracking"), stop=0.2, stop_python=0.1, rounds=2, say=report.say,
        importers=[name for name in PACKAGES if not missing(name)],
    )  # fmt: skip
    assert timings.differences[native.PYTHON] < 1e-9  # the bound of the project
    assert timings.differences[native.CONTAINER] < 1e-12  # the same calls in the same order
    assert timings.differences[native.BY_FMPY] == 0.0  # the same bits
    assert 0.0 < timings.least(native.EMPTY) < timings.least(native.NATIVE) < timings.least(native.BY_FMPY)


def test_measured_commands_keep_bytecode_as_for_users(monkeypatch):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    whole.command("--version")
    assert [*Path(whole.BYTECODE.name).rglob("app.*.pyc")]


@needs_compiler
@pytest.mark.heavy
def test_work_precision_and_engines(report):
    pytest.importorskip("vdfmu.extras.robots")
    precision = work_precision.study(load_robot("planar_2dof"), 0.02, [1e-5, 1e-7], 1)
    for method in (work_precision.COSIM, work_precision.CVODE):
        loose, tight = precision.of(method)
        # a hundred times the tolerance: the local error is controlled, of all states
        assert tight.error < 1e-5
        assert tight.error < loose.error
    work_precision.tabulate(precision, report, "fall")
    precision = engines.study(load_robot("planar_2dof"), 0.02, 1, report.say)
    for integrator, order in (("RK4", 4), ("implicit", 1)):
        first, *_, last = precision.of(f"mujoco {integrator}")
        # its own order between the steps: the models are the same, for the error of another one would stay
        assert last.error < 10.0 * first.error * (last.level / first.level) ** order + 1e-10
    work_precision.tabulate(precision, report, "fall")


def test_time_at_an_error_is_interpolated():
    points = [work_precision.Point("A", 1e-4, 1.0, 1e-4), work_precision.Point("A", 1e-8, 100.0, 1e-8)]
    precision = work_precision.WorkPrecision(points)
    assert precision.time_at("A", 1e-6) == pytest.approx(10.0, rel=1e-12)
    assert precision.time_at("A", 1e-3) is None
    assert precision.time_at("B", 1e-6) is None


@pytest.mark.heavy
def test_command_line(tmp_path, capsys, monkeypatch):
    with pytest.raises(SystemExit) as exit_:
        main(["nothing"])
    assert exit_.value.code == 2
    assert "there is no benchmark 'nothing'" in capsys.readouterr().err
    monkeypatch.setattr(coupling, "STEPS", {"jacobi": (1e-3, 5e-4), "iterative": (4e-3, 2e-3)})
    monkeypatch.setattr(coupling, "ERRORS", (1e-4,))
    assert main(["coupling", "--quick", "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "coupling.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in page.splitlines()
        if line.startswith(("| jacobi", "| iterative"))
    ]
    assert [row[0] for row in rows] == ["jacobi"] * 2 + ["iterative"] * 2 + ["iterative, adaptive"]
    errors = [float(row[3]) for row in rows]
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1) and errors[3] < errors[2] < errors[0]  # first order
    assert [row[-1] for row in rows[:2]] == ["4000", "8000"]  # steps of four units


def test_work_at_an_error_is_the_least_of_the_points_and_between_them():
    points = [(1e-5, 100), (1e-7, 10_000), (1e-8, 20_000)]
    assert coupling.work_at(points, 1e-6) == pytest.approx(1000.0, rel=1e-12)
    assert coupling.work_at(points, 1e-3) == 100  # the longest step is more precise than that
    assert coupling.work_at(points, 1e-9) is None


@needs_compiler
@pytest.mark.heavy
def test_verdict(report, monkeypatch):
    monkeypatch.setattr(verdict, "CASES", verdict.CASES[:1])
    verdict.run(report, quick=True)
    (row,) = report.tables[-1].rows
    assert row[1] == 3 and all(0 <= count <= 3 for count in row[2:])


def test_folders_of_measurements_are_asked_for(capsys):
    pytest.importorskip("vdfmu.extras.identify")
    with pytest.raises(SystemExit) as exit_:
        import_module("benchmarks.measured").main([])
    assert exit_.value.code == 2
    assert "name at least one folder" in capsys.readouterr().err
