"""Tables for terminal and Markdown."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rich.box
import rich.table
from rich.console import Console

from vdfmu.engine.masters.observer import processor_name


@dataclass
class Table:
    """Rows of values; `columns` are pairs of heading and format, such as ``("time [us]", ".2f")``.

    A value of None is shown as a dash.
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

    def texts(self) -> list[list[str]]:
        """Rows as shown."""
        formats = [spec for _, spec in self.columns]
        return [[_show(v, spec) for v, spec in zip(row, formats, strict=True)] for row in self.rows]

    def numeric(self, column: int) -> bool:
        """Whether a column holds numbers and is aligned to the right."""
        return all(not isinstance(row[column], str) for row in self.rows)

    def to_rich(self) -> rich.table.Table:
        """Table for the terminal."""
        table = rich.table.Table(title=self.title.replace("[", r"\["), title_justify="left", box=rich.box.SIMPLE_HEAD)
        for i, (heading, _) in enumerate(self.columns):
            number = self.numeric(i)
            table.add_column(heading.replace("[", r"\["), justify="right" if number else "left", no_wrap=not number)
        for row in self.texts():
            table.add_row(*[text.replace("[", r"\[") for text in row])
        return table

    def to_markdown(self) -> str:
        """Table and notes in Markdown."""
        head = "| " + " | ".join(heading for heading, _ in self.columns) + " |"
        rule = "|" + "|".join(" ---: " if self.numeric(i) else " --- " for i in range(len(self.columns))) + "|"
        body = ["| " + " | ".join(row) + " |" for row in self.texts()]
        return "\n".join([f"### {self.title}", "", head, rule, *body, "", *[f"- {n}" for n in self.notes], ""])


def _show(value: Any, spec: str) -> str:
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
        self._console.print(table.to_rich())
        for note in table.notes:
            self._console.print(f"  {note}", highlight=False, markup=False)
        self._console.print()

    def write(self) -> None:
        """Write ``<name>.md``."""
        text = [f"## {self.title}", ""]
        text += [table.to_markdown() for table in self.tables]
        (self.out / f"{self.name}.md").write_text("\n".join(text), encoding="utf-8")


def machine() -> dict[str, Any]:
    """Where and with what the numbers were measured."""
    import casadi
    import numpy

    return {
        "processor": processor_name(),
        "cores": os.cpu_count(),
        "load_average": [round(v, 2) for v in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "casadi": casadi.CasadiMeta.version(),
    }
