"""The tables of a run for the terminal.

A summary is the content of ``summary.json``; :mod:`vdfmu.study.report.sheets` chooses what the tables show.
"""

from __future__ import annotations

from rich import box
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from vdfmu.base.table import plain_table
from vdfmu.engine.results.verdict import checks_of, not_checked
from vdfmu.study.report.headline import checks_line
from vdfmu.study.report.sheets import Sheet, facts
from vdfmu.study.report.summary_keys import Summary


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
    checks = checks_of(summary)
    failed = sum(not check.passed for check in checks)
    title = f"{failed} of {len(checks)} checks failed" if failed else checks_line(summary)
    table = plain_table(title=f"\n{title}", show_header=False)
    if failed and isinstance(table.title, Text):
        table.title.stylize("red")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for check in checks:
        sign = Text("pass", style="green") if check.passed else Text("FAIL", style="bold red")
        table.add_row(sign, Text(f"{check.name}: {check.text}"))
    for text in not_checked(summary):
        table.add_row(Text("-"), Text(f"not checked: {text}"))
    return table
