"""What all formats are written from: signals, connections, parameter sets; and the diagram of the SSD."""

import dataclasses

import pytest

from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.structure_file import structure_file
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import group_value, robot_parameters, system_values

SCENARIOS = ["estimation", "planar_tracking", "slider_tracking", "tracking", "two_joint"]


@pytest.fixture(scope="module", params=SCENARIOS)
def scenario(request):
    return load_scenario(request.param)


@pytest.fixture(params=["1.0", "2.0"])
def description(scenario, request):
    return SystemDescription(scenario, version=request.param)


def bound_values(description, unit):
    """Name of a unit's variable to the values that its bindings give it, in their order."""
    bound = {}
    for binding in description.bindings[unit]:
        names = dict(binding.mapping)
        for signal, values in description.parameter_sets[binding.file].entries:
            name = names.get(signal.name, signal.name)
            group = name.split("[")[0]
            for variable, value in zip(signal.variables, values, strict=True):
                index = dataclasses.replace(variable, group=group).name
                bound.setdefault(index, []).append(value)
    return bound


def test_every_value_is_in_one_set_and_the_scenario_first_holds_all_that_the_fmu_of_the_robot_lacks(description):
    for unit, values in description.values.items():
        assert bound_values(description, unit) == {name: [value] for name, value in values.items()}
    # So an importer that applies one set applies the first, and the FMU's start values are the rest.
    defaults = robot_parameters("feedforward", description.tables["feedforward"], description.scenario)
    for unit, bindings in description.bindings.items():
        sets = [description.parameter_sets[b.file] for b in bindings]
        names = [s.name for s in sets]
        if unit == "estimator":  # a scenario sets nothing of it
            assert names == ["robot"]
        else:
            assert names[0] == "scenario"
            assert names[1:] in (["robot"], ["robot", "start"], ["start"])
        for signal, values in (entry for s in sets if s.name == "robot" for entry in s.entries):
            for variable, value in zip(signal.variables, values, strict=True):
                assert value == defaults[variable.name], (unit, variable.name)


def test_the_plant_that_differs_has_its_values_and_the_start_is_one_value_with_two_names():
    description = SystemDescription(load_scenario("two_joint"))
    scenario = {s.name for s, _ in description.parameter_sets["plant.scenario.ssv"].entries}
    robot = {s.name for s, _ in description.parameter_sets["plant.robot.ssv"].entries}
    assert {"mass[1]", "K_f0[6]", "f_v[2]"} <= scenario
    assert {"ell[1]", "I_m[6]", "centroid[1,3]"} <= robot
    assert description.bindings["feedforward"][1].file == "robot.ssv"
    scenario = load_scenario("planar_tracking")
    description = SystemDescription(scenario)
    (binding,) = [b for b in description.bindings["plant"] if b.file == "start.ssv"]
    assert binding.mapping == (("q_start[1]", "q_0[1]"), ("q_start[2]", "q_0[2]"))
    elsewhere = SystemDescription(scenario, system_values(scenario, {"plant.q_0[2]": "0.1"}))
    assert "start.ssv" not in elsewhere.parameter_sets
    assert bound_values(elsewhere, "plant")["q_0[2]"] == [0.1]
    assert bound_values(elsewhere, "trajectory")["q_start[2]"] == [group_value(scenario, "trajectory.q_start")[1]]


def test_both_versions_connect_the_same_elements_arrays_whole_and_mixed_units_by_element(scenario):
    elements = []
    for version in ("1.0", "2.0"):
        description = SystemDescription(scenario, version=version)
        pairs = set()
        for link in description.links:
            sides = []
            for (unit, signal), index in ((link.start, link.start_index), (link.end, link.end_index)):
                chosen = [v for v in signal.variables if not index or tuple(i + 1 for i in v.index) == index]
                sides.append([f"{unit}.{v.name}" for v in chosen])
            pairs |= set(zip(*sides, strict=True))
        elements.append(pairs)
    assert elements[0] == elements[1]
    pairs_of_groups = 19 if scenario.system.path.stem == "estimator" else 16  # all of one signal a joint
    assert len(elements[0]) == pairs_of_groups * scenario.robot.n
    whole = SystemDescription(load_scenario("tracking"), version="2.0").links
    assert {len(link.start[1].variables) for link in whole} == {6}
    assert len(whole) == 16
    mixed = SystemDescription(load_scenario("slider_tracking"), version="2.0").links  # rad and m in one group
    assert {link.start[1].name for link in mixed if link.start[1].group == "q"} == {"q[1]", "q[2]", "q[3]"}


def test_elements_of_arrays_are_connected_by_index():
    scenario = load_scenario("planar_tracking")
    crossed = {"trajectory.q_d[1]": ["controller.q_d[2]"], "plant.q": ["controller.q"]}
    scenario = dataclasses.replace(scenario, system=dataclasses.replace(scenario.system, connections=crossed))
    element, whole = SystemDescription(scenario, version="2.0").links
    assert (element.start[1].shape, element.start_index, element.end_index) == ((2,), (1,), (2,))
    assert (whole.start_index, whole.end_index) == ((), ())


def test_boxes_of_the_diagram_lie_apart_on_the_canvas_with_connectors_at_their_sides(description):
    root = structure_file(description)

    def box_of(element):
        return [float(element.get(key)) for key in ("x1", "y1", "x2", "y2")]

    x1, y1, x2, y2 = box_of(root.find(".//ssd:SystemGeometry", NAMESPACES))
    boxes = []
    for component in root.iterfind(".//ssd:Component", NAMESPACES):
        left, low, right, high = box = box_of(component.find("ssd:ElementGeometry", NAMESPACES))
        assert x1 < left < right < x2 and y1 < low < high < y2
        assert all(left > other[2] or right < other[0] or low > other[3] or high < other[1] for other in boxes)
        boxes.append(box)
        places = set()
        connectors = component.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
        for connector in connectors:
            place = connector.find("ssd:ConnectorGeometry", NAMESPACES)
            places.add((place.get("x"), place.get("y")))
            assert float(place.get("x")) == (0.0 if connector.get("kind") == "input" else 1.0)
        assert len(places) == len(connectors)
