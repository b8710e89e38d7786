"""A run by hand, whose steps the user makes, for a controller or reinforcement learning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.fmu.access import KINDS, TEXTS
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.masters.components import Components
from vdfmu.engine.package.system import Value, spread
from vdfmu.engine.plan.checker import overrides
from vdfmu.engine.results.results import group_of
from vdfmu.engine.run.isolated import Isolated
from vdfmu.engine.run.run import Run


class ByHand:
    """Steps and values of a run of components, in this or their own process; nothing is recorded."""

    def __init__(self, components: Components | Isolated, run: Run) -> None:
        self._components, self._exchange, self._run = components, components.exchange, run
        run.by_hand()
        run.begin()
        self._sinks: dict[str, tuple[str, list[FmuVariable]]] = {}
        self._sources: dict[str, Callable[[], Any]] = {}
        self._memory = [(bank.memory, bank.memory.copy()) for bank in self._exchange.banks]
        self._returns = components.keep_start()

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._run.time

    def restart(self) -> bool:
        """Return to the start from saved states; False if a new initialization is needed."""
        self._components.to_start()
        for memory, before in self._memory:
            memory[:] = before
        self._run.begin()
        return self._returns

    def step(self, count: int) -> None:
        """Make a number of steps."""
        if not isinstance(count, (int, np.integer)) or count < 0:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise UsageError(f"step: expected a number of steps, 0 or more, got {count!r}.")
        run, ended = self._run, self._components.box.ended
        if count > (left := run.grid.n - run.row):
            raise UsageError(
                f"step: expected at most {left}: the run is at t = {self.time:g} s and ends at {run.grid.end:g} s. "
                "Reset it with a later stop."
            )
        run.step(run.row + count)
        if ended:
            name, time = next(iter(ended.items()))
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
        checked = self._exchange.checked
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
        """Return a number, or the array of all numbers of this name."""
        return (self._sources.get(name) or self._sources.setdefault(name, self._source_of(name)))()

    def _source_of(self, name: str) -> Callable[[], Any]:
        for owner, description in self._exchange.checked.descriptions.items():
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
            raise UsageError(f"{owner}: {variables[0].name} and the other elements of this name do not fill an array.")
        places = [place for v in variables if (place := self._place(owner, v)) is not None]
        if len(places) == len(variables):
            memory, columns = places[0][0], np.array([place for _, place in places], np.intp)
            return lambda: memory.take(columns).reshape(shape)
        numbers = [self._number(owner, v) for v in variables]
        return lambda: np.array([number() for number in numbers]).reshape(shape)

    def _place(self, owner: str, variable: FmuVariable) -> tuple[NDArray[Any], int] | None:
        """Return the memory and the place of a number in the master; None if only the component has it."""
        if variable.kind in TEXTS:
            return None
        bank = self._exchange.banks[KINDS.index(variable.kind)]
        place = bank.position.get((owner, variable.name))
        return None if place is None else (bank.memory, place)
