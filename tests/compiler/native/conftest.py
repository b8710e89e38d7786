"""The native FMUs of the shipped robots, as C calls and as a user of fmpy has them."""

import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.compiler.native.binding import Model
from tests.compiler.native.fmi_types import HEADERS

HERE = Path(__file__).parent
VERSIONS = ("2.0", "3.0")


@pytest.fixture(scope="session")
def native_fmu(built):
    """Return the FMU of a unit: ``native_fmu(unit, version, robot)``."""
    return lambda unit, version="2.0", robot="planar_2dof": built("native", robot, version)[unit]


def program(name: str, package: str, *places: str) -> str:
    for place in (name, *places):
        path = shutil.which(place)
        if path:
            return path
    pytest.skip(f"needs {name}: apt install {package}")


def run(command: list[Any], *, seconds: float = 120.0, cwd: Path | None = None, **environment: str) -> str:
    done = subprocess.run(
        [str(word) for word in command],
        capture_output=True, text=True, timeout=seconds, cwd=cwd, env=os.environ | environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout[-4000:]}\n{done.stderr[-8000:]}"
    return done.stdout


def driver_arguments(model: Model) -> list[str]:
    """Arguments of driver.c after the library."""

    def listed(*causalities: str) -> str:
        return ",".join(f"{v.reference}:{len(v.names)}" for v in model.of(*causalities))

    fixed = next(v for v in model.of("parameter") if v.variability == "fixed" and len(v.names) == 1)
    states = [str(model.n_states)] if model.n_states else []
    return [model.guid, listed("input"), listed("output"), str(fixed.reference), *states]


def bits(text: str) -> dict[str, list[bytes]]:
    """Rows that driver.c prints, by their first word; each number as 8 bytes."""
    lines = [line.split() for line in text.splitlines()]
    assert lines[-1] == ["done"]
    rows: dict[str, list[bytes]] = {}
    for name, *words in lines[:-1]:
        rows.setdefault(name, []).append(b"".join(int(word, 16).to_bytes(8, "little") for word in words))
    return rows


@pytest.fixture(scope="session")
def sanitized(model, tmp_path_factory):
    """Objects of the sources of a unit, compiled by gcc with its sanitizers, to link with a program."""

    @cache
    def make(unit: str, version: str = "2.0") -> list[Path]:
        return sanitized_objects(model(unit, version).folder / "sources", tmp_path_factory.mktemp("sanitized"))

    return make


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    """Compile driver.c for this machine with the system's compiler; it loads the library that it is given."""

    @cache
    def make(version: str) -> Path:
        path = tmp_path_factory.mktemp("driver") / f"driver{version[0]}"
        run([program("gcc", "gcc"), *GCC, *version_flags(version), HERE / "driver.c", "-o", path, "-ldl", "-lm"])
        return path

    return make


def sanitized_objects(sources: Path, out: Path) -> list[Path]:
    flags = (*GCC, *SANITIZERS, "-DDISABLE_PREFIX", "-ffp-contract=off", f"-I{sources}")
    run([program("gcc", "gcc"), *flags, "-c", *sorted(sources.glob("*.c"))], seconds=300, cwd=out)
    return sorted(out.glob("*.o"))


def fuzz_program(sources: Path, objects: list[Path], version: str, target: Path) -> Path:
    """Compile fuzz.c for a unit and link it with the objects of the unit; ``fuzz CALLS SEED``."""
    run([program("gcc", "gcc"), *GCC, *SANITIZERS, *version_flags(version), "-DMAIN", f"-I{sources}",
         HERE / "fuzz.c", *objects, "-o", target, "-lm"])  # fmt: skip
    return target


SANITIZERS = (
    "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer",
)  # fmt: skip
GCC = ("-std=c11", "-O1", "-g", "-Wall", "-Wextra", "-Werror", f"-I{HEADERS}")


def version_flags(version: str) -> list[str]:
    """Return flags that choose the version of FMI in driver.c and fuzz.c."""
    return ["-DFMI3"] if version == "3.0" else []
