"""Parameters that follow from others: gains of a regulator from its weights, in Python, FMUs, runs and studies."""

import fmpy
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import vdfmu
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.follow import MARK, mark
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.variable import scalar_variables
from vdfmu.system.scenario.values import system_values
from vdfmu.unit import Parameter, Unit

UNIT = '''"""A double integrator under a linear-quadratic regulator."""

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from vdfmu.unit import Input, Output, Parameter, Sampled, Unit


def sampled(period, mass):
    """State and input matrix, side by side."""
    return expm(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / mass], [0.0, 0.0, 0.0]]) * period)[:2]


def gain(AB, Q, R):
    if R > 100.0:
        raise ValueError("the force is too dear")
    A, B = AB[:, :2], AB[:, 2:]
    P = solve_discrete_are(A, B, np.diag(Q), np.array([[R]]))
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)[0]


class Regulator(Unit):
    """Regulated mass."""

    w = Input("N", text="disturbance")
    Q = Parameter("1", 2, "weights of the state", start=[1.0, 0.1], minimum=0.0)
    R = Parameter("1", text="weight of the force", start=0.01, minimum=1e-12)
    mass = Parameter("kg", text="mass", start=2.0, minimum=1e-6)
    period = Parameter("s", text="time between samples", start=0.01, minimum=1e-6)
    AB = Parameter("1", (2, 3), "matrices of the mass", start=sampled)
    K = Parameter("1", 2, "gain", start=gain)
    x = Sampled("1", 2, "position and velocity", start=[1.0, 0.0])
    u = Output("N", text="force")

    def outputs(self) -> None:
        self.u = -self.K @ self.x

    def update(self) -> None:
        self.x = self.AB[:, :2] @ self.x + self.AB[:, 2] * (self.w - self.K @ self.x)
'''
SYSTEM = """
name = "regulated"
description = "A mass and its regulator"
[units]
lqr = "regulator.py"
"""
SCENARIO = """
name = "regulated"
description = "A mass and its regulator"
system = "system.toml"
robot = "planar_2dof"
stop = 0.2
step = 0.01
master = "jacobi"
"""


def gains(Q, R=0.01, mass=2.0, period=0.01):
    """Return the gain by another way to the same: the matrices in closed form."""
    A, B = np.array([[1.0, period], [0.0, 1.0]]), np.array([[0.5 * period**2], [period]]) / mass
    P = solve_discrete_are(A, B, np.diag(Q), [[R]])
    return (np.linalg.inv(B.T @ P @ B + R) @ B.T @ P @ A)[0]


@pytest.fixture
def folder(tmp_path):
    for name, text in (("regulator.py", UNIT), ("system.toml", SYSTEM), ("scenario.toml", SCENARIO)):
        (tmp_path / name).write_text(text)
    return tmp_path


# Two ways to one Riccati equation, of a condition around 1e4.
CLOSE = {"rtol": 1e-9, "atol": 0}


def test_what_follows_is_calculated_from_what_is_set(folder):
    unit = find_unit(folder / "regulator.py")
    assert unit.follows == {"AB": ("period", "mass"), "K": ("AB", "Q", "R"), MARK: ("period", "mass", "Q", "R")}
    made = unit(Q=[5.0, 0.2], mass=3.0)
    np.testing.assert_allclose(made.K, gains([5.0, 0.2], mass=3.0), **CLOSE)
    made.period = 0.05
    np.testing.assert_allclose(made.K, gains([5.0, 0.2], mass=3.0, period=0.05), **CLOSE)
    made.K = [1.0, 2.0]  # an own value stays
    made.mass = 1.0
    assert made.K.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(made.AB[1], [0.0, 1.0, 0.05], rtol=1e-15)
    made.simulate(stop=0.1, step=0.05)


@pytest.mark.heavy
def test_start_values_of_an_fmu_follow(folder):
    (path,) = vdfmu.build_fmus(
        None, folder, units=[folder / "regulator.py"], start_values={"regulator": {"Q[1]": 7.0, "R": 0.5}}
    ).values()
    starts = {v.name: v.start for v in fmpy.read_model_description(str(path)).modelVariables}
    np.testing.assert_allclose([float(starts["K[1]"]), float(starts["K[2]"])], gains([7.0, 0.1], R=0.5), **CLOSE)


@pytest.mark.heavy
@pytest.mark.parametrize("backend", ["native", "python"])
def test_an_fmu_refuses_values_for_which_nothing_was_calculated(folder, backend, caplog):
    (path,) = vdfmu.build_fmus(None, folder, units=[folder / "regulator.py"], backend=backend).values()

    def run(**values):
        messages = []
        caplog.clear()

        def log(environment, instance, status, category, message):
            messages.append(message.decode())

        try:
            return fmpy.simulate_fmu(
                str(path), stop_time=0.05, output_interval=0.01, start_values=values, logger=log, output=["u", "K[1]"]
            )
        except Exception:
            return " ".join([*messages, caplog.text])  # where a Python FMU is heard too

    assert run()["K[1]"][0] == pytest.approx(gains([1.0, 0.1])[0], rel=1e-9)
    for values in ({"Q[1]": 1.0 + 1e-7}, {"R": 0.02}, {"period": 0.005}, {"Q[1]": 0.1, "Q[2]": 1.0}):
        assert "expected the mark of period, mass, Q, R, for which AB, K followed in Python" in run(**values)
    own = {"Q[1]": 3.0, "K[1]": 2.0, "K[2]": 1.0, MARK: 0.0}
    assert run(**own)["u"][0] == -2.0


def test_the_mark_differs_for_other_values_and_is_the_same_in_c(folder):
    random = np.random.default_rng(0)
    for scale in (1e-12, 1.0, 1e12):
        values = random.normal(size=20) * scale
        known = mark([values, 0.0])
        assert mark([values * (1.0 + 1e-15), 0.0]) == pytest.approx(known, rel=1e-13)
        for k in range(20):
            for factor in (1.0 + 1e-7, -1.0, 0.0):
                other = values.copy()
                other[k] *= factor
                assert abs(mark([other, 0.0]) - known) > 1e-12 * known  # what is allowed


def test_settings_and_sections_of_a_scenario(folder):
    scenario = vdfmu.load_scenario(folder / "scenario.toml")
    for settings, expected in (
        ({}, gains([1.0, 0.1])),
        ({"lqr.Q": 4.0}, gains([4.0, 4.0])),
        ({"lqr.period": 0.02, "lqr.R": 1.0}, gains([1.0, 0.1], R=1.0, period=0.02)),
    ):
        values = system_values(scenario, settings)["lqr"]
        np.testing.assert_allclose([values["K[1]"], values["K[2]"]], expected, **CLOSE)
    values = system_values(scenario, {"lqr.Q": 4.0, "lqr.K[2]": 0.5})["lqr"]
    assert (values["K[1]"], values["K[2]"]) == (pytest.approx(gains([4.0, 4.0])[0], rel=1e-9), 0.5)
    (folder / "scenario.toml").write_text(SCENARIO + "[lqr]\nQ = [9.0, 0.3]\n")
    values = system_values(vdfmu.load_scenario(folder / "scenario.toml"), {"lqr.R": 0.1})["lqr"]
    np.testing.assert_allclose([values["K[1]"], values["K[2]"]], gains([9.0, 0.3], R=0.1), **CLOSE)
    with pytest.raises(
        UnitError,
        match=r"regulator\.py, line \d+: Regulator: K: start: the function fails for .*R = 200\.0: ValueError: the",
    ):
        system_values(scenario, {"lqr.R": 200.0})


@pytest.mark.heavy
def test_a_study_of_weights_has_the_gains_of_each(folder):
    weights = [0.1, 1.0, 30.0]
    study = vdfmu.sweep(
        folder / "scenario.toml", {"lqr.Q[1]": weights}, measure={"u": "first(lqr.u)"}, workers=1,
        out=folder / "study",
    )  # fmt: skip
    found = [row["u"] for row in sorted(study.table().to_pylist(), key=lambda row: row["point"])]
    np.testing.assert_allclose(found, [-gains([q, 0.1])[0] for q in weights], **CLOSE)


@pytest.mark.heavy
def test_a_point_for_which_the_function_fails_is_a_failed_row(folder):
    study = vdfmu.sweep(
        folder / "scenario.toml", {"lqr.R": [1.0, 200.0]},
        measure={"u": "first(lqr.u)"}, workers=1, out=folder / "study"
    )  # fmt: skip
    good, bad = sorted(study.table().to_pylist(), key=lambda row: row["point"])
    assert good["u"] == pytest.approx(-gains([1.0, 0.1], R=1.0)[0], rel=1e-9)
    assert "lqr" in bad["failed"] and "finite" in bad["failed"]


SQUARED = """
from vdfmu.unit import Derivative, Parameter, State, Unit

class Squared(Unit):
    '''Decay at a rate that follows.'''

    a = Parameter("1", start=2.0)
    rate = Parameter("1/s", start=lambda a: a * a)
    x = State("1", start=1.0)
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        self.x_dot = -self.rate * self.x
"""


@pytest.mark.heavy
@pytest.mark.parametrize("engine", ["fmu", "batch"])
def test_both_engines_of_studies_follow(folder, engine):
    (folder / "squared.py").write_text(SQUARED)
    (folder / "system.toml").write_text(SYSTEM.replace("lqr", "squared").replace("regulator.py", "squared.py"))
    study = vdfmu.sweep(
        folder / "scenario.toml", {"squared.a": [0.5, 1.0, 3.0]}, measure={"x": "final(squared.x)"}, workers=1,
        engine=engine, out=folder / "study",
    )  # fmt: skip
    found = [row["x"] for row in sorted(study.table().to_pylist(), key=lambda row: row["point"])]
    # the solver's tolerance is 1e-7
    np.testing.assert_allclose(found, np.exp(-0.2 * np.array([0.25, 1.0, 9.0])), rtol=0, atol=1e-6)


@pytest.mark.heavy
def test_a_run_follows_its_settings_and_its_reference_too(folder):
    results = vdfmu.run(folder / "scenario.toml", settings={"lqr.Q[1]": 30.0}, out=folder / "out")
    x, K = np.array([1.0, 0.0]), gains([30.0, 0.1])
    assert results["lqr.u"][0] == pytest.approx(-K @ x, rel=1e-9)
    AB = expm(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]) * 0.01)[:2]
    for k in range(1, len(results)):
        x = (AB[:, :2] - np.outer(AB[:, 2], K)) @ x
        # twenty products of a stable loop
        assert results["lqr.x"][k] == pytest.approx(x, abs=1e-9)


def test_functions_of_the_robot_alone_are_as_they_were():
    class Known(Unit):
        """Takes the robot, by any name, and a default."""

        joints = Parameter("1", start=lambda arm, scale=2.0: scale * arm.n)

    assert Known.follows == {}
    assert scalar_variables(Known, vdfmu.load_robot("planar_2dof"))[0].start == 4.0


def test_what_cannot_follow_is_refused():
    with pytest.raises(UnitError, match=r"a <- b <- a|b <- a <- b: these parameters follow from each other"):
        type("Circle", (Unit,), {"a": Parameter(start=lambda b: b), "b": Parameter(start=lambda a: a)})
    with pytest.raises(UnitError, match=r"b: start: expected parameters and one argument for the robot, got x, y"):
        type("Unknown", (Unit,), {"a": Parameter(), "b": Parameter(start=lambda a, x, y: a)})
    for limit in ({"minimum": 3.0}, {"maximum": 1.0}):
        beyond = type("Beyond", (Unit,), {"a": Parameter(start=2.0), "b": Parameter(start=lambda a: a, **limit)})
        with pytest.raises(UnitError, match=r"b: start: expected finite numbers within the limits, got 2\.0"):
            Interface(beyond, None)
    with pytest.raises(UsageError, match="has no 'c' to set"):
        type("Other", (Unit,), {"a": Parameter(), "b": Parameter(start=lambda a: a)})(c=1.0)
