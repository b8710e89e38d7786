"""modelDescription.xml of FMI 2.0, of Python and native FMUs, and the parts that FMI 3.0 has too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from vdfmu.base.measure import measure
from vdfmu.base.standards import FMI_2, FmiVersion
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.variable import Variable

DEFAULT_EXPERIMENT = {"startTime": "0", "stopTime": "10", "stepSize": "0.001"}
LOG_CATEGORIES = {
    "logEvents": "Start of the simulation.",
    "logStatusWarning": "Log messages with fmi2Warning status.",
    "logStatusDiscard": "Log messages with fmi2Discard status.",
    "logStatusError": "Log messages with fmi2Error status.",
    "logStatusFatal": "Log messages with fmi2Fatal status.",
    "logAll": "Log all messages.",
}
SAMPLED = "org.vdfmu.sampled"
"""Annotation that names the parameter with the time between samples: the discrete outputs are states that are sampled
by the inputs at the begin of a communication step, and a directional derivative of them is that of the next sample."""
TIME_STAMP = "2026-01-01T00:00:00Z"
"""Fixed, so that the same sources give the same FMU."""


def number(value: float) -> str:
    """Shortest text of a number, in XML and in C, that reads back as the same number."""
    return repr(float(value))


def boolean(value: object) -> str:
    """Return ``true`` or ``false``."""
    return str(bool(value)).lower()


def document(root: Element) -> bytes:
    """XML document of a root element."""
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
    """Root element of the model description of FMI 2.0.

    A native unit with continuous states also has model exchange, and one that says so. The time is not a variable; by
    the standard, every unknown is then taken to depend on it. `tool` is name and version of the generation tool;
    `about` has author, licence, copyright and version of the unit, as far as they are known. `sources` are the files of
    the folder ``sources`` to compile, if it has one; None for a Python FMU, which has neither states nor derivatives
    for the importer.
    """
    native = sources is not None
    root = root_element(interface, version, guid, tool, about)
    places = range(interface.size)
    states, derivatives = places[interface.states], places[interface.derivatives]
    common = {
        "modelIdentifier": interface.model_name,
        "needsExecutionTool": boolean(not native),
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
    }
    if native:
        common["providesDirectionalDerivative"] = "true"
    simulation = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": boolean(native),
        "maxOutputDerivativeOrder": "0",
        "canRunAsynchronuously": "false",
    }
    if native and interface.has_exchange:
        root.set("numberOfEventIndicators", "0")
        exchange = {"completedIntegratorStepNotNeeded": "true"}
        _add_sources(SubElement(root, "ModelExchange", common | exchange), sources)
    element = SubElement(root, "CoSimulation", common | simulation)
    if native:
        _add_sources(element, sources)
    shown = interface.memory[: interface.time] if native else interface.variables
    add_units(root, shown)
    add_log_and_experiment(root, version.prefix, interface)
    if interface.is_sampled:
        add_sampled(SubElement(SubElement(root, "VendorAnnotations"), "Tool", {"name": SAMPLED}))
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(shown):
        _add_variable(variables, variable, reference)
    for derivative, state in zip(derivatives, states, strict=True) if native else ():
        variables[derivative][0].set("derivative", str(state + 1))

    def known(positions: Iterable[int]) -> list[int]:
        kinds = ("input", "parameter") if not native else ("input", "parameter", "output", "local")
        return [i for i in positions if interface.memory[i].causality in kinds]

    structure = SubElement(root, "ModelStructure")
    unknowns = [i for i, v in enumerate(shown) if v.causality == "output"]
    _add_unknowns(structure, "Outputs", unknowns, [known(interface.step_dependencies(i)) for i in unknowns])
    if native and derivatives:
        steps = [known(interface.step_dependencies(i)) for i in derivatives]
        _add_unknowns(structure, "Derivatives", derivatives, steps)
        unknowns += derivatives
    initial = [known(interface.start_dependencies(i)) for i in unknowns]
    _add_unknowns(structure, "InitialUnknowns", unknowns, initial)
    return root


def root_element(interface: Interface, version: FmiVersion, guid: str, tool: str, about: Mapping[str, str]) -> Element:
    """Root element."""
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


def add_units(root: Element, variables: Iterable[Variable]) -> None:
    """Add the definitions of the units that some variables have."""
    names = sorted({v.unit for v in variables if v.unit})
    definitions = SubElement(root, "UnitDefinitions") if names else root
    for name in names:
        unit = SubElement(definitions, "Unit", {"name": name})
        exponents = {base: str(exponent) for base, exponent in measure(name).exponents.items()}
        SubElement(unit, "BaseUnit", exponents)
        for display, factor in measure(name).display.items():
            SubElement(unit, "DisplayUnit", {"name": display, "factor": number(factor)})


def add_log_and_experiment(root: Element, fmi: str, interface: Interface) -> None:
    """Add the log categories and the default experiment; `fmi` is the prefix of status names.

    The tolerance is that of the unit's solver: importers choose one of their own where none is named. The
    step of one with sampled states is their period.
    """
    categories = SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        text = description.replace("fmi2", fmi)
        SubElement(categories, "Category", {"name": name, "description": text})
    experiment = SubElement(root, "DefaultExperiment", DEFAULT_EXPERIMENT)
    if interface.is_sampled:
        experiment.set("stepSize", start_text(interface.find("period")))
    if "tolerance" in interface.groups:
        experiment.set("tolerance", start_text(interface.find("tolerance")))


def add_sampled(annotation: Element) -> None:
    """Say of a unit with sampled states what `SAMPLED` means."""
    SubElement(annotation, "Sampled", {"xmlns": f"urn:{SAMPLED}", "period": "period"})


def value_attributes(variable: Variable) -> dict[str, str]:
    """Return unit and limits of a variable, which both versions of FMI name alike."""
    text = number if variable.type == "Real" else str
    found = {
        "unit": variable.unit,
        "displayUnit": variable.display_unit,
        "min": None if variable.minimum is None else text(variable.minimum),
        "max": None if variable.maximum is None else text(variable.maximum),
    }
    return {name: value for name, value in found.items() if value}


def start_text(variable: Variable) -> str:
    """Start value of a variable that has one."""
    write = {"Real": number, "Integer": str, "Boolean": boolean}[variable.type]
    return write(variable.start)


def variable_attributes(name: str, reference: int, description: str, variable: Variable) -> dict[str, str]:
    """Return what both versions of FMI say of a variable; inputs and the time have no ``initial``."""
    found = {"parameter": "exact", "output": "calculated", "local": "calculated"}.get(variable.causality)
    return {
        "name": name,
        "valueReference": str(reference),
        "description": description,
        "causality": variable.causality,
        "variability": variable.variability,
        **({"initial": found} if found else {}),
    }


def _add_sources(parent: Element, sources: Sequence[str]) -> None:
    if sources:
        files = SubElement(parent, "SourceFiles")
        for name in sources:
            SubElement(files, "File", {"name": name})


def _add_unknowns(structure: Element, tag: str, unknowns: Sequence[int], dependencies: Sequence[Sequence[int]]) -> None:
    """Add a list of unknowns, which may not be empty; FMI 2.0 counts variables from 1."""
    parent = SubElement(structure, tag) if unknowns else structure
    for unknown, positions in zip(unknowns, dependencies, strict=True):
        knowns = " ".join(str(i + 1) for i in positions)
        SubElement(parent, "Unknown", {"index": str(unknown + 1), "dependencies": knowns})


def _add_variable(parent: Element, variable: Variable, reference: int) -> None:
    attributes = variable_attributes(variable.name, reference, variable.description, variable)
    scalar = SubElement(parent, "ScalarVariable", attributes)
    start = {} if variable.start is None else {"start": start_text(variable)}
    SubElement(scalar, variable.type, value_attributes(variable) | start)
