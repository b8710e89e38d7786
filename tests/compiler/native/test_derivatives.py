"""Directional and adjoint derivatives are the slopes of the outputs, and dependencies are where slopes are not zero.

Slopes are found through the unit's own functions: central differences with Richardson's extrapolation.
"""

import ctypes as ct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.compiler.native.binding import Instance, Variable, doubles, references
from tests.compiler.native.slopes import assert_slopes, directional, elements, slopes
from tests.compiler.points import POINTS, random_value


def random_point(unit: Instance, variables: Sequence[Variable]) -> np.ndarray:
    """Values at which nothing is hidden, as the tests of the Python units use them."""
    rng = np.random.default_rng(1)
    return np.array(
        [
            random_value(v.group, v.causality, start, v.group == "theta_err_amplitude", rng)
            for v in variables
            for start in np.atleast_1d(unit.read([v]))
        ]
    )


def configure(unit: Instance, choices: dict[str, Any]) -> tuple[list[Variable], np.ndarray]:
    knowns = unit.model.of("input", "parameter")
    point = random_point(unit, knowns)
    names = elements(knowns)
    for group, value in choices.items():
        if any(v.name == group and v.type != "Real" for v in unit.model.variables):
            unit.set(**{group: value})
        else:
            point[[name.split("[")[0] == group for name in names]] = value
    return knowns, point


def step_sizes(point: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Return a thousandth of the value: within the limits, and inertias within the triangle inequality."""
    assert np.all(point != 0.0), [name for name, value in zip(names, point, strict=True) if value == 0.0]
    return 1e-3 * np.abs(point)


def initial_case(unit: Instance, choices: dict[str, Any]) -> tuple[Any, ...]:
    """Take a unit to a point in initialization mode; return its knowns, unknowns, their values and the steps."""
    knowns, point = configure(unit, choices)
    unit.write(knowns, point).setup().enter()
    unknowns = unit.model.of("output", "local")

    def evaluate(values: np.ndarray) -> np.ndarray:
        return unit.write(knowns, values).read(unknowns)

    return knowns, unknowns, point, evaluate


@pytest.mark.heavy
def test_during_initialization_they_are_slopes_in_inputs_and_parameters(native, version, unit_name, robot_name):
    for choices in POINTS[unit_name]:
        unit = native(unit_name, version, robot_name)
        knowns, unknowns, point, evaluate = initial_case(unit, choices)
        matrix = directional(unit, unknowns, knowns)
        h = step_sizes(point, elements(knowns))
        expected = slopes(evaluate, point, h)
        assert_slopes(matrix, expected, evaluate(point), h)
        assert np.any(matrix != 0.0)


def exchange_case(unit: Instance, choices: dict[str, Any]) -> tuple[Any, ...]:
    """Plant in continuous-time mode: knowns are inputs and states."""
    knowns, point = configure(unit, choices)
    unit.write(knowns, point).start().continuous()
    inputs = unit.model.of("input")
    states = [v for v in unit.model.of("output") if v.group in ("q", "q_dot", "kappa_dot", "tau_s")]
    unknowns = unit.model.of("output", "local")
    n = len(elements(inputs))
    rng = np.random.default_rng(2)
    values = np.concatenate([unit.read(inputs), rng.uniform(-0.9, 0.9, unit.model.n_states)])

    def evaluate(values: np.ndarray) -> np.ndarray:
        return unit.write(inputs, values[:n]).states(values[n:]).read(unknowns)

    evaluate(values)
    return [*inputs, *states], unknowns, values, evaluate


def stepping_case(unit: Instance, choices: dict[str, Any]) -> tuple[Any, ...]:
    """Take a unit without states to step mode: knowns are inputs. A step shows their effect."""
    knowns, point = configure(unit, choices)
    unit.write(knowns, point).start()
    inputs = unit.model.of("input")
    unknowns = unit.model.of("output")
    values = unit.read(inputs) if inputs else np.empty(0)

    def evaluate(values: np.ndarray) -> np.ndarray:
        if inputs:
            unit.write(inputs, values)
        return unit.step(2.0**-10).outputs()

    evaluate(values)
    return inputs, unknowns, values, evaluate


def test_in_continuous_time_they_are_slopes_in_inputs_and_states(native, version, robot_name):
    unit = native("plant", version, robot_name, kind="ModelExchange")
    knowns, unknowns, point, evaluate = exchange_case(unit, {})
    matrix = directional(unit, unknowns, knowns)
    h = np.full(len(point), 1e-3)
    assert_slopes(matrix, slopes(evaluate, point, h), evaluate(point), h)
    names, rows = elements(knowns), elements(unknowns)
    for i in range(unit.model.n_states // 4):  # a state that is an output depends on itself
        assert matrix[rows.index(f"q[{i + 1}]"), names.index(f"q[{i + 1}]")] == 1.0
        (row,) = (k for k, name in enumerate(rows) if name in (f"der(q[{i + 1}])", f"der(q)[{i + 1}]"))
        assert matrix[row, names.index(f"q_dot[{i + 1}]")] == 1.0


@pytest.mark.parametrize("unit_name", ["feedforward", "controller"])
def test_in_step_mode_they_are_slopes_in_inputs(native, version, unit_name, robot_name):
    for choices in POINTS[unit_name]:
        unit = native(unit_name, version, robot_name)
        knowns, unknowns, point, evaluate = stepping_case(unit, choices)
        matrix = directional(unit, unknowns, knowns)
        h = np.full(len(point), 1e-3)
        assert_slopes(matrix, slopes(evaluate, point, h), evaluate(point), h)


def test_the_plant_in_step_mode_gives_those_of_its_state_and_the_trajectory_those_in_time(native, version):
    """Co-simulation and model exchange at the same point: the same bits."""
    start = {"q_0": [0.3, -0.2], "q_dot_0": [0.1, 0.4], "tau": [0.1, 0.2]}
    simulation = native("plant", version).start(**start)
    exchange = native("plant", version, kind="ModelExchange").start(**start)
    unknowns = simulation.model.of("output", "local")
    knowns = [*simulation.model.of("input"), *(v for v in simulation.model.of("output") if v.group in ("q", "tau_s"))]
    assert directional(simulation, unknowns, knowns).tolist() == directional(exchange, unknowns, knowns).tolist()
    # FMI 3 offers time as a known. The five groups are derivatives of one another.
    unit = native("trajectory", "3.0").start(0.7, q_end=[1.0, -2.0], T=3.0).step(0.25)
    (time,) = unit.model.of("independent")
    rates = unit.directional(unit.model.of("output"), [time], [1.0]).reshape(5, 2)
    values = unit.outputs().reshape(5, 2)
    np.testing.assert_allclose(rates[:4], values[1:], rtol=1e-12, atol=1e-12)
    plant = native("plant", "3.0").start().step(0.01)
    assert not plant.directional(plant.model.of("output"), plant.model.of("independent"), [1.0]).any()


def test_a_seed_is_a_direction_and_derivatives_change_nothing(native, version, unit_name):
    """Linear in the seed, to rounding: 1e-12 of the sum of the parts. A value that is named twice counts twice."""
    unit = native("plant", version, kind="ModelExchange").start(q_0=[0.3, -0.2], q_dot_0=[0.5, 0.4]).continuous()
    knowns, unknowns = unit.model.of("input"), unit.model.of("output", "local")
    seed = np.linspace(-1.0, 2.0, len(elements(knowns)))
    jacobian = directional(unit, unknowns, knowns)
    np.testing.assert_allclose(
        unit.directional(unknowns, knowns, seed), jacobian @ seed, rtol=0.0, atol=1e-12 * np.abs(jacobian).max()
    )
    twice = unit.directional(unknowns, [knowns[0], knowns[0]], np.ones(2 * len(knowns[0].names)))
    np.testing.assert_allclose(twice, 2.0 * unit.directional(unknowns, [knowns[0]], np.ones(len(knowns[0].names))))
    assert not unit.directional(unknowns, [], []).any()
    unit = native(unit_name, version).start()
    unit.step(1e-3)
    unit.outputs()
    before = unit.complete()
    knowns, unknowns = unit.model.of("input"), unit.model.of("output", "local")
    directional(unit, unknowns, knowns)
    if version == "3.0":
        unit.adjoint(unknowns, knowns, np.ones(len(elements(unknowns))))
    assert unit.complete() == before


def test_adjoint_derivatives_are_the_transpose(native, unit_name, robot_name):
    """In both phases, for all choices; each of some thousand products and sums rounds by 1e-16 of the largest."""
    for choices in POINTS[unit_name]:
        unit = native(unit_name, "3.0", robot_name)
        knowns, unknowns, *_ = initial_case(unit, choices)
        for phase in ("initialization", "step"):
            if phase == "step":
                unit.do("ExitInitializationMode")
                knowns = [*unit.model.of("input"), *unit.model.of("independent")]
                if unit_name == "plant":
                    knowns += [v for v in unknowns if v.group in ("q", "q_dot", "kappa_dot", "tau_s")]
            forward = directional(unit, unknowns, knowns)
            seeds = np.eye(len(elements(unknowns)))
            backward = np.array([unit.adjoint(unknowns, knowns, seed) for seed in seeds])
            scale = np.abs(forward).max(axis=1, keepdims=True)
            # terms of about 10 N.m may cancel, as gravity does about a vertical axis: 1e-13
            assert np.all(np.abs(forward - backward) <= 1e-11 * (0.01 + scale)), phase


def structure(unit: Instance, tag: str) -> dict[str, set[str]]:
    """Element to elements it is declared to depend on, from the ModelStructure of FMI 2."""
    names = [v.name for v in unit.model.variables]
    sources: dict[str, set[str]] = {}
    tags = (tag,) if tag == "InitialUnknowns" else ("Outputs", "Derivatives")
    for part in tags:
        for unknown in unit.model.root.findall(f"ModelStructure/{part}/Unknown"):
            listed = unknown.attrib["dependencies"].split()
            sources[names[int(unknown.attrib["index"]) - 1]] = {names[int(i) - 1] for i in listed}
    return sources


def per_element(unit: Instance, positions: Sequence[str]) -> dict[str, set[str]]:
    sources: dict[str, set[str]] = {}
    for v in unit.model.of("output", "local"):
        n = ct.c_size_t()
        unit.do("GetNumberOfVariableDependencies", v.reference, ct.byref(n))
        own_elements, source_elements = (ct.c_size_t * n.value)(), (ct.c_size_t * n.value)()
        refs, kinds = (ct.c_uint32 * n.value)(), (ct.c_int * n.value)()
        unit.do("GetVariableDependencies", v.reference, own_elements, refs, source_elements, kinds, n.value)
        assert set(kinds) <= {5}  # fmi3Dependent
        for i in range(len(v.names)):
            sources[positions[v.reference + i]] = set()
        for i, ref, j in zip(own_elements, refs, source_elements, strict=True):
            sources[positions[v.reference + i - 1]].add(positions[ref + j - 1])
    return sources


def test_dependencies_of_elements_are_those_of_the_model_structure(native, unit_name, robot_name):
    """Those of FMI 3 also name the time, and what it moves is what depends on it: the trajectory."""
    two, three = native(unit_name, "2.0", robot_name), native(unit_name, "3.0", robot_name)
    positions = [*elements(two.model.variables), "time"]
    for phase, tag in (("instantiated", "InitialUnknowns"), ("initialization", "InitialUnknowns"), ("step", "Outputs")):
        if phase == "initialization":
            three.setup().enter()
        elif phase == "step":
            three.do("ExitInitializationMode")
        sources = per_element(three, positions)
        timed = {name for name, knowns in sources.items() if "time" in knowns}
        assert timed == (set(sources) if unit_name == "trajectory" else set())
        assert {name: knowns - {"time"} for name, knowns in sources.items()} == structure(two, tag), phase


@pytest.mark.parametrize("name", ["GetDirectionalDerivative", "GetAdjointDerivative"])
def test_seeds_of_the_wrong_number_are_refused(native, name):
    unit = native("plant", "3.0").start()
    (tau,), (q,) = unit.model.group("tau"), unit.model.group("q")
    lists = (references([q.reference]), 1, references([tau.reference]), 1)
    room = doubles(np.ones(8))
    for n_seed, n_sensitivity in ((1, 2), (2, 1), (3, 2), (2, 3), (0, 0)):
        before = unit.complete()
        with unit.refuses(rf"expected 2 seeds and 2 sensitivities, got {n_seed} and {n_sensitivity}\.") as no:
            no(name, *lists, room, n_seed, room, n_sensitivity)
        assert unit.complete() == before
        assert list(room) == [1.0] * 8
