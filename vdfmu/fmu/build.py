"""Build of the FMUs of a robot, Python or native, reproducible to the bit."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

from vdfmu.errors import StorageError, UsageError
from vdfmu.fmu.archive import is_built, keep_record, regular_target
from vdfmu.fmu.behaviour import robot_problems
from vdfmu.fmu.content import BACKENDS, FMI_VERSIONS, Content
from vdfmu.fmu.interface import MODEL_NAMES, UNIT_NAMES, start_values
from vdfmu.fmu.native import native_available
from vdfmu.model import Robot, check_robot

__all__ = ["build_fmus", "build_notes", "choose_backend"]

_MOST_JOINTS = 30
_SLOW_JOINTS = 9
"""Joints from which on a first build is announced."""


def _build_seconds(n: int) -> float:
    """Processor time of a first native build of all units for `n` joints [s], as measured for 6 to 30."""
    return 35.0 * (n / 6.0) ** 1.6


def build_notes(robot: Robot, backend: str | None = None) -> list[str]:
    """Return what to say before the FMUs of a robot are built: how long the first build of many joints takes."""
    if robot.n < _SLOW_JOINTS or choose_backend(backend) == "python":
        return []
    seconds = _build_seconds(robot.n)
    return [f"the first build for {robot.n} joints takes some {seconds:.0f} s of processor time; it is kept."]


def choose_backend(backend: str | None) -> str:
    """Return the backend that is asked for, or the default: native where its compiler is installed.

    Raises
    ------
    UsageError
        For an unknown one.
    ImportError
        If the package is missing that Python FMUs need.
    """
    if backend is None:
        return "native" if native_available() else "python"
    if backend not in BACKENDS:
        raise UsageError(f"There is no backend {backend!r}. There are: {', '.join(BACKENDS)}.")
    if backend == "python":
        import_module("pythonfmu")  # an FMU that is built already would only say that it needs vdfmu
    return backend


def build_fmus(
    robot: Robot,
    out_dir: str | os.PathLike[str],
    *,
    units: Sequence[str] = UNIT_NAMES,
    start_values: Mapping[str, Mapping[str, float]] | None = None,
    backend: str | None = None,
    fmi_version: str = "2.0",
    platforms: Sequence[str] | str | None = None,
) -> dict[str, Path]:
    """Build the FMUs of a robot: Trajectory, Feedforward, PDController, Plant and TorqueEstimator, each ``.fmu``.

    The same sources, robot, start values and options give the same bytes. An FMU that is, to the byte, one that the
    user built of these before, and has the platforms asked for, is left alone, with others that it may have; any
    other is replaced.

    Parameters
    ----------
    robot : Robot
    out_dir : path
        Folder, made if it does not exist.
    units : sequence of str, optional
        Which units; default all.
    start_values : mapping of unit to mapping of variable to number, optional
        Start values in place of those of the variable table.
    backend : "python" or "native", optional
        A Python FMU runs in a Python that has vdfmu; a native one needs nothing but its platform. Default
        native where its compiler is installed.
    fmi_version : "2.0" or "3.0", optional
        Python FMUs are of FMI 2.0.
    platforms : sequence of str, or "all", optional
        Platforms of native FMUs; default that of this machine.

    Returns
    -------
    dict of str to Path
        Unit to its FMU.

    Raises
    ------
    UsageError
        If a unit, variable, backend or platform does not exist, or a start value is not allowed.
    ModelError
        If the robot is not physical.
    FmuError
        If a file cannot be written, or the compiler is missing or fails.
    """
    if backend is None and (fmi_version == "3.0" or platforms is not None):
        backend = "native"  # what only native FMUs have asks for them
    backend = choose_backend(backend)
    _check_names(units, start_values or {}, backend, fmi_version, platforms)
    check_robot(robot)
    if robot.n > _MOST_JOINTS:
        raise UsageError(
            f"robot {robot.name}: expected at most {_MOST_JOINTS} joints for FMUs, got {robot.n}. Tracing and "
            f"compiling would take some {_build_seconds(robot.n) / 60:.0f} minutes or more, and gigabytes of memory; "
            "vdfmu.inverse_dynamics and forward_dynamics take more joints."
        )
    out = Path(out_dir)
    contents = [
        Content(unit, robot, dict((start_values or {}).get(unit, {})), backend, fmi_version) for unit in units
    ]
    for content in contents:
        _check(content)
    built = {content.unit: out / f"{content.model_name}.fmu" for content in contents}
    for path in built.values():  # all of them before the first is replaced
        regular_target(path)
    if backend == "native":
        from vdfmu.fmu.native.package import build_native_fmus

        build_native_fmus(contents, built, platforms)
        return built
    for content in contents:
        path = built[content.unit]
        try:
            out.mkdir(parents=True, exist_ok=True)
            if not is_built(path, content.guid):
                from vdfmu.fmu.python_backend import build_python_fmu

                build_python_fmu(content, path)
                keep_record(path, content.guid)
        except OSError as error:
            raise StorageError(
                f"{path}: cannot be written: {error}. Choose another folder or free space."
            ) from error
    return built


def _check_names(
    units: Sequence[str],
    start_values: Mapping[str, Mapping[str, float]],
    backend: str,
    fmi_version: str,
    platforms: Sequence[str] | str | None,
) -> None:
    unknown = [unit for unit in (*units, *start_values) if unit not in MODEL_NAMES]
    if unknown:
        raise UsageError(f"There is no unit {unknown[0]!r}. There are: {', '.join(UNIT_NAMES)}.")
    if fmi_version not in FMI_VERSIONS:
        raise UsageError(
            f"There is no FMI {fmi_version!r} here. There are: {', '.join(map(repr, FMI_VERSIONS))}."
        )
    if backend == "python" and fmi_version != "2.0":
        raise UsageError(f"Python FMUs are of FMI 2.0, got {fmi_version}. Native ones are of 3.0 too.")
    if backend == "python" and platforms is not None:
        raise UsageError("Platforms can be chosen for native FMUs only.")


def _check(content: Content) -> None:
    """Raise for start values with which the unit could not start."""
    table = content.table()
    if table.has_robot:
        problems = robot_problems(table, start_values(table))
        if problems:
            raise UsageError(f"start values of {content.unit}: {' '.join(problems)}")
