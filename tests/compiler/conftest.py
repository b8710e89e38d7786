"""The FMUs of the shipped robots, and a unit as a user of plain fmpy has it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import pytest

from tests.compiler.native.binding import Instance, Model
from tests.conftest import TYPICAL, alone, heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.interface import Interface

EACH = pytest.mark.parametrize("version", ["2.0", "3.0", "python"])
"""Each form of a unit computes, saves, refuses and says the same: the same tests, the same words."""


class Lazy(dict[str, Any]):
    """A mapping that makes its values when they are first asked for."""

    def __init__(self, make: Callable[[str], Any]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, key: str) -> Any:
        self[key] = self._make(key)
        return self[key]


@pytest.fixture(scope="session")
def robots():
    return {name: load_robot(name) for name in TYPICAL}


@pytest.fixture(scope="session")
def planar(robots):
    return robots["planar_2dof"]


@pytest.fixture
def interface(robots, robot_name, unit_name):
    return Interface(shipped_units()[unit_name], robots[robot_name])


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


@pytest.fixture(scope="session")
def fmus(built):
    """Return the Python FMUs by robot and unit."""
    return Lazy(lambda robot: built("python", robot))


@pytest.fixture(scope="session")
def folders(unpacked):
    """Return their folders."""
    return Lazy(lambda robot: Lazy(lambda unit: unpacked("python", robot, unit)))


@pytest.fixture(scope="session")
def model(built, unpacked, tmp_path_factory):
    """Return ``model(unit, version, robot)``; the version "python" is the Python FMU of FMI 2.0."""

    @cache
    def unpack(unit: str, version: str = "2.0", robot: str = "planar_2dof") -> Model:
        if version == "3.0":
            return Model(Path(fmpy.extract(built("native", robot, version)[unit], tmp_path_factory.mktemp(unit))))
        return Model(unpacked("native" if version == "2.0" else version, robot, unit))

    return unpack


@pytest.fixture
def native(model):
    """Instantiate ``native(unit, version, robot, **options of Instance)``; freed at the end of the test."""
    opened: list[Instance] = []

    def instantiate(unit: str = "plant", version: str = "2.0", robot: str = "planar_2dof", **options: Any) -> Instance:
        opened.append(Instance(model(unit, version, robot), **options))
        assert opened[-1].pointer, opened[-1].messages
        return opened[-1]

    yield instantiate
    for instance in opened:
        instance.free()


@pytest.fixture(params=["2.0", "3.0"])
def version(request):
    return request.param


@pytest.fixture
def open_unit(native, version):
    """Instantiate a unit of the version of the test, of the planar robot if none is named."""
    return lambda unit, robot="planar_2dof", **options: native(unit, version, robot, **options)


@pytest.fixture
def words_of_refusal():
    """Instantiate a unit from a folder, which must fail, and return what its user reads."""

    def instantiate(folder: Path) -> str:
        instance = Instance(Model(folder))
        assert instance.pointer is None
        return instance.messages[-1].text

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


@pytest.fixture(params=["planar_2dof", *heavy("manipulator_6dof", "slider_3dof")])
def robot_name(request):
    return request.param
