"""Check of one FMU."""

from __future__ import annotations

import math
import posixpath
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy

from vdfmu.base.errors import SspError, StorageError
from vdfmu.engine.inspect.description import DESCRIPTION, description_faults
from vdfmu.engine.inspect.fmi import (
    BUILD,
    MANIFEST,
    REFERENCES,
    TERMINALS,
    build_faults,
    manifest_faults,
    related_notes,
    terminal_faults,
    variable_faults,
)
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.rules import Finding, Findings, breach, finding

_VERSION = re.compile(r"[12]\.0|3\.0(\.\d+)?")
"""fmiVersion: fixed texts in FMI 1.0 and 2.0, with an optional third number in FMI 3.0."""
NOT_RUN = finding("RUN006", "not run: code of a file with problems is not run; mend them first")
_XML_FOLDERS = ("terminalsAndIcons/", "sources/", "extra/")
_MAGIC = {
    ".so": (b"\x7fELF",),
    ".dll": (b"MZ",),
    ".wasm": (b"\0asm",),
    ".dylib": (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf"),
}
"""First bytes of a shared library."""
_ELF = {3: "x86", 40: "arm", 62: "x86_64", 183: "aarch64", 243: "riscv"}
_PE = {0x14C: "x86", 0x1C0: "arm", 0x8664: "x86_64", 0xAA64: "aarch64"}


@dataclass(frozen=True)
class _FmuContents:
    """Contents of an FMU: its members, and the roots of its XML files by name."""

    names: list[str]
    roots: Mapping[str, Any]
    misbuilt: Mapping[str, str]
    """Messages on libraries for another processor in the folder of this platform."""


def store(archive: Archive, source: str, folder: Path) -> Path:
    """Write an FMU of a package into a temporary folder, under a number, since its name may be too long for a file."""
    path = folder / f"{sum(1 for _ in folder.iterdir())}.fmu"
    try:
        with path.open("wb") as file:
            archive.copy(source, file)
    except OSError as error:
        raise StorageError(
            f"{path}: cannot be written: {error.strerror}; free space there, or name another folder in TMPDIR"
        ) from error
    return path


def check_unit(
    path: Path, run: bool = True, name: str = "", outer: Archive | None = None
) -> tuple[Findings, str | None]:
    """Check an FMU of FMI 1.0, 2.0 or 3.0; return the standard too, such as ``FMI 2.0``, None if not stated.

    `run`: without other faults, make ten steps in another process and compare with reference results. `name` is its
    name in messages, by default the file's, `outer` the package around it; both share the limit of unpacked bytes.
    """
    findings, standard = _examine(path, name or path.name, outer)
    if not run:
        findings.note("RUN006", "not run (--no-run): the binary was not loaded")
    elif findings.problems:
        findings.notes.append(NOT_RUN)
    else:
        from vdfmu.engine.inspect.trial import run_apart

        findings.add(run_apart(path))
    return findings, standard


def _examine(path: Path, name: str, outer: Archive | None) -> tuple[Findings, str | None]:
    """Check all that needs no run; for arguments and result see `check_unit`."""
    findings = Findings()
    try:
        unit = _read(path, name, findings, outer)
    except SspError as error:
        text = f"{name} is not a readable FMU"
        return Findings([p.reworded(f"{text}: {p.removeprefix(f'{name}: ')}") for p in error.problems]), None
    root = unit.roots[DESCRIPTION]
    version = root.get("fmiVersion")
    standard = f"FMI {version}" if version else None
    if not _VERSION.fullmatch(version or ""):
        got = f"fmiVersion is {version!r}" if version else "has no fmiVersion"
        findings.problem("FMI002", f"{DESCRIPTION}: {got}; expected 1.0, 2.0 or 3.0", root)
        return findings, standard
    if version == "1.0":
        text = "FMI 1.0: fmpy and other importers run it, the master of vdfmu takes FMI 2.0 and 3.0"
        findings.note("RUN008", text, root)
    broken, mended = _rules(unit)
    findings.add(broken)
    try:
        description: Any = fmpy.read_model_description(str(path), validate=False)
    except Exception:  # fmpy raises bare exceptions for unexpected elements; `_rules` reports them
        description = mended
    if description is None:
        return findings, standard
    interfaces = ("coSimulation", "modelExchange", "scheduledExecution")
    kinds = [name for name in interfaces if getattr(description, name, None) is not None]
    if version != "1.0" and "coSimulation" not in kinds:
        findings.note("FMI019", "no co-simulation: a master needs it; other importers bring a solver", root)
    if not any("'DefaultExperiment'" in problem for problem in findings.problems):  # by the schema
        findings.problems += _experiment(description)
    _binaries(unit, description, kinds, findings)
    return findings, standard


def _rules(unit: _FmuContents) -> tuple[Findings, Any]:
    """Return the breaches of the schema and of the rules of the standard, and fmpy's description of the rest."""
    root = unit.roots[DESCRIPTION]
    ours = variable_faults(root)
    if TERMINALS in unit.roots:
        ours += terminal_faults(unit.roots[TERMINALS], root)
    for name, other in unit.roots.items():
        if name.endswith(f"/{MANIFEST}"):
            ours += manifest_faults(name, other)
    references = unit.roots.get(REFERENCES + MANIFEST)
    notes = [] if references is None else related_notes(references)
    build = build_faults(root, unit.roots.get(BUILD), unit.names)
    problems, description = description_faults(root)
    if description is None:  # breaches of the schema hide all others
        return Findings(problems), None
    return Findings([*problems, *ours, *build.problems], [*notes, *build.notes]), description


def _experiment(description: Any) -> list[Finding]:
    """Return the faults of the times of the default experiment."""
    experiment = description.defaultExperiment
    problems: list[Finding] = []

    def fault(text: str) -> None:
        problems.append(finding("FMI016", f"{DESCRIPTION}: DefaultExperiment: {text}", (DESCRIPTION, 0)))

    times: dict[str, float] = {}
    for name in ("startTime", "stopTime", "stepSize"):
        if (text := getattr(experiment, name, None)) is None:
            continue
        try:
            times[name] = float(text)
        except ValueError:
            times[name] = math.nan
        if not math.isfinite(times[name]) or (name == "stepSize" and times[name] <= 0.0):
            wanted = "a positive number" if name == "stepSize" else "a finite number"
            fault(f"{name} is {text!r}; expected {wanted}")
    start, stop = times.get("startTime", 0.0), times.get("stopTime", math.inf)
    if not problems and stop < start:
        fault(f"stopTime {stop:g} lies before startTime {start:g}")
    return problems


def _read(path: Path, label: str, findings: Findings, outer: Archive | None) -> _FmuContents:
    """Read the contents of an FMU; report and skip refused XML."""
    with Archive(path, label, outer) as archive:
        findings.notes += archive.notes
        if DESCRIPTION not in archive:
            hint = "; it is a package of SSP, name it .ssp" if "SystemStructure.ssd" in archive else ""
            raise breach("FMI001", f"it has no {DESCRIPTION!r}{hint}")
        root = parse_xml(archive.read(DESCRIPTION), DESCRIPTION)
        if root.tag != "fmiModelDescription":
            raise breach("FMI001", f"{DESCRIPTION}: expected the root fmiModelDescription, got {root.tag!r}", root)
        roots, misbuilt = {DESCRIPTION: root}, dict[str, str]()
        for name in archive.names:
            if name.endswith(".xml") and name.startswith(_XML_FOLDERS):
                try:
                    roots[name] = parse_xml(archive.read(name), name)
                except SspError as error:
                    findings.problems += error.problems
            if name.startswith("binaries/") and name.count("/") == 2 and name.endswith(tuple(_MAGIC)):
                data = archive.head(name)
                if not data.startswith(_MAGIC[posixpath.splitext(name)[1]]):
                    findings.problem("FMI018", f"{name}: is not a shared library of the kind in its name")
                elif name.split("/")[1] in (fmpy.platform, fmpy.platform_tuple):
                    processor = _architecture(data)
                    if processor not in (None, fmpy.architecture):
                        text = f"is compiled for {processor}, this platform needs {fmpy.architecture}"
                        misbuilt[name] = f"{name}: {text}; build the FMU for it"
        return _FmuContents(archive.names, roots, misbuilt)


def _binaries(unit: _FmuContents, description: Any, kinds: list[str], findings: Findings) -> None:
    """Check that there is a binary for this platform."""
    names = unit.names
    folders = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") >= 2})
    here = [p for p in (fmpy.platform, fmpy.platform_tuple) if p in folders]
    if not here:
        has_sources = any(n.startswith("sources/") and n.endswith((".c", ".cpp", ".cc")) for n in names)
        sources = "; compile its sources first" if has_sources else ""
        text = f"no binary for this platform, {fmpy.platform}; there are: {', '.join(folders) or 'none'}{sources}"
        findings.problem("FMI017", text)
        return
    for identifier in sorted({str(getattr(description, kind).modelIdentifier) for kind in kinds}):
        libraries = [f"binaries/{p}/{identifier}{fmpy.sharedLibraryExtension}" for p in here]
        here_too = [name for name in libraries if name in names]
        if not here_too:
            folder, library = posixpath.split(libraries[0])
            findings.problem("FMI017", f"{folder} has no {library}, as the model identifier asks for")
        findings.problems += [finding("FMI018", unit.misbuilt[name]) for name in here_too if name in unit.misbuilt]


def _architecture(data: bytes) -> str | None:
    """Return the processor of an ELF or PE library; None if the header does not state it."""
    try:
        if data.startswith(b"\x7fELF"):
            (number,) = struct.unpack_from("<H" if data[5] == 1 else ">H", data, 18)
            return _ELF.get(number, f"processor {number} (e_machine)")
        if data.startswith(b"MZ"):
            (head,) = struct.unpack_from("<I", data, 0x3C)
            (number,) = struct.unpack_from("<H", data, head + 4)
            name = _PE.get(number, f"processor {number:#x} (PE machine)")
            return name if data[head : head + 4] == b"PE\0\0" else None
    except (struct.error, IndexError):  # truncated; loading reports it
        pass
    return None
