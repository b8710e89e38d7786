"""Every equation (1)-(63), evaluated on the path that the units take.

Their methods run once at random states while all calls into ``vdfmu.arm.equations`` are recorded.
What an equation says is written here again as the paper prints it (with the errata of ``test_errata.py``), in numpy
and without those functions, and held against the arguments and results of the calls. An equation that no path uses
says why.
"""

import dataclasses
import sys
from collections import defaultdict

import numpy as np
import pytest

from tests.arm.paper.printed import ORIGINS, N, Subsystems, Z, body_force, cross, printed_rotation, stribeck, transform
from vdfmu.arm.equations.feedforward import FeedbackGains
from vdfmu.arm.equations.mapping import extended_jacobian, jacobian, velocity_mapping
from vdfmu.arm.equations.plant import plant_outputs
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units.controller import PDController
from vdfmu.arm.units.feedforward import Feedforward
from vdfmu.arm.units.plant import Plant
from vdfmu.arm.units.trajectory import Trajectory

EPS = np.finfo(float).eps

UNUSED = {
    1: "positions of the three parts of the gear; every other equation takes the ratio as ell, see test_errata.py",
    28: "counts the spring torque twice; the path uses tau of (27), see test_errata.py",
    33: "placements go as pairs of rotation and origin; the product of (33)s is end_effector_pose, tested",
}
"""Equations that no unit uses, and why."""


class Calls:
    """Calls into ``vdfmu.arm.equations`` while a function runs: name to arguments and result."""

    def __init__(self):
        self.of = defaultdict(list)
        self._open = []

    def __call__(self, frame, event, argument):
        """Record a call or its result, for ``sys.setprofile``."""
        code = frame.f_code
        if "vdfmu/arm/equations" not in code.co_filename.replace("\\", "/"):
            return
        if event == "call":
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            self._open.append({name: frame.f_locals[name] for name in names})
        elif event == "return":
            arguments = self._open.pop()
            if argument is not None:
                self.of[code.co_name].append((arguments, argument))

    def run(self, function, *arguments):
        """Return what the function returns, and record the calls."""
        sys.setprofile(self)
        try:
            return function(*arguments)
        finally:
            sys.setprofile(None)

    def __getitem__(self, name):
        assert self.of[name], f"{name} is not on the path"
        return self.of[name]


class Path:
    """One state of the arm, what the units make of it, and the calls that made it."""

    def __init__(self, robot):
        random = np.random.default_rng(90)
        self.robot = robot
        self.q, self.q_dot, self.kappa_dot = (random.uniform(-1.5, 1.5, N) for _ in range(3))
        self.tau_s, self.tau, self.F_e = (
            random.uniform(-20, 20, N), random.uniform(-0.5, 0.5, N), random.normal(size=6),
        )  # fmt: skip
        self.x = np.concatenate([self.q, self.q_dot, self.kappa_dot, self.tau_s])
        self.plant, self.vdc, self.inverse, self.other = Calls(), Calls(), Calls(), Calls()
        plant = Plant(robot, tau=self.tau, F_e=self.F_e)
        plant.q, plant.q_dot, plant.kappa_dot, plant.tau_s = np.split(self.x, 4)
        self.plant.run(plant.derivatives)
        self.q_ddot, self.kappa_ddot, self.tau_s_dot = plant.der_q_dot, plant.der_kappa_dot, plant.der_tau_s
        self.other.run(plant.outputs)
        self.q_end, self.T, self.t = np.linspace(0.5, 1.5, N), 10.0, 3.7
        trajectory = Trajectory(robot, q_end=self.q_end, T=self.T)
        trajectory.t = self.t
        self.other.run(trajectory.outputs)
        self.desired = Desired(*(getattr(trajectory, name) for name in Desired._fields))
        self.gains = FeedbackGains(*(random.uniform(0.5, 2.0, N) for _ in range(4)))
        measured = dict(q=self.q, q_dot=self.q_dot, kappa_dot=self.kappa_dot, F_e_d=self.F_e)
        desired, gains = self.desired._asdict(), self.gains._asdict()
        vdc = Feedforward(robot, mode="vdc", **gains, **desired, **measured)
        self.vdc.run(vdc.outputs)
        self.tau_m = vdc.tau_m
        self.inverse.run(Feedforward(robot, mode="inverse", **desired).outputs)


CHECKS = {}


def equations(*numbers):
    """Register a check for these equations."""

    def register(check):
        for number in numbers:
            CHECKS[number] = check
        return check

    return register


def close(a, b, size=1.0):
    # Some 1000 products of the given size.
    np.testing.assert_allclose(a, b, rtol=0, atol=1000 * EPS * size)


@equations(2, 3)
def spring(path):
    robot = path.robot
    for arguments, kappa in (*path.plant["rotor_position"], *path.other["rotor_position"]):
        tau_w = arguments["tau_s"] / robot.ell
        wave = np.sign(tau_w) / (robot.c_w * robot.ell * robot.K_w0) * (1.0 - np.exp(-robot.c_w * np.abs(tau_w)))
        delta_theta_f = kappa - arguments["q"] - wave - 0.0  # (3), theta_err = 0
        tau_f = np.tan(delta_theta_f * robot.c_f * robot.K_f0) / robot.c_f  # (2)
        # An angle of 1.5 rad is rounded to 1e-16; the stiffness is up to 3e4 N m/rad.
        close(tau_f, arguments["tau_s"], 10.0)
    # and the plant's rate of tau_s keeps it: kappa_dot by a difference along the plant's motion
    h = 1e-7
    ahead, behind = (
        plant_outputs(
            robot, path.x + s * h * np.concatenate([path.q_dot, path.q_ddot, path.kappa_ddot, path.tau_s_dot])
        ).kappa
        for s in (1, -1)
    )
    # rounding 1e-16 / 1e-7; truncation h^2 / 6 D''' tau_s_dot^3 with tau_s_dot of 4e4 N m/s, D''' = (c_w / ell)^2 D' of
    # 6e-6: 1e-14 / 6 * 6e-6 * 6e13 = 6e-7
    np.testing.assert_allclose((ahead - behind) / (2 * h), path.kappa_dot, rtol=0, atol=1e-6)


@equations(4)
def velocity_of_rotors(path):
    for arguments, V_D in path.plant["rotor_velocity"]:
        close(V_D, Z * arguments["ell"] * arguments["kappa_dot"] + arguments["U_BD"].T @ arguments["V_B"], 100.0)
    now = Subsystems(
        path.robot, path.q, (path.q_dot, path.kappa_dot), (path.q_dot, path.kappa_dot, path.q_ddot, path.kappa_ddot)
    )
    velocities = [V for arguments, V in path.plant["rotor_velocity"] if arguments["kappa_dot"] in path.kappa_dot]
    for i in range(1, N):
        assert any(np.allclose(V, now.V_D[i], rtol=0, atol=1e-11) for V in velocities)


@equations(5, 29, 30, 31)
def velocity_of_links(path):
    now = Subsystems(
        path.robot, path.q, (path.q_dot, path.kappa_dot), (path.q_dot, path.kappa_dot, path.q_ddot, path.kappa_ddot)
    )
    arguments, motion = path.plant["link_motion"][0]
    np.testing.assert_array_equal(arguments["q_dot"], path.q_dot)
    for i in range(N):
        close(motion.V_B[i], now.V[i], 10.0)
        close(motion.V_B_dot[i], now.V_r_dot[i], 1e3)
        T = transform(np.eye(3), ORIGINS[i])  # (30): {T_i} is {B_(i-1)} moved to the joint
        V_T = T.T @ (now.V[i - 1] if i else np.zeros(6))
        close(motion.V_B[i], Z * path.q_dot[i] + transform(printed_rotation(i, path.q[i]), np.zeros(3)).T @ V_T, 10.0)


@equations(6, 7, 8, 9, 10, 11, 44, 45, 46, 47)
def motion_of_all_bodies(path):
    """Solve the bodies' equations: z.T F_q = ell tau_t - xi and z.T F_kappa = tau - tau_t - xi after (11)."""
    robot = path.robot
    motion = (path.q_dot, path.kappa_dot)
    now = Subsystems(robot, path.q, motion, (*motion, path.q_ddot, path.kappa_ddot))
    F_q, F_k = now.forces(path.F_e)  # (44): {O} = {B_6} for the paper's arm
    tau_t = path.tau_s / robot.ell
    xi_l, xi_m = stribeck(robot, path.q_dot), robot.f_ck * np.tanh(path.kappa_dot / robot.eps)
    # Forces of up to 1e4 rad/s2 times 1 kg m2.
    close([Z @ F for F in F_q], robot.ell * tau_t - xi_l, 1e4)
    close([Z @ F for F in F_k], path.tau - tau_t - xi_m, 10.0)
    # (45)-(46), link by link: without its rotor's part of (11), (46) does not hold
    for i in range(N - 1):
        star = now.F_T_star[i] + now.F_B_star[i]
        rotor = now.U_D[i + 1] @ F_k[i + 1]
        close(F_q[i] - star - now.U[i + 1] @ F_q[i + 1] - rotor, 0.0, 1e4)
        assert np.abs(rotor).max() > 1e-3


@equations(12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 48, 49, 50, 51, 52, 53)
def virtual_decomposition_control(path):
    robot, gains, desired = path.robot, path.gains, path.desired
    _, drive = path.vdc["desired_drive_motion"][0]
    q_dot_r = desired.q_d_dot + gains.Lambda * (desired.q_d - path.q)  # (12)
    q_ddot_r = desired.q_d_ddot + gains.Lambda * (desired.q_d_dot - path.q_dot)
    kappa_dot_r = q_dot_r + drive.kappa_dot - desired.q_d_dot
    kappa_ddot_r = q_ddot_r + drive.kappa_ddot - desired.q_d_ddot
    _, required = path.vdc["required_motion"][0]
    for actual, wanted in zip(required, (q_dot_r, q_ddot_r, kappa_dot_r, kappa_ddot_r), strict=True):
        close(actual, wanted, 10.0)
    parts = Subsystems(robot, path.q, (path.q_dot, path.kappa_dot), (q_dot_r, kappa_dot_r, q_ddot_r, kappa_ddot_r))
    parts.add_gains(gains.K_V)  # (15), (17), (50)
    F_qr, F_kr = parts.forces(path.F_e)  # (18)-(20), (23)-(25); F_l of (51)
    close(np.array(path.vdc["required_forces"][0][1]), np.array(F_qr), 1e3)  # (51)-(53), with (25)'s rotor
    xi_l, xi_m = stribeck(robot, desired.q_d_dot), robot.f_ck * np.tanh(drive.kappa_dot / robot.eps)
    tau_q, tau_kr = (np.array([Z @ F for F in forces]) for forces in (F_qr, F_kr))
    tau_t = (tau_q + xi_l) / robot.ell + gains.k_vq * (q_dot_r - path.q_dot)  # (26)
    tau = tau_t + gains.k_vkappa * (kappa_dot_r - path.kappa_dot) + xi_m + tau_kr  # (27)
    close(path.tau_m, tau, 10.0)
    close(tau_q, robot.ell * (tau_t - gains.k_vq * (q_dot_r - path.q_dot)) - xi_l, 1e3)  # (21)
    close(tau_kr, tau - tau_t - gains.k_vkappa * (kappa_dot_r - path.kappa_dot) - xi_m, 10.0)  # (22)


@equations(32)
def transforms(path):
    for arguments, U in path.plant["force_transform"]:
        close(U, transform(arguments["R_AB"], arguments["p_AB"]))


@equations(34, 35, 36)
def rotations(path):
    matrices = {arguments["i"]: R for arguments, R in path.plant["joint_rotation"]}
    for i in range(N):
        close(matrices[i], printed_rotation(i, path.q[i]))


@equations(37, 38, 39, 40, 41, 42, 43)
def mapping_matrices(path):
    """Not on the path, whose forward dynamics is a recursion; they map the velocities that the plant has."""
    J_q, J_ba = jacobian(path.robot, path.q), velocity_mapping(path.robot, path.q)
    _, motion = path.plant["link_motion"][0]
    V_O = motion.V_B[5]  # {O} = {B_6}
    close(J_q @ path.q_dot, V_O, 10.0)  # (37)
    U = np.eye(6)
    for j in reversed(range(N)):
        close(J_q[:, j], U.T @ Z)  # (38), U_(B_j O)
        U = motion.U_AB[j] @ U
    V_b = np.concatenate([V_O, *motion.V_B])  # (40)
    close(J_ba @ path.q_dot, V_b, 10.0)  # (41)
    # (39), (42)-(43): away from singular positions
    V_e = np.concatenate([V_O, path.q_dot, *motion.V_B])
    condition = np.linalg.cond(J_q)
    close(np.linalg.inv(J_q) @ V_O, path.q_dot, 10.0 * condition)
    close(extended_jacobian(path.robot, path.q) @ V_O, V_e, 10.0 * condition)


@equations(54)
def friction_of_joints(path):
    for calls in (path.plant, path.vdc):
        floats = [call for call in calls["stribeck_friction"] if call[0]["velocity"].dtype == float]
        for arguments, xi in floats:
            close(xi, stribeck(path.robot, arguments["velocity"]), 10.0)


@equations(55)
def friction_of_rotors(path):
    for arguments, xi in path.plant["coulomb_friction"]:
        # far from standstill the sign is whole
        np.testing.assert_array_equal(xi, path.robot.f_ck * np.sign(arguments["kappa_dot"]))


@equations(56)
def pure_rotation(path):
    """As the paper simplifies it: the plant without `rotor_coupling`."""
    alone = Path(dataclasses.replace(path.robot, rotor_coupling=False))
    robot = alone.robot
    xi_m = robot.f_ck * np.tanh(alone.kappa_dot / robot.eps)
    close(robot.I_m * alone.kappa_ddot, alone.tau - alone.tau_s / robot.ell - xi_m)
    motion = (alone.q_dot, alone.kappa_dot)
    now = Subsystems(robot, alone.q, motion, (*motion, alone.q_ddot, alone.kappa_ddot))
    now.F_D_star = [np.zeros(6)] * N  # (46) without the reaction
    F_q, _ = now.forces(alone.F_e)
    close([Z @ F for F in F_q], alone.tau_s - stribeck(robot, alone.q_dot), 1e4)


@equations(57)
def trajectory(path):
    s = path.t / path.T
    close(path.desired.q_d, path.q_end * (s - np.sin(2 * np.pi * s) / (2 * np.pi)))


@equations(58)
def feedback(path):
    K_p, K_v = np.full(N, 2000.0), np.full(N, 20.0)
    d = path.desired
    controller = PDController(
        path.robot, velocity="q_dot", K_p=K_p, K_v=K_v, q_d=d.q_d, q_d_dot=d.q_d_dot, q=path.q, q_dot=path.q_dot,
        tau_m=path.tau_m,
    )  # fmt: skip
    calls = Calls()
    calls.run(controller.outputs)
    _, command = calls["pd_control"][0]
    np.testing.assert_array_equal(command.tau, controller.tau)
    tau_e = K_v * (d.q_d_dot - path.q_dot) + K_p * (d.q_d - path.q)
    close(command.tau_e, tau_e, 1e4)
    close(command.tau, path.tau_m + tau_e / path.robot.ell, 100.0)


@equations(59)
def net_forces(path):
    names = ("m_B", "r_B", "I_B", "g_B")
    for arguments, F_star in path.plant.of["net_force"] + path.inverse["net_force"]:
        if arguments["V_B"].dtype == float:
            body = [arguments[name] for name in names]
            close(F_star, body_force(*body, arguments["V_B"][3:], arguments["V_B_dot"], arguments["V_B"]), 1e3)


@equations(60)
def mass_matrices(path):
    for arguments, M in path.plant["mass_matrix"]:
        m, r, I = arguments["m_B"], arguments["r_B"], arguments["I_B"]
        close(M, np.block([[m * np.eye(3), -m * cross(r)], [m * cross(r), I - m * cross(r) @ cross(r)]]))


@equations(61)
def coriolis_terms(path):
    rest = (np.zeros(3), np.zeros(6))
    for arguments, force in path.plant["coriolis_force"]:
        m, r, I, V = (arguments[name] for name in ("m_B", "r_B", "I_B", "V_B"))
        close(force, body_force(m, r, I, rest[0], V[3:], rest[1], V), 1e2)
    for arguments, C in path.vdc["coriolis_matrix"]:
        m, r, I, w = (arguments[name] for name in ("m_B", "r_B", "I_B", "omega_B"))
        columns = [body_force(m, r, I, rest[0], w, rest[1], e) for e in np.eye(6)]
        close(C, np.array(columns).T, 1e2)


@equations(62)
def gravity_terms(path):
    for arguments, G in path.plant["gravity_force"]:
        m, r, g_B = arguments["m_B"], arguments["r_B"], arguments["g_B"]
        close(G, np.concatenate([m * g_B, m * np.cross(r, g_B)]), 100.0)
        assert np.linalg.norm(g_B) == pytest.approx(9.81, rel=10 * EPS)


@equations(63)
def cross_products(path):
    for arguments, S in path.plant["skew"]:
        np.testing.assert_array_equal(S, cross(arguments["a"]))


@pytest.fixture(scope="module")
def path():
    """Return a state of the paper's arm with everything of the paper on: rotors as bodies, friction on both sides."""
    return Path(dataclasses.replace(load_robot("manipulator_6dof"), rotor_coupling=True, friction="split"))


@pytest.mark.parametrize("number", sorted(CHECKS))
def test_the_equation_holds_on_the_path(number, path):
    CHECKS[number](path)


def test_every_equation_is_checked_or_says_why_not():
    assert sorted([*CHECKS, *UNUSED]) == list(range(1, 64))
