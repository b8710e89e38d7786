"""Traced functions against the methods that they come from, on floats: every unit, on arms with all that there is."""

import dataclasses
from itertools import product

import numpy as np
import pytest

from tests.arm.balanced import ONE
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.units import package_units
from vdfmu.compiler.unit.declaration import Choice
from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface


def first_joint(robot: Robot) -> Robot:
    arrays = {name: getattr(robot, name)[:1] for name, row in PARAMETERS.items() if row.per_joint}
    return dataclasses.replace(robot, name="single", joint_types=robot.joint_types[:1], **arrays)


@pytest.fixture(scope="module", params=["general", "single", "balanced"])
def traced_robot(request, general):
    """Return the general chain, an arm of one joint, and one with a counterbalance."""
    return {"general": general, "single": first_joint(general), "balanced": ONE}[request.param]


def draw(table: Interface, seed: int) -> np.ndarray:
    """Return values of all variables: parameters up to 5 % from their start, states and inputs of order 1."""
    random, memory = np.random.default_rng(seed), table.memory_of({})
    for k, variable in enumerate(table.memory):
        if variable.type != "Real":
            continue
        if variable.causality == "parameter":
            memory[k] *= random.uniform(0.95, 1.05)
        elif variable.causality in ("input", "output", "local"):
            memory[k] = random.uniform(-1.0, 1.0)
    memory[-1] = 0.7
    return memory


UNITS = [name for name, unit in package_units().items() if unit.backend == "native" and unit.needs_robot()]


@pytest.mark.few(18)
@pytest.mark.parametrize("name", UNITS)
def test_a_traced_unit_sets_what_its_methods_set(traced_robot, name):
    table = Interface(package_units()[name], traced_robot)
    chosen = {each: range(len(d.choices)) for each, d in table.unit.declared.items() if isinstance(d, Choice)}
    for seed, values in enumerate(product(*chosen.values())):
        start = draw(table, seed)
        for choice, value in zip(chosen, values, strict=True):
            start[table.groups[choice]] = value
        plain, traced = Plain(table, start.copy()), Traced(table, start.copy())
        for phase in ("start", "outputs", "derivatives", "update"):
            getattr(plain, phase)()
            getattr(traced, phase)()
        for group, places in table.groups.items():
            expected = plain.memory[places]
            # The same operations, in an order that CasADi may change: some 5000 roundings, and what cancels.
            scale = np.abs(expected).max(initial=0.0)
            np.testing.assert_allclose(traced.memory[places], expected, rtol=0, atol=1e-11 * scale, err_msg=group)


def test_structure_decides_the_key_and_values_do_not(arm):
    key = arm.key()
    assert arm.with_parameters(mass=9.0, ell=50.0).key() == key
    turned = arm.rotation.copy()
    turned[1] = np.eye(3)
    changed = [
        arm.with_parameters(tool_offset=[0.1, 0.0, 0.0]),
        arm.with_parameters(theta_err_amplitude=1e-4),
        arm.with_parameters(rotation=turned),
        dataclasses.replace(arm, friction="split"),
        dataclasses.replace(arm, joint_types=("prismatic", *arm.joint_types[1:])),
    ]
    assert len({key, *(other.key() for other in changed)}) == 6


@pytest.mark.few(40)
@pytest.mark.parametrize("row", PARAMETERS.values(), ids=PARAMETERS)
@pytest.mark.parametrize("kind", ["plain", "lumped", "split"])
def test_the_key_has_every_value_that_is_folded(row, kind, planar, with_options):
    robot = planar if kind == "plain" else dataclasses.replace(with_options(), friction=kind)
    key, array = robot.key(), np.array(getattr(robot, row.name))
    for index in np.ndindex(array.shape):
        changed = array.copy()
        changed[index] += 0.125
        mirrored = (*index[:-2], index[-1], index[-2]) if row.fold == "inertia" else index
        changed[mirrored] = changed[index]
        other = dataclasses.replace(robot, **{row.name: changed})
        free = any(row.is_free(robot, i) and row.is_free(other, i) for i in (index, mirrored))
        assert (other.key() == key) == free, f"{row.name}{index}"
