"""The benchmarks' own pieces at tiny sizes: no assertion on any time."""

from __future__ import annotations

import csv
import io
import json
import shutil
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks import (
    arms,
    c_loops,
    coupling,
    engines,
    federation,
    fmu_growth,
    gradient,
    growth,
    importers,
    native,
    order,
    sweeps,
    whole,
    work_precision,
)
from benchmarks.__main__ import main
from benchmarks.chains import random_motion, repeated_link
from benchmarks.compiled import CompiledFunction, write_library
from benchmarks.counting import Count, count_operations
from benchmarks.fit import exact_polynomial, fit_exponent, upper_half
from benchmarks.report import Report, Table
from benchmarks.system import Clock, least, median
from benchmarks.timing import Case, measure
from vdfmu.arm.equations.rigid_body import net_force
from vdfmu.arm.robot import Robot, check_robot, load_robot
from vdfmu.arm.robot.structure import values
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.system.scenario import load_scenario

needs_compiler = pytest.mark.skipif(
    not native_available(), reason="the compiler of native FMUs is not installed"
)


@pytest.fixture
def report(tmp_path: Path) -> Report:
    return Report("sample", "Sample", tmp_path, Console(file=io.StringIO(), width=120))


def saved(report: Report) -> Path:
    report.write()
    (picture,) = report.pictures
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"]({picture.name})" in (report.out / f"{report.name}.md").read_text(encoding="utf-8")
    json.dumps(report.facts)  # all of it can be written to bench.json
    return picture


def test_exponent_of_a_power_is_recovered() -> None:
    n = [1, 2, 4, 8, 16, 32]
    fit = fit_exponent(n, [3e-6 * k**2.5 for k in n])
    # rounding of six logarithms of numbers up to 1e-2
    assert fit.slope == pytest.approx(2.5, abs=1e-12)
    assert fit.error == pytest.approx(0.0, abs=1e-12)
    assert fit.at(10) == pytest.approx(3e-6 * 10**2.5, rel=1e-12)
    assert (fit.points, fit.range) == (6, "1 to 32")


def test_exponent_with_noise_lies_within_its_standard_error() -> None:
    random = np.random.default_rng(7)
    n = np.geomspace(1, 100, 40)
    fit = fit_exponent(n.tolist(), (n**4 * np.exp(random.normal(scale=0.1, size=40))).tolist())
    # four standard errors: one draw in 16,000 lies outside, and this draw is fixed
    assert abs(fit.slope - 4.0) < 4 * fit.error < 0.1


def test_one_point_has_no_slope() -> None:
    with pytest.raises(ValueError, match="expected at least 2 points, got 1"):
        fit_exponent([1], [1])


def test_upper_half_rounds_up() -> None:
    assert upper_half([1, 2, 3, 4, 5], [9, 8, 7, 6, 5]) == ([3, 4, 5], [7, 6, 5])


def test_polynomial_of_counts_is_exact() -> None:
    n = [1, 2, 3, 5, 8, 9, 12]
    found = exact_polynomial(n, [(5 * k**4 - 3 * k) // 1 + 7 for k in n])
    assert found is not None
    assert found.coefficients == (7, -3, 0, 0, 5)
    assert (found.degree, found.checked, str(found)) == (4, 2, "5 n^4 - 3 n + 7")
    assert found(100) == 5 * 100**4 - 300 + 7


def test_polynomial_with_fractions() -> None:
    n = [1, 2, 3, 4, 5, 6]
    found = exact_polynomial(n, [k * (k + 1) // 2 for k in n])
    assert found is not None
    assert found.coefficients == (0, Fraction(1, 2), Fraction(1, 2))


def test_no_polynomial_without_points_to_spare() -> None:
    assert exact_polynomial([1, 2, 3, 4, 5], [2, 4, 8, 16, 32]) is None


def test_known_expressions() -> None:
    assert count_operations(lambda c: c * 2.0 + 1.0 - c / c) == Count(2, 2, 0)
    assert count_operations(lambda c: -c) == Count(0, 0, 0)
    assert count_operations(lambda c: np.sin(c.array(4)) + np.cos(c.array(4))) == Count(0, 4, 8)
    # a product of a (3, 3) and a (3,): 9 products, 6 sums; times a vector: 3 products, 2 sums
    assert count_operations(lambda c: np.eye(3) @ c.array(3) @ c.array(3)) == Count(12, 8, 0)


def test_equations_run_on_it() -> None:
    counted = count_operations(
        lambda c: net_force(c, c.array(3), c.array(3, 3), c.array(3), c.array(6), c.array(6))
    )
    assert counted.multiplications > 2 * 36  # two products of (6, 6) and (6,) alone
    assert counted.functions == 0


@pytest.mark.parametrize(("name", "degree"), [("VD", 1), ("Newton-Euler", 1), ("Lagrange", 4)])
def test_growth_of_the_formulations(name: str, degree: int) -> None:
    n = list(range(1, 9))
    found = exact_polynomial(n, [growth.count(name, k).multiplications for k in n])
    assert found is not None
    assert found.degree == degree


def test_every_case_gets_samples() -> None:
    calls = {"a": 0, "b": 0}

    def run(name: str) -> None:
        calls[name] += 1

    cases = [Case(name, lambda name=name: run(name)) for name in calls]
    measure(cases, 3, batch=1e-5)
    for case in cases:
        assert case.samples >= 3
        assert calls[case.name] >= case.calls * 3
        assert 0.0 < case.best < np.inf


def test_slow_case_gets_one_sample() -> None:
    slow = Case("slow", lambda: sum(range(10_000)))
    measure([slow], 5, batch=0.0, limit=0.0)
    assert slow.samples == 1


def test_table_in_all_forms(tmp_path: Path) -> None:
    table = Table("t", "Title [us]", [("name", ""), ("time [us]", ".1f")], notes=["a note"])
    table.add("x", 1.25)
    table.add("y", None)
    assert table.to_markdown().splitlines() == [
        "### Title [us]", "", "| name | time [us] |", "| --- | ---: |", "| x | 1.2 |", "| y | - |", "", "- a note",
    ]  # fmt: skip
    table.to_csv(tmp_path / "t.csv")
    with open(tmp_path / "t.csv", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["name", "time [us]"], ["x", "1.25"], ["y", ""]]
    stream = io.StringIO()
    Console(file=stream, width=80).print(table.to_rich())
    assert "Title [us]" in stream.getvalue()
    assert "time [us]" in stream.getvalue()


def test_row_of_wrong_length() -> None:
    with pytest.raises(ValueError, match="t: expected 1 values, got 2"):
        Table("t", "", [("a", "")]).add(1, 2)


def test_repeated_link_is_a_valid_chain_of_equal_links() -> None:
    chain = check_robot(repeated_link(5))
    assert chain.n == 5
    assert np.all(chain.inertia == chain.inertia[0])
    assert [a.shape for a in random_motion(5)] == [(5,)] * 3


@pytest.mark.heavy
def test_growth(report: Report) -> None:
    joints = [1, 2, 3, 4]
    every = dict.fromkeys(growth.FORMULATIONS, joints)
    found = growth.grow(joints, every | {"Lagrange": [1, 2, 3]}, every, 1, 0.0, report.say)
    # torques of 4 links from formulations that share nothing: a few hundred roundings
    assert found.disagreement < 1e-12
    growth.tabulate(found, report, 1)
    report.save(growth.draw(found))
    saved(report)
    rows = {table.name: len(table.rows) for table in report.tables}
    assert rows["growth_plain"] == rows["growth_generated"] == rows["growth_operations"] == 4
    multiplications = report.facts["exponents"]["multiplications"]
    assert {name: fact["degree"] for name, fact in multiplications.items()} == {
        "VD": 1, "Newton-Euler": 1, "Lagrange": 4,
    }  # fmt: skip


@pytest.mark.heavy
def test_arms_are_measured_and_run_by_their_names(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    ran = {"build": 1.0, "second": 0.1, "largest": 1e-5, "final": 1e-6}
    monkeypatch.setattr(arms, "_child", lambda name: asked.append(name) or ran)
    arms.run(report, quick=True)
    (table,) = report.tables
    assert [row[0] for row in table.rows] == asked == ["planar_2dof", "scara_4dof"]
    assert [row[1] for row in table.rows] == [2, 4]
    assert table.rows[0][3] == pytest.approx(0.9)  # m, links of 0.5 and 0.4 m


@pytest.mark.heavy
def test_growth_of_the_fmus(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_growth, "_JOINTS", (1, 2, 7))
    fmu_growth.run(report, quick=True)
    table, sizes = report.tables
    assert [row[0] for row in table.rows] == [row[0] for row in sizes.rows] == [1, 2]
    # the libraries of all units, and of the plant
    assert table.rows[0][4] < table.rows[1][4]
    assert sizes.rows[0][7] < sizes.rows[1][7]


@pytest.mark.heavy
def test_order(report: Report) -> None:
    steps = {a: [1e-3, 5e-4, 2.5e-4] for a in order.ALGORITHMS} | {"iterative": [4e-3, 2e-3, 1e-3]}
    found = order.converge(load_scenario("tracking"), steps, 0.2, report.say)
    assert order.EXPECTED == {"gauss-seidel": 1, "jacobi": 1, "extrapolated": 2, "iterative": 2}
    for algorithm, expected in order.EXPECTED.items():
        # a tenth is the bound of the project for observed orders
        assert found.order("q", algorithm).slope == pytest.approx(expected, abs=0.1)
    order.tabulate(found, 0.2, report)
    report.save(order.draw(found, 0.2))
    saved(report)
    assert [row[0] for row in report.tables[0].rows] == [4.0, 2.0, 1.0, 0.5, 0.25]
    assert [row[0] for row in report.tables[1].rows] == list(order.ALGORITHMS)
    # a step that an algorithm did not run is a gap, not a number
    assert [v is None for v in report.tables[0].rows[0]] == [False, *2 * [True, True, True, False]]


@needs_compiler
@pytest.mark.heavy
def test_coupling(report: Report) -> None:
    before = ContinuousStepper.advance
    steps = {a: [1e-3, 5e-4, 2.5e-4] for a in order.ALGORITHMS} | {"iterative": [4e-3, 2e-3, 1e-3]}
    errors = [1e-4, 1e-5, 1e-6]
    found = coupling.study(load_scenario("tracking"), steps, errors, stop=0.2, rounds=2, say=report.say)
    assert ContinuousStepper.advance is before  # the instrument is gone
    for algorithm, expected in order.EXPECTED.items():
        points = found.of(algorithm)
        # a tenth is the bound of the project for observed orders
        slope = fit_exponent(steps[algorithm], [p.error for p in points]).slope
        assert slope == pytest.approx(expected, abs=0.1)
        assert [p.steps for p in points] == [round(0.2 / h) for h in steps[algorithm]]
        for p in points:
            assert p.residual is not None and p.bound is not None
            if algorithm == "iterative":
                assert 0.0 < p.residual <= p.bound
            else:  # one step of each of the four units
                assert p.unit_steps == 4 * p.steps
        if algorithm != "iterative":
            assert found.energy_order(algorithm).slope == pytest.approx(expected, abs=0.1)
    for algorithm in coupling.CONTROLLED:
        points = found.of(f"{algorithm}, adaptive")
        assert [p.adaptive for p in points] == errors
        # a hundredth of the allowed error costs more steps and is more precise
        assert points[0].error > points[-1].error
        assert points[0].steps < points[-1].steps
        assert all(p.unit_steps >= 4 * (p.steps + p.rejected) for p in points)
        time, mean = found.chosen[algorithm]
        assert time[-1] == pytest.approx(0.2)
        # each row is cut into whole steps, so the counts of the rows add up to those of the same run
        assert np.sum(coupling.LONGEST / mean) == pytest.approx(points[1].steps)
    coupling.tabulate(found, report)
    report.save(coupling.draw(found))
    saved(report)
    assert [len(table.rows) for table in report.tables] == [18, 3, 12]


def test_work_at_an_error_is_the_least_of_the_points_and_between_them() -> None:
    found = coupling.Coupling(1.0)
    found.points = [
        coupling.Point("iterative", None, h, error, unit_steps=n)
        for h, error, n in ((3e-3, 1e-5, 100), (2e-3, 1e-7, 10_000), (1e-3, 1e-8, 20_000))
    ]
    assert found.work_at("iterative", 1e-6) == pytest.approx(1000.0, rel=1e-12)
    assert found.work_at("iterative", 1e-3) == 100  # the longest step is more precise than that
    assert found.work_at("iterative", 1e-9) is None
    assert found.work_at("jacobi", 1e-6) is None


def test_least_of_blocks_leaves_out_what_disturbed_a_round() -> None:
    rounds = [np.array([1.0, 9.0, 2.0]), np.array([5.0, 1.0, 2.0]), np.array([1.0, 1.0, 3.0])]
    assert least(rounds) == 4.0
    assert median(rounds) == 8.0


def test_clock_divides_by_the_steps() -> None:
    clock = Clock()
    for done in (0, 50, 100):
        clock.progress(done, 100)
    assert clock.wall.shape == clock.processor.shape == (2,)
    assert clock.wall.sum() * 100 == pytest.approx(clock.marks[-1][1] - clock.marks[0][1], rel=1e-9)


@needs_compiler
def test_compiled_function_is_the_traced_one(tmp_path: Path, planar: Robot, functions_of) -> None:
    functions, name = functions_of("plant", planar), "plant_derivatives"
    compiled = CompiledFunction(write_library(functions, [name], tmp_path), functions, name)
    traced = functions.function(name)
    random = np.random.default_rng(3)
    for name, buffer in traced.args.items():
        buffer[:] = values(planar) if name == "p" else random.uniform(-0.5, 0.5, len(buffer))
        compiled.args[name][:] = buffer
    traced.run()
    compiled.run()
    # one rounding of the largest term apart at most: libraries differ in sin and cos
    np.testing.assert_allclose(compiled.results["x_dot"], traced.results["x_dot"], rtol=1e-12, atol=1e-12)


@needs_compiler
@pytest.mark.heavy
def test_native(report: Report) -> None:
    found = native.study(
        load_scenario("planar_tracking"), stop=0.2, stop_python=0.1, rounds=2, say=report.say
    )
    assert found.differences[native.PYTHON] < 1e-9  # the bound of the project
    assert found.differences[native.CONTAINER] < 1e-12  # the same calls in the same order
    assert found.differences[native.ISOLATED] == 0.0  # the very calls, in another process
    assert found.differences[native.LOOP] == 0.0  # the very calls of the master
    assert {name: set(parts) for name, parts in found.units.items()} == {
        "trajectory": {"do_step", "get"},
        **dict.fromkeys(("feedforward", "controller", "plant", native.OWN), {"set", "do_step", "get"}),
    }
    assert found.differences[native.OWN] == 0.0  # the same operations in the same order
    assert (
        found.master["number of calls"] == 11
    )  # set, doStep and get of four units, of which one has no inputs
    native.tabulate(found, report)
    report.save(native.draw(found))
    saved(report)
    assert report.tables[1].rows[-1][0] == "total"


@needs_compiler
@pytest.mark.heavy
def test_importers(report: Report) -> None:
    others = [name for name in importers.PACKAGES if not importers.missing(name)]
    found = importers.study(load_scenario("planar_tracking"), others, stop=0.1, rounds=1, say=report.say)
    assert found.importers == [importers.MASTER, importers.CONTAINER, *others]
    # the same units and values, exchanged at the same times
    assert max(found.differences.values()) < 1e-9
    importers.tabulate(found, report)
    report.save(importers.draw(found))
    saved(report)


@needs_compiler
@pytest.mark.heavy
def test_work_precision(report: Report) -> None:
    found = work_precision.study(
        load_robot("planar_2dof"), stop=0.02, tolerances=[1e-5, 1e-7], rounds=1, say=report.say
    )
    assert found.check < 1e-9  # the reference agrees with another solver
    for method in work_precision.METHODS:
        loose, tight = found.of(method)
        # a hundred times the tolerance: the local error is controlled, of all states
        assert tight.error < 1e-5
        assert tight.error < loose.error
        assert (tight.calls is None) == (method == work_precision.COSIM)
    work_precision.tabulate(found, report)
    report.save(work_precision.draw(found))
    saved(report)


@needs_compiler
@pytest.mark.heavy
def test_engines(report: Report) -> None:
    found = engines.study(load_robot("planar_2dof"), stop=0.02, rounds=1, say=report.say)
    methods = {p.method for p in found.points}
    present = {name for name, package in engines.METHODS.items() if not package or find_spec(package)}
    assert methods == present
    for method in methods:
        points = found.of(method)
        # Error control and steps span three decades at least; without another model in between, so does the error.
        assert points[-1].error < 0.1 * points[0].error
        # A fall of 20 ms is one of 0.5 mrad: engines agree with the plant to a hundredth of it.
        assert points[-1].error < 5e-6
    engines.tabulate(found, report)
    report.save(engines.draw(found))
    saved(report)


@needs_compiler
@pytest.mark.heavy
def test_engines_that_are_not_installed_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(engines, "find_spec", lambda _: None)
    found = engines.study(load_robot("planar_2dof"), stop=0.02, rounds=1, say=said.append)
    assert {p.method for p in found.points} == {work_precision.COSIM}
    assert "without MuJoCo, RK4: mujoco is not installed (pip install .[bench])" in said
    assert "without Drake, runge_kutta3: drake is not installed (pip install .[bench])" in said


@needs_compiler
@pytest.mark.heavy
def test_whole(report: Report) -> None:
    whole.run(report, quick=True)
    commands = report.facts["commands_s"]
    assert set(commands) > {"vdfmu --help", "vdfmu run, references kept"} and min(commands.values()) > 0.0
    assert report.facts["results.csv_mb"] > report.facts["results.parquet_mb"] > 0.1
    assert report.facts["a state of a batch, compiled"] > 0.0


@needs_compiler
@pytest.mark.heavy
def test_sweeps(report: Report) -> None:
    sweeps.run(report, quick=True)
    assert [table.name for table in report.tables] == [
        "sweep_points",
        "sweep_point",
        "sweep_engines",
        "sweep_growth",
        "sweep_cluster",
    ]
    assert (
        report.facts["vdfmu.sweep, engine batch_2"]["points_per_s"] > 0.0
        and report.facts["dask_1"]["scheduler_s"] > 0.0
    )


@pytest.mark.heavy
def test_federation(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(federation, "BURNS", (0.0, 1e-4))
    monkeypatch.setattr(federation, "CORES", ("ipc",))
    monkeypatch.setattr(federation, "measured", lambda quick: ("planar_tracking", 5, 5, 1))
    federation.run(report)
    forms, loads = report.tables
    assert [(row[0], row[1]) for row in forms.rows] == [
        ("1", "none"),
        ("1, apart", "none"),
        ("2", "ipc"),
        ("4", "ipc"),
    ]
    assert [row[0] for row in loads.rows] == [0.0, 100.0]
    saved(report)


def test_break_even_is_the_last_crossing() -> None:
    loads, one = (0.0, 1.0, 2.0, 4.0), (0.0, 2.0, 4.0, 8.0)
    assert (
        federation.break_even(loads, one, (3.0, 3.0, 3.0, 5.0)) == 1.5
    )  # half between 1, slower by 1, and 2, faster by 1
    assert federation.break_even(loads, one, (3.0, 1.0, 5.0, 5.0)) == 2.5  # a lucky one before does not count
    assert federation.break_even(loads, one, (9.0, 9.0, 9.0, 9.0)) is None
    assert federation.break_even(loads, one, (-1.0, 1.0, 3.0, 7.0)) == 0.0


def test_time_at_an_error_is_interpolated() -> None:
    found = work_precision.WorkPrecision("", 1.0, 0.0, 1e-6, 1e-6)
    found.points = [
        work_precision.Point("A", tolerance, time, error)
        for tolerance, time, error in ((1e-4, 1.0, 1e-4), (1e-8, 100.0, 1e-8))
    ]
    assert found.time_at("A", 1e-6) == pytest.approx(10.0, rel=1e-12)
    assert found.time_at("A", 1e-3) is None
    assert found.time_at("B", 1e-6) is None


@pytest.mark.heavy
def test_c_loops(report: Report) -> None:
    lacking = c_loops.missing()
    if lacking:
        pytest.skip(lacking)
    found = list(
        c_loops.compare(
            [repeated_link(3)],
            c_loops.PROCESSORS[:1],
            processes=1,
            rounds=1,
            calls=64,
            say=report.say,
            compiler="clang++"
            if shutil.which("clang++")
            else "g++",  # the first reads templates in a third of the time
            flags=("-O0",),
        )
    )
    assert [c.algorithm for c in found] == list(c_loops.ALGORITHMS)
    assert max(c.difference for c in found) < 1e-9
    c_loops.tabulate(found, report)
    report.save(c_loops.draw(found))
    saved(report)


@pytest.mark.heavy
def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["nothing"])
    assert exit_.value.code == 2
    assert "there is no benchmark 'nothing'" in capsys.readouterr().err
    assert main(["growth", "--quick", "--out", str(tmp_path / "out")]) == 0
    facts = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))
    assert set(facts["benchmarks"]) == {"growth"}
    assert facts["benchmarks"]["growth"]["disagreement"] < 1e-9  # of the formulations, each a sum of n terms
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert {"bench.json", "bench.md", "growth.md", "growth.png", "growth_operations.csv"} <= names


@needs_compiler
@pytest.mark.heavy
def test_the_adjoint_is_the_gradient_of_the_chain_and_of_the_fmus() -> None:
    found = gradient.study("planar_tracking", 0.1).found
    adjoint = found["adjoint of the chain"]
    # forward differences of 0.1 % of costs that go with 1 / gain^2: half the curvature, 1.5e-3 of each derivative; the
    # chain's step without error control moves the FMUs' by some 1e-4 more
    for way in ("differences of the chain", "differences of the FMUs"):
        assert np.abs(found[way] - adjoint).max() < 3e-3 * np.abs(adjoint).max()
