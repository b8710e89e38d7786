"""Writes FMUs and the connections between them as a system package (SSP 1.0)."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vdfmu.base.errors import SspError, UsageError
from vdfmu.base.files import pack_zip, require_ours, storing
from vdfmu.base.measure import BASE_UNITS
from vdfmu.base.text import close_to, name_fault
from vdfmu.engine.fmu.description import Description, inspect_description
from vdfmu.engine.fmu.variables import FmuVariable, type_of
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.parse import FOREIGN, META, add, add_experiment, root, to_bytes
from vdfmu.engine.package.system import Connections, UnitFactor, ends_of
from vdfmu.engine.plan.check import require_algorithm
from vdfmu.engine.plan.checker import Starts, overrides, unknown_variable
from vdfmu.engine.results.recorded import group_of

_TYPES = {"Real", "Integer", "Boolean", "String"}
"""Types of SSP 1.0 that need no further attributes; for other types a connector may omit the type."""
JOINED = "system"
"""Name of a system without another name."""
_CAUSALITIES = {"from": ("output", "calculatedParameter", "parameter"), "to": ("input", "parameter")}


def join(
    fmus: Mapping[str, str | os.PathLike[str]],
    connections: Connections,
    path: Path,
    *,
    name: str = JOINED,
    stop: float | None = None,
    step: float | None = None,
    algorithm: str | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> Path:
    """Write FMUs and their connections as a package.

    Parameters
    ----------
    fmus : mapping of component to path
        FMUs of any tool.
    connections : mapping of output to input or inputs, or sequence of such pairs
        ``component.variable``. A name without an index means all elements of a vector.
    path : Path
        The package to write.
    name : str, optional
        Name of the system.
    stop, step : float, optional [s]
        Stop time and communication step of its default experiment. They default to the longest stop time and the
        shortest step of the FMUs' default experiments, else to 1 s and a thousandth of the stop time.
    algorithm : str, optional
        Master algorithm of its default experiment.
    parameters : mapping of ``component.variable`` to value, optional
        Values of parameters and start values of inputs, in the units of the FMUs.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    UsageError
        For unknown components or variables, and for vectors of different lengths. It lists all faults.
    SspError
        If an FMU cannot be read.
    StorageError
        If the file cannot be written.
    """
    if not fmus:
        raise UsageError("components must be at least one, got none. Give a name and an FMU: {'plant': 'Plant.fmu'}.")
    for each, dots in (*dict.fromkeys(fmus, False).items(), (name, True)):
        if expected := name_fault(each, dots):
            raise UsageError(f"{'name' if dots else 'component'}: expected {expected}, got {each!r:.60}.")
    for key, time in (("stop", stop), ("step", step)):
        if time is not None and not 0.0 < time < math.inf:
            raise UsageError(f"{key}: expected a positive finite time in s, got {time:g}.")
    require_algorithm(algorithm)
    ports = _Ports({component: _described(component, Path(fmu)) for component, fmu in fmus.items()})
    read = ports.descriptions.values()
    stop = max((each.stop for each in read if each.stop is not None), default=1.0) if stop is None else stop
    step = min((each.step for each in read if each.step is not None), default=1e-3 * stop) if step is None else step
    pairs = [pair for start, end in ends_of(connections) for pair in ports.pairs(start, end)]
    bound: Starts = {}
    try:
        bound = overrides(ports.descriptions, parameters or {}, {})
    except UsageError as error:
        ports.faults += str(error).splitlines()
    if ports.faults:
        raise UsageError("\n".join(dict.fromkeys(ports.faults)))
    require_ours(path)
    with storing(path):
        members = {f"resources/{component}.fmu": Path(fmu).read_bytes() for component, fmu in fmus.items()}
        text = to_bytes(_structure(ports, pairs, bound, name, (stop, step, algorithm)))
        path.parent.mkdir(parents=True, exist_ok=True)
        pack_zip(path, {"SystemStructure.ssd": text, **members})
    return path


def _described(component: str, path: Path) -> Description:
    with Archive(path, path.name) as archive:
        description, problems = inspect_description(archive, path.name)
    if description is None:
        raise SspError([problem.within(component) for problem in problems])
    return description


class _Ports:
    """The variables of the components by the names that users write, and the faults of these names."""

    def __init__(self, descriptions: Mapping[str, Description]) -> None:
        self.descriptions = descriptions
        self.faults: list[str] = []

    def elements(self, text: str, causalities: Sequence[str], where: str) -> list[FmuVariable]:
        """Return the variables of ``component.variable``; if their causality is wrong, add a fault and return none."""
        component, _, wanted = text.partition(".")
        description = self.descriptions.get(component)
        if description is None:
            names = ", ".join(self.descriptions)
            self.faults.append(
                f"{where}: component must be one of {names}, got {component!r}{close_to(component, self.descriptions)}."
            )
            return []
        matches = description.elements(wanted) or [
            v for v in description.variables.values() if group_of(v.name)[0] == wanted
        ]
        matches = sorted(matches, key=lambda v: group_of(v.name)[1])
        if not matches:
            self.faults.append(f"{where}: {unknown_variable(component, wanted, description.named(causalities[0]))}")
        elif matches[0].causality not in causalities:
            got = f"{component}.{matches[0].name} is of causality {matches[0].causality}"
            self.faults.append(f"{where}: must go from an output to an input, but {got}.")
            return []
        return matches

    def pairs(self, start: str, end: str) -> list[tuple[tuple[str, FmuVariable], tuple[str, FmuVariable]]]:
        """Return the pairs of variables of a connection, element by element."""
        where, source, sink = f"{start} -> {end}", start.partition(".")[0], end.partition(".")[0]
        sources = self.elements(start, _CAUSALITIES["from"], where)
        sinks = self.elements(end, _CAUSALITIES["to"], where)
        if sources and sinks and len(sources) != len(sinks):
            self.faults.append(
                f"{where}: lengths must be equal, got {len(sources)} and {len(sinks)}. Connect elements: "
                f"{source}.{sources[0].name} -> {sink}.{sinks[0].name}."
            )
            return []
        return [((source, a), (sink, b)) for a, b in zip(sources, sinks, strict=False)]

    @property
    def units(self) -> dict[str, UnitFactor]:
        """The defined units of measurement; of several with the same name, the first."""
        units: dict[str, UnitFactor] = {}
        for description in self.descriptions.values():
            for variable in description.variables.values():
                if variable.unit is not None and variable.unit.exponents is not None:
                    units.setdefault(variable.unit.name, variable.unit)
        return units


def _is_plain(unit: UnitFactor | None) -> bool:
    """Return whether a unit of measurement is 1, which signals of any quantity may declare."""
    return unit is not None and unit.exponents is not None and not any(unit.exponents) and unit.factor == 1.0


def _structure(ports: _Ports, pairs: Any, bound: Starts, name: str, experiment: tuple[Any, Any, Any]) -> Any:
    units = ports.units
    top = root(
        "ssd:SystemStructureDescription", {"version": "1.0", "name": name, **META}, ("ssd", "ssc", "ssv", *FOREIGN)
    )
    system = add(top, "ssd:System", name=name)
    elements = add(system, "ssd:Elements")
    for component, description in ports.descriptions.items():
        element = add(
            elements,
            "ssd:Component",
            name=component,
            source=quote(f"resources/{component}.fmu"),
            type="application/x-fmu-sharedlibrary",
        )
        variables = [v for kind in ("input", "output") for v in description.named(kind)]
        used = {id(v): v for pair in pairs for owner, v in pair if owner == component}
        variables += [v for v in used.values() if v.causality not in ("input", "output")]
        box = add(element, "ssd:Connectors") if variables else None
        for variable in variables:
            connector = add(box, "ssd:Connector", name=variable.name, kind=variable.causality)
            kind, unit = type_of(variable.declared), variable.unit
            if kind in _TYPES:
                defined = kind == "Real" and unit is not None and unit == units.get(unit.name)
                add(connector, f"ssc:{kind}", unit=unit.name if unit is not None and defined else None)
        if component in bound:
            binding = add(add(element, "ssd:ParameterBindings"), "ssd:ParameterBinding")
            values = add(add(binding, "ssd:ParameterValues"), "ssv:ParameterSet", version="1.0", name=component)
            listed = add(values, "ssv:Parameters")
            for variable, value in bound[component].values():
                kind = type_of(variable.native)
                kind = kind if kind in _TYPES else "Integer"
                add(add(listed, "ssv:Parameter", name=variable.name), f"ssv:{kind}", value=value)
    wires = add(system, "ssd:Connections") if pairs else None
    for (start, source), (end, sink) in pairs:
        plain = source.unit != sink.unit and (_is_plain(source.unit) or _is_plain(sink.unit))
        add(
            wires,
            "ssd:Connection",
            startElement=start,
            startConnector=source.name,
            endElement=end,
            endConnector=sink.name,
            suppressUnitConversion="true" if plain else None,
        )
    if units:
        box = add(top, "ssd:Units")
        for unit in units.values():
            powers = {base: power for base, power in zip(BASE_UNITS, unit.exponents or (), strict=True) if power}
            scale = {"factor": unit.factor if unit.factor != 1.0 else None, "offset": unit.offset or None}
            add(add(box, "ssc:Unit", name=unit.name), "ssc:BaseUnit", **powers, **scale)
    stop, step, algorithm = experiment
    add_experiment(top, stop, step, algorithm=algorithm)
    return top
