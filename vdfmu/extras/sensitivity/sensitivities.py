"""Sensitivity indices, which tell on which axes a measure depends, by SALib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import quantity
from vdfmu.engine.results.verdict import DOUBTFUL, GOOD, Check
from vdfmu.study.sweeps.axes import draw, read_axes, shares
from vdfmu.study.sweeps.table import StudyTable

CONFIDENCE = 0.95
"""Confidence level of the half-widths, which come from bootstrap."""
_BOOTSTRAP: Any = {"num_resamples": 500, "conf_level": CONFIDENCE, "seed": 1}  # SALib reads 0 as no seed


_LEVELS = 4
"""Number of levels of Morris' trajectories on each axis."""


@dataclass(frozen=True)
class Indices:
    """Sensitivity indices of a measure, with the half-widths of their confidence intervals."""

    kind: str
    """``sobol`` or ``morris``."""
    axes: tuple[str, ...]
    values: dict[str, Floats]
    """Sobol: ``first`` and ``total``, (d,), the share of the measure's variance caused by an axis alone and with all
    its interactions, and ``second``, (d, d), the share of pairs, NaN except above the diagonal. Morris: ``mu_star``,
    the mean absolute change of the measure over the range of an axis, ``mu``, the same with sign, and ``sigma``, its
    standard deviation, (d,), which is 0 for an axis without curvature and interaction."""
    widths: dict[str, Floats]
    """Half-widths of the same shapes; for Morris only of ``mu_star``."""
    confidence: float = CONFIDENCE

    def rows(self) -> list[tuple[str, dict[str, str]]]:
        """Return a line for each axis, then for each pair: name, and by index its value ± half-width as text."""
        alone = [name for name, array in self.values.items() if array.ndim == 1]
        lines = [(axis, {name: self._text(name, i) for name in alone}) for i, axis in enumerate(self.axes)]
        for i, j in zip(*np.triu_indices(len(self.axes) if "second" in self.values else 0, 1), strict=True):
            lines.append((f"{self.axes[i]} with {self.axes[j]}", {"second": self._text("second", (i, j))}))
        return lines

    def _text(self, name: str, place: Any) -> str:
        width = f" ± {self.widths[name][place]:.2g}" if name in self.widths else ""
        return f"{self.values[name][place]:.3g}{width}"


def indices(study: StudyTable, measure: str | None = None) -> Indices:
    """Return the indices of a measure of a ``saltelli`` or ``morris`` study. UsageError unless it has all points."""
    sample, n, d = study.facts["sample"], study.facts["n"], len(study.axes)
    if sample not in ("saltelli", "morris"):
        raise UsageError(f"{study.path}: indices need --sample saltelli or morris, got {sample}. Try 'sweep report'.")
    values = np.full(n, np.nan)
    values[study["point"]] = study.values(measure)
    missing = np.flatnonzero(~np.isfinite(values))
    if len(missing):
        why = study.failed.get(int(missing[0]), "it is not done, or the measure is not finite")
        raise UsageError(
            f"{study.path}: indices need all points, {len(missing)} of {n} have no value; point {missing[0]}: {why}. "
            "Give the command of the study again, with --retry for failed points, or choose axes without failures."
        )
    if np.ptp(values) == 0.0:
        raise UsageError(f"{study.path}: the measure is {values[0]:g} at all points, so no axis matters.")
    if sample == "saltelli":
        return sobol_indices(values, study.axes)
    base = n // (d + 1)
    axes, drawn = draw(read_axes(study.facts["axes"]), sample, base, study.facts["seed"])
    order = study["point"]
    if any((drawn[axis.target][order] != study[axis.target]).any() for axis in axes):
        raise UsageError(f"{study.path}: its points were drawn by another release of SALib; run the study again.")
    return morris_indices(values, shares(d, sample, base, study.facts["seed"]), study.axes)


def sobol_indices(values: ArrayLike, axes: Sequence[str]) -> Indices:
    """Return Sobol indices of the values at points of ``saltelli``, (n (2 d + 2),), in order."""
    from SALib.analyze import sobol

    analysis: Any = sobol.analyze(_unit_problem(len(axes), axes), np.asarray(values, dtype=float), **_BOOTSTRAP)
    names = {"first": "S1", "total": "ST", "second": "S2"}
    return Indices(
        "sobol",
        tuple(axes),
        {name: np.asarray(analysis[key]) for name, key in names.items()},
        {name: np.asarray(analysis[f"{key}_conf"]) for name, key in names.items()},
    )


def morris_indices(values: ArrayLike, points: Floats, axes: Sequence[str]) -> Indices:
    """Return Morris' measures of the values at points of ``morris``, (n (d + 1), d) in the unit cube."""
    from SALib.analyze import morris

    analysis: Any = morris.analyze(
        _unit_problem(len(axes), axes), points, np.asarray(values, dtype=float), num_levels=_LEVELS, **_BOOTSTRAP
    )
    return Indices(
        "morris",
        tuple(axes),
        {name: np.asarray(analysis[name], dtype=float) for name in ("mu_star", "mu", "sigma")},
        {"mu_star": np.asarray(analysis["mu_star_conf"], dtype=float)},
    )


def shares_of(d: int, sample: str, n: int, seed: int) -> Floats:
    """Return the points of ``saltelli``, n (2 d + 2), or of ``morris``, n (d + 1), in the unit cube, a row each."""
    problem = _unit_problem(d)
    if sample == "saltelli":
        from SALib.sample import sobol

        return np.asarray(sobol.sample(problem, n, calc_second_order=True, seed=seed))
    from SALib.sample import morris

    return np.asarray(morris.sample(problem, n, num_levels=_LEVELS, seed=seed))


def matters(study: StudyTable) -> tuple[Check, list[str]]:
    """Return the check of a sensitivity study's indices, and the axes that matter most."""
    name, label = next(iter(study.facts["measures"])), "Indices"
    unit = study.facts["units"].get(name, "")
    unit = "" if unit == "1" else unit
    try:
        sensitivity = indices(study, name)
    except UsageError as error:
        return Check("indices", label, DOUBTFUL, str(error).partition(": ")[2].partition(". ")[0]), []
    key = "total" if sensitivity.kind == "sobol" else "mu_star"
    first, *rest = np.argsort(-sensitivity.values[key], kind="stable")[:2].tolist()
    if key == "total":
        begin, by, factor, unit, more = "", "", 100.0, "%", f" of the variance of {name}"
    else:
        begin, by, factor, more = f"over its range it changes {name} ", "by ", 1.0, ""
    values, widths = (factor * each[key] for each in (sensitivity.values, sensitivity.widths))
    effects = [f"{by}{quantity(float(values[k]), unit)} ± {quantity(float(widths[k]), unit)}" for k in (first, *rest)]
    phrases = [f"{sensitivity.axes[first]} matters most: {begin}{effects[0]}{more}"]
    phrases += [f"{sensitivity.axes[k]} {effect}" for k, effect in zip(rest, effects[1:], strict=True)]
    return Check("indices", label, GOOD, phrases[0]), phrases


def _unit_problem(d: int, names: Sequence[str] | None = None) -> dict[str, Any]:
    """Return a problem of SALib in the unit cube."""
    return {"num_vars": d, "names": list(names or [f"x{i}" for i in range(d)]), "bounds": [[0.0, 1.0]] * d}
