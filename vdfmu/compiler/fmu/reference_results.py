"""Reference results inside an FMU, `extra/org.fmi-standard.fmi-ls-ref/`, of the layered standard FMI-LS-REF.

They are independent of the generated C and of the unit's solver: continuous states come from scipy's LSODA at a
tolerance of 1e-12, everything else from the unit's methods in numpy. Inputs are constant between the rows of a table,
so co-simulation and model exchange have the same solution.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any
from xml.etree.ElementTree import Element, SubElement, register_namespace

import numpy as np

from vdfmu.base.cache import cache_folder, load_or_make
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.fmu.description import document
from vdfmu.compiler.unit.evaluate import Evaluation, Plain, evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import TOLERANCE, ScipySolver, margin

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
INTERVALS = 10
"""Number of intervals of the experiment, with constant inputs and a row of results at the end of each."""
_MOST_SOLVED = 480
"""Limit of the number of intervals times the number of continuous states, or joints, so that it takes a few seconds.
Beyond it the results end earlier."""
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_DIGITS = "%.12g"
"""Digits of the results; later ones differ between machines because of rounding."""


def reference_files(content: Content) -> dict[str, bytes]:
    """Return path in the FMU to content: manifest, inputs, results and a page about them; empty without results."""
    interface, name = content.interface, content.model_name
    outputs, inputs = columns(content, "output"), columns(content, "input")
    if not outputs:
        return {}
    stored = _stored(content)
    times = [_time(interface, k) for k in range(_intervals(interface) + 1)]
    files = {f"{FOLDER}/{name}_out.csv": _csv(outputs, times, stored["results"])}
    if inputs:
        # a change is two rows, with the values before and after it
        double = [t for t in times for _ in (0, 1)][1:-1]
        held = {group: [row for row in rows for _ in (0, 1)] for group, rows in stored["inputs"].items()}
        files[f"{FOLDER}/{name}_in.csv"] = _csv(inputs, double, held)
    files[f"{FOLDER}/fmi-ls-manifest.xml"] = document(_manifest(name, times[-1], bool(inputs)))
    files["documentation/fmi-ls-ref.txt"] = _page(interface, bool(inputs)).encode()
    return files


def _stored(content: Content) -> dict[str, Any]:
    """Return inputs and results by group, cached because they are the same for both versions of FMI."""
    identity = {"model": content.model_key, "start": content.interface.start_values().tolist()}
    file = cache_folder() / "reference" / sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    with np.errstate(all="ignore"):
        return load_or_make(file, lambda: json.dumps(reference_results(content.interface)).encode(), _tables)


def _tables(content: bytes) -> dict[str, Any]:
    """Read inputs and results; an exception for anything else."""
    stored = json.loads(content)
    return {name: dict(stored[name]) for name in ("inputs", "results")}


def reference_results(interface: Interface) -> dict[str, dict[str, list[list[float]]]]:
    """Return, by group, the ``inputs`` in each interval, and the ``results`` at the start and at the end of each."""
    unit = Plain(interface)
    held: list[dict[str, list[float]]] = []
    for k in range(_intervals(interface)):
        unit.memory[-1] = _time(interface, k)
        unit.experiment()
        # as rounded in the table
        row = _values(unit, "input")
        held.append({group: [float(_DIGITS % v) for v in values] for group, values in row.items()})
    rows = list(_rows(unit, held))
    return {
        "inputs": {group: [row[group] for row in held] for group in held[0]},
        "results": {group: [row[group] for row in rows] for group in rows[0] if all(group in row for row in rows)},
    }


def _intervals(interface: Interface) -> int:
    states = interface.states.stop - interface.states.start
    return max(1, min(INTERVALS, _MOST_SOLVED // max(states, interface.joints, 1)))


def _time(interface: Interface, k: int) -> float:
    """Return the start of an interval [s]."""
    return interface.unit.experiment_stop * k / INTERVALS


def _values(unit: Evaluation, causality: str) -> dict[str, list[float]]:
    """Return the values of a causality by group."""
    return {group: unit.memory[where].tolist() for group, where in unit.interface.groups_of(causality).items()}


def _rows(unit: Plain, held: Sequence[Mapping[str, list[float]]]) -> Iterator[dict[str, list[float]]]:
    """Yield the outputs after the initialization, then at the end of each interval."""
    interface = unit.interface
    hold = _time(interface, 1)
    moves = interface.has_states or interface.is_sampled or unit.at_events
    motion = ScipySolver(evaluation(interface, unit.memory) if moves else unit)  # tracing a long arm takes a while
    unit.memory[-1] = 0.0
    for group, values in held[0].items():
        unit.group(group)[:] = values
    unit.start()
    unit.outputs()
    motion.events.begin()
    yield _values(unit, "output")
    for k, row in enumerate(held):
        for group, values in row.items():
            unit.group(group)[:] = values
        motion.move(hold * k, hold * (k + 1))
        yield _settled(unit, hold * (k + 1))


def _settled(unit: Plain, t: float) -> dict[str, list[float]]:
    """Return the outputs at a time, except those that switch there, whose value depends on rounding of the time."""
    if not unit.switches:
        unit.outputs()
        return _values(unit, "output")
    sides: list[dict[str, list[float]]] = []
    for time in (t - 2.0 * margin(t), t + 2.0 * margin(t), t):
        unit.memory[-1] = time
        unit.outputs()
        sides.append(_values(unit, "output"))
    before, after, values = sides
    return {group: row for group, row in values.items() if np.allclose(before[group], after[group])}


Column = tuple[str, str, slice]
"""A variable, its group, and its elements in the group."""


def columns(content: Content, causality: str) -> list[Column]:
    """Return the columns of the table of inputs or outputs. In FMI 3.0 a column is an array.

    Variables with a comma in their name are omitted, because readers split the header at commas.
    """
    interface, groups = content.interface, content.interface.groups_of(causality)
    listed: list[Column] = []
    for array in interface.arrays:
        group = interface.memory[array.first].group
        if group not in groups:
            continue
        first = array.first - groups[group].start
        if content.fmi.arrays:
            listed.append((array.name, group, slice(first, first + array.size)))
        else:
            names = [v.name for v in interface.memory[array.positions]]
            listed += [(name, group, slice(first + i, first + i + 1)) for i, name in enumerate(names)]
    return [column for column in listed if "," not in column[0]]


def _csv(listed: Sequence[Column], times: Sequence[float], rows: Mapping[str, Sequence[Sequence[float]]]) -> bytes:
    """Return a table of variables over time; the elements of an array are separated by spaces."""
    listed = [column for column in listed if column[1] in rows]
    lines = [",".join(["time", *[name for name, _, _ in listed]])]
    for k, t in enumerate(times):
        cells = [_DIGITS % t]
        cells += [" ".join(_DIGITS % v for v in rows[group][k][where]) for _, group, where in listed]
        if all(np.isfinite(rows[group][k]).all() for _, group, _ in listed):
            lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode()


def _manifest(name: str, stop: float, has_inputs: bool) -> Element:
    register_namespace("fmi-ls", _NAMESPACE)
    stated = {
        "name": "org.fmi-standard.fmi-ls-ref",
        "version": "1.0.0-alpha.1",
        "description": "Layered Standard providing information on related files included in an FMU.",
    }
    root = Element("fmiReferences", {f"{{{_NAMESPACE}}}fmi-ls-{key}": text for key, text in stated.items()})
    inputs = (f"{name}_in.csv", "text/csv", "testcase", f"Inputs of an experiment of {stop:g} s")
    outputs = (f"{name}_out.csv", "text/csv", "result", f"Outputs of an experiment of {stop:g} s")
    page = ("../../documentation/fmi-ls-ref.txt", "text/plain", "document", "Description of the experiment")
    for source, kind, role, description in (*([inputs] if has_inputs else []), outputs, page):
        SubElement(root, "Related", type=kind, source=source, role=role, description=description)
    return root


def _page(interface: Interface, has_inputs: bool) -> str:
    name, stop = interface.model_name, _time(interface, _intervals(interface))
    hold = f"{_time(interface, 1):g} s"
    inputs = f"""Inputs: {name}_in.csv. They are constant for {hold} at a time; a change is two rows of the same
time. Co-simulation steps must end at each change of the inputs.
"""
    solved = f"""Solved by scipy's LSODA at a relative and absolute tolerance of {TOLERANCE:g}, not by the FMU's solver.
Expect differences of about the parameter `tolerance`, times the size of the variable.
"""
    calculated = "Computed from the equations in numpy, not by the FMU. Expect rounding differences.\n"
    return f"""Reference results of {name}

Start at 0 s, stop at {stop:g} s, all parameters at their start values.
{inputs if has_inputs else ""}\
Outputs: {name}_out.csv, at the end of each {hold}, before the inputs change; the first row is from
the initialization. Variables with a comma in their name are omitted in FMI 2.0.
{solved if interface.has_states else calculated}"""
