"""Check of an FMU or a system: schema, rules of the standard, binaries, a short run, reference results."""

from __future__ import annotations

import html
import os
import posixpath
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from vdfmu.base.errors import SspError, StorageError, UsageError
from vdfmu.base.files import pack_zip
from vdfmu.base.temporary import temporary_folder
from vdfmu.engine.inspect.findings import Findings, one_line
from vdfmu.engine.inspect.fmu import check_unit
from vdfmu.engine.inspect.package import check_package
from vdfmu.engine.package.archive import is_inside
from vdfmu.engine.package.read import DEFAULT
from vdfmu.engine.rules import Finding

FORMAT = 1
"""Version of the structure of `Report`; it changes when a key changes its meaning or is removed."""
_ENDINGS = (".fmu", ".ssp", ".ssd")


@dataclass
class Report(Findings):
    """Result of the check of a file; `vdfmu check --json` prints these keys."""

    file: str = ""
    """The path as it was given."""
    kind: str = ""
    """``FMU``, ``SSP`` or ``SSD``."""
    standard: str | None = None
    """Such as ``FMI 3.0``; None where the file does not get that far."""

    @classmethod
    def of(cls, findings: Findings, path: Path, kind: str, standard: str | None = None) -> Report:
        """Return the report on a file: each finding once, in a line."""
        problems, notes = (list(dict.fromkeys(map(one_line, texts))) for texts in (findings.problems, findings.notes))
        return cls(problems, notes, findings.compared, findings.ran, str(path), kind, standard)

    def to_dict(self) -> dict[str, Any]:
        """Return the report for JSON; ``findings`` are problems and notes with rule and place."""
        head = {name: getattr(self, name) for name in ("file", "kind", "standard", "ran", "compared")}
        findings = [
            {
                "rule": text.rule.number, "severity": severity, "file": text.file or None, "line": text.line or None,
                "message": str(text), "way_out": text.rule.way,
            }
            for severity, texts in (("problem", self.problems), ("note", self.notes))
            for text in texts
        ]  # fmt: skip
        texts = {"problems": self.problems, "notes": self.notes}
        return {"format": FORMAT, **head, **texts, "findings": findings}


def inspect_file(
    path: str | os.PathLike[str], run: bool = True, say: Callable[[str], None] = lambda text: None
) -> Report:
    """Check an FMU, an SSP or an SSD, by the ending of its name.

    Parameters
    ----------
    path : path
        ``.fmu``; ``.ssp``; ``.ssd`` with its resources next to it.
    run : bool, optional
        Whether to make ten steps of the unit or system and to compare an FMU with the reference results that it
        may carry (FMI-LS-REF). That runs the units' code, in a process of its own.
    say : callable, optional
        Called with the file, which can be read, before its code may run.

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
        say(f"{path}, unless reading finds problems,")
    try:
        return _inspect(path, suffix, run)
    except OSError as error:
        raise StorageError(
            f"{path}: was not checked: {error}. The check needs a temporary folder with free space; "
            "TMPDIR names another one."
        ) from error


def _inspect(path: Path, suffix: str, run: bool) -> Report:
    if suffix == ".fmu":
        findings, standard = check_unit(path, run)
        return Report.of(findings, path, "FMU", standard)
    with temporary_folder("vdfmu_check_") as folder:
        package = path
        if suffix == ".ssd":
            package = Path(folder, path.name)  # the name in messages: there is no package
            try:
                _pack(path, package)
            except SspError as error:
                return Report.of(Findings(error.problems), path, "SSD")
        findings, standard = check_package(package, Path(folder), run)
        if suffix == ".ssd":
            findings = _renamed(findings, f"{path.name}: {DEFAULT}", path.name)
    return Report.of(findings, path, suffix[1:].upper(), standard)


def _renamed(findings: Findings, old: str, new: str) -> Findings:
    """Return findings with another name for a place."""
    problems, notes = (
        [Finding(text.replace(old, new), text.rule, text.file.replace(old, new), text.line) for text in texts]
        for texts in (findings.problems, findings.notes)
    )
    return replace(findings, problems=problems, notes=notes)


def _require(path: Path, suffix: str) -> None:
    """Raise UsageError for anything that cannot be checked."""
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
        raise UsageError(f"{path}: is not of a kind that can be checked; expected {', '.join(_ENDINGS)}.")


def _pack(ssd: Path, package: Path) -> None:
    """Pack an SSD with the files next to it that it names, and that SSDs among these files name."""
    members = {DEFAULT: ssd.read_bytes()}
    home = ssd.parent.resolve()
    waiting = [("", members[DEFAULT])]
    while waiting:
        base, text = waiting.pop()
        for found in re.findall(rb"""source\s*=\s*["']([^"']+)["']""", text):
            source = unquote(html.unescape(found.decode(errors="replace"))).partition("#")[0]
            name = posixpath.normpath(posixpath.join(base, source)) if source else ""
            if name in members or not is_inside(name):
                continue  # what points outside is reported by the check
            file = (home / name).resolve()
            if len(file.name) < 256 and file.is_file() and file.is_relative_to(home):
                members[name] = file.read_bytes()
                if name.lower().endswith(".ssd"):
                    waiting.append((posixpath.dirname(name), members[name]))
    pack_zip(package, members)
