"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from vdfmu.base.measure import measure
from vdfmu.base.standards import FMI_2, FMI_3, FmiVersion
from vdfmu.compiler.unit.interface import Array, Interface
from vdfmu.compiler.unit.variable import Variable

DEFAULT_EXPERIMENT = {"startTime": "0", "stopTime": "10", "stepSize": "0.001"}
LOG_CATEGORIES = {
    "logEvents": "Start of the simulation, and events of co-simulation with their times.",
    **{f"logStatus{s}": f"Log messages with fmi2{s} status." for s in ("Warning", "Discard", "Error", "Fatal")},
    "logAll": "Log all messages.",
}
SAMPLED = "org.vdfmu.sampled"
"""Annotation with ``Sampled`` or ``Continuous``. ``Sampled`` names the parameter with the sample period: the discrete
outputs are states that are updated from the inputs at the start of a communication step. Their directional derivatives
refer to the next sample. Without a parameter the unit samples once per step."""
FOLDED = "org.vdfmu.folded"
"""Annotation that lists the robot's numbers that are constants in the code, as names of arrays and elements."""
CHOICES = "org.vdfmu.choices"
"""Annotation with the names of choices' values."""
TIME_STAMP = "2026-01-01T00:00:00Z"
"""Fixed, so that builds are reproducible."""
FMI_3_TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}
"""Types of FMI 2.0 to types of FMI 3.0 and SSP 2.0."""


def number(value: float) -> str:
    """Return the shortest text of a number, in XML and in C, that is read back as the same number."""
    return repr(float(value))


def boolean(value: object) -> str:
    """Return ``true`` or ``false``."""
    return str(bool(value)).lower()


def document(root: Element) -> bytes:
    """Return the XML document of a root element."""
    root = deepcopy(root)
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def model_description(
    interface: Interface,
    guid: str,
    tool: str,
    about: Mapping[str, str],
    sources: Sequence[str] | None = None,
    version: FmiVersion = FMI_2,
) -> Element:
    """Return the root element of a model description of FMI 2.0.

    Native units have model exchange if they have continuous states or `exchange`. The time is not a variable; by the
    standard, every unknown then depends on it. `tool` is the name and version of the generation tool; `about` contains
    the author, licence, copyright and version of the unit, as far as they are known. `sources` are the C files of the
    folder ``sources``, or None for a Python FMU, which exposes neither states nor derivatives.
    """
    native = sources is not None
    root = _root_element(interface, version, guid, tool, about)
    places = range(interface.size)
    states, derivatives = places[interface.states], places[interface.derivatives]
    common = {
        "modelIdentifier": interface.model_name,
        "needsExecutionTool": boolean(not native),
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        **({"providesDirectionalDerivative": "true"} if native else {}),
    }
    simulation = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": boolean(native),
        "maxOutputDerivativeOrder": "0",
        "canRunAsynchronuously": "false",
    }
    if native and interface.has_exchange:
        root.set("numberOfEventIndicators", str(interface.events.stop - interface.events.start))
        exchange = {"completedIntegratorStepNotNeeded": "true"}
        _add_sources(SubElement(root, "ModelExchange", common | exchange), sources)
    element = SubElement(root, "CoSimulation", common | simulation)
    if native:
        _add_sources(element, sources)
    shown = interface.memory[: interface.time] if native else interface.variables
    _add_units(root, shown)
    _add_log_and_experiment(root, version.prefix, interface)
    _add_annotations(root, interface, "VendorAnnotations", "Tool", "name")
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(shown):
        attributes = _variable_attributes(variable.name, reference, variable.description, variable)
        start = {} if variable.start is None else {"start": _start_text(variable)}
        scalar = SubElement(variables, "ScalarVariable", attributes)
        SubElement(scalar, variable.type, _value_attributes(variable) | start)
    for derivative, state in zip(derivatives, states, strict=True) if native else ():
        variables[derivative][0].set("derivative", str(state + 1))
    structure = SubElement(root, "ModelStructure")
    causalities = ("input", "parameter", "output", "local") if native else ("input", "parameter")

    def add(tag: str, unknowns: Sequence[int], dependencies: Callable[[int], list[int]]) -> None:
        parent = SubElement(structure, tag) if unknowns else structure  # a list must not be empty
        for unknown in unknowns:
            knowns = [i for i in dependencies(unknown) if interface.memory[i].causality in causalities]
            counted = {"index": str(unknown + 1), "dependencies": " ".join(str(i + 1) for i in knowns)}
            SubElement(parent, "Unknown", counted)

    outputs = [i for i, v in enumerate(shown) if v.causality == "output"]
    rates = list(derivatives) if native else []
    add("Outputs", outputs, interface.step_dependencies)
    add("Derivatives", rates, interface.step_dependencies)
    add("InitialUnknowns", outputs + rates, interface.start_dependencies)
    return root


def _root_element(interface: Interface, version: FmiVersion, guid: str, tool: str, about: Mapping[str, str]) -> Element:
    attributes = {
        "fmiVersion": version.name,
        "modelName": interface.model_name,
        version.token: guid,
        "description": interface.description + (f" ({interface.robot.name})" if interface.robot else ""),
        **about,
        "generationTool": tool,
        "generationDateAndTime": TIME_STAMP,
        "variableNamingConvention": "structured",
    }
    return Element("fmiModelDescription", attributes)


def _add_units(root: Element, variables: Iterable[Variable]) -> None:
    names = sorted({v.unit for v in variables if v.unit})
    definitions = SubElement(root, "UnitDefinitions") if names else root
    for name in names:
        unit = SubElement(definitions, "Unit", {"name": name})
        exponents = {base: str(exponent) for base, exponent in measure(name).exponents.items()}
        SubElement(unit, "BaseUnit", exponents)
        for display, factor in measure(name).display.items():
            SubElement(unit, "DisplayUnit", {"name": display, "factor": number(factor)})


def _add_log_and_experiment(root: Element, fmi: str, interface: Interface) -> None:
    """Add the log categories and the default experiment; `fmi` is the prefix of status names.

    The tolerance is that of the unit's solver, because importers would otherwise choose their own. The step of a unit
    with sampled states is their period.
    """
    categories = SubElement(root, "LogCategories")
    for name, text in LOG_CATEGORIES.items():
        SubElement(categories, "Category", {"name": name, "description": text.replace("fmi2", fmi)})
    experiment = SubElement(root, "DefaultExperiment", DEFAULT_EXPERIMENT)
    if interface.is_sampled:
        experiment.set("stepSize", _start_text(interface.find("period")))
    if "tolerance" in interface.groups:
        experiment.set("tolerance", _start_text(interface.find("tolerance")))


def _add_annotations(root: Element, interface: Interface, group: str, tag: str, key: str) -> None:
    """Add annotations on sampling, folded numbers and names of choices; each version of FMI has its own tags."""
    folded = interface.robot.constants() if interface.robot is not None and interface.has_robot else []
    named = [variable for variable in interface if variable.choices]
    sampled = interface.unit.sampled or interface.is_sampled
    declared = interface.unit.sampled is not None or interface.is_sampled or interface.events.stop > 0
    parent = SubElement(root, group) if declared or folded or named else root
    if declared:
        annotation = SubElement(parent, tag, {key: SAMPLED})
        period = {"period": "period"} if interface.is_sampled else {}
        SubElement(annotation, "Sampled" if sampled else "Continuous", {"xmlns": f"urn:{SAMPLED}", **period})
    if folded:
        annotation = SubElement(parent, tag, {key: FOLDED})
        SubElement(annotation, "Folded", {"xmlns": f"urn:{FOLDED}"}).text = " ".join(folded)
    if named:  # in one element, because FMI 2.0 allows only one per tool
        choices = SubElement(SubElement(parent, tag, {key: CHOICES}), "Choices", {"xmlns": f"urn:{CHOICES}"})
        for variable in named:
            listed = SubElement(choices, "Variable", {"name": variable.name})
            for name in variable.choices:  # of the values 0, 1, ..
                SubElement(listed, "Choice", {"name": name})


def _value_attributes(variable: Variable) -> dict[str, str]:
    """Return unit and limits of a variable, which have the same names in both versions of FMI."""
    text = number if variable.type == "Real" else str
    attributes = {
        "unit": variable.unit,
        "displayUnit": variable.display_unit,
        "min": None if variable.minimum is None else text(variable.minimum),
        "max": None if variable.maximum is None else text(variable.maximum),
    }
    return {name: value for name, value in attributes.items() if value}


def _start_text(variable: Variable) -> str:
    return {"Real": number, "Integer": str, "Boolean": boolean}[variable.type](variable.start)


def _variable_attributes(name: str, reference: int, description: str, variable: Variable) -> dict[str, str]:
    """Return attributes of a variable in both versions of FMI; inputs and the time have no ``initial``."""
    initial = {"parameter": "exact", "output": "calculated", "local": "calculated"}.get(variable.causality)
    return {
        "name": name,
        "valueReference": str(reference),
        "description": description,
        "causality": variable.causality,
        "variability": variable.variability,
        **({"initial": initial} if initial else {}),
    }


def _add_sources(parent: Element, sources: Sequence[str]) -> None:
    files = SubElement(parent, "SourceFiles") if sources else parent
    for name in sources:
        SubElement(files, "File", {"name": name})


# ------------------------------------------------------------------ FMI 3.0


def model_description_3(
    interface: Interface, guid: str, tool: str, about: Mapping[str, str], version: FmiVersion = FMI_3
) -> Element:
    """Return the root element of the model description of a native FMI 3.0 FMU; see :func:`model_description`.

    `guid` is the instantiation token. Dependencies are between whole variables; functions of the FMU return those of
    elements.
    """
    root = _root_element(interface, version, guid, tool, about)
    _add_interfaces(root, interface)
    _add_units(root, interface.memory)
    _add_log_and_experiment(root, version.prefix, interface)
    variables = SubElement(root, "ModelVariables")
    for array in interface.arrays:
        _add_array(variables, interface, array)
    _add_structure(root, interface)
    _add_annotations(root, interface, "Annotations", "Annotation", "type")
    return root


def build_description(files: Sequence[str], definitions: Mapping[str, str], model_identifier: str) -> Element:
    """Return the root element of ``sources/buildDescription.xml``, with the files in ``sources`` to compile.

    `definitions` of the preprocessor are name to value. Each needs a value, because fmpy writes an absent one as
    ``None``.
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
        # early return only if the importer requests it, between steps of the solver
        "mightReturnEarlyFromDoStep": "false",
        "canReturnEarlyAfterIntermediateUpdate": boolean(interface.has_states),
        "hasEventMode": "false",
        "providesEvaluateDiscreteStates": "false",
    }
    SubElement(root, "CoSimulation", common | simulation)


def _add_array(parent: Element, interface: Interface, array: Array) -> None:
    members = interface.memory[array.positions]
    variable = members[0]
    attributes = _variable_attributes(array.name, array.first, interface.array_description(array), variable)
    if variable.variability == "continuous":
        attributes["intermediateUpdate"] = "true"
    attributes |= _value_attributes(variable)
    if variable.start is not None:
        attributes["start"] = " ".join(_start_text(v) for v in members)
    if variable.causality == "local":
        offset = array.first - interface.derivatives.start
        attributes["derivative"] = str(interface.states.start + offset)
    element = SubElement(parent, FMI_3_TYPES[variable.type], attributes)
    for length in array.shape:
        SubElement(element, "Dimension", {"start": str(length)})


def _add_structure(root: Element, interface: Interface) -> None:
    structure = SubElement(root, "ModelStructure")
    outputs, rates = (
        [array for array in interface.arrays if interface.memory[array.first].causality == kind]
        for kind in ("output", "local")
    )

    def add(tag: str, unknowns: Sequence[Array], dependencies: Callable[[int], list[int]]) -> None:
        for array in unknowns:
            elements = range(array.first, array.first + array.size)
            owners = {interface.owners[dependency] for element in elements for dependency in dependencies(element)}
            knowns = " ".join(str(interface.arrays[owner].first) for owner in sorted(owners))
            SubElement(structure, tag, {"valueReference": str(array.first), "dependencies": knowns})

    add("Output", outputs, interface.step_dependencies)
    add("ContinuousStateDerivative", rates, interface.step_dependencies)
    add("InitialUnknown", outputs + rates, interface.start_dependencies)
    events = [a for a in outputs if interface.events.start <= a.first < interface.events.stop]
    add("EventIndicator", events if interface.has_exchange else (), interface.step_dependencies)
