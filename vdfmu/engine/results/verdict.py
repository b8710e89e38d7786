"""The verdict on a run in its summary: checks against limits, their states, and a headline about the worst."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

GOOD, DOUBTFUL, FAILED = STATES = ("good", "doubtful", "failed")
"""States of a verdict, worst last. A failed run exits with code 1."""
UNJUDGED = "not judged"
"""State of a check that does not apply or was not requested. It does not affect the verdict."""
SIGNS = {GOOD: "\u2713", DOUBTFUL: "!", FAILED: "\u2717", UNJUDGED: "\u2013"}
LONGEST = 90
"""Longest headline [characters]."""
_KEPT = rf"^.{{{LONGEST // 2},{LONGEST - 2}}}"
CUT = re.compile(rf"{_KEPT}(?=[;:.] |, [A-Za-z]| \()|{_KEPT}(?= )|^.{{{LONGEST - 2}}}")
"""Where a text that is too long is cut: after the last clause that fits, else after a word, so that numbers stay whole.

A comma before a number may be part of a list, such as ``joints 1, 2``. The pages use the same pattern.
"""


class Check(NamedTuple):
    """One check of a run."""

    key: str
    """Name of its row in a table of limits."""
    name: str
    state: str
    sentence: str
    """What happened, where and when; short enough for the headline."""
    more: str = ""
    """Additional measured values, or the complete message of an error."""
    value: float = math.nan
    limit: float = math.nan
    """The judged number and its limit, in the same unit; NaN if there are none."""
    by: str = ""
    """Origin of the limit: an option, a file, or a reference that recommends it."""

    @property
    def text(self) -> str:
        """The sentence with the additional values."""
        first = self.sentence.partition(" ")[0]
        sentence = (
            f"{first.capitalize()}{self.sentence[len(first) :]}"
            if first.islower() and first.replace("-", "").isalpha()
            else self.sentence
        )
        joint = ". " if self.more[:1].isupper() and self.more.endswith(".") else "; "  # after it, whole sentences
        return joint.join(filter(None, (sentence, self.more)))

    @property
    def source(self) -> str:
        """The limit and its origin; empty without a limit."""
        return f"limit {self.limit:.3g}: {self.by}" if math.isfinite(self.limit) else ""

    def to_dict(self) -> dict[str, Any]:
        """Return the check for JSON, without missing numbers."""
        facts = self._asdict()
        return {key: value for key, value in facts.items() if value != "" and value == value}


def verdict_of(checks: Sequence[Check], results: Sequence[str] = ()) -> dict[str, Any]:
    """Return the entry ``verdict`` of a summary: ``state``, ``headline``, ``results`` and ``checks``.

    The headline is the sentence of the worst check, or of the first if several are equally bad. For a good run it is
    the first of `results`, phrases about what the run achieved, and as many of the next ones as fit. Checks that were
    not judged are named after the results. A run is doubtful if none of its checks could be judged.
    """
    judged = [check for check in checks if check.state != UNJUDGED]
    state = max((check.state for check in judged), key=STATES.index, default=DOUBTFUL)
    phrases = [*results, *unjudged_phrase(checks)]
    if state == GOOD:
        room, count = LONGEST - len(f"{GOOD}: "), 1 if phrases else 0
        while count < len(phrases) and len("; ".join(phrases[: count + 1])) <= room:
            count += 1
        headline, phrases = "; ".join(phrases[:count]) or "all checks pass", phrases[count:]
    else:
        headline = next((check.sentence for check in judged if check.state == state), "no check applies to this run")
    return {
        "state": state,
        "headline": _short(f"{state.capitalize()}: {headline}"),
        "results": "; ".join(phrases),
        "checks": [check.to_dict() for check in checks],
    }


def unjudged_phrase(checks: Iterable[Check]) -> list[str]:
    """Return the phrase that names the checks that were not judged; none if all were."""
    names = [check.name[:1].lower() + check.name[1:] for check in checks if check.state == UNJUDGED]
    return [f"not judged: {', '.join(names)}"] if names else []


def _short(text: str) -> str:
    text = " ".join(text.split())
    kept = CUT.match(text) if len(text) > LONGEST else None
    return f"{kept[0]} \u2026" if kept else text


def checks_of(summary: Mapping[str, Any]) -> list[Check]:
    """Return the checks of a run from its summary; empty without a verdict."""
    return [Check(**each) for each in _verdict(summary).get("checks", ())]


def state_of(summary: Mapping[str, Any]) -> str:
    """Return the state of a run from its summary; empty without a verdict."""
    return _verdict(summary).get("state", "")


def headline_of(summary: Mapping[str, Any]) -> str:
    """Return the headline of a run, ``Doubtful: modulus margin 0.14 at joint 6``; empty without a verdict."""
    return _verdict(summary).get("headline", "")


def outcome_of(summary: Mapping[str, Any]) -> str:
    """Return the headline; of FMUs that were not judged how far they ran, and the option that judges them."""
    if headline_of(summary) or "scenario" in summary or "steps" not in summary:
        return headline_of(summary)
    ended = summary.get("ended")
    ran = f"Ran to {summary['stop']:.9g} s in {summary['steps']:,} steps"
    if ended:
        ran = f"Ran until {ended['component']} ended it at {ended['time']:.9g} s"
    joined = len(summary.get("order", ())) > 1
    return _short(f"{ran}; {'coupling not judged: add --judge' if joined else 'not judged: add --expect'}")


def results_of(summary: Mapping[str, Any]) -> str:
    """Return the results of a run in addition to its headline: largest errors, and checks that were not judged."""
    return _verdict(summary).get("results", "")


def checks_line(summary: Mapping[str, Any]) -> str:
    """Return the number of passed checks, ``3 of 4 checks pass, 1 doubtful``; empty without checks."""
    states = [check.state for check in checks_of(summary) if check.state != UNJUDGED]
    rest = "".join(f", {states.count(state)} {state}" for state in STATES[1:] if state in states)
    return f"{states.count(GOOD)} of {len(states)} checks pass{rest}" if states else ""


def _verdict(summary: Mapping[str, Any]) -> Mapping[str, Any]:
    return summary.get("verdict") or {}
