"""The least squares of an identification: weights, parameters unknown from the log, covariance."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.identify.problem import SPRINGS, IdentificationProblem

_UNKNOWN = 0.1
"""Standard deviation, relative, from which a parameter is not identified."""
_ROUNDS = 3
"""Rounds of weights."""
_STEPS = 30
"""Steps of the search in each."""


def solve(problem: IdentificationProblem) -> tuple[Floats, Floats, dict[str, str]]:
    """Return all parameters, their covariance, and the parameters that are held."""
    search = _Search(problem)
    while True:
        before, place = search.x, search.hold()
        if place is None:
            for _ in range(_ROUNDS):
                search.fit()
            place = search.hold()
            if place is None:
                scale = search.scale(search.x)
                whole = np.zeros((len(before), len(before)))
                whole[np.ix_(search.free, search.free)] = search.covariance() * np.outer(scale, scale)
                return search.x, whole, search.held
        search.x = before.copy()
        search.x[place], search.free[place] = problem.start[place], False


class _Search:
    """Gauss-Newton in logarithms of drives and springs, which are positive, and in parts of the sizes of all else."""

    def __init__(self, problem: IdentificationProblem) -> None:
        self.problem, self.x, self.sizes = problem, problem.start.copy(), _sizes(problem)
        self.count = problem.places["links"].start
        """Parameters in logarithms, which come first."""
        self.free: Any = np.ones(len(self.x), bool)
        self.free[: self.count] = self.x[: self.count] > 0.0
        self.held = {
            problem.names[i]: "0 in the robot file, where the search would start; give a value"
            for i in np.flatnonzero(~self.free)
        }
        unseen = np.flatnonzero(~problem.seen)
        way = "log them by encoders behind the gears"
        reasons = {"I_m": f"without positions of links it cannot be told from their inertia; {way}"}
        if problem.stretch is not None:
            reasons |= dict.fromkeys(SPRINGS, f"the log has no positions of its link; {way}")
            self.free[problem.places["offset"].start + unseen] = False
        for name, why in reasons.items():
            places = problem.places[name].start + unseen
            self.free[places] = False
            self.held |= {problem.names[i]: why for i in places}
        each = zip(problem.errors(self.x), problem.jacobian(self.x), strict=True)
        self.weights = [self._noise(error, slope) for error, slope in each]

    def scale(self, x: Floats) -> Floats:
        """Return the effect of a change by 1 of the search's variables: for positive parameters their value."""
        return np.concatenate([x[: self.count], self.sizes[self.count :]])[self.free]

    def _noise(self, error: Floats, slope: Floats) -> Floats:
        """Return the noise of an equation by joint: the remainder of the linear problem at the start."""
        slopes = np.moveaxis(slope[:, :, self.free] * self.scale(self.x), 1, 0)
        left = [e - s @ np.linalg.lstsq(s, e, rcond=None)[0] for e, s in zip(error.T, slopes, strict=True)]
        return _level(np.transpose(left))

    def _slopes(self, x: Floats) -> Floats:
        each = zip(self.problem.jacobian(x), self.weights, strict=True)
        rows = [(e / np.reshape(w, (-1, 1))).reshape(-1, len(x))[:, self.free] for e, w in each]
        return np.concatenate(rows) * self.scale(x)

    def fit(self) -> None:
        """Go to the least squares with the weights, and take new ones from what is left there."""
        x, count = self.x, self.count

        def whole(part: Floats) -> Floats:
            full = np.zeros(len(x))
            full[self.free] = part
            positive = x[:count] * np.exp(np.clip(full[:count], -5.0, 5.0))
            return np.concatenate([positive, x[count:] + self.sizes[count:] * full[count:]])

        def residual(part: Floats) -> Floats:
            each = zip(self.problem.errors(whole(part)), self.weights, strict=True)
            return np.concatenate([(e / w).ravel() for e, w in each])

        def slopes(part: Floats) -> Floats:
            return self._slopes(whole(part))

        start, jac = np.zeros(int(self.free.sum())), cast(Any, slopes)
        found: Any = least_squares(residual, start, jac, method="lm", xtol=1e-6, ftol=1e-9, max_nfev=_STEPS)
        self.x = whole(found.x)
        self.weights = [_level(e) for e in self.problem.errors(self.x)]

    def covariance(self) -> Floats:
        """Covariance of the search's variables."""
        slopes = self._slopes(self.x)
        V: Any
        _, S, V = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
        inverse = V.T / np.maximum(S, 1e-12 * S[0])
        return inverse @ inverse.T * (len(slopes) / max(1, len(slopes) - slopes.shape[1]))

    def hold(self) -> int | None:
        """Return the place of the least known parameter, if it is known too little, and note why."""
        problem, covariance = self.problem, self.covariance()
        spread, places = np.sqrt(np.diag(covariance)), np.flatnonzero(self.free)
        shown = places < problem.shown
        if not shown.any():
            raise UsageError("identify: the log tells no parameter; check units, signs and order of its columns.")
        worst = int(np.argmax(np.where(shown, spread, 0.0)))
        if spread[worst] < _UNKNOWN:
            return None
        correlation = np.where(shown, covariance[worst] / (spread * spread[worst]), 0.0)
        correlation[worst] = 0.0
        partner = int(np.argmax(np.abs(correlation)))
        name = problem.names[places[worst]]
        share = f"{100 * spread[worst]:.0f} %" if spread[worst] < 10.0 else "more than ten times"
        self.held[name] = (
            f"its standard deviation is {share} of its size, its correlation with {problem.names[places[partner]]} "
            f"{correlation[partner]:+.2f}; {_way_out(name)}"
        )
        return int(places[worst])


def _level(error: Floats) -> Floats:
    """Return the root mean square by joint, 1 for one without the equation, whose rows are 0."""
    level = np.sqrt(np.mean(error**2, axis=0))
    return np.where(level > 0.0, level, 1.0)


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
