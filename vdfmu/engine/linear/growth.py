"""Stability of a run: where disturbances grow along it, and the margins of its loops at some times."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.errors import VdfmuError
from vdfmu.engine.linear.linearise import Linearisation
from vdfmu.engine.linear.loops import GROWTH, fastest_mode, modulus_margins, moving, of_positions, opened_at, rates_of
from vdfmu.engine.linear.system import LinearSystem
from vdfmu.engine.masters.components import Components

_HARM = 50.0
"""Factor by which disturbances grow, beyond what this rate gives, before a run is unstable: vibration and the ends of a
motion, where friction falls with speed, let them grow for a while."""
_POSES, _FEWEST, _SPARSE = 60, 8, 25
"""Rows at which a run is linearised: at most, at least, and steps for each of the others. Stick-slip at the ends of a
motion of 4 s lasts for 0.1 s."""
MARGINS = 5
"""Times of a run at which margins are calculated: evenly spread, the first at its start, the last at its end."""


class Growth(NamedTuple):
    """Where disturbances grow most along a run."""

    exponent: float
    """Logarithm of the factor by which they grow, beyond what the rate `GROWTH` gives."""
    begin: float
    """Begin [s]."""
    end: float
    """End [s]."""
    rate: float
    """Largest rate in this time [1/s]."""
    state: str
    """State with the largest part in the mode of this rate."""
    lasts: bool
    """Whether they grow until the end of the run."""

    @property
    def unstable(self) -> bool:
        """Whether disturbances grow by a factor of `_HARM` beyond what the rate `GROWTH` gives; e-fold if they last."""
        return self.exponent > (1.0 if self.lasts else math.log(_HARM))


def margin_rows(n: int) -> list[int]:
    """Return the rows of a run with n steps at which margins are calculated."""
    return [round(k * n / (MARGINS - 1)) for k in range(MARGINS)]


class Poses:
    """Linearises the loops of a run at some of its rows: a visitor of the run.

    Parameters
    ----------
    group : str
        Loops are opened at connected inputs of this name, at any component.
    most : int
        Most rows for the growth, besides one near the start.

    Attributes
    ----------
    systems : list of (time, LinearSystem)
        Systems in the loops, for the growth.
    spread : list of (time, LinearSystem)
        Those for the margins.
    lacking : str
        Why systems are missing; empty if none are.
    """

    def __init__(self, group: str, most: int = _POSES) -> None:
        self._group, self._most = group, most
        self.systems: list[tuple[float, LinearSystem]] = []
        self.spread: list[tuple[float, LinearSystem]] = []
        self._lists: list[Any] = []  # those of the two to which each row goes, the last row first
        self.lacking = ""
        self.opened: list[str] = []
        self._linearisation: Linearisation | None = None

    def rows(self, n: int) -> frozenset[int]:
        """Return the rows of a run with n steps: for the growth closer together at both ends, where motors are slow."""
        poses = min(self._most, _FEWEST + n // _SPARSE)
        shares = (1.0 - np.cos(np.pi * (np.arange(poses) + 0.5) / poses)) / 2.0
        own, spread = {*(n * shares).astype(int).tolist(), min(2, n), min(10, n)}, margin_rows(n)
        kinds = ((own, self.systems), (spread, self.spread))
        rows = sorted(own.union(spread), reverse=True)
        self._lists = [[systems for some, systems in kinds if row in some] for row in rows]
        return frozenset(rows)

    def visit(self, components: Components, time: float, step: float) -> None:
        """Linearise the components."""
        lists = self._lists.pop()
        if self.lacking:
            return
        try:
            if self._linearisation is None:
                self._linearisation = Linearisation(components, step, loops=True)
            found = self._linearisation.at(time, values=False)
            found = replace(found, parts=of_positions(found.parts))
            self.lacking = "; ".join(found.parts.notes)
            self.opened = opened_at(found, self._group)
            if not self.opened:
                self.lacking = f"nothing is connected to an input {self._group}"
            if not self.lacking:
                loops = found.around(self.opened)
                if not (self.systems or self.spread) and not loops.how.continuous:
                    loops.sampled()  # refuses unknown behaviour
                elif loops.how.continuous and loops.samples.signals:
                    self.lacking = f"{loops.algorithm} takes as continuous what has sampled states"
                for systems in lists:
                    systems.append((time, loops))
        except VdfmuError as error:
            self.lacking = str(error)

    def growth(self, begin: float, end: float) -> Growth:
        """Return where disturbances grow most, of a run from `begin` to `end` [s]."""
        times = [t for t, _ in self.systems]
        bounds = [begin, *((a + b) / 2.0 for a, b in pairwise(times)), max(end, times[-1])]
        systems = [moving(system) for _, system in self.systems]
        rates = [float(rates_of(np.linalg.eigvals(each.A), each.step).max()) for each in systems]
        most, run, first, place = -np.inf, 0.0, 0, range(0)
        for k, rate in enumerate(rates):
            if run < 0.0 or not k:
                run, first = 0.0, k
            run += (rate - GROWTH) * (bounds[k + 1] - bounds[k])
            if run > most:
                most, place = run, range(first, k + 1)
        fastest = max(place, key=rates.__getitem__)
        rate, state = fastest_mode(self.systems[fastest][1])
        return Growth(most, bounds[place.start], bounds[place.stop], rate, state, place.stop == len(rates))

    def margin(self) -> tuple[float, float, str] | None:
        """Return the smallest modulus margin of `spread`, its time [s], and the input at which that loop is opened.

        Without a margin, the state that grows most. None for a master that takes signals as continuous.
        """
        if self.systems[0][1].how.continuous:
            return None
        found: list[tuple[float, float, str]] = []
        for time, system in self.spread:
            modulus = modulus_margins(system, self.opened)
            i = system.places(self.opened)[int(modulus.argmin())]
            name = system.parts.inputs[i] if modulus.any() else fastest_mode(system)[1]
            found.append((float(modulus.min()), time, name))
        return min(found)
