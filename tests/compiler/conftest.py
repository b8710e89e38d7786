"""The FMUs of the shipped robots, and a unit as a user of plain fmpy has it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

from tests.conftest import TYPICAL, heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import shipped_units

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None


BOTH = pytest.mark.parametrize("backend", ["python", "native"])
"""A native unit computes, saves, refuses and says what the Python unit does: the same tests, the same words."""


class Lazy(dict[str, Any]):
    """A mapping that makes its values when they are first asked for."""

    def __init__(self, make: Callable[[str], Any]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, key: str) -> Any:
        self[key] = self._make(key)
        return self[key]


class Unit:
    """One instance of an FMU, driven through fmpy, with the messages that its user sees.

    A name without index stands for the whole group, in the order of the value references.
    """

    def __init__(self, folder: Path, instance: str = "unit", messages: list[str] | None = None) -> None:
        self.description = fmpy.read_model_description(folder, validate=False)
        self.messages: list[str] = [] if messages is None else messages
        self.statuses: list[int] = []
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(self._receive)
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu = FMU2Slave(
            guid=self.description.guid, modelIdentifier=self.description.coSimulation.modelIdentifier,
            unzipDirectory=str(folder), instanceName=instance,
        )  # fmt: skip
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)
        self.time = 0.0

    def _receive(self, _: Any, instance: bytes, status: int, category: bytes, text: bytes) -> None:
        self.statuses.append(status)
        self.messages.append(text.decode())

    def variables(self, name: str) -> list[Any]:
        """Variables of a name, or of a group."""
        members = [v for v in self.description.modelVariables if name in (v.name, v.name.split("[")[0])]
        assert members, name
        return members

    def references(self, name: str) -> list[int]:
        """Value references of a name, or of a group."""
        return [v.valueReference for v in self.variables(name)]

    def set(self, **values: Any) -> Unit:
        """Set groups: ``set(q_0=[0.1, 0.2], equilibrium=False)``; use :meth:`set_one` for ``mass[1]``."""
        for name, value in values.items():
            self.set_one(name, value)
        return self

    def set_one(self, name: str, value: Any) -> Unit:
        """Set a variable or group of a name that is no Python name."""
        variables = self.variables(name)
        array = np.broadcast_to(value, len(variables)).tolist()
        call = getattr(self.fmu, "set" + variables[0].type)
        call([v.valueReference for v in variables], array)
        return self

    def get(self, name: str) -> np.ndarray:
        """Values of a variable or group."""
        variables = self.variables(name)
        call = getattr(self.fmu, "get" + variables[0].type)
        return np.array(call([v.valueReference for v in variables]))

    def outputs(self) -> np.ndarray:
        """All outputs in order."""
        return np.array(
            self.fmu.getReal([v.valueReference for v in self.description.modelVariables if v.causality == "output"])
        )

    def start(self, time: float = 0.0, tolerance: float | None = None, **values: Any) -> Unit:
        """Set values and take the unit through initialization."""
        self.setup(time, tolerance)
        self.set(**values)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def setup(self, time: float = 0.0, tolerance: float | None = None) -> Unit:
        """Set up the experiment."""
        self.time = time
        self.fmu.setupExperiment(tolerance=tolerance, startTime=time)
        return self

    def step(self, size: float = 1e-3, **inputs: Any) -> Unit:
        """Set inputs and make a step from where the last one ended."""
        self.set(**inputs)
        self.fmu.doStep(self.time, size)
        self.time += size
        return self

    @contextmanager
    def refuses(self, words: str) -> Iterator[None]:
        """Expect that a call fails and that the last message matches `words`."""
        with pytest.raises(FMICallException):
            yield
        assert re.search(words, self.messages[-1]), self.messages[-1]


@pytest.fixture(scope="session")
def robots():
    return {name: load_robot(name) for name in TYPICAL}


@pytest.fixture(scope="session")
def planar(robots):
    return robots["planar_2dof"]


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Let one process of the test session build at a time: the next finds what it needs in the cache."""
    with (folder / "build.lock").open("w") as file:
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def built(robots, tmp_path_factory, kernel_cache):
    """Return ``built(backend, robot, version)``: the FMUs of a robot by unit, built when they are first asked for."""

    @cache
    def build(backend: str, robot: str, version: str = "2.0") -> dict[str, Path]:
        with alone(kernel_cache):
            return build_fmus(
                robots[robot], tmp_path_factory.mktemp(robot), backend=backend, fmi_version=version, folded=True
            )

    return build


@pytest.fixture(scope="session")
def unpacked(built, tmp_path_factory):
    """Return ``unpacked(backend, robot, unit)``: the folder of an FMU of FMI 2.0."""

    @cache
    def unpack(backend: str, robot: str, unit: str) -> Path:
        return Path(fmpy.extract(built(backend, robot)[unit], tmp_path_factory.mktemp(f"{robot}_{unit}")))

    return unpack


@pytest.fixture
def backend():
    """Return the kind of the FMUs: Python ones, except where a test is marked with `BOTH`."""
    return "python"


@pytest.fixture
def fmus(built, backend):
    return Lazy(lambda robot: built(backend, robot))


@pytest.fixture
def folders(unpacked, backend):
    return Lazy(lambda robot: Lazy(lambda unit: unpacked(backend, robot, unit)))


@pytest.fixture
def open_unit(folders):
    """Instantiate a unit, of the planar robot if none is named; freed at the end of the test."""
    opened: list[Unit] = []

    def open_one(unit: str, robot: str = "planar_2dof", instance: str = "unit") -> Unit:
        opened.append(Unit(folders[robot][unit], instance))
        return opened[-1]

    yield open_one
    for unit in opened:
        unit.fmu.freeInstance()


@pytest.fixture
def words_of_refusal():
    """Instantiate a unit from a folder, which must fail, and return what its user reads."""

    def instantiate(folder: Path) -> str:
        messages: list[str] = []
        with pytest.raises(Exception, match="Failed to instantiate model"):
            Unit(folder, messages=messages)
        return messages[-1]

    return instantiate


@pytest.fixture
def copy_of(folders, tmp_path):
    def copy(unit: str) -> Path:
        return Path(shutil.copytree(folders["planar_2dof"][unit], tmp_path / unit))

    return copy


@pytest.fixture
def run_python():
    def run(script: str, *arguments: Any, cwd: Path | None = None, **environment: str) -> str:
        words = [sys.executable, "-X", "faulthandler", "-c", script, *map(str, arguments)]
        env = {**os.environ, **environment}
        done = subprocess.run(words, capture_output=True, text=True, cwd=cwd, env=env, timeout=120)
        assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    return run


@pytest.fixture(params=shipped_units())
def unit_name(request):
    return request.param


@pytest.fixture(params=[*heavy(*TYPICAL[:1]), *TYPICAL[1:]])
def robot_name(request):
    return request.param
