"""A run by hand: the user makes its steps, for a controller or reinforcement learning."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.fmu.access import KINDS, TEXTS
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.sampled import SampledStepper
from vdfmu.engine.package.system import Value, spread
from vdfmu.engine.plan.checker import overrides
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import group_of
from vdfmu.engine.run.session import Session


class ByHand:
    """Steps of components that are initialized and coupled, and not isolated."""

    def __init__(self, session: Session, grid: Grid) -> None:
        assert isinstance(session.components, Components)
        self._session, self._grid, self._instances = session, grid, session.components.instances
        self._plan, self._k = session.planned(grid, ()), 0  # values that are read must be finite
        session.exchange.refuse_not_finite("initialization", grid.begin)
        self._sinks: dict[str, list[tuple[Instance, FmuVariable]]] = {}
        self._sources: dict[str, Callable[[], Any]] = {}
        self._memory = [(bank.memory, bank.memory.copy()) for bank in session.exchange.banks]
        self._states: list[tuple[Instance, c_void_p]] = []
        # arrays of FMI 3.0 are set as a whole, with elements that the instance remembers
        simple = all(d.saves_state and not d.version.arrays for d in session.checked.descriptions.values())
        if simple and type(self._plan.stepper) is SampledStepper:
            self._states = [(instance, instance.saved_state()) for instance in self._instances.values()]

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._grid.time(self._k)

    def restart(self) -> bool:
        """Go back to the start from saved states; False if that needs a new initialization."""
        for instance, state in self._states:
            instance.restore_state(state)
        for memory, before in self._memory:
            memory[:] = before
        self._k = 0
        if self._plan.compiled is not None:
            self._plan.compiled.row = 0
        return bool(self._states)

    def close(self) -> None:
        """Free the saved states."""
        for instance, state in self._states:
            instance.free_state(state)
        self._states = []

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
        """Set an input that nothing feeds, or a tunable parameter."""
        sinks = self._sinks.get(name) or self._sinks.setdefault(name, self._sinks_of(name, value))
        try:
            values = spread(value, [variable.name for _, variable in sinks])
            made = [(v, v.domain.read(x)) for (_, v), x in zip(sinks, values, strict=True)]
        except ValueError as error:
            raise UsageError(f"{name!r}: {error}") from None
        sinks[0][0].set_all(made)

    def _sinks_of(self, name: str, value: Value) -> list[tuple[Instance, FmuVariable]]:
        checked = self._session.checked
        fed = {link.end: link.start for link in checked.links}
        sinks: list[tuple[Instance, FmuVariable]] = []
        for owner, named in overrides(checked.descriptions, {name: value}).items():
            instance = self._instances[owner]
            for variable, _ in named.values():
                source = fed.get((owner, variable.name))
                if source is not None:
                    raise UsageError(f"{name!r}: {'.'.join(source)} feeds it. Take the connection out to set it.")
                tunable = variable.causality == "parameter" and variable.variability == "tunable"
                if not (variable.causality == "input" or tunable) or not instance.between_events(variable):
                    raise UsageError(
                        f"{name!r}: expected an input or a tunable parameter, got a {variable.variability} "
                        f"{variable.causality}. Set it before the run: reset(parameters={{{name!r}: ..}})."
                    )
                sinks.append((instance, variable))
        return sinks

    def get(self, name: str) -> Any:
        """Return a number, or the array of all numbers whose names begin with it."""
        return (self._sources.get(name) or self._sources.setdefault(name, self._source_of(name)))()

    def _source_of(self, name: str) -> Callable[[], Any]:
        for owner, description in self._session.checked.descriptions.items():
            if not name.startswith(f"{owner}."):
                continue
            wanted, instance = name[len(owner) + 1 :], self._instances[owner]
            variables = [v for v in description.variables.values() if v.name.partition("[")[0] == wanted]
            if wanted in description.variables:
                return self._number(instance, description.variables[wanted])
            if variables:
                return self._array(instance, variables)
        raise UsageError(f"there is no signal {name!r}.")

    def _number(self, instance: Instance, variable: FmuVariable) -> Callable[[], Any]:
        place = self._place(instance, variable)
        return (lambda: instance.get(variable)) if place is None else lambda: place[0][place[1]].item()

    def _array(self, instance: Instance, variables: list[FmuVariable]) -> Callable[[], Any]:
        indices = [group_of(v.name)[1] for v in variables]
        shape = tuple(map(max, zip(*indices, strict=True)))
        if indices != [tuple(i + 1 for i in index) for index in np.ndindex(shape)]:
            raise UsageError(f"{instance.name}: {variables[0].name} and the others of its name do not fill an array.")
        places = [place for v in variables if (place := self._place(instance, v)) is not None]
        if len(places) == len(variables):
            memory, columns = places[0][0], np.array([place for _, place in places], np.intp)
            return lambda: memory.take(columns).reshape(shape)
        numbers = [self._number(instance, v) for v in variables]
        return lambda: np.array([number() for number in numbers]).reshape(shape)

    def _place(self, instance: Instance, variable: FmuVariable) -> tuple[NDArray[Any], int] | None:
        """Return the memory and place of a number in the master; None if only the component has it."""
        if variable.kind in TEXTS:
            return None
        bank = self._session.exchange.banks[KINDS.index(variable.kind)]
        place = bank.position.get((instance.name, variable.name))
        return None if place is None else (bank.memory, place)
