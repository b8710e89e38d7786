"""States that are functions of outputs with known rates: the torques of springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from vdfmu.engine.linear.loops import Tied
from vdfmu.engine.linear.system import LinearSystem


def with_tied(system: LinearSystem, tied: Sequence[Tied]) -> LinearSystem:
    """Return the system with rates of tied states from the rates of their outputs.

    For a stiffening spring, ``tau_dot = K(tau) (v - w)``, the linearisation of any system has a positive pole while the
    load grows, only because K depends on tau. But tau is a function of the position, whose rate is v.
    """
    A, C = system.parts.A.copy(), system.parts.C
    for states, outputs in _tied_places(system.parts.states, system.parts.outputs, tuple(tied)):
        slopes = C[np.ix_(outputs, states)]
        if np.diag(slopes).all():
            rest: list[int] = np.delete(np.arange(len(A)), states).tolist()
            A[np.ix_(states, states)] = -np.linalg.solve(slopes, C[np.ix_(outputs, rest)] @ A[np.ix_(rest, states)])
    return replace(system, parts=replace(system.parts, A=A))


@lru_cache(8)
def _tied_places(
    states: tuple[str, ...], outputs: tuple[str, ...], tied: tuple[Tied, ...]
) -> list[tuple[list[int], list[int]]]:
    """Return the places of the tied states and outputs of each component that has all of them."""
    places: list[tuple[list[int], list[int]]] = []
    for component in dict.fromkeys(name.partition(".")[0] for name in states):
        for groups in tied:
            torques, positions, rates = (
                [i for i, name in enumerate(names) if name.split("[")[0] == f"{component}.{group}"]
                for names, group in zip((states, outputs, states), groups, strict=True)
            )
            if torques and len(torques) == len(positions) == len(rates):
                places.append((torques, positions))
    return places
