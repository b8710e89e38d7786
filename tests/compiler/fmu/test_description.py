"""The model descriptions of all forms: valid, and the same as the layout and the variable table."""

import io
import math
import zipfile
from collections.abc import Callable, Iterable
from functools import cache
from xml.etree.ElementTree import Element

import fmpy
import pytest
from fmpy.model_description import ModelDescription, Unknown
from fmpy.validation import validate_fmu

from tests.conftest import heavy
from vdfmu.arm.units import shipped_units
from vdfmu.base.measure import measure
from vdfmu.compiler.fmu.description import build_description, document, model_description, model_description_3
from vdfmu.compiler.unit.interface import Interface

ABOUT = {"author": "Ada", "license": "MIT"}
GUID, TOOL = "{01234567-89ab-cdef-0123-456789abcdef}", "vdfmu 0"
SOURCES = ("unit.c", "solver.c")
EACH = pytest.mark.parametrize("form", ["python", "2.0", "3.0"])


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


@pytest.fixture(params=[*heavy("manipulator_6dof"), "planar_2dof", "slider_3dof"])
def robot_name(request):
    return request.param


@pytest.fixture
def interface(interfaces, robot_name, unit_name):
    return interfaces[robot_name, unit_name]


@pytest.fixture
def root(interface, form):
    return root_of(interface, form)


@pytest.mark.heavy
def test_fmpy_finds_no_problem(fmus, robot_name, unit_name):
    """It validates by the schema of the standard too; native FMUs in native/test_valid.py."""
    assert validate_fmu(str(fmus[robot_name][unit_name])) == []


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


TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}


@EACH
def test_each_variable_is_that_of_the_table(interface, root, form):
    """A scalar of FMI 2.0 has one of the table, an array of FMI 3.0 those of its elements, which share the rest."""
    described = [v for v in read(root).modelVariables if v.causality != "independent"]
    if form == "3.0":
        expected = [(a.name, a.first, a.shape, interface.memory[a.positions]) for a in interface.arrays[:-1]]
    else:
        end = len(interface) if form == "python" else interface.time
        expected = [(v.name, i, (), [v]) for i, v in enumerate(interface.memory[:end])]
    assert [(v.name, v.valueReference, v.shape or ()) for v in described] == [each[:3] for each in expected]
    for variable, (name, *_, members) in zip(described, expected, strict=True):
        first = members[0]
        assert variable.type == (TYPES[first.type] if form == "3.0" else first.type), name
        for attribute in ("causality", "variability", "unit"):
            assert getattr(variable, attribute) == getattr(first, attribute), (name, attribute)
        assert variable.displayUnit == first.display_unit, name
        assert form == "3.0" or variable.description == first.description
        for text, limit in ((variable.min, first.minimum), (variable.max, first.maximum)):
            assert (None if text is None else float(text)) == limit, name
        texts = variable.start.split() if variable.start else [None]
        values = [
            text if text is None else text == "true" if first.type == "Boolean" else float(text) for text in texts
        ]
        assert values == [v.start for v in members][: len(texts)], name


def listed(unknowns: Iterable[Unknown]) -> list[tuple[str, set[str]]]:
    """Return the names of unknowns, and of what each is said to depend on."""
    return [(u.variable.name, {v.name for v in u.dependencies}) for u in unknowns]


@EACH
def test_the_structure_is_that_of_the_layout(interface, root, form):
    """In FMI 3.0 an array depends on what its elements do. A Python FMU shows no derivatives, and no states."""
    owners = (
        [interface.arrays[k].name for k in interface.owners] if form == "3.0" else [v.name for v in interface.memory]
    )
    hidden = {"local", "output"} if form == "python" else set()

    def joined(causalities: set[str], dependencies: Callable[[int], list[int]]) -> list[tuple[str, set[str]]]:
        sources: dict[str, set[str]] = {}
        for i, variable in enumerate(interface.memory):
            if variable.causality in causalities:
                listed = [k for k in dependencies(i) if form == "3.0" or k != interface.time]
                shown = {owners[k] for k in listed if interface.memory[k].causality not in hidden}
                sources[owners[i]] = sources.get(owners[i], set()) | shown
        return [*sources.items()]

    description, rates = read(root), set() if form == "python" else {"local"}
    assert listed(description.outputs) == joined({"output"}, interface.step_dependencies)
    assert listed(description.derivatives) == joined(rates, interface.step_dependencies)
    assert listed(description.initialUnknowns) == joined({"output", *rates}, interface.start_dependencies)
    states = dict.fromkeys(owners[interface.states] if rates else [])
    assert [u.variable.derivative.name for u in description.derivatives] == [*states]
    assert description.numberOfContinuousStates == (interface.states.stop - interface.states.start if rates else 0)


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


@EACH
def test_log_categories_and_experiment(root, form):
    categories = {c.get("name") for c in root.iterfind("LogCategories/Category")}
    statuses = {f"logStatus{status}" for status in ("Warning", "Discard", "Error", "Fatal")}
    assert form == "python" or categories == statuses | {"logAll", "logEvents"}
    experiment = {name: float(value) for name, value in root.find("DefaultExperiment").attrib.items()}
    # Where there is no tolerance, importers hand the unit one of their own, of 1e-4.
    assert experiment.get("tolerance", 1e-7) == 1e-7
    steps = experiment["stopTime"] / experiment["stepSize"]
    assert experiment["startTime"] == 0.0 and steps == pytest.approx(round(steps), rel=1e-12)
