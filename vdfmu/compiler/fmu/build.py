"""Build of the FMUs of a robot, Python or native, reproducible to the bit; and whether an FMU is what was built."""

from __future__ import annotations

import json
import math
import os
import zipfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

from vdfmu.base.cache import COMPILER, cache_folder
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.files import regular_target, require_ours, storing, temporary_folder
from vdfmu.base.progress import warn_once
from vdfmu.base.standards import BACKENDS, FMI_3, FMI_VERSIONS, PYTHON_FMI, WITHOUT_NATIVE
from vdfmu.base.version import __version__
from vdfmu.compiler.c.platforms import COMPONENT, native_available
from vdfmu.compiler.fmu.content import CONTENT_PLACES, EFMU, Content, installed_digest, is_built, keep_record, tool_of
from vdfmu.compiler.targets import TARGETS, BuildTarget
from vdfmu.compiler.unit.base import BaseUnit, unit_name
from vdfmu.compiler.unit.machine import Machine
from vdfmu.compiler.unit.requirements import unmet

_MOST_JOINTS = 512
_SLOW_JOINTS = 9
"""Joints from which a first build is announced."""


def _build_seconds(n: int) -> float:
    """Processor time of a first native build of all units for `n` joints [s], as measured for 6 to 256."""
    return 0.1 * n + 12.0


def build_notes(robot: Machine | None, backend: str | None = None) -> list[str]:
    """Return what to say before the FMUs of a robot are built: how long the first build of many joints takes."""
    if robot is None or robot.n < _SLOW_JOINTS or choose_backend(backend) == "python":
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
    if backend is None and not native_available():
        warn_once(f"{WITHOUT_NATIVE}. 'pip install vdfmu[native]' brings the compiler of native ones.")
    if backend is None:
        return "native" if native_available() else "python"
    if backend not in BACKENDS:
        raise UsageError(f"There is no backend {backend!r}. There are: {', '.join(BACKENDS)}.")
    if backend == "python":
        import_module("pythonfmu")  # an FMU that is built already would only say that it needs vdfmu
    return backend


def build_units(
    robot: Machine | None,
    out_dir: str | os.PathLike[str],
    units: Sequence[type[BaseUnit]],
    *,
    start_values: Mapping[str, Mapping[str, float]],
    backend: str | None,
    fmi_version: str,
    platforms: Sequence[str] | str | None,
    sources: bool,
    target: str,
    precision: str,
    step: float,
) -> dict[str, Path]:
    """Build FMUs of units, each ``<Name>.fmu``; see :func:`vdfmu.build_fmus`."""
    further = _checked_target(target, precision, step, backend, units)
    asked = fmi_version != PYTHON_FMI.name or platforms is not None or not sources or further is not None
    if backend is None and asked:
        backend = "native"  # what only native FMUs have asks for them
    named = {unit_name(unit): unit for unit in units}
    backend = choose_backend(backend)
    _check_names(named, start_values, backend, fmi_version, platforms)
    if robot is not None:
        if robot.n > _MOST_JOINTS:
            raise UsageError(
                f"robot {robot.name}: expected at most {_MOST_JOINTS} joints for FMUs, got {robot.n}. Tracing and "
                f"compiling would take some {_build_seconds(robot.n) / 60:.0f} minutes or more, and gigabytes of "
                "memory; vdfmu.inverse_dynamics and forward_dynamics take more joints."
            )
    out = Path(out_dir)
    contents = {
        out / f"{unit.__name__}.fmu": Content(
            unit,
            robot if unit.needs_robot() else None,
            dict(start_values.get(name, {})),
            *form_of(unit, backend, fmi_version),
            sources=sources,
        )
        for name, unit in named.items()
    }
    for content in contents.values():
        if content.backend == "python" and not sources:
            raise UsageError(f"{content.model_name}: a Python FMU is its source. Build a native one to leave it out.")
        _check(content)
    for path in contents:  # all of them before the first is replaced
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
            keep_record(path, content.guid)
    if further is not None:
        for path, content in contents.items():
            further.load().finish(path, content, precision, step)
    return dict(zip(named, contents, strict=True))


def _checked_target(
    name: str, precision: str, step: float, backend: str | None, units: Sequence[type[BaseUnit]]
) -> BuildTarget | None:
    """Return a target; UsageError if there is none of the name, or a unit or the options do not go with it."""
    if name not in TARGETS:
        raise UsageError(f"There is no target {name!r}. There are: {', '.join(TARGETS)}.")
    if not 0.0 < step < math.inf:
        raise UsageError(f"step: expected a finite number above 0 s, got {step}.")
    target = TARGETS[name]
    if target is None:
        if precision != "double":
            raise UsageError(f"precision: must be double for FMUs, got {precision!r}. Use --target efmi for another.")
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
    """Return backend and version of FMI of a unit where these are asked for: some units are Python FMUs only."""
    return ("python", PYTHON_FMI.name) if unit.backend == "python" else (backend, fmi_version)


def _check_names(
    units: Mapping[str, type[BaseUnit]],
    start_values: Mapping[str, Mapping[str, float]],
    backend: str,
    fmi_version: str,
    platforms: Sequence[str] | str | None,
) -> None:
    unknown = [unit for unit in start_values if unit not in units]
    if unknown:
        raise UsageError(f"start_values: there is no unit {unknown[0]!r}. There are: {', '.join(units)}.")
    if fmi_version not in FMI_VERSIONS:
        raise UsageError(f"There is no FMI {fmi_version!r} here. There are: {', '.join(map(repr, FMI_VERSIONS))}.")
    if backend == "python" and fmi_version != PYTHON_FMI.name:
        raise UsageError(f"Python FMUs are of FMI {PYTHON_FMI.name}, got {fmi_version}. Native ones are of 3.0 too.")
    if backend == "python" and (exchanged := [name for name, unit in units.items() if unit.exchange]):
        raise UsageError(f"{exchanged[0]} is for model exchange, which native FMUs alone have, got the backend python.")
    if backend == "python" and platforms is not None:
        raise UsageError("Platforms can be chosen for native FMUs only.")
    if fmi_version != FMI_3.name and COMPONENT in ([platforms] if isinstance(platforms, str) else platforms or ()):
        raise UsageError(f"Components of WebAssembly are of FMI {FMI_3.name}, got {fmi_version}.")


def _check(content: Content) -> None:
    """Raise for start values with which the unit could not start."""
    interface = content.interface
    problems = unmet(interface, interface.memory_of({}))
    if problems:
        raise UsageError(f"start values of {interface.name}: {' '.join(problems)}")


def verify(path: Path, unit: type[BaseUnit] | None = None) -> list[str]:
    """Build an FMU anew, without the cache, and return how it differs; nothing where it is the same to the bit.

    Parameters
    ----------
    path : Path
        An FMU that vdfmu built.
    unit : type of BaseUnit, optional
        The unit of an FMU of a user's own. Its own file would show nothing: that is not run.

    Raises
    ------
    FmuError
        If it is not an FMU of vdfmu, or of another version, which cannot make the same bits.
    UsageError
        If its unit is missing.
    """
    members = _members(path)
    place = next((place for place in CONTENT_PLACES.values() if place in members), "")
    try:
        data = json.loads(members[place])
        name, backend, made = str(data["unit"]), str(data["backend"]), (str(data["digest"]), str(data["tool"]))
        model = ElementTree.fromstring(members["modelDescription.xml"]).find(".//*[@modelIdentifier]")
        model_name = model.attrib["modelIdentifier"] if model is not None else ""
        here = installed_digest(backend, data.get("module"), data.get("reader")), tool_of(backend)
    except (ValueError, LookupError, TypeError, ElementTree.ParseError):
        raise FmuError(
            f"{path}: not an FMU of a unit that vdfmu built: {CONTENT_PLACES['native']} does not say which unit it is "
            "of."
        ) from None
    if made != here:
        raise FmuError(
            f"{path}: made by vdfmu {data.get('version')} (digest {made[0][:8]}) and {made[1]}, here are {__version__} "
            f"({here[0][:8]}) and {here[1]}: only the same make the same bits. Install those."
        )
    if data.get("module") is None and unit is None:
        raise UsageError(
            f"{path}: its unit {name} is a file of a user's own, and that in an FMU shows nothing. Name it: --unit "
            "my_unit.py."
        )
    if any(member.startswith(f"{EFMU}/") for member in members):
        raise FmuError(f"{path}: an eFMU; only plain FMUs are built again. Build it with --target efmi and compare.")
    with temporary_folder("vdfmu_verify_") as folder:
        content = Content.of(data, unit, f"{path}: {place}", model_name)
        return _differences(members, _members(_built(content, data.get("platforms"), Path(folder) / "again")))


def _built(content: Content, platforms: Sequence[str] | None, folder: Path) -> Path:
    """Build the FMU of a content in a folder, with a cache of its own that shares the compiler's library."""
    before = {name: os.environ.get(name) for name in ("VDFMU_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR")}
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    os.environ["VDFMU_CACHE_DIR"] = str(folder / "cache")
    target = folder / f"{content.model_name}.fmu"
    folder.mkdir()
    try:
        if content.backend == "native":
            from vdfmu.compiler.fmu.native import build_native_fmus

            build_native_fmus({target: content}, platforms)
        else:
            from vdfmu.compiler.fmu.python.package import build_python_fmu

            build_python_fmu(content, target)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
    return target


def _members(path: Path) -> dict[str, bytes]:
    """Return the files of an FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            if len(set(names)) < len(names):
                raise FmuError(f"{path}: it has a file twice, of which tools may take either.")
            return {name: archive.read(name) for name in names}
    except FileNotFoundError:
        raise UsageError(f"{path}: there is no such file.") from None
    except (OSError, zipfile.BadZipFile, RuntimeError) as error:
        raise FmuError(f"{path}: cannot be read as an FMU: {error}.") from None


def _differences(found: Mapping[str, bytes], expected: Mapping[str, bytes]) -> list[str]:
    """Return a line for each file that is not the same."""
    said: list[str] = []
    for name in sorted({*found, *expected}):
        if name not in expected:
            said.append(f"{name}: is not in an FMU of these sources")
        elif name not in found:
            said.append(f"{name}: is missing")
        elif found[name] != expected[name]:
            said.append(f"{name}: differs, {len(found[name])} bytes, {len(expected[name])} in the one built again")
    return said
