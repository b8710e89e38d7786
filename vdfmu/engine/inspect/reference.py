"""Comparison of an FMU with the reference results that it carries (layered standard FMI-LS-REF)."""

from __future__ import annotations

import csv
import io
import posixpath
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import SspError
from vdfmu.engine.fmu.component import ComponentInstance
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.inspect.abilities import described
from vdfmu.engine.inspect.findings import Findings
from vdfmu.engine.inspect.fmi import MANIFEST, REFERENCES
from vdfmu.engine.inspect.said import Said
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.rules import finding

# Reference results say nothing of the solver's tolerance. This is far above those in use and far below a wrong result.
AGREEMENT = 1e-3

_MANY = 20_000
"""Steps that a comparison may take in any case: seconds for a compiled unit, less than the time limit for others."""
_INTEGERS = tuple(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64))
_NUMBERS = {"Float64", "Float32", "Real", "Integer", "Boolean", "Enumeration", *_INTEGERS}
"""Types that a cell of the table can hold."""


class _NotComparedError(Exception):
    """Reasons, not faults of the FMU, for leaving results out."""


@dataclass(frozen=True)
class ReferenceTable:
    """Columns over time; a cell holds one number, or the elements of an array with spaces between them."""

    time: Floats
    columns: Mapping[str, Floats]


def refuse_negative(call: str) -> None:
    """Raise for a call, as fmpy logs it, that returned a status below 0. fmpy takes such a status for success."""
    if match := re.fullmatch(r"(\w+)\(.*\) -> (-\d+)", call, re.DOTALL):
        raise FMICallException(function=match[1], status=int(match[2]))


def compare(path: Path) -> Findings:
    """Compare the results of an FMU with every table of reference results in it."""
    findings = Findings()
    description = fmpy.read_model_description(str(path), validate=False)
    variables = {v.name: v for v in description.modelVariables}
    with zipfile.ZipFile(path) as archive:
        for name, inputs in _tables(archive, findings).items():
            short, said = posixpath.basename(name), Said()
            try:
                version = description.fmiVersion or ""
                if version == "1.0":
                    raise _NotComparedError("reference results are defined for FMI 2.0 and 3.0")
                expected = _results_of(archive, name, variables, findings)
                signals = _inputs_of(archive, inputs, variables)
                results = (
                    _results_3(path, description, variables, expected, signals, said)
                    if version.startswith("3") and description.coSimulation is not None
                    else _simulated(path, description, expected, signals, said)
                )
                findings.problems += [
                    finding("RUN003", f"{short}: {problem}") for problem in _differences(expected, results)
                ]
                findings.compared.append(short)
            except _NotComparedError as reason:
                _leave(findings, name, str(reason))
            except Exception as error:  # foreign files and units
                text = f"{short}: the reference results cannot be compared: {said.with_error(error)}"
                findings.problem("RUN003", text)
    return findings


def _tables(archive: zipfile.ZipFile, findings: Findings) -> dict[str, str | None]:
    """Return the tables of results, each with that of its inputs: by the manifest, experiments, or their own names.

    A manifest may name a file that is not there: other tools may have removed it (FMI-LS-REF, Related Files).
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
                findings.problems += [finding("RUN003", text) for text in error.problems]
    return tables


_RESULTS = ("_out.csv", "_ref.csv")


def _beside(name: str, names: set[str]) -> str | None:
    """Return the inputs of a table of results, by its own name."""
    inputs = next((f"{name.removesuffix(ending)}_in.csv" for ending in _RESULTS if name.endswith(ending)), "")
    return inputs if inputs in names else None


def _named(element: Any, owner: str) -> str:
    """Return the member that a source names, from the folder of the file that does."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(owner), unquote(element.get("source", ""))))


def _leave(findings: Findings, name: str, why: str) -> None:
    findings.note("RUN004", f"{posixpath.basename(name)}: not compared: {why}")


def _experiments(root: Any, owner: str, names: set[str], findings: Findings) -> dict[str, str | None]:
    """Return the tables of a file of experiments (modelica/ma-hs-experiments), each with that of its inputs."""
    found: dict[str, str | None] = {}
    for experiment in root.iterfind("{*}Experiment"):
        given = {tag: experiment.find(f"{{*}}{tag}") for tag in ("References", "Stimuli", "Parameters")}
        tables = [_named(each, owner) for each in (given["References"], given["Stimuli"]) if each is not None]
        where = f"{posixpath.basename(owner)}, experiment {experiment.get('name')!r}"
        if given["References"] is None:
            _leave(findings, where, "it has no reference results")
        elif given["Parameters"] is not None:
            _leave(findings, where, f"it sets the parameters of {given['Parameters'].get('source')!r}")
        elif lacking := [name for name in tables if name not in names or not name.endswith(".csv")]:
            _leave(findings, where, f"expected a .csv file of the FMU, got {', '.join(lacking)}")
        else:
            found[tables[0]] = tables[1] if given["Stimuli"] is not None else None
    if not root.tag.endswith("Experiments"):
        _leave(findings, owner, f"its root is {root.tag!r}, not 'Experiments'")
    return found


def _results_of(
    archive: zipfile.ZipFile, name: str, variables: Mapping[str, Any], findings: Findings
) -> ReferenceTable:
    """Return the columns that can be compared; a note names the others.

    One table may serve several FMUs, so a column need not have a variable in each.
    """
    left: dict[str, list[str]] = {}

    def skip(column: str) -> bool:
        kind = variables[column].type if column in variables else None
        if kind in _NUMBERS:
            return False
        why = f"of type {kind}, which a table of numbers does not hold" if kind else "the unit has no such variable"
        left.setdefault(why, []).append(column)
        return True

    table = read_table(archive.read(name).decode("utf-8-sig"), skip)
    short = posixpath.basename(name)
    findings.notes += [
        finding("RUN004", f"{short}: {', '.join(columns)}: not compared: {why}") for why, columns in left.items()
    ]
    if not table.columns:
        raise _NotComparedError("it has no column that can be")
    return table


def _inputs_of(archive: zipfile.ZipFile, inputs: str | None, variables: Mapping[str, Any]) -> ReferenceTable | None:
    """Return the inputs that belong to a table of results; raise for a column that cannot be fed."""
    if inputs is None:
        return None

    def check(column: str) -> bool:
        if column not in variables:
            raise ValueError(f"the unit has no variable {column!r}")
        if variables[column].type not in _NUMBERS:
            raise _NotComparedError(f"the input {column!r} is of type {variables[column].type}")
        return False

    return read_table(archive.read(inputs).decode("utf-8-sig"), check)


def read_table(text: str, skip: Callable[[str], bool] = lambda column: False) -> ReferenceTable:
    """Read a table without the columns for which `skip` holds; ValueError names the line that is wrong."""
    rows = [row for row in csv.reader(io.StringIO(text), skipinitialspace=True) if row]
    if len(rows) < 2 or len(rows[0]) < 2:
        raise ValueError("expected a head with 'time' and variables, and at least one row")
    head = [name.strip() for name in rows[0]]
    kept = [0, *(k for k, name in enumerate(head) if k and not skip(name))]
    values: list[list[list[float]]] = []
    for line, row in enumerate(rows[1:], start=2):
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
        raise ValueError(f"line {int(np.argmin(np.isfinite(time))) + 2}: times must be finite")
    if not np.all(np.diff(time) >= 0.0):
        raise ValueError("times must not decrease")
    return ReferenceTable(time, columns)


def _number(text: str) -> float:
    truth = {"true": 1.0, "false": 0.0}
    return truth[text.lower()] if text.lower() in truth else float(text)


def _differences(expected: ReferenceTable, results: Mapping[str, Floats]) -> list[str]:
    """Return the variables that differ too much, each at its worst time and, for an array, its worst element."""
    problems: list[str] = []
    for name, wanted in expected.columns.items():
        error = np.abs(results[name] - wanted)
        scaled = error / (1.0 + np.abs(wanted))
        row, element = np.unravel_index(int(np.argmax(np.where(np.isnan(scaled), np.inf, scaled))), error.shape)
        if not scaled[row, element] <= AGREEMENT:
            where = name if wanted.shape[1] == 1 else f"{name}, element {element + 1}"
            problems.append(
                f"{where} at t = {expected.time[row]:g} s: expected {wanted[row, element]:.9g}, "
                f"differs by {error[row, element]:.3g}"
            )
    return problems


def _simulated(
    path: Path, description: Any, expected: ReferenceTable, signals: ReferenceTable | None, said: Said
) -> dict[str, Floats]:
    """Return the results of an FMU 2.0, or of one that FMPy's solver integrates, at the times of a table."""
    names, time = list(expected.columns), expected.time
    fed: Any = None
    if signals is not None:
        kinds: list[Any] = [("time", float)]
        kinds += [(name, float, c.shape[1:] if c.shape[1] > 1 else ()) for name, c in signals.columns.items()]
        fed = np.zeros(len(signals.time), dtype=kinds)
        fed["time"] = signals.time
        for name, column in signals.columns.items():
            fed[name] = column if column.shape[1] > 1 else column[:, 0]
    steps = np.diff(time)
    step = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 1e-3
    count = (time[-1] - time[0]) / step
    if count > max(_MANY, 2 * len(time)):
        raise _NotComparedError(
            f"two rows are {step:g} s apart; steps of that size from the first row to the last would be {count:.3g}"
        )
    kind = "CoSimulation" if description.coSimulation is not None else "ModelExchange"
    try:
        result: Any = fmpy.simulate_fmu(
            str(path), validate=False, fmi_type=kind, start_time=time[0], stop_time=max(time[-1], time[0] + step),
            output_interval=step, input=fed, output=names, logger=said, fmi_call_logger=refuse_negative,
            remote_platform=None,  # pyright: ignore[reportArgumentType]
        )  # fmt: skip
    finally:
        said.stay()
    columns = {name: result[name].reshape(len(result), -1).T for name in names}
    return {name: np.stack([np.interp(time, result["time"], x) for x in c], 1) for name, c in columns.items()}


def _results_3(
    path: Path,
    description: Any,
    variables: Mapping[str, Any],
    expected: ReferenceTable,
    signals: ReferenceTable | None,
    said: Said,
) -> dict[str, Floats]:
    """Return the results of an FMU 3.0 at the times of a table: arrays set and read at every communication point."""
    folder, known = fmpy.extract(str(path)), described(path)
    if known is not None and known.sandboxed:
        own = ComponentInstance("check", known, Path(folder), MessageBox(lambda message: None), set())
        own.instantiate()
        instance: Any = own.fmu
    else:
        instance = FMU3Slave(
            guid=description.guid, unzipDirectory=folder, instanceName="check",
            modelIdentifier=description.coSimulation.modelIdentifier, fmiCallLogger=refuse_negative,
        )  # fmt: skip
    start, stop = float(expected.time[0]), float(expected.time[-1])
    points = expected.time if signals is None else np.concatenate([expected.time, signals.time])
    points = np.unique(points[(points >= start) & (points <= stop)])
    results = {name: np.empty_like(column) for name, column in expected.columns.items()}
    try:
        if isinstance(instance, FMU3Slave):
            instance.instantiate(logMessage=said)
        instance.enterInitializationMode(startTime=start, stopTime=stop)
        _feed(instance, variables, signals, start)
        instance.exitInitializationMode()
        for index, time in enumerate(points):
            if index:
                instance.doStep(points[index - 1], time - points[index - 1])
            for row in np.flatnonzero(expected.time == time):
                for name, column in results.items():
                    get = getattr(instance, f"get{_accessor(variables[name])}")
                    column[row] = get([variables[name].valueReference], nValues=column.shape[1])
            _feed(instance, variables, signals, float(time))
        instance.terminate()
        return results
    finally:
        instance.freeInstance()


def _feed(instance: Any, variables: Mapping[str, Any], signals: ReferenceTable | None, time: float) -> None:
    """Set the inputs to their values from a time on: between two rows continuous ones change linearly."""
    if signals is None:
        return
    last = max(int(np.searchsorted(signals.time, time, side="right")) - 1, 0)
    following = min(last + 1, len(signals.time) - 1)
    span = signals.time[following] - signals.time[last]
    part = (time - signals.time[last]) / span if span > 0.0 and time > signals.time[last] else 0.0
    for name, column in signals.columns.items():
        variable = variables[name]
        value = column[last]
        if variable.variability == "continuous":
            value = value + part * (column[following] - value)
        kind = _accessor(variable)
        cast = float if kind.startswith("Float") else bool if kind == "Boolean" else int
        getattr(instance, f"set{kind}")([variable.valueReference], [cast(x) for x in value])


def _accessor(variable: Any) -> str:
    return "Int64" if variable.type == "Enumeration" else str(variable.type)
