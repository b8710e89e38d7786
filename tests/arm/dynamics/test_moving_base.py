"""An arm on a moving base, and under a load with a mass: against Pinocchio with a free joint as root, and by laws."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from tests.arm.balanced import EVERY_CHAIN
from tests.arm.dynamics.rotor_bodies import RotorBodies
from tests.conftest import random_inertia, random_rotation
from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.flexible_joint import split_state
from vdfmu.arm.equations.forward_dynamics import articulated, forward_dynamics
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import Base, gravity_in_links, inverse_dynamics, link_motion
from vdfmu.arm.equations.kinematics import tool_transform
from vdfmu.arm.equations.plant import plant_derivative, plant_outputs
from vdfmu.arm.equations.rigid_body import coriolis_force, gravity_force, mass_matrix
from vdfmu.arm.equations.spatial import skew
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.world.attachment import Load, base_load, moving_base, point_acceleration, tool_motion
from vdfmu.compiler.scalar.jet import derivative, jets

# Of the largest: some 5000 roundings on either side, and solutions with mass matrices of a condition up to 1e4.
CLOSE = 1e-10
EPS = np.finfo(float).eps


class Ride(NamedTuple):
    """Motion of a base: rotation in {I}, velocity in {S}, classical and angular acceleration, in {S}."""

    R_S: np.ndarray
    V_S: np.ndarray
    A_S: np.ndarray

    def base(self, robot):
        """Return it as the equations take it."""
        return moving_base(self.R_S, self.V_S[3:], self.A_S)


def rides(count, seed):
    random = np.random.default_rng(seed)
    return [Ride(random_rotation(random), random.normal(size=6), 3.0 * random.normal(size=6)) for _ in range(count)]


def close(actual, expected, share=CLOSE):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=share * np.abs(expected).max())


class Flying:
    """A Pinocchio model behind a free joint, whose motion is prescribed."""

    def __init__(self, model, robot):
        root = pin.Model()
        root.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        root.addFrame(pin.Frame("mount", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        self.model = pin.appendModel(root, model, root.getFrameId("mount"), pin.SE3.Identity())
        self.model.gravity = model.gravity  # which that does not take over
        self.data = self.model.createData()
        self.tool, self.robot = max(i for i, n in enumerate(self.model.names) if "joint" in n), robot

    def solve(self, ride, q, q_dot, tau, F_e):
        """Accelerations of the joints, and the wrench of the base on the arm."""
        place = np.concatenate([np.zeros(3), pin.Quaternion(ride.R_S).coeffs(), q])
        v = np.concatenate([ride.V_S, q_dot])
        turning = point_acceleration(ride.V_S, np.zeros(6))
        a = np.concatenate([ride.A_S - turning, np.zeros(len(q))])  # its own is the derivative of coordinates
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        tool = pin.SE3(np.array(self.robot.tool_rotation), np.array(self.robot.tool_offset))
        forces[self.tool] = tool.act(pin.Force(-F_e[:3], -F_e[3:]))
        held = pin.rnea(self.model, self.data, place, v, a, forces)
        still = pin.rnea(self.model, self.data, place, 0.0 * v, 0.0 * v)
        columns = [pin.rnea(self.model, self.data, place, 0.0 * v, e) - still for e in np.eye(len(v))]
        M = np.column_stack(columns)  # crba needs each subtree in one piece, which rotors behind the links are not
        q_ddot = np.linalg.solve(M[6:, 6:], tau - held[6:])
        return q_ddot, held[:6] + M[:6, 6:] @ q_ddot


def test_links_on_a_moving_base_agree_with_a_free_root(chain, draw, pinocchio_model):
    flying = Flying(pinocchio_model(chain), chain)
    for state, ride in zip(draw(chain, 20, seed=11), rides(20, 12), strict=True):
        q_ddot, F_S = flying.solve(ride, state.q, state.q_dot, state.tau_s, state.F_e)
        base = ride.base(chain)
        close(forward_dynamics(chain, state.q, state.q_dot, state.tau_s, state.F_e, base=base), q_ddot)
        tau = inverse_dynamics(chain, state.q, state.q_dot, q_ddot, state.F_e, base=base)
        close(tau, state.tau_s, CLOSE * 10)  # the torque of one joint is the difference of larger ones
        M_S, F_S0 = articulated(chain, state.q, state.q_dot, state.tau_s, state.F_e, None, base, None).arm
        close(M_S @ ride.A_S + F_S0, F_S)
        close(M_S, M_S.T, 1e-13)  # of sums of symmetric matrices


def test_rotors_on_a_moving_base_agree_with_bodies_on_a_free_root(chain, draw):
    robot = dataclasses.replace(chain, rotor_coupling=True)
    n, flying = robot.n, Flying(RotorBodies(robot).model, robot)
    for state, ride in zip(draw(robot, 20, seed=13), rides(20, 14), strict=True):
        xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot)
        accelerations, F_S = flying.solve(
            ride, np.concatenate([state.q, 17.0 * state.kappa_dot]),
            np.concatenate([state.q_dot, robot.ell * state.kappa_dot]),
            np.concatenate([state.tau_s - xi_l, state.tau - state.tau_s / robot.ell - xi_m]), state.F_e,
        )  # fmt: skip
        base = ride.base(robot)
        x_dot = plant_derivative(robot, state.x, state.tau, state.F_e, base)
        close(x_dot[n : 2 * n], accelerations[:n])
        close(x_dot[2 * n : 3 * n], accelerations[n:] / robot.ell)
        M_S, F_S0 = base_load(robot, state.x, state.tau, state.F_e, base, None)
        close(M_S @ ride.A_S + F_S0, F_S)


def test_gravity_is_an_acceleration_of_the_base_and_a_base_that_turns_about_the_axis_of_joint_1_is_joint_1(chain, draw):
    floating = dataclasses.replace(chain, gravity=np.zeros(3))
    for state, ride in zip(draw(chain, 5, seed=18), rides(5, 19), strict=True):
        upward = np.concatenate([ride.R_S.T @ chain.gravity, np.zeros(3)])
        lifted = moving_base(ride.R_S, np.zeros(3), upward)
        tilted = moving_base(ride.R_S, np.zeros(3), np.zeros(6))
        motion = state.q, state.q_dot, state.q_ddot, state.F_e
        close(
            inverse_dynamics(floating, *motion, base=lifted),
            inverse_dynamics(chain, *motion, base=tilted),
            1e-13,  # the same sums in another order
        )
    for state in draw(chain, 5, seed=20):
        posed, ride = turned(chain, 0.7, 1.3, -2.1)
        first = np.eye(chain.n)[0]
        torque = inverse_dynamics(chain, state.q, state.q_dot, state.q_ddot, state.F_e, base=ride.base(chain))
        moved = state.q + 0.7 * first, state.q_dot + 1.3 * first, state.q_ddot - 2.1 * first
        close(torque, inverse_dynamics(chain, *moved, state.F_e), 1e-12)
        shown = plant_outputs(dataclasses.replace(chain, rotor_coupling=False), state.x, *posed)
        other = np.concatenate([moved[0], moved[1], state.kappa_dot, state.tau_s])
        expected = plant_outputs(dataclasses.replace(chain, rotor_coupling=False), other)
        for name in ("p_O", "R_O", "E_kin", "E_pot"):
            close(getattr(shown, name), getattr(expected, name), 1e-12)


def turned(robot, angle, rate, acceleration):
    """Return the place and motion of a base that turns about the axis of joint 1, and its ride."""
    axis, place = robot.rotation[0][:, 2], np.array(robot.offset[0])
    R_S = Rotation.from_rotvec(angle * axis).as_matrix()
    omega, alpha = rate * axis, acceleration * axis
    v = np.cross(omega, -place)
    a = np.cross(alpha, -place) + np.cross(omega, v)
    V_S = np.concatenate([v, omega])
    return (place - R_S @ place, Base(R_S, V_S)), Ride(R_S, V_S, np.concatenate([a, alpha]))


def test_a_load_with_the_mass_of_a_body_is_a_payload(chain, draw):
    bare = dataclasses.replace(chain, payload=False)
    random = np.random.default_rng(21)
    body = 1.7, random.normal(scale=0.1, size=3), 1.7 * random_inertia(random, 0.1)
    loaded = dataclasses.replace(chain, payload=True).with_parameters(
        payload_mass=body[0], payload_centroid=body[1], payload_inertia=body[2]
    )
    for state, ride in zip(draw(chain, 5, seed=22), rides(5, 23), strict=True):
        base = ride.base(chain)
        motion = link_motion(bare, state.q, state.q_dot, np.zeros(chain.n), base=base)
        omega_O = (tool_transform(bare).T @ motion.V_B[-1])[3:]
        g_O = bare.tool_rotation.T @ gravity_in_links(bare, motion.U_AB, base=base)[-1]
        turning = coriolis_force(*body, np.concatenate([np.zeros(3), omega_O]))
        F_e = state.F_e + turning + gravity_force(*body[:2], g_O)
        close(
            plant_derivative(bare, state.x, state.tau, F_e, base, Load(mass_matrix(*body))),
            plant_derivative(loaded, state.x, state.tau, state.F_e, base),
        )


@EVERY_CHAIN
def test_energy_changes_by_the_power_of_motors_tool_and_base(chain, draw):
    """Without friction: dE/dt = tau ell kappa_dot - F_e V_O + F_S V_S."""
    robot = dataclasses.replace(chain, rotor_coupling=True).with_parameters(
        f_c=0, f_s=0, f_v=0, f_ck=0, theta_err_amplitude=0
    )
    for state, ride in zip(draw(robot, 5, seed=26), rides(5, 27), strict=True):
        x_dot = plant_derivative(robot, state.x, state.tau, state.F_e, ride.base(robot))
        V_S_dot = ride.A_S - point_acceleration(ride.V_S, np.zeros(6))
        base = Base(jets(ride.R_S, ride.R_S @ skew(ride.V_S[3:]), 0.0), jets(ride.V_S, V_S_dot, 0.0))
        p_S = jets(np.zeros(3), ride.R_S @ ride.V_S[:3], 0.0)
        out = plant_outputs(robot, jets(state.x, x_dot, 0.0), p_S, base)
        rates = [float(derivative(E, 1)) for E in (out.E_kin, out.E_pot, out.E_spring)]
        M_S, F_S0 = base_load(robot, state.x, state.tau, state.F_e, ride.base(robot), None)
        V_O, _ = tool_motion(robot, state.x, state.tau, state.F_e, ride.base(robot))
        V_O = V_O + np.concatenate([derivative(out.R_O, 0).T @ (ride.R_S @ ride.V_S[:3]), np.zeros(3)])
        powers = [
            state.tau @ (robot.ell * state.kappa_dot), -state.F_e @ V_O, (M_S @ ride.A_S + F_S0) @ ride.V_S
        ]  # fmt: skip
        # some 1000 products of the size of the powers that flow, springs among them
        flow = np.abs(rates).sum() + np.abs(state.tau_s) @ (np.abs(state.kappa_dot) + np.abs(state.q_dot))
        np.testing.assert_allclose(sum(rates), sum(powers), rtol=0, atol=1000 * EPS * flow)


@EVERY_CHAIN
def test_the_feedforward_of_a_base_that_turns_steadily_is_the_exact_inverse(chain):
    chain = chain.with_parameters(theta_err_amplitude=0)  # too quick for the differences
    n = chain.n
    ride = rides(1, 28)[0]
    omega, A_S = ride.V_S[3:], np.concatenate([ride.A_S[:3], np.zeros(3)])

    def base(t):
        return moving_base(ride.R_S @ Rotation.from_rotvec(t * omega).as_matrix(), omega, A_S)

    def desired(t):
        return desired_motion(t, -0.3 * np.ones(n), 0.4 + 0.1 * np.arange(n), 2.0, 0.0)

    def drives(t):
        return desired_drive_motion(chain, desired(t), np.zeros(6), base(t))

    t, h = 0.83, 1e-4
    drive = drives(t)
    for rate, values in ((drive.kappa_dot, "kappa"), (drive.kappa_ddot, "kappa_dot")):
        narrow, wide = ((getattr(drives(t + k * h), values) - getattr(drives(t - k * h), values)) / (2 * k * h)
                    for k in (1, 2))  # fmt: skip
        difference = (4.0 * narrow - wide) / 3.0
        # of order 4 in h: 1e-16 of derivatives below 1e4, and rounding, 1e-16 / h of values near 1
        np.testing.assert_allclose(rate, difference, rtol=0, atol=1e-10 * max(1.0, np.abs(rate).max()))
    torques = feedforward_inverse(chain, desired(t), np.zeros(6), base(t))
    motion = desired(t)
    x = np.concatenate([motion.q_d, motion.q_d_dot, torques.kappa_dot_d, torques.tau_s])
    x_dot = split_state(chain, plant_derivative(chain, x, torques.tau_m, np.zeros(6), base(t)))
    # of a coupled rotor's torque the feedforward leaves out D' I_m D_ddot, see `desired_drive_motion`
    close(x_dot.q_dot, motion.q_d_ddot, 1e-9)
    gains = FeedbackGains(*(np.zeros(n) for _ in range(4)))
    vdc = feedforward_vdc(chain, gains, motion, motion.q_d, motion.q_d_dot, torques.kappa_dot_d, np.zeros(6), base(t))
    close(vdc.tau_m, torques.tau_m, 1e-9)
