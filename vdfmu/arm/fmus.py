"""FMUs of an arm: units by name, file or class."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from vdfmu.arm.robot import Robot, check_robot
from vdfmu.arm.units import find_unit, shipped_units
from vdfmu.base.cache import one_job
from vdfmu.base.progress import Shown, with_progress
from vdfmu.base.standards import FMI_2
from vdfmu.compiler.fmu.build import build_units
from vdfmu.compiler.targets import FMI
from vdfmu.compiler.unit.unit import Unit

_One = str | os.PathLike[str] | type[Unit]
Units = _One | Sequence[_One]


@with_progress
@one_job()
def build_fmus(
    robot: Robot | None,
    out_dir: str | os.PathLike[str],
    *,
    units: Units | None = None,
    start_values: Mapping[str, Mapping[str, float]] | None = None,
    backend: str | None = None,
    fmi_version: str = FMI_2.name,
    platforms: Sequence[str] | str | None = None,
    sources: bool = True,
    target: str = FMI,
    precision: str = "double",
    step: float = 1e-3,
    progress: Shown = None,
) -> dict[str, Path]:
    """Build FMUs of units, each ``<Name>.fmu``.

    The same sources, robot, start values and options give the same bytes. An FMU that is, to the byte, one that the
    user built of these before, and has the platforms asked for, is left alone, with others that it may have; any
    other is replaced.

    Parameters
    ----------
    robot : Robot or None
        None will do for units without joints.
    out_dir : path
        Folder, made if it does not exist.
    units : str, path or type of Unit, or sequence of them, optional
        Names of units of the package, files ``my_unit.py`` or ``my_units.py:Name``, or classes.
        Default: those of the shipped systems that need a robot.
    start_values : mapping of unit to mapping of variable to number, optional
        Start values instead of those of the declaration.
    backend : "python" or "native", optional
        A Python FMU runs in a Python that has vdfmu; a native one needs nothing but its platform. Default
        native where its compiler is installed.
    fmi_version : "2.0" or "3.0", optional
        Python FMUs are of FMI 2.0.
    platforms : sequence of str, or "all", optional
        Platforms of native FMUs; default that of this machine.
    sources : bool
        Whether native FMUs carry their C, for platforms that they have no library of.
    target : "fmi" or "efmi", optional
        What is built: FMUs, or eFMUs, which are FMUs with code for microcontrollers in them.
    precision : "double" or "float32", optional
        Numbers of that code.
    step : float, optional [s]
        Time from one step to the next of an eFMU without sampled states; others have their period.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.

    Returns
    -------
    dict of str to Path
        Name of the unit to its FMU.

    Raises
    ------
    UsageError
        If a unit, variable, backend, platform or target does not exist, a start value is not allowed, or a unit cannot
        be built for the target.
    UnitError
        If a unit is declared wrongly, or its methods cannot be run or traced.
    ModelError
        If the robot is not physical.
    FmuError
        If a file cannot be written, or the compiler is missing or fails.
    """
    if robot is not None:
        check_robot(robot)
    asked = [units] if isinstance(units, str | os.PathLike | type) else units or shipped_units()
    chosen = [find_unit(unit) for unit in asked]
    return build_units(
        robot, out_dir, chosen, start_values=start_values or {}, backend=backend, fmi_version=fmi_version,
        platforms=platforms, sources=sources, target=target, precision=precision, step=step,
    )  # fmt: skip
