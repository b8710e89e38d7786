"""What a check finds."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["Findings", "one_line"]


@dataclass
class Findings:
    """Problems and notes of a file, or of a part of one.

    Attributes
    ----------
    problems : list of str
        What is wrong: one sentence or more each, with the place.
    notes : list of str
        Notes, not errors, such as what could not be checked and why.
    compared : list of str
        Files of reference results inside FMUs whose values were compared.
    ran : bool
        Whether code of the file was run.
    """

    problems: list[str] = field(default_factory=list[str])
    notes: list[str] = field(default_factory=list[str])
    compared: list[str] = field(default_factory=list[str])
    ran: bool = False

    def add(self, other: Findings, where: str = "") -> None:
        """Take over what another check found, with its place before each sentence."""
        self.ran = self.ran or other.ran
        for mine, others in (
            (self.problems, other.problems),
            (self.notes, other.notes),
            (self.compared, other.compared),
        ):
            mine += [f"{where}: {text}" if where else text for text in others]

    def renamed(self, old: str, new: str) -> Findings:
        """Return the findings with another name for a place."""
        problems, notes = (
            [text.replace(old, new) for text in texts] for texts in (self.problems, self.notes)
        )
        return Findings(problems, notes, self.compared, self.ran)


def one_line(text: str) -> str:
    """Return a text without line breaks: a problem is one line, whatever a foreign parser or unit says."""
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())
