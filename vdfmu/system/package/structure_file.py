"""Files of a system package: structure (SSD) with a diagram, parameter sets (SSV), mappings (SSM) and a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from vdfmu.base.measure import measure
from vdfmu.base.page import page, table
from vdfmu.base.version import __version__
from vdfmu.engine.package.parse import FOREIGN, META, add, add_experiment, root
from vdfmu.system.package.description import PackageSignal, ParameterSet, SystemDescription, positions
from vdfmu.system.package.drawing import draw_system, icon_source


def add_units(parent: Any, name: str, units: Iterable[str]) -> None:
    """Append ``prefix:Units`` with the definitions, if any."""
    wanted = sorted(units)
    if wanted:
        element = add(parent, name)
        for unit in wanted:
            add(add(element, "ssc:Unit", name=unit), "ssc:BaseUnit", **measure(unit).exponents)


def value_text(kind: str, value: Any) -> str:
    """Return a parameter's value as text for its SSP type."""
    if kind == "Boolean":
        return str(bool(value)).lower()
    return str(int(value)) if kind in ("Integer", "Int32") else repr(float(value))


_SIDES = {"input": 0.0, "output": 1.0}
_MARGIN = 12.0
"""Margin around the boxes [mm], twice as large above because of the note."""


def structure_file(description: SystemDescription) -> Any:
    """Return the root element of the SSD."""
    scenario = description.scenario
    attributes = {
        "version": description.version,
        "name": description.full_name,
        "description": f"{description.description}. {scenario.description}",
        **META,
    }
    top = root("ssd:SystemStructureDescription", attributes, ("ssd", "ssc", *FOREIGN))
    system = add(top, "ssd:System", name=description.name, description=description.description)
    elements = add(system, "ssd:Elements")
    for component in description.corners:
        _add_component(elements, description, component)
    connections = add(system, "ssd:Connections") if description.links else None
    for link in description.links:
        (start_unit, start), (end_unit, end) = link.start, link.end
        add(
            connections,
            "ssd:Connection",
            startElement=start_unit,
            startConnector=start.name,
            startIndices=" ".join(map(str, link.start_index)) or None,
            endElement=end_unit,
            endConnector=end.name,
            endIndices=" ".join(map(str, link.end_index)) or None,
        )
    left, low, right, high = zip(*description.corners.values(), strict=True)
    x1, y1, x2, y2 = min(left) - _MARGIN, min(low) - _MARGIN, max(right) + _MARGIN, max(high) + 2 * _MARGIN
    add(system, "ssd:SystemGeometry", x1=x1, y1=y1, x2=x2, y2=y2)
    note = f"{description.description}.\n{scenario.description}."
    add(
        add(system, "ssd:GraphicalElements"), "ssd:Note", x1=x1 + 4.0, y1=y2 - 20.0, x2=x2 - 4.0, y2=y2 - 2.0, text=note
    )
    add_units(top, "ssd:Units", description.measures)
    add_experiment(
        top,
        scenario.stop,
        float(scenario.step),
        algorithm=scenario.algorithm,
        solverTolerance=description.tolerance,
        adaptive=scenario.adaptive,
    )
    return top


def _add_component(elements: Any, description: SystemDescription, component: str) -> None:
    x1, y1, x2, y2 = description.corners[component]
    table = description.tables[component]
    element = add(
        elements,
        "ssd:Component",
        name=component,
        description=table.description,
        type="application/x-fmu-sharedlibrary",
        source=f"resources/{description.fmu_name(component)}",
        implementation=table.implementation,
    )
    connectors = add(element, "ssd:Connectors")
    for kind, x in _SIDES.items():
        signals = description.signals(component, kind)
        for signal, y in zip(signals, positions(signals), strict=True):
            connector = add(connectors, "ssd:Connector", name=signal.name, kind=kind, description=signal.description)
            add(connector, f"ssc:{signal.type}", unit=signal.unit)
            for size in signal.shape:
                add(connector, "ssc:Dimension", size=size)
            add(connector, "ssd:ConnectorGeometry", x=x, y=y)
    add(
        element,
        "ssd:ElementGeometry",
        x1=x1,
        y1=y1,
        x2=x2,
        y2=y2,
        iconSource=icon_source(component),
        iconFixedAspectRatio="true",
    )
    bindings = add(element, "ssd:ParameterBindings") if description.bindings[component] else None
    for bound in description.bindings[component]:
        binding = add(bindings, "ssd:ParameterBinding", source=f"resources/{bound.file}")
        if bound.mapping:
            add(binding, "ssd:ParameterMapping", source=f"resources/{mapping_name(component, bound.file)}")


def mapping_name(component: str, file: str) -> str:
    """Return the name of the file that maps a parameter set to a component."""
    return f"{component}.{file.removesuffix('.ssv')}.ssm"


def parameter_file(parameters: ParameterSet, version: str) -> Any:
    """Return the root element of an SSV, with values in the units of their variables."""
    attributes = {"version": version, "name": parameters.name, **META}
    top = root("ssv:ParameterSet", attributes, ("ssv", "ssc"))
    listed = add(top, "ssv:Parameters")
    for signal, values in parameters.entries:
        parameter = add(listed, "ssv:Parameter", name=signal.name)
        text = " ".join(value_text(signal.type, value) for value in values)
        add(parameter, f"ssv:{signal.type}", value=text, unit=signal.unit)
        for size in signal.shape:
            add(parameter, "ssc:Dimension", size=size)
    add_units(top, "ssv:Units", {signal.unit for signal, _ in parameters.entries if signal.unit})
    return top


def mapping_file(pairs: Sequence[tuple[str, str]], version: str) -> Any:
    """Return the root element of an SSM: name in the set to name in the component."""
    top = root("ssm:ParameterMapping", {"version": version, **META}, ("ssm", "ssc"))
    for source, target in pairs:
        add(top, "ssm:MappingEntry", source=source, target=target)
    return top


def system_page(description: SystemDescription, icons: Mapping[str, bytes], fmi_versions: Sequence[str]) -> bytes:
    """Return ``documentation/index.html``, which needs no other files and no network, with icons by source."""
    scenario = description.scenario
    about = [f"Scenario {scenario.name}: {scenario.description.rstrip('.')}."]
    if scenario.robot is not None:
        about.append(f"Robot {scenario.robot.name}:\n{scenario.robot.description.rstrip('.')}.")
    body = f"""<p>{escape(" ".join(about))} SSP {description.version}, FMI {" and ".join(fmi_versions)}.</p>
<h2>Diagram</h2>
<div class="wide">
{draw_system(description, icons)}
</div>
<p>A wire is a scalar, or an array with its size. Connectors without a wire are recorded outputs, and inputs that keep
the values of the parameter sets.</p>
<h2>Components</h2>
{_components(description)}
<h2>Run</h2>
{_run(description)}
<h2>Connections</h2>
{_connections(description)}
<h2>Parameters</h2>
{_parameters(description)}
<h2>Connectors</h2>
{_connectors(description)}
<h2>Origin</h2>
<p>Made by vdfmu {__version__} from the same description as the other files of this package.</p>"""
    return page(description.full_name, description.description, body, 76)


def _components(description: SystemDescription) -> str:
    rows = [
        (
            component,
            f"resources/{description.fmu_name(component)}",
            escape(table.description),
            "<br>".join(_binding(b.file, b.mapping) for b in description.bindings[component]),
        )
        for component, table in description.tables.items()
    ]
    return table(("component", "FMU", "", "parameter sets"), rows, ("name", "name", "", ""))


def _binding(file: str, mapping: Sequence[tuple[str, str]]) -> str:
    pairs = {(a.split("[")[0], b.split("[")[0]) for a, b in mapping}
    renamed = "".join(f", {escape(a)} as {escape(b)}" for a, b in sorted(pairs))
    return f"<code>{file}</code>{renamed}"


def _run(description: SystemDescription) -> str:
    scenario = description.scenario
    step, stop = f"{scenario.step:g}", f"{scenario.stop:g}"
    text = f"""<p>From 0 to {stop} s with a communication step of {step} s. The scenario is designed for the
<code>{scenario.algorithm}</code> algorithm and a solver tolerance of {description.tolerance:g}, which the annotations
of the default experiment contain too.</p>
<p>The parameter sets of a component apply in the order of its bindings. An importer that applies only one of them
applies <code>scenario</code>; the other values are also start values of the FMUs if <code>vdfmu ssp</code> made this
package.</p>"""
    if not description.arrays:
        outputs = [f"{name}.{s.name}" for name in description.tables for s in description.signals(name, "output")]
        shown = next((name for name in ("plant.q[1]", *outputs) if name in outputs), "time")
        text += f"""
<pre>vdfmu run system.ssp</pre>
<p>or in Python</p>
<pre>import vdfmu
results = vdfmu.load("system.ssp").run()
print(results["{escape(shown)}"][-1])</pre>"""
    return text


def _connections(description: SystemDescription) -> str:
    counts: dict[tuple[str, str], list[Any]] = {}
    for link in description.links:
        key = (f"{link.start[0]}.{link.start[1].group}", f"{link.end[0]}.{link.end[1].group}")
        counts.setdefault(key, []).append(link)
    rows: list[tuple[str, ...]] = []
    for (a, b), links in counts.items():
        count = sum(1 if x.start_index or not x.start[1].shape else len(x.start[1].variables) for x in links)
        rows.append((a, b, str(count), escape(", ".join(sorted({x.start[1].unit or "" for x in links})))))
    return table(("from", "to", "signals", "unit"), rows, ("name", "name", "", ""))


def _parameters(description: SystemDescription) -> str:
    takers: dict[str, list[str]] = {}
    for component, bindings in description.bindings.items():
        for binding in bindings:
            takers.setdefault(binding.file, []).append(component)
    parts: list[str] = []
    for file, parameters in description.parameter_sets.items():
        rows = [
            (
                escape(signal.name),
                " ".join(value_text(signal.type, value) for value in values),
                escape(signal.unit or ""),
                escape(signal.description) + _choice(signal, values),
            )
            for signal, values in parameters.entries
        ]
        listed = table(("parameter", "value", "unit", ""), rows, ("name", "value", "", ""))
        head = f"{file}: set {parameters.name}, for {', '.join(takers[file])}"
        parts.append(f"<details><summary>{head}</summary>\n{listed}\n</details>")
    return "\n".join(parts)


def _choice(signal: PackageSignal, values: Sequence[Any]) -> str:
    choices = signal.variables[0].choices
    return f" ({escape(choices[int(values[0])])})" if choices else ""


def _connectors(description: SystemDescription) -> str:
    parts: list[str] = []
    for component in description.tables:
        rows = [
            (escape(s.name), kind, _type(s), escape(s.unit or ""), escape(s.description))
            for kind in ("input", "output")
            for s in description.signals(component, kind)
        ]
        listed = table(("connector", "kind", "type", "unit", ""), rows, ("name", "", "", "", ""))
        parts.append(f"<details><summary>{component}</summary>\n{listed}\n</details>")
    return "\n".join(parts)


def _type(signal: PackageSignal) -> str:
    return signal.type + (f" [{', '.join(map(str, signal.shape))}]" if signal.shape else "")
