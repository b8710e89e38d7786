"""SystemStructure.ssd: components with connectors and parameter bindings, connections, diagram, experiment."""

from __future__ import annotations

from typing import Any

from vdfmu.engine.package.experiment import EXPERIMENT_TYPE, FOREIGN, OSP_TYPE
from vdfmu.system.package.description import PackageSignal, SystemDescription, icon_source, positions
from vdfmu.system.package.geometry import route
from vdfmu.system.package.xml import META, add, add_units, root

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
