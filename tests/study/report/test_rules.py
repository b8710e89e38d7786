"""The table of limits that pages judge by and that the documentation shows."""

import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from vdfmu.study import report
from vdfmu.study.limits import LIMITS, ROWS, read_limits
from vdfmu.study.report.simulation import row_of, rules_of

WEB = Path(str(report.__file__)).parent / "web"
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
    assert [key for key, row in rows["rows"].items() if "usual" in row] == ["margin"]
    assert rows["rows"]["margin"]["usual"] == LIMITS["margin"].value
    assert "failed" not in rows["rows"]["margin"] and rows["rows"]["tool"]["failed"] == 0.5


def close_to_limits():
    """Return rows with numbers that round to their limit, and the sentences about them."""
    for row in ROWS:
        places = dict.fromkeys(set(re.findall(r"{(\w+)}", row.sentence)) - {"value", "samples"}, "x")
        for limit in {row.value, row.failed} - {math.inf}:
            for apart in (1e-2, 1e-4, 1e-6):
                value = limit * (1.0 - apart if row.at_least else 1.0 + apart)
                yield row, value, places, row.check(value, **places).sentence


def test_a_number_that_rounds_to_its_limit_has_the_digits_that_show_the_difference():
    delay = LIMITS["delay"].check(0.9962, place="joint 5", time="0.164 s")
    assert delay.sentence == "delay margin of 0.996 samples at joint 5, 0.164 s (limit 1)"
    one_sample = LIMITS["delay"].check(1.0, place="joint 6", time="0.888 s")
    assert one_sample.sentence == "delay margin of 1 sample at joint 6, 0.888 s"
    for row, value, _, sentence in close_to_limits():
        before, limit = sentence.rstrip(")").split("limit ")
        assert limit == row.shown(row.failed if value > row.failed else row.value)
        assert not re.search(rf"(?<![\d.]){re.escape(limit)}(?![\d.])", before), sentence


@pytest.mark.skipif(shutil.which("node") is None, reason="node is needed for scripts")
def test_the_page_writes_the_same_sentences():
    judged = [*close_to_limits()]
    row, places = LIMITS["delay"], {"place": "joint 6", "time": "0.888 s"}
    judged.append((row, 1.0, places, row.check(1.0, **places).sentence))
    cases = [(row_of(row), value, places) for row, value, places, _ in judged]
    script = f"""import {{ check }} from {json.dumps((WEB / "verdict.js").as_uri())};
    console.log(JSON.stringify({json.dumps(cases)}.map((one) => check(...one).sentence)));"""
    command = ["node", "--input-type=module", "--eval", script]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, timeout=60)
    assert json.loads(done.stdout) == [sentence for *_, sentence in judged]
