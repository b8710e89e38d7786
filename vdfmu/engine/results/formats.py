"""The formats of results, one row each. A new one needs a file with a `FORMAT` and a row here."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from vdfmu.base.extras import extra_modules
from vdfmu.base.plugins import Plugins, PluginTable

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vdfmu.base.arrays import Floats
    from vdfmu.engine.results.recorded import Recorded, Signal


SUFFIXES = ("png", "svg", "pdf")
"""Kinds of files of a picture."""
_FIGURE = re.compile(rf"figure_.+\.({'|'.join(SUFFIXES)})")


def figure_file(key: str, suffix: str) -> str:
    """Return the name of the file of a figure."""
    return f"figure_{re.sub(r'[^A-Za-z0-9_.-]', '_', key.removesuffix('.revolute'))}.{suffix}"


def figure_files(folder: Path) -> list[str]:
    """Return the names of the files of figures in the folder of a run."""
    return [path.name for path in folder.glob("figure_*") if _FIGURE.fullmatch(path.name)]


class Stream(NamedTuple):
    """A text format whose rows are written during the run."""

    head: Callable[[Sequence[Signal]], str]
    """Returns the lines above the rows."""
    lines: Callable[[Floats, Sequence[Signal], Mapping[str, NDArray[Any]], slice], str]
    """Returns a line for each time, with the values of the signals in the rows of the arrays."""


class Format(NamedTuple):
    """A file format of results."""

    needs: Callable[[], object]
    """Raises UsageError if a required package is not installed."""
    write: Callable[[Recorded, Path], None]
    """Writes the signals; see `vdfmu.Results.write`."""
    read: Callable[[Path], Recorded]
    """Reads a file of `write`."""
    streams: Stream | None = None
    """Writes rows during the run; None if the file is written when the run ends."""


def _of(module: str) -> Callable[[], Format]:
    return lambda: import_module(f"vdfmu.engine.results.{module}").FORMAT


_SHIPPED = {".csv": _of("csv_file"), ".parquet": _of("parquet")}
for _extra in extra_modules("result_formats"):
    _SHIPPED |= _extra.FORMATS
PLUGINS = Plugins("formats", "format of results", "a function that returns a Format", callable)
FORMATS: PluginTable[Callable[[], Format]] = PluginTable(PLUGINS, _SHIPPED, prefix=".")
"""Formats by suffix, imported on use. If a folder has several, the last is read."""


def format_of(path: Path) -> Format:
    """Return the format of a file by its suffix; by default CSV."""
    suffix = path.suffix.lower()
    return FORMATS[suffix if suffix in FORMATS else ".csv"]()


def result_files(folder: Path | None = None) -> tuple[str, ...]:
    """Return the names of result files in the folder of a run; those in formats of plugins only if they exist."""
    there = () if folder is None else sorted(path.suffix for path in folder.glob("results.*"))
    suffixes = dict.fromkeys((*FORMATS, *(suffix for suffix in there if suffix in FORMATS)))
    return tuple(f"results{suffix}" for suffix in suffixes)


def choice_of_formats(suffixes: Iterable[str] | None = None) -> str:
    """Return the formats as text, by default all, for which plugins are loaded."""
    names = [suffix[1:] for suffix in (FORMATS.names() if suffixes is None else suffixes)]
    return f"{', '.join(names)}, or {','.join(names)} for all"
