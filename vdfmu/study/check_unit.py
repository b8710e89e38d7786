"""Check of one FMU."""

from __future__ import annotations

import math
import posixpath
import re
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ValidationError

from vdfmu.errors import SspError, StorageError
from vdfmu.ssp.archive import XML_LIMIT, Archive, parse_xml
from vdfmu.study.findings import Findings

__all__ = ["check_unit", "read_unit", "store"]

_DESCRIPTION = "modelDescription.xml"
_VERSION = re.compile(r"[12]\.0|3\.0(\.\d+)?")
"""FMI 1.0 and 2.0 fix the text of fmiVersion; FMI 3.0 leaves a third number open."""
_XML_FOLDERS = ("terminalsAndIcons/", "sources/", "extra/")
_MAGIC = {
    ".so": (b"\x7fELF",),
    ".dll": (b"MZ",),
    ".dylib": (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf"),
}
"""First bytes of a shared library."""


def store(data: bytes, folder: Path) -> Path:
    """Write an FMU of a package into a temporary folder, under a number: its name there may be too long for a file."""
    path = folder / f"{sum(1 for _ in folder.iterdir())}.fmu"
    try:
        path.write_bytes(data)
    except OSError as error:
        raise StorageError(
            f"{path}: cannot be written: {error.strerror}; free space there, or name another folder in TMPDIR"
        ) from error
    return path


def check_unit(path: Path, run: bool = True, name: str = "") -> tuple[Findings, str | None]:
    """Check an FMU of FMI 1.0, 2.0 or 3.0.

    Parameters
    ----------
    path : Path
    name : str, optional
        Its name in messages, if not that of the file.
    run : bool, optional
        Whether to make ten steps and to compare with reference results, in a process of its own.

    Returns
    -------
    Findings
    str or None
        The standard, such as ``FMI 2.0``; None where the model description does not say.
    """
    findings = Findings()
    try:
        version, names = _read(path, name or path.name, findings)
    except SspError as error:
        name = name or path.name
        why = [problem.removeprefix(f"{name}: ") for problem in error.problems]
        return Findings([f"{name} is no FMU that can be read: {problem}" for problem in why]), None
    standard = f"FMI {version}" if version else None
    if not version:
        findings.problems.append(f"{_DESCRIPTION}: has no fmiVersion; expected 1.0, 2.0 or 3.0")
        return findings, standard
    if not _VERSION.fullmatch(version):
        findings.problems.append(f"{_DESCRIPTION}: fmiVersion is {version!r}; expected 1.0, 2.0 or 3.0")
        return findings, standard
    if version == "1.0":
        findings.notes.append("FMI 1.0: fmpy and other importers run it, the master of vdfmu takes FMI 2.0")
    findings.problems += _rules(path)
    try:
        description = read_unit(path)
    except (
        Exception
    ):  # fmpy raises bare exceptions where an element is not as it expects; `_rules` says which
        findings.notes.append("not run: the model description cannot be read")
        return findings, standard
    kinds = [
        name
        for name in ("coSimulation", "modelExchange", "scheduledExecution")
        if getattr(description, name, None) is not None
    ]
    if version != "1.0" and "coSimulation" not in kinds:
        findings.notes.append(
            "no co-simulation: a master needs it; other importers bring a solver of their own"
        )
    here = _binaries(path, description, kinds, names, findings)
    odd = _experiment(description)
    if not any("'DefaultExperiment'" in problem for problem in findings.problems):  # by the schema
        findings.problems += odd
    if here and run and odd:
        findings.notes.append("not run: its default experiment says nothing that can be run")
    elif here and run:
        from vdfmu.study.check_run import run_apart

        findings.add(run_apart(path))
    elif here:
        findings.notes.append("not run (--no-run): the binary was not loaded")
    return findings, standard


def _rules(path: Path) -> list[str]:
    """Return what breaks the schema or the rules of the standard that fmpy knows."""
    try:
        fmpy.read_model_description(
            str(path), validate=True, validate_variable_names=True, validate_model_structure=True
        )
    except ValidationError as error:
        return [str(problem) for problem in error.problems]
    except KeyError as error:
        return [f"{_DESCRIPTION}: {error} is used and not defined"]
    except Exception as error:
        return [f"{_DESCRIPTION}: cannot be read, an element or attribute is missing or odd: {error}"]
    return []


def read_unit(path: Path) -> Any:
    """Return fmpy's model description, whatever rules it breaks."""
    return fmpy.read_model_description(str(path), validate=False)


def _experiment(description: Any) -> list[str]:
    """Return what is wrong with the times of the default experiment."""
    experiment = description.defaultExperiment
    problems: list[str] = []
    times: dict[str, float] = {}
    for name in ("startTime", "stopTime", "stepSize"):
        text = getattr(experiment, name, None)
        if text is None:
            continue
        try:
            times[name] = float(text)
        except ValueError:
            times[name] = math.nan
        if not math.isfinite(times[name]) or (name == "stepSize" and times[name] <= 0.0):
            wanted = "a positive number" if name == "stepSize" else "a finite number"
            problems.append(f"{_DESCRIPTION}: DefaultExperiment: {name} is {text!r}; expected {wanted}")
    start, stop = times.get("startTime", 0.0), times.get("stopTime", math.inf)
    if not problems and stop < start:
        problems.append(
            f"{_DESCRIPTION}: DefaultExperiment: stopTime {stop:g} lies before startTime {start:g}"
        )
    return problems


def _read(path: Path, label: str, findings: Findings) -> tuple[str | None, list[str]]:
    """Return version and members; XML that must not be parsed goes no further."""
    with Archive(path, label) as archive:
        if _DESCRIPTION not in archive:
            hint = "; it is a package of SSP, name it .ssp" if "SystemStructure.ssd" in archive else ""
            raise SspError(f"it has no {_DESCRIPTION!r}{hint}")
        root = parse_xml(archive.read(_DESCRIPTION, XML_LIMIT), _DESCRIPTION)
        if root.tag != "fmiModelDescription":
            raise SspError(f"{_DESCRIPTION}: expected the root fmiModelDescription, got {root.tag!r}")
        for name in archive.names:
            if name.endswith(".xml") and name.startswith(_XML_FOLDERS):
                try:
                    parse_xml(archive.read(name, XML_LIMIT), name)
                except SspError as error:
                    findings.problems += error.problems
        for name in archive.names:
            kind = posixpath.splitext(name)[1]
            if name.startswith("binaries/") and name.count("/") == 2 and kind in _MAGIC:
                if not archive.read(name).startswith(_MAGIC[kind]):
                    findings.problems.append(f"{name}: is no shared library of the kind its name says")
        return root.get("fmiVersion"), archive.names


def _binaries(path: Path, description: Any, kinds: list[str], names: list[str], findings: Findings) -> bool:
    """Check the binaries; tell whether there is one for this platform."""
    folders = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") >= 2})
    here = [p for p in (fmpy.platform, fmpy.platform_tuple) if p in folders]
    if not here:
        sources = "; it has sources, which must be compiled first" if _has_sources(names) else ""
        findings.problems.append(
            f"no binary for this platform, {fmpy.platform}; there are: {', '.join(folders) or 'none'}{sources}"
        )
        return False
    libraries = {
        str(getattr(description, kind).modelIdentifier) + fmpy.sharedLibraryExtension for kind in kinds
    }
    for library in sorted(libraries):
        if not any(f"binaries/{folder}/{library}" in names for folder in here):
            findings.problems.append(f"binaries/{here[0]} has no {library}, as the model identifier asks for")
            return False
    return True


def _has_sources(names: list[str]) -> bool:
    return any(n.startswith("sources/") and n.endswith((".c", ".cpp", ".cc")) for n in names)
