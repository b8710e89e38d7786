"""Builds the FMUs of a robot, Python or native, reproducible to the bit.

Extras add targets, see `targets`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.cache import keep_built
from vdfmu.base.errors import UsageError
from vdfmu.base.extras import extra_modules
from vdfmu.base.files import regular_target, require_ours, storing
from vdfmu.base.platforms import native_available
from vdfmu.base.progress import warn_once
from vdfmu.base.standards import BACKENDS, FMI_VERSIONS, PYTHON_FMI, WITHOUT_NATIVE
from vdfmu.compiler.fmu.content import Content, is_built
from vdfmu.compiler.unit.base import BaseUnit, unit_name
from vdfmu.compiler.unit.declaration import Machine
from vdfmu.compiler.unit.evaluate import unmet

_MOST_JOINTS = 512
_SLOW_JOINTS = 9
"""Fewest joints for which the time of a first build is announced."""


class BuildTarget(NamedTuple):
    """A target of builds, imported only when it is used."""

    module: str
    """Module with ``reason_against(unit)``, the reason why a unit cannot be built for it or None, and
    ``finish(path, content, precision, step)`` to turn an FMU into the target."""
    precisions: tuple[str, ...]
    """Floating-point types of the code, the default first."""

    def load(self) -> Any:
        """Return the module."""
        return import_module(self.module)


FMI = "fmi"
"""The default target: a plain FMU."""


def targets() -> dict[str, BuildTarget | None]:
    """Return the targets by name, with those of extras."""
    added: dict[str, BuildTarget | None] = {FMI: None}
    for module in extra_modules("targets"):
        added |= module.TARGETS
    return added


def _build_seconds(n: int) -> float:
    """Return the processor time [s] of a first native build of all units for `n` joints, measured for 6 to 256."""
    return 0.1 * n + 12.0


def build_notes(robot: Machine | None, backend: str | None = None) -> list[str]:
    """Return notes before a build of a robot's FMUs: with many joints, the time of the first build."""
    if robot is None or robot.n < _SLOW_JOINTS or choose_backend(backend) == "python":
        return []
    seconds = _build_seconds(robot.n)
    return [f"the first build for {robot.n} joints takes some {seconds:.0f} s of processor time; it is kept."]


def choose_backend(backend: str | None) -> str:
    """Return the backend, by default native if its compiler is installed; ImportError if pythonfmu is missing."""
    if backend is None and native_available():
        return "native"
    if backend is None:
        warn_once(f"{WITHOUT_NATIVE}. 'pip install vdfmu[native]' installs the compiler for native FMUs.")
        return "python"
    if backend not in BACKENDS:
        raise UsageError(f"There is no backend {backend!r}. There are: {', '.join(BACKENDS)}.")
    if backend == "python":
        import_module("pythonfmu")  # its error is clearer than that of an FMU without it
    return backend


def build_units(
    robot: Machine | None,
    out_dir: str | os.PathLike[str],
    units: Sequence[type[BaseUnit]],
    *,
    parameters: Mapping[str, Mapping[str, float]],
    backend: str | None,
    fmi_version: str,
    platforms: Sequence[str] | str | None,
    sources: bool,
    target: str,
    precision: str,
    step: float,
    files: Mapping[str, str] | None = None,
) -> dict[str, Path]:
    """Build FMUs of units, each ``<Name>.fmu`` or as `files` names it; see :func:`vdfmu.arm.fmus.build_fmus`."""
    further = _checked_target(target, precision, step, backend, units)
    asked = fmi_version != PYTHON_FMI.name or platforms is not None or not sources or further is not None
    backend = choose_backend("native" if backend is None and asked else backend)  # options only for native FMUs
    named = {unit_name(unit): unit for unit in units}
    _check_names(named, parameters, backend, fmi_version, platforms)
    if robot is not None and robot.n > _MOST_JOINTS:
        raise UsageError(
            f"robot {robot.name}: expected at most {_MOST_JOINTS} joints for FMUs, got {robot.n}. Tracing and "
            f"compiling would take some {_build_seconds(robot.n) / 60:.0f} minutes or more, and gigabytes of "
            "memory; vdfmu.dynamics accepts more joints."
        )
    out = Path(out_dir)
    contents = {
        out / (files or {}).get(name, f"{unit.__name__}.fmu"): Content(
            unit,
            robot if unit.needs_robot() else None,
            dict(parameters.get(name, {})),
            *form_of(unit, backend, fmi_version),
            sources=sources,
        )
        for name, unit in named.items()
    }
    for content in contents.values():
        if content.backend == "python" and not sources:
            raise UsageError(f"{content.model_name}: a Python FMU contains its source. Build a native FMU to omit it.")
        if problems := unmet(content.interface, content.interface.memory_of({})):
            raise UsageError(f"start values of {content.interface.name}: {' '.join(problems)}")
    for path in contents:  # make all of them before the first is replaced
        regular_target(path)
        require_ours(path)
    native = {path: content for path, content in contents.items() if content.backend == "native"}
    if native:
        from vdfmu.compiler.fmu.native import build_native_fmus

        build_native_fmus(native, platforms)
    for path, content in contents.items():
        if content.backend == "native" or is_built(path, content.guid):
            continue
        from vdfmu.compiler.fmu.python.package import build_python_fmu

        with storing(path):
            out.mkdir(parents=True, exist_ok=True)
            build_python_fmu(content, path)
            keep_built(path, content.guid)
    if further is not None:
        for path, content in contents.items():
            further.load().finish(path, content, precision, step)
    return dict(zip(named, contents, strict=True))


def _checked_target(
    name: str, precision: str, step: float, backend: str | None, units: Sequence[type[BaseUnit]]
) -> BuildTarget | None:
    """Return a target; UsageError for an unknown name, or for a unit or options that do not suit it."""
    if name not in (by_name := targets()):
        raise UsageError(f"There is no target {name!r}. There are: {', '.join(by_name)}.")
    if not 0.0 < step < math.inf:
        raise UsageError(f"step: expected a finite number above 0 s, got {step}.")
    target = by_name[name]
    if target is None:
        if precision != "double":
            raise UsageError(f"precision: must be double for FMUs, got {precision!r}. Add --target efmi.")
        return None
    if precision not in target.precisions:
        raise UsageError(f"precision: must be {' or '.join(target.precisions)}, got {precision!r}.")
    if backend == "python":
        raise UsageError(f"target {name}: expected the backend native, got python.")
    reasons = {unit_name(unit): target.load().reason_against(unit) for unit in units}
    if problems := [f"{unit}: {reason}." for unit, reason in reasons.items() if reason]:
        raise UsageError(f"target {name}: {' '.join(problems)}")
    return target


def form_of(unit: type[BaseUnit], backend: str, fmi_version: str) -> tuple[str, str]:
    """Return the backend and the FMI version of a unit; some units can only be Python FMUs."""
    return ("python", PYTHON_FMI.name) if unit.backend == "python" else (backend, fmi_version)


def _check_names(
    units: Mapping[str, type[BaseUnit]],
    parameters: Mapping[str, Mapping[str, float]],
    backend: str,
    fmi_version: str,
    platforms: Sequence[str] | str | None,
) -> None:
    if unknown := [unit for unit in parameters if unit not in units]:
        raise UsageError(f"parameters: there is no unit {unknown[0]!r}. There are: {', '.join(units)}.")
    if fmi_version not in FMI_VERSIONS:
        raise UsageError(f"There is no FMI {fmi_version!r} here. There are: {', '.join(map(repr, FMI_VERSIONS))}.")
    if backend != "python":
        return
    if fmi_version != PYTHON_FMI.name:
        raise UsageError(f"Python FMUs have FMI {PYTHON_FMI.name}, got {fmi_version}. Native ones can also have 3.0.")
    if exchanged := [name for name, unit in units.items() if unit.exchange]:
        raise UsageError(f"{exchanged[0]} is for model exchange and must be a native FMU, got the backend python.")
    if platforms is not None:
        raise UsageError("Platforms can only be chosen for native FMUs.")
