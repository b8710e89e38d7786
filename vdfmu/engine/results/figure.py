"""Figures: curves of one quantity over time. The page draws them, and `vdfmu.extras.pictures.picture` writes files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.measure import Shown
from vdfmu.engine.results.recorded import Recorded

Terms = Sequence[tuple[float, str]]
"""Factors, and names of signals; an empty name means the constant 1."""


class Curve(NamedTuple):
    """A curve of a figure: the sum of signals, each times its factor.

    The page evaluates the same sums for runs that it simulates.
    """

    label: str
    joint: int
    """Number of the joint from 1; 0 for none."""
    terms: Terms
    """Terms of the sum, at least one."""
    dashed: bool = False

    def values(self, results: Recorded, factor: float = 1.0) -> Floats:
        """Return the curve's values times a factor, (m,)."""
        ones = np.ones(len(results))
        return factor * reduce(np.add, [scale * (results[name] if name else ones) for scale, name in self.terms])


class Figure(NamedTuple):
    """Curves of one quantity over time. The unit and the factor of the values follow from the quantity."""

    key: str
    title: str
    quantity: Shown
    curves: Sequence[Curve]


def signal_figures(results: Recorded, hidden: Collection[str] = (), joints: int | None = None) -> Iterator[Figure]:
    """Yield a figure for each recorded variable except the signals that are `hidden`.

    Elements of an array are curves of one figure, except that elements with another unit get their own. In arrays of
    `joints` elements, by default in all arrays, they are numbered as joints.
    """
    for group, members in results.groups.items():
        listed = [(k, name) for k, (_, name) in enumerate(sorted(members.items()), 1) if name not in hidden]
        units = dict.fromkeys(results.units[name] for _, name in listed)
        for unit in units:
            curves = [
                Curve(name.rpartition(".")[2], k if joints in (None, len(members)) else 0, [(1.0, name)])
                for k, name in listed
                if results.units[name] == unit
            ]
            yield Figure(f"{group}, {unit}" if len(units) > 1 else group, group, Shown(unit), curves)
