"""Check of an FMU or a system: schema, rules of the standard, binaries, a short run, reference results."""

from __future__ import annotations

import html
import os
import posixpath
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

from vdfmu.base.errors import SspError, UsageError
from vdfmu.base.files import no_temporary, pack_zip, temporary_folder
from vdfmu.base.standards import SSP_FORMATS
from vdfmu.engine.inspect.description import REFERENCES
from vdfmu.engine.inspect.fmu import check_unit, note_run, store
from vdfmu.engine.inspect.trial import master_of, run_apart
from vdfmu.engine.package.archive import Archive, is_inside
from vdfmu.engine.package.parse import parse_xml, version_of
from vdfmu.engine.package.read import DEFAULT, read_system, variants
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.rules import Finding, Findings, finding, one_line

FORMAT = 1
"""Version of the structure of `Report`. It increases when a key changes its meaning or is removed."""
_ENDINGS = (".fmu", ".ssp", ".ssd")


@dataclass
class Report(Findings):
    """Result of the check of a file; `vdfmu check --json` prints these keys."""

    file: str = ""
    """The path, as the user wrote it."""
    kind: str = ""
    """``FMU``, ``SSP`` or ``SSD``."""
    standard: str | None = None
    """The standard, such as ``FMI 3.0``; None if the file cannot be read."""

    @classmethod
    def of(cls, findings: Findings, path: Path, kind: str, standard: str | None = None) -> Report:
        """Return the report on a file with each finding once, as one line."""
        lines = list(dict.fromkeys(map(one_line, findings.entries)))
        return cls(lines, findings.compared, findings.ran, str(path), kind, standard)

    def to_dict(self) -> dict[str, Any]:
        """Return the report for JSON; ``findings`` are problems and notes with rule and place."""
        head = {name: getattr(self, name) for name in ("file", "kind", "standard", "ran", "compared")}
        findings = [
            {
                "rule": text.rule.number,
                "severity": text.rule.severity,
                "file": text.file or None,
                "line": text.line or None,
                "message": str(text),
                "fix": text.rule.way,
            }
            for text in (*self.problems, *self.notes)
        ]
        return {"format": FORMAT, **head, "problems": self.problems, "notes": self.notes, "findings": findings}


def inspect_file(
    path: str | os.PathLike[str], run: bool = True, say: Callable[[str], None] = lambda text: None, anyway: bool = False
) -> Report:
    """Check an FMU, an SSP or an SSD, depending on the suffix of its name.

    Parameters
    ----------
    path : path
        ``.fmu``; ``.ssp``; ``.ssd`` with its resources next to it.
    run : bool, optional
        Whether to make ten steps of the unit or system, and to compare an FMU with its reference results
        (FMI-LS-REF). Both run the units' code, in another process.
    say : callable, optional
        Called with the file before its code may run.
    anyway : bool, optional
        Whether to also run FMUs that break rules of FMI, such as a model structure with missing entries.

    Raises
    ------
    UsageError
        If the file does not exist, cannot be opened, or has another ending.
    StorageError
        If the temporary folder cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    _require(path, suffix)
    if run:
        say(f"{path}{'' if anyway else ' (unless the file has problems)'}")
    try:
        return _inspect(path, suffix, run, anyway)
    except OSError as error:
        raise no_temporary(f"{path} was not checked", error) from error


def _inspect(path: Path, suffix: str, run: bool, anyway: bool) -> Report:
    if suffix == ".fmu":
        findings, standard = check_unit(path, run, anyway=anyway)
        return Report.of(findings, path, "FMU", standard)
    with temporary_folder("vdfmu_check_") as folder:
        package = path
        if suffix == ".ssd":
            package = Path(folder, path.name)  # with the name for messages
            try:
                _pack(path, package)
            except SspError as error:
                return Report.of(Findings(error.problems), path, "SSD")
        findings, standard = check_package(package, Path(folder), run, anyway)
        if suffix == ".ssd":
            findings = _renamed(findings, f"{path.name}: {DEFAULT}", path.name)
    return Report.of(findings, path, suffix[1:].upper(), standard)


def _renamed(findings: Findings, old: str, new: str) -> Findings:
    entries = (
        Finding(each.replace(old, new), each.rule, each.file.replace(old, new), each.line) for each in findings.entries
    )
    return replace(findings, entries=[*entries])


def _require(path: Path, suffix: str) -> None:
    """Raise UsageError unless the file can be checked."""
    if path.is_dir():
        inside = path / DEFAULT
        hint = f"; give {inside}" if inside.is_file() else f"; expected a file, {', '.join(_ENDINGS)}"
        raise UsageError(f"{path}: is a folder{hint}.")
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    try:
        path.open("rb").close()
    except OSError as error:
        raise UsageError(f"{path}: cannot be opened: {error.strerror}.") from error
    if suffix not in _ENDINGS:
        raise UsageError(f"{path}: has a type that cannot be checked; expected {', '.join(_ENDINGS)}.")


def _pack(ssd: Path, package: Path) -> None:
    """Pack an SSD with its sources next to it."""
    members = {DEFAULT: ssd.read_bytes()}
    home = ssd.parent.resolve()
    for value in re.findall(rb"""source\s*=\s*["']([^"']+)["']""", members[DEFAULT]):
        name = posixpath.normpath(unquote(html.unescape(value.decode(errors="replace"))))
        if name in members or not is_inside(name):
            continue  # the check reports sources outside the folder
        file = (home / name).resolve()
        if len(file.name) < 256 and file.is_file() and file.is_relative_to(home):
            members[name] = file.read_bytes()
    pack_zip(package, members)


def check_package(path: Path, folder: Path, run: bool, anyway: bool = False) -> tuple[Findings, str | None]:
    """Check every SSD of a package. Without faults, run the default SSD and the FMUs with reference results.

    `folder` is for its FMUs. For `anyway` see `note_run`. Returns the standard too, such as ``SSP 1.0``.
    """
    findings = Findings()
    heads: dict[str, Any] = {}
    try:
        with Archive(path, path.name) as archive:
            findings.entries += archive.notes
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
                findings.report("SSP007", f"{path.name}: {text}")
            findings.entries += _same_names(heads)
    except SspError as error:
        return Findings(error.problems), None
    stored: dict[str, Path] = {}
    for name in heads:
        findings.add(_check_variant(path, name, folder, stored), "" if name == DEFAULT else name)
    if run and note_run(findings, anyway):
        findings.add(run_apart(path, "SSP"))
        for source, fmu in stored.items():
            with Archive(fmu, source) as archive:
                has = any(name.startswith(REFERENCES) for name in archive.names)
            if has:
                findings.add(run_apart(fmu), source, f"{path.name}: {source}")
    version = heads[DEFAULT].get("version") if heads[DEFAULT] is not None else None
    return findings, f"SSP {version}" if version else None


def _check_variant(path: Path, variant: str, folder: Path, stored: dict[str, Path]) -> Findings:
    """Check an SSD and, even if there are faults, each of its FMUs that is not yet `stored`."""
    system, problems = read_system(path, variant)
    findings, units = Findings([*problems]), dict[str, list[Finding]]()
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
        findings.entries += system.faults
        try:
            checked = check_system(system, algorithm=master_of(system))
            new = cast("list[Finding]", [*checked.notes])  # without set values all are findings
        except SspError as error:
            new = [*error.problems, *error.notes]
        starts = tuple(f"{c.name}: {c.source}: " for c in system.components if units.get(c.source))
        new = [each for each in new if not (each.startswith(starts) and each.rule.number.startswith(_OF_UNIT))]
        findings.entries = list(dict.fromkeys([*findings.entries, *new]))
    for source, faults in units.items():
        findings.add(Findings(faults), source, f"{path.name}: {source}")
    return findings


_OF_UNIT = ("FMI", "PKG")
"""Rules that the check of an FMU covers too."""


def _same_names(heads: Mapping[str, Any]) -> list[Finding]:
    """Return notes on SSDs of a package that have the same name."""
    users: dict[str, list[str]] = {}
    for file, root in heads.items():
        users.setdefault("" if root is None else root.get("name") or "", []).append(file)
    text = "have the same name, {!r}; tools use it to let users choose"
    same = [(name, files) for name, files in users.items() if name and len(files) > 1]
    return [finding("SSP006", f"{' and '.join(files)}: {text.format(name)}") for name, files in same]


def _head(archive: Archive, label: str, name: str) -> tuple[Any, Findings]:
    """Return the root of an SSD, or None if it cannot be read, and notes on its version and icons."""
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
    return root, Findings(notes)
