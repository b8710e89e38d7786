"""No misuse ends the process: each runs in a Python of its own, again and again, and the process goes on.

pythonfmu's wrapper releases a slave twice after an error. Memory that is wrongly freed seldom shows at once, so each
case is repeated, with garbage collections and new instances in between.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

SCRIPT = """
import ctypes, gc, shutil, signal, sys, tempfile
from pathlib import Path
import fmpy
from fmpy.fmi2 import FMU2Slave, fmi2FMUstate

source, case = sys.argv[1:]
description = fmpy.read_model_description(source)
identifier = description.coSimulation.modelIdentifier
references = {v.name: v.valueReference for v in description.modelVariables}
failures = 0


def make(folder=source):
    fmu = FMU2Slave(guid=description.guid, modelIdentifier=identifier, unzipDirectory=folder, instanceName="unit")
    fmu.instantiate(loggingOn=True)
    return fmu


def start(fmu):
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    return fmu


def fails(call, *arguments):
    global failures
    try:
        call(*arguments)
    except Exception as error:
        failures += 1
        return
    raise SystemExit(f"{call} did not fail")


def error(fmu):
    fails(fmu.doStep, 0.0, -1.0)


def error_often(fmu):
    for _ in range(5):
        fails(fmu.doStep, 0.0, -1.0)
        fails(fmu.setReal, [9999], [0.0])


def error_then_go_on(fmu):
    fails(fmu.setReal, [references["mass[1]"]], [0.0])
    for k in range(5):
        fmu.doStep(k * 1e-3, 1e-3)
        fmu.getReal(list(range(8, 12)))
    fmu.terminate()


def error_then_reset(fmu):
    fails(fmu.doStep, 0.0, -1.0)
    fmu.reset()
    start(fmu).doStep(0.0, 1e-3)


def error_reset_error(fmu):
    for _ in range(3):
        fails(fmu.doStep, 0.0, float("nan"))
        fmu.reset()
        fails(fmu.doStep, 0.0, 1e-3)
        fmu.reset()
        start(fmu)


def error_with_states(fmu):
    state = fmu.getFMUstate()
    fails(fmu.doStep, 0.0, -1.0)
    fmu.setFMUstate(state)
    fmu.doStep(0.0, 1e-3)
    fmu.freeFMUstate(state)


def no_state(fmu):
    fails(fmu.setFMUstate, fmi2FMUstate())
    fails(fmu.setFMUstate, None)


def damaged_bytes(fmu):
    for data in (b"", b"{", bytes(range(256))):
        fails(fmu.deSerializeFMUstate, data)
    state = fmu.deSerializeFMUstate(b"[]")
    fails(fmu.setFMUstate, state)


def interrupt(fmu):
    # Ctrl-C at the next line of Python, which is in the slave
    class Interrupting(float):
        def __float__(self):
            return 0.0

    sys.setprofile(lambda frame, event, arg: frame.f_code.co_name == "step" and signal.raise_signal(signal.SIGINT))
    try:
        fails(fmu.doStep, 0.0, 1e-3)
    finally:
        sys.setprofile(None)


def failed_reset(fmu):
    folder = tempfile.mkdtemp()
    shutil.copytree(source, folder, dirs_exist_ok=True)
    other = start(make(folder))
    other.doStep(0.0, 1e-3)
    content = Path(folder, "resources", "vdfmu.json")
    text = content.read_text()
    content.unlink()
    fails(other.reset)
    fails(other.reset)
    gc.collect()
    make().freeInstance()
    content.write_text(text)
    other.reset()
    start(other).doStep(0.0, 1e-3)
    other.freeInstance()
    shutil.rmtree(folder)


def failed_instantiation(fmu):
    folder = tempfile.mkdtemp()
    shutil.copytree(source, folder, dirs_exist_ok=True)
    content = Path(folder, "resources", "vdfmu.json")
    content.write_text(content.read_text().replace('"version": "', '"version": "9.9.'))
    for _ in range(3):
        fails(make, folder)
    shutil.rmtree(folder)


def freed_in_the_middle(fmu):
    fmu.doStep(0.0, 1e-3)


for _ in range(12):
    units = [start(make()) for _ in range(2)]
    globals()[case](units[0])
    gc.collect()
    units[1].doStep(0.0, 1e-3)
    for unit in units:
        unit.freeInstance()
    make().freeInstance()
    gc.collect()
again = start(make())
again.doStep(0.0, 1e-3)
again.terminate()
again.freeInstance()
print("alive", failures)
"""

CASES = {  # name: failing calls in each round
    "error": 1, "error_often": 10, "error_then_go_on": 1, "error_then_reset": 1, "error_reset_error": 6,
    "error_with_states": 1, "no_state": 2, "damaged_bytes": 4, "interrupt": 1, "failed_reset": 2,
    "failed_instantiation": 3, "freed_in_the_middle": 0,
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_process_survives(
    folders: Mapping[str, Mapping[str, Path]], run_python: Callable[..., str], case: str
) -> None:
    said = run_python(SCRIPT, folders["planar_2dof"]["plant"], case, PYTHONMALLOC="debug")
    assert said.splitlines()[-1] == f"alive {12 * CASES[case]}"
