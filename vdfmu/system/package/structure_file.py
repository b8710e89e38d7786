"""The files of a system package: its structure (SSD) with a diagram, parameter sets (SSV) and mappings (SSM)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.measure import measure
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.description import number
from vdfmu.engine.package.parse import EXPERIMENT_TYPE, FOREIGN, NAMESPACES, OSP_TYPE
from vdfmu.system.package.description import PackageSignal, ParameterSet, SystemDescription, icon_source, positions

META = {
    "generationTool": f"vdfmu {__version__}",
    "generationDateAndTime": "2026-01-01T00:00:00Z",  # a constant: the same system gives the same bytes
}


_SPACES = NAMESPACES | FOREIGN


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_SPACES[prefix]}}}{local}"


def root(name: str, attributes: Mapping[str, str], prefixes: Iterable[str]) -> Any:
    """Root element ``prefix:name`` that declares the namespaces of the prefixes."""
    return etree.Element(_tag(name), dict(attributes), nsmap={p: _SPACES[p] for p in prefixes})


def add(parent: Any, name: str, /, **attributes: Any) -> Any:
    """Append an element ``prefix:name``; attributes that are None are left out."""
    return etree.SubElement(
        parent, _tag(name), {key: _text(value) for key, value in attributes.items() if value is not None}
    )


def add_units(parent: Any, name: str, units: Iterable[str]) -> None:
    """Append ``prefix:Units`` with the definitions, unless there are none."""
    wanted = sorted(units)
    if wanted:
        element = add(parent, name)
        for unit in wanted:
            add(add(element, "ssc:Unit", name=unit), "ssc:BaseUnit", **measure(unit).exponents)


def value_text(kind: str, value: Any) -> str:
    """Text of a parameter's value, of a type of SSP."""
    if kind == "Boolean":
        return str(bool(value)).lower()
    return str(int(value)) if kind in ("Integer", "Int32") else number(value)


def to_bytes(element: Any) -> bytes:
    """Whole file."""
    return etree.tostring(element, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def _text(value: Any) -> str:
    return number(value) if isinstance(value, float) else str(value)


_SIDES = {"input": 0.0, "output": 1.0}
_MARGIN = 12.0
"""Distance of the edge of the canvas from the boxes [mm]; twice of it above, for the note."""


def structure_file(description: SystemDescription) -> Any:
    """Root element of the SSD."""
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
        add(system, "ssd:GraphicalElements"),
        "ssd:Note", x1=x1 + 4.0, y1=y2 - 20.0, x2=x2 - 4.0, y2=y2 - 2.0, text=note,
    )  # fmt: skip
    add_units(top, "ssd:Units", description.measures)
    _add_experiment(top, description)
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
            _add_connector(connectors, signal, x, y)
    add(
        element,
        "ssd:ElementGeometry",
        x1=x1, y1=y1, x2=x2, y2=y2,
        iconSource=icon_source(component),
        iconFixedAspectRatio="true",
    )  # fmt: skip
    bound_sets = description.bindings[component]
    if not bound_sets:
        return
    bindings = add(element, "ssd:ParameterBindings")
    for bound in bound_sets:
        binding = add(bindings, "ssd:ParameterBinding", source=f"resources/{bound.file}")
        if bound.mapping:
            add(binding, "ssd:ParameterMapping", source=f"resources/{mapping_name(component, bound.file)}")


def mapping_name(component: str, file: str) -> str:
    """Name of the file that maps a parameter set to a component."""
    return f"{component}.{file.removesuffix('.ssv')}.ssm"


def _add_connector(connectors: Any, signal: PackageSignal, x: float, y: float) -> None:
    connector = add(connectors, "ssd:Connector", name=signal.name, kind=signal.kind, description=signal.description)
    add(connector, f"ssc:{signal.type}", unit=signal.unit)
    for size in signal.shape:
        add(connector, "ssc:Dimension", size=size)
    add(connector, "ssd:ConnectorGeometry", x=x, y=y)


def _add_experiment(top: Any, description: SystemDescription) -> None:
    """Append the default experiment; how it is run is ours to say, and in the words of libcosim."""
    scenario = description.scenario
    experiment = add(top, "ssd:DefaultExperiment", startTime=0.0, stopTime=float(scenario.stop))
    annotations = add(experiment, "ssd:Annotations")
    ours = add(annotations, "ssc:Annotation", type=EXPERIMENT_TYPE)
    add(
        ours,
        "vdfmu:Experiment",
        communicationStepSize=float(scenario.step),
        algorithm=scenario.master,
        solverTolerance=description.tolerance,
        adaptive=scenario.adaptive,
    )
    osp = add(annotations, "ssc:Annotation", type=OSP_TYPE)
    algorithm = add(osp, "osp:Algorithm")
    add(algorithm, "osp:FixedStepAlgorithm", baseStepSize=float(scenario.step))


def parameter_file(parameters: ParameterSet, version: str) -> Any:
    """Root element of an SSV: values in the units of their variables."""
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
    """Root element of an SSM: name in the set to name in the component."""
    top = root("ssm:ParameterMapping", {"version": version, **META}, ("ssm", "ssc"))
    for source, target in pairs:
        add(top, "ssm:MappingEntry", source=source, target=target)
    return top
