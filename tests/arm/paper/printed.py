"""The paper's own lines as it prints them, with the errata, in numpy and without ``vdfmu.arm.equations``."""

import numpy as np

N = 6
Z = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
PART = 0.4  # of each link, as the base of the next joint; the rest is the output link of its own: (6) and (8)


def cross(a):
    """(63)."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def printed_rotation(i, q):
    """Upper left block of (34)-(36)."""
    c, s = np.cos(q), np.sin(q)
    return [
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        np.array([[c, -s, 0], [0, 0, -1], [s, c, 0]]),
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        np.array([[0, 0, 1], [-c, s, 0], [-s, -c, 0]]),
        np.array([[c, -s, 0], [0, 0, -1], [s, c, 0]]),
        np.array([[c, -s, 0], [0, 0, 1], [-s, -c, 0]]),
    ][i]


ORIGINS = np.array([[0, 0, 0], [0, 0, 0.3], [0.3, 0, 0], [0, 0, 0], [0, 0, 0.303], [0, 0.5, 0]])
"""Origin of {B_i} in {B_(i-1)}: l1 to l4 of section IV."""


def transform(R, p):
    """(32)."""
    return np.block([[R, np.zeros((3, 3))], [cross(p) @ R, R]])


def body_force(m, r, I, g_B, omega, V_dot, V):
    """(59)-(62); of required velocities, with the actual omega, F*_r of (15)-(17), (50) less its gain."""
    r_x, w_x = cross(r), cross(omega)
    M = np.block([[m * np.eye(3), -m * r_x], [m * r_x, I - m * r_x @ r_x]])
    C = np.block([[m * w_x, -m * w_x @ r_x], [m * r_x @ w_x, w_x @ I + I @ w_x - m * r_x @ w_x @ r_x]])
    G = np.concatenate([m * g_B, m * r_x @ g_B])
    return M @ V_dot + C @ V + G


def rate_of(U_transposed_V, V, q_dot):
    """Return the derivative of U.T V_A without V_A_dot: the new frame turns with z q_dot."""
    v, w = U_transposed_V[:3], U_transposed_V[3:]
    turn = Z[3:] * q_dot
    return np.concatenate([-np.cross(turn, v), -np.cross(turn, w)])


class Subsystems:
    """The arm as the paper cuts it: base, rotor and output link of every joint, at velocities and accelerations."""

    def __init__(self, robot, q, actual, wanted):
        q_dot, kappa_dot = actual
        self.q_dot, self.kappa_dot, q_ddot, kappa_ddot = wanted
        self.U, self.V, self.V_r, self.V_r_dot, self.V_D, self.V_D_r = [], [], [], [], [], []
        self.F_T_star, self.F_D_star, self.F_B_star = [], [], []
        zero = np.zeros(6)
        V, V_r, V_r_dot, g = zero, zero, zero, robot.gravity
        base = (zero, zero, zero, g)
        for i in range(N):
            V_A, V_A_r, V_A_r_dot, g_A = base
            R, p = printed_rotation(i, q[i]), ORIGINS[i]
            U = transform(R, p)
            U_D = transform(printed_rotation(i, 0.0), p)
            V_D = Z * robot.ell[i] * kappa_dot[i] + U_D.T @ V_A  # (4)
            V_D_r = Z * robot.ell[i] * self.kappa_dot[i] + U_D.T @ V_A_r  # (13)
            V_D_r_dot = Z * robot.ell[i] * kappa_ddot[i] + U_D.T @ V_A_r_dot
            V = Z * q_dot[i] + U.T @ V_A  # (5), (29)-(31)
            V_r = Z * self.q_dot[i] + U.T @ V_A_r  # (14), (48)-(49)
            V_r_dot = Z * q_ddot[i] + U.T @ V_A_r_dot + rate_of(U.T @ V_A_r, V_A_r, q_dot[i])
            g = R.T @ g_A
            rotor = np.diag([0.0, 0.0, robot.I_m[i] / robot.ell[i]])
            body = (robot.mass[i], robot.centroid[i], robot.inertia[i])
            whole = body_force(*body, g, V[3:], V_r_dot, V_r)
            self.F_T_star.append((1 - PART) * whole)  # (8)
            self.F_B_star.append(PART * whole)  # (6), of the base of joint i + 1
            self.F_D_star.append(body_force(0.0, np.zeros(3), rotor, np.zeros(3), V_D[3:], V_D_r_dot, V_D_r))  # (7)
            for values, value in zip(
                (self.U, self.V, self.V_r, self.V_r_dot, self.V_D, self.V_D_r),
                (U, V, V_r, V_r_dot, V_D, V_D_r),
                strict=True,
            ):
                values.append(value)
            base = (V, V_r, V_r_dot, g)
        self.U_D = [transform(printed_rotation(i, 0.0), ORIGINS[i]) for i in range(N)]

    def add_gains(self, K):
        """(15), (17), (50): K (V_r - V), in the parts of the links; that of (16) is k_vkappa of (27)."""
        for i in range(N):
            more = K[i] * (self.V_r[i] - self.V[i])
            self.F_T_star[i] = self.F_T_star[i] + (1 - PART) * more
            self.F_B_star[i] = self.F_B_star[i] + PART * more

    def forces(self, F_end):
        """(9)-(11), or (18)-(20) solved as (23)-(25): F_q of every joint, F_kappa of every rotor."""
        # The last base of the chain is the next joint's driven cutting point too: F_q of a joint is F_B of its link.
        F_q, F_k = [None] * N, self.F_D_star  # (10), (19), (24)
        F_T = self.F_B_star[-1] + F_end  # (44), (51): no joint follows the last link's second part
        for i in reversed(range(N)):
            F_q[i] = self.F_T_star[i] + F_T  # (9), (23)
            if i:
                F_T = self.F_B_star[i - 1] + self.U[i] @ F_q[i] + self.U_D[i] @ F_k[i]  # (11), (25)
        return F_q, F_k


def stribeck(robot, v):
    """(54), with sgn as tanh."""
    return (robot.f_c + (robot.f_s - robot.f_c) * np.exp(-(np.abs(v / robot.v_s) ** 2))) * np.tanh(
        v / robot.eps
    ) + robot.f_v * v
