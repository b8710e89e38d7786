"""The components of one run in this process: unpacking, loading, initialization, coupling, freeing and exits."""

from __future__ import annotations

import ctypes
import inspect
import os
import platform
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from ctypes import c_void_p
from functools import partial
from pathlib import Path
from typing import NamedTuple

import fmpy

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.files import no_temporary
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.algorithms import choice
from vdfmu.engine.fmu.access import TEXTS
from vdfmu.engine.fmu.description import is_own
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.library import Watch
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.fmu.versions import class_of
from vdfmu.engine.masters.broyden import Broyden
from vdfmu.engine.masters.compiled import CompiledSteps, obstacle
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.masters.events import Events, EventStepper
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import MultirateStepper, SampledStepper, Stepper
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.recorder import RowsInMemory

CONVERGENCE = 1e-8
"""Default relative change at which repetitions end."""


def unpack_units(checked: Checked, folder: Path) -> tuple[dict[str, Path], bool]:
    """Unpack the FMUs of a system; return their folders by source, and whether any of them is foreign.

    VdfmuError if the disk is full, or if Python FMUs cannot run in a folder of this name.
    """
    unpacked: dict[str, Path] = {}
    path, foreign = checked.system.path, False
    with Archive(path, path.name) as package:
        for source in dict.fromkeys(d.source for d in checked.descriptions.values()):
            unpacked[source] = folder / f"{len(unpacked)}"
            try:
                with package.opened(source, source) as unit:
                    foreign = foreign or not is_own(unit)
                    unit.extract(unpacked[source], _needed)
            except OSError as error:
                raise no_temporary("FMUs", error) from error
            _refuse_escapes(unpacked[source])
    return unpacked, foreign


def _refuse_escapes(folder: Path) -> None:
    """Raise an error if a Python FMU would crash the process, because its wrapper decodes only spaces in URIs."""
    uri = folder.as_uri()
    if (folder / "resources" / "slavemodule.txt").is_file() and "%" in uri.replace("%20", " "):
        raise VdfmuError(
            f"{folder}: the path of a folder with Python FMUs must have only ASCII letters, digits and spaces. Set "
            "TMPDIR to another folder."
        )


def _needed(member: str) -> bool:
    places = "resources/", f"binaries/{fmpy.platform}/", f"binaries/{fmpy.platform_tuple}/"
    return member == "modelDescription.xml" or member.startswith(places)


class Coupling(NamedTuple):
    """Parts of a stepper; for `convergence` and `error`, which may be None, see :class:`ContinuousStepper`."""

    exchange: Exchange
    box: MessageBox
    events: Events | None
    """Events of FMI 3.0 components in event mode."""
    convergence: float | None
    error: float | None
    span: float
    """Length of the run [s]."""


def held(coupling: Coupling) -> SampledStepper:
    """Return the stepper for inputs that are held over a step."""
    checked = coupling.exchange.checked
    if checked.schedule.groups and (checked.multiples or coupling.events is not None):
        raise UsageError(
            f"{', '.join(checked.schedule.groups[0])}: depend on each other within a step and are integrated together. "
            "Other components of the system must not have their own steps or events of co-simulation. Leave these out, "
            f"or use {choice(repeats=True)}"
        )
    if checked.multiples:
        return MultirateStepper(coupling.exchange, coupling.span)
    if coupling.events is not None:
        return EventStepper(coupling.exchange, coupling.events)
    return SampledStepper(coupling.exchange)


def continuous(coupling: Coupling, solver: Callable[[], Broyden] | None) -> ContinuousStepper:
    """Return the stepper for inputs that ramp over a step; for `solver` see :class:`ContinuousStepper`."""
    exchange, _, _, convergence, error, span = coupling
    convergence = convergence or (CONVERGENCE if error is None else 0.01 * error)
    return ContinuousStepper(exchange, solver=solver, convergence=convergence, error=error, span=span)


extrapolated = partial(continuous, solver=None)
"""Inputs ramp to predicted outputs."""
iterative = partial(continuous, solver=Broyden)
"""Steps are repeated until predicted and computed outputs agree."""


class Components:
    """The components of one run.

    `folders` contain the unpacked FMUs, by source. For `words` see `Exchange`. `watch` wraps all calls of an FMU; see
    `Instance`.
    """

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
        self.exchange = Exchange(checked, self.instances, box, words)
        self._watch = watch
        self._events: Events | None = None
        self._stepper: Stepper | None = None
        self._start: list[tuple[Instance, c_void_p]] = []
        """Saved states at the start."""

    def load(self) -> None:
        """Load the libraries and create the instances."""
        corrupt: set[str] = set()
        own_steps = any(component.step is not None for component in self.checked.system.components)
        continuous, fed = self.checked.how.continuous, {link.end[0] for link in self.checked.links}
        for name, description in self.checked.descriptions.items():
            folder = self.folders[description.source]
            kind = class_of(description.version.name)
            instance = self.instances[name] = kind(name, description, folder, self.box, corrupt, self._watch)
            instance.event_mode = description.event_mode and not continuous and not own_steps
            instance.updates = description.updates_inputs and continuous and name in fed
            with InterruptGuard():  # Python units turn Ctrl-C into an error
                self._instantiate(instance)

    def _instantiate(self, instance: Instance) -> None:
        """Create an instance, without event mode if it declares event mode but rejects it."""
        try:
            instance.instantiate()
        except CosimError as error:
            clocked = any(v.clock is not None for v in instance.description.variables.values())
            if clocked or not instance.event_mode:
                raise
            self.box.pending.clear()
            instance.event_mode = False
            instance.instantiate()
            text = (
                f"{instance.name}: declares event mode (hasEventMode) but rejects it, so runs without: {error.reason}"
            )
            self.box.pending.append(LogMessage("", self.box.time, "note", "", text))

    def initialize(self, begin: float, end: float, tolerance: float | None, convergence: float = CONVERGENCE) -> None:
        """Initialize all components; the exchange then has the outputs at `begin`."""
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
        """Return the stepper of the algorithm in `checked`; for parameters see `simulate`."""
        coupling = Coupling(self.exchange, self.box, self._events, convergence, adaptive, span)
        stepper = self._stepper = self.checked.how.load()(coupling)
        return stepper

    def compiled(self, grid: Grid, keepers: Sequence[RowsInMemory]) -> CompiledSteps | str:
        """Return the steps of a run in C, with the rows of all keepers, or why its steps are made in Python."""
        assert self._stepper is not None
        return obstacle(self._stepper, self.exchange) or CompiledSteps(self._stepper, self.exchange, grid, keepers)

    def bring_inputs(self, time: float) -> None:
        """Set all inputs to the values of the outputs that they are connected to."""
        self.exchange.feed(time)
        for gather in self.exchange.gathers():
            gather()
        for bank in self.exchange.banks:
            for instance in self.instances.values():
                instance.run(bank.calls(instance, "Set"))

    def put(self, name: str, values: Sequence[tuple[str, Value]]) -> None:
        """Set variables of a component."""
        variables = self.checked.descriptions[name].variables
        self.instances[name].set_all([(variables[each], value) for each, value in values])

    def value(self, name: str, variable: str) -> Value:
        """Get a variable of a component."""
        return self.instances[name].get_all([self.checked.descriptions[name].variables[variable]])[0]

    def between_events(self, name: str, variable: str) -> bool:
        """Return whether a variable of a component is set between events."""
        return self.instances[name].between_events(self.checked.descriptions[name].variables[variable])

    def keep_start(self) -> bool:
        """Save the states of all components; return whether they can be restored."""
        # arrays of FMI 3.0 are set as a whole, with elements that the instance remembers
        simple = all(d.saves_state and not d.version.arrays for d in self.checked.descriptions.values())
        if simple and type(self._stepper) is SampledStepper:
            self._start = [(instance, instance.saved_state()) for instance in self.instances.values()]
        return bool(self._start)

    def to_start(self) -> None:
        """Restore the states of `keep_start` in all components."""
        for instance, state in self._start:
            instance.restore_state(state)

    def _free(self) -> None:
        """Free the states saved by the stepper and by `keep_start`."""
        start, self._start = self._start, []
        if self._stepper is not None:
            self._stepper.free()
        for instance, state in start:
            instance.free_state(state)

    def reset(self, checked: Checked) -> None:
        """Reset all components to their state after loading; `checked` has their start values."""
        self.checked, self._events = checked, None
        with InterruptGuard():
            self._free()
            for instance in self.instances.values():
                instance.reset()
        self.exchange.checked = self.checked
        for bank in self.exchange.banks:
            if bank.variables:
                bank.memory[:] = b"" if bank.kind in TEXTS else 0
        self.box.flush()

    def close(self) -> CosimError | None:
        """Terminate and free all components; return the first failure. The others become messages."""
        failure = None
        try:
            self._free()
        except CosimError as error:
            failure = error
        return self._first([failure, *(instance.close() for instance in self.instances.values())])

    def _first(self, each: Iterable[CosimError | None]) -> CosimError | None:
        """Return the first failure; the others become messages."""
        failures = [*filter(None, each)]
        self.box.pending += map(failure_message, failures[1:])
        self.box.flush()
        return failures[0] if failures else None


def failure_message(error: CosimError) -> LogMessage:
    """Return a failure as a message."""
    return LogMessage("", error.time, "error", "", str(error))


@contextmanager
def report_exits(box: MessageBox, save: Callable[[], str], resting: Callable[[], bool]) -> Generator[None]:
    """Report a component that ends the process, save the rows, and exit with code 1; `save` returns a text about them.

    Between runs, when `resting`, no component is to blame.

    Works with the C libraries of Linux (glibc) and macOS, because others cannot remove a handler.
    """
    if platform.libc_ver()[0] != "glibc" and sys.platform != "darwin":
        yield
        return
    process, over = os.getpid(), False

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def at_exit(_: int | None) -> None:
        if over or resting() or os.getpid() != process:  # in a process that the component has forked
            return
        with suppress(BaseException):
            where = save()
            sys.stderr.write(f"error: {_caller()} ended the process at t = {box.time:.9g} s.{where}\n")
            sys.stderr.flush()
        os._exit(1)

    library, key = ctypes.CDLL(None), ctypes.byref(ctypes.c_char())
    library.__cxa_atexit(at_exit, None, key)
    try:
        yield
    finally:
        over = True
        library.__cxa_finalize(key)  # calls and removes the handler


def _caller() -> str:
    """Return the names of components in local variables of the calling functions in this thread."""
    frame = inspect.currentframe()
    while frame is not None:
        values = [(value, getattr(value, "instance", None)) for value in frame.f_locals.values()]
        if names := dict.fromkeys(each.name for pair in values for each in pair if isinstance(each, Instance)):
            return f"component {' or '.join(names)}"
        frame = frame.f_back
    return "a component"
