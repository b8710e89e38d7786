"""The components of one run in this process: loading, initialization, coupling, freeing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import c_double, c_void_p
from pathlib import Path

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.fmu.access import TEXTS
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.library import Watch
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.fmu.versions import class_of
from vdfmu.engine.masters.events import Events
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.observer import reader
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.masters.steppers import CONVERGENCE, Coupling
from vdfmu.engine.plan.check import Checked


class Components:
    """The components of one run.

    Parameters
    ----------
    checked : Checked
    folders : mapping of str to Path
        Where the FMUs are unpacked, by source.
    box : MessageBox
    words : array, optional
        Memory of the exchange; see `Exchange`.
    watch : callable, optional
        Wraps everything that runs code of an FMU; see `Instance`.
    """

    exchanges = Exchange
    """The class of the exchange."""

    def __init__(
        self,
        checked: Checked,
        folders: Mapping[str, Path],
        box: MessageBox,
        words: Floats | None = None,
        watch: Watch | None = None,
    ) -> None:
        self.checked, self.folders, self.box = checked, folders, box
        self.instances: dict[str, Instance] = {}
        self.exchange = self.exchanges(checked, self.instances, box, words)
        self._watch = watch
        self._events: Events | None = None
        self._stepper: Stepper | None = None
        self._kept: list[list[tuple[Instance, c_void_p]]] = []

    def load(self) -> None:
        """Load the libraries and create the instances."""
        corrupt: set[str] = set()
        own_steps = any(component.step is not None for component in self.checked.system.components)
        continuous = self.checked.how.continuous
        for name, description in self.checked.descriptions.items():
            folder = self.folders[description.source]
            kind = class_of(description)
            instance = self.instances[name] = kind(name, description, folder, self.box, corrupt, self._watch)
            instance.event_mode = description.event_mode and not continuous and not own_steps
            instance.updates = description.updates_inputs and continuous
            with InterruptGuard():  # which units written in Python would turn into an error
                self._instantiate(instance)

    def _instantiate(self, instance: Instance) -> None:
        """Create an instance; without event mode where it declares that and refuses it."""
        try:
            instance.instantiate()
        except CosimError as error:
            clocked = any(v.clock is not None for v in instance.description.variables.values())
            if clocked or not instance.event_mode:
                raise
            self.box.pending.clear()
            instance.event_mode = False
            instance.instantiate()
            text = f"{instance.name}: declares event mode (hasEventMode) and refuses it, runs without: {error.reason}"
            self.box.pending.append(LogMessage("", self.box.time, "note", "", text))

    def initialize(self, begin: float, end: float, tolerance: float | None, convergence: float = CONVERGENCE) -> None:
        """Take all through initialization; leaves the outputs at `begin` in the exchange."""
        self.box.time = begin
        with InterruptGuard():
            for name, instance in self.instances.items():
                instance.prepare(tolerance, begin, end, list(self.checked.starts.get(name, ())))
            for instance in self.instances.values():
                instance.enter_initialization()
            self.exchange.initialize(begin, convergence)
            for instance in self.instances.values():
                instance.exit_initialization()
            self.exchange.read_outputs()
            if any(instance.event_mode for instance in self.instances.values()):
                self._events = Events(self.exchange, begin)
        self.box.flush()

    def couple(
        self, adaptive: float | None, convergence: float | None, span: float, record: Sequence[str] | None
    ) -> Stepper:
        """Return their stepper, by the algorithm of `checked`; for parameters see `simulate`."""
        make = self.checked.how.load()
        stepper = make(Coupling(self.exchange, self.box, self._events, convergence, adaptive, span))
        self._stepper = stepper
        return stepper

    def bring_inputs(self, time: float) -> None:
        """Set all inputs to the values of the outputs that feed them."""
        self.exchange.feed(time)
        for bank in self.exchange.banks:
            gather = bank.gather(slice(0, bank.inputs.size))
            if gather is not None:
                gather()
            for instance in self.instances.values():
                instance.run(bank.calls(instance, "Set"))

    def keep(self, names: Sequence[str]) -> None:
        """Keep the states that components have now, for `look`."""
        self._kept.append([(self.instances[name], self.instances[name].saved_state()) for name in names])

    def look(
        self, steps: Mapping[str, float], times: Sequence[float], end: float
    ) -> list[dict[str, list[list[float]]]]:
        """Return the numbers of components in the states that were kept at `times` [s], and after one more step.

        Parameters
        ----------
        steps : mapping of str to float
            Length of the step [s] by component; none is done for 0, and none beyond `end` [s].
        """
        found: list[dict[str, list[list[float]]]] = []
        read = {name: reader(self.instances[name]) for name in steps}
        for time, kept in zip(times, self._kept, strict=True):
            found.append({})
            for instance, state in kept:
                instance.restore_state(state)
                instance.free_state(state)
                listed = found[-1][instance.name] = [read[instance.name]()]
                size, instance.line = steps[instance.name], lambda time: None  # inputs hold
                if size and instance.integrator is None and time + size <= end:
                    instance.run([instance.step_call(c_double(time), c_double(size))])
                    listed.append(read[instance.name]())
        self._kept.clear()
        return found

    def reset(self) -> None:
        """Return all to their state after loading."""
        stepper, self._stepper, self._events = self._stepper, None, None
        with InterruptGuard():
            if stepper is not None:
                stepper.free()
            for instance in self.instances.values():
                instance.reset()
        self.exchange.checked = self.checked
        for bank in self.exchange.banks:
            bank.memory[:] = b"" if bank.kind in TEXTS else 0
        self.box.flush()

    def close(self) -> CosimError | None:
        """Terminate and free them all; return the first failure. The others become messages."""
        failures: list[CosimError] = []
        try:
            if self._stepper is not None:
                self._stepper.free()
        except CosimError as error:
            failures.append(error)
        failures += [error for error in [instance.close() for instance in self.instances.values()] if error is not None]
        for error in failures[1:]:
            self.box.pending.append(failure_message(error))
        self.box.flush()
        return failures[0] if failures else None


def failure_message(error: CosimError) -> LogMessage:
    """Return a failure as a message."""
    return LogMessage("", error.time, "error", "", str(error))
