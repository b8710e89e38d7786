"""The page of a comparison: matrices of cells as heat maps, each with the command that opens its run."""

from __future__ import annotations

import json
import re
import shlex
from html import escape
from pathlib import Path

import numpy as np

from vdfmu.base.files import write_whole
from vdfmu.base.page import page
from vdfmu.study.compare.axes import LAWS, MISMATCHES
from vdfmu.study.compare.measures import MEASURES
from vdfmu.study.compare.words import BY, GOOD, LawComparison, in_words
from vdfmu.study.report.page import NAME
from vdfmu.study.report.scripts import COMPARED, data_element, look, module_element


def write_comparison(study: LawComparison) -> Path:
    """Write ``report.html`` in the folder of a comparison."""
    about = study.about
    first, _, rest = _html(in_words(study)).partition("</section>")
    body = f"""{first}</section><section class="card"><div class="bar sticky" id="choices"><h2>Cells</h2></div>
<p class="note">Number: the measure. Colour: how many times the best law of its row; the best is bold. Choose a cell for
its other measures and the command that runs it again with everything that a run shows.</p>
<div id="matrices"></div><div id="cell" hidden></div></section>
{rest}
{data_element({"runs": [], "compared": _content(study)})}
{module_element(COMPARED)}"""
    what = f"{len(study)} cells, {about['budget']} evaluations, seed {about['seed']}, vdfmu {study.facts['vdfmu']}"
    path = study.folder / NAME
    write_whole(path, [page("Control laws compared", what, body, 76, look("laws.css"))])
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
