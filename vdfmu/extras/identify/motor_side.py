"""The linear model of an arm from the motor side: motor torques as functions of small rotor motions.

With springs S = K + j w d, rotors J = I_m ell, viscous friction F, links M and G, and rotors carried by links, all
link-side and at a frequency w [rad/s]::

    (-w^2 J + j w F + S) kappa - P q = ell tau       P = S + w^2 C,    C = diag(J / ell) A
    L q = P^T kappa                                  L = -w^2 (M + A^T diag(J / ell^2) A) + G + S

so that ``ell tau = Z kappa`` with ``Z = -w^2 J + j w F + S - P L^-1 P^T``. A is 0 without `rotor_coupling`. This is
:func:`vdfmu.linearize` without dry friction, with dampers d in parallel with the springs.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from vdfmu.arm.dynamics import gravity_torque, mass_matrix
from vdfmu.arm.equations.harmonic_drive import deformation
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.extras.identify.problem import regressor

Complex = npt.NDArray[np.complex128]
_DAMPING = 0.01
"""Damping ratio of the springs at the start of a fit; strain-wave gears have 0.5 to 2 %."""
_NODES = 41
"""Quadrature nodes for a mean over normally distributed torques; few suffice for smooth spring laws."""
_SLOPE = 1e-5
"""Step [rad or m] of the central differences of gravity torques, whose error and rounding are near 1e-10 of the
torque."""


class Drives(NamedTuple):
    """Parameters of the model, link-side, (n,) each: N.m/rad, N.m.s/rad and kg.m2, or N/m, N.s/m and kg."""

    stiffness: Floats
    damping: Floats
    viscous: Floats
    rotor: Floats
    """J = I_m ell."""
    payload: float
    """Payload [kg], at its place in the robot file, or at the tool if the file has none."""


class MotorResponse(NamedTuple):
    """Effects of rotor motions at f frequencies, for r realisations; see the equations of the module."""

    torque: Complex
    """ell tau without dry friction, (r, f, n) [N.m or N]."""
    link: Complex
    """The part of it that springs transmit or that acts on carried rotors, (r, f, n)."""
    q: Complex
    bent: Complex
    """Positions of links and deformations of springs, (r, f, n) [rad or m]."""
    reaction: Complex
    """P L^-1, (f, n, n)."""


@dataclass(frozen=True, eq=False)
class MotorSide:
    """The links of an arm at a pose."""

    robot: Robot
    pose: Floats
    """Pose, (n,) [rad or m]."""

    @cached_property
    def links(self) -> tuple[Floats, Floats]:
        """Mass matrix and slope of the gravity torques without payload, (n, n) each."""
        return self._links(_with_payload(self.robot, 0.0))

    @cached_property
    def payload(self) -> tuple[Floats, Floats]:
        """Change of both by a payload of 1 kg."""
        loaded = self._links(_with_payload(self.robot, 1.0))
        return loaded[0] - self.links[0], loaded[1] - self.links[1]

    @cached_property
    def carried(self) -> Floats:
        """Rows A (n, n): contributions of the joint speeds to the speed of each motor."""
        n, none = self.robot.n, np.zeros((self.robot.n, self.robot.n))
        pose = np.tile(self.pose, (n, 1))
        return (regressor(self.robot, pose, none, np.eye(n), none, none).carried * self.robot.ell).T

    def scaled_link(self, i: int) -> tuple[Floats, Floats]:
        """Return the changes of both matrices if link `i` has twice the mass and inertia."""
        factor = 1.0 + np.eye(self.robot.n)[i]
        robot = _with_payload(self.robot, 0.0)
        more = robot.with_parameters(mass=robot.mass * factor, inertia=robot.inertia * factor[:, None, None])
        M, G = self._links(more)
        return M - self.links[0], G - self.links[1]

    def _links(self, robot: Robot) -> tuple[Floats, Floats]:
        steps = _SLOPE * np.eye(robot.n)
        G = [(gravity_torque(robot, self.pose + u) - gravity_torque(robot, self.pose - u)) / (2.0 * _SLOPE)
             for u in steps]  # fmt: skip
        return mass_matrix(robot, self.pose), np.array(G).T

    @property
    def weight(self) -> Floats:
        """Torques of gravity on the springs (n,) [N.m or N]."""
        return gravity_torque(self.robot, self.pose)

    def start(self, torque: npt.ArrayLike = 0.0) -> Drives:
        """Return the robot file's drives, with springs loaded by torques of an RMS (n,) about gravity's."""
        robot, M = self.robot, self.links[0]
        K = effective_stiffness(robot, self.weight, np.broadcast_to(np.asarray(torque, float), robot.n))
        mass = float(np.asarray(robot.payload_mass)) if robot.payload else 0.0
        damping = 2.0 * _DAMPING * np.sqrt(K * np.diag(M))
        return Drives(K, damping, np.array(robot.f_v, float), robot.I_m * robot.ell, mass)

    def masses(self, payload: float) -> tuple[Floats, Floats]:
        """Return M and G with a payload [kg], (n, n) each."""
        (M, G), (M_p, G_p) = self.links, self.payload
        return M + payload * M_p, G + payload * G_p

    def answer(self, w: Floats, drives: Drives, kappa: Complex) -> MotorResponse:
        """Return the torques required by rotor motions (r, f, n) at frequencies (f,) [rad/s]."""
        S = drives.stiffness + 1j * w[:, None] * drives.damping
        square = (w**2)[:, None, None]
        M, G = self.masses(drives.payload)
        A, ell, J = self.carried, self.robot.ell, drives.rotor
        eye = np.eye(self.robot.n)
        L = -square * (M + A.T @ ((J / ell**2)[:, None] * A)) + G + S[:, :, None] * eye
        P = S[:, :, None] * eye + square * ((J / ell)[:, None] * A)
        inverse = np.linalg.inv(L)
        q = times(inverse, times(np.swapaxes(P, 1, 2), kappa))
        link = S * kappa - times(P, q)
        rotor = (-(w**2)[:, None] * J + 1j * w[:, None] * drives.viscous) * kappa
        return MotorResponse(rotor + link, link, q, kappa - q, P @ inverse)

    def impedance(self, w: Floats, drives: Drives) -> Complex:
        """Return Z (f, n, n), the torques ell tau per motion of each rotor."""
        n = self.robot.n
        columns = np.broadcast_to(np.eye(n, dtype=complex)[:, None, :], (n, len(w), n))
        return np.moveaxis(self.answer(w, drives, columns).torque, 0, 2)

    def antiresonances(self, drives: Drives) -> Floats:
        """Return for each joint the frequency (n,) [Hz] of the mode with held motors that bends its spring most.

        At this frequency the response of the rotors to their torques has a minimum. The spring that bends most is the
        one with most of the energy. A payload is set to 0 if its fitted mass is negative, because masses must be
        positive.
        """
        M, G = self.masses(max(drives.payload, 0.0))
        carried = self.carried.T @ ((drives.rotor / self.robot.ell**2)[:, None] * self.carried)
        values, modes = eigh(np.diag(drives.stiffness) + (G + G.T) / 2.0, M + carried)
        energy = drives.stiffness[:, None] * modes**2
        bent = (energy / energy.sum(axis=0)).argmax(axis=1)
        return np.sqrt(np.maximum(values[bent], 0.0)) / (2.0 * np.pi)


def effective_stiffness(robot: Robot, weight: Floats, swing: Floats) -> Floats:
    """Return the springs' stiffnesses (n,) for torques that vary with an RMS (n,) about mean ones (n,) [N.m or N].

    It is the regression slope of torque on deformation for a normal distribution, as in a multisine.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    weights = weights / weights.sum()
    swing = np.maximum(swing, 1e-6 * np.maximum(np.abs(weight), 1.0))
    torques = weight + np.outer(nodes, swing)
    bent: Any = np.array([deformation(robot, each) for each in torques])
    about = bent - weights @ bent
    return (weights @ (about * (torques - weight))) / (weights @ about**2)


def times(matrices: npt.NDArray[Any], columns: npt.NDArray[Any]) -> Any:
    """Return the products (r, f, n) of matrices (f, n, n) and columns (r, f, n)."""
    return (matrices @ columns[..., None])[..., 0]


def _with_payload(robot: Robot, mass: float) -> Robot:
    return dataclasses.replace(robot, payload=True).with_parameters(payload_mass=mass)
