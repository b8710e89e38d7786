"""The unit that plays a motion: the same numbers in numpy, as traced, in C, and in a run of the arm."""

import json
import zipfile

import fmpy
import numpy as np
import pytest

import vdfmu
from vdfmu.arm import motion as motions
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.scalar.generic import lookup
from vdfmu.compiler.unit.evaluate import evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.run import simulate
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit

GROUPS = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot")
POINTS = np.array([[-1.57, 0.0], [-1.2, 0.5], [-0.6, 0.2], [-0.3, 0.6], [0.0, 0.3]])
TIMES = np.array([0.0, 0.3, 0.55, 0.8, 1.0])
SCENARIO = """\
name = "way"
robot = "planar_2dof"
stop = 0.3
step = 0.001

[motion]
kind = "waypoints"
file = "path.csv"

[controller]
K_p = [1500.0, 500.0]
K_v = [40.0, 20.0]
"""


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")


@pytest.fixture
def scenario(tmp_path):
    rows = np.column_stack([TIMES, np.degrees(POINTS[:, 0]), POINTS[:, 1]])
    np.savetxt(tmp_path / "path.csv", rows, "%.17g", ",", header="time [s],q1 [deg],q2 [rad]", comments="")
    path = tmp_path / "way.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


EDGES, ROWS = np.array([0.0, 0.1, 0.25, 1.0]), np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]])


class Stairs(Unit):
    """Two steps."""

    u = Input("1", text="place")
    a = Parameter("1", text="factor", start=2.0)
    y = Output("1", 2, "values")

    def outputs(self) -> None:
        """Take a step."""
        self.y = self.a * self.u * lookup(self.u, EDGES, ROWS)


def test_a_row_of_a_table_is_found_the_same_on_floats_and_symbols_and_by_no_derivative():
    unit = evaluation(Interface(Stairs, None))
    for u in [*EDGES, *np.nextafter(EDGES, -1.0), -3.0, 0.2, 7.0]:
        k = int(np.clip(np.searchsorted(EDGES, u, "right") - 1, 0, 2))
        unit.group("u")[:] = u
        unit.outputs()
        assert (unit.group("y") == 2.0 * u * ROWS[k]).all()
        assert (lookup(u, EDGES, ROWS) == ROWS[k]).all()
    assert (lookup(0.5, EDGES[[0, 3]], ROWS[:1]) == ROWS[0]).all()
    functions = Interface(Stairs, None).functions
    name = next(iter(functions.names()))
    for u, row in ((0.05, ROWS[0]), (0.2, ROWS[1])):
        forward = functions.function(f"{name}_forward")
        forward.args["u"][:], forward.args["a"][:], forward.args["d_u"][:] = u, 2.0, 1.0
        forward.run()
        assert (forward.results["d_y"] == 2.0 * row).all()


def test_the_unit_plays_the_motion_scales_its_speed_holds_it_or_begins_anew(robot):
    motion = motions.waypoints(POINTS, TIMES)
    unit = motion.unit()(robot, t_start=0.5, speed=2.0)
    for t in np.linspace(0.0, 1.5, 301):
        unit.t = t
        unit.outputs()
        at = motion.at(min(max(2.0 * (t - 0.5), 0.0), 1.0))
        if t >= 1.0:
            at[1:] = 0.0
        for order, group in enumerate(GROUPS):
            # the same polynomials, the time with two roundings: 1e-16 s of the next derivative
            assert getattr(unit, group) == pytest.approx(2.0**order * at[order], rel=1e-9, abs=1e-9)
    motion = motions.waypoints([[0.0, 0.0], [1.0, 0.5], [0.0, 0.0]], duration=1.0).dwelling(0.25)
    assert motion.closed and "cycles" not in motions.waypoints(POINTS, TIMES).unit().declared
    unit = motion.unit()(robot, cycles=3.0)
    for t in np.linspace(0.0, 5.0, 401):
        unit.t = t
        unit.outputs()
        here = t % 1.25 if t < 3.75 else 0.0
        # the time is reduced with a rounding of 5e-16 s, times derivatives of up to 1e4
        assert np.abs(unit.q_d - motion.at(here)[0]).max() < 1e-13
        assert np.abs(unit.q_d_ddddot - motion.at(here)[4]).max() < 1e-8


@pytest.mark.heavy
def test_a_scenario_carries_its_motion_into_the_package_and_the_results(scenario, tmp_path):
    motion = vdfmu.load_motion(scenario, vdfmu.load_robot("planar_2dof"))
    assert np.abs(motion.at(TIMES)[0] - POINTS).max() < 1e-12  # degrees and back
    results = vdfmu.run(scenario, out=tmp_path / "out", parameters={"trajectory.t_start": 0.05})
    (tmp_path / "path.csv").unlink()  # nothing needs it any more
    expected = motion.at(np.maximum(results.time - 0.05, 0.0))[0]
    # the time of the step, and t_start, are rounded: 1e-16 s at 4 rad/s
    assert np.abs(results["trajectory.q_d"] - expected).max() < 1e-14
    assert np.abs(results["plant.q"][0] - POINTS[0]).max() < 1e-12  # it starts where the motion does
    # docs/cosimulation.md: the sampled reference agrees to the tolerance of the plant's solver, 1e-7
    assert results.summary["reference"]["sampled"]["max_position_difference_rad"] < 1e-7
    with zipfile.ZipFile(tmp_path / "out" / "system.ssp") as package:
        assert any(name.endswith("Motion.fmu") for name in package.namelist())
    again = simulate(tmp_path / "out" / "system.ssp", stop=0.3, step=1e-3, algorithm="gauss-seidel")
    assert (again["plant.q"] == results["plant.q"]).all()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["scenario"] == "way"


def test_a_motion_of_other_joints_or_too_long_is_refused_and_code_without_a_table_has_none(robot):
    with pytest.raises(UsageError, match="expected at most 500000 coefficients"):
        motions.joined([motions.rest(np.zeros(6), 1.0)] * 14_000).unit()
    from vdfmu.arm.units import shipped_units
    from vdfmu.compiler.c.functions import kernel_source

    for unit in shipped_units().values():
        functions = Interface(unit, robot).functions
        for name in functions.names():
            assert "lookup" not in kernel_source(functions.casadi_function(name))


class Fed(Unit):
    """A state that a table feeds."""

    u = Input("1", text="place")
    x = State("1", 2, "state")
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        """Feed the state."""
        self.x_dot = lookup(self.u, EDGES, ROWS) - self.x


class FedByTime(Fed):
    """The same by time: its edges may lie within a step of the solver."""

    def derivatives(self) -> None:
        """Feed the state."""
        self.x_dot = lookup(self.t, EDGES, ROWS) - self.x


@pytest.mark.heavy
def test_the_solver_of_a_state_looks_up_too(tmp_path):
    fmus = build_fmus(None, tmp_path, units=[Fed])
    inside = (EDGES[1] + EDGES[2]) / 2
    result = fmpy.simulate_fmu(str(fmus["fed"]), stop_time=1.0, output_interval=0.05, start_values={"u": inside})
    # x = row (1 - exp(-t)); the tolerance of the solver is 1e-7, some ten steps
    assert [result["x[1]"][-1], result["x[2]"][-1]] == pytest.approx(ROWS[1] * (1 - np.exp(-1.0)), abs=1e-6)


def test_a_table_over_time_in_derivatives_is_refused(tmp_path):
    with pytest.raises(UnitError, match="depends on the time and reads a table by lookup"):
        build_fmus(None, tmp_path, units=[FedByTime])
