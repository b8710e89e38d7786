"""The equations of an identification: residuals, their derivatives, and the rigid arm's torques."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.arm.equations.rigid_body import BODY, PAIRS, body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats


class Regressor(NamedTuple):
    """Spring torques ``links @ phi + rotors @ J``, link-side, and the effect on a rotor of the link that carries it."""

    links: Floats
    """Derivatives by the concatenated parameters of the bodies, (m, n, 10 n)."""
    rotors: Floats
    """Derivatives by the rotors' inertias J = I_m ell, link-side, (m, n, n): their reaction (11) on the links, 0 in
    pure rotation."""
    carried: Floats
    """Acceleration added to kappa_ddot in the rotor's torque ``J (kappa_ddot + carried)``, (m, n) [rad/s2]."""


def regressor(robot: Any, q: Floats, q_dot: Floats, q_ddot: Floats, kappa_dot: Floats, kappa_ddot: Floats) -> Regressor:
    """Regressor of the arm at m states, (m, n) each [rad or m, per s, per s2]; rotor motions are divided by ell."""
    m, n = q.shape
    slides = [kind == "prismatic" for kind in robot.joint_types]
    z = np.array([0.0, 0.0, 1.0])
    links, rotors, carried = np.zeros((m, n, 10 * n)), np.zeros((m, n, n)), np.zeros((m, n))

    # forward: angular velocity w, its derivative dw, and acceleration a of the origin, against gravity
    w, dw = np.zeros((m, 3)), np.zeros((m, 3))
    a = np.broadcast_to(np.asarray(robot.gravity, dtype=float), (m, 3))
    turns: list[Floats] = []
    arms: list[Floats] = []
    bodies: list[Floats] = []
    moments: list[Floats] = []
    for i in range(n):
        fixed = robot.rotation[i]
        spin, spin_dot = w @ fixed, dw @ fixed  # of the rotor's base, in {D_i}
        speed = robot.ell[i] * kappa_dot[:, i] + spin[:, 2]
        change = robot.ell[i] * kappa_ddot[:, i] + spin_dot[:, 2]
        moments.append((change[:, None] * z + speed[:, None] * np.cross(spin, z)) / robot.ell[i] ** 2 @ fixed.T)
        carried[:, i] = spin_dot[:, 2] / robot.ell[i]
        c, s = (np.ones(m), np.zeros(m)) if slides[i] else (np.cos(q[:, i]), np.sin(q[:, i]))
        turn = np.zeros((m, 3, 3))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
        R = fixed @ turn
        along, rate, rate_dot = (x[:, i, None] * z for x in (q, q_dot, q_ddot))
        p = robot.offset[i] + (along @ fixed.T if slides[i] else 0.0 * along)
        a = _into(R, a + np.cross(dw, p) + np.cross(w, np.cross(w, p)))
        w, dw = _into(R, w), _into(R, dw)
        if slides[i]:
            a = a + 2.0 * np.cross(w, rate) + rate_dot
        else:
            dw = dw + np.cross(w, rate) + rate_dot
            w = w + rate
        turns.append(R)
        arms.append(p)
        bodies.append(_body(a, w, dw))

    # backward: forces and moments of each body, and moments of the rotors, at the joints before it
    for j in range(n):
        _project(bodies[j], j, slides, turns, arms, links[:, :, 10 * j : 10 * j + 10])
        if robot.rotor_coupling and j > 0:
            wrench = np.zeros((m, 6, 1))
            wrench[:, 3:, 0] = moments[j]
            _project(wrench, j - 1, slides, turns, arms, rotors[:, :, j : j + 1])
    return Regressor(links, rotors, carried if robot.rotor_coupling else np.zeros((m, n)))


def _body(a: Floats, w: Floats, dw: Floats) -> Floats:
    """Return a body's force and moment about the origin, as derivatives by its parameters, (m, 6, 10)."""
    W = np.zeros((len(a), 6, 10))
    S = _skew(dw) + _skew(w) @ _skew(w)
    W[:, :3, 0] = a
    W[:, :3, 1:4] = S
    W[:, 3:, 1:4] = -_skew(a)
    for k, (i, j) in enumerate(PAIRS, 4):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        W[:, 3:, k] = dw @ unit + np.cross(w, w @ unit)
    return W


def _project(W: Floats, link: int, slides: list[bool], turns: list[Floats], arms: list[Floats], into: Floats) -> None:
    """Return the torques of wrenches (m, 6, k) on a link at the joints that carry it."""
    for i in range(link, -1, -1):
        into[:, i] += W[:, 2 if slides[i] else 5]
        f, n = turns[i] @ W[:, :3], turns[i] @ W[:, 3:]
        W = np.concatenate([f, n + _skew(arms[i]) @ f], axis=1)


def _into(R: Floats, v: Any) -> Any:
    """Coordinates in the frames whose axes are the columns of R."""
    return np.einsum("mji,mj->mi", R, v)


def _skew(v: Floats) -> Floats:
    S = np.zeros((*v.shape[:-1], 3, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return S - np.swapaxes(S, -1, -2)


_STATES = 100
"""Number of random states for the columns: for ten joints there are ten times as many rows as columns."""
_ZERO = 1e-8
"""Fraction of a column's size below which the remainder is rounding."""


class BaseParameters(NamedTuple):
    """Base parameters ``matrix @ phi``, the combinations that affect a torque (Gautier and Khalil 1990).

    Columns of the regressor (p,), matrix (p, 10 n), names and units.
    """

    columns: list[int]
    matrix: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]


def base_parameters(robot: Robot) -> BaseParameters:
    """Find the base parameters of an arm from its structure, at random states, by projection column by column.

    A column of the regressor that depends linearly on earlier columns is removed, and its parameter is added to theirs.
    """
    n, random = robot.n, np.random.default_rng(0)
    q, q_dot, q_ddot = random.uniform(-2.0, 2.0, (3, max(_STATES, 20 * n), n))
    Y = regressor(robot, q, q_dot, q_ddot, 0.0 * q, 0.0 * q).links
    Y = Y.reshape(-1, 10 * n)
    columns: list[int] = []
    basis = np.zeros((len(Y), 0))
    size = np.linalg.norm(Y, axis=0)
    for k in np.flatnonzero(size > _ZERO * size.max()):
        left = Y[:, k] - basis @ (basis.T @ Y[:, k])
        left = left - basis @ (basis.T @ left)
        if np.linalg.norm(left) > _ZERO * size[k]:
            columns.append(int(k))
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
    matrix: Any = np.linalg.lstsq(Y[:, columns], Y, rcond=None)[0]
    matrix[np.abs(matrix) < _ZERO] = 0.0
    parameters = [f"{name}{i + 1}" for i in range(n) for name in BODY]
    names = tuple(_combination(row, parameters) for row in matrix)
    kinds = ("kg", "kg.m", "kg.m2")
    units = tuple(kinds[min(2, (k % 10 + 2) // 3)] for k in columns)
    return BaseParameters(columns, matrix, names, units)


def link_errors(robot: Robot, share: float) -> Floats:
    """Return the changes (10 n, 10 n) of inertial parameters, one per column, for a standard deviation of a robot file.

    Masses and moments of inertia have a relative error, centres of mass have this error relative to the radius of
    gyration.
    """
    ways = np.zeros((10 * robot.n, 10 * robot.n))
    here = body_parameters(robot)

    def change(k: int, i: int, **parameters: Floats) -> None:
        ways[:, 10 * i + k] = body_parameters(robot.with_parameters(**parameters)) - here

    for i in range(robot.n):
        mass, inertia = robot.mass[i], robot.inertia[i]
        unit = np.eye(robot.n)[i]
        change(0, i, mass=robot.mass + share * mass * unit)
        for j in range(3):
            reach = share * np.sqrt(np.trace(inertia) / (2.0 * mass))
            change(1 + j, i, centroid=robot.centroid + reach * np.outer(unit, np.eye(3)[j]))
        size = share * np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))
        for k, (a, b) in enumerate(PAIRS, 4):
            moment = np.zeros((3, 3))
            moment[a, b] = moment[b, a] = size[a, b]
            change(k, i, inertia=robot.inertia + unit[:, None, None] * moment)
    return ways


def link_covariance(robot: Robot, base: BaseParameters, share: float) -> Floats | None:
    """Return the covariance (p, p) of the base parameters of a robot file, None for an infinite error."""
    errors = base.matrix @ link_errors(robot, share) if np.isfinite(share) else None
    return None if errors is None else errors @ errors.T


def _combination(row: Floats, parameters: list[str]) -> str:
    """Name of a base parameter: ``Izz1 + 0.25 m2 - my2``."""
    text = ""
    for factor, name in zip(row, parameters, strict=True):
        if factor:
            size = "" if abs(abs(factor) - 1.0) < _ZERO else f"{abs(factor):.4g} "
            text += f" {'-' if factor < 0 else '+'} {size}{name}"
    return text.removeprefix(" + ").strip()


DRIVES = ("I_m", "f_c", "f_s", "v_s", "f_v")
SPRINGS = ("K_f0", "c_f", "K_w0", "c_w")


class TorqueParts(NamedTuple):
    """Spring torques ``Y pi + R J + balance F_cb``, link-side, of m states."""

    Y: Floats
    """Derivatives by base parameters, (m, n, p)."""
    R: Floats
    """Derivatives by rotor inertias, link-side, (m, n, n)."""
    balance: Floats
    """Torques of a counterbalance of 1 N, (m, n) [m]."""


@dataclass
class IdentificationProblem:
    """The rows, and the parameters' places in one vector."""

    robot: Robot
    base: BaseParameters
    step: float
    """Time between the samples of the log [s]."""
    torques: TorqueParts
    """Torques at all m samples, needed for the springs' nonlinear law."""
    filtered: TorqueParts
    """The same at the k rows, filtered."""
    acceleration: Floats
    """Accelerations of rotors, and of the links that carry them, (k, n) [rad/s2 or m/s2]."""
    tau: Floats
    tau_dot: Floats
    """Motor torques, link-side, and their rates, (k, n) [N.m or N]."""
    stretch: Floats | None
    """Measured kappa - q - theta_err, (k, n) [rad or m]; None without encoders behind the gears."""
    steps: Callable[[], list[Floats]]
    """Functions that return deformation errors (k, n) [rad or m] due to the steps of encoders behind the gears, each
    for other zeros."""
    resolution: Floats
    """Steps of the encoders behind the gears, (n,) [rad or m]; 0 if unknown."""
    seen: npt.NDArray[np.bool_]
    """Joints whose links are measured and that have the second equation, (n,)."""
    position: Floats
    """Filtered positions of links, (k, n)."""
    speed: Floats
    """Filtered velocities of rotors, for delayed encoders, (k, n)."""
    velocity: Floats
    """Velocities of rotors at all samples, for friction, (m, n) [rad/s or m/s]."""
    narrow: Callable[[Floats], Floats]
    start: Floats = field(default_factory=lambda: np.zeros(0))
    names: list[str] = field(default_factory=list[str])
    units: list[str] = field(default_factory=list[str])
    places: dict[str, slice] = field(default_factory=dict[str, slice])

    def __post_init__(self) -> None:
        robot = self.robot
        springs = SPRINGS if self.stretch is not None else ()
        for name in (*DRIVES, *springs):
            self._place(name, [PARAMETERS[name].unit(kind) for kind in robot.joint_types], getattr(robot, name))
        self._place("links", self.base.units, self.base.matrix @ body_parameters(robot), self.base.names)
        if robot.counterbalance:
            self._place("F_cb", ["N"] * robot.n, robot.F_cb)
        self._place("tau_0", ["N.m"] * robot.n)
        self._place("delay_tau", ["s"], names=["delay_tau"])
        if self.stretch is not None:
            self._place("delay_q", ["s"] * robot.n)
        none = {"delay_q": ~self.seen, "F_cb": self.start[self.places.get("F_cb", slice(0))] == 0.0}
        unused = {f"{name}[{i + 1}]" for name, joints in none.items() for i in np.flatnonzero(joints)}
        self.shown = [k for k, name in enumerate(self.names) if name not in unused]
        if self.stretch is not None:
            self._place("offset", [PARAMETERS["theta_err_amplitude"].unit(kind) for kind in robot.joint_types])

    def _place(self, name: str, units: Sequence[str], start: Any = 0.0, names: Sequence[str] = ()) -> None:
        begin = len(self.names)
        self.places[name] = slice(begin, begin + len(units))
        self.names += names or [f"{name}[{i + 1}]" for i in range(len(units))]
        self.units += units
        self.start = np.concatenate([self.start, np.broadcast_to(np.asarray(start, dtype=float), len(units))])

    def errors(self, x: Floats) -> list[Floats]:
        """Residuals (k, n) of torques, link-side, and of deformations."""
        robot, at = self.robot, self.places
        J = x[at["I_m"]] * robot.ell
        sign, share, v = self._dry(x)
        dry = (x[at["f_c"]] + (x[at["f_s"]] - x[at["f_c"]]) * share) * sign
        tau_s = self.spring_torques(x)
        torque = self.tau - robot.ell * x[at["tau_0"]] + x[at["delay_tau"]] * self.tau_dot - tau_s
        torque -= J * self.acceleration + self.narrow(dry + x[at["f_v"]] * v)
        if self.stretch is None:
            return [torque]
        late = x[at["delay_q"]] * self.speed + x[at["offset"]]
        bent = self.narrow(deformation(self._robot(x), self._of_parts(self.torques, x)))
        return [torque, self.seen * (self.stretch - bent - late)]

    def jacobian(self, x: Floats) -> list[Floats]:
        """Return the derivatives (k, n, p) of the residuals by all parameters.

        It uses the compliance at the filtered torque, which affects the steps of the search but not its result.
        """
        robot, at, n = self.robot, self.places, self.robot.n
        each = np.arange(n)
        sign, share, v = self._dry(x)
        step = x[at["f_s"]] - x[at["f_c"]]
        by_spring = np.zeros((*self.tau.shape, len(x)))
        by_spring[:, :, at["links"]] = self.filtered.Y
        by_spring[:, :, at["I_m"]] = self.filtered.R * robot.ell
        if "F_cb" in at:
            by_spring[:, each, at["F_cb"].start + each] = self.filtered.balance
        torque = -by_spring
        torque[:, each, at["I_m"].start + each] -= robot.ell * self.acceleration
        for name, slope in (
            ("f_c", (1.0 - share) * sign),
            ("f_s", share * sign),
            ("f_v", v),
            ("v_s", step * share * sign * 2.0 * v**2 / x[at["v_s"]] ** 3),
        ):
            torque[:, each, at[name].start + each] = -self.narrow(slope)
        torque[:, :, at["delay_tau"].start] = self.tau_dot
        torque[:, each, at["tau_0"].start + each] = -robot.ell
        if self.stretch is None:
            return [torque]
        springs, tau_s, all_torques = self._robot(x), self.spring_torques(x), self._of_parts(self.torques, x)
        stretch = -np.asarray(deformation_derivative(springs, tau_s), dtype=float)[:, :, None] * by_spring
        for name in SPRINGS:
            here = getattr(springs, name)
            ends = [springs.with_parameters(**{name: here * f}) for f in (1.0 + 1e-5, 1.0 - 1e-5)]
            change = deformation(ends[0], all_torques) - deformation(ends[1], all_torques)
            stretch[:, each, at[name].start + each] = -self.narrow(change) / (2e-5 * here)
        stretch[:, each, at["offset"].start + each] = -1.0
        stretch[:, each, at["delay_q"].start + each] = -self.speed
        return [torque, self.seen[:, None] * stretch]

    def stiffness(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the RMS of the spring torques, the secant stiffness there, (n,) each, and its slopes (n, p)."""
        torque = np.sqrt(np.mean(self.spring_torques(x) ** 2, axis=0))
        slopes = np.zeros((self.robot.n, len(x)))

        def secant(x: Floats) -> Floats:
            return torque / np.asarray(deformation(self._robot(x), torque), dtype=float)

        for name in SPRINGS if self.stretch is not None else ():
            for k in range(self.places[name].start, self.places[name].stop):
                ends = [x.copy(), x.copy()]
                ends[0][k], ends[1][k] = 1.00001 * x[k], 0.99999 * x[k]
                slopes[:, k] = (secant(ends[0]) - secant(ends[1])) / (2e-5 * x[k])
        return torque, secant(x), slopes

    def _dry(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Sign and Stribeck share of the friction (54), and the velocity, (m, n) each."""
        v = self.velocity
        return np.tanh(v / self.robot.eps), np.exp(-((v / x[self.places["v_s"]]) ** 2)), v

    def spring_torques(self, x: Floats) -> Floats:
        """Torques of the drives in the rows, link-side, (k, n) [N.m or N]."""
        return self._of_parts(self.filtered, x)

    def _of_parts(self, parts: TorqueParts, x: Floats) -> Floats:
        at = self.places
        tau_s = parts.Y @ x[at["links"]] + parts.R @ (x[at["I_m"]] * self.robot.ell)
        return tau_s + parts.balance * x[at["F_cb"]] if "F_cb" in at else tau_s

    def _robot(self, x: Floats) -> Robot:
        return self.robot.with_parameters(**{n: x[self.places[n]] for n in SPRINGS if n in self.places})
