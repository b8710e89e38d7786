"""The library of an FMU: loading, calls through fmpy's instance, and failures.

fmpy's loading changes the working directory of the process for all threads. It also looks up all functions of the
standard for each instance. Here a function is looked up at its first call.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from ctypes import CDLL, c_int
from functools import cache, partial
from inspect import signature
from pathlib import Path
from types import UnionType
from typing import Any, get_args

import fmpy
from fmpy.fmi1 import _FMU  # pyright: ignore[reportPrivateUsage]

from vdfmu.base.errors import SHORTEST_STEP, CosimError, FailureKind
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description, library_name
from vdfmu.engine.fmu.messages import STATUS, LogMessage, MessageBox, taken_error

Watch = Callable[[str, str, Any], Any]
"""Wraps a function to note component and call before it runs."""
_tokens = itertools.count(1)


class Library:
    """The functions of an FMU, unpacked in `folder`.

    `fmu`, fmpy's instance, makes calls that occur once or at events. Values, steps, and the states and derivatives of
    model exchange use functions with arguments that are prepared once. After a fatal error no instance of the same FMU
    is called again, not even to free it (FMI 2.0, table of statuses). `corrupt`, shared by the units of a run, has the
    sources of such FMUs. `watch` wraps everything that runs code of the FMU: its functions and the loading.
    """

    kinds: tuple[type[_FMU], type[_FMU]]
    """Classes of fmpy for co-simulation and for model exchange."""
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
        self._functions: dict[str, Any] = {}
        self.token = next(_tokens)
        self._watch = watch or (lambda unit, call, function: function)
        try:
            path = str(folder / library_name(description.identifier, description.version))
            self._library: CDLL = self._watch(name, "load", CDLL)(path)
        except OSError as error:
            raise CosimError(name, "load", box.time, str(error)) from None
        self.python = (folder / "resources" / "slavemodule.txt").is_file()
        self._kind = self.kinds[description.exchange]
        self.fmu: Any = self._kind.__new__(self._kind)
        free = self._watch(name, "freeLibrary", fmpy.freeLibrary)
        vars(self.fmu).update(
            guid=description.guid, unzipDirectory=str(folder), instanceName=name, component=None,
            _call=self._judged, freeLibrary=partial(free, self._library._handle),
        )  # fmt: skip
        self.argument: Any = None
        """The instance as an argument, prepared once."""

    def let_go(self) -> None:
        """Make the library of a Python FMU give up its share in what its instances hold.

        pythonfmu 0.7.0 counts that down when the library is unloaded or the process ends, after it has been freed.
        """
        with suppress(AttributeError):  # another wrapper
            self._library.finalizePythonInterpreter()

    def _symbol(self, name: str) -> str:
        return name

    def _look_up(self, name: str, arguments: list[Any] | None, result: Any) -> Any:
        """Return an FMI function as a ctypes object; CosimError if the library lacks it."""
        call, symbol = name[4].lower() + name[5:], self._symbol(name)
        try:
            function: Any = self._library[symbol]
        except AttributeError:
            raise CosimError(self.name, call, self.box.time, f"the library has no function {symbol}") from None
        function.argtypes, function.restype = arguments, result
        return self._watch(self.name, call, function)

    def _judged(self, name: str, *values: Any) -> Any:
        """Call a function for fmpy; CosimError with the unit's reason instead of fmpy's error."""
        if name not in self._functions:
            self._functions[name] = self._look_up(name, *_types(self._kind, name))
        returned = self._functions[name](*values)
        if "Instantiate" in name:
            if not returned:
                self.stage = "failed"
                raise CosimError(self.name, "instantiate", self.box.time, self._reason())
        elif returned:
            self.judge(returned, name[4:])
        return returned

    def function(self, name: str) -> Any:
        """Return an FMI function by its name without prefix; it takes ctypes arguments."""
        if name not in self._functions:
            self._functions[name] = self._look_up(self.prefix + name, None, c_int)
        return self._functions[name]

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function with ctypes arguments; CosimError when its status is above warning."""
        self.run([(self.function(name), (self.argument, *arguments), name)])

    def run(self, calls: Sequence[Call]) -> None:
        """Make calls one after the other."""
        for function, arguments, name in calls:
            status = function(*arguments)
            if status:
                self.judge(status, name)

    def judge(self, status: int, call: str) -> None:
        """Accept a warning, or a step that ends the simulation on request of the unit; else raise CosimError."""
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
        raise CosimError(self.name, call, self.box.time, f"{reason} (status {label})", kind=kind)

    def _reason(self) -> str:
        error = taken_error() if self.python else None
        if error is None:
            return self.box.reason(self.name)
        for text in (*error.logged, error.trace):
            self.box.add(LogMessage(self.name, self.box.time, "fatal", "", text))
        return f"{error.reason}; it logged: {' '.join(error.logged)}" if error.logged else error.reason

    def has_ended(self) -> bool:
        """Whether the unit has discarded a step to end the simulation; sets `MessageBox.ended`."""
        return False

    @property
    def dead(self) -> bool:
        """Whether the FMU has had a fatal error."""
        return self.description.source in self._corrupt


@cache
def _types(kind: type[_FMU], name: str) -> tuple[list[Any], Any]:
    """Return the types of the arguments and of the result of a function, as fmpy declares them."""
    declared = signature(getattr(kind, name))
    types = [p.annotation for p in declared.parameters.values()][1:]
    result = declared.return_annotation
    return [get_args(t)[0] if isinstance(t, UnionType) else t for t in types], c_int if result is int else result
