"""The library of an FMU: fmpy's instance, calls by its methods with FMI's names, and failures."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from fmpy.fmi1 import FMICallException

from vdfmu.base.errors import SHORTEST_STEP, CosimError, FailureKind
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.messages import STATUS, LogMessage, MessageBox, taken_error

Watch = Callable[[str, str, Any], Any]
"""Wraps a function so that it notes the component and the call before it runs."""
_tokens = itertools.count(1)
_LOADING = threading.Lock()
"""Lock held while fmpy loads a library, because it changes the process's working folder for all threads."""


def status_of(function: Callable[..., int], *arguments: Any) -> int:
    """Return the status of a call through fmpy, which raises an exception for statuses above warning."""
    try:
        return function(*arguments)
    except FMICallException as error:
        return error.status


class Library:
    """The functions of an FMU that is unpacked in `folder`.

    `fmu` is fmpy's instance. Its methods with FMI's names receive arguments that are prepared once. After a fatal error
    no instance of the same FMU is called again, not even to free it (FMI 2.0, table of statuses). `corrupt`, shared by
    the units of a run, contains the sources of such FMUs. `watch` wraps everything that runs the FMU's code: its
    functions and the loading.
    """

    kinds: tuple[Any, Any]
    """fmpy's classes for co-simulation and for model exchange."""
    prefix = ""
    """Prefix of the functions."""

    def __init__(
        self,
        name: str,
        description: Description,
        folder: Path,
        box: MessageBox,
        corrupt: set[str],
        watch: Watch | None = None,
    ) -> None:
        self.name, self.description, self.folder, self.box = name, description, folder, box
        self.stage = "loaded"
        self._corrupt = corrupt
        self.token = next(_tokens)
        self.python = (folder / "resources" / "slavemodule.txt").is_file()
        load = partial(
            self.kinds[description.exchange],
            guid=description.guid,
            modelIdentifier=description.identifier,
            unzipDirectory=str(folder),
            instanceName=name,
        )
        try:
            self.fmu = _loaded(watch(name, "load", load) if watch else load)
        except Exception as error:  # fmpy raises bare exceptions
            lacks = f"the library lacks a function of FMI {description.version.name}: "
            reason = f"{lacks if isinstance(error, AttributeError) else ''}{error.__context__ or error}"
            raise CosimError(name, "load", box.time, reason) from None
        self.mend(self.fmu)
        if watch:
            watch_calls(self.fmu, name, self.prefix, watch)

    @staticmethod
    def mend(fmu: Any) -> None:
        """Fix functions that fmpy declares wrongly."""

    def let_go(self) -> None:
        """Release the references that a Python FMU's library holds to the data of its instances.

        Otherwise pythonfmu 0.7.0 releases the data, already freed, when the library is unloaded or the process ends.
        """
        with suppress(AttributeError):  # another wrapper
            self.fmu.dll.finalizePythonInterpreter()

    def symbol(self, name: str) -> str:
        """Return the name in the library of an FMI function, given without its prefix."""
        return self.prefix + name

    def function(self, name: str) -> Any:
        """Return fmpy's method for an FMI function, given without its prefix; the method accepts ctypes arguments."""
        return getattr(self.fmu, self.prefix + name)

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function with ctypes arguments; CosimError if its status is above warning."""
        self.run([(self.function(name), (self.fmu.component, *arguments), name)])

    def run(self, calls: Sequence[Call]) -> None:
        """Make calls one after the other."""
        for function, arguments, name in calls:
            try:
                status = function(*arguments)
            except FMICallException as error:
                status = error.status
            if status:
                self.judge(status, name)

    def judge(self, status: int, call: str) -> None:
        """Accept a warning, or a step with which the unit ends the simulation; else raise CosimError."""
        if status == 1 or (status == 2 and call == "doStep" and self.has_ended()):
            return
        version = self.description.version.name
        label = STATUS[status] if 0 <= status < len(STATUS) else f"{status}, not of FMI {version}"
        self.stage = "failed" if self.stage != "initialized" or status != 2 else self.stage
        if status == 4:
            self._corrupt.add(self.description.source)
        reason = "asynchronous steps are not supported" if status == 5 else self._reason()
        kind = FailureKind.SOLVER if SHORTEST_STEP in reason else FailureKind.COMPONENT
        call = call[0].lower() + call[1:]
        raise CosimError(self.name, call, self.box.time, f"{reason.removesuffix('.')} (status {label})", kind=kind)

    def _reason(self) -> str:
        error = taken_error() if self.python else None
        if error is None:
            return self.box.reason(self.name)
        for text in (*error.logged, error.trace):
            self.box.add(LogMessage(self.name, self.box.time, "fatal", "", text))
        return f"{error.reason}; it logged: {' '.join(error.logged)}" if error.logged else error.reason

    def has_ended(self) -> bool:
        """Return whether the unit has discarded a step to end the simulation; sets `MessageBox.ended`."""
        return False

    @property
    def dead(self) -> bool:
        """Return whether the FMU has had a fatal error."""
        return self.description.source in self._corrupt


def watch_calls(fmu: Any, name: str, prefix: str, watch: Watch) -> None:
    """Wrap the functions of the component's instance of fmpy, so that all of its methods use the wrapped ones."""
    for each in dir(fmu):
        if each.startswith(prefix) or each == "freeLibrary":
            call = each.removeprefix(prefix)
            setattr(fmu, each, watch(name, call[0].lower() + call[1:], getattr(fmu, each)))


def _loaded(load: Callable[[], Any]) -> Any:
    """Return fmpy's instance of an FMU."""
    with _LOADING:
        here = os.getcwd()
        try:
            return load()
        finally:
            os.chdir(here)  # fmpy does not leave the folder of a library that it cannot load
