"""Checks of a system against its FMUs: connectors, connections, parameters, and values that the user gives."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from itertools import pairwise

from vdfmu.base.errors import SspError, UsageError
from vdfmu.base.text import close_to
from vdfmu.engine.fmu.description import Description, inspect_description
from vdfmu.engine.fmu.variables import CONVERT_TYPE, FmuVariable, feeds, type_of
from vdfmu.engine.package.archive import Archive, stamp_of
from vdfmu.engine.package.system import (
    BoundParameter,
    Component,
    Connection,
    Connector,
    FlatSystem,
    Index,
    Shape,
    UnitFactor,
    Value,
    factor_of,
    spread,
)
from vdfmu.engine.package.wiring import CONVERT, fits, show_shape
from vdfmu.engine.plan.conversion import Conversion, Link, MisfitError, Port, compose
from vdfmu.engine.rules import Finding, finding, notes_in, problems_in

Starts = dict[str, dict[str, tuple[FmuVariable, Value]]]
"""Variables and their values by component and name."""


def overrides(
    descriptions: Mapping[str, Description], parameters: Mapping[str, Value], present: Starts | None = None
) -> Starts:
    """Resolve the user's ``component.variable`` names; without an index they mean all elements.

    A factor, ``*0.8``, multiplies the number in `present`, else the start value; without `present` it is rejected.
    """
    starts: Starts = {}
    problems: list[str] = []
    for full, value in parameters.items():
        owners = [name for name in descriptions if full.startswith(name + ".")]
        if not owners:
            problems.append(f"parameter {full!r}: no component of that name; there are {', '.join(descriptions)}.")
            continue
        wanted = {
            owner: named for owner in owners if (named := _named(descriptions[owner].variables, full[len(owner) + 1 :]))
        }
        if not wanted:
            owner = max(owners, key=len)
            name = full[len(owner) + 1 :]
            text = unknown_variable(owner, name, descriptions[owner].named("parameter"))
            problems.append(f"parameter {full!r}: {text}")
        for owner, named in wanted.items():
            try:
                for name, element in zip(named, spread(value, named), strict=True):
                    variable = descriptions[owner].variables[name]
                    if not variable.settable:
                        raise ValueError(why_not(variable) + _start_of(name, descriptions[owner].variables))
                    if present is not None and variable.type in ("Real", "Integer"):
                        element = _multiplied(element, *present.get(owner, {}).get(name, (variable, variable.start)))
                    starts.setdefault(owner, {})[name] = (variable, variable.domain.read(element))
            except ValueError as error:
                problems.append(f"parameter {full!r}: {error}.")
    if problems:
        raise UsageError("\n".join(problems))
    return starts


def _multiplied(value: Value, variable: FmuVariable, present: Value) -> Value:
    """Return the product of a factor and the present value of a variable, or any other value unchanged."""
    if (factor := factor_of(value)) is None:
        return value
    if not isinstance(present, (int, float)):
        raise ValueError(f"{variable.name} has no number to multiply. Set a value instead")
    return factor * present


def unknown_variable(component: str, name: str, variables: Sequence[FmuVariable]) -> str:
    """Return a message that a component does not have a variable, with its variables of a causality."""
    groups = list(dict.fromkeys(v.name.partition("[")[0] for v in variables))
    kind = variables[0].causality if variables else "variable"
    more = f" and {len(groups) - 12} more" if len(groups) > 12 else ""
    close = close_to(name, [*(v.name for v in variables), *groups]) or "."
    return f"{component} has no variable {name!r}{close} Its {kind}s: {', '.join(groups[:12]) or 'none'}{more}."


def unfed(component: str, variable: str) -> Finding:
    """Return the finding on an input that has neither a connection nor a value."""
    return finding("SSP038", f"{component}.{variable}: input is not connected and keeps its start value")


def _named(variables: Mapping[str, FmuVariable], name: str) -> list[str]:
    return [name] if name in variables else [v for v in variables if v.startswith(f"{name}[")]


def _start_of(name: str, variables: Mapping[str, FmuVariable]) -> str:
    """Return the fix for a state that cannot be set: its start value, such as ``q_0[1]`` of ``q[1]``."""
    group, bracket, index = name.partition("[")
    start = f"{group}_0{bracket}{index}"
    return f". Set its start value, {start}" if start in variables and variables[start].settable else ""


def why_not(variable: FmuVariable) -> str:
    """Return why a variable cannot be set."""
    text = f"is not settable: causality {variable.causality}, variability {variable.variability}"
    return text + (f", initial {variable.initial}" if variable.initial else "")


_PAIRS = {("output", "input"), ("calculatedParameter", "parameter"), ("calculatedParameter", "input")}


class Checker:
    """Collects problems and notes of a system; for parameters see `vdfmu.engine.plan.check.check_system`."""

    def __init__(self, system: FlatSystem, ignore_unmatched: bool, parameters: Mapping[str, Value]) -> None:
        self.system, self.ignore_unmatched, self.parameters = system, ignore_unmatched, parameters
        self.findings = [*system.problems, *system.notes]
        self.descriptions: dict[str, Description] = {}
        self.clock_links: list[tuple[Port, Port]] = []
        self._reported: set[Hashable] = set()
        for text in system.unmatched:
            self._unmatched(text)

    def _unmatched(self, text: Finding) -> None:
        if self.ignore_unmatched:
            self.findings.append(finding("SSP057", f"{text}; the value is ignored", (text.file, text.line)))
        else:
            way = "ignore_unmatched, 'vdfmu run --ignore-unmatched'"
            self.findings.append(text.reworded(f"{text}; correct the name, or have it ignored: {way}"))

    def read(self) -> None:
        """Read the FMUs and check the connectors against their variables."""
        if not self.system.components:
            self.findings.append(finding("SSP023", f"{self.system.path.name}: the system has no components"))
        with ExitStack() as stack:
            path = self.system.path
            opened = cache(lambda: stack.enter_context(Archive(path, path.name)))
            for component in self.system.components:
                if not component.source:
                    continue  # it is among the system's problems
                description = self._inspect(opened, component, {})
                if description is not None and (sizes := self._sizes(component, description)):
                    description = self._inspect(opened, component, sizes)
                if description is not None:
                    self.descriptions[component.name] = description
                    for connector in component.connectors.values():
                        for rule, text in self._connector(connector, description):
                            text = f"{component.name}.{connector.name}: {text}"
                            self.findings.append(finding(rule, text, connector.place))
        self._same_names()
        users: dict[str, list[str]] = {}
        for name, description in self.descriptions.items():
            if description.once_per_process:
                users.setdefault(description.source, []).append(name)
        for source, names in users.items():
            if len(names) > 1:
                text = f"{', '.join(names)}: {source} can be instantiated only once per process"
                self.findings.append(finding("SSP046", text))

    def _inspect(
        self, package: Callable[[], Archive], component: Component, sizes: dict[str, Value]
    ) -> Description | None:
        """Read an FMU once for each choice of its sizes, shared between checks unless the package changes."""
        key = component.source, component.implementation, frozenset(sizes.items())
        read, place = self.system.inspected, (*key, stamp_of(self.system.path))
        if place not in read:
            try:
                with package().opened(component.source, component.source) as unit:
                    read[place] = inspect_description(unit, *key[:2], sizes)
            except SspError as error:
                read[place] = None, error.problems
        description, problems = read[place]
        if key not in self._reported:
            self._reported.add(key)
            self.findings += [problem.within(component.name) for problem in problems]
        return description

    def _sizes(self, component: Component, description: Description) -> dict[str, Value]:
        """Return the values of structural parameters that differ from their start values and are whole numbers."""
        stated = {p.name: p.value for p in component.parameters if not isinstance(p.value, tuple)}
        sizes: dict[str, Value] = {}
        for v in description.named("structuralParameter"):
            value = self.parameters.get(f"{component.name}.{v.name}", stated.get(v.name, v.start))
            with suppress(ValueError):  # the check of its value reports it
                size = v.domain.read(value)
                sizes |= {v.name: size} if size != v.start else {}
        return sizes

    def _same_names(self) -> None:
        """Note variables of two components with the same dotted name, because results show only one."""
        for name, description in self.descriptions.items():
            parts = name.split(".")
            for i in range(1, len(parts)):
                outer, inner = ".".join(parts[:i]), ".".join(parts[i:])
                names = self.descriptions[outer].variables if outer in self.descriptions else {}
                for variable in description.variables:
                    if f"{inner}.{variable}" in names:
                        text = f"{name}.{variable}: two variables have this name, of {outer} and of {name}"
                        self.findings.append(finding("SSP021", f"{text}; rename a component"))

    def _connector(self, connector: Connector, description: Description) -> Iterator[tuple[str, str]]:
        """Yield the rules that a connector breaks, compared with the variable of the same name."""
        shape = description.shapes.get(connector.name, ())
        variable = next(iter(description.elements(connector.name)), None)
        if variable is None:
            yield "SSP040", f"{description.source} has no such variable{close_to(connector.name, description.names)}"
            return
        if connector.kind not in (variable.causality, "unspecified"):
            yield "SSP041", f"the SSD declares kind {connector.kind!r}, the FMU causality {variable.causality!r}"
        if connector.type is not None and not _same_type(connector.type, variable.declared):
            yield "SSP042", f"the SSD declares type {connector.type}, the FMU {variable.declared}"
        elif connector.unit and variable.unit is not None:
            declared = self._unit(connector.unit)
            if not declared.same_as(variable.unit):
                units = [f"{unit.name!r} ({_full(unit)})" for unit in (declared, variable.unit)]
                yield "SSP043", f"unit mismatch, the SSD declares {units[0]}, the FMU {units[1]}"
        if not fits(connector.dimensions, shape):
            yield "SSP044", f"the SSD declares {show_shape(connector.dimensions)}, the FMU {show_shape(shape)}"

    def _unit(self, name: str) -> UnitFactor:
        return self.system.units.get(name, UnitFactor(name))

    def port_unit(self, port: Port, variable: FmuVariable) -> UnitFactor | None:
        """Return the unit in the FMU, else that of the connector in the SSD."""
        if variable.unit is not None:
            return variable.unit
        connector = self.system.component(port[0]).connectors.get(port[1])
        return self._unit(connector.unit) if connector is not None and connector.unit else None

    def _as_declared(self, port: Port, variable: FmuVariable) -> bool:
        """Whether the connector's kind fits the variable; mismatches are reported with the connectors."""
        kind = self.system.component(port[0]).connectors[port[1]].kind
        return kind in (variable.causality, "unspecified")

    def _elements(self, port: Port, index: Index = ()) -> tuple[list[FmuVariable], Shape]:
        """Return the variables at one end of a connection, if any, and their shape."""
        description = self.descriptions.get(port[0])
        if description is None:
            return [], ()
        return description.elements(port[1], index), description.shapes.get(port[1], ())[len(index) :]

    def link(self) -> list[Link]:
        """Check every connection."""
        links: list[Link] = []
        for connection in self.system.connections:
            ends = (connection.start, connection.end)
            (sources, shape), (sinks, other) = map(self._elements, ends, connection.indices)
            if not sources or not sinks:
                continue  # reported with the connectors
            source, sink, stepped = sources[0], sinks[0], sources[0].causality == "output"
            if source.type == sink.type == "Clock":
                self.clock_links.append(ends)
                continue

            def fault(rule: str, text: str, connection: Connection = connection) -> None:
                self.findings.append(finding(rule, f"connection {connection}: {text}", connection.hops[-1].place))

            types = [source.declared, *(h.type for h in connection.hops[:-1] if h.type), sink.declared]
            if not all(feeds(*pair) for pair in pairwise(types)):
                fault("SSP033", f"type mismatch, {' to '.join(types)}. {CONVERT_TYPE}")
                continue
            if (source.causality, sink.causality) not in _PAIRS:
                if self._as_declared(connection.start, source) and self._as_declared(connection.end, sink):
                    kinds = f"{source.causality} to {sink.causality}"
                    fault("RUN007", f"the master passes no values from {kinds}; set the value in a parameter set")
                continue
            if sink.causality == "parameter" and not (sink.settable and sink.variability != "constant"):
                fault("SSP053", f"parameter {'.'.join(connection.end)} is not settable")
            conversion = Conversion()
            try:
                conversion = compose(
                    connection.hops,
                    self.port_unit(connection.start, source),
                    self.port_unit(connection.end, sink),
                    sink.type,
                    self.system.units,
                    sink.relative,
                    (source.items, sink.items),
                )
            except MisfitError as error:
                fault(_OF_CONNECTION[error.kind], f"{error}. {CONVERT}" if error.kind == "unit" else str(error))
            unit, target = self.port_unit(connection.start, source), self.port_unit(connection.end, sink)
            suppressed = any(hop.suppress_unit_conversion for hop in connection.hops) and source.type == "Real"
            if suppressed and unit is not None and target is not None and not unit.same_as(target):
                text = f"connection {connection}: passes {unit.name!r} as {target.name!r}, without a conversion"
                self.findings.append(finding("SSP058", text, connection.hops[-1].place))
            if shape != other:
                fault("SSP035", f"dimension mismatch, {show_shape(shape)} to {show_shape(other)}")
            links += [
                Link((connection.start[0], a.name), (connection.end[0], b.name), a, b, conversion, stepped)
                for a, b in zip(sources, sinks, strict=False)
            ]
        return links

    def inputs(self, links: Sequence[Link]) -> None:
        """Report the unconnected inputs."""
        set_here = {(p.component, p.name): () for c in self.system.components for p in c.parameters}
        named = {c.end: c.indices[1] for c in self.system.connections} | set_here
        fed = {link.end for link in links}
        fed |= {(port[0], v.name) for port, index in named.items() for v in self._elements(port, index)[0]}
        for name, description in self.descriptions.items():
            for variable in description.named("input"):
                if variable.clock is not None and not variable.clock.triggered:
                    continue  # the master ticks it
                if (name, variable.name) not in fed:
                    self.findings.append(unfed(name, variable.name))

    @property
    def problems(self) -> list[Finding]:
        """Problems that prevent the run."""
        return problems_in(self.findings)

    @property
    def notes(self) -> list[Finding]:
        """Notes that do not prevent it."""
        return notes_in(self.findings)

    def start_values(self) -> Starts:
        """Check the bound parameters and convert them to the units of the FMUs."""
        starts: Starts = {}
        for component in self.system.components:
            description = self.descriptions.get(component.name)
            if description is None:
                continue
            for parameter in (*component.overruled, *component.parameters):
                where = f"{component.name}: parameter {parameter.name!r} ({parameter.origin})"
                elements, shape = self._elements((component.name, parameter.name))
                if not elements:
                    if not any(self._exists(*place) for place in parameter.elsewhere):
                        text = f"{where}: {description.source} has no such variable"
                        text += close_to(parameter.name, description.names)
                        self._unmatched(finding("SSP052", text, parameter.place))
                    continue
                values = parameter.value if isinstance(parameter.value, tuple) else (parameter.value,)
                faults = [("SSP053", why_not(elements[0]))] if not elements[0].settable else []
                if not fits(parameter.dimensions, shape):
                    sizes = f"is {show_shape(parameter.dimensions)}, the FMU declares {show_shape(shape)}"
                    faults.append(("SSP054", sizes))
                for variable, value in zip(elements, values, strict=False) if not faults else ():
                    try:
                        value = self._converted(parameter, value, variable)
                        starts.setdefault(component.name, {})[variable.name] = (variable, value)
                    except MisfitError as error:
                        faults.append((_OF_VALUE[error.kind], str(error)))
                for rule, text in dict.fromkeys(faults):
                    self.findings.append(finding(rule, f"{where}: {text}", parameter.place))
        return starts

    def _exists(self, component: str, name: str) -> bool:
        """Return whether a component has a variable; connectors of systems always exist."""
        description = self.descriptions.get(component)
        return description is None or bool(description.elements(name))

    def _converted(self, parameter: BoundParameter, value: Value, variable: FmuVariable) -> Value:
        hops = parameter.hops
        if isinstance(value, str) and variable.type == "Enumeration":  # an enumeration is mapped by its items
            for hop in hops:
                if hop.transformation is not None and hop.transformation.kind == "enumeration":
                    value = hop.transformation.names.get(value, value)
            hops = ()
        domain = variable.domain  # the limits apply to the converted value
        mapped = any(hop.transformation is not None for hop in hops)
        names = None if mapped else domain.names
        try:
            if parameter.type == "String" != variable.type:
                raise domain.misfit(value)
            value = domain._replace(low=None, high=None, names=names).read(value)
        except ValueError as error:
            raise MisfitError("type", str(error)) from None
        unit = self.port_unit((parameter.component, parameter.name), variable)
        conversion = compose(
            hops,
            parameter.unit,
            unit,
            variable.type,
            self.system.units,
            variable.relative,
            (variable.items, variable.items),
        )
        if conversion.table is not None:
            value = conversion.table.get(int(value), int(value))
        elif isinstance(value, float) and not conversion.trivial:
            value = conversion.factor * value + conversion.offset
        try:
            return domain.read(value)
        except ValueError as error:
            raise MisfitError("limit", str(error)) from None


_OF_CONNECTION = {"type": "SSP033", "unit": "SSP034", "transformation": "SSP036"}
_OF_VALUE = {"type": "SSP054", "unit": "SSP055", "limit": "SSP056", "transformation": "SSP036"}
"""Kind of mismatch to the rule that it breaks."""
_SAME = {"Real": "Float64", "Integer": "Int32"}
"""Types of SSP 1.0 and FMI 2.0 to types of SSP 2.0 and FMI 3.0."""


def _same_type(stated: str, declared: str) -> bool:
    """Return whether a connector has the type of a variable; types of SSP 1.0 match any number of bits."""
    if stated in _SAME:
        return stated == type_of(declared)
    return stated == _SAME.get(declared, declared)


def _full(unit: UnitFactor) -> str:
    factor, offset = (repr(value).removesuffix(".0") for value in (unit.factor, unit.offset))
    scale = f", factor {factor}, offset {offset}"
    return unit.dimension + (scale if (unit.factor, unit.offset) != (1.0, 0.0) else "")
