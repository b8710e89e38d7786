"""The tables of a run for the terminal.

A summary is the content of ``summary.json``; :mod:`vdfmu.study.report.sheets` chooses what the tables show.
"""

from __future__ import annotations

from rich import box
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from vdfmu.base.bars import plain_table
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, SIGNS, checks_line, checks_of, line_of, state_of
from vdfmu.study.report.sheets import Sheet, facts
from vdfmu.study.run.summary_keys import Summary

STYLES = {GOOD: "green", DOUBTFUL: "yellow", FAILED: "red"}


def run_panel(summary: Summary) -> Panel:
    """Return the facts of the run, a line a fact."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, text in facts(summary):
        grid.add_row(Text(name), Text(text))
    return Panel(grid, title="Run", title_align="left", expand=False, box=box.ROUNDED)


def sheet_table(sheet: Sheet) -> Table:
    """Return a sheet for the terminal."""
    table = plain_table(title=f"\n{sheet.title}")
    table.caption = Text("\n".join(sheet.notes), style="dim")
    for i, heading in enumerate(sheet.columns):
        justify = "left" if i == 0 else "right"
        table.add_column(Text(heading), justify=justify, overflow="fold")  # a digit is never cut off
    for row in sheet.rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def verdict_table(summary: Summary) -> Table:
    """Return the checks of a run, a line a check."""
    table = plain_table(title=f"\n{checks_line(summary)}", show_header=False)
    if state_of(summary) == FAILED and isinstance(table.title, Text):
        table.title.stylize(STYLES[FAILED])
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for check in checks_of(summary):
        sign = Text(f"{SIGNS[check.state]} {check.state}", style=STYLES[check.state])
        table.add_row(sign, Text(f"{check.name}: {check.text}"))
    return table


def verdict_text(summary: Summary) -> Text:
    """Return the line of a run's verdict, and how many checks pass; empty without a verdict."""
    state, text = state_of(summary), "; ".join(filter(None, (line_of(summary), checks_line(summary))))
    return Text.assemble((f"{SIGNS[state]} ", STYLES[state]), (text, f"bold {STYLES[state]}")) if state else Text()
