"""The equations of an identification: residuals of torques and deformations, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.study.identify.regressor import BaseParameters

DRIVES = ("I_m", "f_c", "f_s", "v_s", "f_v")
SPRINGS = ("K_f0", "c_f", "K_w0", "c_w")


class TorqueParts(NamedTuple):
    """Spring torques ``Y pi + R J + balance F_cb``, link-side, of m states."""

    Y: Floats
    """(m, n, p), by base parameters."""
    R: Floats
    """(m, n, n), by rotor inertias, link-side."""
    balance: Floats
    """(m, n): Torques that a counterbalance of 1 N asks for [m]."""


@dataclass
class IdentificationProblem:
    """The rows, and the parameters' places in one vector."""

    robot: Robot
    base: BaseParameters
    step: float
    """Time between the samples of the log [s]."""
    torques: TorqueParts
    """Of all m samples, for the springs, whose law is not linear."""
    filtered: TorqueParts
    """Of the k rows."""
    acceleration: Floats
    """(k, n): of rotors, and of what carries them [rad/s2 or m/s2]."""
    tau: Floats
    tau_dot: Floats
    """(k, n): Motor torques, link-side [N.m or N], and their rates."""
    stretch: Floats | None
    """(k, n): kappa - q - theta_err as measured [rad or m]; None without encoders behind the gears."""
    steps: Callable[[], list[Floats]]
    """Return errors (k, n) of the deformation by the steps of encoders behind the gears, each for other zeros
    [rad or m]."""
    seen: npt.NDArray[np.bool_]
    """(n,): Joints whose links are measured, and that have the second equation."""
    position: Floats
    """(k, n): Filtered positions of links."""
    speed: Floats
    """(k, n): Filtered velocities of rotors, by which encoders that are late lie behind."""
    velocity: Floats
    """(m, n): Velocities of rotors at all samples, for friction [rad/s or m/s]."""
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

        Of the compliance it takes the value at the filtered torque, which changes steps of the search, not its end.
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
            ("f_c", (1.0 - share) * sign), ("f_s", share * sign), ("f_v", v),
            ("v_s", step * share * sign * 2.0 * v**2 / x[at["v_s"]] ** 3),
        ):  # fmt: skip
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
        """Root mean square of the spring torques, secant stiffness there, (n,) each, and its slopes (n, p)."""
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
