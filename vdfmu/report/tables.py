"""The tables of a run, for the terminal (rich) and for the documentation (Markdown).

A summary is what ``summary.json`` holds; :mod:`vdfmu.report.sheets` says what the tables show of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich import box
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from vdfmu.report.sheets import Sheet, facts, sheets

__all__ = ["run_panel", "sheet_table", "to_markdown"]

Summary = Mapping[str, Any]


def run_panel(summary: Summary) -> Panel:
    """Return what the run was, a line a fact."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, text in facts(summary):
        grid.add_row(Text(name), Text(text))
    return Panel(grid, title="Run", title_align="left", expand=False, box=box.ROUNDED)


def to_markdown(summary: Summary) -> str:
    """Return the facts, the tables and the warnings of a run in Markdown, the numbers as in the terminal."""
    parts = [_markdown(("", ""), facts(summary))]
    for sheet in sheets(summary):
        parts.append(f"**{_plain(sheet.title)}**")
        parts.append(_markdown(sheet.columns, sheet.rows))
        parts.append(_plain(" ".join(sheet.notes)))
    warnings = [f"- {_plain(text)}" for text in summary.get("warnings") or ()]
    if warnings:
        parts += ["**Warnings**", "\n".join(warnings)]
    return "\n\n".join(parts) + "\n"


def sheet_table(sheet: Sheet) -> Table:
    """Return a sheet for the terminal."""
    table = Table(
        title=Text(f"\n{sheet.title}", style="bold"),
        title_justify="left",
        caption=Text("\n".join(sheet.notes), style="dim"),
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    for i, heading in enumerate(sheet.columns):
        justify = "left" if i == 0 else "right"
        table.add_column(Text(heading), justify=justify, overflow="fold")  # a digit is never cut off
    for row in sheet.rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def _markdown(columns: tuple[str, ...], rows: list[tuple[str, ...]] | list[tuple[str, str]]) -> str:
    """Return a table in Markdown, numbers to the right; without headings it is a list of facts."""
    facts_only = not any(columns)
    rule = [":---"] + [":---" if facts_only else "---:"] * (len(columns) - 1)
    lines = [columns, tuple(rule), *rows]
    return "\n".join("| " + " | ".join(_plain(cell) for cell in line) + " |" for line in lines)


def _plain(text: str) -> str:
    """Return text that Markdown shows as it is, in one line."""
    for special in "\\|*_<>`":
        text = text.replace(special, f"\\{special}")
    return text.replace("\n", " ")
