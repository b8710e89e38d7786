"""Check of a system of SSP 1.0 or 2.0: the package, its files, the wiring, and every FMU."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

from vdfmu.base.errors import SspError
from vdfmu.base.standards import SSP_FORMATS
from vdfmu.engine.inspect.findings import Findings
from vdfmu.engine.inspect.fmi import REFERENCES
from vdfmu.engine.inspect.fmu import NOT_RUN, check_unit, store
from vdfmu.engine.inspect.trial import master_of, run_apart
from vdfmu.engine.package.archive import Archive, is_inside
from vdfmu.engine.package.parse import parse_xml, version_of
from vdfmu.engine.package.read import DEFAULT, read_system, variants
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.rules import Finding, finding


def check_package(path: Path, folder: Path, run: bool) -> tuple[Findings, str | None]:
    """Check every SSD of a package, and run the default one, and FMUs with reference results, if nothing is wrong.

    `folder` is for its FMUs. Returns the standard too, such as ``SSP 1.0``.
    """
    findings = Findings()
    heads: dict[str, Any] = {}
    try:
        with Archive(path, path.name) as archive:
            findings.notes += [
                finding("PKG007", f"entry {name!r} occurs more than once, with the same content")
                for name in archive.doubled
            ]
            names = variants(archive)
            if DEFAULT not in names:
                has = f"; it has {', '.join(names)}" if names else ""
                has += "; it is an FMU, name it .fmu" if "modelDescription.xml" in archive else ""
                return Findings([finding("SSP001", f"{path.name}: the package has no {DEFAULT!r}{has}")]), None
            for name in names:
                heads[name], broken = _head(archive, path.name, name)
                findings.add(broken, "" if name == DEFAULT else name)
            documented = any(name.startswith("documentation/") for name in archive.names)
            if documented and "documentation/index.html" not in archive:
                text = "has documentation/ without documentation/index.html, where readers start"
                findings.problem("SSP007", f"{path.name}: {text}")
            findings.notes += _same_names(heads)
    except SspError as error:
        return Findings(error.problems), None
    stored: dict[str, Path] = {}
    for name in heads:
        findings.add(_check_variant(path, name, folder, stored), "" if name == DEFAULT else name)
    if run and findings.problems:
        findings.notes.append(NOT_RUN)
    elif run:
        findings.add(run_apart(path, "SSP"))
        for source, fmu in stored.items():
            with Archive(fmu, source) as archive:
                has = any(name.startswith(REFERENCES) for name in archive.names)
            if has:
                findings.add(run_apart(fmu), source, f"{path.name}: {source}")
    version = heads[DEFAULT].get("version") if heads[DEFAULT] is not None else None
    return findings, f"SSP {version}" if version else None


def _check_variant(path: Path, variant: str, folder: Path, stored: dict[str, Path]) -> Findings:
    """Check one SSD, and each of its FMUs that is not yet among those in the folder, whatever else is wrong."""
    system, problems = read_system(path, variant)
    findings, units = Findings(list(problems)), dict[str, list[Finding]]()
    with Archive(path, path.name) as archive:
        sources = [n for n in archive.names if n.lower().endswith(".fmu")]
        if system is not None:
            sources = [c.source for c in system.components if c.source]
        for source in dict.fromkeys(sources):
            if source in stored:
                continue
            try:
                stored[source] = store(archive, source, folder)
                unit, _ = check_unit(stored[source], False, posixpath.basename(source), archive)
                units[source] = unit.problems
            except SspError as error:
                units[source] = error.problems
    if system is not None:
        findings.problems += system.faults
        try:
            checked = check_system(system, algorithm=master_of(system), ignore_unmatched=True)
            problems, notes = [], cast("list[Finding]", [*checked.notes])  # others are of values that are given
        except SspError as error:
            problems, notes = error.problems, [*error.notes]
        findings.notes += notes
        starts = tuple(f"{c.name}: {c.source}: " for c in system.components if units.get(c.source))
        new = [each for each in problems if not (each.startswith(starts) and each.rule.number.startswith(_OF_UNIT))]
        findings.problems = list(dict.fromkeys([*findings.problems, *new]))
    for source, faults in units.items():
        findings.add(Findings(faults), source, f"{path.name}: {source}")
    return findings


_OF_UNIT = ("FMI", "PKG")
"""Rules whose breach the check of an FMU reports, too."""


def _same_names(heads: Mapping[str, Any]) -> list[Finding]:
    """Return notes on SSDs of one package that cannot be told apart by their names."""
    users: dict[str, list[str]] = {}
    for file, root in heads.items():
        users.setdefault("" if root is None else root.get("name") or "", []).append(file)
    text = "have the same name, {!r}, by which tools let users choose"
    return [
        finding("SSP006", f"{' and '.join(files)}: {text.format(name)}")
        for name, files in users.items()
        if name and len(files) > 1
    ]


def _head(archive: Archive, label: str, name: str) -> tuple[Any, Findings]:
    """Return the root of an SSD, None where it cannot be read, and notes on its version and its icons."""
    try:
        root = parse_xml(archive.read(name), f"{label}: {name}")
    except SspError:
        return None, Findings()  # reported by its check
    version = root.get("version")
    notes: list[Finding] = []
    if version and version not in SSP_FORMATS:
        text = f"the SSD states version {version!r}; it was checked as SSP {version_of(root)}"
        notes.append(finding("SSP005", text, root))
    for element in root.iter():
        icon = element.get("iconSource")
        member = posixpath.normpath(unquote(icon)) if icon else ""
        if is_inside(member) and member not in archive:
            owner = element.getparent().get("name") or "the system"
            notes.append(finding("SSP008", f"{owner}: icon: the package has no {icon!r}", element))
    return root, Findings(notes=notes)
