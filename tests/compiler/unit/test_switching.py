"""Units whose derivatives switch by time: no pulse is stepped over, however long the steps are."""

from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.linalg import expm

import vdfmu
from tests.conftest import heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError
from vdfmu.engine.inspect.inspection import inspect_file

HEAD = """
import numpy as np
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit, clip, interpolate, lookup, where
"""
MOTOR = '''

class Motor(Unit):
    """DC motor on pulses of 1 kHz."""

    duty = Input("1", text="duty", start=0.3)
    i = State("A", text="current")
    w = State("rad/s", text="speed")
    di = Derivative(i)
    dw = Derivative(w)
    u = Output("V", text="voltage")

    def bridge(self):
        return where(self.t * 1e3 - np.floor(self.t * 1e3) < DUTY, 24.0, 0.0)

    def outputs(self):
        self.u = self.bridge()

    def derivatives(self):
        self.di = (self.bridge() - 0.6 * self.i - 0.03 * self.w) / 5e-4
        self.dw = (0.03 * self.i - 0.01 - 1e-5 * self.w) / 2e-5
'''
ONE = '''

class One(Unit):
    """The integral of a function of time."""

    x = State("s", text="integral")
    x_dot = Derivative(x)

    def derivatives(self):
        self.x_dot = FUNCTION
'''
STOP = 0.1
A = np.array([[-0.6 / 5e-4, -0.03 / 5e-4], [0.03 / 2e-5, -1e-5 / 2e-5]])
GIVEN = np.array([[1 / 5e-4, 0.0], [0.0, -1 / 2e-5]])


@pytest.fixture(scope="module")
def motor(tmp_path_factory):
    def write(duty: str = "clip(self.duty, 0.0, 1.0)", text: str = MOTOR) -> Path:
        path = tmp_path_factory.mktemp("motor") / "motor.py"
        path.write_text(HEAD + text.replace("DUTY", duty).replace("FUNCTION", duty))
        return path

    return write


def moved(x: np.ndarray, voltage: float, duration: float) -> np.ndarray:
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[:2, 2:] = A, GIVEN
    return (expm(whole * duration) @ [*x, voltage, 0.01])[:2]


def pulses(duty: float) -> np.ndarray:
    x = np.zeros(2)
    for _ in range(round(STOP * 1e3)):
        x = moved(moved(x, 24.0, duty * 1e-3), 0.0, (1 - duty) * 1e-3)
    return x


@pytest.fixture(scope="module", params=[*heavy("2.0"), "3.0", "python"])
def fmu(request, motor, tmp_path_factory):
    kind = {"backend": "python"} if request.param == "python" else {"fmi_version": request.param}
    (path,) = build_fmus(None, tmp_path_factory.mktemp("fmu"), units=[motor()], **kind).values()
    return path


# Local errors of at most 1e-7 of 30 A and 250 rad/s, of 30 to 100 steps that the last 10 ms remember, the time constant
# of the motor: what is seen is 3e-7.
CLOSE = {"rtol": 1e-6, "atol": 1e-6}


@pytest.mark.few(4)
@pytest.mark.parametrize("step", [1e-3, 0.05, 0.0007])
@pytest.mark.parametrize("duty", [*heavy(0.3), 0.01, 0.0005])
def test_no_pulse_is_stepped_over(fmu, duty, step):
    rows = fmpy.simulate_fmu(
        str(fmu), fmi_type="CoSimulation", stop_time=STOP if step != 0.0007 else 0.0994, output_interval=step,
        step_size=step, start_values={"duty": duty}, output=["i", "w"],
    )  # fmt: skip
    wanted = pulses(duty)
    if step == 0.0007:  # from the middle of a pulse's period, on to its end
        wanted = moved(np.array([rows["i"][-1], rows["w"][-1]]), 0.0, 6e-4)
        np.testing.assert_allclose(wanted, pulses(duty), **CLOSE)
    else:
        np.testing.assert_allclose([rows["i"][-1], rows["w"][-1]], wanted, **CLOSE)


@pytest.mark.parametrize("fmu", [*heavy("2.0"), "3.0"], indirect=True)
@pytest.mark.parametrize("duty", [0.3, 0.01])
def test_model_exchange_has_them_as_time_events(fmu, duty):
    rows = fmpy.simulate_fmu(
        str(fmu), fmi_type="ModelExchange", stop_time=STOP, output_interval=0.05, relative_tolerance=1e-8,
        start_values={"duty": duty}, output=["i", "w"],
    )  # fmt: skip
    # CVODE's tolerance, of 200 ways between events, which are short
    np.testing.assert_allclose([rows["i"][-1], rows["w"][-1]], pulses(duty), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("step", [1e-3, 0.05])
def test_a_unit_in_python_locates_them(motor, step):
    solution = find_unit(motor())(duty=0.01).simulate(stop=STOP, step=step)
    # LSODA's 1e-9, 200 times
    np.testing.assert_allclose([solution["i"][-1], solution["w"][-1]], pulses(0.01), rtol=1e-7, atol=1e-7)


@pytest.mark.heavy
def test_a_duty_that_follows_a_state_is_located(motor, tmp_path):
    """Own solution: pulses that end where the current says, found by bisection of the exact motion."""
    path = motor("0.02 - 0.01 * self.i")
    x = np.zeros(2)
    for _ in range(round(STOP * 1e3)):
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            passed = middle > 0.02 - 0.01 * moved(x, 24.0, middle * 1e-3)[0]
            low, high = (low, middle) if passed else (middle, high)
        x = moved(moved(x, 24.0, low * 1e-3), 0.0, (1 - low) * 1e-3)
    solution = find_unit(path)().simulate(stop=STOP, step=0.05)
    np.testing.assert_allclose([solution["i"][-1], solution["w"][-1]], x, rtol=1e-6, atol=1e-6)
    (fmu,) = build_fmus(None, tmp_path, units=[path]).values()
    rows = fmpy.simulate_fmu(str(fmu), stop_time=STOP, output_interval=0.05, step_size=0.05, output=["i", "w"])
    np.testing.assert_allclose([rows["i"][-1], rows["w"][-1]], x, **CLOSE)


@pytest.mark.heavy
def test_reference_results_and_references_have_them(fmu, motor, tmp_path):
    """A voltage that switches at the rows themselves has no value there, and no column."""
    findings = inspect_file(fmu)
    assert findings.problems == []
    folder = motor().parent
    (folder / "system.toml").write_text('name = "m"\ndescription = "m"\n[components]\nm = "motor.py"\n[connections]\n')
    (folder / "scenario.toml").write_text(
        f'name = "m"\ndescription = "m"\nsystem = "system.toml"\nrobot = "planar_2dof"\nstop = {STOP}\nstep = 0.05\n'
    )
    results = vdfmu.run(folder / "scenario.toml", parameters={"m.duty": 0.01}, out=tmp_path / "r")
    for compared in results.summary["reference"].values():
        assert max(compared["max_difference"][f"m.{name}"] for name in "iw") < 1e-6  # as `CLOSE`


@pytest.mark.parametrize(("function", "integral"), [
    ("where((self.t > 0.5) & (self.t < 0.5 + 1e-6), 1e6, 0.0)", 1.0),
    ("clip(1e6 * (self.t - 0.5), 0.0, 1.0)", 0.5 - 0.5e-6),
    ("interpolate(self.t, np.array([0.4, 0.4001, 0.4002]), np.array([0.0, 1e4, 0.0]))", 1.0),
    ("where((-3.0 * self.t) % 0.3 < 1e-4, 3e4, 0.0)", 10.0),
    ("1.0 - np.sign(self.t - 0.25)", 0.5),
    ("where(np.abs(self.t - 0.7) < 1e-5, 1e5, 0.0)", 2.0),
    ("np.sin(self.t)", 1 - np.cos(1.0)),
])  # fmt: skip
def test_one_pulse_in_a_long_step_counts(motor, function, integral):
    path = motor(function, ONE)
    x = find_unit(path)().simulate(stop=1.0, step=1.0, tolerance=1e-9)["x"][-1]
    # 1e-9 relative and absolute of the steps between some switchings
    assert x == pytest.approx(integral, abs=1e-6)


@pytest.mark.parametrize(("function", "reason"), [
    ("where(np.sin(self.t) > 0.9, 1.0, 0.0)", "a condition is not linear in time"),
    ("np.floor(self.t**2)", "a condition is not linear in time"),
    ("lookup(self.t, np.arange(3.0), np.arange(2.0))", "it depends on the time and reads a table by lookup"),
])  # fmt: skip
def test_what_cannot_be_located_is_refused(motor, tmp_path, function, reason):
    with pytest.raises(UnitError, match=rf"motor\.py, line \d+: derivatives\(\) of One may switch by time: {reason}"):
        build_fmus(None, tmp_path, units=[motor(function, ONE)])
