"""The findings of a check in the format of code scanners: SARIF 2.1.0."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

from vdfmu.base.version import __version__
from vdfmu.engine.inspect.inspection import Report
from vdfmu.engine.rules import RULES, Finding, Rule

_LEVELS = {"problem": "error", "note": "note"}
_URI = "https://raw.githubusercontent.com/oasis-tcs/sarif-spec/main/sarif-2.1/schema/sarif-schema-2.1.0.json"


def to_sarif(report: Report) -> dict[str, Any]:
    """Return a report as a SARIF log of one run.

    A file inside the checked one is an artifact with a parent; so a scanner shows the line where it can.
    """
    places: dict[str, int] = {"": 0}
    results: list[dict[str, Any]] = []
    for level, texts in (("error", report.problems), ("note", report.notes)):
        for text in texts:
            if isinstance(text, Finding):
                place = _inside(text.file, PurePath(report.file).name)
                location: dict[str, Any] = {
                    "artifactLocation": {"index": places.setdefault(place, len(places))}
                }
                if text.line:
                    location["region"] = {"startLine": text.line}
                results.append(
                    {
                        "ruleId": text.rule.number,
                        "level": level,
                        "message": {"text": str(text)},
                        "locations": [{"physicalLocation": location}],
                    }
                )
    inner = [{"location": {"uri": f"/{place}"}, "parentIndex": 0} for place in places if place]
    outer = {"location": {"uri": PurePath(report.file).as_posix()}}
    driver = {"name": "vdfmu", "version": __version__, "rules": [_rule(rule) for rule in RULES.values()]}
    run = {"tool": {"driver": driver}, "artifacts": [outer, *inner], "results": results}
    return {"$schema": _URI, "version": "2.1.0", "runs": [run]}


def _inside(file: str, checked: str) -> str:
    """Return the path of a file inside the checked one; empty for that itself."""
    return "/".join(part for part in file.split(": ") if part and part != checked)


def _rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.number,
        "shortDescription": {"text": rule.title},
        "help": {"text": rule.way},
        "defaultConfiguration": {"level": _LEVELS[rule.severity]},
    }
