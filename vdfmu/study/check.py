"""Check of an FMU file: schema, rules of the standard, binary, and a short run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy
from fmpy.validation import validate_fmu

from vdfmu.errors import UsageError

__all__ = ["check_fmu"]

_STEPS = 10
_SECONDS = 60.0
"""Time that the short run may take, with the start of Python and the preparation of the unit."""
_ANSWER = "problems.json"


def check_fmu(path: str | os.PathLike[str], run: bool = True) -> list[str]:
    """Problems of an FMU, every one; an empty list for none.

    Parameters
    ----------
    path : path of the ``.fmu`` file
    run : bool, optional
        Whether to instantiate the unit and make ten communication steps, which runs its code, in a process of its own.

    Raises
    ------
    UsageError
        If there is no such file.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    try:
        problems = list(validate_fmu(str(path)))
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # fmpy raises bare exceptions for files that are no zip or hold no FMU
        return [f"{path.name} is no FMU that can be read: {error}"]
    if fmpy.platform not in platforms and fmpy.platform_tuple not in platforms:
        problems.append(
            f"no binary for this platform, {fmpy.platform}; there are: {', '.join(platforms) or 'none'}"
        )
    elif run and not problems:
        problems += _run_apart(path)
    return problems


def _run_apart(path: Path) -> list[str]:
    """Problems of the short run in another process, which a foreign unit may crash or never leave."""
    with tempfile.TemporaryDirectory(prefix="vdfmu_check_") as folder:
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", "vdfmu.study.check", str(path.resolve()), folder],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                timeout=_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return [f"{_STEPS} steps did not end within {_SECONDS:g} s"]
        except OSError as error:
            return [f"{_STEPS} steps could not be tried: {error}"]
        answer = Path(folder, _ANSWER)
        answered = answer.is_file()
        problems: list[str] = json.loads(answer.read_text(encoding="utf-8")) if answered else []
    if done.returncode:
        code = done.returncode
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        problems.append(
            f"the process crashed ({how}) in a run of {_STEPS} steps{''.join(f': {s}' for s in said)}"
        )
    elif not answered:
        problems.append(f"the unit ended the process in a run of {_STEPS} steps")
    return problems


def _smoke_run(path: Path) -> list[str]:
    messages: list[str] = []

    def logger(_environment: int, _instance: bytes, status: int, _category: bytes, message: bytes) -> None:
        if status > 1:
            messages.append(message.decode(errors="replace"))

    experiment = fmpy.read_model_description(str(path)).defaultExperiment
    step = float(experiment.stepSize) if experiment and experiment.stepSize else 1e-3
    try:
        fmpy.simulate_fmu(
            str(path),
            stop_time=_STEPS * step,
            output_interval=step,
            logger=logger,
            debug_logging=True,
            remote_platform=None,  # pyright: ignore[reportArgumentType]  # None: never another process
        )
    except Exception as error:  # whatever a foreign unit does, it is reported
        return [f"{_STEPS} steps of {step:g} s failed: {'; '.join([*messages, str(error)])}"]
    return [f"{_STEPS} steps of {step:g} s gave: {message}" for message in messages]


def _main(path: str, folder: str) -> None:
    tempfile.tempdir = folder  # what a crash leaves there goes with the folder
    problems = _smoke_run(Path(path))
    Path(folder, _ANSWER).write_text(json.dumps(problems), encoding="utf-8")


if __name__ == "__main__":
    _main(*sys.argv[1:])
