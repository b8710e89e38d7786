"""Comparison of an FMU with its reference results (layered standard FMI-LS-REF)."""

from __future__ import annotations

import io
import posixpath
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import fmpy
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.csv_file import CsvFile
from vdfmu.base.errors import SspError
from vdfmu.engine.fmu.access import DTYPES
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.library import Watch
from vdfmu.engine.fmu.variables import FmuVariable, type_of
from vdfmu.engine.inspect.description import MANIFEST, REFERENCES
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.rules import Findings, finding
from vdfmu.extras.inspect.abilities import described, make_step, tried

# Reference results do not state the solver's tolerance. This is far above usual tolerances and far below wrong results.
AGREEMENT = 1e-3

_MANY = 20_000
"""Number of steps always allowed in a comparison: seconds for a compiled unit, less than the time limit for others."""
_EVEN = 1e-9
"""Allowed difference between equal steps, relative to the largest time, because rows are rounded."""
_NUMBERS = ("Real", "Integer", "Boolean", "Enumeration")
"""Types in the master that a cell of the table can contain."""


class _NotComparedError(Exception):
    """Reason for omitting results, which is no fault of the FMU."""


@dataclass(frozen=True)
class ReferenceTable:
    """Columns over time; a cell contains a number, or the elements of an array separated by spaces."""

    time: Floats
    columns: Mapping[str, Floats]


def try_references(path: Path, start: float, step: float, watch: Watch) -> Findings:
    """Compare the results of an FMU with every table in it, unless it allows only one instance per process."""
    description = described(path)
    if description is not None and description.once_per_process:
        findings, reason = Findings(), "the unit can be instantiated only once per process"
        findings.report("RUN004", f"reference results not compared: {reason}")
        return findings
    return compare(path)


def compare(path: Path) -> Findings:
    """Compare the results of an FMU with every table of reference results in it."""
    findings, description = Findings(), described(path)
    with zipfile.ZipFile(path) as archive:
        for name, inputs in _tables(archive, findings).items():
            short = posixpath.basename(name)
            try:
                if description is None:
                    raise _NotComparedError("reference results are defined for FMI 2.0 and 3.0")
                expected = _results_of(archive, name, description, findings)
                signals = _inputs_of(archive, inputs, description)
                results = _results(path, description, expected, signals)
                for problem in _differences(expected, results):
                    findings.report("RUN003", f"{short}: {problem}")
                findings.compared.append(short)
            except _NotComparedError as reason:
                _leave(findings, name, str(reason))
            except Exception as error:  # foreign files and units
                findings.report("RUN003", f"{short}: the reference results cannot be compared: {error}")
    return findings


def _tables(archive: zipfile.ZipFile, findings: Findings) -> dict[str, str | None]:
    """Return the tables of results and of their inputs, found through the manifest, experiments or names.

    A manifest may name a missing file: other tools may have removed it (FMI-LS-REF, Related Files).
    """
    names = set(archive.namelist())
    tables = {n: _beside(n, names) for n in archive.namelist() if n.startswith(REFERENCES) and n.endswith(_RESULTS)}
    manifest = REFERENCES + MANIFEST
    if manifest not in names:
        return tables
    try:
        root = parse_xml(archive.read(manifest), manifest)
    except SspError:
        return tables  # reported with the other files
    for related in root.iterfind(".//{*}Related"):
        name, role = _named(related, manifest), (related.get("role") or "").split("/")[0]
        if role not in ("result", "experiment") or (role == "result" and not name.endswith(".csv")):
            continue
        if name not in names:
            _leave(findings, name, f"{manifest} names it, and the FMU does not have it")
        elif role == "result":
            tables.setdefault(name, _beside(name, names))
        else:
            try:
                tables |= _experiments(parse_xml(archive.read(name), name), name, names, findings)
            except SspError as error:
                findings.entries += [finding("RUN003", text) for text in error.problems]
    return tables


_RESULTS = ("_out.csv", "_ref.csv")


def _beside(name: str, names: set[str]) -> str | None:
    """Return the table of the inputs for the name of a table of results."""
    inputs = next((f"{name.removesuffix(ending)}_in.csv" for ending in _RESULTS if name.endswith(ending)), "")
    return inputs if inputs in names else None


def _named(element: Any, owner: str) -> str:
    """Return the member named by a source, relative to the folder of its file."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(owner), unquote(element.get("source", ""))))


def _leave(findings: Findings, name: str, why: str) -> None:
    findings.report("RUN004", f"{posixpath.basename(name)}: not compared: {why}")


def _experiments(root: Any, owner: str, names: set[str], findings: Findings) -> dict[str, str | None]:
    """Return the tables of a file of experiments (modelica/ma-hs-experiments) with the tables of their inputs."""
    results: dict[str, str | None] = {}
    for experiment in root.iterfind("{*}Experiment"):
        parts = (experiment.find(f"{{*}}{tag}") for tag in ("References", "Stimuli", "Parameters"))
        references, stimuli, parameters = parts
        tables = [_named(each, owner) for each in (references, stimuli) if each is not None]
        where = f"{posixpath.basename(owner)}, experiment {experiment.get('name')!r}"
        if references is None:
            _leave(findings, where, "it has no reference results")
        elif parameters is not None:
            _leave(findings, where, f"it sets the parameters of {parameters.get('source')!r}")
        elif lacking := [name for name in tables if name not in names or not name.endswith(".csv")]:
            _leave(findings, where, f"expected a .csv file of the FMU, got {', '.join(lacking)}")
        else:
            results[tables[0]] = tables[1] if stimuli is not None else None
    if not root.tag.endswith("Experiments"):
        _leave(findings, owner, f"its root is {root.tag!r}, not 'Experiments'")
    return results


def _results_of(archive: zipfile.ZipFile, name: str, description: Description, findings: Findings) -> ReferenceTable:
    """Return the comparable columns; a note names the others, because a table may belong to several FMUs."""
    left: dict[str, list[str]] = {}

    def skip(column: str) -> bool:
        kind = _type(description, column)
        if type_of(kind) in _NUMBERS:
            return False
        reason = f"type {kind} does not fit into a table of numbers" if kind else "the unit has no such variable"
        left.setdefault(reason, []).append(column)
        return True

    table = read_table(archive.read(name).decode("utf-8-sig"), skip)
    for reason, columns in left.items():
        findings.report("RUN004", f"{posixpath.basename(name)}: {', '.join(columns)}: not compared: {reason}")
    if not table.columns:
        raise _NotComparedError("it has no comparable columns")
    return table


def _type(description: Description, name: str) -> str:
    """Return the declared type of a variable or array; empty for an unknown name."""
    return next((v.declared for v in description.elements(name)), "")


def _inputs_of(archive: zipfile.ZipFile, inputs: str | None, description: Description) -> ReferenceTable | None:
    """Return the inputs of a table of results; raise an error for a column that is not a settable variable."""
    if inputs is None:
        return None

    def check(column: str) -> bool:
        kind = _type(description, column)
        if not kind:
            raise ValueError(f"the unit has no variable {column!r}")
        if type_of(kind) not in _NUMBERS:
            raise _NotComparedError(f"the input {column!r} is of type {kind}")
        return False

    return read_table(archive.read(inputs).decode("utf-8-sig"), check)


def read_table(text: str, skip: Callable[[str], bool] = lambda column: False) -> ReferenceTable:
    """Read a table without the columns for which `skip(name)` is true; ValueError names the faulty line."""
    file = CsvFile(io.StringIO(text, newline=""))
    head, rows = [*map(str.strip, file.headings)], [*file]
    if not rows or len(head) < 2:
        raise ValueError("expected a head with 'time' and variables, and at least one row")
    kept = [0, *(k for k, name in enumerate(head) if k and not skip(name))]
    values: list[list[list[float]]] = []
    for line, row in rows:
        if len(row) != len(head):
            raise ValueError(f"line {line}: expected {len(head)} cells, got {len(row)}")
        try:
            values.append([[_number(part) for part in row[k].split()] for k in kept])
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    columns: dict[str, Floats] = {}
    for index, name in enumerate(head[k] for k in kept):
        sizes = {len(row[index]) for row in values}
        if len(sizes) > 1 or 0 in sizes:
            raise ValueError(f"column {name!r}: expected the same number of elements in every row")
        columns[name] = np.array([row[index] for row in values])
    time = columns.pop(head[0])[:, 0]
    if not np.all(np.isfinite(time)):
        raise ValueError(f"line {rows[int(np.argmin(np.isfinite(time)))][0]}: times must be finite")
    if not np.all(np.diff(time) >= 0.0):
        raise ValueError("times must not decrease")
    return ReferenceTable(time, columns)


def _number(text: str) -> float:
    return float({"true": 1.0, "false": 0.0}.get(text.lower(), text))


def _differences(expected: ReferenceTable, results: Mapping[str, Floats]) -> list[str]:
    """Return the variables with a difference above the limit, each at its worst time and element."""
    problems: list[str] = []
    for name, wanted in expected.columns.items():
        error = np.abs(results[name] - wanted)
        scaled = error / (1.0 + np.abs(wanted))
        row, element = np.unravel_index(int(np.argmax(np.where(np.isnan(scaled), np.inf, scaled))), error.shape)
        if not scaled[row, element] <= AGREEMENT:
            where = name if wanted.shape[1] == 1 else f"{name}, element {element + 1}"
            text = f"{where} at t = {expected.time[row]:g} s: expected {wanted[row, element]:.9g}"
            problems.append(f"{text}, differs by {error[row, element]:.3g}")
    return problems


def _results(
    path: Path, description: Description, expected: ReferenceTable, signals: ReferenceTable | None
) -> dict[str, Floats]:
    """Return the results of an FMU at the times of a table, with values exchanged at every communication point."""
    outputs, inputs = (
        {name: _elements(description, name, column) for name, column in (table.columns if table else {}).items()}
        for table in (expected, signals)
    )
    points = _points(description, expected, signals)
    rows = {name: np.empty((len(points), column.shape[1])) for name, column in expected.columns.items()}

    def feed(instance: Instance, time: float, running: bool = False) -> None:
        """Set the inputs to their values from a time on; within a step, when `running`, only continuous inputs."""
        if signals is None:
            return
        lines, held = _values_at(signals, time)
        for name, variables in inputs.items():
            continuous = variables[0].variability == "continuous"
            if continuous or not running:
                values = zip(variables, (lines if continuous else held)[name].tolist(), strict=True)
                instance.set_all([(v, bool(x) if v.kind == "Boolean" else v.domain.read(x)) for v, x in values])

    def steps(instance: Instance, *_: float) -> str:
        memory = {name: np.zeros(len(each), DTYPES[each[0].kind]) for name, each in outputs.items()}
        calls = [call for name, each in outputs.items() for call in instance.access("Get", each, memory[name])]
        for k, time in enumerate(points.tolist()):
            if k:
                if inputs and description.exchange:
                    instance.line = lambda time: feed(instance, time, running=True)
                make_step(instance, points[k - 1].item(), time - points[k - 1].item())
            if instance.box.ended and time < points[-1]:
                raise ValueError(f"the unit ended the simulation at t = {instance.box.time:.9g} s")
            instance.run(calls)
            for name, values in memory.items():
                rows[name][k] = values
            instance.line = lambda time: None
            feed(instance, time)
        return ""

    start = points[0].item()
    length = (points[-1].item() - start) / 10.0  # `tried` announces ten steps
    tried(description, Path(fmpy.extract(str(path))), steps, start, length, lambda instance: feed(instance, start))
    return {name: np.stack([np.interp(expected.time, points, x) for x in each.T], 1) for name, each in rows.items()}


def _elements(description: Description, name: str, column: Floats) -> list[FmuVariable]:
    elements = description.elements(name)
    if len(elements) != column.shape[1]:
        raise ValueError(f"{name}: the unit has {len(elements)} elements, the table {column.shape[1]}")
    return elements


def _points(description: Description, expected: ReferenceTable, signals: ReferenceTable | None) -> Floats:
    """Return the communication points: the times of both tables, or even steps if the unit needs them."""
    start, stop = expected.time[0], expected.time[-1]
    points = np.unique(expected.time if signals is None else np.concatenate([expected.time, signals.time]))
    points = points[(points >= start) & (points <= stop)]
    steps = np.diff(points)
    if description.varies_steps or not steps.size or steps.max() - steps.min() <= _EVEN * np.abs(points).max():
        return points
    step = float(np.diff(np.unique(expected.time)).min())
    count = (stop - start) / step
    if count > max(_MANY, 2 * len(expected.time)):
        text = f"two rows are {step:g} s apart; steps of that size from the first row to the last would be {count:.3g}"
        raise _NotComparedError(text)
    return start + step * np.arange(round(count) + 1)


def _values_at(signals: ReferenceTable, time: float) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the values of each input from a time on: interpolated between two rows, and those of the last row."""
    last = max(int(np.searchsorted(signals.time, time, side="right")) - 1, 0)
    following = min(last + 1, len(signals.time) - 1)
    span = signals.time[following] - signals.time[last]
    part = (time - signals.time[last]) / span if span > 0.0 and time > signals.time[last] else 0.0
    held, then = ({name: x[row] for name, x in signals.columns.items()} for row in (last, following))
    return {name: value + part * (then[name] - value) for name, value in held.items()}, held
