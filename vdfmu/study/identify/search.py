"""The least squares of an identification: weights, parameters unknown from the log, covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.identify.problem import IdentificationProblem

_UNKNOWN = 0.1
"""Standard deviation, relative, from which a parameter is not identified."""
_ROUNDS = 3
"""Rounds of weights."""
_STEPS = 30
"""Steps of the search in each."""


def solve(problem: IdentificationProblem) -> tuple[Floats, Floats, dict[str, str]]:
    """Return all parameters, their covariance, and the parameters that are held.

    Gauss-Newton in logarithms of drives and springs, which are positive, and in parts of the sizes of all else.
    """
    x, count = problem.start.copy(), problem.places["links"].start
    free = np.ones(len(x), bool)
    free[:count] = x[:count] > 0.0
    held = {
        problem.names[i]: "0 in the robot file, where the search would start; give a value"
        for i in np.flatnonzero(~free)
    }
    if problem.stretch is None:
        rotors = range(problem.places["I_m"].start, problem.places["I_m"].stop)
        free[rotors] = False
        why = "without positions of links it cannot be told from their inertia; log them by encoders behind the gears"
        held |= {problem.names[i]: why for i in rotors}
    sizes = _sizes(problem)
    weights = _weights(problem, x, free, sizes)
    while True:
        if name := _hold(problem, x, free, sizes, weights, held):
            place = problem.names.index(name)
            x[place], free[place] = problem.start[place], False
            continue
        before = x
        for _ in range(_ROUNDS):
            x = _fitted(problem, x, free, sizes, weights)
            weights = [np.sqrt(np.mean(e**2, axis=0)) for e in problem.errors(x)]
        if not (name := _hold(problem, x, free, sizes, weights, held)):
            scale = _scale(problem, x, sizes)[free]
            whole = np.zeros((len(x), len(x)))
            whole[np.ix_(free, free)] = _covariance(problem, x, free, sizes, weights) * np.outer(scale, scale)
            return x, whole, held
        place = problem.names.index(name)
        x = before
        x[place], free[place] = problem.start[place], False


def _scale(problem: IdentificationProblem, x: Floats, sizes: Floats) -> Floats:
    """Return the effect of a change by 1 of the search's variables: for positive parameters their value."""
    count = problem.places["links"].start
    return np.concatenate([x[:count], sizes[count:]])


def _slopes(problem: IdentificationProblem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    scale = _scale(problem, x, sizes)[free]
    each = zip(problem.jacobian(x), weights, strict=True)
    return np.concatenate([(e / np.reshape(w, (-1, 1))).reshape(-1, len(x))[:, free] * scale for e, w in each])


def _weights(problem: IdentificationProblem, x: Floats, free: Any, sizes: Floats) -> list[Any]:
    """Return the noise of each equation: the remainder of the linear problem at the start."""
    found = []
    for error, slope in zip(problem.errors(x), problem.jacobian(x), strict=True):
        scale = _scale(problem, x, sizes)[free]
        left = [e - s @ np.linalg.lstsq(s, e, rcond=None)[0] for e, s in
                ((error[:, i], slope[:, i, free] * scale) for i in range(error.shape[1]))]  # fmt: skip
        found.append(np.array([np.sqrt(np.mean(e**2)) for e in left]))
    return found


def _fitted(problem: IdentificationProblem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    """Return the least squares with these weights."""
    count = problem.places["links"].start

    def whole(part: Floats) -> Floats:
        full = np.zeros(len(x))
        full[free] = part
        return np.concatenate(
            [x[:count] * np.exp(np.clip(full[:count], -5.0, 5.0)), x[count:] + sizes[count:] * full[count:]]
        )

    def residual(part: Floats) -> Floats:
        each = zip(problem.errors(whole(part)), weights, strict=True)
        return np.concatenate([(e / w).ravel() for e, w in each])

    def slopes(part: Floats) -> Floats:
        return _slopes(problem, whole(part), free, sizes, weights)

    start = np.zeros(int(free.sum()))
    jac: Any = slopes
    found: Any = least_squares(residual, start, jac, method="lm", xtol=1e-6, ftol=1e-9, max_nfev=_STEPS)
    return whole(found.x)


def _covariance(problem: IdentificationProblem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    """Covariance of the search's variables."""
    slopes = _slopes(problem, x, free, sizes, weights)
    V: Any
    _, S, V = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
    inverse = V.T / np.maximum(S, 1e-12 * S[0])
    return inverse @ inverse.T * (len(slopes) / max(1, len(slopes) - slopes.shape[1]))


def _hold(
    problem: IdentificationProblem, x: Floats, free: Any, sizes: Floats, weights: list[Any], held: dict[str, str]
) -> str | None:
    """Return the least known parameter, if it is known too little, and note why."""
    covariance = _covariance(problem, x, free, sizes, weights)
    spread, places = np.sqrt(np.diag(covariance)), np.flatnonzero(free)
    shown = places < problem.shown
    if not shown.any():
        raise UsageError("identify: the log tells no parameter; check units, signs and order of its columns.")
    worst = int(np.argmax(np.where(shown, spread, 0.0)))
    if spread[worst] < _UNKNOWN:
        return None
    correlation = covariance[worst] / (spread * spread[worst])
    correlation[worst] = 0.0
    correlation[~shown] = 0.0
    partner = int(np.argmax(np.abs(correlation)))
    name = problem.names[places[worst]]
    share = f"{100 * spread[worst]:.0f} %" if spread[worst] < 10.0 else "more than ten times"
    held[name] = (
        f"its standard deviation is {share} of its size, its correlation with {problem.names[places[partner]]} "
        f"{correlation[partner]:+.2f}; {_way_out(name)}"
    )
    return name


def _sizes(problem: IdentificationProblem) -> Floats:
    """Sizes of parameters: for links the largest of the same unit, for a delay 1 ms, for an offset 1e-4."""
    sizes, links = np.abs(problem.start), problem.places["links"]
    for i in range(links.start, links.stop):
        same = [j for j in range(links.start, links.stop) if problem.units[j] == problem.units[i]]
        sizes[i] = max(np.abs(problem.start[same]).max(), 1e-9)
    sizes[problem.places["delay"]], sizes[problem.places["offset"]] = 1e-3, 1e-4
    return sizes


def _way_out(name: str) -> str:
    return {
        "I_m": "log faster motions",
        "f_s": "log slow motions, below v_s",
        "v_s": "log slow motions, about v_s",
        "f_v": "log motions at several speeds",
        "c_f": "log larger torques",
        "c_w": "log torques through 0",
        "K_w0": "log torques through 0",
    }.get(name.split("[")[0], "log a motion that moves more joints, further")
