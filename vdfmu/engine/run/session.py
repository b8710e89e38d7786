"""The components of one system: unpacked, loaded, stepped, reset, freed; and a handler for calls of C's ``exit``."""

from __future__ import annotations

import ctypes
import inspect
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import fmpy

from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.engine.fmu.description import is_ours
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.components import Components, failure_message
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.isolated import Elsewhere, Isolated, Limits, Making


class Session:
    """The components of a system for runs in a row; its exit frees them and removes the unpacked FMUs.

    For `isolate` and `limits` see `simulate`; `apart`, if given, replaces `Isolated`.
    """

    components: Components | Elsewhere
    stepper: Stepper

    def __init__(
        self, checked: Checked, log: Callable[[LogMessage], None] | None, isolate: bool | None, limits: Limits,
        apart: Making | None = None,
    ) -> None:  # fmt: skip
        self.checked, self.box, self._limits = checked, MessageBox(log), limits
        self.isolated = isolate if apart is None else True
        self.results: Results | None = None
        """Results of the last run."""
        self.save: Callable[[], str] = lambda: ""
        """Saves the rows of the current run; returns a text about them."""
        self._apart = apart or Isolated
        self._stack = ExitStack()

    def __enter__(self) -> Session:
        try:
            folder = Path(self._stack.enter_context(temporary_folder("vdfmu-")))
        except OSError as error:
            raise no_room(tempfile.gettempdir(), error) from error
        for note in self.checked.notes:
            self.box.pending.append(LogMessage("", 0.0, "note", "", note))
        self.box.flush()
        try:
            folders, isolated = unpack_units(self.checked, folder)
            self.isolated = isolated if self.isolated is None else self.isolated
            if self.isolated:
                self.components = self._apart(self.checked, folders, self.box, folder, self._limits)
            else:
                self._stack.enter_context(report_exits(self.box, lambda: self._left(folder)))
                self.components = Components(self.checked, folders, self.box)
            self.components.load()
        except BaseException as error:
            self.__exit__(type(error), error)
            raise
        self.exchange = self.components.exchange
        return self

    def _left(self, folder: Path) -> str:
        """Save the rows of a process that a component ends; return a text about them."""
        shutil.rmtree(folder, ignore_errors=True)
        return self.save()

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        if self.results is not None:
            self.box.time = float(self.results.time[-1])
        failure = None
        try:
            if hasattr(self, "components"):
                failure = self.components.close()
        finally:
            self._stack.close()
            self.save = lambda: ""  # releases the run and the files of its memory
        if failure is not None and error is not None:
            self.box.pending.append(failure_message(failure))
        self.box.flush()
        if self.results is not None:
            self.results.messages = list(self.box.kept)
        if failure is not None and error is None:
            failure.results = self.results
            raise failure

    def reset(self, checked: Checked) -> None:
        """Return components that are not isolated to their state after loading; `checked` has their start values."""
        assert isinstance(self.components, Components)
        self.checked = self.components.checked = checked
        self.box.flush()
        self.box.kept.clear()
        self.box.ended.clear()
        self.results, self.save = None, lambda: ""
        self.components.reset()

    def stepping(self, grid: Grid) -> Callable[[int], None]:
        """Return the function for step k of a run."""
        box, advance = self.box, self.stepper.advance
        begin, end, step, n = grid
        last, rest = n - 1, grid.last

        def one(k: int) -> None:
            box.time = time = begin + k * step
            advance(time, step if k < last else rest, begin + (k + 1) * step if k < last else end)

        return one


def unpack_units(checked: Checked, folder: Path) -> tuple[dict[str, Path], bool]:
    """Unpack the FMUs of a system; return their folders by source, and whether to isolate them by default.

    FMUs without the mark of this project, which can be forged, are isolated. VdfmuError if the disk is full, or if
    Python FMUs cannot run in a folder of this name.
    """
    unpacked: dict[str, Path] = {}
    path, isolated = checked.system.path, False
    with Archive(path, path.name) as package:
        for source in dict.fromkeys(d.source for d in checked.descriptions.values()):
            unpacked[source] = folder / f"{len(unpacked)}"
            try:
                with package.opened(source, source) as unit:
                    isolated = isolated or not is_ours(unit.names)
                    unit.extract(unpacked[source], _needed)
            except OSError as error:
                raise no_room(str(folder), error) from error
            _refuse_escapes(unpacked[source])
    return unpacked, isolated


def _refuse_escapes(folder: Path) -> None:
    """Raise if a Python FMU would crash the process: its wrapper decodes no URI escapes except of spaces."""
    uri = folder.as_uri()
    if (folder / "resources" / "slavemodule.txt").is_file() and "%" in uri.replace("%20", " "):
        raise VdfmuError(
            f"{folder}: the folder of Python FMUs must be ASCII letters, digits and spaces only. Choose another folder "
            "for temporary files with TMPDIR."
        )


def no_room(folder: str, error: OSError) -> VdfmuError:
    """Return the error of FMUs that cannot be unpacked."""
    return VdfmuError(
        f"{folder}: FMUs cannot be unpacked there: {error}. Free space, or choose another folder with TMPDIR."
    )


def _needed(member: str) -> bool:
    """Whether a member of an FMU is needed to run it."""
    places = "resources/", f"binaries/{fmpy.platform}/", f"binaries/{fmpy.platform_tuple}/"
    return member == "modelDescription.xml" or member.startswith(places)


@contextmanager
def report_exits(box: MessageBox, save: Callable[[], str]) -> Generator[None]:
    """Report a component that ends the process, save the rows, and make the exit code 1; `save` returns a text on them.

    For the C libraries of Linux (glibc) and macOS; no others can remove a handler.
    """
    if platform.libc_ver()[0] != "glibc" and sys.platform != "darwin":
        yield
        return
    process, over = os.getpid(), False

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def at_exit(_: int | None) -> None:
        if over or os.getpid() != process:  # in a process that the component has forked
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
    """Return the names of the components in the local variables of the calls above in this thread."""
    frame = inspect.currentframe()
    while frame is not None:
        values = [(value, getattr(value, "instance", None)) for value in frame.f_locals.values()]
        if names := dict.fromkeys(one.name for pair in values for one in pair if isinstance(one, Instance)):
            return f"component {' or '.join(names)}"
        frame = frame.f_back
    return "a component"
