"""The unit Plant: the arm with its drives."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import OptionState
from vdfmu.arm.drive.options import OPTIONS
from vdfmu.arm.equations.flexible_joint import rest_state, state_names
from vdfmu.arm.equations.inverse_dynamics import AT_REST, Base
from vdfmu.arm.equations.plant import balance, equilibrium_torque, plant_derivative, plant_outputs
from vdfmu.arm.signals import (
    ACCELERATION,
    MASS,
    MEASURED,
    VELOCITY,
    WRENCH,
    base_motion,
    base_of,
    six,
    wave_wrench,
    wrench,
)
from vdfmu.arm.world.attachment import Load, base_load, tool_motion
from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit import (
    JOINTS,
    Derivative,
    Input,
    Output,
    Parameter,
    RobotParameters,
    State,
    Switch,
    Terminal,
    Unit,
)
from vdfmu.compiler.unit.declaration import Declared, Variables

_ADDED = [(name, option.state) for name, option in OPTIONS.items() if option.state]
_STATES = {s.name: State(s.unit, JOINTS, s.text, when=name) for name, s in _ADDED}
_RATES = {f"der_{name}": Derivative(state) for name, state in _STATES.items()}
_STARTS = {
    f"{s.name}_0": Parameter(s.unit, JOINTS, s.start_text, start=s.start, minimum=s.minimum, when=name)
    for name, s in _ADDED
}


@cache
def _own_variables(state: OptionState) -> tuple[Declared, ...]:
    """Return state, derivative and start of a robot's own drive."""
    declared_state = State(state.unit, JOINTS, state.text)
    start = Parameter(state.unit, JOINTS, state.start_text, start=state.start, minimum=state.minimum)
    named = {state.name: declared_state, f"der_{state.name}": Derivative(declared_state), f"{state.name}_0": start}
    return tuple(Variables(named).values())


class Plant(Unit):
    """Serial manipulator with flexible harmonic-drive joints, Eq. (4)-(11), (29)-(47), (54)-(56).

    Numbers in brackets are the paper's. q is the position of a link, kappa the position of its rotor divided by the
    reduction ratio ell, tau_s the spring torque, link-side. For a prismatic joint read m for rad and N for N.m on the
    link side. The state is q, q_dot, kappa_dot, tau_s::

        M(q) q_ddot + C q_dot + G = tau_s - xi_l - J_q' F_e                       links, (9)
        I_m kappa_ddot = tau - tau_s / ell - xi_m                                 rotors, (10), (56)
        tau_s_dot = [kappa_dot (1 - theta_err'(kappa)) - q_dot] / D'(tau_s)       springs, (2)-(3)
        kappa = q + D(tau_s) + theta_err(kappa)

    with the deformation of the harmonic drive, its kinematic error, and friction::

        D(tau) = atan(c_f tau) / (c_f K_f0) + sgn(tau) (1 - exp(-c_w |tau| / ell)) / (c_w ell K_w0)
        theta_err(kappa) = A sin(2 ell kappa + phi)
        xi(v) = [f_c + (f_s - f_c) exp(-(v / v_s)^2)] tanh(v / eps) + f_v v       (54)
        lumped: xi_l = 0, xi_m = xi(kappa_dot) / ell
        split:  xi_l = xi(q_dot), xi_m = f_ck tanh(kappa_dot / eps)               (54)-(55)

    A robot with rotor_coupling has rotors as bodies that turn with the links, (4), (7), (11). Drives and motors may
    have options, some with their own states: hysteresis (tau_h), friction that holds at rest (tau_z), a winding with
    its current loop (i_m), a temperature (T_j), load-dependent loss, backlash; or a counterbalance, a gas spring
    between two links, whose torque adds to the right of (9).

    The springs start with the torque that holds the arm under F_e unless equilibrium is false. Outputs depend only on
    the state. Friction is regularised by tanh(v / eps), so the equations are smooth and have no events; sticking is a
    creep slower than eps. At a tolerance of 1e-7 the phase of stiff springs drifts over thousands of cycles of
    oscillation; compare with 1e-9. Energies: E_kin of links and rotors, E_pot of gravity, E_spring of drives, stops,
    counterbalances.

    A robot with moving_base is mounted on a frame {S} whose motion is an input; the wrench of the base on the arm
    depends on its acceleration A_S, and so does the acceleration A_O of the tool of a robot with coupled_tool on its
    load::

        F_S = M_S A_S + F_S0                 M_S: apparent mass matrix of the arm, F_S0: wrench at A_S = 0
        F   = M_e A_O + F_e                  wrench of the arm on a load; M_e = 0: on its surroundings, F_e

    M_S and F_S0 of an arm are M_e and F_e of the arm that carries it.
    """

    tau = Input("N.m", JOINTS, "motor torque, motor-side")
    F_e = wrench("of the arm on its surroundings")
    M_e = Input(*MASS, "Apparent mass matrix of the load at the end effector in {O}", when="coupled_tool")
    p_S = Input("m", 3, "Position of the base frame {S} in {I}, axis", when="moving_base")
    R_S, V_S, A_S = base_motion()
    q = State(*MEASURED["q"])
    q_dot = State(*MEASURED["q_dot"])
    kappa_dot = State(*MEASURED["kappa_dot"])
    tau_s = State(*MEASURED["tau_s"])
    states_of_options = Variables(_STATES)
    der_q = Derivative(q)
    der_q_dot = Derivative(q_dot)
    der_kappa_dot = Derivative(kappa_dot)
    der_tau_s = Derivative(tau_s)
    rates_of_options = Variables(_RATES)
    kappa = Output(*MEASURED["kappa"])
    p_O = Output("m", 3, "Position of the end effector in {I}, axis")
    R_O = Output("1", (3, 3), "Rotation matrix of the end effector in {I}")
    E_kin = Output("J", text="Kinetic energy of links and rotors")
    E_pot = Output("J", text="Potential energy of gravity")
    E_spring = Output("J", text="Elastic energy of drives, end stops and counterbalances")
    # fmt: off
    V_O = Output(*VELOCITY, six("Velocity of the end effector in {O}", "Angular velocity of the end effector in {O}"),
                 when="coupled_tool")
    A_O = Output(*ACCELERATION, six("Acceleration of the origin of {O} in {O}",
                                    "Angular acceleration of the end effector in {O}"), when="coupled_tool")
    F_S = Output(*WRENCH, six("Force of the base on the arm in {S}", "Moment of the base on the arm in {S}"),
                 when="moving_base")
    M_S = Output(*MASS, "Apparent mass matrix of the arm at its base in {S}", when="moving_base")
    F_S0 = Output(*WRENCH, six("Force of the base on the arm at A_S = 0 in {S}",
                               "Moment of the base on the arm at A_S = 0 in {S}"), when="moving_base")
    # fmt: on
    q_0 = Parameter("position", JOINTS, "start position of the link")
    q_dot_0 = Parameter("velocity", JOINTS, "start velocity of the link")
    equilibrium = Switch(
        True,
        "Start the springs with the torque that holds the arm under F_e, and the rotors with the velocity of their "
        "links; otherwise from kappa_dot_0 and tau_s_0",
    )
    kappa_dot_0 = Parameter("velocity", JOINTS, "start velocity of the rotor, without equilibrium")
    tau_s_0 = Parameter("torque", JOINTS, "start spring torque, link-side, without equilibrium")
    starts_of_options = Variables(_STARTS)
    robot = RobotParameters()
    terminals = (
        Terminal(
            "joints",
            "left",
            ("tau", "q", "q_dot", "kappa_dot", "tau_s", "kappa", *_STATES),
            "Motor torques and motion of the joints",
        ),
        Terminal(
            "end_effector", "right", ("F_e", "p_O", "R_O", "V_O", "A_O", "M_e"), "Wrench and pose of the end effector"
        ),
        Terminal("base", "bottom", ("p_S", "R_S", "V_S", "A_S", "F_S", "M_S", "F_S0"), "Motion and wrench of the base"),
    )
    # positions, rotors and springs are each tied to their own joint; the links' dense block last
    elimination = ("q", *reversed(_STATES), "kappa_dot", "tau_s", "q_dot")
    chain = 9  # from here on elimination along the chain takes fewer operations than elimination of the dense block
    experiment_stop = 0.2

    @classmethod
    def declared_for(cls, robot: Any) -> dict[str, Declared]:
        """Variables by name, with the states of the robot's own drive."""
        states = [option.state for option in getattr(robot, "own_options", ()) if option.state]
        variables = {d.name: d for state in states for d in _own_variables(state)}
        if taken := variables.keys() & cls.declared.keys():
            raise UnitError(f"{', '.join(sorted(taken))}: the Plant already has one. Rename the state of the drive.")
        return super().declared_for(robot) | variables

    def _x(self, prefix: str = "") -> Any:
        """State, or with the prefix ``der_`` its derivative."""
        return np.concatenate([self._read(self.declared[prefix + name]) for name in state_names(self.of_robot)])

    def _ends(self) -> tuple[Base, Load | None]:
        return base_of(self), Load(self.M_e) if self.robot.coupled_tool else None

    def start(self) -> None:
        """Rest under the wrench on a base at rest, or the start values."""
        self.q, self.q_dot = self.q_0, self.q_dot_0
        if self.equilibrium:
            self.kappa_dot = self.q_dot_0
            base = Base(self.R_S) if self.robot.moving_base else AT_REST
            self.tau_s = equilibrium_torque(self.robot, self.q_0, self.F_e, base)
        else:
            self.kappa_dot, self.tau_s = self.kappa_dot_0, self.tau_s_0
        rest = rest_state(self.robot, self.tau_s) if self.equilibrium else {}
        for name in state_names(self.of_robot)[4:]:
            self._write(self.declared[name], rest[name] if name in rest else self._read(self.declared[f"{name}_0"]))

    def outputs(self) -> None:
        """Calculate the outputs of the plant in addition to its state."""
        robot, x = self.robot, self._x()
        base = (self.p_S, Base(self.R_S, self.V_S)) if robot.moving_base else ()
        self.kappa, self.p_O, self.R_O, self.E_kin, self.E_pot, self.E_spring = plant_outputs(robot, x, *base)
        if robot.coupled_tool:
            V_O, self.A_O = tool_motion(robot, x, self.tau, self.F_e, *self._ends())
            if robot.moving_base:
                V_O = V_O + np.concatenate([self.R_O.T @ (self.R_S @ self.V_S[:3]), np.zeros(3)])
            self.V_O = V_O
        if robot.moving_base:
            self.M_S, self.F_S0 = base_load(robot, x, self.tau, self.F_e, *self._ends())
            self.F_S = self.M_S @ self.A_S + self.F_S0

    def derivatives(self) -> None:
        """Eq. (9), (10) and the springs, in the order of the docstring; then the states of options."""
        x_dot = plant_derivative(self.robot, self._x(), self.tau, self.F_e, *self._ends())
        names = state_names(self.of_robot)
        for name, rate in zip(names, np.split(x_dot, len(names)), strict=True):
            self._write(self.declared[f"der_{name}"], rate)

    def balance(self) -> Any:
        """Balance of forces from inverse dynamics, whose derivatives are shorter than those of the accelerations."""
        return balance(self.robot, self._x(), self._x("der_"), self.tau, self.F_e, *self._ends())

    def experiment(self) -> None:
        """Torques that hold the arm at its start and push it slightly harder than friction, and a small wrench."""
        hold = equilibrium_torque(self.robot, self.q_0)
        ramp = np.sin(np.pi * self.t / self.experiment_stop) ** 2
        push = 1.5 * self.robot.f_s * ramp * (-1.0) ** np.arange(self.n)
        self.tau = (hold + push) / self.robot.ell
        self.F_e = wave_wrench(self.t)
        if self.robot.moving_base:
            self.V_S, self.A_S = wave_wrench(self.t), 2.0 * wave_wrench(self.t + 0.5 * np.pi)
