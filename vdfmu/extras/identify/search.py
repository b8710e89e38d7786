"""The least-squares problem of an identification: weights, prior, covariance.

A log of some seconds does not determine all parameters, and its residuals are not white because model errors persist.
So the robot file's values are treated as observations with typical errors of such files, and residuals are weighted by
their long-run variance (Newey and West 1987), which also determines the intervals.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from scipy.optimize import least_squares

from vdfmu.base.arrays import Floats
from vdfmu.extras.identify.problem import SPRINGS, IdentificationProblem

_UNKNOWN = 0.7
"""Standard deviation, relative to the prior's, above which a parameter keeps the robot file's value."""
_RESOLVED = 10.0
"""Encoder steps below which the standard deviation of a deformation is not resolved."""
_SHARES = {
    "I_m": 0.2, "f_c": 1.0, "f_s": 0.5, "v_s": 1.0, "f_v": 1.0, "K_f0": 0.5, "c_f": 1.0, "K_w0": 0.5, "c_w": 1.0,
    "F_cb": 0.2, "delay_tau": 1.0, "delay_q": 1.0,
}  # fmt: skip
"""Standard deviations without the log, relative to the robot file's value; for static friction that of its ratio to
Coulomb friction, for delays relative to the log's step."""
_ASSUMED = 0.5
"""The same for a rotor inertia whose source in the robot file begins with "Assumed"."""
_ROUNDS, _SETTLED = 6, 1e-3
"""Number of updates of the weights, and change of the search variables below which they end: 0.1 %."""
_STEPS = 30
"""Steps of the search per update."""
_ALIKE = 0.3
"""Largest difference between a motion and its repetition, relative to the power of velocities."""
_LAGS = 1.5
"""Lags up to which residuals count as correlated, divided by the cube root of the number of rows."""


NO_START = "0 in the robot file, the start of the search; give a value"
"""Why a parameter that the robot does not have is not fitted."""


class Weak(NamedTuple):
    """A parameter that a log hardly determines, its deviation relative to the prior's, and the most correlated one."""

    share: float
    partner: str
    correlation: float
    advice: str


class Estimate(NamedTuple):
    """Result of a search."""

    x: Floats
    covariance: Floats
    held: dict[str, str]
    """Parameters that keep the robot file's values, and the reasons."""
    weak: dict[str, Weak]
    """Parameters that the log hardly determines."""


def solve(problem: IdentificationProblem, prior: Floats | None, narrower: IdentificationProblem) -> Estimate:
    """Return all parameters.

    `prior` is the covariance of the base parameters of the robot file, None if nothing is known of them. `narrower` are
    the same rows with half the band of the first filter; the change of parameters with them is part of the deviations.
    """
    search = _searched(problem, prior)
    covariance = search.covariance(narrower)
    return Estimate(search.x, covariance, search.held, search.weak(covariance))


def with_links(problem: IdentificationProblem, prior: Floats) -> Floats:
    """Return all parameters, where those of the links have this covariance about the robot file's."""
    return _searched(problem, prior).x


def _searched(problem: IdentificationProblem, prior: Floats | None) -> _Search:
    search = _Search(problem, prior)
    while True:
        for _ in range(_ROUNDS):
            if search.fit() < _SETTLED:
                break
        if not search.flatten():
            return search


def expected_deviations(problem: IdentificationProblem, prior: Floats | None, noise: list[Floats]) -> Floats:
    """Return standard deviations (p,) of all parameters at the robot file's values, 0 if held.

    `noise` are the standard deviations (n,) of the independent rows of each equation.
    """
    search = _Search(problem, prior, noise)
    return np.linalg.norm(search.ways(search.x) @ search.inverse(search.slopes(search.x)), axis=1)


class _Search:
    """Gauss-Newton search in logarithms of the drives' and springs' positive parameters, and in scaled other ones."""

    def __init__(self, problem: IdentificationProblem, prior: Floats | None, noise: list[Floats] | None = None) -> None:
        self.problem, self.x, self.sizes = problem, problem.start.copy(), _sizes(problem)
        self.prior, self.period = prior, _period(problem.speed)
        self.count = problem.places["links"].start
        """Number of parameters in logarithms, which come first."""
        self.root = np.zeros((len(self.x), len(self.x)))
        """Matrix that converts distances from the robot file's values to standard deviations."""
        for name, share in _SHARES.items():
            for k in range(*problem.places.get(name, slice(0)).indices(len(self.x))):
                self.root[k, k] = 1.0 / share
        inertia = problem.places["I_m"].start
        for i in range(problem.robot.n):
            if (problem.robot.source_of(f"joints[{i + 1}].drive.I_m") or "").startswith("Assumed"):
                self.root[inertia + i, inertia + i] = 1.0 / _ASSUMED
        if prior is not None:
            links = problem.places["links"]
            self.root[links, links] = np.linalg.inv(np.linalg.cholesky(prior)) * self.sizes[links]
        self.mix = np.eye(len(self.x))
        """Static friction is scaled with Coulomb friction, to keep their ratio in a log without slow motions."""
        f_s, f_c = problem.places["f_s"], problem.places["f_c"]
        self.mix[f_s, f_c] = np.eye(problem.robot.n)
        self.free: Any = np.ones(len(self.x), bool)
        self.free[: self.count] = self.x[: self.count] > 0.0
        if "F_cb" in problem.places:
            self.free[problem.places["F_cb"]] = problem.robot.F_cb > 0.0
        dry = problem.start[problem.places["f_s"]] + problem.start[problem.places["f_c"]] > 0.0
        self.free[problem.places["v_s"]] &= dry
        self.held = {problem.names[i]: NO_START for i in np.flatnonzero(~self.free[: self.count])}
        unseen = np.flatnonzero(~problem.seen)
        way = "log them by encoders behind the gears"
        if problem.stretch is not None:
            for name in (*SPRINGS, "delay_q", "offset"):
                places = problem.places[name].start + unseen
                self.free[places] = False
                if name in SPRINGS:
                    self.held |= {problem.names[i]: f"the log has no positions of its link; {way}" for i in places}
        if noise is None:
            each = zip(problem.errors(self.x), problem.jacobian(self.x), strict=True)
            noise = [self._noise(error, slope) for error, slope in each]
        self.weights = noise
        self.moved = np.zeros(len(self.x))

    def ways(self, x: Floats) -> Floats:
        """Return the derivatives of all parameters with respect to the search variables, (p, free)."""
        return np.concatenate([x[: self.count], self.sizes[self.count :]])[:, None] * self.mix[:, self.free]

    def _noise(self, error: Floats, slope: Floats) -> Floats:
        """Return the noise of an equation by joint: the residual of the linear problem at the start."""
        slopes = np.moveaxis(slope @ self.ways(self.x), 1, 0)
        left = [e - s @ np.linalg.lstsq(s, e, rcond=None)[0] for e, s in zip(error.T, slopes, strict=True)]
        return _level(np.transpose(left), self.period)

    def slopes(self, x: Floats) -> list[Floats]:
        """Return derivatives (k, n, free) of each equation's weighted residuals with respect to search variables."""
        each = zip(self.problem.jacobian(x), self.weights, strict=True)
        return [(e / w[:, None]) @ self.ways(x) for e, w in each]

    def fit(self) -> float:
        """Solve the least-squares problem, set new weights from the residuals, and return the change."""
        x, count, root = self.x, self.count, self.root[:, self.free]

        def whole(part: Floats) -> Floats:
            full = self.mix[:, self.free] @ part
            positive = x[:count] * np.exp(np.clip(full[:count], -5.0, 5.0))
            return np.concatenate([positive, x[count:] + self.sizes[count:] * full[count:]])

        def residual(part: Floats) -> Floats:
            each = zip(self.problem.errors(whole(part)), self.weights, strict=True)
            return np.concatenate([*((e / w).ravel() for e, w in each), self.root @ self.moved + root @ part])

        def slopes(part: Floats) -> Floats:
            now = whole(part)
            rows = [each.reshape(-1, part.size) for each in self.slopes(now)]
            return np.concatenate([*rows, root])

        start, jac = np.zeros(int(self.free.sum())), cast(Any, slopes)
        solution: Any = least_squares(residual, start, jac, method="lm", xtol=1e-6, ftol=1e-9, max_nfev=_STEPS)
        self.x = whole(solution.x)
        self.moved[self.free] += solution.x
        self.weights = [_level(e, self.period) for e in self.problem.errors(self.x)]
        return float(np.abs(solution.x).max(initial=0.0))

    def flatten(self) -> bool:
        """Hold joints' static friction at Coulomb friction if it would be less; return whether any joint changes."""
        at, n = self.problem.places, self.problem.robot.n
        less = [i for i in range(n) if self.free[at["f_s"].start + i] and self.x[at["f_s"]][i] < self.x[at["f_c"]][i]]
        for i in less:
            for name in ("f_s", "v_s"):
                place = at[name].start + i
                self.free[place], self.moved[place] = False, 0.0
                self.held[self.problem.names[place]] = "in this log friction does not fall with speed, so f_s is f_c"
            self.x[at["f_s"].start + i] = self.x[at["f_c"].start + i]
            self.x[at["v_s"].start + i] = self.problem.start[at["v_s"].start + i]
        return bool(less)

    def inverse(self, slopes: list[Floats]) -> Floats:
        """Return a square root (free, free) of the search variables' covariance for independent residuals."""
        root = self.root[:, self.free]
        rows = [each.reshape(-1, root.shape[1]) for each in slopes]
        V: Any
        _, S, V = np.linalg.svd(np.linalg.qr(np.concatenate([*rows, root]), mode="r"))
        return V.T / np.maximum(S, 1e-12 * S[0])

    def covariance(self, narrower: IdentificationProblem) -> Floats:
        """Covariance of all parameters for residuals that are correlated from row to row (Newey and West 1987).

        Deviations are at least as large as for independent residuals. To these are added the changes caused by halving
        the first filter's band, and by encoder steps, which pass the second filter at turning points.
        """
        x, root = self.x, self.root[:, self.free]
        slopes = self.slopes(x)
        errors = [e / w for e, w in zip(self.problem.errors(x), self.weights, strict=True)]
        rows = sum(each.shape[0] * each.shape[1] for each in slopes)
        inverse = self.inverse(slopes)
        inverse = inverse @ inverse.T
        pulls = np.sum([np.einsum("kn,knp->kp", e, s) for e, s in zip(errors, slopes, strict=True)], axis=0)
        ways, spare = self.ways(x) @ inverse, rows / max(1, rows - root.shape[1])
        alike = ways @ (spare * _long_run(pulls, self.period) + root.T @ root) @ ways.T
        prior = np.sum((ways @ root.T) ** 2, axis=1)
        independent = spare * np.einsum("pi,pi->p", ways, self.ways(x)) + (1.0 - spare) * prior
        more = np.sqrt(np.maximum(1.0, independent / np.maximum(np.diag(alike), 1e-300)))
        each = zip(narrower.errors(x), self.problem.errors(x), self.weights, slopes, strict=True)
        changes = [(np.sum([np.einsum("kn,knp->p", (a - b) / w, s) for a, b, w, s in each], axis=0), 1.0)]
        steps = [] if self.problem.stretch is None else self.problem.steps()
        for error in steps:
            pull = np.einsum("kn,knp->p", self.problem.seen * error / self.weights[1], slopes[1])
            changes.append((pull, len(steps) ** -0.5))
        shifts = []
        for pull, share in changes:
            change = inverse @ pull
            change /= max(1.0, np.abs(root @ change).max())  # the prior limits a large change
            shifts.append(share * self.ways(x) @ change)
        return alike * np.outer(more, more) + np.transpose(shifts) @ np.array(shifts)

    def weak(self, covariance: Floats) -> dict[str, Weak]:
        """Return the parameters that the log hardly determines, with their partners and the fix."""
        names, places, shown = self.problem.names, self.problem.places, self.problem.shown
        before = np.full(len(names), np.inf)
        scale = np.concatenate([self.x[: self.count], self.sizes[self.count :]])
        for name in _SHARES:
            each = places.get(name, slice(0))
            before[each] = scale[each] / np.diag(self.root)[each]
        if self.prior is not None:
            before[places["links"]] = np.sqrt(np.diag(self.prior))
        deviation, notes = np.sqrt(np.diag(covariance)), dict[str, Weak]()
        coarse = self._coarse()
        for k in shown:
            if self.free[k] and (names[k] in coarse or deviation[k] > _UNKNOWN * before[k]):
                correlation = covariance[k, shown] / (np.maximum(deviation[shown], 1e-300) * deviation[k])
                correlation[shown.index(k)] = 0.0
                partner = int(np.argmax(np.abs(correlation)))
                share = float(deviation[k] / before[k])
                way = "use encoders with a finer resolution" if names[k] in coarse else _fix(names[k])
                notes[names[k]] = Weak(share, names[shown[partner]], float(correlation[partner]), way)
        return notes

    def _coarse(self) -> set[str]:
        """Return the parameters of springs that deform by only a few steps of their encoder.

        Errors of so few steps follow the motion, so they are not noise, and intervals would miss the true value.
        """
        problem, n = self.problem, self.problem.robot.n
        if problem.stretch is None:
            return set()
        bend = np.std(problem.stretch - self.x[problem.places["delay_q"]] * problem.speed, axis=0)
        few = [i for i in range(n) if bend[i] < _RESOLVED * problem.resolution[i]]
        return {f"{name}[{i + 1}]" for name in SPRINGS for i in few}


def _level(error: Floats, period: float) -> Floats:
    """Return the noise of an equation's residuals by joint; 1 for a joint without the equation, whose rows are 0.

    It is their RMS times the ratio of their mean's deviation to that for independent residuals.
    """
    level = np.sqrt([_long_run(column[:, None], period)[0, 0] / len(error) for column in error.T])
    level = np.maximum(level, np.sqrt(np.mean(error**2, axis=0)))
    return np.where(level > 0.0, level, 1.0)


def _long_run(pulls: Floats, period: float) -> Floats:
    """Covariance (p, p) of the sum of correlated rows (k, p), with Bartlett weights.

    Rows at the same place of a periodic motion are treated as one, because model errors are the same there.
    """
    folded = np.zeros((min(int(period) + 1, len(pulls)), pulls.shape[1]))
    np.add.at(folded, (np.arange(len(pulls)) % period).astype(int), pulls)
    lags = int(np.ceil(_LAGS * len(folded) ** (1.0 / 3.0)))
    total = folded.T @ folded
    for lag in range(1, min(lags, len(folded) - 1) + 1):
        shifted = (1.0 - lag / (lags + 1.0)) * folded[lag:].T @ folded[:-lag]
        total += shifted + shifted.T
    return total


def _period(speed: Floats) -> float:
    """Return the number of rows of (k, n) after which a motion repeats, k if it does not."""
    k = len(speed)
    off = np.array([np.mean((speed[lag:] - speed[:-lag]) ** 2) for lag in range(1, k // 2 + 1)]) / np.mean(speed**2)
    for i in range(1, len(off) - 1):
        if off[i] < _ALIKE and off[i] <= min(off[i - 1], off[i + 1]):
            bend = off[i - 1] - 2.0 * off[i] + off[i + 1]
            return i + 1.0 + 0.5 * (off[i - 1] - off[i + 1]) / max(bend, 1e-300)
    return float(k)


def _sizes(problem: IdentificationProblem) -> Floats:
    """Return scales of parameters: for links the largest with the same unit, for delays a step of the log."""
    sizes, links = np.abs(problem.start), problem.places["links"]
    for i in range(links.start, links.stop):
        same = [j for j in range(links.start, links.stop) if problem.units[j] == problem.units[i]]
        sizes[i] = max(np.abs(problem.start[same]).max(), 1e-9)
    for name, size in (("tau_0", 0.1), ("delay_tau", problem.step), ("delay_q", problem.step), ("offset", 1e-4)):
        sizes[problem.places.get(name, slice(0))] = size
    return sizes


def _fix(name: str) -> str:
    return {
        "I_m": "log faster motions",
        "f_s": "log slow motions, below v_s",
        "v_s": "log slow motions, about v_s",
        "f_v": "log motions at several speeds",
        "c_f": "log larger torques",
        "c_w": "log torques through 0",
        "K_w0": "log torques through 0",
        "delay_tau": "log faster motions",
        "delay_q": "log faster motions",
    }.get(name.split("[")[0], "log a motion that moves more joints, further")
