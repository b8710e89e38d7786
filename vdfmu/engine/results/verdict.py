"""The verdict on a run in its summary: checks, their states, and a line; terminal, page and exit code read it."""

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
    """The result in the line of a run that is not good; by default the line quotes the check."""


def verdict_of(checks: Sequence[Check], numbers: str = "") -> dict[str, Any]:
    """Return the entry ``verdict`` of a summary: ``state``, ``words``, and ``checks`` with name, state and text.

    The words follow the order of the checks. Without checks the run was not judged, and is doubtful. `numbers` are the
    words of a good run, and the last words of a doubtful run.
    """
    state = max((check.state for check in checks), key=STATES.index, default=DOUBTFUL)
    bad = [check for check in checks if check.state != GOOD]
    words = [check.words for check in bad if check.words]
    if not any(check.words for check in bad if check.state == state):
        words += [_short(f"{check.name}: {check.text}") for check in bad if check.state == state][:1]
    words += [] if checks else ["not judged, since no check applies to this run"]
    words += [numbers] if numbers and state != FAILED else []
    kept = [{"name": check.name, "state": check.state, "text": check.text} for check in checks]
    return {"state": state, "words": "; ".join(words), "checks": kept}


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def checks_of(summary: Mapping[str, Any]) -> list[Check]:
    """Return the checks of a run from its summary; empty without a verdict."""
    return [Check(each["name"], each["state"], each["text"]) for each in _verdict(summary).get("checks", ())]


def state_of(summary: Mapping[str, Any]) -> str:
    """Return the state of a run from its summary; empty without a verdict."""
    return _verdict(summary).get("state", "")


def line_of(summary: Mapping[str, Any]) -> str:
    """Return the line of a run, ``Good: stable; tool error ...``; empty without a verdict."""
    return ": ".join(filter(None, (state_of(summary).capitalize(), _verdict(summary).get("words", ""))))


def checks_line(summary: Mapping[str, Any]) -> str:
    """Return the number of passed checks, ``3 of 4 checks pass, 1 doubtful``; empty without checks."""
    states = [check.state for check in checks_of(summary)]
    rest = "".join(f", {states.count(state)} {state}" for state in STATES[1:] if state in states)
    return f"{states.count(GOOD)} of {len(states)} checks pass{rest}" if states else ""


def _verdict(summary: Mapping[str, Any]) -> Mapping[str, Any]:
    return summary.get("verdict") or {}
