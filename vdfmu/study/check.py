"""Check of an FMU file: schema, rules of the standard, binary, and a short run."""

from __future__ import annotations

import os
from pathlib import Path

import fmpy
from fmpy.validation import validate_fmu

from vdfmu.errors import UsageError

__all__ = ["check_fmu"]

_STEPS = 10


def check_fmu(path: str | os.PathLike[str], run: bool = True) -> list[str]:
    """Problems of an FMU, every one; an empty list for none.

    Parameters
    ----------
    path : path of the ``.fmu`` file
    run : bool, optional
        Whether to instantiate the unit and make ten communication steps, which runs its code.

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
        problems += _smoke_run(path)
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
