"""The XML of native FMUs, FMI 2.0 and 3.0: valid, and the same as the layout and the variable table."""

import io
import zipfile
from functools import cache
from xml.etree.ElementTree import Element, tostring

import fmpy
import numpy as np
import pytest
from fmpy.model_description import ModelDescription, ModelVariable

from vdfmu.arm.units import shipped_units
from vdfmu.compiler.fmu.description import build_description, document, model_description, model_description_3
from vdfmu.compiler.unit.interface import Interface

ABOUT = {"author": "Ada", "license": "MIT"}
GUID, TOOL = "{01234567-89ab-cdef-0123-456789abcdef}", "vdfmu 0"
SOURCES = ("unit.c", "solver.c")
VERSIONS = (2, 3)


@cache
def root_of(interface: Interface, version: int) -> Element:
    if version == 2:
        return model_description(interface, GUID, TOOL, ABOUT, SOURCES)
    return model_description_3(interface, GUID, TOOL, ABOUT)


def read(root: Element) -> ModelDescription:
    build = build_description(SOURCES, {"DISABLE_PREFIX": "1"}, root.get("modelName", ""))
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("modelDescription.xml", document(root))
        if root.get("fmiVersion") == "3.0":
            archive.writestr("sources/buildDescription.xml", document(build))
    return fmpy.read_model_description(data, validate_variable_names=True, validate_model_structure=True)


@pytest.fixture(scope="module")
def interfaces(robots):
    return {(name, unit): Interface(shipped_units()[unit], robots[name]) for name in robots for unit in shipped_units()}


@pytest.fixture
def interface(interfaces, robot_name, unit_name):
    return interfaces[robot_name, unit_name]


@pytest.fixture
def root2(interface):
    return root_of(interface, 2)


@pytest.fixture
def root3(interface):
    return root_of(interface, 3)


def structure(root: Element, tag: str) -> list[Element]:
    element = root.find("ModelStructure")
    assert element is not None
    return element.findall(tag)


def numbers(text: str | None) -> list[int]:
    assert text is not None
    return [int(word) for word in text.split()]


@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_finds_no_problem_and_the_plant_has_model_exchange(interface, version, unit_name):
    """Schema, names, units, start values, structure."""
    description = read(root_of(interface, version))
    assert description.fmiVersion == f"{version}.0"
    assert description.guid == GUID
    assert description.modelName == interface.model_name
    assert description.coSimulation.modelIdentifier == interface.model_name
    assert (description.modelExchange is not None) == (unit_name == "plant")
    n_x = interface.states.stop - interface.states.start
    assert description.numberOfContinuousStates == n_x
    assert description.numberOfEventIndicators == 0


def test_capabilities_of_fmi_2(root2, unit_name):
    flags = {"canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"}
    flags |= {"canNotUseMemoryManagementFunctions"}
    kind_flags = {
        "ModelExchange": {"completedIntegratorStepNotNeeded"},
        "CoSimulation": {"canHandleVariableCommunicationStepSize", "canInterpolateInputs"},
    }
    for tag in ("ModelExchange", "CoSimulation") if unit_name == "plant" else ("CoSimulation",):
        element = root2.find(tag)
        assert element is not None
        assert {k for k, v in element.attrib.items() if v == "true"} == flags | kind_flags[tag]
        assert [file.get("name") for file in element.iterfind("SourceFiles/File")] == list(SOURCES)


def test_capabilities_of_fmi_3(root3, unit_name):
    flags = {"canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives"}
    flags |= {"providesAdjointDerivatives", "providesPerElementDependencies"}
    simulation = {"canHandleVariableCommunicationStepSize", "providesIntermediateUpdate"}
    if unit_name == "plant":
        simulation |= {"canReturnEarlyAfterIntermediateUpdate"}
        assert {k for k, v in root3.find("ModelExchange").attrib.items() if v == "true"} == flags
    assert {k for k, v in root3.find("CoSimulation").attrib.items() if v == "true"} == flags | simulation


def test_variables_of_fmi_2_are_those_of_the_python_fmu_and_structure_that_of_the_layout(interface, root2):
    python = model_description(interface, GUID, TOOL, ABOUT)
    ours = [tostring(v) for v in root2.iterfind("ModelVariables/ScalarVariable")]
    theirs = [tostring(v) for v in python.iterfind("ModelVariables/ScalarVariable")]
    assert ours[: len(theirs)] == theirs
    assert len(ours) == interface.time
    description = read(root2)
    assert [u.variable.name for u in description.derivatives] == [
        v.name for v in interface.memory[interface.derivatives]
    ]
    assert [u.variable.derivative.name for u in description.derivatives] == [
        v.name for v in interface.memory[interface.states]
    ]
    outputs = [i for i, v in enumerate(interface.memory) if v.causality == "output"]
    derivatives = [i for i, v in enumerate(interface.memory) if v.causality == "local"]
    for tag, unknowns, dependencies in (
        ("Outputs", outputs, interface.step_dependencies),
        ("Derivatives", derivatives, interface.step_dependencies),
        ("InitialUnknowns", outputs + derivatives, interface.start_dependencies),
    ):
        elements = structure(root2, f"{tag}/Unknown")
        assert [int(u.get("index", "")) - 1 for u in elements] == unknowns
        for element, unknown in zip(elements, unknowns, strict=True):
            sources = [i for i in dependencies(unknown) if i != interface.time]
            assert [i - 1 for i in numbers(element.get("dependencies"))] == sources


def test_arrays_of_fmi_3_are_those_of_the_layout(interface, root3):
    elements = list(root3.find("ModelVariables"))
    for array, element in zip(interface.arrays, elements, strict=True):
        members = interface.memory[array.positions]
        first = members[0]
        assert element.tag == {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}[first.type]
        assert element.get("name") == array.name
        assert element.get("valueReference") == str(array.first)
        assert (element.get("causality"), element.get("variability")) == (first.causality, first.variability)
        assert (element.get("unit"), element.get("displayUnit")) == (first.unit, first.display_unit)
        assert tuple(int(d.get("start", "")) for d in element.iterfind("Dimension")) == array.shape
        for attribute, limit in (("min", first.minimum), ("max", first.maximum)):
            text = element.get(attribute)
            assert (text is None) == (limit is None)
            assert text is None or float(text) == limit
        starts = element.get("start")
        if first.start is None:
            assert starts is None
        else:
            values = {"true": 1.0, "false": 0.0}
            assert starts is not None
            assert [values[s] if s in values else float(s) for s in starts.split()] == [float(v.start) for v in members]
        continuous = first.variability == "continuous"
        assert element.get("intermediateUpdate") == ("true" if continuous else None)


def test_structure_of_fmi_3_joins_the_dependencies_of_the_elements_and_derivatives_name_their_states(interface, root3):
    description = read(root3)
    derivatives = [u.variable for u in description.derivatives]
    assert [v.name for v in derivatives] == [f"der({v.derivative.name})" for v in derivatives]
    assert [v.shape for v in derivatives] == [v.derivative.shape for v in derivatives]
    positions = [v.derivative.valueReference + k for v in derivatives for k in range(int(np.prod(v.shape)))]
    assert positions == list(range(interface.states.start, interface.states.stop))
    of_position = {i: array.first for array in interface.arrays for i in range(array.first, array.first + array.size)}
    calculated = {i for i, v in enumerate(interface.memory) if v.causality in ("output", "local")}
    for tag, kinds, dependencies in (
        ("Output", {"output"}, interface.step_dependencies),
        ("ContinuousStateDerivative", {"local"}, interface.step_dependencies),
        ("InitialUnknown", {"output", "local"}, interface.start_dependencies),
    ):
        expected: dict[int, set[int]] = {}
        for i in sorted(calculated):
            if interface.memory[i].causality in kinds:
                sources = {of_position[k] for k in dependencies(i)}
                expected[of_position[i]] = expected.get(of_position[i], set()) | sources
        elements = structure(root3, tag)
        assert [numbers(u.get("valueReference")) for u in elements] == [[first] for first in expected]
        assert [numbers(u.get("dependencies")) for u in elements] == [sorted(k) for k in expected.values()]
    (time,) = (v for v in read(root3).modelVariables if v.causality == "independent")
    assert (time.name, time.valueReference, time.unit, time.start) == ("time", interface.time, "s", None)


def test_start_values_of_arrays_are_the_robots_row_by_row(general):
    variables = {v.name: v for v in read(root_of(Interface(shipped_units()["plant"], general), 3)).modelVariables}

    def start(variable: ModelVariable) -> np.ndarray:
        return np.array(variable.start.split(), dtype=float).reshape(variable.shape)

    for field in ("gravity", "offset", "centroid", "mass", "f_ck"):
        assert np.array_equal(start(variables[field]), getattr(general, field)), field


@pytest.mark.parametrize("version", VERSIONS)
def test_every_unit_is_defined_once_and_used(interface, version):
    root = root_of(interface, version)
    defined = [unit.get("name") for unit in root.iterfind("UnitDefinitions/Unit")]
    used = {v.get("unit") for v in root.iter() if v.tag in ("Real", "Float64")}
    assert sorted(map(str, defined)) == sorted(map(str, used))


@pytest.mark.parametrize("version", VERSIONS)
def test_log_categories_and_experiment(interface, version):
    root = root_of(interface, version)
    categories = {c.get("name"): c.get("description", "") for c in root.iterfind("LogCategories/Category")}
    assert {f"logStatus{status}" for status in ("Warning", "Discard", "Error", "Fatal")} == set(categories) - {
        "logAll",
        "logEvents",
    }
    assert all(f"fmi{5 - version}" not in text for text in categories.values())
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    tolerances = [str(v.start) for v in interface if v.name == "tolerance"]
    assert set(experiment.attrib) == {"startTime", "stopTime", "stepSize", *(["tolerance"] if tolerances else [])}
    assert [experiment.get("tolerance")] == (tolerances or [None])
