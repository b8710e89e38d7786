"""Tables in Markdown, for the terminal and for files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rich.box
import rich.table
from rich.console import Console
from rich.text import Text


@dataclass
class Table:
    """Rows of values; `columns` are pairs of heading and format, such as ``("time [us]", ".2f")``.

    A value of None is shown as a dash. A column of numbers is aligned to the right.
    """

    name: str
    title: str
    columns: Sequence[tuple[str, str]]
    rows: list[list[Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, *values: Any) -> None:
        """Append a row."""
        if len(values) != len(self.columns):
            raise ValueError(f"{self.name}: expected {len(self.columns)} values, got {len(values)}")
        self.rows.append(list(values))

    def show(self, console: Console) -> None:
        """Print title, rows and notes."""
        table = rich.table.Table(box=rich.box.MARKDOWN)
        for i, (heading, _) in enumerate(self.columns):
            number = all(not isinstance(row[i], str) for row in self.rows)
            table.add_column(Text(heading), justify="right" if number else "left", no_wrap=not number)
        for row in self.rows:
            table.add_row(*(Text(_text(value, spec)) for value, (_, spec) in zip(row, self.columns, strict=True)))
        console.print(Text(f"### {self.title}\n"), table, *(Text(f"- {note}") for note in self.notes), sep="\n")


def _text(value: Any, spec: str) -> str:
    return "-" if value is None else value if isinstance(value, str) else format(value, spec)


class Report:
    """Tables of one benchmark."""

    def __init__(self, name: str, title: str, out: Path, console: Console) -> None:
        self.name = name
        self.title = title
        self.out = out
        self.tables: list[Table] = []
        self._console = console

    def say(self, text: str) -> None:
        """Tell what is being done."""
        self._console.print(f"  {text}", style="dim", highlight=False, markup=False)

    def show(self, table: Table) -> None:
        """Print a table with its notes and keep it."""
        self.tables.append(table)
        table.show(self._console)

    def write(self) -> None:
        """Write ``<name>.md``."""
        with (self.out / f"{self.name}.md").open("w", encoding="utf-8") as file:
            print(f"## {self.title}\n", file=file)
            for table in self.tables:
                table.show(Console(file=file, width=1000))
