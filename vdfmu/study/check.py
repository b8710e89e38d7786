"""Check of an FMU or a system: schema, rules of the standard, binaries, a short run, reference results."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

from vdfmu.cosim.check import check_system
from vdfmu.cosim.master import simulate
from vdfmu.errors import SspError, UsageError, VdfmuError
from vdfmu.fmu.archive import pack_zip
from vdfmu.ssp.read import load_ssp

__all__ = ["check_file", "check_fmu", "check_system_file"]

_STEPS = 10
_SECONDS = 60.0
"""Time that the short run may take, with the start of Python and the preparation of the unit."""
_ANSWER = "problems.json"


def check_file(path: str | os.PathLike[str], run: bool = True) -> list[str]:
    """Problems of an FMU, an SSP or an SSD, by the ending of its name; see the two functions below."""
    suffix = Path(path).suffix.lower()
    return (check_system_file if suffix in (".ssp", ".ssd") else check_fmu)(path, run)


def check_system_file(path: str | os.PathLike[str], run: bool = True) -> list[str]:
    """Problems of a system: wiring, units, parameters, each of its FMUs, and ten steps of the whole.

    Parameters
    ----------
    path : path of the ``.ssp`` file, or of an ``.ssd`` beside its resources
    run : bool, optional
        As in :func:`check_fmu`.

    Raises
    ------
    UsageError
        If there is no such file.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    with tempfile.TemporaryDirectory(prefix="vdfmu_check_") as folder:
        if path.suffix.lower() == ".ssd":
            path = _pack(path, Path(folder))
        try:
            checked = check_system(load_ssp(path))
        except SspError as error:
            return error.problems
        problems: list[str] = []
        for source, data in checked.fmus.items():
            fmu = Path(folder) / Path(source).name
            fmu.write_bytes(data)
            problems += [f"{source}: {problem}" for problem in check_fmu(fmu, run=False)]
        return problems or (_run_apart(path) if run else [])


def _pack(ssd: Path, folder: Path) -> Path:
    """Pack an SSD with the files beside it that it names."""
    text = ssd.read_bytes()
    members = {"SystemStructure.ssd": text}
    for name in {unquote(found.decode()) for found in re.findall(rb'source="([^"]+)"', text)}:
        file = (ssd.parent / name).resolve()
        if file.is_file() and file.is_relative_to(ssd.parent.resolve()):
            members[name] = file.read_bytes()
    package = folder / f"{ssd.stem}.ssp"
    pack_zip(package, members)
    return package


def check_fmu(path: str | os.PathLike[str], run: bool = True) -> list[str]:
    """Problems of an FMU, every one; an empty list for none.

    Parameters
    ----------
    path : path of the ``.fmu`` file
    run : bool, optional
        Whether to instantiate the unit, make ten communication steps, and compare with the reference results that an
        FMU 2.0 may carry (FMI-LS-REF). That runs its code, in a process of its own.

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
    problems = [f"{_STEPS} steps of {step:g} s gave: {message}" for message in messages]
    return problems or _compare(path)


_LS_REF = "extra/org.fmi-standard.fmi-ls-ref/"
# Reference results say nothing of the solver's tolerance. This is far above those in use and far below a wrong result.
_AGREEMENT = 1e-3


def _compare(path: Path) -> list[str]:
    """Problems of the results of an FMU 2.0 beside the reference results that it carries."""
    description = fmpy.read_model_description(str(path))
    with zipfile.ZipFile(path) as archive:
        found = [n for n in archive.namelist() if n.startswith(_LS_REF) and n.endswith("_out.csv")]
        if description.fmiVersion != "2.0" or description.coSimulation is None:
            found = []  # arrays, which fmpy does not take as input
        problems: list[str] = []
        for name in found:
            try:
                expected = _read_csv(archive, name)
                inputs = name.replace("_out.csv", "_in.csv")
                signals = _read_csv(archive, inputs) if inputs in archive.namelist() else None
                problems += [
                    f"{Path(name).name}: {problem}" for problem in _difference(path, expected, signals)
                ]
            except Exception as error:  # foreign files
                problems.append(f"{Path(name).name}: the reference results cannot be compared: {error}")
    return problems


def _read_csv(archive: zipfile.ZipFile, name: str) -> Any:
    return np.genfromtxt(io.BytesIO(archive.read(name)), delimiter=",", names=True, deletechars="")


def _difference(path: Path, expected: Any, signals: Any) -> list[str]:
    names = list(expected.dtype.names[1:])
    time = expected["time"]
    result = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", start_time=time[0], stop_time=time[-1], output_interval=time[1] - time[0],
        input=signals, output=names, remote_platform=None,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    problems: list[str] = []
    for name in names:
        error = np.abs(np.interp(time, result["time"], result[name]) - expected[name])
        worst = int(np.argmax(error / (1.0 + np.abs(expected[name]))))
        if not error[worst] <= _AGREEMENT * (1.0 + abs(expected[name][worst])):
            problems.append(
                f"{name} at t = {time[worst]:g} s: expected {expected[name][worst]:.9g}, differs by {error[worst]:.3g}"
            )
    return problems


def _run_system(path: Path) -> list[str]:
    """Problems of ten steps of a system."""
    system = load_ssp(path)
    start = system.start or 0.0
    step = 1e-3 if system.stop is None else min(1e-3, (system.stop - start) / _STEPS)
    try:
        simulate(system, start=start, stop=start + _STEPS * step, step=step, log=lambda message: None)
    except (VdfmuError, OSError) as error:
        return [f"{_STEPS} steps of {step:g} s failed: {error}"]
    return []


def _main(path: str, folder: str) -> None:
    tempfile.tempdir = folder  # what a crash leaves there goes with the folder
    problems = _run_system(Path(path)) if path.endswith(".ssp") else _smoke_run(Path(path))
    Path(folder, _ANSWER).write_text(json.dumps(problems), encoding="utf-8")


if __name__ == "__main__":
    _main(*sys.argv[1:])
