"""modelDescription.xml of FMI 2.0, of Python and of native FMUs, and what that of FMI 3.0 shares with it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from vdfmu import __version__
from vdfmu.fmu.interface import Interface, Variable
from vdfmu.fmu.layout import Layout
from vdfmu.fmu.units import UNITS

__all__ = [
    "DEFAULT_EXPERIMENT",
    "LOG_CATEGORIES",
    "document",
    "model_description",
    "native_model_description",
]

DEFAULT_EXPERIMENT = {"startTime": "0", "stopTime": "10", "stepSize": "0.001"}
LOG_CATEGORIES = {
    "logEvents": "Start of the simulation.",
    "logStatusWarning": "Log messages with fmi2Warning status.",
    "logStatusDiscard": "Log messages with fmi2Discard status.",
    "logStatusError": "Log messages with fmi2Error status.",
    "logStatusFatal": "Log messages with fmi2Fatal status.",
    "logAll": "Log all messages.",
}
_TIME_STAMP = "2026-01-01T00:00:00Z"  # fixed, so that the same sources give the same FMU


def number(value: float) -> str:
    """Shortest decimal that reads back as the same float."""
    return repr(float(value))


def boolean(value: object) -> str:
    """Return ``true`` or ``false``."""
    return str(bool(value)).lower()


def document(root: Element) -> bytes:
    """XML document of a root element."""
    root = deepcopy(root)
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def model_description(table: Interface, guid: str, tool: str) -> Element:
    """Root element of the model description of a Python FMU.

    Parameters
    ----------
    table : Interface
    guid : str
    tool : str
        Name and version of the generation tool.
    """
    root = _root(table, guid, tool)
    SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": table.model_name,
            "needsExecutionTool": "true",
            "canHandleVariableCommunicationStepSize": "true",
            "canInterpolateInputs": "false",
            "canBeInstantiatedOnlyOncePerProcess": "false",
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
        },
    )
    _add_definitions(root, table, table)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(table):
        _add_variable(variables, variable, reference)
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, v in enumerate(table) if v.causality == "output"]
    direct = [table.direct_dependencies(table.variables[i]) for i in outputs]
    initial = [table.initial_dependencies(table.variables[i]) for i in outputs]
    _add_unknowns(structure, "Outputs", outputs, direct)
    _add_unknowns(structure, "InitialUnknowns", outputs, initial)
    return root


def native_model_description(layout: Layout, guid: str, tool: str, sources: Sequence[str]) -> Element:
    """Root element of the model description of a native FMU of FMI 2.0.

    A unit with states also has model exchange. The time is no variable; by the standard, every unknown is then
    taken to depend on it.

    Parameters
    ----------
    layout : Layout
    guid : str
    tool : str
        Name and version of the generation tool.
    sources : sequence of str
        Files of the folder ``sources`` to compile.
    """
    table = layout.table
    root = _root(table, guid, tool)
    states, derivatives = _positions(layout.states), _positions(layout.derivatives)
    common = {
        "modelIdentifier": table.model_name,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    exchange = {"completedIntegratorStepNotNeeded": "true"}
    simulation = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "true",
        "maxOutputDerivativeOrder": "0",
        "canRunAsynchronuously": "false",
    }
    if states:
        root.set("numberOfEventIndicators", "0")
        _add_sources(SubElement(root, "ModelExchange", common | exchange), sources)
    _add_sources(SubElement(root, "CoSimulation", common | simulation), sources)
    _add_definitions(root, layout.variables[: layout.time], table)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(layout.variables[: layout.time]):
        _add_variable(variables, variable, reference)
    for derivative, state in zip(derivatives, states, strict=True):
        variables[derivative][0].set("derivative", str(state + 1))

    def known(positions: Iterable[int]) -> list[int]:
        return [i for i in positions if i != layout.time]

    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, v in enumerate(layout) if v.causality == "output"]
    for tag, unknowns in (("Outputs", outputs), ("Derivatives", derivatives)):
        if unknowns:
            _add_unknowns(structure, tag, unknowns, [known(layout.step_dependencies(i)) for i in unknowns])
    unknowns = outputs + derivatives
    initial = [known(layout.start_dependencies(i)) for i in unknowns]
    _add_unknowns(structure, "InitialUnknowns", unknowns, initial)
    return root


def root_attributes(table: Interface, tool: str) -> dict[str, str]:
    """Attributes of the root that both versions of FMI name alike."""
    return {
        "modelName": table.model_name,
        "description": f"{table.description} ({table.robot.name})",
        "version": __version__,
        "author": "vdfmu contributors",
        "license": "MIT",
        "generationTool": tool,
        "generationDateAndTime": _TIME_STAMP,
        "variableNamingConvention": "structured",
    }


def add_units(root: Element, variables: Iterable[Variable]) -> None:
    """Add the definitions of the units that some variables have."""
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in variables if v.unit}):
        unit = SubElement(definitions, "Unit", {"name": name})
        exponents = {base: str(exponent) for base, exponent in UNITS[name].exponents.items()}
        SubElement(unit, "BaseUnit", exponents)
        for display, factor in UNITS[name].display.items():
            SubElement(unit, "DisplayUnit", {"name": display, "factor": number(factor)})


def add_log_and_experiment(root: Element, fmi: str, table: Interface) -> None:
    """Add the log categories and the default experiment; `fmi` is the prefix of status names.

    A unit with a solver names the tolerance of its parameter: importers take one of their own where there is none.
    """
    categories = SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        text = description.replace("fmi2", fmi)
        SubElement(categories, "Category", {"name": name, "description": text})
    experiment = SubElement(root, "DefaultExperiment", DEFAULT_EXPERIMENT)
    if "tolerance" in table.groups:
        experiment.set("tolerance", start_text(table.find("tolerance")))


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


def initial(variable: Variable) -> dict[str, str]:
    """Attribute ``initial``, which inputs and the time do not have."""
    found = {"parameter": "exact", "output": "calculated", "local": "calculated"}.get(variable.causality)
    return {"initial": found} if found else {}


def _positions(where: slice) -> list[int]:
    return list(range(where.start, where.stop))


def _root(table: Interface, guid: str, tool: str) -> Element:
    attributes = root_attributes(table, tool)
    name = attributes.pop("modelName")
    return Element("fmiModelDescription", {"fmiVersion": "2.0", "modelName": name, "guid": guid} | attributes)


def _add_definitions(root: Element, variables: Iterable[Variable], table: Interface) -> None:
    add_units(root, variables)
    add_log_and_experiment(root, "fmi2", table)


def _add_sources(parent: Element, sources: Sequence[str]) -> None:
    files = SubElement(parent, "SourceFiles")
    for name in sources:
        SubElement(files, "File", {"name": name})


def _add_unknowns(
    structure: Element, tag: str, unknowns: Sequence[int], dependencies: Sequence[Sequence[int]]
) -> None:
    """Add a list of unknowns; FMI 2.0 counts variables from 1."""
    parent = SubElement(structure, tag)
    for unknown, positions in zip(unknowns, dependencies, strict=True):
        knowns = " ".join(str(i + 1) for i in positions)
        SubElement(parent, "Unknown", {"index": str(unknown + 1), "dependencies": knowns})


def _add_variable(parent: Element, variable: Variable, reference: int) -> None:
    scalar = SubElement(
        parent,
        "ScalarVariable",
        {
            "name": variable.name,
            "valueReference": str(reference),
            "description": variable.description,
            "causality": variable.causality,
            "variability": variable.variability,
        }
        | initial(variable),
    )
    start = {} if variable.start is None else {"start": start_text(variable)}
    SubElement(scalar, variable.type, value_attributes(variable) | start)
