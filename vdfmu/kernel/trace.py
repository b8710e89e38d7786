"""The functions that are traced: name, inputs, outputs and the equation behind each."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.equations.estimator import torque_estimates
from vdfmu.equations.feedforward import Gains, feedforward_inverse, feedforward_vdc
from vdfmu.equations.forward_dynamics import forward_dynamics
from vdfmu.equations.inverse_dynamics import inverse_dynamics
from vdfmu.equations.kinematics import end_effector_pose
from vdfmu.equations.mapping import jacobian, joint_space_mass_matrix
from vdfmu.equations.newton_euler import newton_euler
from vdfmu.equations.pd import pd_control
from vdfmu.equations.plant import balance, equilibrium_torque, plant_derivative, plant_outputs
from vdfmu.equations.trajectory import Desired, desired_motion
from vdfmu.kernel.derivatives import DIRECTIONS
from vdfmu.kernel.requirements import margins, requirements
from vdfmu.kernel.rodas import rodas_step
from vdfmu.kernel.structure import symbolic_robot
from vdfmu.model import Robot
from vdfmu.model.parameters import SPRING_KEYS
from vdfmu.scalar.elimination import factorize, solve
from vdfmu.scalar.symbol import from_sx, to_sx

__all__ = ["FUNCTIONS", "derivative_of"]

Trace = Callable[[Robot], ca.Function]
FUNCTIONS: dict[str, Trace] = {}
"""Name to what traces the function for the structure of a robot."""


def _traced(make: Trace) -> Trace:
    FUNCTIONS[make.__name__.removeprefix("_trace_")] = make
    return make


def derivative_of(name: str) -> tuple[str, str] | None:
    """Return the function of :data:`FUNCTIONS` and the direction of ``<name>_forward`` or ``<name>_reverse``.

    None for any other name. :mod:`vdfmu.kernel.derivatives` has what makes it.
    """
    base, _, direction = name.rpartition("_")
    return (base, direction) if direction in DIRECTIONS and base in FUNCTIONS else None


def _function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    # cse finds terms that the equations compute more than once, such as the motion in all solver stages
    expressions = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), expressions, list(inputs), list(outputs))


def _vectors(n: int, *names: str) -> dict[str, ca.SX]:
    return {name: ca.SX.sym(name, n) for name in names}


def _arrays(inputs: dict[str, ca.SX]) -> list[np.ndarray]:
    return [from_sx(expression) for expression in inputs.values()]


_DESIRED = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot")


@_traced
def _trace_inverse_dynamics(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "q_ddot") | _vectors(6, "F_e")
    q, q_dot, q_ddot, F_e = _arrays(inputs)
    tau = inverse_dynamics(symbols, q, q_dot, q_ddot, F_e)
    return _function("inverse_dynamics", inputs | {"p": p}, {"tau": to_sx(tau)})


@_traced
def _trace_newton_euler(robot: Robot) -> ca.Function:
    """For contrast only, section IV-A."""
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "q_ddot") | _vectors(6, "F_e")
    tau = newton_euler(symbols, *_arrays(inputs))
    return _function("newton_euler", inputs | {"p": p}, {"tau": to_sx(tau)})


@_traced
def _trace_forward_dynamics(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "tau") | _vectors(6, "F_e")
    q, q_dot, tau, F_e = _arrays(inputs)
    q_ddot = forward_dynamics(symbols, q, q_dot, tau, F_e)
    return _function("forward_dynamics", inputs | {"p": p}, {"q_ddot": to_sx(q_ddot)})


@_traced
def _trace_forward_kinematics(robot: Robot) -> ca.Function:
    """Position and rotation of {O} in {I}, in one vector."""
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    pose = [to_sx(part) for part in end_effector_pose(symbols, *_arrays(inputs))]
    return _function("forward_kinematics", inputs | {"p": p}, {"pose": ca.vertcat(*pose)})


@_traced
def _trace_jacobian(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    return _function("jacobian", inputs | {"p": p}, {"J_q": to_sx(jacobian(symbols, *_arrays(inputs)))})


@_traced
def _trace_mass_matrix(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    M = joint_space_mass_matrix(symbols, *_arrays(inputs))
    return _function("mass_matrix", inputs | {"p": p}, {"M": to_sx(M)})


def _plant_inputs(n: int) -> dict[str, ca.SX]:
    return _vectors(4 * n, "x") | _vectors(n, "tau") | _vectors(6, "F_e")


class _Plant:
    """The plant's right-hand side and its linearisation, as expressions.

    Links and rotors obey :func:`vdfmu.equations.plant.balance`, so their rows of ``E J`` are derivatives of the inverse
    dynamics, a third of the length of those of the forward dynamics. `E` is the identity, but for the derivatives of
    the balance with respect to q_ddot: M in the links' rows, and with `rotor_coupling` the links' part in the rotors'
    rows.
    `Ef_t` is E times the derivative along inputs that change at `rates`.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n
        symbols, p = symbolic_robot(robot)
        self.inputs = _plant_inputs(n)
        x, tau, F_e = self.inputs.values()
        arrays = _arrays(self.inputs)
        self.x_dot = to_sx(plant_derivative(symbols, *arrays))
        self.inputs["p"] = p

        q_ddot = ca.SX.sym("q_ddot", n)
        residual = to_sx(np.concatenate(balance(symbols, arrays[0], from_sx(q_ddot), *arrays[1:])))
        rates = self.rates = _vectors(n, "tau_dot") | _vectors(6, "F_e_dot")
        inputs, changes = ca.vertcat(tau, F_e), ca.vertcat(*rates.values())
        at = [x, q_ddot, tau, F_e, p, *rates.values()]
        balanced = ca.Function(
            "balance",
            at,
            [
                ca.jacobian(residual, x),
                -ca.jacobian(residual, q_ddot),
                ca.jtimes(residual, inputs, changes),
            ],
        )
        rows, E, rows_t = balanced(x, self.x_dot[n : 2 * n], tau, F_e, p, *rates.values())
        self.M, self.S = E[:n, :], E[n:, :]
        self.Ef_t = ca.vertcat(ca.SX(n, 1), rows_t, ca.SX(n, 1))
        shift = ca.horzcat(ca.SX(n, n), ca.SX.eye(n), ca.SX(n, 2 * n))  # d q_dot / d x
        self.EJ = ca.vertcat(shift, rows, ca.jacobian(self.x_dot[3 * n :], x))
        self.E = ca.diagcat(ca.SX.eye(n), self.M, ca.SX.eye(2 * n))
        self.E[2 * n : 3 * n, n : 2 * n] = self.S


@_traced
def _trace_plant_derivative(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _plant_inputs(robot.n)
    x_dot = plant_derivative(symbols, *_arrays(inputs))
    return _function("plant_derivative", inputs | {"p": p}, {"x_dot": to_sx(x_dot)})


@_traced
def _trace_plant_jacobian(robot: Robot) -> ca.Function:
    plant = _Plant(robot)
    n = robot.n
    factors = factorize(from_sx(ca.densify(plant.M)).reshape(n, n))
    rows = ca.densify(plant.EJ[n : 2 * n, :])
    links = ca.horzcat(*[to_sx(solve(factors, from_sx(rows[:, j]))) for j in range(4 * n)])
    rotors = plant.EJ[2 * n : 3 * n, :] - plant.S @ links
    J = ca.vertcat(plant.EJ[:n, :], links, rotors, plant.EJ[3 * n :, :])
    return _function("plant_jacobian", plant.inputs, {"J": J})


@_traced
def _trace_plant_step(robot: Robot) -> ca.Function:
    """One Rodas4 step, inputs linear in time, and its local error relative to the tolerance, by component."""
    plant = _Plant(robot)
    inputs = plant.inputs
    x, h, tolerance = inputs["x"], ca.SX.sym("h"), ca.SX.sym("tolerance")
    tau, F_e, p = (inputs[name] for name in ("tau", "F_e", "p"))
    tau_dot, F_e_dot = plant.rates.values()
    f = ca.Function("f", [x, tau, F_e, p], [plant.x_dot])
    # elimination order: positions, rotors, springs, each tied to its own joint; the links' dense block last
    blocks = np.arange(4 * robot.n).reshape(4, robot.n)
    order = np.concatenate(blocks[[0, 2, 3, 1]])
    x_new, error = rodas_step(
        lambda x_i, t: f(x_i, tau + t * tau_dot, F_e + t * F_e_dot, p),
        x, h, plant.E, plant.EJ, plant.Ef_t, order,
    )  # fmt: skip
    nominal = 1.0  # SI unit, of every state
    scale = tolerance * (nominal + ca.fmax(ca.fabs(x), ca.fabs(x_new)))
    ratio = error / scale
    norm = ca.sqrt(ca.sumsqr(ratio) / (4 * robot.n))
    return _function(
        "plant_step",
        inputs | plant.rates | {"h": h, "tolerance": tolerance},
        {"x_new": x_new, "norm": norm, "ratio": ratio},
    )


@_traced
def _trace_plant_outputs(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(4 * robot.n, "x")
    outputs = plant_outputs(symbols, *_arrays(inputs))
    return _function("plant_outputs", inputs | {"p": p}, {k: to_sx(v) for k, v in outputs._asdict().items()})


@_traced
def _trace_equilibrium_torque(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q") | _vectors(6, "F_e")
    tau_s = equilibrium_torque(symbols, *_arrays(inputs))
    return _function("equilibrium_torque", inputs | {"p": p}, {"tau_s": to_sx(tau_s)})


@_traced
def _trace_margins(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    return _function("margins", {"p": p}, {"margin": to_sx(margins(symbols, requirements(robot)))})


@_traced
def _trace_feedforward_inverse(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    desired, wrench = _vectors(robot.n, *_DESIRED), _vectors(6, "F_e_d")
    inputs = desired | wrench
    torques = feedforward_inverse(symbols, Desired(*_arrays(desired)), *_arrays(wrench))
    return _function(
        "feedforward_inverse", inputs | {"p": p}, {k: to_sx(v) for k, v in torques._asdict().items()}
    )


@_traced
def _trace_feedforward_vdc(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    desired = _vectors(robot.n, *_DESIRED)
    measured = _vectors(robot.n, "q", "q_dot", "kappa_dot") | _vectors(6, "F_e_d")
    gains = _vectors(robot.n, *Gains._fields)
    torques = feedforward_vdc(symbols, Gains(*_arrays(gains)), Desired(*_arrays(desired)), *_arrays(measured))
    inputs = desired | measured | gains | {"p": p}
    return _function("feedforward_vdc", inputs, {k: to_sx(v) for k, v in torques._asdict().items()})


@_traced
def _trace_trajectory(robot: Robot) -> ca.Function:
    scalars = {name: ca.SX.sym(name) for name in ("t", "T", "t_start")}
    vectors = _vectors(robot.n, "q_start", "q_end")
    t, T, t_start = (from_sx(v)[0] for v in scalars.values())
    q_start, q_end = _arrays(vectors)
    desired = desired_motion(t, q_start, q_end, T, t_start)
    return _function("trajectory", scalars | vectors, {k: to_sx(v) for k, v in desired._asdict().items()})


@_traced
def _trace_pd_control(robot: Robot) -> ca.Function:
    inputs = _vectors(robot.n, "K_p", "K_v", "ell", "tau_max", "q_d", "velocity_d", "q", "velocity", "tau_m")
    command: Any = pd_control(*_arrays(inputs))
    return _function("pd_control", inputs, {k: to_sx(v) for k, v in command._asdict().items()})


@_traced
def _trace_torque_estimates(robot: Robot) -> ca.Function:
    signals = _vectors(robot.n, "q", "kappa", "tau", "tau_hat_max")
    springs = _vectors(robot.n, *SPRING_KEYS)
    drive = SimpleNamespace(**dict(zip(springs, _arrays(springs), strict=True)))
    estimates = torque_estimates(drive, *_arrays(signals))
    return _function(
        "torque_estimates", signals | springs, {k: to_sx(v) for k, v in estimates._asdict().items()}
    )
