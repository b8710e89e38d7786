"""Findings of a check."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from vdfmu.base.text import elided
from vdfmu.engine.rules import Finding, finding, reworded, within


@dataclass
class Findings:
    """Problems and notes of a file, or of a part of one."""

    problems: list[str] = field(default_factory=list[str])
    """Faults: one sentence or more each, with the place."""
    notes: list[str] = field(default_factory=list[str])
    """Notes, not errors, such as what could not be checked and why."""
    compared: list[str] = field(default_factory=list[str])
    """Files of reference results inside FMUs whose values were compared."""
    ran: bool = False
    """Whether code of the file was run."""

    def problem(self, rule: str, text: str, at: Any = ("", 0)) -> None:
        """Add a fault; for `at` see `found`."""
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


def _placed(texts: Iterable[str], where: str, file: str) -> Iterable[str]:
    for text in texts:
        text = within(where, text)
        if file and isinstance(text, Finding):
            text = Finding(text, text.rule, f"{file}: {text.file}".removesuffix(": "), text.line)
        yield text


def one_line(text: str) -> str:
    """Return a text without line breaks, and bounded: a problem is one line, whatever a parser or unit says."""
    return reworded(text, elided("; ".join(line.strip() for line in text.splitlines() if line.strip())))
