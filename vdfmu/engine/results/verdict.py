"""The verdict on a run: its checks, each with pass or fail.

A run makes it once and keeps it in its summary; terminal, page and exit code read it from there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple


class Check(NamedTuple):
    """One check of a run."""

    name: str
    passed: bool
    text: str
    """The result, and the limit that it was compared with."""


def verdict_of(checks: Iterable[Check], not_checked: Sequence[str] = ()) -> dict[str, Any]:
    """Return the entry ``verdict`` of a summary.

    ``passed``; ``checks`` with name, passed and text; ``not_checked``, sentences.
    """
    found = [check._asdict() for check in checks]
    passed = all(check["passed"] for check in found)
    return {"passed": passed, "checks": found, "not_checked": list(not_checked)}


def checks_of(summary: Mapping[str, Any]) -> list[Check]:
    """Return the checks of a run from its summary; empty where the summary has no verdict."""
    return [
        Check(str(one["name"]), one["passed"] is True, str(one["text"]))
        for one in (summary.get("verdict") or {}).get("checks", ())
    ]


def not_checked(summary: Mapping[str, Any]) -> list[str]:
    """Return the checks that were left out, and why."""
    return [str(one) for one in (summary.get("verdict") or {}).get("not_checked", ())]
