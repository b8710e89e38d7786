"""The points of a parameter study: combinations of the axes' values."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.options import SAMPLES
from vdfmu.study.sweeps.axes import MOST_POINTS, Axis, read_axes

LEVELS = 4
"""Levels of Morris' trajectories on each axis."""

Points = dict[str, NDArray[Any]]
"""Target of an axis to its values, (n,) each: row k is point k."""


def draw(axes: Sequence[Axis], sample: str, n: int | None = None, seed: int = 0) -> tuple[list[Axis], Points]:
    """Draw the points of axes; the same for the same arguments.

    Parameters
    ----------
    sample : str
        ``grid``, all combinations of the values, the last axis running fastest; ``lhs`` (Latin hypercube), ``sobol``
        (scrambled) or ``random``, `n` points; ``saltelli``, n (2 d + 2) points, or ``morris``, n (d + 1) points, for
        d axes; or the path of a CSV file: a line of targets, then a line a point.
    n : int, optional
        Needed except for a grid or a file.
    seed : int

    Returns
    -------
    axes
        The file's axes, if there is a file.
    points

    Raises
    ------
    UsageError
        For axes that do not fit the way, a bad file, or too many points.
    """
    if seed < 0:
        raise UsageError(f"seed: expected a number of at least 0, got {seed}.")
    if sample not in SAMPLES:
        if axes and Path(sample).suffix:
            raise UsageError(f"sample: {sample} says what varies, so expected no axis with it.")
        if n is not None and Path(sample).is_file():
            raise UsageError(f"points: {sample} has the points; leave it out.")
        return _read(sample)
    if not axes:
        raise UsageError("vary: expected at least one axis, such as controller.K_p=lin(500, 5000, 10).")
    if sample == "grid":
        return list(axes), _grid(axes, n)
    if n is None or not 1 <= n <= MOST_POINTS:
        raise UsageError(f"points: expected a number of points of {sample} up to {MOST_POINTS:g}, got {n}.")
    count = n * {"saltelli": 2 * len(axes) + 2, "morris": len(axes) + 1}.get(sample, 1)
    if count > MOST_POINTS:
        raise UsageError(f"points: expected at most {MOST_POINTS:g} points, got {count}.")
    drawn = shares(len(axes), sample, n, seed)
    return list(axes), {axis.target: axis.at(drawn[:, i]) for i, axis in enumerate(axes)}


def _grid(axes: Sequence[Axis], n: int | None) -> Points:
    if n is not None:
        raise UsageError("points: a grid has as many points as its axes say; leave it out, or take lhs or sobol.")
    words = "expected values, or their number, lin(FROM, TO, N), in a grid; lhs and sobol need none."
    if without := [f"{axis}: {words}" for axis in axes if not axis.values]:
        raise UsageError("\n".join(without))
    size = math.prod(len(axis.values) for axis in axes)
    if size > MOST_POINTS:
        raise UsageError(f"vary: expected a grid of at most {MOST_POINTS:g} points, got {size}.")
    index = np.indices([len(axis.values) for axis in axes]).reshape(len(axes), -1)
    return {axis.target: np.array(axis.values)[i] for axis, i in zip(axes, index, strict=True)}


def shares(d: int, sample: str, n: int, seed: int) -> Floats:
    """Return points in the unit cube, one a row: for each axis the shares of its distribution, see `Axis.at`."""
    from scipy.stats import qmc

    drawn: Any = {"seed": seed}  # rng from SciPy 1.15 on, which takes both
    if sample == "random":
        return np.random.default_rng(seed).random((n, d))
    if sample == "lhs":
        return qmc.LatinHypercube(d, **drawn).random(n)
    if sample == "sobol":
        if n & (n - 1) == 0:
            return qmc.Sobol(d, **drawn).random_base2(n.bit_length() - 1)
        return qmc.Sobol(d, **drawn).random(2 ** n.bit_length())[:n]
    problem = unit_problem(d)
    if sample == "saltelli":
        from SALib.sample import sobol

        return np.asarray(sobol.sample(problem, n, calc_second_order=True, seed=seed))
    from SALib.sample import morris

    return np.asarray(morris.sample(problem, n, num_levels=LEVELS, seed=seed))


def unit_problem(d: int, names: Sequence[str] | None = None) -> dict[str, Any]:
    """Return a problem of SALib in the unit cube."""
    return {"num_vars": d, "names": list(names or [f"x{i}" for i in range(d)]), "bounds": [[0.0, 1.0]] * d}


def _read(path: str) -> tuple[list[Axis], Points]:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if row]
    except FileNotFoundError:
        raise UsageError(f"sample: expected {', '.join(SAMPLES)} or a CSV file, got {path}.") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if len(rows) < 2:
        raise UsageError(f"{path}: expected a line of targets, then a line for each point.")
    (_, head), *lines = rows
    problems = [
        f"{path}: line {k}: expected {len(head)} values, got {len(row)}." for k, row in lines if len(row) != len(head)
    ] or [
        f"{path}: line {k}: {name.strip()}: expected one value, got {cell!r}."
        for k, row in lines
        for name, cell in zip(head, row, strict=True)
        if "," in cell or not cell.strip()
    ]
    if problems:
        raise UsageError("\n".join(problems[:8]))
    columns = {name.strip(): ", ".join(c) for name, *c in zip(head, *(row for _, row in lines), strict=True)}
    if len(columns) < len(head):
        raise UsageError(f"{path}: expected each target once, got {', '.join(head)}.")
    try:
        axes = read_axes(columns)
    except UsageError as error:
        raise UsageError("\n".join(f"{Path(path)}: {line}" for line in str(error).splitlines())) from None
    return axes, {axis.target: np.array(axis.values) for axis in axes}
