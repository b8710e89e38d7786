"""The verdict on a run: its checks, the state of each, and the line that says it.

A run makes it once and keeps it in its summary. Terminal, page, gallery and exit code read it from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

GOOD, DOUBTFUL, FAILED = STATES = ("good", "doubtful", "failed")
"""States of a check, the worst last. A run has the state of its worst check; a failed one ends with exit code 1."""
SIGNS = {GOOD: "\u2713", DOUBTFUL: "!", FAILED: "\u2717"}
_LONGEST = 160
"""Most characters of a check that is quoted in the line."""


class Check(NamedTuple):
    """One check of a run."""

    name: str
    state: str
    text: str
    """The result, and the limit that it was compared with."""
    words: str = ""
    """The result in the line of a run that is not good. The line quotes a check without words if it needs one."""


def verdict_of(checks: Sequence[Check], numbers: str = "") -> dict[str, Any]:
    """Return the entry ``verdict`` of a summary: ``state``, ``words``, and ``checks`` with name, state and text.

    Parameters
    ----------
    checks : sequence of Check
        The first one is told first. Without any the run was not judged, and is doubtful.
    numbers : str
        The words of a good run, and the last ones of a doubtful run.
    """
    state = max((check.state for check in checks), key=STATES.index, default=DOUBTFUL)
    others = [check for check in checks if check.state != GOOD]
    told = [check.words for check in others if check.words]
    if not any(check.words for check in others if check.state == state):
        told += [_short(f"{check.name}: {check.text}") for check in others if check.state == state][:1]
    told += [] if checks else ["not judged, since no check applies to this run"]
    told += [numbers] if numbers and state != FAILED else []
    kept = [{"name": check.name, "state": check.state, "text": check.text} for check in checks]
    return {"state": state, "words": "; ".join(told), "checks": kept}


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def checks_of(summary: Mapping[str, Any]) -> list[Check]:
    """Return the checks of a run from its summary; empty if it has no verdict."""
    return [Check(each["name"], each["state"], each["text"]) for each in _verdict(summary).get("checks", ())]


def state_of(summary: Mapping[str, Any]) -> str:
    """Return the state of a run; empty if its summary has no verdict."""
    return _verdict(summary).get("state", "")


def line_of(summary: Mapping[str, Any]) -> str:
    """Return the line of a run, ``Good: stable; tool error ...``; empty if its summary has no verdict."""
    return ": ".join(filter(None, (state_of(summary).capitalize(), _verdict(summary).get("words", ""))))


def checks_line(summary: Mapping[str, Any]) -> str:
    """Return how many checks of a run pass, ``3 of 4 checks pass, 1 doubtful``; empty if it has none."""
    states = [check.state for check in checks_of(summary)]
    others = "".join(f", {states.count(state)} {state}" for state in STATES[1:] if state in states)
    return f"{states.count(GOOD)} of {len(states)} checks pass{others}" if states else ""


def _verdict(summary: Mapping[str, Any]) -> Mapping[str, Any]:
    return summary.get("verdict") or {}
