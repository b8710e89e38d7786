"""FMUs of an arm: units by name, file or class."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.arm.robot import Robot, check_robot, load_robot
from vdfmu.arm.units import find_unit, shipped_units
from vdfmu.base.cache import one_job
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types
from vdfmu.base.progress import Shown, with_progress
from vdfmu.base.standards import FMI_2
from vdfmu.compiler.fmu.build import FMI, build_units, unit_name
from vdfmu.compiler.unit import Unit
from vdfmu.compiler.unit.interface import interface_of
from vdfmu.engine.package.system import spread

_One = str | os.PathLike[str] | type[Unit]
Units = _One | Sequence[_One]


@with_progress
@one_job()
@checks_types
def build_fmus(
    robot: Robot | None,
    out_dir: str | os.PathLike[str],
    *,
    units: Units | None = None,
    parameters: Mapping[str, Mapping[str, float]] | None = None,
    backend: str | None = None,
    fmi_version: str = FMI_2.name,
    platforms: Sequence[str] | str | None = None,
    sources: bool = True,
    target: str = FMI,
    precision: str = "double",
    step: float = 1e-3,
    folded: bool = False,
    progress: Shown = None,
) -> dict[str, Path]:
    """Build FMUs of units, each ``<Name>.fmu``.

    Builds are reproducible: the same sources, robot, start values and options result in the same bytes. An existing FMU
    is kept if this user built it from the same inputs for at least these platforms; any other is replaced.

    Parameters
    ----------
    robot : Robot or None
        May be None for units without joints.
    out_dir : path
        Folder, made if it does not exist.
    units : str, path or type of Unit, or sequence of them, optional
        Names of units of the package, files ``my_unit.py`` or ``my_units.py:Name``, or classes.
        Default: those of the shipped systems that need a robot.
    parameters : mapping of unit to mapping of variable to number, optional
        Start values that replace the declared ones.
    backend : "python" or "native", optional
        A Python FMU runs in a Python that has vdfmu; a native one needs only its platform. The default is native if its
        compiler is installed.
    fmi_version : "2.0" or "3.0", optional
        Python FMUs have FMI 2.0.
    platforms : sequence of str, or "all", optional
        Platforms of native FMUs; default that of this machine.
    sources : bool
        Whether native FMUs contain their C sources, for platforms without a library.
    target : "fmi" or "efmi", optional
        What is built: FMUs, or eFMUs, which also contain code for microcontrollers.
    precision : "double" or "float32", optional
        Numbers of that code.
    step : float, optional [s]
        Step of an eFMU without sampled states; others use their period.
    folded : bool, optional
        Whether zeros of gravity, centres of mass and tool, and the payload of a robot without one, are constants. That
        is the fastest form, and the one that :func:`vdfmu.run` builds. By default they are parameters, as in
        :func:`build`.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.

    Returns
    -------
    dict of str to Path
        Name of the unit to its FMU.

    Raises
    ------
    UsageError
        If a unit, variable, backend, platform or target does not exist, if a start value is not allowed, or if a unit
        cannot be built for the target.
    UnitError
        If a unit is declared wrongly, or its methods cannot be run or traced.
    ModelError
        If the robot is not physical.
    FmuError
        If a file cannot be written, or the compiler is missing or fails.
    """
    if robot is not None:
        check_robot(robot)
    names: Any = [units] if isinstance(units, str | os.PathLike | type) else shipped_units() if units is None else units
    if not isinstance(names, Iterable):
        raise UsageError(f"units: expected names, files or classes of units, got {units!r:.60}.")
    return build_units(
        robot if folded or robot is None else robot.unfolded(),
        out_dir,
        [find_unit(unit) for unit in names],
        parameters=parameters or {},
        backend=backend,
        fmi_version=fmi_version,
        platforms=platforms,
        sources=sources,
        target=target,
        precision=precision,
        step=step,
    )


@with_progress
@one_job()
@checks_types
def build(
    unit: str | os.PathLike[str] | type[Unit],
    path: str | os.PathLike[str] | None = None,
    *,
    robot: Robot | str | None = None,
    fmi: str = FMI_2.name,
    platform: Sequence[str] | str | None = None,
    backend: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    folded: bool = False,
    progress: Shown = None,
    **start: Any,
) -> Path:
    """Build one FMU.

    Parameters
    ----------
    unit : type of Unit, path or str
        A class, a file ``my_unit.py`` or ``my_units.py:Name``, or the name of a unit of the package.
    path : path, optional
        The FMU to write, by default ``<Class>.fmu`` in this folder.
    robot : Robot, str, optional
        Robot, its name or its file, for units of an arm.
    fmi : "2.0" or "3.0", optional
        Version of FMI.
    platform : str, sequence of str or "all", optional
        Platforms of a native FMU, default that of this machine.
    backend : "python" or "native", optional
        Default native if its compiler is installed.
    parameters : mapping of variable to value, optional
        Start values whose names are not Python identifiers.
    folded : bool, optional
        Whether zeros of gravity, centres of mass and tool, and the payload of a robot without one, are constants. That
        is the fastest form. By default they are parameters.
    progress : callable or bool, optional
        See :func:`build_fmus`.
    **start
        Start values by name: ``T=0.2``, a vector as a sequence or as one number for all elements.

    Returns
    -------
    Path
        The FMU.

    Raises
    ------
    UsageError, UnitError, ModelError, FmuError
        See :func:`build_fmus`.

    Examples
    --------
    >>> vdfmu.build(LowPass, "low_pass.fmu", T=0.2)
    """
    chosen = find_unit(unit)
    target = Path(path) if path is not None else Path(f"{chosen.__name__}.fmu")
    if target.suffix.lower() != ".fmu":
        raise UsageError(f"path must end in .fmu, got {target}. Write {target.parent / (target.stem or 'unit')}.fmu.")
    arm = load_robot(robot) if isinstance(robot, str | os.PathLike) else robot
    if arm is not None:
        check_robot(arm)
        arm = arm if folded else arm.unfolded()
    elif chosen.needs_robot():
        raise UsageError(
            f"robot must be given for {chosen.__name__}, got none. Add robot='ur5e_6dof', or your own file."
        )
    name = unit_name(chosen)
    starts: dict[str, float] = {}
    table = interface_of(chosen, arm if chosen.needs_robot() else None)
    for key, value in {**(parameters or {}), **start}.items():
        names = [v.name for v in table if key in (v.name, v.group)] or [key]
        try:
            starts |= dict(zip(names, spread(value, names), strict=True))
        except ValueError as error:
            raise UsageError(f"{key}: {error}.") from None
    built = build_units(
        arm,
        target.parent,
        [chosen],
        parameters={name: starts} if starts else {},
        backend=backend,
        fmi_version=fmi,
        platforms=platform,
        sources=True,
        target=FMI,
        precision="double",
        step=1e-3,
        files={name: target.name},
    )
    return built[name]
