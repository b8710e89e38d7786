"""Tables of a run or a study as LaTeX."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from vdfmu.base.files import MARK, write_whole
from vdfmu.study.report.sheets import Sheet

SUFFIX = ".tex"
_SPECIAL = {**{each: f"\\{each}" for each in "&%$#_{}"}, "\\": r"\textbackslash{}", "~": r"\textasciitilde{}"}
_SPECIAL |= {"^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}", "µ": r"\textmu{}"}
_POWER = re.compile(r"(-?\d[\d.]*)e([+-]?\d+)")
_UNIT = re.compile(r"\b(N|kg|J|W)\.(m|s|mm)")


def write_tables(sheets: Iterable[Sheet], path: Path) -> Path:
    """Write the tables of a run or a study as LaTeX; they need the package booktabs."""
    head = f'% {MARK.decode()}"\n% \\usepackage{{booktabs}}\n'
    write_whole(path, [(head + "\n".join(map(sheet_latex, sheets))).encode()])
    return path


def sheet_latex(sheet: Sheet) -> str:
    """Return a table in LaTeX: its title and notes as comments, numbers in columns on the right."""
    rows = [" & ".join(map(_cell, cells)) + r" \\" for cells in (sheet.columns, *sheet.rows)]
    lines = [
        *(f"% {' '.join(text.split())}" for text in (sheet.title, *sheet.notes)),
        rf"\begin{{tabular}}{{l{'r' * (len(sheet.columns) - 1)}}}",
        r"\toprule", rows[0], r"\midrule", *rows[1:], r"\bottomrule", r"\end{tabular}", "",
    ]  # fmt: skip
    return "\n".join(lines)


def _cell(text: str) -> str:
    """Return a cell: 1.3e-05 as 1.3 times a power of ten, units as N m."""
    number = _POWER.fullmatch(text)
    if number:
        return rf"${number[1]}\cdot 10^{{{int(number[2])}}}$"
    if re.fullmatch(r"-\d[\d.]*", text):
        return f"${text}$"
    escaped = "".join(_SPECIAL.get(each, each) for each in " ".join(text.split()))
    return _UNIT.sub(r"\1\\,\2", escaped)
