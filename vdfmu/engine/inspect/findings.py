"""Findings of a check."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from vdfmu.base.text import elided
from vdfmu.engine.rules import Finding, finding


@dataclass
class Findings:
    """Problems and notes of a file, or of a part of one."""

    problems: list[Finding] = field(default_factory=list[Finding])
    """Faults: one sentence or more each, with the place."""
    notes: list[Finding] = field(default_factory=list[Finding])
    """Notes, not errors, such as what could not be checked and why."""
    compared: list[str] = field(default_factory=list[str])
    """Files of reference results inside FMUs whose values were compared."""
    ran: bool = False
    """Whether code of the file was run."""

    def problem(self, rule: str, text: str, at: Any = ("", 0)) -> None:
        """Add a fault; for `at` see `finding`."""
        self.problems.append(finding(rule, text, at))

    def note(self, rule: str, text: str, at: Any = ("", 0)) -> None:
        """Add a note."""
        self.notes.append(finding(rule, text, at))

    def add(self, other: Findings, where: str = "", file: str = "") -> None:
        """Add the findings of another check, with its place before each sentence, and `file` before each file."""
        self.ran = self.ran or other.ran
        self.problems += _placed(other.problems, where, file)
        self.notes += _placed(other.notes, where, file)
        self.compared += [f"{where}: {name}" if where else name for name in other.compared]


def _placed(findings: Iterable[Finding], where: str, file: str) -> Iterable[Finding]:
    for each in findings:
        within = f"{file}: {each.file}".removesuffix(": ") if file else each.file
        yield Finding(each.within(where), each.rule, within, each.line)


def one_line(text: Finding) -> Finding:
    """Return a finding without line breaks, and bounded: it is one line, whatever a parser or unit says."""
    return text.reworded(elided("; ".join(line.strip() for line in text.splitlines() if line.strip())))
