"""The law of (2)-(3) fitted to what catalogues of strain-wave gears print.

A catalogue prints three stiffnesses, K_1 up to the torque T_1, K_2 up to T_2 and K_3 beyond: a torsion of three
straight pieces, measured with the wave generator held. The fit is that of the deformation D: least squares of the
difference of both torsions, over torques up to the largest that the gear may carry again and again.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from vdfmu.arm.equations.harmonic_drive import deformation

_POINTS, _PASSES = 60, 200
_NAMES = ("K_f0", "c_f", "K_w0", "c_w")
_LEAST = np.log(1e-6)
"""Smallest value of any parameter: the flexspline of a c_f of 1e-6 is a linear spring."""


def catalogue_torsion(torque: Any, K: Any, T: Any) -> Any:
    """Torsion [rad] of three straight pieces, for stiffnesses K (3,) [N m/rad] and torques T (2,) [N m]."""
    first, second = np.clip(torque, 0.0, T[0]), np.clip(torque - T[0], 0.0, T[1] - T[0])
    return first / K[0] + second / K[1] + np.clip(torque - T[1], 0.0, None) / K[2]


def fit_spring(ratio: float, K: Any, T: Any, largest: float) -> tuple[dict[str, float], float]:
    """Fit the parameters of (2)-(3): Levenberg's method in their logarithms, which keeps them positive.

    scipy's methods with bounds end in another minimum for two gears of the catalogue.

    Parameters
    ----------
    ratio : float
    K, T : see :func:`catalogue_torsion`
    largest : float [N m]
        Torque up to which it counts.

    Returns
    -------
    numbers : the parameters by name
    residual : float [rad]
        Largest difference of the torsions.
    """
    torque = np.linspace(0.0, largest, _POINTS + 1)[1:]
    wanted = catalogue_torsion(torque, K, T)

    def residual(logarithms: Any) -> Any:
        drive = SimpleNamespace(ell=ratio, **dict(zip(_NAMES, np.exp(logarithms), strict=True)))
        return (deformation(drive, torque) - wanted) / wanted[-1]

    # as if half of the compliance at rest, and of its fall, were the flexspline's
    start = [2.0 * K[0], 1.0 / largest, 2.0 * K[0] / ratio**2, ratio / T[1]]
    x, damping = np.log(start), 1e-2
    r = residual(x)
    for _ in range(_PASSES):
        J = np.stack([(residual(x + step) - residual(x - step)) / 2e-6 for step in 1e-6 * np.eye(4)], axis=1)
        trial = np.maximum(x - np.linalg.solve(J.T @ J + damping * np.eye(4), J.T @ r), _LEAST)
        better = residual(trial)
        if better @ better < r @ r:
            x, r, damping = trial, better, damping / 4.0
        else:
            damping *= 4.0
    return dict(zip(_NAMES, map(float, np.exp(x)), strict=True)), float(np.abs(r).max() * wanted[-1])
