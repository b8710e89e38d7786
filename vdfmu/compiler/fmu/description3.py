"""modelDescription.xml and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement

from vdfmu.base.standards import FMI_3, FmiVersion
from vdfmu.compiler.fmu.description import (
    SAMPLED,
    add_log_and_experiment,
    add_sampled,
    add_units,
    boolean,
    root_element,
    start_text,
    value_attributes,
    variable_attributes,
)
from vdfmu.compiler.unit.interface import Array, Interface

FMI_3_TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}
"""Type of FMI 2.0 to the type of FMI 3.0 and SSP 2.0."""


def model_description_3(
    interface: Interface, guid: str, tool: str, about: Mapping[str, str], version: FmiVersion = FMI_3
) -> Element:
    """Root element of the model description of a native FMU, with the instantiation token `guid`.

    `tool` is name and version of the generation tool; `about` has author, licence, copyright and version of the unit.

    A unit with states also has model exchange, and one that says so. Dependencies are those between whole variables;
    functions of the FMU give those between elements.
    """
    root = root_element(interface, version, guid, tool, about)
    _add_interfaces(root, interface)
    add_units(root, interface.memory)
    add_log_and_experiment(root, version.prefix, interface)
    variables = SubElement(root, "ModelVariables")
    for array in interface.arrays:
        _add_variable(variables, interface, array)
    _add_structure(root, interface)
    if interface.is_sampled:
        add_sampled(SubElement(SubElement(root, "Annotations"), "Annotation", {"type": SAMPLED}))
    return root


def build_description(files: Sequence[str], definitions: Mapping[str, str], model_identifier: str) -> Element:
    """Root element of ``sources/buildDescription.xml``: the files of the folder ``sources`` to compile.

    `definitions` are those of the preprocessor, name to value. fmpy writes an absent value as ``None``: give one.
    """
    root = Element("fmiBuildDescription", {"fmiVersion": FMI_3.name})
    configuration = SubElement(root, "BuildConfiguration", {"modelIdentifier": model_identifier})
    sources = SubElement(configuration, "SourceFileSet", {"language": "C11"})
    for file in files:
        SubElement(sources, "SourceFile", {"name": file})
    for name, value in definitions.items():
        SubElement(sources, "PreprocessorDefinition", {"name": name, "value": value})
    return root


def _add_interfaces(root: Element, interface: Interface) -> None:
    has_states = interface.has_states
    common = {
        "modelIdentifier": interface.model_name,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
        "providesAdjointDerivatives": "true",
        "providesPerElementDependencies": "true",
    }
    if interface.has_exchange:
        exchange = {"needsCompletedIntegratorStep": "false", "providesEvaluateDiscreteStates": "false"}
        SubElement(root, "ModelExchange", common | exchange)
    simulation = {
        "canHandleVariableCommunicationStepSize": "true",
        "maxOutputDerivativeOrder": "0",
        "recommendedIntermediateInputSmoothness": "0",
        "providesIntermediateUpdate": "true",
        # It returns early only if the importer asks for it, between the steps of the solver.
        "mightReturnEarlyFromDoStep": "false",
        "canReturnEarlyAfterIntermediateUpdate": boolean(has_states),
        "hasEventMode": "false",
        "providesEvaluateDiscreteStates": "false",
    }
    SubElement(root, "CoSimulation", common | simulation)


def _add_variable(parent: Element, interface: Interface, array: Array) -> None:
    members = interface.memory[array.positions]
    variable = members[0]
    attributes = variable_attributes(array.name, array.first, interface.array_description(array), variable)
    if variable.variability == "continuous":
        attributes["intermediateUpdate"] = "true"
    attributes |= value_attributes(variable)
    if variable.start is not None:
        attributes["start"] = " ".join(start_text(v) for v in members)
    if variable.causality == "local":
        offset = array.first - interface.derivatives.start
        attributes["derivative"] = str(interface.states.start + offset)
    element = SubElement(parent, FMI_3_TYPES[variable.type], attributes)
    for length in array.shape:
        SubElement(element, "Dimension", {"start": str(length)})


def _add_structure(root: Element, interface: Interface) -> None:
    structure = SubElement(root, "ModelStructure")
    kinds = [interface.memory[array.first].causality for array in interface.arrays]
    outputs = [array for array, kind in zip(interface.arrays, kinds, strict=True) if kind == "output"]
    derivatives = [array for array, kind in zip(interface.arrays, kinds, strict=True) if kind == "local"]

    def add(tag: str, unknowns: Sequence[Array], dependencies: Callable[[int], list[int]]) -> None:
        for array in unknowns:
            elements = range(array.first, array.first + array.size)
            owners = {interface.owners[known] for element in elements for known in dependencies(element)}
            knowns = " ".join(str(interface.arrays[owner].first) for owner in sorted(owners))
            SubElement(structure, tag, {"valueReference": str(array.first), "dependencies": knowns})

    add("Output", outputs, interface.step_dependencies)
    add("ContinuousStateDerivative", derivatives, interface.step_dependencies)
    add("InitialUnknown", outputs + derivatives, interface.start_dependencies)
