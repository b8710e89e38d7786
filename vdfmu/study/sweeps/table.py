"""The table of a parameter study on disk, with a row per point, and its axes and measures as data for figures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import is_own
from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_json
from vdfmu.base.foreign import read_arrow
from vdfmu.base.option import renamed
from vdfmu.base.text import amount, close_to, elided
from vdfmu.engine.results.parquet import needed
from vdfmu.study.report.sheets import Sheet
from vdfmu.study.run.summary_keys import ANY, NUMBER, TEXT, WHOLE, Keyed, List, Record, typed
from vdfmu.study.sweeps.axes import is_option, read_axes
from vdfmu.study.sweeps.job import WiredSystem
from vdfmu.study.sweeps.ledger import LEDGER, PLAIN, TABLE, TABLES, files_of, readable, table_in, table_of
from vdfmu.study.sweeps.plain_table import PlainTable

_FACTS = Record({
    **dict.fromkeys(("scenario", "source", "vdfmu", "sample"), TEXT), "n": WHOLE, "seed": WHOLE,
    "axes": List(TEXT), "measures": Keyed(TEXT), "units": Keyed(TEXT), "parameters": Keyed(ANY), "options": Keyed(ANY),
    "systems": List({"package": TEXT}),
}, {"engine": TEXT})  # fmt: skip
"""The facts of a study that are read, and their types."""


_TUNED = Record({
    "points": Record(dict.fromkeys(("start", "chosen", "infeasible"), List(WHOLE))),
    "comparison": List(Record({"name": TEXT, "before": NUMBER, "after": NUMBER})),
})  # fmt: skip
"""The results of a search that are read, and their types."""
TUNED = "tune.json"
"""File of these results."""


class SearchPoints(NamedTuple):
    """Points of a search."""

    start: frozenset[int]
    """Points with the values of the scenario."""
    chosen: frozenset[int]
    infeasible: frozenset[int]
    """Points that failed or violate a limit or the margin."""
    compared: Mapping[str, tuple[float, float]]
    """Name of a cost, measure or margin to its values at the start and at the chosen point."""


def _sealed(folder: Path) -> bool:
    """Return whether this user made the study in a folder."""
    try:
        facts = dict(read_json(readable(folder / LEDGER)))
        return is_own(facts.pop("seal", None), facts, str(folder.resolve()))
    except (UsageError, ValueError, TypeError):
        return False


def _foreign_table(path: Path, columns: Sequence[str] | None = None) -> Any:
    """Return the table of someone else's file, or some of its columns; see `read_foreign`."""
    if path.suffix == Path(PLAIN).suffix:
        return table_of(path, columns)
    pyarrow, _ = needed()
    return pyarrow.ipc.open_file(read_arrow(path, columns)).read_all()


class StudyTable:
    """The results of a parameter study, without drawing; see :class:`vdfmu.study.sweeps.sweep.Sweep`."""

    def __init__(self, path: str | os.PathLike[str], notes: Sequence[str] = ()) -> None:
        self.path = Path(path)
        self.notes = list(notes)
        folder = self.path if self.path.is_dir() else self.path.parent
        self.folder = folder
        table = table_in(folder) if self.path.is_dir() else self.path
        self._files = [table] if table.exists() else files_of(folder)
        expected = f"{self.path}: expected {TABLE} or {PLAIN} of a parameter study, or its folder"
        named = self.path.name in TABLES or self.path.exists()  # the table of an unfinished study is not there yet
        if not named or not self._files and not (folder / LEDGER).exists():
            raise UsageError(f"{expected}; there is none.")
        content: Any = None
        try:
            self._table_of = table_of if _sealed(folder) else _foreign_table
            self._schemas = [self._table_of(file, []).schema for file in self._files]
            inside = self._files == [table] and table.suffix != Path(PLAIN).suffix
            content = read_json(self._table_facts() if inside else readable(folder / LEDGER))
            self.facts, problems = typed(renamed(content), _FACTS)
        except (UsageError, ValueError, KeyError, TypeError) as error:
            problems = [elided(str(error))]
        if problems:
            raise UsageError(f"{expected}: {'; '.join(problems).rstrip('.')}.")
        self._sealed = content.pop("seal", None), content, str(folder.resolve())
        self.columns: list[str] = list(dict.fromkeys(n for schema in self._schemas for n in schema.names))

    def _table_facts(self) -> bytes:
        facts = (self._schemas[0].metadata or {}).get(b"vdfmu")
        if facts is None:
            raise UsageError(f"{self._files[0].name} has no facts of a study, so no study of vdfmu wrote it")
        return facts

    @property
    def axes(self) -> list[str]:
        """Columns of the axes."""
        return [axis.partition("=")[0] for axis in self.facts["axes"]]

    @property
    def measures(self) -> list[str]:
        """Columns of the measures."""
        names = set(self.facts["measures"])
        return [c for c in self.columns if c.partition("[")[0] in names]

    def table(self, columns: Sequence[str] | None = None) -> Any:
        """Return a ``pyarrow.Table`` of some columns, or all; for a study in CSV a table with some of its methods."""
        for name in columns or ():
            if name not in self.columns:
                if (group := name.partition("[")[0]) in self.facts["measures"]:
                    self.elements(group)  # an error if all points failed
                way = close_to(name, self.columns) or f"; it has {', '.join(self.columns)}"
                raise UsageError(f"the study has no column {name!r}{way}")
        tables = [
            self._table_of(file, None if columns is None else [c for c in columns if c in schema.names])
            for file, schema in zip(self._files, self._schemas, strict=True)
        ]
        if not tables:
            raise UsageError(f"{self.path}: no point is done yet.")
        if isinstance(tables[0], PlainTable):
            return PlainTable.joined(tables)
        pyarrow, _ = needed()
        try:
            return pyarrow.concat_tables(tables, promote_options="permissive")
        except pyarrow.ArrowException as error:
            raise UsageError(f"{self.path}: its files have columns that do not fit together: {error}.") from None

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Return a column, shape (n,); UsageError for an unknown name."""
        return self.table([column])[column].to_numpy(zero_copy_only=False)

    def __repr__(self) -> str:
        axes, measures = ", ".join(self.axes), ", ".join(self.measures)
        return f"Study {self.folder}: {amount(len(self), 'point')}; axes {axes}; measures {measures}"

    def __len__(self) -> int:
        return self.table(["point"]).num_rows if self._files else 0

    @cached_property
    def search(self) -> SearchPoints | None:
        """The points of a search by role; None for a sweep, and before a search has ended."""
        file = self.folder / TUNED
        if "tune" not in self.facts or not file.exists():
            return None
        try:
            content, problems = typed(read_json(readable(file)), _TUNED)
        except (UsageError, ValueError) as error:
            content, problems = {}, [elided(str(error))]
        if problems:
            raise UsageError(f"{file}: expected the results of a search: {'; '.join(problems).rstrip('.')}.")
        compared = {row["name"]: (row["before"], row["after"]) for row in content["comparison"]}
        start, chosen, infeasible = (frozenset(content["points"][role]) for role in SearchPoints._fields[:3])
        return SearchPoints(start, chosen, infeasible, compared)

    @property
    def robots(self) -> int:
        """Number of robots with which each value of a search runs; 1 for a sweep."""
        return self.facts["n"] if "tune" in self.facts else 1

    @property
    def failed(self) -> dict[int, str]:
        """Reasons why points failed, by point number."""
        if not self._files:
            return {}
        table = self.table(["point", "failed"])
        return {
            point: words
            for point, words in zip(table["point"].to_pylist(), table["failed"].to_pylist(), strict=True)
            if words is not None
        }

    def elements(self, by: str | None = None) -> list[str]:
        """Return the columns of a measure, by default the first, or a column itself; UsageError for an unknown name."""
        name = by or next(iter(self.facts["measures"]), "")
        columns = [c for c in self.columns if name in (c, c.partition("[")[0])]
        if not columns and name in self.facts["measures"]:
            raise UsageError(f"{self.path}: no point has a value of {name}: all failed.")
        if not columns:
            allowed = dict.fromkeys([*self.facts["measures"], *self.measures])
            raise UsageError(f"by: expected {', '.join(allowed)}, got {name!r}.")
        return columns

    def values(self, by: str | None = None) -> Floats:
        """Return a column, or the largest element of a measure, at each point, (n,); NaN if the run failed."""
        table = self.table(self.elements(by))
        return np.max([column.to_numpy().astype(float) for column in table.columns], axis=0)

    def sheet(self) -> Sheet:
        """Return the range of each measure as a table."""
        units = self.facts["units"]
        rows = [(*row, units.get(row[0].partition("[")[0], "")) for row in self.ranges()]
        columns = ("measure", "smallest", "median", "largest", "smallest\nat point", "largest\nat point", "unit")
        return Sheet(f"Measures of {self.facts['scenario']}", columns, rows, [])

    def ranges(self) -> list[list[str]]:
        """Return for each column of a measure the name, smallest, median, largest, points of smallest and largest."""
        points, rows = self["point"], list[list[str]]()
        for column in self.measures:
            values = self[column]
            if np.isfinite(values).any():
                ends = [f"{f(values):.4g}" for f in (np.nanmin, np.nanmedian, np.nanmax)]
                rows.append([column, *ends, *(str(points[f(values)]) for f in (np.nanargmin, np.nanargmax))])
            else:
                rows.append([column, "no value", "", "", "", ""])
        return rows

    def undefined(self) -> list[str]:
        """Return a note for each column of a measure without a finite value at points that did not fail."""
        points, failed = self["point"], [*self.failed]
        counts = {c: int(np.sum(~np.isfinite(self[c]) & ~np.isin(points, failed))) for c in self.measures}
        return [f"{c} has no finite value at {n} of {len(points)} points." for c, n in counts.items() if n]

    def row(self, which: int | str, by: str | None = None) -> dict[str, Any]:
        """Return a point, given by number, or as ``worst`` or ``best`` by a measure's largest element or a column."""
        if which in ("worst", "best"):
            values = self.values(by)
            if which == "best" and self.search and not self.search.chosen & self.search.infeasible:
                values[np.isin(self["point"], [*self.search.infeasible])] = np.nan
            if not np.isfinite(values).any():
                raise UsageError(f"{self.path}: no point has a value of {by or self.measures[0]}: all failed.")
            place = int((np.nanargmax if which == "worst" else np.nanargmin)(values))
        else:
            points = self["point"]
            places = np.flatnonzero(points == (int(which) if str(which).isdecimal() else -1))
            if not len(places):
                raise UsageError(f"row: expected worst, best or a point up to {points.max()}, got {which}.")
            place = int(places[0])
        return self.table().slice(place, 1).to_pylist()[0]

    def require_own(self, trust: bool = False) -> None:
        """Raise UsageError unless the user made the study in this folder, or trusts the files that it names."""
        if not trust and not is_own(*self._sealed):
            raise UsageError(
                f"{self.path}: its scenario was not run, because the study was made elsewhere or with another cache, "
                "and can name any code. If you trust who made it, --trust runs it."
            )

    def options(self, which: int | str = "worst", by: str | None = None, *, trust: bool = False) -> dict[str, Any]:
        """Return the options of `vdfmu.run` for the run of a point: ``vdfmu.run(**sweep.options("worst"))``.

        `notes` says if the scenario, or a file that it names, has changed since the study. UsageError as in `row`, and
        for a study of a package, with inputs that were not a file, or, without `trust`, from elsewhere.
        """
        from vdfmu.study.sweeps.plan import digest

        self.require_own(trust)
        row, source, was = self.row(which, by), self.facts["source"], self.facts["systems"]
        if source.endswith(".ssp"):
            kept = self.folder / Path(source).name
            values = ", ".join(f"{axis}={row[axis]}" for axis in self.axes)
            package = kept if kept.exists() else source
            raise UsageError(
                f"{self.path}: expected a study of a scenario, got one of a package. Use 'vdfmu run {package}' and set "
                f"{values}."
            )
        system, options = self.system(row)
        if digest(system.content) not in [each["package"] for each in was]:
            self._note(f"{source}: its values, units or robot have changed since the study.")
        if [table.digest for table in system.inputs] not in [each["inputs"] for each in was]:
            self._note(f"{source}: its inputs have changed since the study.")
        for target, binding in system.bindings.items():
            options["parameters"] |= binding.values(row[target])
        return {"scenario": source, **options}

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)

    def system(self, row: Mapping[str, Any]) -> tuple[WiredSystem, dict[str, Any]]:
        """Return the system of a point, and the options of its run without the varied parameters."""
        from vdfmu.study.sweeps.plan import of_scenario

        switched = {axis: row[axis] for axis in self.axes if is_option(axis)}
        axes = [axis for axis in read_axes(self.facts["axes"]) if not is_option(axis.target)]
        options: Any = {**self.facts["options"], "parameters": dict(self.facts["parameters"])}
        system = of_scenario(self.facts["source"], axes, switched, options)
        for axis, value in switched.items():
            if axis.startswith("unit:"):
                options["units"] = {**(options.get("units") or {}), axis.removeprefix("unit:"): value}
            else:
                options[axis] = value
        return system, options

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame``."""
        return self.table().to_pandas()


_DECADES = 1.5
"""Decades that a measure must span to be drawn on a logarithmic scale."""
_FIFTHS = 5


@dataclass(frozen=True)
class Side:
    """A column as data for a figure."""

    name: str
    unit: str
    values: Floats
    """Numbers (n,); for words the places in `words`."""
    log: bool = False
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class View:
    """A measure over the varied axes, the most influential first."""

    sides: list[Side]
    value: Side


def view(study: StudyTable, measure: str | None = None) -> View:
    """Read the data for figures of a measure, or of one of its columns; UsageError if all points failed."""
    columns = study.elements(measure)
    values = study.values(measure)
    name, units = columns[0].partition("[")[0], study.facts["units"]
    good = np.isfinite(values)
    if not good.any():
        raise UsageError(f"{study.path}: no point has a value of {name}: all failed.")
    shown = columns[0] if len(columns) == 1 else f"{name}, largest of {len(columns)}"
    spread = values[good]
    log = bool(spread.min() > 0.0 and np.log10(spread.max() / spread.min()) > _DECADES)
    value = Side(shown, units.get(name, ""), np.where(good, values, np.nan), log)
    sides: list[Side] = []
    for axis in read_axes(study.facts["axes"]):
        column = study[axis.target]
        label = f"{axis.target} (factor)" if axis.factor else axis.target
        if column.dtype.kind not in "iuf":
            words = tuple(dict.fromkeys(map(str, axis.values)))
            places = np.array([words.index(str(each)) for each in column], dtype=float)
            names = tuple(Path(word).name for word in words)  # files are named without their folders
            side = Side(label, "", places, words=names if len(set(names)) == len(words) else words)
        else:
            log = axis.form in ("log", "lognormal") and column.min() > 0.0
            side = Side(label, units.get(axis.target, ""), column.astype(float), bool(log))
        if np.ptp(side.values) > 0.0:
            sides.append(side)
    if not sides:
        raise UsageError(f"{study.path}: expected an axis with at least two values to draw {name} over.")
    sides.sort(key=lambda side: -np.ptp([mean for _, mean in groups(side, value)]))
    return View(sides, value)


def groups(side: Side, value: Side) -> list[tuple[float, float]]:
    """Return means of a side and of the measure, at each value if the side has few, else in fifths of the points."""
    good = np.isfinite(value.values)
    x, y = side.values[good], value.values[good]
    return [(float(np.mean(x[part])), float(np.mean(y[part]))) for part in parts_of(x, bool(side.words))]


def parts_of(x: Floats, words: bool) -> list[NDArray[np.intp]]:
    """Return the places of each value if a side has few, or has `words`, else of each fifth of the points."""
    distinct = np.unique(x)
    if len(distinct) <= _FIFTHS or words:
        return [np.flatnonzero(x == level) for level in distinct]
    return [part for part in np.array_split(np.argsort(x, kind="stable"), _FIFTHS) if len(part)]
