"""Check of an FMU: its contents, the rules of FMI, its libraries, and a run."""

from __future__ import annotations

import math
import posixpath
import re
import struct
from collections import ChainMap
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import fmpy
from lxml.etree import QName  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.errors import SspError
from vdfmu.base.files import no_temporary
from vdfmu.engine.inspect.description import (
    DESCRIPTION,
    MANIFEST,
    REFERENCES,
    description_faults,
    schema_faults,
    types_of,
    variables_of,
)  # fmt: skip
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.rules import Finding, Findings, breach, can_run, finding, line_of

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
BUILD = "sources/buildDescription.xml"
_SHOWN = 5
"""Largest number of missing source files in a message."""
_VERSION = re.compile(r"[12]\.0|3\.0(\.\d+)?")
"""fmiVersion: fixed texts in FMI 1.0 and 2.0, with an optional third number in FMI 3.0."""
NOT_RUN = finding("RUN006", "not run: code of a file with problems is not run; fix them first")
RUN_ANYWAY = finding("RUN006", "run despite its problems (--run-anyway)")
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
    """Contents of an FMU: its members, and the root elements of its XML files by name."""

    names: list[str]
    roots: Mapping[str, Any]
    misbuilt: Mapping[str, str]
    """Messages about libraries for another processor in the folder of this platform."""


def store(archive: Archive, source: str, folder: Path) -> Path:
    """Write an FMU of a package into a temporary folder, named by a number because its name may be too long."""
    path = folder / f"{sum(1 for _ in folder.iterdir())}.fmu"
    try:
        with path.open("wb") as file:
            archive.copy(source, file)
    except OSError as error:
        raise no_temporary(source, error) from error
    return path


def note_run(findings: Findings, anyway: bool) -> bool:
    """Return whether to run a file with these findings, and note the reason; `anyway` ignores faults of FMUs."""
    problems = findings.problems
    if not all(anyway and can_run(problem) for problem in problems):
        findings.entries.append(NOT_RUN)
        return False
    findings.entries += [RUN_ANYWAY] if problems else []
    return True


def check_unit(
    path: Path, run: bool = True, name: str = "", outer: Archive | None = None, anyway: bool = False
) -> tuple[Findings, str | None]:
    """Check an FMU of FMI 1.0, 2.0 or 3.0; return the standard too, such as ``FMI 2.0``, None if not stated.

    `run`: without other faults, make ten steps in another process and compare with reference results. `name` is its
    name in messages, by default the file's, `outer` the package around it; both share the limit of unpacked bytes. For
    `anyway` see `note_run`.
    """
    findings, standard = _examine(path, name or path.name, outer)
    if not run:
        findings.report("RUN006", "not run (--no-run): the binary was not loaded")
    elif note_run(findings, anyway):
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
        findings.report("FMI002", f"{DESCRIPTION}: {got}; expected 1.0, 2.0 or 3.0", root)
        return findings, standard
    if version == "1.0" and root.find("Implementation") is None:
        text = "FMI 1.0 for model exchange: fmpy runs it, but vdfmu's master runs FMI 1.0 only for co-simulation"
        findings.report("RUN008", text, root)
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
    if kinds == ["scheduledExecution"]:
        if outer is None:  # in a package, the check of its system reports it
            text = "expected an FMU for CoSimulation or ModelExchange, got one for ScheduledExecution"
            findings.report("RUN007", text, root)
    elif version != "1.0" and "coSimulation" not in kinds:
        findings.report("FMI019", "no co-simulation: it needs an importer with a solver, such as vdfmu's master", root)
    if not any("'DefaultExperiment'" in problem for problem in findings.problems):  # by the schema
        findings.entries += _experiment(description)
    _binaries(unit, description, kinds, findings)
    return findings, standard


def _rules(unit: _FmuContents) -> tuple[Findings, Any]:
    """Return the violations of the schema and of the standard's rules, and fmpy's description of the rest."""
    root = unit.roots[DESCRIPTION]
    ours = _variable_faults(root)
    if TERMINALS in unit.roots:
        ours += _terminal_faults(unit.roots[TERMINALS], root)
    for name, other in unit.roots.items():
        if name.endswith(f"/{MANIFEST}"):
            ours += _manifest_faults(name, other)
    references = unit.roots.get(REFERENCES + MANIFEST)
    notes = [] if references is None else related_notes(references)
    build = _build_faults(root, unit.roots.get(BUILD), unit.names)
    problems, description = description_faults(root)
    if description is None:  # violations of the schema hide all others
        return Findings(problems), None
    return Findings([*problems, *ours, *build, *notes]), description


def _experiment(description: Any) -> list[Finding]:
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
    """Read the contents of an FMU; report and skip invalid XML."""
    with Archive(path, label, outer) as archive:
        findings.entries += archive.notes
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
                    findings.entries += error.problems
            if name.startswith("binaries/") and name.count("/") == 2 and name.endswith(tuple(_MAGIC)):
                data = archive.head(name)
                if not data.startswith(_MAGIC[posixpath.splitext(name)[1]]):
                    findings.report("FMI018", f"{name}: is not a shared library of the kind in its name")
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
        findings.report("FMI017", text)
        return
    for identifier in sorted({str(getattr(description, kind).modelIdentifier) for kind in kinds}):
        libraries = [f"binaries/{p}/{identifier}{fmpy.sharedLibraryExtension}" for p in here]
        if not {*libraries} & {*names}:
            folder, library = posixpath.split(libraries[0])
            findings.report("FMI017", f"{folder} has no {library}, as the model identifier requires")
        findings.entries += [finding("FMI018", unit.misbuilt[name]) for name in libraries if name in unit.misbuilt]


def _architecture(data: bytes) -> str | None:
    """Return the processor of an ELF or PE library, or None if the header does not state it."""
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


# ------------------------------------------------------------------ rules of FMI that fmpy does not check


def _variable_faults(root: Any) -> list[Finding]:
    """Return faults of variables: values outside of their ranges, nominal values, `initial`, aliases."""
    version, types = str(root.get("fmiVersion"))[0], types_of(root)
    faults: list[Finding] = []
    for item, value in variables_of(root):
        stated = _stated(value, types)
        texts = [("FMI009", _range_fault(stated)), ("FMI020", _nominal_fault(stated.get("nominal")))]
        if version == "2" and item.get("causality") == "input" and item.get("initial") is not None:
            text = f"initial is {item.get('initial')!r}; FMI 2.0 allows none where causality is 'input'"
            texts.append(("FMI010", text))
        where = f"{line_of(item)}: variable {item.get('name')!r}"
        faults += [finding(rule, f"{where}: {text}", item) for rule, text in texts if text]
    return faults + (_alias_faults(root, types) if version == "2" else [])


def _stated(value: Any, types: Mapping[str, Any]) -> ChainMap[str, str]:
    """Return the attributes of a variable, else of its type."""
    declared = types.get(value.get("declaredType"))
    return ChainMap(value.attrib, {} if declared is None else declared.attrib)


def _nominal_fault(text: str | None) -> str:
    """Return the fault of a nominal value, with which importers scale tolerances."""
    if text is None or _number(text) is None or (math.isfinite(float(text)) and float(text)):
        return ""
    return f"nominal is {text}; expected a finite number other than 0"


def _manifest_faults(name: str, root: Any) -> list[Finding]:
    stated = {QName(each).localname for each, text in root.attrib.items() if text}
    missing = [key for key in ("fmi-ls-name", "fmi-ls-version") if key not in stated]
    return [finding("FMI021", f"{name}: {' and '.join(missing)} missing", root)] if missing else []


_ROLES = (
    "document", "requirement", "specification", "model", "parameter", "system", "testcase", "experiment", "result",
    "method", "rationale", "report", "request", "delivery", "configuration", "signature", "serialized-state",
    "meta-data", "other",
)  # fmt: skip
_PURPOSES = ("smoke-test", "validation", "uncertainty-analysis")
"""Roles of related files, and purposes after experiment/ (FMI-LS-REF 1.0.0-alpha.1, July 2026)."""


def related_notes(root: Any) -> list[Finding]:
    """Return violations of the draft FMI-LS-REF in its manifest."""
    faults: list[tuple[str, Any]] = []
    if root.tag != "fmiReferences":
        faults.append((f"{REFERENCES}{MANIFEST}: expected the root fmiReferences, got {root.tag!r}", root))
    for item in root.iterfind("Related"):
        where = f"{line_of(item)}: {item.get('source')!r}"
        if not item.get("source"):
            faults.append((f"{line_of(item)}: a related file has no source", item))
        role, slash, purpose = (item.get("role") or "").partition("/")
        free = role == "serialized-state" or not slash or (role == "experiment" and purpose in _PURPOSES)
        if role not in _ROLES or not free:
            faults.append((f"{where}: role is {item.get('role')!r}; expected one of {', '.join(_ROLES)}", item))
        if any(not label.get("name") for label in item.iterfind("Label")):
            faults.append((f"{where}: a label has no name", item))
    return [finding("FMI022", text, item) for text, item in faults]


def _range_fault(stated: Mapping[str, str]) -> str:
    """Return a fault unless min <= start <= max."""
    low, high = (_number(stated.get(name)) for name in ("min", "max"))
    if low is not None and high is not None and low > high:
        return f"min {stated['min']} is above max {stated['max']}"
    numbers = ((text, _number(text)) for text in stated.get("start", "").split())
    for text, number in ((text, number) for text, number in numbers if number is not None):
        if low is not None and number < low:
            return f"start {text} is below min {stated['min']}"
        if high is not None and number > high:
            return f"start {text} is above max {stated['max']}"
    return ""


def _number(text: str | None) -> float | None:
    """Return the number in a text, integers exactly; None if the text violates the schema."""
    for read in (int, float):
        with suppress(ValueError):
            return None if text is None else read(text)
    return None


def _alias_faults(root: Any, types: Mapping[str, Any]) -> list[Finding]:
    """Return the faults of FMI 2.0 variables that share a value reference (2.2.7)."""
    shared: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
    for item, value in variables_of(root):
        base = "Integer" if value.tag == "Enumeration" else value.tag
        shared.setdefault((base, item.get("valueReference")), []).append((item, value))
    faults: list[Finding] = []
    for (_, reference), aliases in shared.items():
        if len(aliases) < 2:
            continue
        names, first = ", ".join(repr(item.get("name")) for item, _ in aliases), aliases[0][0]
        where = f"{line_of(first)}: {names} share value reference {reference}"

        def fault(text: str, where: str = where, first: Any = first) -> None:
            faults.append(finding("FMI011", f"{where}: {text}", first))

        constant = [item.get("variability") == "constant" for item, _ in aliases]
        starts = [value.get("start") for _, value in aliases if value.get("start") is not None]
        if any(constant) and not all(constant):
            fault("a constant may share it only with constants")
        elif any(constant) and len({s if (number := _number(s)) is None else number for s in starts}) > 1:
            fault(f"constants must have the same start value, they have {', '.join(starts)}")
        elif not any(constant) and len(starts) > 1:
            fault(f"one of them may have a start value, {len(starts)} have")
        stated = [_stated(value, types).get("unit") for _, value in aliases]
        units = [repr(unit) if unit else "none" for unit in stated]
        if len(set(units)) > 1:
            fault(f"they must have the same unit, they have {', '.join(dict.fromkeys(units))}")
    return faults


def _build_faults(root: Any, build: Any, names: Collection[str]) -> list[Finding]:
    """Return the faults of the source files in the model description or a build description."""
    where, listed = DESCRIPTION, root.iterfind("*/SourceFiles/File")
    if build is not None:
        version = build.get("fmiVersion") or "none"
        if not version.startswith("3."):
            return [finding("FMI002", f"{BUILD}: fmiVersion is {version!r}; expected 3.0", build)]
        faults = schema_faults(build, "fmi3/fmi3BuildDescription.xsd", BUILD)
        if faults:
            return faults
        where, listed = BUILD, build.iterfind(".//SourceFile")
    files = dict.fromkeys(str(item.get("name")) for item in listed)
    missing = [f for f in files if not {posixpath.normpath(f"sources/{n}") for n in (f, unquote(f))} & {*names}]
    if not missing:
        return []
    shown = ", ".join(map(repr, missing[:_SHOWN])) + (f" and {len(missing) - _SHOWN} more" if missing[_SHOWN:] else "")
    text = f"{where}: lists source files that are not in sources/: {shown}"
    stripped = not any(name.startswith("sources/") and name != BUILD for name in names)
    if stripped and any(name.startswith("binaries/") for name in names):
        text += "; without sources it runs only with its binaries"
        return [finding("FMI024", text, (where, 0))]
    return [finding("FMI014", text, (where, 0))]


def _terminal_faults(terminals: Any, root: Any) -> list[Finding]:
    """Return the names in terminals that are not variables of the model description."""
    names = {each.get("name") for item, _ in variables_of(root) for each in (item, *item.iterfind("Alias"))}
    return [
        finding("FMI015", f"{line_of(item)}: {item.tag}: {DESCRIPTION} has no variable {item.get(attribute)!r}", item)
        for item in terminals.iter()
        for attribute in ("variableName", "inStreamVariableName", "outStreamVariableName")
        if item.get(attribute) is not None and item.get(attribute) not in names
    ]
