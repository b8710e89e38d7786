"""The files of a system package: its structure (SSD) with a diagram, parameter sets (SSV) and mappings (SSM)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.measure import measure
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.description import number
from vdfmu.engine.package.experiment import EXPERIMENT_TYPE, FOREIGN, OSP_TYPE
from vdfmu.engine.package.parse import NAMESPACES
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
    heights: dict[tuple[str, str], float] = {}
    for component in description.corners:
        _add_component(elements, description, component, heights)
    paths, (x1, y1, x2, y2) = route(description, heights)
    connections = add(system, "ssd:Connections") if description.links else None
    for link, path in zip(description.links, paths, strict=True):
        (start_unit, start), (end_unit, end) = link.start, link.end
        connection = add(
            connections,
            "ssd:Connection",
            startElement=start_unit,
            startConnector=start.name,
            startIndices=" ".join(map(str, link.start_index)) or None,
            endElement=end_unit,
            endConnector=end.name,
            endIndices=" ".join(map(str, link.end_index)) or None,
        )
        add(
            connection,
            "ssd:ConnectionGeometry",
            pointsX=" ".join(f"{x:g}" for x, _ in path),
            pointsY=" ".join(f"{y:g}" for _, y in path),
        )
    add(system, "ssd:SystemGeometry", x1=x1, y1=y1, x2=x2, y2=y2)
    note = f"{description.description}.\n{scenario.description}."
    add(
        add(system, "ssd:GraphicalElements"),
        "ssd:Note", x1=x1 + 4.0, y1=y2 - 20.0, x2=x2 - 4.0, y2=y2 - 2.0, text=note,
    )  # fmt: skip
    add_units(top, "ssd:Units", description.measures)
    _add_experiment(top, description)
    return top


def _add_component(
    elements: Any, description: SystemDescription, component: str, heights: dict[tuple[str, str], float]
) -> None:
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
            heights[component, signal.name] = y1 + y * (y2 - y1)
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


_LANE = 5.0
"""Distance of two lanes [mm]."""
_MARGIN = 12.0
"""Distance of the outermost lane from a box, and of the canvas from what is on it [mm]."""

Bends = list[tuple[float, float]]


def route(
    description: SystemDescription, heights: Mapping[tuple[str, str], float]
) -> tuple[list[Bends], tuple[float, float, float, float]]:
    """Return the bends of every connection [mm], without its ends, and the corners of the canvas.

    The boxes stand in columns. All signals of a group leave their box to the right into one lane. To the next column it
    leads to the connectors, at `heights` [mm] by component and connector; to others by a lane below all boxes and one
    in front of the target.
    """
    corners, columns = description.corners, list(description.corners)
    bottom = min(corner[1] for corner in corners.values())
    behind: dict[tuple[str, str], float] = {}  # component and group to the lane
    below: dict[tuple[str, str], float] = {}
    before: dict[tuple[str, str, str], float] = {}
    for (source, start), (target, _) in reversed([(link.start, link.end) for link in description.links]):
        if columns.index(target) != columns.index(source) + 1:
            taken = sum(component == target for component, *_ in before)
            x_end = corners[target][0] - _MARGIN - taken * _LANE
            before.setdefault((target, source, start.group), x_end)
    paths: list[Bends] = []
    for link in description.links:
        (source, start), (target, end) = link.start, link.end
        taken = sum(component == source for component, _ in behind)
        x = behind.setdefault((source, start.group), corners[source][2] + _MARGIN + taken * _LANE)
        y, y_end = heights[source, start.name], heights[target, end.name]
        x_end = before.get((target, source, start.group))
        if x_end is None:
            paths.append([(x, y), (x, y_end)])
        else:
            low = below.setdefault((source, start.group), bottom - _MARGIN - len(below) * _LANE)
            paths.append([(x, y), (x, low), (x_end, low), (x_end, y_end)])
    points = [(c[k], c[k + 1]) for c in corners.values() for k in (0, 2)] + [p for path in paths for p in path]
    xs, ys = zip(*points, strict=True)
    return paths, (min(xs) - _MARGIN, min(ys) - _MARGIN, max(xs) + _MARGIN, max(ys) + 2 * _MARGIN)


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
