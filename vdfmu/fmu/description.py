"""modelDescription.xml of FMI 2.0 from the variable table."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from vdfmu import __version__
from vdfmu.fmu.interface import Interface, Variable
from vdfmu.fmu.units import UNITS

__all__ = ["DEFAULT_EXPERIMENT", "LOG_CATEGORIES", "model_description"]

# No tolerance: importers such as fmpy would hand it to every run, and it goes before the plant's parameter.
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


def model_description(table: Interface, guid: str, tool: str) -> Element:
    """Root element of the model description.

    Parameters
    ----------
    table : Interface
    guid : str
    tool : str
        Name and version of the generation tool.
    """
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "modelName": table.model_name,
            "guid": guid,
            "description": f"{table.description} ({table.robot.name})",
            "version": __version__,
            "author": "vdfmu contributors",
            "license": "MIT",
            "generationTool": tool,
            "generationDateAndTime": _TIME_STAMP,
            "variableNamingConvention": "structured",
        },
    )
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
    _add_units(root, table)
    categories = SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        SubElement(categories, "Category", {"name": name, "description": description})
    SubElement(root, "DefaultExperiment", DEFAULT_EXPERIMENT)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(table):
        _add_variable(variables, variable, reference)
    structure = SubElement(root, "ModelStructure")
    for tag, dependencies in (
        ("Outputs", table.direct_dependencies),
        ("InitialUnknowns", table.initial_dependencies),
    ):
        unknowns = SubElement(structure, tag)
        for reference, variable in enumerate(table):
            if variable.causality == "output":
                knowns = " ".join(str(i + 1) for i in dependencies(variable))
                SubElement(unknowns, "Unknown", {"index": str(reference + 1), "dependencies": knowns})
    return root


def _add_units(root: Element, table: Interface) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in table if v.unit}):
        unit = SubElement(definitions, "Unit", {"name": name})
        exponents = {base: str(exponent) for base, exponent in UNITS[name].exponents.items()}
        SubElement(unit, "BaseUnit", exponents)
        for display, factor in UNITS[name].display.items():
            SubElement(unit, "DisplayUnit", {"name": display, "factor": number(factor)})


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
        },
    )
    attributes: dict[str, str] = {}
    if variable.causality == "parameter":
        scalar.set("initial", "exact")
    elif variable.causality == "output":
        scalar.set("initial", "calculated")
    if variable.type == "Real":
        text = number
        if variable.unit:
            attributes["unit"] = variable.unit
        if variable.display_unit:
            attributes["displayUnit"] = variable.display_unit
    else:
        text = str
    if variable.minimum is not None:
        attributes["min"] = text(variable.minimum)
    if variable.maximum is not None:
        attributes["max"] = text(variable.maximum)
    if variable.start is not None:
        start = variable.start
        attributes["start"] = str(start).lower() if variable.type == "Boolean" else text(start)
    SubElement(scalar, variable.type, attributes)
