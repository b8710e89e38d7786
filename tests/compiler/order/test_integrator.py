"""Error control of the integrator: error against tolerance, and failure; states are saved in native/test_state.py."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.conftest import heavy
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import KernelError
from vdfmu.compiler.unit import solver as module
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import MAXIMUM_STEPS, Integrator


def start_of(robot):
    n = robot.n
    q = np.linspace(0.3, 0.9, n)
    return np.concatenate([q, np.full(n, 0.5), np.full(n, 0.4), 0.7 * equilibrium_torque(robot, q)])


def integrator_of(robot, tolerance=1e-9):
    integrator = Integrator(Traced(Interface(Plant, robot)))
    integrator.x[:] = start_of(robot)
    integrator.unit.group("tau")[:] = 0.05
    integrator.unit.group("F_e")[:] = [1.0, -2.0, 0.5, 0.1, 0.0, -0.2]
    integrator.tolerance = tolerance
    return integrator


DURATION = 0.05


def reference(robot, plant_function, duration=DURATION):
    """Return the state by scipy's Radau with the traced right-hand side and Jacobian."""
    held = integrator_of(robot)
    inputs = held.unit.group("tau"), held.unit.group("F_e")
    f, jacobian = (plant_function(robot, name) for name in ("derivatives", "jacobian"))
    solution = solve_ivp(
        lambda _, x: f(x, *inputs), (0.0, duration), held.x.copy(), method="Radau",
        jac=lambda _, x: jacobian(x, *inputs), rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert solution.success
    return solution.y[:, -1]


@pytest.mark.heavy
@pytest.mark.parametrize("friction", ["shipped", "smooth"])
def test_error_is_proportional_to_the_tolerance(planar, plant_function, friction):
    robot = planar if friction == "shipped" else planar.with_parameters(f_c=0.0, f_s=0.0)
    exact = reference(robot, plant_function)
    tolerances = np.array([1e-5, 1e-6, 1e-7, 1e-8, 1e-9])
    errors = []
    for tolerance in tolerances:
        integrator = integrator_of(robot, tolerance)
        integrator.advance(0.0, DURATION)
        errors.append(np.abs((integrator.x - exact) / (1.0 + np.abs(exact))).max())
    # Step h ~ tolerance^(1/4) from an error estimate of h^4, global error of order 4: proportional. The steps
    # of single tolerances scatter, by a factor of 3 or so over 4 decades: 0.15 in the exponent.
    slope = np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.15)
    # Local errors add over some hundred steps, and are damped: at most 100 times the tolerance.
    assert (np.array(errors) < 100.0 * tolerances).all()


@pytest.mark.parametrize("name", ["planar_2dof", *heavy("manipulator_6dof", "slider_3dof")])
def test_error_is_within_the_tolerance_for_every_robot(name, plant_function):
    robot = load_robot(name).with_parameters(eps=0.05)
    integrator = integrator_of(robot, 1e-8)
    integrator.advance(0.0, 0.02)
    exact = reference(robot, plant_function, 0.02)
    # As above.
    assert np.abs((integrator.x - exact) / (1.0 + np.abs(exact))).max() < 100.0 * 1e-8


def test_short_communication_steps_change_nothing_but_the_time(planar):
    integrator = integrator_of(planar)
    x, h = integrator.x.copy(), integrator.h
    integrator.advance(1.0, 0.0)
    np.testing.assert_array_equal(integrator.x, x)
    assert integrator.h == h and integrator.steps == 0
    integrator = integrator_of(planar, 1e-6)
    integrator.advance(0.0, 0.02)
    h = integrator.h
    assert h > 1e-6
    integrator.advance(0.02, 1e-7)
    assert integrator.h >= h


def fails(integrator, message):
    x, h = integrator.x.copy(), integrator.h
    with pytest.raises(KernelError, match=message):
        integrator.advance(0.25, 0.01)
    np.testing.assert_array_equal(integrator.x, x)
    assert integrator.h == h


def test_tolerance_that_cannot_be_met_names_time_and_state(planar):
    integrator = integrator_of(planar, 1e-300)
    fails(
        integrator,
        r"at t = 0\.25 s the local error of state (q|q_dot|kappa_dot|tau_s)\[[12]\] is .* times the "
        r"tolerance 1e-300, and the internal step reached its minimum 1e-12 s\. Check its inputs",
    )
    assert integrator.rejected > 0
    # The same integrator goes on once it can.
    integrator.tolerance = 1e-6
    integrator.advance(0.25, 0.001)
    assert np.isfinite(integrator.x).all()


def test_a_call_that_takes_too_many_internal_steps_is_ended_and_changes_nothing(planar, monkeypatch):
    """The limit counts rejected steps too; a call that needs just as many is made."""
    counted, limited = integrator_of(planar), integrator_of(planar)
    before = limited.x.copy(), limited.h
    counted.advance(0.0, DURATION)
    needed = counted.steps + counted.rejected
    monkeypatch.setattr(module, "MAXIMUM_STEPS", needed - 1)
    words = (
        rf"^at t = 2\.0\d* s the communication step of {DURATION} s is not done after {needed - 1} internal steps, "
        r"the last of \S+ s\. Take shorter communication steps\. Check its inputs and the gains behind them, its "
        r"start and its parameters, or loosen the tolerance\.$"
    )
    with pytest.raises(KernelError, match=words):
        limited.advance(2.0, DURATION)
    assert np.array_equal(limited.x, before[0]) and limited.h == before[1]
    monkeypatch.setattr(module, "MAXIMUM_STEPS", needed)
    limited.advance(0.0, DURATION)
    assert np.array_equal(limited.x, counted.x)


@pytest.mark.heavy
def test_the_limit_of_internal_steps_is_far_from_use(arm):
    """0.1 s as one step at 1e-9, under a torque and a wrench: below a hundredth of the limit, which 10 s then keep."""
    integrator = integrator_of(arm, 1e-9)
    integrator.advance(0.0, 0.1)
    assert integrator.steps + integrator.rejected < MAXIMUM_STEPS / 100
