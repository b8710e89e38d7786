"""Runs side by side are those of the FMUs: whatever varies, whatever fails, whichever lanes they have."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.conftest import heavy
from tests.system.moving import POSITION, REST, scenario_file, switched_file
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.job import Bench
from vdfmu.study.sweeps.plan import make_plan
from vdfmu.system.scenario import load_scenario


@pytest.fixture
def bench(tmp_path):
    """Return what gives the rows of a study: in lanes, and by the FMUs; `needed`: whether the first needed FMUs too."""
    opened = []

    def run(scenario, over, *, apart=False, tasks=None, **options):
        plan = make_plan(scenario, over, **{"record": ["*"], "engine": "batch", **options})
        folder = tmp_path / str(len(opened))
        folder.mkdir()
        opened.append(Bench(dataclasses.replace(plan.job, compared=()), folder))
        listed = [plan.task(k) for k in (range(len(plan)) if tasks is None else tasks)]
        rows = opened[-1].run(listed)
        run.needed = bool(opened[-1]._alive)
        return rows, opened[-1].run(listed, apart=True)

    yield run
    for engine in opened:
        engine.close()


def general_slider():
    """Return the arm with a prismatic joint with all that it leaves out as shipped."""
    robot = load_robot("slider_3dof")
    robot = dataclasses.replace(robot, friction="split", rotor_coupling=True)
    return robot.with_parameters(theta_err_amplitude=[1e-5, 2e-6, 1e-5], theta_err_phase=[0.3, 1.0, -0.5])


def all_parameters(scenario):
    """Return factors near 1 for every group of parameters that are numbers; small values where there are none."""
    from vdfmu.system.scenario.values import system_values

    values = system_values(scenario)
    groups: dict[str, list[float]] = {}
    for name, table in scenario.resolved.tables.items():
        for v in table:
            if v.causality == "parameter" and v.type == "Real" and v.group not in ("tolerance", "period"):
                groups.setdefault(f"{name}.{v.group}", []).append(values[name].get(v.name) or 0.0)
    return {group: "*lin(0.95, 1.05)" if any(each) else "lin(0.0, 1e-3)" for group, each in groups.items()}


def assert_same_runs(rows, wanted):
    for row, other in zip(rows, wanted, strict=True):
        assert (row["failed"], other["failed"]) == (None, None)
        assert row.keys() == other.keys()
        for name, values in other.items():
            if re.match(r"plant\.(q|kappa)\[", name):
                np.testing.assert_allclose(row[name], values, rtol=0.0, atol=POSITION, err_msg=name)
            elif isinstance(values, np.ndarray):
                atol = REST * max(1.0, np.abs(values).max())
                np.testing.assert_allclose(row[name], values, rtol=0.0, atol=atol, err_msg=name)


def all_in_lanes(bench, scenario, over, **options):
    """Run a study in lanes; its rows are those of the FMUs, which it did not need."""
    rows, wanted = bench(scenario, over, **options)
    assert_same_runs(rows, wanted)
    assert not bench.needed
    return rows


_ROBOTS = [*heavy("tracking"), "slider", *heavy("options")]


@pytest.mark.heavy
@pytest.mark.parametrize("scenario", _ROBOTS)
def test_all_that_can_vary_gives_the_runs_of_the_fmus(bench, with_options, scenario):
    if scenario == "options":
        scenario = dataclasses.replace(load_scenario("planar_tracking", with_options()), stop=0.1)
    elif scenario == "slider":
        scenario = load_scenario("slider_tracking", general_slider())
        sections = {**scenario.sections, "feedforward": {**scenario.sections["feedforward"], "mode": "vdc"}}
        scenario = dataclasses.replace(scenario, stop=0.1, sections=sections)
    else:
        scenario = dataclasses.replace(load_scenario(scenario), stop=0.1)
    rows = all_in_lanes(bench, scenario, all_parameters(scenario), sample="lhs", points=11)
    assert np.ptp([row["plant.q[1]"][-1] for row in rows]) > 1e3 * POSITION  # they are different runs


@pytest.mark.parametrize("algorithm", ["gauss-seidel", *heavy("jacobi")])
def test_inputs_from_outside_and_both_masters(bench, algorithm):
    t = np.array([0.0, 0.013, 0.0301, 0.05])
    inputs = {"plant.F_e[1]": (t, np.array([0.0, 20.0, -5.0, 3.0]))}
    over = {"plant.tolerance": [1e-5, 1e-7, 1e-9], "trajectory.t_start": [0.0, 0.02], "plant.F_e[2]": [0.0, 4.0]}
    for hold in (False, True):
        options = {"algorithm": algorithm, "stop": 0.06, "inputs": inputs, "input_hold": hold}
        all_in_lanes(bench, "planar_tracking", over, **options)


@pytest.mark.heavy
@pytest.mark.parametrize("options", [
    {"parameters": {"plant.solver": "fixed_2"}},
    *heavy(*({"units": {"controller": law}} for law in ("disturbance_observer", "virtual_decomposition"))),
], ids=str)  # fmt: skip
def test_a_solver_with_a_fixed_number_of_steps_and_sampled_laws_of_control(bench, options):
    all_in_lanes(bench, "planar_tracking", {"plant.mass[1]": [5.0, 6.0, 7.0]}, stop=0.05, **options)


@pytest.mark.heavy
def test_lanes_that_fail_have_the_reason_of_the_fmus_and_disturb_no_other(bench):
    options = {"stop": 0.2}
    over = {"plant.f_s[1]": [0.8, 0.1], "controller.K_v[2]": [30.0, 1e9], "plant.mass[1]": [6.0, 7.0]}
    rows, wanted = bench("planar_tracking", over, **options)
    assert len({row["failed"] for row in rows}) > 2
    for row, other in zip(rows, wanted, strict=True):
        assert (row["failed"], row["failed_at"]) == (other["failed"], other["failed_at"])
    well = [k for k, row in enumerate(rows) if row["failed"] is None]
    assert 0 < len(well) < len(rows)
    alone, wanted = bench("planar_tracking", over, **options, tasks=well)
    assert_same_runs(alone, wanted)
    for k, row in zip(well, alone, strict=True):
        for name, values in row.items():
            assert name == "wall_s" or np.array_equal(rows[k][name], values), name


def test_a_value_out_of_its_limits_is_refused_as_by_the_fmus(bench):
    rows, wanted = bench("planar_tracking", {"plant.mass[1]": "normal(0.5, 1.0)"}, sample="random", points=9, stop=0.02)
    assert [row["failed"] for row in rows] == [row["failed"] for row in wanted]
    assert {row["failed"] is None for row in rows} == {True, False}


def sweep(out, **options):
    return vdfmu.sweep(
        "planar_tracking", {"controller.K_v": "*lin(0.5, 2.0, 21)"}, stop=0.05, out=out,
        measure=["end=final(plant.q)"], **options,
    )  # fmt: skip


@pytest.mark.heavy
def test_a_row_is_the_same_bits_with_any_workers_and_chunks(tmp_path):
    first = sweep(tmp_path / "one", workers=1)
    second = sweep(tmp_path / "two", workers=2, chunk=5)
    assert first.facts["engine"] == second.facts["engine"] == "batch"
    for column in ("end[1]", "end[2]"):
        assert (first[column] == second[column]).all()


@pytest.mark.heavy
def test_some_points_are_compared_with_the_fmus_and_the_page_says_so(tmp_path):
    study = sweep(tmp_path / "study")
    difference = study["to_fmu[rad]"]
    assert np.flatnonzero(np.isfinite(difference)).tolist() == [0, 10, 20]
    assert np.nanmax(difference) < POSITION
    page = study.report().read_text(encoding="utf-8")
    assert "batch" in page
    assert f"{difference[10]:.2g}" in page
    by_fmus = sweep(tmp_path / "fmus", engine="fmu")
    assert by_fmus.facts["engine"] == "fmu"
    assert "to_fmu[rad]" not in by_fmus.columns
    np.testing.assert_allclose(study["end[1]"], by_fmus["end[1]"], rtol=0.0, atol=POSITION)


@pytest.mark.parametrize(("over", "options", "words"), [
    ({"feedforward.mode": "vdc, inverse"}, {}, r"feedforward.mode: determines what is compiled"),
    ({"plant.solver": "adaptive, fixed_1"}, {}, r"plant.solver: determines what is compiled"),
    ({"plant.mass[1]": "1, 2"}, {"algorithm": "iterative"}, "algorithm: expected gauss-seidel or jacobi"),
])  # fmt: skip
def test_what_cannot_go_side_by_side_is_said_and_left_to_the_fmus(over, options, words):
    with pytest.raises(UsageError, match=f"engine: batch: {words}(.|\n)*Choose the engine fmu"):
        make_plan("planar_tracking", over, **options, engine="batch")
    values = [1.0 + k / 20 for k in range(20)]
    many = {**over, "controller.K_v[1]": values}
    assert make_plan("planar_tracking", many, **options).facts["engine"] == "fmu"


def test_packages_and_few_points_are_run_by_fmus_and_an_engine_that_there_is_not_is_said(tmp_path):
    over = {"plant.mass[1]": "1, 2"}
    few = make_plan("planar_tracking", over)
    assert few.facts["engine"] == "fmu"
    path = tmp_path / "system.ssp"
    path.write_bytes(few.job.systems[0].content)
    with pytest.raises(UsageError, match="engine: batch needs a scenario"):
        make_plan(path, over, measure=["m=max(plant.q)"], engine="batch")
    with pytest.raises(UsageError, match="engine: expected fmu or batch, got 'gpu'"):
        make_plan("planar_tracking", over, engine="gpu")


@pytest.mark.heavy
def test_units_of_a_user_with_states_and_twice_in_a_system(bench, tmp_path):
    (tmp_path / "wave.py").write_text(
        "import numpy as np\n\nfrom vdfmu.unit import Output, Parameter, Unit\n\n\n"
        'class Wave(Unit):\n    """A wave."""\n\n    f = Parameter("1/s", text="angular frequency", start=30.0)\n'
        '    y = Output("1", text="wave")\n\n    def outputs(self) -> None:\n'
        "        self.y = np.sin(self.f * self.t)\n"
    )
    low_pass = Path(__file__).parents[3] / "examples" / "units" / "low_pass.py"
    (tmp_path / "low_pass.py").write_text(low_pass.read_text())
    parts = 'wave = "wave.py"\na = "low_pass.py"\nb = "low_pass.py"\n'
    units = parts + '\n[connections]\n"wave.y" = ["a.u"]\n"a.y" = ["b.u"]\n'
    over = {"a.T": "0.01, 0.1", "b.T": "0.02, 1e-4, 0.05", "wave.f": "10, 60"}
    rows = all_in_lanes(bench, scenario_file(tmp_path, units), over, measure=["end=final(b.y)"])
    assert len({row["end"] for row in rows}) == 12


@pytest.mark.heavy
@pytest.mark.parametrize("algorithm", ["gauss-seidel", *heavy("jacobi")])
def test_units_that_are_sampled_or_switched_by_time(bench, tmp_path, algorithm):
    scenario = switched_file(tmp_path)
    over = {"b.period": "0.01, 0.02, 0.07", "b.seed": "3, 4", "a.f": "7, 100"}
    rows = all_in_lanes(bench, scenario, over, measure=["end=final(b.s)"], algorithm=algorithm)
    assert len({row["end"] for row in rows}) == 12
    for row in bench(scenario, {"b.period": "0.015, 0.005"}, measure=["end=final(b.s)"])[0]:
        assert "expected a whole multiple of its step 0.01 s" in row["failed"]  # by the FMUs, to which it was left


@pytest.mark.heavy
def test_what_a_unit_requires_of_its_parameters_holds_in_lanes_too(bench, tmp_path):
    (tmp_path / "band.py").write_text(
        "from vdfmu.unit import Derivative, Parameter, State, Unit\n\n\n"
        'class Band(Unit):\n    """A sum."""\n\n    low = Parameter("1", text="lower edge", start=1.0)\n'
        '    high = Parameter("1", text="upper edge", start=2.0)\n    y = State("1", text="sum")\n'
        "    y_dot = Derivative(y)\n\n    def requirements(self):\n"
        '        return {"high": ("high > low", self.high - self.low)}\n\n'
        "    def derivatives(self) -> None:\n        self.y_dot = self.high + self.low\n"
    )
    over = {"a.low": "0, 0.5, 3", "a.high": "0.2, 1"}
    rows, wanted = bench(scenario_file(tmp_path, 'a = "band.py"\n'), over, measure=["end=final(a.y)"])
    assert [row["failed"] for row in rows] == [row["failed"] for row in wanted]
    # three of the six: 0.5 and 3 are above 0.2, 3 above 1
    assert sum("high > low" in str(row["failed"]) for row in rows) == 3
