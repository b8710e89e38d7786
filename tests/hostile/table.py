"""Corpora of hostile inputs, and the table of tries and failures."""

import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from vdfmu.base.errors import VdfmuError

_SHOWN = 5
"""Most failures of a corpus that are kept in full."""


@dataclass(frozen=True)
class Corpus:
    """Inputs that mean harm, made by number: the same number gives the same input.

    Attributes
    ----------
    name : str
        The first column of the table.
    tries : int
        How many `make hostile` makes.
    attempt : callable
        ``attempt(number, folder)`` makes an input in an empty folder and hands it to the package. It returns, or
        raises a `VdfmuError` when the input is refused in words; any other exception is a failure.
    quick : int
        How many `make test` makes; 0 if it has a test of its own for a smaller attempt.
    seconds : float
        Most time that one try may take; one that takes longer is a failure.
    each : int
        What a try counts for in the table: the calls or runs that it makes.
    """

    name: str
    tries: int
    attempt: Callable[[int, Path], object]
    quick: int = 25
    seconds: float = 10.0
    each: int = 1


@dataclass
class Row:
    """What came of the tries of a corpus."""

    name: str
    tries: int = 0
    refused: int = 0
    failures: int = 0
    slowest: float = 0.0
    examples: list[str] = field(default_factory=list)


def tried(corpus: Corpus, numbers: Iterable[int], row: Row | None = None) -> Row:
    """Make the tries of these numbers and count what came of them, in a row that may be looked at before the end."""
    row = Row(corpus.name) if row is None else row
    for number in numbers:
        fault = ""
        with tempfile.TemporaryDirectory(prefix="vdfmu_hostile_") as folder:
            begin = time.perf_counter()
            try:
                corpus.attempt(number, Path(folder))
            except VdfmuError as error:
                row.refused += 1
                if not str(error).strip():
                    fault = "is refused without a word"
            except Exception as error:  # whatever it is, no input may cause it
                fault = f"{type(error).__name__}: {error}"
            seconds = time.perf_counter() - begin
        row.tries += corpus.each
        row.slowest = max(row.slowest, seconds)
        if not fault and seconds > corpus.seconds:
            fault = f"takes {seconds:.1f} s; expected at most {corpus.seconds:g} s"
        if fault:
            row.failures += 1
            if len(row.examples) < _SHOWN:
                row.examples.append(f"{corpus.name}, number {number}: {fault}")
    return row


def table(rows: Iterable[Row]) -> str:
    head = "| corpus | tries | rejected or stopped with a message | failures | slowest [s] |"
    return "\n".join([head, "| --- | ---: | ---: | ---: | ---: |", *map(_line, rows)])


def _line(row: Row) -> str:
    return f"| {row.name} | {row.tries} | {row.refused} | {row.failures} | {row.slowest:.2g} |"


def replaced(page: str, rows: Iterable[Row]) -> str:
    """Return a page with the rows in its table, instead of those of the same names; new ones come last."""
    lines = page.split("\n")
    first = lines.index(table([]).split("\n")[1]) + 1
    last = next(i for i in range(first, len(lines)) if not lines[i].startswith("|"))
    line_of = {line.split(" | ")[0].removeprefix("| "): line for line in lines[first:last]}
    line_of |= {row.name: _line(row) for row in rows}
    return "\n".join([*lines[:first], *line_of.values(), *lines[last:]])
