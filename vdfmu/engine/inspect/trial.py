"""The part of a check that runs foreign code: ten steps and the reference results, in a process of their own."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import fmpy
import numpy as np
import numpy.typing as npt
from fmpy import fmi2
from fmpy.fmi1 import FMICallException

from vdfmu.base.errors import StorageError, VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.interrupt import listening
from vdfmu.base.process import Listener, end_group, limit, started
from vdfmu.engine.algorithms import DELAYED
from vdfmu.engine.inspect.abilities import try_abilities
from vdfmu.engine.inspect.reference import compare
from vdfmu.engine.package.limits import package_limit, unpack_limit
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.rules import Finding, Findings, finding

STEPS = 10
SECONDS = 60.0
"""Time that the short run may take, including the start of Python and the preparation of the unit."""
NAMING = 10.0
"""Last part of it [s]: a call of a package's component must end before, so that the component can be named."""
MEMORY = 4 * 2**30
"""Address space that the process may have [byte], on Linux; Python and fmpy take 0.3 GiB of it."""
FILE_SIZE = 2**30
"""Largest file that it may write [byte], on Linux and macOS."""
_PATIENCE = 2.0
"""Time [s] that it has, after the time limit or Ctrl-C, to end isolated components."""
_ANSWER_LIMIT = 16 * 2**20
"""Largest text of findings that is read [byte]."""
_ANSWER = "findings.json"
_PHASE = "phase.txt"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_FULL_NOTICE = "vdfmu: no space left in the temporary folder"
"""Last line of the error output of a process that could not write."""
_MOST = 20
"""Most messages of a unit that are kept, from the first."""
_TEXT = 1000
"""Most characters of one of them."""


def run_apart(
    path: Path, kind: str = "FMU", module: str = "vdfmu.engine.inspect.trial", task: str = f"a run of {STEPS} steps"
) -> Findings:
    """Run code of a file in another process, which it may crash or never leave: an FMU or a package for ten steps.

    `kind` is ``FMU``, or ``SSP`` for a package, whatever the name of the file ends with; `module` runs there and calls
    :func:`serve`, `task` is its work in messages. StorageError if the temporary folder is full.
    """
    findings = Findings(ran=True)
    with temporary_folder("vdfmu_check_") as folder:
        try:
            deadline = str(monotonic() + SECONDS - NAMING)
            code, words = _contained(module, kind, str(path.resolve()), deadline, folder, str(unpack_limit()), task)
        except OSError as error:
            return Findings([finding("RUN001", f"{task} could not be tried: {error}")])
        noted = Path(folder, _PHASE)
        phase = noted.read_text(encoding="utf-8") if noted.is_file() else "the start of the process"
        answer = Path(folder, _ANSWER)
        answered = False
        try:
            if answer.stat().st_size > _ANSWER_LIMIT:
                raise ValueError(f"they have more than {_ANSWER_LIMIT} bytes")
            values = json.loads(answer.read_text(encoding="utf-8"))
            findings.add(_decoded(values))
            answered = bool(values["whole"])
        except FileNotFoundError:
            pass
        except (ValueError, TypeError, KeyError) as error:  # cut off, or written by the unit
            findings.problem("RUN002", f"the findings of {task} cannot be read: {error}")
            answered = True
    if code is None:
        findings.problem("RUN002", f"{phase} did not end within {SECONDS:g} s")
        return findings
    last = words.strip().splitlines()[-1:]
    if code and last == [_FULL_NOTICE]:
        raise StorageError(
            f"{path.name}: the run needs a temporary folder, and {tempfile.gettempdir()} is full; "
            "free space there, or name another folder in TMPDIR"
        )
    if code:
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        findings.problem("RUN002", f"the process crashed ({how}) in {phase}{''.join(f': {s}' for s in last)}")
    elif not answered:
        findings.problem("RUN002", f"the unit ended the process in {phase}")
    return findings


def _encoded(findings: Findings, whole: bool) -> dict[str, Any]:
    """Return findings as JSON holds them: rules by their numbers, and whether more were to follow."""
    pairs = {
        key: [(each.rule.number, each, each.file, each.line) for each in listed]
        for key, listed in (("problems", findings.problems), ("notes", findings.notes))
    }
    return {**pairs, "compared": findings.compared, "ran": findings.ran, "whole": whole}


def _decoded(values: Any) -> Findings:
    """Return the findings of :func:`_encoded`; ValueError, TypeError or KeyError for anything else."""
    problems, notes = (
        [finding(rule, text, (str(file), int(line))) for rule, text, file, line in values[key]]
        for key in ("problems", "notes")
    )
    return Findings([*problems], [*notes], [str(name) for name in values["compared"]], bool(values["ran"]))


def _contained(module: str, *arguments: str) -> tuple[int | None, str]:
    """Run a module in a process that may do anything, and whose children end with it.

    Returns its exit code, None if it did not end in time, and the end of its error output.
    """
    process = started(module, *arguments, talks=False)
    assert process.stderr is not None
    listener = Listener(process.stderr)
    try:
        code = process.wait(SECONDS)
    except subprocess.TimeoutExpired:
        code = None
    finally:
        end_group(process, _PATIENCE)
        process.wait()
    return code, listener.finish()


class _Said:
    """The first messages of a unit that are worse than a warning: a logger for FMPy."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def __call__(self, *given: Any) -> None:
        """Keep a message; before its status FMI 3.0 has one argument, FMI 1.0 and 2.0 have two."""
        status, _, message = given[-3:]
        if status not in (0, 1) and len(self.messages) <= _MOST:
            text = message if isinstance(message, str) else message.decode(errors="replace")
            text = text if len(text) <= _TEXT else f"{text[:_TEXT]} ... ({len(text) - _TEXT} characters more)"
            self.messages.append(text if len(self.messages) < _MOST else f"more than {_MOST} messages")

    def with_error(self, error: Exception) -> str:
        """Return its messages before an error, and the error, as one text."""
        return "; ".join([*self.messages, str(error)])

    def stay(self) -> None:
        """Take messages of FMI 1.0 and 2.0 from now on.

        FMPy has one place for all loggers of the process. The logger of its last simulation stays there after its
        memory has been freed.
        """
        fmi2.defaultCallbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self)
        with contextlib.suppress(ImportError, OSError):  # as FMPy: there is a library for some platforms
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(ctypes.byref(fmi2.defaultCallbacks))


def _refuse_negative(call: str) -> None:
    """Raise for a call, as fmpy logs it, that returned a status below 0. fmpy takes such a status for success."""
    if match := re.fullmatch(r"(\w+)\(.*\) -> (-\d+)", call, re.DOTALL):
        raise FMICallException(function=match[1], status=int(match[2]))


def _run_unit(path: Path, phase: Callable[..., None]) -> Findings:
    """Make ten steps of an FMU, compare with the reference results that it carries, try what else it declares."""
    said = _Said()
    description = fmpy.read_model_description(str(path), validate=False)
    if description.coSimulation is None and description.modelExchange is None:
        return Findings(notes=[finding("RUN006", "not run: it has neither co-simulation nor model exchange")])
    experiment = description.defaultExperiment
    start = float(experiment.startTime) if experiment and experiment.startTime else 0.0
    step = float(experiment.stepSize) if experiment and experiment.stepSize else 1e-3
    try:
        results = fmpy.simulate_fmu(
            str(path),
            validate=False,  # its problems are already known
            start_time=start,
            stop_time=start + STEPS * step,
            output_interval=step,
            logger=said,
            fmi_call_logger=_refuse_negative,
            debug_logging=True,
            remote_platform=None,  # pyright: ignore[reportArgumentType]  # None: never another process
        )
    except Exception as error:  # whatever a foreign unit does, it is reported
        if isinstance(error, OSError) and error.errno in _FULL:
            raise
        return Findings([finding("RUN001", f"{STEPS} steps of {step:g} s failed: {said.with_error(error)}")])
    said.stay()
    if said.messages:
        given = f"{STEPS} steps of {step:g} s gave"
        return Findings([finding("RUN001", f"{given}: {message}") for message in said.messages])
    findings = Findings()
    kind = description.coSimulation or description.modelExchange
    if kind is not None and kind.canBeInstantiatedOnlyOncePerProcess:
        findings.note("RUN004", "reference results not compared: the unit can be instantiated only once per process")
    else:
        phase("the comparison with the reference results")
        findings = compare(path)
    findings.notes += [] if results is True else _not_finite(results)
    if not str(description.fmiVersion).startswith("1"):
        phase("the calls that it declares", findings)
        findings.add(try_abilities(path, start, step))
    return findings


def _not_finite(results: npt.NDArray[Any]) -> list[Finding]:
    """Return a note on each signal of a run that is not finite all the time, with its first time."""
    notes: list[Finding] = []
    for name in (results.dtype.names or ())[1:]:
        rows = results[name].reshape(len(results), -1)
        bad = np.argwhere(~np.isfinite(rows)) if rows.dtype.kind == "f" else np.empty((0, 2), int)
        for row, column in bad[:1]:
            text = f"{name} is {rows[row, column]} at t = {results['time'][row]:.9g} s, inputs at their start values; "
            notes.append(finding("RUN005", f"{text}a co-simulation that reads or records it ends there"))
    return notes


def master_of(system: FlatSystem) -> str:
    """Return the master algorithm of a system, else the one that steps any system, even with loops."""
    return system.experiment.algorithm or DELAYED


def _run_system(path: Path, deadline: float) -> Findings:
    """Make ten steps of a system; at `deadline`, of `monotonic`, a call that began with the run is ended."""
    from vdfmu.engine.run.simulator import simulate  # an FMU alone needs no master

    system = load_ssp(path)
    experiment = system.experiment
    start = experiment.start or 0.0
    steps = [component.step for component in system.components if component.step is not None]
    step = experiment.step or min(steps, default=1e-3)
    count = STEPS
    if experiment.stop is not None and not steps:
        # fewer steps, not shorter ones: periods of samples fit the step
        step = min(step, experiment.stop - start)
        count = min(STEPS, int((experiment.stop - start) / step + 1e-6))
    try:
        with listening(signal.SIGTERM):  # the time limit, or Ctrl-C: the components are in another session
            simulate(
                system, start=start, stop=start + count * step, step=step, algorithm=master_of(system),
                ignore_unmatched=True, log=lambda message: None, isolate=True,
                wait_limit=max(1.0, round(deadline - monotonic(), 1)),
            )  # fmt: skip
    except (VdfmuError, OSError) as error:
        if isinstance(error, OSError) and error.errno in _FULL:
            raise
        return Findings([finding("RUN001", f"{count} steps of {step:g} s failed: {error}")])
    return Findings()


def _open(stream: Any) -> bool:
    """Whether the file of a stream of the process is still open."""
    try:
        os.fstat(stream.fileno())
    except OSError:
        return False
    return True


def serve(
    check: Callable[[str, Path, float, Callable[..., None]], Findings],
    kind: str,
    path: str,
    deadline: str,
    folder: str,
    unpacked: str,
    task: str,
) -> None:
    """Check in this process, which `run_apart` has started with these arguments, and leave the findings for it.

    `check` takes the kind, the path, the time of `monotonic` by which a call is ended, and a function that notes what
    is under way.
    """
    tempfile.tempdir = folder  # files that a crash leaves there are removed with the folder

    def phase(what: str, findings: Findings | None = None) -> None:
        """Report the next task, and the findings so far."""
        if findings is not None:
            answer(findings, whole=False)
        Path(folder, _PHASE).write_text(what, encoding="utf-8")

    def answer(findings: Findings, whole: bool) -> None:
        Path(folder, _ANSWER).write_text(json.dumps(_encoded(findings, whole)), encoding="utf-8")

    try:
        for what, size in (("AS", MEMORY), ("FSIZE", FILE_SIZE), ("CORE", 0)):
            limit(what, size)
        phase(task)
        with package_limit(int(unpacked)):
            findings = check(kind, Path(path), float(deadline), phase)
        if not _open(sys.__stderr__):
            findings.problem("RUN002", "the unit closed files of the process that are not its own")
        answer(findings, whole=True)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        sys.exit(_FULL_NOTICE)


def _check(kind: str, path: Path, deadline: float, phase: Callable[..., None]) -> Findings:
    return _run_system(path, deadline) if kind == "SSP" else _run_unit(path, phase)


if __name__ == "__main__":
    serve(_check, *sys.argv[1:])
