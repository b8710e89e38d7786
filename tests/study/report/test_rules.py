"""The table of limits that pages judge by and that the documentation shows."""

import math
from pathlib import Path

from vdfmu.study.limits import LIMITS, ROWS, read_limits
from vdfmu.study.report.rules import row_of, rules_of

PAGE = Path(__file__).parents[3] / "docs" / "report.md"


def documented() -> list[str]:
    """Return the rows of the table in the documentation."""
    rows: list[str] = []
    for row in ROWS:
        side = "below" if row.at_least else "above"
        beyond = f"{row.beyond} {side} {row.shown(row.value)}"
        if math.isfinite(row.failed):
            beyond += f", failed {side} {row.shown(row.failed)}"
        rows.append(f"| `{row.key}` | {row.name} | {beyond} | {row.by} |")
    return rows


def test_the_documentation_has_the_table_of_limits():
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if any(line.startswith(f"| `{row.key}` |") for row in ROWS)] == documented()


def test_a_page_has_every_limit_and_says_whose_it_is():
    changed = {"margin": {"value": 0.3, "by": "--limit"}}
    rows = rules_of({"own_limits": changed}, "vdfmu run tracking --stop 2 --limit margin=0.3")
    assert rows["asked"] and rows["rows"].keys() == LIMITS.keys()
    assert rows["rows"]["margin"] == row_of(read_limits({"margin": 0.3}, "--limit")["margin"])
    assert [key for key, row in rows["rows"].items() if row["own"]] == ["margin"]
    assert "failed" not in rows["rows"]["margin"] and rows["rows"]["tool"]["failed"] == 0.5
