"""Build of the Python FMUs with pythonfmu, reproducible to the bit."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from pythonfmu import FmuBuilder

from vdfmu.data import data_path
from vdfmu.errors import FmuError, UsageError
from vdfmu.fmu.behaviour import robot_problems
from vdfmu.fmu.content import CONTENT_FILE, Content
from vdfmu.fmu.interface import MODEL_NAMES, UNIT_NAMES, start_values
from vdfmu.model import Robot, check_robot

__all__ = ["build_fmus", "pack_zip"]

_EPOCH = (1980, 1, 1, 0, 0, 0)
_GUID = re.compile(rb'<fmiModelDescription[^>]* guid="([^"]*)"')
# pythonfmu puts a copy of itself into every FMU. A process that loads an FMU first would take that copy for
# the package; it lacks the binaries that a later build needs. The slaves use the installed one.
_LEFT_OUT = "resources/pythonfmu/"


def build_fmus(
    robot: Robot,
    out_dir: str | os.PathLike[str],
    *,
    units: Sequence[str] = UNIT_NAMES,
    start_values: Mapping[str, Mapping[str, float]] | None = None,
) -> dict[str, Path]:
    """Build the FMUs of a robot: Trajectory.fmu, Feedforward.fmu, PDController.fmu and Plant.fmu.

    The same sources, robot and start values give the same bytes. An FMU that is up to date is left alone.

    Parameters
    ----------
    robot : Robot
    out_dir : path
        Folder, made if it does not exist.
    units : sequence of str, optional
        Which units; default all four.
    start_values : mapping of unit to mapping of variable to number, optional
        Start values in place of those of the variable table.

    Returns
    -------
    dict of str to Path
        Unit to its FMU.

    Raises
    ------
    UsageError
        If a unit or variable does not exist, or a start value is not allowed.
    ModelError
        If the robot is not physical.
    FmuError
        If a file cannot be written.
    """
    unknown = [unit for unit in (*units, *(start_values or {})) if unit not in MODEL_NAMES]
    if unknown:
        raise UsageError(f"There is no unit {unknown[0]!r}. There are: {', '.join(UNIT_NAMES)}.")
    check_robot(robot)
    out = Path(out_dir)
    contents = [Content(unit, robot, dict((start_values or {}).get(unit, {}))) for unit in units]
    for content in contents:
        _check(content)
    built: dict[str, Path] = {}
    for content in contents:
        path = out / f"{content.model_name}.fmu"
        try:
            out.mkdir(parents=True, exist_ok=True)
            if _guid_of(path) != content.guid:
                _build(content, path)
        except OSError as error:
            raise FmuError(
                f"{path}: cannot be written: {error}. Choose another folder or free space."
            ) from error
        built[content.unit] = path
    return built


def _check(content: Content) -> None:
    """Raise for start values with which the unit could not start."""
    table = content.table()
    if content.unit in ("feedforward", "plant"):
        problems = robot_problems(table, start_values(table))
        if problems:
            raise UsageError(f"start values of {content.unit}: {' '.join(problems)}")


def _build(content: Content, path: Path) -> None:
    script = data_path("fmu_src") / "python" / f"vdfmu_{content.unit}_slave.py"
    with tempfile.TemporaryDirectory(prefix="vdfmu_build_") as folder:
        resource = Path(folder) / CONTENT_FILE
        resource.write_text(content.to_json(), encoding="utf-8")
        search_path = list(sys.path)
        try:
            raw = FmuBuilder.build_FMU(script, dest=folder, project_files=[resource])
        finally:
            sys.path[:] = search_path
        with zipfile.ZipFile(raw) as archive:
            names = [name for name in archive.namelist() if not name.startswith(_LEFT_OUT)]
            members = {name: archive.read(name) for name in names}
    members["documentation/index.html"] = _documentation(content).encode()
    pack_zip(path, members)


def pack_zip(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file whose bytes depend on its members alone: sorted names, one time stamp, one mode."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(members):
                entry = zipfile.ZipInfo(name, _EPOCH)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, members[name])
        os.chmod(temporary, 0o644)  # a temporary file is its owner's alone
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _guid_of(path: Path) -> str | None:
    """GUID of an FMU on disk; None if there is none that can be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.testzip() is not None:  # a damaged member
                return None
            found = _GUID.search(archive.read("modelDescription.xml"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None
    return found[1].decode() if found else None


def _documentation(content: Content) -> str:
    """Short page inside the FMU: what it is, what it needs, its variables."""
    table = content.table()
    rows = "\n".join(
        f"<tr><td>{v.name}</td><td>{v.causality}</td><td>{v.unit or ''}</td>"
        f"<td>{escape(v.description)}</td></tr>"
        for v in table
    )
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        f"<title>{content.model_name}</title></head><body>\n<h1>{content.model_name}</h1>\n"
        f"<p>{table.description}. Robot: {escape(content.robot.name)}.</p>\n"
        f"<p>This FMU runs in a Python that has vdfmu {content.version} installed.</p>\n"
        f"<table><tr><th>variable</th><th>causality</th><th>unit</th><th>description</th></tr>\n{rows}\n</table>\n"
        "</body></html>\n"
    )
