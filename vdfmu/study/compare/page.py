"""A comparison: its table; in words, which law to take when, and which fail; and its page, whose matrices open runs."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.files import write_whole
from vdfmu.base.page import page
from vdfmu.study.compare.axes import LAWS, MISMATCHES
from vdfmu.study.compare.measures import MEASURES
from vdfmu.study.report.page import NAME
from vdfmu.study.report.scripts import COMPARED, data_element, look, scripts_of
from vdfmu.study.sweeps.sweep import Sweep

AXES = ("arm", "motion", "mismatch", "law")
GOOD = ("stable",)
VERDICTS = (*GOOD, "not judged", "no margin", "at limits", "off the path", "unstable", "failed")
"""Verdicts on cells; measures of the others than `GOOD` are not compared."""


class LawComparison(Sweep):
    """The table of a comparison: a row for each cell, and the column ``run``, with which it is run again."""

    @property
    def about(self) -> dict[str, Any]:
        """How it was made: budget, margin, seed, axes, and all tunings, also of laws that are not tuned."""
        return self.facts["compare"]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """All cells."""
        return self.table().to_pylist()


BY = "rms_tool"
"""Measure by which laws are ranked."""
_CLOSE = 1.1
"""Ratio below which two laws are said to be equally good."""
_LEAST = 1e-6
"""Error [m] below which laws are equally good: a tool does not show it."""


class Ranked(NamedTuple):
    """A law with a mismatch."""

    broken: int
    """Cells with another verdict than `GOOD`, also those of arms on which it is not tuned."""
    mean: float
    """Geometric mean of its error over the first law's, of the cells in which both are good; inf without any."""
    law: str


def in_words(study: LawComparison) -> str:
    """Return the comparison as Markdown."""
    about, title = study.about, MEASURES[BY].title
    count = {verdict: sum(row["verdict"] == verdict for row in study.rows) for verdict in VERDICTS}
    orders = {mismatch: ranked(study, mismatch) for mismatch in about["mismatches"]}
    sizes = ", ".join(f"{axis} {len(about[axis])}" for axis in ("laws", "arms", "motions", "mismatches"))
    delayed = " with one more sample of delay" if about["delayed"] else ""
    verdicts = ", ".join(f"{verdict} {number}" for verdict, number in count.items() if number)
    laws = [law for law in about["laws"] if any(law == one.law for order in orders.values() for one in order)]
    ratios = (f"| {mismatch.replace('_', ' ')} | {' | '.join(_ratios(o, laws))} |" for mismatch, o in orders.items())
    lines = [
        "# Control laws compared",
        "",
        f"{len(study)} cells: {sizes}. "
        f"Each law is tuned on each arm by {about['budget']} evaluations, seed {about['seed']}, to a modulus margin of "
        f"at least {about['margin']:g}{delayed}. Cells: {verdicts}.",
        "",
        "## Which law to take",
        "",
        *(f"- {_advice(mismatch, order, title)}" for mismatch, order in orders.items()),
        "",
        f"## {title}, times that of the best law of the row",
        "",
        "The best law has the most stable cells with the mismatch, and of such laws the smallest error. The others are "
        "compared with it by the geometric mean over the arms and motions in which both are stable, so that a law with "
        "fewer stable cells may be below 1. Errors below 1 um are equally good: they count as 1 um. In brackets: the "
        "number of cells that are not stable, including those of arms on which the law is not tuned.",
        "",
        f"| | {' | '.join(f'`{law}`' for law in laws)} |",
        f"| --- |{' ---: |' * len(laws)}",
        *ratios,
        "",
        "## Not stable",
        "",
        *(_broken(study) or ["All cells are stable, keep their path, and stay away from limits."]),
        "",
        "## Tuning",
        "",
        f"{MEASURES[about['cost']].title} [mm] of the motion with a push, before and after the search.",
        "",
        *_tunings(study),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def ranked(study: LawComparison, mismatch: str) -> list[Ranked]:
    """Return the laws that are tuned: first the best of those with the fewest broken cells, the others against it."""
    found: dict[str, dict[tuple[str, str], float]] = {}
    for row in study.rows:
        if row["mismatch"] == mismatch:
            cells = found.setdefault(row["law"], {})
            if row["verdict"] in GOOD:
                cells[row["arm"], row["motion"]] = np.log(max(row[BY], _LEAST))
    number = len(study.about["arms"]) * len(study.about["motions"])
    most = max(map(len, found.values()))
    best = {law: cells for law, cells in found.items() if len(cells) == most}
    first = min(best, key=lambda law: sum(x for x in (_ratio(best[law], each) for each in best.values()) if x < np.inf))
    order = [
        Ranked(number - len(cells), float(np.exp(_ratio(cells, found[first]))), law) for law, cells in found.items()
    ]
    return sorted(order, key=lambda one: (one.broken, one.law != first, one.mean))


def _ratio(cells: Mapping[Any, float], other: Mapping[Any, float]) -> float:
    """Return the mean difference over the cells that both have; inf without any."""
    common = [value - other[cell] for cell, value in cells.items() if cell in other]
    return float(np.mean(common)) if common else np.inf


def _advice(mismatch: str, order: list[Ranked], title: str) -> str:
    """Return a sentence on the best laws and by how much they are better."""
    text, first = MISMATCHES[mismatch].text[:1].upper() + MISMATCHES[mismatch].text[1:], order[0]
    if not np.isfinite(first.mean):
        return f"{text}: no law is stable."
    best = [one.law for one in order if one.broken == first.broken and one.mean <= _CLOSE]
    rest = [one for one in order if one.law not in best and one.broken == first.broken]
    names = " or ".join(f"`{law}`" for law in best)
    words = [f"{text}: {names}"]
    if first.broken:
        words.append(f"stable in all but {first.broken} cell{'s' if first.broken > 1 else ''}")
    if rest and np.isfinite(rest[0].mean):
        words.append(f"{_times(rest[0].mean)} times less {title} than `{rest[0].law}`")
    worse = len(order) - len(best) - len(rest)
    if worse:
        words.append(f"{worse} {'laws are' if worse > 1 else 'law is'} stable in fewer cells")
    return "; ".join(words) + "."


def _ratios(order: list[Ranked], laws: list[str]) -> Iterator[str]:
    found = {one.law: one for one in order}
    for law in laws:
        one = found.get(law)
        words = "" if one is None or not np.isfinite(one.mean) else _times(one.mean)
        yield f"{words} [{one.broken}]".strip() if one is not None and one.broken else words


def _times(ratio: float) -> str:
    return f"{ratio:.3g}" if ratio < 999.5 else f"{ratio:,.0f}"


def _broken(study: LawComparison) -> list[str]:
    """Return a line for each mismatch and verdict, with laws, arms and motions."""
    found: dict[tuple[str, str], dict[str, dict[str, list[str]]]] = {}
    for row in study.rows:
        if row["verdict"] not in GOOD:
            laws = found.setdefault((row["mismatch"], row["verdict"]), {})
            laws.setdefault(row["law"], {}).setdefault(row["arm"], []).append(row["motion"].replace("_", " "))
    motions = len(study.about["motions"])
    lines: list[str] = []
    for (mismatch, verdict), laws in found.items():
        each = (
            f"`{law}` on "
            + ", ".join(arm if len(m) == motions > 1 else f"{arm} ({', '.join(m)})" for arm, m in arms.items())
            for law, arms in laws.items()
        )
        lines.append(f"- {mismatch.replace('_', ' ')}, {verdict}: {'; '.join(each)}.")
    return lines


def _tunings(study: LawComparison) -> Iterator[str]:
    tunings = study.about["tunings"]
    yield f"| law | what it is | {' | '.join(tunings)} | step [us] |"
    yield f"| --- | --- | {' | '.join('---' for _ in tunings)} | ---: |"
    for law in study.about["laws"]:
        each = [laws[law] for laws in tunings.values()]
        cells = [t["why_not"] or f"{1e3 * t['before']:.3g} → {1e3 * t['after']:.3g}" for t in each]
        steps = [t["step_us"] for t in each if t["step_us"]]
        span = f"{min(steps):.2g} to {max(steps):.2g}" if steps else ""
        yield f"| `{law}` | {LAWS[law].text} | {' | '.join(cells)} | {span} |"


def write_comparison(study: LawComparison) -> Path:
    """Write ``report.html`` in the folder of a comparison."""
    about = study.about
    first, _, rest = _html(in_words(study)).partition("</section>")
    body = f"""{first}</section><section class="card"><div class="bar sticky" id="choices"><h2>Cells</h2></div>
<p class="note">Number: the measure. Colour: how many times the best law of its row; the best is bold. Choose a cell for
its other measures and the command that runs it again with everything that a run shows.</p>
<div id="matrices"></div><div id="cell" hidden></div></section>
{rest}
{data_element({"runs": [], "compared": _content(study)})}"""
    what = f"{len(study)} cells, {about['budget']} evaluations, seed {about['seed']}, vdfmu {study.facts['vdfmu']}"
    path = study.folder / NAME
    content = page("Control laws compared", what, body, 76, look("laws.css"), scripts=scripts_of(COMPARED))
    write_whole(path, [content])
    return path


def _content(study: LawComparison) -> dict[str, object]:
    about, rows = study.about, study.rows
    settings = {f"{r['arm']} {r['mismatch']}": json.loads(r["run"])["settings"] for r in reversed(rows)}
    return {
        "laws": {name: LAWS[name].text for name in about["laws"]},
        "mismatches": {name: MISMATCHES[name].text for name in about["mismatches"]},
        "arms": about["arms"], "motions": about["motions"], "good": GOOD, "by": BY,
        "measures": {
            name: {"title": m.title, "factor": m.factor, "unit": m.shown, "more": m.more_is_better}
            for name, m in MEASURES.items()
        },
        "cells": {
            f"{r['arm']} {r['motion']} {r['mismatch']} {r['law']}": {
                "row": r["point"], "verdict": r["verdict"], "why": r["failed"], "runs": r["runs"],
                "values": [_short(r.get(name)) for name in MEASURES],
            }
            for r in rows
        },
        "tunings": about["tunings"], "settings": settings, "seed": about["seed"],
        "command": f"vdfmu run --from {shlex.quote(str(study.folder))} --row ",
    }  # fmt: skip


def _short(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.4g}")


def _html(text: str) -> str:
    """Return the Markdown of the words, headings, tables, lists and paragraphs, as HTML."""
    parts: list[str] = []
    for block in text.split("\n\n")[1:]:
        lines = [re.sub("`(.*?)`", r"<code>\1</code>", escape(line)) for line in block.strip().splitlines()]
        if lines[0].startswith("|"):
            cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
            rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells[2:])
            parts.append(
                f'<div class="wide words"><table><tr><th>{"</th><th>".join(cells[0])}</th></tr>{rows}</table></div>'
            )
        elif lines[0].startswith("#"):
            parts.append(f'</section><section class="card"><h2>{lines[0].lstrip("# ")}</h2>')
        elif lines[0].startswith("- "):
            parts.append(f"<ul>{''.join(f'<li>{line[2:]}</li>' for line in lines)}</ul>")
        else:
            parts.append(f"<p>{' '.join(lines)}</p>")
    return f'<section class="card">{"".join(parts)}</section>'
