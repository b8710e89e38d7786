"""The model descriptions of all forms: valid, and the same as the layout and the variable table."""

import io
import math
import zipfile
from functools import cache
from xml.etree.ElementTree import Element, tostring

import fmpy
import numpy as np
import pytest
from fmpy.model_description import ModelDescription, ModelVariable
from fmpy.validation import validate_fmu

from vdfmu.arm.units import shipped_units
from vdfmu.base.measure import measure
from vdfmu.compiler.fmu.description import build_description, document, model_description, model_description_3
from vdfmu.compiler.unit.interface import Interface

ABOUT = {"author": "Ada", "license": "MIT"}
GUID, TOOL = "{01234567-89ab-cdef-0123-456789abcdef}", "vdfmu 0"
SOURCES = ("unit.c", "solver.c")
EACH = pytest.mark.parametrize("form", ["python", "2.0", "3.0"])
OF_FMI_2 = pytest.mark.parametrize("form", ["python", "2.0"])


@cache
def root_of(interface: Interface, form: str) -> Element:
    if form == "3.0":
        return model_description_3(interface, GUID, TOOL, ABOUT)
    return model_description(interface, GUID, TOOL, ABOUT, *([SOURCES] if form == "2.0" else []))


@cache
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
def root(interface, form):
    return root_of(interface, form)


def structure(root: Element, tag: str) -> list[Element]:
    element = root.find("ModelStructure")
    assert element is not None
    return element.findall(tag)


def numbers(text: str | None) -> list[int]:
    assert text is not None
    return [int(word) for word in text.split()]


def test_fmpy_finds_no_problem(fmus, robot_name, unit_name):
    """It validates by the schema of the standard too; native FMUs in native/test_valid.py."""
    assert validate_fmu(str(fmus[robot_name][unit_name])) == []


@pytest.mark.few(5)
@EACH
def test_native_plants_have_model_exchange_and_states(root, interface, form, unit_name):
    description = read(root)
    assert description.fmiVersion == ("2.0" if form == "python" else form)
    assert description.guid == GUID
    assert description.modelName == interface.model_name == description.coSimulation.modelIdentifier
    assert (description.modelExchange is not None) == (unit_name == "plant" and form != "python")
    n_x = interface.states.stop - interface.states.start
    assert description.numberOfContinuousStates == (0 if form == "python" else n_x)
    assert description.numberOfEventIndicators == 0


ALL = {"canGetAndSetFMUstate", "canSerializeFMUstate", "canNotUseMemoryManagementFunctions"}
ALL_3 = {
    "canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives", "providesAdjointDerivatives",
    "providesPerElementDependencies",
}  # fmt: skip
FLAGS = {
    "python": {"CoSimulation": ALL | {"needsExecutionTool", "canHandleVariableCommunicationStepSize"}},
    "2.0": {
        "CoSimulation": ALL
        | {"providesDirectionalDerivative", "canHandleVariableCommunicationStepSize", "canInterpolateInputs"},
        "ModelExchange": ALL | {"providesDirectionalDerivative", "completedIntegratorStepNotNeeded"},
    },
    "3.0": {
        "CoSimulation": ALL_3 | {"canHandleVariableCommunicationStepSize", "providesIntermediateUpdate"},
        "ModelExchange": ALL_3,
    },
}


@EACH
def test_capabilities_are_declared(root, form, unit_name):
    for tag, flags in FLAGS[form].items():
        element = root.find(tag)
        if tag == "ModelExchange" and unit_name != "plant":
            assert element is None
            continue
        early = {"canReturnEarlyAfterIntermediateUpdate"} if (form, unit_name) == ("3.0", "plant") else set()
        assert {k for k, v in element.attrib.items() if v == "true"} == flags | (early if tag[0] == "C" else set())
        assert element.get("modelIdentifier") == root.get("modelName")
        files = [file.get("name") for file in element.iterfind("SourceFiles/File")]
        assert files == (list(SOURCES) if form == "2.0" else [])


def test_each_variable_is_that_of_the_table(interface):
    table, root = interface, root_of(interface, "python")
    scalars = root.findall("ModelVariables/ScalarVariable")
    assert len(scalars) == len(table)
    for reference, (scalar, variable) in enumerate(zip(scalars, table, strict=True)):
        (value,) = scalar
        assert scalar.get("name") == variable.name
        assert scalar.get("valueReference") == str(reference)
        assert scalar.get("description") == variable.description
        assert scalar.get("causality") == variable.causality
        assert scalar.get("variability") == variable.variability
        assert (
            scalar.get("initial") == {"parameter": "exact", "output": "calculated", "input": None}[variable.causality]
        )
        assert value.tag == variable.type
        assert value.get("unit") == variable.unit
        assert value.get("displayUnit") == variable.display_unit
        for attribute, expected in (
            ("min", variable.minimum), ("max", variable.maximum), ("start", variable.start)
        ):  # fmt: skip
            text = value.get(attribute)
            if expected is None:
                assert text is None, (variable.name, attribute)
            elif variable.type == "Boolean":
                assert text == str(expected).lower()
            else:
                assert float(text) == expected, (variable.name, attribute)
    native = [tostring(v) for v in root_of(interface, "2.0").iterfind("ModelVariables/ScalarVariable")]
    assert native[: len(scalars)] == [tostring(v) for v in scalars]
    assert len(native) == interface.time


@OF_FMI_2
def test_the_structure_of_fmi_2_is_that_of_the_layout(interface, root, form):
    def is_listed(i: int) -> bool:
        return i != interface.time and (form == "2.0" or interface.memory[i].causality in ("input", "parameter"))

    description = read(root)
    states, derivatives = (
        [v.name for v in interface.memory[part]] if form == "2.0" else []
        for part in (interface.states, interface.derivatives)
    )
    assert [u.variable.name for u in description.derivatives] == derivatives
    assert [u.variable.derivative.name for u in description.derivatives] == states
    of = {kind: [i for i, v in enumerate(interface.memory) if v.causality == kind] for kind in ("output", "local")}
    rates = of["local"] if form == "2.0" else []
    expected = {"Outputs": (of["output"], interface.step_dependencies)}
    if rates:
        expected["Derivatives"] = (rates, interface.step_dependencies)
    expected["InitialUnknowns"] = (of["output"] + rates, interface.start_dependencies)
    assert [element.tag for element in root.find("ModelStructure")] == [*expected]
    for tag, (unknowns, dependencies) in expected.items():
        elements = structure(root, f"{tag}/Unknown")
        assert [int(u.get("index", "")) - 1 for u in elements] == unknowns
        for element, unknown in zip(elements, unknowns, strict=True):
            sources = [i for i in dependencies(unknown) if is_listed(i)]
            assert [i - 1 for i in numbers(element.get("dependencies"))] == sources


@EACH
def test_every_unit_is_defined_once_and_used_and_those_of_displays_are_as_their_names_say(root):
    defined = [unit.get("name") for unit in root.iterfind("UnitDefinitions/Unit")]
    used = {v.get("unit") for v in root.iter() if v.tag in ("Real", "Float64")}
    assert sorted(map(str, defined)) == sorted(map(str, used))
    for unit in root.findall("UnitDefinitions/Unit"):
        expected = {name: str(exponent) for name, exponent in measure(unit.get("name")).exponents.items()}
        assert dict(unit.find("BaseUnit").attrib) == expected, unit.get("name")
    factors = {"deg": 180.0 / math.pi, "mm": 1e3, "ms": 1e3, "g": 1e3}
    for unit in root.findall("UnitDefinitions/Unit"):
        for display in unit.findall("DisplayUnit"):
            # value in the display unit = factor * value in the unit: `deg/s`, `N.mm`, `N/mm`
            over, _, under = display.get("name").partition("/")
            factor = math.prod(factors.get(p, 1.0) for p in over.split("."))
            factor /= math.prod(factors.get(p, 1.0) for p in under.split("."))
            assert float(display.get("factor")) == pytest.approx(factor, rel=1e-15)
            assert display.get("offset") is None


@EACH
def test_log_categories_and_experiment(interface, root, form):
    categories = {c.get("name"): c.get("description", "") for c in root.iterfind("LogCategories/Category")}
    if form != "python":
        statuses = {f"logStatus{status}" for status in ("Warning", "Discard", "Error", "Fatal")}
        assert set(categories) == statuses | {"logAll", "logEvents"}
        assert all(f"fmi{5 - int(form[0])}" not in text for text in categories.values())
    # Where there is no tolerance, importers hand the unit one of their own, of 1e-4.
    experiment = dict(root.find("DefaultExperiment").attrib)
    tolerance = experiment.pop("tolerance", None)
    assert tolerance == ("1e-07" if "tolerance" in interface.groups else None)
    assert tolerance is None or interface.find("tolerance").start == float(tolerance)
    start, stop, step = (float(experiment.pop(name)) for name in ("startTime", "stopTime", "stepSize"))
    assert start == 0.0 and not experiment
    assert stop / step == pytest.approx(round(stop / step), rel=1e-12)


def test_arrays_of_fmi_3_are_those_of_the_layout(interface):
    root3 = root_of(interface, "3.0")
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


def test_structure_of_fmi_3_joins_the_dependencies_of_the_elements_and_derivatives_name_their_states(interface):
    root3 = root_of(interface, "3.0")
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
    (time,) = (v for v in description.modelVariables if v.causality == "independent")
    assert (time.name, time.valueReference, time.unit, time.start) == ("time", interface.time, "s", None)


def test_start_values_of_arrays_are_the_robots_row_by_row(general):
    variables = {v.name: v for v in read(root_of(Interface(shipped_units()["plant"], general), "3.0")).modelVariables}

    def start(variable: ModelVariable) -> np.ndarray:
        return np.array(variable.start.split(), dtype=float).reshape(variable.shape)

    for field in ("gravity", "offset", "centroid", "mass", "f_ck"):
        assert np.array_equal(start(variables[field]), getattr(general, field)), field


def test_start_values_lie_within_their_limits_and_only_what_each_step_reads_is_tunable(interface, unit_name):
    for variable in interface:
        if variable.start is not None:
            assert variable.problem(variable.start) is None, variable.name
    tunable = {v.group for v in interface if v.variability == "tunable"}
    assert (
        tunable
        == {
            "trajectory": set(), "feedforward": {"Lambda", "K_V", "k_vq", "k_vkappa"},
            "controller": {"K_p", "K_v", "tau_max"}, "plant": set(), "estimator": {"tau_hat_max"},
        }[unit_name]
    )  # fmt: skip


def test_quantities_of_a_prismatic_joint_are_linear(robots):
    robot = robots["slider_3dof"]
    (i,) = (i for i, kind in enumerate(robot.joint_types) if kind == "prismatic")
    units = {
        (v.group, v.index): v.unit for name in ("controller", "plant") for v in Interface(shipped_units()[name], robot)
    }
    expected = {
        "q": "m", "q_dot": "m/s", "tau_s": "N", "tau": "N.m", "ell": "rad/m", "K_p": "N/m", "K_v": "N.s/m",
        "K_f0": "N/m", "K_w0": "N.m/rad", "I_m": "kg.m", "f_s": "N", "f_v": "N.s/m", "v_s": "m/s",
    }  # fmt: skip
    assert {group: units[group, (i,)] for group in expected} == expected
