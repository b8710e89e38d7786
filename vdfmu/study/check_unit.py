"""Check of one FMU."""

from __future__ import annotations

import posixpath
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ValidationError

from vdfmu.errors import SspError
from vdfmu.ssp.archive import XML_LIMIT, Archive, parse_xml
from vdfmu.study.findings import Findings

__all__ = ["check_unit", "read_unit"]

_DESCRIPTION = "modelDescription.xml"
_VERSIONS = ("1.0", "2.0", "3.0")
_XML_FOLDERS = ("terminalsAndIcons/", "sources/", "extra/")
_MAGIC = {
    ".so": (b"\x7fELF",),
    ".dll": (b"MZ",),
    ".dylib": (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf"),
}
"""First bytes of a shared library."""


def check_unit(path: Path, run: bool = True) -> tuple[Findings, str | None]:
    """Check an FMU of FMI 1.0, 2.0 or 3.0.

    Parameters
    ----------
    path : Path
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
        version, names = _read(path, findings)
    except SspError as error:
        why = [problem.removeprefix(f"{path.name}: ") for problem in error.problems]
        return Findings([f"{path.name} is no FMU that can be read: {problem}" for problem in why]), None
    standard = None if version is None else f"FMI {version}"
    if version is None or version[:3] not in _VERSIONS:
        findings.problems.append(
            f"{_DESCRIPTION}: fmiVersion is {version!r}; expected one of {', '.join(_VERSIONS)}"
        )
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
    if here and run:
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


def _read(path: Path, findings: Findings) -> tuple[str | None, list[str]]:
    """Return version and members; XML that must not be parsed goes no further."""
    with Archive(path, path.name) as archive:
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
