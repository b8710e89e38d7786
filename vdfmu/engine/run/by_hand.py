"""A run by hand: the user makes its steps, for a controller or reinforcement learning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.fmu.access import KINDS, TEXTS
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Value, spread
from vdfmu.engine.plan.checker import overrides
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import group_of
from vdfmu.engine.run.session import Session


class ByHand:
    """Steps of components that are initialized and coupled, here or in a process of their own."""

    def __init__(self, session: Session, grid: Grid) -> None:
        self._session, self._grid, self._components = session, grid, session.components
        self._plan, self._k = session.planned(grid, ()), 0  # values that are read must be finite
        session.exchange.refuse_not_finite("initialization", grid.begin)
        self._sinks: dict[str, tuple[str, list[FmuVariable]]] = {}
        self._sources: dict[str, Callable[[], Any]] = {}
        self._memory = [(bank.memory, bank.memory.copy()) for bank in session.exchange.banks]
        self._returns = self._components.keep_start()

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._grid.time(self._k)

    def restart(self) -> bool:
        """Go back to the start from saved states; False if that needs a new initialization."""
        self._components.to_start()
        for memory, before in self._memory:
            memory[:] = before
        self._k = 0
        if self._plan.compiled is not None:
            self._plan.compiled.row = 0
        return self._returns

    def step(self, count: int) -> None:
        """Do some steps."""
        if not isinstance(count, (int, np.integer)) or count < 0:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise UsageError(f"step: expected a number of steps, 0 or more, got {count!r}.")
        if count > (left := self._grid.n - self._k):
            raise UsageError(
                f"step: the run ends at t = {self._grid.end:g} s, {left} steps from t = {self.time:g} s. "
                "Reset it, with a later stop."
            )
        box, compiled, end = self._session.box, self._plan.compiled, self._k + count
        while self._k < end:
            if compiled is not None:
                self._k = compiled.run(end)
            else:
                self._plan.do_step(self._k)
                self._k += 1
                self._session.exchange.refuse_not_finite("doStep", self.time)
            if box.pending:
                box.flush()
            if box.ended:
                name, time = next(iter(box.ended.items()))
                raise CosimError(name, "doStep", time, "it ended the simulation")

    def set(self, name: str, value: Any) -> None:
        """Set an unconnected input or a tunable parameter."""
        owner, sinks = self._sinks.get(name) or self._sinks.setdefault(name, self._sinks_of(name, value))
        try:
            values = spread(value, [variable.name for variable in sinks])
            made = [(v.name, v.domain.read(x)) for v, x in zip(sinks, values, strict=True)]
        except ValueError as error:
            raise UsageError(f"{name!r}: {error}") from None
        self._components.put(owner, made)

    def _sinks_of(self, name: str, value: Value) -> tuple[str, list[FmuVariable]]:
        checked = self._session.checked
        fed = {link.end: link.start for link in checked.links}
        ((owner, named),) = overrides(checked.descriptions, {name: value}).items()
        sinks: list[FmuVariable] = []
        for variable, _ in named.values():
            source = fed.get((owner, variable.name))
            if source is not None:
                raise UsageError(f"{name!r}: {'.'.join(source)} is connected to it. Remove the connection to set it.")
            tunable = variable.causality == "parameter" and variable.variability == "tunable"
            settable = variable.causality == "input" or tunable
            if not settable or not self._components.between_events(owner, variable.name):
                raise UsageError(
                    f"{name!r}: expected an input or a tunable parameter, got a {variable.variability} "
                    f"{variable.causality}. Set it before the run: reset(parameters={{{name!r}: ..}})."
                )
            sinks.append(variable)
        return owner, sinks

    def get(self, name: str) -> Any:
        """Return a number, or the array of all numbers whose names begin with it."""
        return (self._sources.get(name) or self._sources.setdefault(name, self._source_of(name)))()

    def _source_of(self, name: str) -> Callable[[], Any]:
        for owner, description in self._session.checked.descriptions.items():
            if not name.startswith(f"{owner}."):
                continue
            wanted = name[len(owner) + 1 :]
            variables = [v for v in description.variables.values() if v.name.partition("[")[0] == wanted]
            if wanted in description.variables:
                return self._number(owner, description.variables[wanted])
            if variables:
                return self._array(owner, variables)
        raise UsageError(f"there is no signal {name!r}.")

    def _number(self, owner: str, variable: FmuVariable) -> Callable[[], Any]:
        place = self._place(owner, variable)
        if place is None:
            return lambda: self._components.value(owner, variable.name)
        return lambda: place[0][place[1]].item()

    def _array(self, owner: str, variables: list[FmuVariable]) -> Callable[[], Any]:
        indices = [group_of(v.name)[1] for v in variables]
        shape = tuple(map(max, zip(*indices, strict=True)))
        if indices != [tuple(i + 1 for i in index) for index in np.ndindex(shape)]:
            raise UsageError(f"{owner}: {variables[0].name} and the others of its name do not fill an array.")
        places = [place for v in variables if (place := self._place(owner, v)) is not None]
        if len(places) == len(variables):
            memory, columns = places[0][0], np.array([place for _, place in places], np.intp)
            return lambda: memory.take(columns).reshape(shape)
        numbers = [self._number(owner, v) for v in variables]
        return lambda: np.array([number() for number in numbers]).reshape(shape)

    def _place(self, owner: str, variable: FmuVariable) -> tuple[NDArray[Any], int] | None:
        """Return the memory and place of a number in the master; None if only the component has it."""
        if variable.kind in TEXTS:
            return None
        bank = self._session.exchange.banks[KINDS.index(variable.kind)]
        place = bank.position.get((owner, variable.name))
        return None if place is None else (bank.memory, place)
