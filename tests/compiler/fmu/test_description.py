"""The model descriptions: valid, and the same as the variable table."""

import math
import zipfile

import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from vdfmu.arm.units import shipped_units
from vdfmu.base.measure import measure
from vdfmu.compiler.unit.interface import Interface


@pytest.fixture
def path(fmus, robot_name, unit_name):
    return fmus[robot_name][unit_name]


@pytest.fixture
def root(path):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read("modelDescription.xml"))


def test_fmpy_finds_no_problem(path):
    """It validates by the schema of the standard too."""
    assert validate_fmu(str(path)) == []


def test_each_variable_is_that_of_the_table(root, robots, robot_name, unit_name):
    table = Interface(shipped_units()[unit_name], robots[robot_name])
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


def test_start_values_lie_within_their_limits_and_only_what_each_step_reads_is_tunable(robots, robot_name, unit_name):
    for variable in Interface(shipped_units()[unit_name], robots[robot_name]):
        if variable.start is not None:
            assert variable.problem(variable.start) is None, variable.name
    table = Interface(shipped_units()[unit_name], robots[robot_name])
    tunable = {v.group for v in table if v.variability == "tunable"}
    assert (
        tunable
        == {
            "trajectory": set(), "feedforward": {"Lambda", "K_V", "k_vq", "k_vkappa"},
            "controller": {"K_p", "K_v", "tau_max"}, "plant": set(), "estimator": {"tau_hat_max"},
        }[unit_name]
    )  # fmt: skip


def test_units_and_display_units_are_as_their_names_say(root):
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


def test_capabilities_are_declared_and_the_default_experiment_has_the_tolerance_of_the_plant(root, unit_name):
    unit = dict(root.find("CoSimulation").attrib)
    true = {name for name, value in unit.items() if value == "true"}
    assert true == {
        "needsExecutionTool", "canHandleVariableCommunicationStepSize", "canNotUseMemoryManagementFunctions",
        "canGetAndSetFMUstate", "canSerializeFMUstate",
    }  # fmt: skip
    assert unit["modelIdentifier"] == root.get("modelName")
    # Where there is none, importers hand the unit one of their own, of 1e-4.
    experiment = root.find("DefaultExperiment")
    solver = {"tolerance"} if unit_name == "plant" else set()
    assert set(experiment.attrib) == {"startTime", "stopTime", "stepSize"} | solver
    if solver:
        variable = root.find("ModelVariables/ScalarVariable[@name='tolerance']/Real")
        assert experiment.get("tolerance") == variable.get("start") == "1e-07"
    assert float(experiment.get("startTime")) == 0.0
    stop, step = float(experiment.get("stopTime")), float(experiment.get("stepSize"))
    assert stop / step == pytest.approx(round(stop / step), rel=1e-12)


def test_model_structure_lists_each_output_twice_and_nothing_else(root, robots, robot_name, unit_name):
    table = Interface(shipped_units()[unit_name], robots[robot_name])
    outputs = [i for i, v in enumerate(table) if v.causality == "output"]
    assert [element.tag for element in root.find("ModelStructure")] == ["Outputs", "InitialUnknowns"]
    for tag, declared in (("Outputs", table.step_dependencies), ("InitialUnknowns", table.start_dependencies)):
        unknowns = root.findall(f"ModelStructure/{tag}/Unknown")
        assert [int(u.get("index")) - 1 for u in unknowns] == outputs
        for unknown, output in zip(unknowns, outputs, strict=True):
            dependencies = [int(k) - 1 for k in unknown.get("dependencies").split()]
            sources = [i for i in declared(output) if table.memory[i].causality in ("input", "parameter")]
            assert dependencies == sources
