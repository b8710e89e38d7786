"""The complete state: saved, restored, serialized and moved, every run continues to the bit."""

import json
from typing import Any

import numpy as np
import pytest

from tests.compiler.conftest import BOTH

H = 1e-3


def torque(k: int, n: int) -> list[float]:
    return [0.05 * np.sin(0.7 * k + i) for i in range(n)]


def drive(unit: Any, name: str, first: int, count: int) -> np.ndarray:
    rows = []
    for k in range(first, first + count):
        inputs = [v for v in unit.description.modelVariables if v.causality == "input"]
        values = [0.3 * np.sin(0.9 * k + 0.1 * i) for i in range(len(inputs))]
        if name == "plant":  # near standstill, where friction is stiff and the solver's step matters
            values = [*torque(k, 2), *([0.0] * 6)]
        if name == "estimator":  # positions that differ by less than the springs give
            values = [1e-3 * value for value in values]
        unit.fmu.setReal([v.valueReference for v in inputs], values)
        rows.append(unit.step(H).outputs())
    return np.array(rows)


@BOTH
def test_a_rollback_repeats_the_run_to_the_bit(open_unit, unit_name):
    unit = open_unit(unit_name).start()
    drive(unit, unit_name, 0, 20)
    state, time, before = unit.fmu.getFMUstate(), unit.time, unit.outputs()
    first = drive(unit, unit_name, 20, 20)
    for _ in range(3):
        unit.fmu.setFMUstate(state)
        unit.time = time
        assert np.array_equal(unit.outputs(), before)
        assert np.array_equal(drive(unit, unit_name, 20, 20), first)
    unit.fmu.freeFMUstate(state)
    assert len(np.unique(first, axis=0)) == 20  # the run is not constant


@BOTH
def test_a_rollback_near_standstill_restores_the_solver_too(open_unit):
    """The step that the solver tries next decides the bits of what follows."""
    unit = open_unit("plant").start(q_0=[0.3, -0.2], q_dot_0=[0.02, -0.01])
    unit.set(tau=unit.get("tau_s") / unit.get("ell"))  # holds the weight, so that friction stops the rotors
    for _ in range(30):
        unit.step(H)
    assert 0.0 < np.abs(unit.get("kappa_dot")).max() < 1e-3  # below eps: the steepest part of tanh(v/eps)
    state, time = unit.fmu.getFMUstate(), unit.time
    x = {f"{name}_0": unit.get(name) for name in ("q", "q_dot", "kappa_dot", "tau_s")}
    first = drive(unit, "plant", 0, 10)
    unit.fmu.setFMUstate(state)
    unit.time = time
    assert np.array_equal(drive(unit, "plant", 0, 10), first)
    # The same physical state under a solver that starts anew differs, within the tolerance of 1e-7 a step.
    fresh = drive(open_unit("plant").start(time, equilibrium=False, **x), "plant", 0, 10)
    assert not np.array_equal(fresh, first)
    assert np.abs(fresh - first)[:, :4].max() < 1e-5  # q, q_dot; 10 communication steps of some internal ones


@BOTH
def test_a_state_is_a_copy_with_inputs_and_parameters(open_unit):
    unit = open_unit("plant").start()
    state = unit.fmu.getFMUstate()
    before = unit.outputs()
    drive(unit, "plant", 0, 5)
    later = unit.fmu.getFMUstate()
    unit.fmu.setFMUstate(state)
    assert np.array_equal(unit.outputs(), before)
    unit.fmu.setFMUstate(later)
    assert not np.array_equal(unit.outputs(), before)
    unit = open_unit("controller").start(K_p=500.0, q_d=0.1)
    state = unit.fmu.getFMUstate()
    before = unit.step(H).outputs()
    unit.step(H, K_p=900.0, q_d=0.2, q=0.05)
    unit.fmu.setFMUstate(state)
    unit.time = 0.0
    assert np.array_equal(unit.get("K_p"), [500.0, 500.0])
    assert np.array_equal(unit.get("q_d"), [0.1, 0.1])
    assert np.array_equal(unit.get("q"), [0.0, 0.0])
    assert np.array_equal(unit.step(H).outputs(), before)


@BOTH
def test_a_state_saves_the_phase(open_unit):
    """Saved before the initialization, restored after it: fixed parameters can be set again."""
    unit = open_unit("plant").setup(2.0)
    early = unit.fmu.getFMUstate()
    unit.fmu.enterInitializationMode()
    unit.fmu.exitInitializationMode()
    unit.step(H)
    unit.fmu.setFMUstate(early)
    unit.set(q_0=[0.5, 0.0])
    unit.fmu.enterInitializationMode()
    middle = unit.fmu.getFMUstate()
    assert np.array_equal(unit.get("q"), [0.5, 0.0])
    unit.set(q_0=[0.7, 0.0])
    unit.fmu.exitInitializationMode()
    unit.fmu.setFMUstate(middle)
    assert np.array_equal(unit.get("q"), [0.5, 0.0])
    unit.fmu.exitInitializationMode()
    unit.time = 2.0
    unit.step(H)


def test_a_state_saves_the_tolerance_of_the_experiment_and_moves_to_another_instance(open_unit, unit_name):
    fine, coarse = (open_unit("plant").start(tolerance=t, q_0=[0.3, 0.0]) for t in (1e-10, 1e-3))
    fine_run = drive(fine, "plant", 0, 5)
    assert not np.array_equal(drive(coarse, "plant", 0, 5), fine_run)
    start = open_unit("plant").start(tolerance=1e-10, q_0=[0.3, 0.0])
    coarse.fmu.setFMUstate(start.fmu.getFMUstate())
    coarse.time = 0.0
    assert np.array_equal(drive(coarse, "plant", 0, 5), fine_run)
    unit, other = open_unit(unit_name).start(), open_unit(unit_name, instance="other")
    drive(unit, unit_name, 0, 10)
    state = unit.fmu.getFMUstate()
    other.fmu.setFMUstate(state)
    other.time = unit.time
    assert np.array_equal(other.outputs(), unit.outputs())
    assert np.array_equal(drive(other, unit_name, 10, 10), drive(unit, unit_name, 10, 10))


@BOTH
def test_serialization_keeps_every_bit(open_unit, unit_name):
    unit, other = open_unit(unit_name).start(), open_unit(unit_name, instance="other")
    drive(unit, unit_name, 0, 10)
    saved = unit.fmu.serializeFMUstate(unit.fmu.getFMUstate())
    other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(saved))
    other.time = unit.time
    assert other.fmu.serializeFMUstate(other.fmu.getFMUstate()) == saved
    assert np.array_equal(drive(other, unit_name, 10, 10), drive(unit, unit_name, 10, 10))


CONTINUE = """
import sys
from pathlib import Path
import fmpy
from fmpy.fmi2 import FMU2Slave
folder, saved, time, steps = sys.argv[1], Path(sys.argv[2]).read_bytes(), float(sys.argv[3]), int(sys.argv[4])
description = fmpy.read_model_description(folder)
fmu = FMU2Slave(guid=description.guid, modelIdentifier="Plant", unzipDirectory=folder, instanceName="moved")
fmu.instantiate(loggingOn=True)
fmu.setFMUstate(fmu.deSerializeFMUstate(saved))
outputs = [v.valueReference for v in description.modelVariables if v.causality == "output"]
for k in range(steps):
    fmu.doStep(time, 1e-3)
    time += 1e-3
    print(*(value.hex() for value in fmu.getReal(outputs)))
"""


@pytest.mark.heavy
def test_a_state_moves_to_another_process(open_unit, folders, tmp_path, run_python):
    unit = open_unit("plant").start(q_0=[0.3, -0.2])
    drive(unit, "plant", 0, 10)
    saved = tmp_path / "state"
    saved.write_bytes(unit.fmu.serializeFMUstate(unit.fmu.getFMUstate()))
    text = run_python(CONTINUE, folders["planar_2dof"]["plant"], saved, repr(unit.time), 10)
    there = [[float.fromhex(word) for word in line.split()] for line in text.splitlines()]
    here = [unit.step(H).outputs() for _ in range(10)]
    assert np.array_equal(there, here)


def test_a_state_of_another_unit_or_robot_is_refused(open_unit):
    plant, controller = open_unit("plant").start(), open_unit("controller").start()
    before = plant.outputs()
    with plant.refuses(r"unit: setFMUstate.* expected a state of Plant with GUID \{.*got one with GUID \{"):
        plant.fmu.setFMUstate(controller.fmu.getFMUstate())
    assert np.array_equal(plant.outputs(), before)
    unit, other = open_unit("plant").start(), open_unit("plant", "slider_3dof").start()
    with unit.refuses(r"expected a state of Plant with GUID"):
        unit.fmu.setFMUstate(other.fmu.getFMUstate())


@pytest.mark.parametrize(("change", "words"), [
    (lambda state: state | {"memory": state["memory"][:-1]}, r"the state is damaged: ValueError: .*reshape"),
    (lambda state: {"guid": state["guid"]}, r"the state is damaged: KeyError: 'phase'"),
    (lambda state: [1, 2, 3], r"expected a state of Plant with GUID .*, got something else"),
    (lambda state: state | {"guid": 3}, r"expected a state of Plant .*, got one with GUID 3"),
    (lambda state: state | {"phase": "ended"}, r"the state is damaged: KeyError"),
    (lambda state: state | {"solver": {}}, r"the state is damaged: KeyError: 'h'"),
])  # fmt: skip
def test_a_damaged_state_is_refused_and_changes_nothing(open_unit, change, words):
    unit = open_unit("plant").start(q_0=[0.3, -0.2])
    unit.step(H)
    saved = unit.fmu.serializeFMUstate(unit.fmu.getFMUstate())
    damaged = json.dumps(change(json.loads(saved))).encode()
    state = unit.fmu.deSerializeFMUstate(damaged)
    with unit.refuses(words):
        unit.fmu.setFMUstate(state)
    assert unit.fmu.serializeFMUstate(unit.fmu.getFMUstate()) == saved


@pytest.mark.parametrize("data", [b"", b"abc", b"{", b"\xff\xfe\x00", b"\x00" * 100])
def test_bytes_that_are_no_state_are_refused(open_unit, data):
    unit = open_unit("plant").start()
    with unit.refuses(rf"deSerializeFMUstate failed: expected the bytes of a state, got {len(data)} other bytes"):
        unit.fmu.deSerializeFMUstate(data)


def test_reset_returns_to_the_start_values(open_unit, unit_name):
    unit = open_unit(unit_name)
    references = [
        v.valueReference for v in unit.description.modelVariables if v.type == "Real" and v.causality != "output"
    ]
    before = unit.fmu.getReal(references)
    first = drive(unit.start(), unit_name, 0, 10)
    if unit_name in ("controller", "feedforward"):
        unit.set(**{"K_p" if unit_name == "controller" else "Lambda": 3.0})
    unit.fmu.reset()
    assert unit.fmu.getReal(references) == before
    assert np.array_equal(drive(unit.start(), unit_name, 0, 10), first)
    unit.fmu.terminate()
    unit.fmu.reset()
    assert np.array_equal(drive(unit.start(), unit_name, 0, 10), first)


@BOTH
def test_reset_forgets_parameters_that_were_set(open_unit):
    unit = open_unit("plant")
    nominal = drive(unit.start(), "plant", 0, 10)
    unit.fmu.reset()
    heavy = drive(unit.start(mass=[5.0, 4.0]), "plant", 0, 10)
    assert not np.array_equal(heavy, nominal)
    unit.fmu.reset()
    assert np.array_equal(drive(unit.start(), "plant", 0, 10), nominal)
