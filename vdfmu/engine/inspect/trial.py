"""Runs foreign code for a check in another process: ten steps, and the trials of extras."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import mmap
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import fmpy
import numpy as np
import numpy.typing as npt
from fmpy import fmi1, fmi2
from fmpy.fmi1 import FMICallException

from vdfmu.base.errors import VdfmuError
from vdfmu.base.extras import extra_modules
from vdfmu.base.files import no_temporary, read_json, temporary_folder
from vdfmu.base.interrupt import listening
from vdfmu.base.process import Listener, contained, end_group, limit, started
from vdfmu.engine.algorithms import DELAYED
from vdfmu.engine.fmu.library import watch_calls
from vdfmu.engine.fmu.versions import Instance3, class_of
from vdfmu.engine.package.archive import package_limit, unpack_limit
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.rules import Finding, Findings, finding

STEPS = 10
SECONDS = 60.0
"""Time limit of the short run [s], including the start of Python and the preparation of the unit."""
NAMING = 10.0
"""Final part of this time [s] in which no component of a package is called, so that a hanging one can be named."""
MEMORY = 4 * 2**30
"""Limit of the address space of the process [byte], on Linux; Python and fmpy take 0.3 GiB."""
FILE_SIZE = 2**30
"""Limit of its files [byte], on Linux and macOS."""
_PATIENCE = 2.0
"""Time [s] to end isolated components after the time limit or Ctrl-C."""
_ANSWER_LIMIT = 16 * 2**20
"""Size limit for the text of findings [byte]."""
_ANSWER = "findings.json"
_PHASE = "phase.txt"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_FULL_NOTICE = "vdfmu: no space left in the temporary folder"
"""Last line of the error output of a process that ran out of disk space."""
_MOST = 20
"""Largest number of messages of a unit; the first ones are kept."""
_TEXT = 1000
"""Longest message [characters]."""


def run_apart(
    path: Path, kind: str = "FMU", module: str = "vdfmu.engine.inspect.trial", task: str = f"a run of {STEPS} steps"
) -> Findings:
    """Run code of a file in another process, which may crash or hang: ten steps of an FMU or a package.

    `kind` is ``FMU``, or ``SSP`` for a package, whatever the file's name. `module` runs in that process and calls
    :func:`serve`; `task` names its work in messages. StorageError if the temporary folder is full.
    """
    findings = Findings(ran=True)
    with temporary_folder("vdfmu_check_") as folder:
        try:
            deadline = str(monotonic() + SECONDS - NAMING)
            code, output = _contained(module, kind, str(path.resolve()), deadline, folder, str(unpack_limit()), task)
        except OSError as error:
            return Findings([finding("RUN001", f"{task} could not be tried: {error}")])
        noted, answer, answered, whole = Path(folder, _PHASE), Path(folder, _ANSWER), False, False
        phase = "the start of the process"
        if noted.is_file():
            with noted.open("rb") as file:  # the unit may have written it
                phase = file.read(_TEXT).rstrip(b"\0").decode(errors="replace") or phase
        try:
            if answer.is_file() and answer.stat().st_size > _ANSWER_LIMIT:
                raise ValueError(f"they have more than {_ANSWER_LIMIT} bytes")
            if answer.is_file():
                values = read_json(answer)
                findings.add(_decoded(values))
                answered = whole = bool(values["whole"])
        except (ValueError, TypeError, KeyError) as error:  # cut off, or written by the unit
            findings.report("RUN002", f"the findings of {task} cannot be read: {error}")
            answered = True
    if whole:  # a fault at the end of the process is not a finding
        return findings
    if code is None:
        findings.report("RUN002", f"{phase} did not end within {SECONDS:g} s")
        return findings
    last = output.strip().splitlines()[-1:]
    if code and last == [_FULL_NOTICE]:
        raise no_temporary(path.name, os.strerror(errno.ENOSPC))
    if code:
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        findings.report("RUN002", f"the process crashed ({how}) in {phase}{''.join(f': {s}' for s in last)}")
    elif not answered:
        findings.report("RUN002", f"the unit ended the process in {phase}")
    return findings


def _encoded(findings: Findings, whole: bool) -> dict[str, Any]:
    """Return findings for JSON, with rules by number; `whole` if no others follow."""
    entries = [(each.rule.number, each, each.file, each.line) for each in findings.entries]
    return {"entries": entries, "compared": findings.compared, "ran": findings.ran, "whole": whole}


def _decoded(values: Any) -> Findings:
    """Return the findings of :func:`_encoded`; ValueError, TypeError or KeyError for anything else."""
    entries = [finding(rule, text, (str(file), int(line))) for rule, text, file, line in values["entries"]]
    return Findings(entries, [str(name) for name in values["compared"]], bool(values["ran"]))


def _contained(module: str, *arguments: str) -> tuple[int | None, str]:
    """Run a module in a process group; return its exit code, None after the time limit, and its last error output."""
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
    """Logger for FMPy that keeps the first messages of a unit with a status above warning."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def __call__(self, *arguments: Any) -> None:
        """Keep a message. Its status is the second argument in FMI 3.0, and the third in FMI 1.0 and 2.0."""
        status, _, message = arguments[-3:]
        if status not in (0, 1) and len(self.messages) <= _MOST:
            text = message if isinstance(message, str) else message.decode(errors="replace")
            text = text if len(text) <= _TEXT else f"{text[:_TEXT]} ... ({len(text) - _TEXT} characters more)"
            self.messages.append(text if len(self.messages) < _MOST else f"more than {_MOST} messages")

    def stay(self) -> None:
        """From now on receive the messages of FMI 1.0 and 2.0 through FMPy's default callbacks."""
        fmi1.defaultCallbacks.logger = fmi1.fmi1CallbackLoggerTYPE(self)
        fmi2.defaultCallbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self)
        with contextlib.suppress(ImportError, OSError):  # as in FMPy: the library exists for some platforms
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(ctypes.byref(fmi1.defaultCallbacks))
            addLoggerProxy(ctypes.byref(fmi2.defaultCallbacks))


class Phase:
    """Notes this process's task and current call of a unit, for the process that reports a crash.

    `report` accepts the findings so far. The file stays mapped, because a unit may close files.
    """

    def __init__(self, path: Path, report: Callable[[Findings], None]) -> None:
        self._report, self._task = report, ""
        path.write_bytes(bytes(_TEXT))
        with path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), _TEXT)

    def __call__(self, task: str, findings: Findings | None = None) -> None:
        """Note the next task, and report the findings so far."""
        if findings is not None:
            self._report(findings)
        self._task = task
        self._note(task)

    def _note(self, text: str) -> None:
        self._memory[:] = text.encode(errors="replace")[:_TEXT].ljust(_TEXT, b"\0")

    def watch(self, unit: str, call: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of a unit, wrapped so that it is noted while it runs."""

        def watched(*arguments: Any) -> Any:
            self._note(f"{call} in the test of {self._task}")
            try:
                return function(*arguments)
            finally:
                self._note(self._task)

        return watched


def _refuse_negative(call: str) -> None:
    """Raise an error for a logged call with a status below 0, which fmpy accepts."""
    if match := re.fullmatch(r"(\w+)\(.*\) -> (-\d+)", call, re.DOTALL):
        raise FMICallException(function=match[1], status=int(match[2]))


def _run_unit(path: Path, phase: Phase) -> Findings:
    """Make ten steps of an FMU, and the trials that extras add, for example of reference results and declared calls."""
    said = _Said()
    description = fmpy.read_model_description(str(path), validate=False)
    part = description.coSimulation or description.modelExchange
    if part is None:
        return Findings([finding("RUN006", "not run: it has neither co-simulation nor model exchange")])
    experiment = description.defaultExperiment
    start = float(experiment.startTime) if experiment and experiment.startTime else 0.0
    step = float(experiment.stepSize) if experiment and experiment.stepSize else 1e-3
    try:
        folder, kind = fmpy.extract(str(path)), class_of(str(description.fmiVersion))
        load = partial(
            kind.kinds[description.coSimulation is None],
            guid=description.guid,
            modelIdentifier=part.modelIdentifier,
            unzipDirectory=folder,
            fmiCallLogger=_refuse_negative,
        )
        fmu = phase.watch("", "load", load)()
        kind.mend(fmu)
        watch_calls(fmu, "", kind.prefix, phase.watch)
        said.stay()
        fmu.instantiate(loggingOn=True, **({"logMessage": said} if kind is Instance3 else {}))
        results = fmpy.simulate_fmu(  # without validation, which the check has done
            folder,
            validate=False,
            start_time=start,
            stop_time=start + STEPS * step,
            output_interval=step,
            model_description=description,
            fmu_instance=fmu,
        )
        fmu.freeInstance()
    except Exception as error:  # of a foreign unit, so of any kind
        _raise_if_full(error)
        text = f"{STEPS} steps of {step:g} s failed: {'; '.join([*said.messages, str(error)])}"
        return Findings([finding("RUN001", text)])
    if said.messages:
        return Findings([finding("RUN001", f"{STEPS} steps of {step:g} s gave: {text}") for text in said.messages])
    findings = Findings([] if results is True else _not_finite(results))
    for module in extra_modules("trials"):
        for task, attempt in module.TRIALS.items():
            phase(task, findings)
            findings.add(attempt(path, start, step, phase.watch))
    return findings


def _not_finite(results: npt.NDArray[Any]) -> list[Finding]:
    """Return a note on each signal of a run with values that are not finite, with the first such time."""
    notes: list[Finding] = []
    for name in (results.dtype.names or ())[1:]:
        rows = results[name].reshape(len(results), -1)
        bad = np.argwhere(~np.isfinite(rows)) if rows.dtype.kind == "f" else np.empty((0, 2), int)
        for row, column in bad[:1]:
            text = f"{name} is {rows[row, column]} at t = {results['time'][row]:.9g} s, inputs at their start values; "
            notes.append(finding("RUN005", f"{text}a co-simulation that reads or records it ends there"))
    return notes


def _raise_if_full(error: Exception) -> None:
    if isinstance(error, OSError) and error.errno in _FULL:
        raise error


def master_of(system: FlatSystem) -> str:
    """Return the master algorithm of a system; the default suits any system, even with loops."""
    return system.experiment.algorithm or DELAYED


def _run_system(path: Path, deadline: float) -> Findings:
    """Make ten steps of a system; a call that hangs at `deadline`, in `monotonic` time, is ended."""
    from vdfmu.engine.run.once import simulate  # only systems need the master

    system = load_ssp(path)
    experiment = system.experiment
    start = experiment.start or 0.0
    steps = [component.step for component in system.components if component.step is not None]
    step = experiment.step or min(steps, default=1e-3)
    count = STEPS
    if experiment.stop is not None and not steps:
        # fewer steps instead of shorter ones, because sample periods fit the step
        step = min(step, experiment.stop - start)
        count = min(STEPS, int((experiment.stop - start) / step + 1e-6))
    try:
        with listening(signal.SIGTERM):  # the time limit, or Ctrl-C: the components are in another session
            simulate(
                system,
                start=start,
                stop=start + count * step,
                step=step,
                algorithm=master_of(system),
                log=lambda message: None,
                isolate=True,
                wait_limit=max(1.0, round(deadline - monotonic(), 1)),
            )
    except (VdfmuError, OSError) as error:
        _raise_if_full(error)
        return Findings([finding("RUN001", f"{count} steps of {step:g} s failed: {error}")])
    return Findings()


def serve(check: Callable[[str, Path, float, Phase], Findings], *arguments: str) -> None:
    """Run the check in this process with the arguments from `run_apart`, and write the findings for it.

    `check` accepts the kind, the path, the deadline of a call in `monotonic` time, and the note of the task.
    """
    kind, path, deadline, folder, unpacked, task = arguments
    tempfile.tempdir = folder  # so that a crashed process's files are removed with the folder

    def answer(findings: Findings, whole: bool) -> None:
        Path(folder, _ANSWER).write_text(json.dumps(_encoded(findings, whole)), encoding="utf-8")

    try:
        for resource, size in (("AS", MEMORY), ("FSIZE", FILE_SIZE), ("CORE", 0)):
            limit(resource, size)
        phase = Phase(Path(folder, _PHASE), partial(answer, whole=False))
        phase(task)
        with package_limit(int(unpacked)):
            findings = check(kind, Path(path), float(deadline), phase)
        try:
            os.fstat(2)
        except OSError:
            findings.report("RUN002", "the unit closed files of the process that it does not own")
        answer(findings, whole=True)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        sys.exit(_FULL_NOTICE)


def _check(kind: str, path: Path, deadline: float, phase: Phase) -> Findings:
    return _run_system(path, deadline) if kind == "SSP" else _run_unit(path, phase)


if __name__ == "__main__":
    contained(serve, _check, *sys.argv[1:])
