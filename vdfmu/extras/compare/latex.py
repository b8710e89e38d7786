"""The tables of runs in LaTeX."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from vdfmu.base.files import MARK, write_whole
from vdfmu.study.report.sheets import COMPARED, Sheet

_SPECIAL = {**{each: f"\\{each}" for each in "&%$#_{}"}, "\\": r"\textbackslash{}", "~": r"\textasciitilde{}"}
_SPECIAL |= {"^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}", "µ": r"\textmu{}"}
_POWER = re.compile(r"(-?\d[\d.]*)e([+-]?\d+)")
_UNIT = re.compile(r"\b(N|kg|J|W)\.(m|s|mm)")


_COLUMN, _LETTER, _SPACE = 240.0, 4.4, 6.0
"""Width of a column of a paper; width of a letter of 8 pt, and between columns [pt]."""


def write_tables(tables: Iterable[tuple[str, Sheet]], path: Path) -> Path:
    """Write tables, each with the name of its run or "", as LaTeX; they need the package booktabs."""
    head = f'% {MARK.decode()}"\n% \\usepackage{{booktabs}}\n'
    write_whole(path, [(head + "\n".join(sheet_latex(sheet, name) for name, sheet in tables)).encode()])
    return path


def sheet_latex(sheet: Sheet, name: str = "") -> str:
    """Return a table in LaTeX, with the name of its run and its notes in the caption, and numbers on the right.

    A table that is wider than a column of a paper is parted; each part begins with the first column.
    """
    title = " ".join(sheet.title.split())
    caption = " ".join([f"{title}, {name}." if name else f"{title}.", *map(str.strip, sheet.notes)])
    label = "-".join(re.findall(r"[a-z0-9]+", f"{name} {title}".lower()))
    return "\n".join([
        r"\begin{table}", r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{_cell(caption)}}}", rf"\label{{tab:{label}}}",
        "\n\\par\\medskip\n".join(_tabular(sheet, part) for part in _parts(sheet)), r"\end{table}", "",
    ])  # fmt: skip


def _widths(sheet: Sheet) -> list[float]:
    """Return the widths of the columns of a table [pt]."""
    return [
        max(len(line) for cell in cells for line in cell.split("\n")) * _LETTER + _SPACE
        for cells in zip(sheet.columns, *sheet.rows, strict=True)
    ]


def _parts(sheet: Sheet) -> list[list[int]]:
    """Return the columns of the parts of a table, the first in each. Columns that a heading compares stay together."""
    widths = _widths(sheet)
    groups: list[list[int]] = []
    for k in range(1, len(sheet.columns)):
        if groups and sheet.columns[k] in COMPARED:
            groups[-1].append(k)
        else:
            groups.append([k])
    parts = [[0]]
    for group in groups:
        if len(parts[-1]) > 1 and sum(widths[k] for k in (*parts[-1], *group)) > _COLUMN:
            parts.append([0])
        parts[-1] += group
    return parts


def _tabular(sheet: Sheet, part: Sequence[int]) -> str:
    """Return columns of a table. A heading of several lines takes as many rows, and ends above the rule."""
    headings = [sheet.columns[k].split("\n") for k in part]
    deep = max(map(len, headings))
    above = zip(*([""] * (deep - len(heading)) + heading for heading in headings), strict=True)
    rows = [*above, *([row[k] for k in part] for row in sheet.rows)]
    lines = [" & ".join(map(_cell, cells)) + r" \\" for cells in rows]
    first, *widths = (_widths(sheet)[k] for k in part)
    long = first + sum(widths) > _COLUMN  # a column alone beside the first: its text is broken into lines
    kinds = f"p{{{max(_COLUMN - first, 60.0):.0f}pt}}" if long else "r" * len(widths)
    rules = [rf"\begin{{tabular}}{{l{kinds}}}", r"\toprule", *lines[:deep], r"\midrule", *lines[deep:]]
    return "\n".join([*rules, r"\bottomrule", r"\end{tabular}"])


def _cell(text: str) -> str:
    """Return a cell: 1.3e-05 as 1.3 times a power of ten, units as N m."""
    if power := _POWER.fullmatch(text):
        return rf"${power[1]}\cdot 10^{{{int(power[2])}}}$"
    if re.fullmatch(r"-\d[\d.]*", text):
        return f"${text}$"
    escaped = "".join(_SPECIAL.get(each, each) for each in " ".join(text.split()))
    return _UNIT.sub(r"\1\\,\2", escaped)
