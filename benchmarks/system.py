"""The system of a scenario, packed and run for a benchmark."""

from __future__ import annotations

import logging
import tempfile
import zipfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from vdfmu.base.compile import compile_library
from vdfmu.base.files import pack_zip
from vdfmu.base.platforms import this_platform
from vdfmu.engine.package.system import Component, FlatSystem
from vdfmu.engine.run import LogMessage, Results, simulate
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import Scenario


@contextmanager
def packed(scenario: Scenario, backend: str = "python") -> Generator[Path]:
    """Build the FMUs and the package of a scenario in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        fmus = build_parts(scenario, Path(folder) / "fmus", backend=backend)
        yield write_ssp(scenario, fmus, Path(folder) / f"{scenario.name}.ssp")


def write_emptied(package: Path, path: Path) -> Path:
    """Copy an FMU, or a package of FMUs, with libraries that do nothing: the remaining time is that of the master."""
    members = _members(package)
    if package.suffix == ".fmu":
        source = Path(__file__).with_name("empty_unit.c").read_bytes()
        library = compile_library(
            {"empty_unit.c": source}, this_platform(), name="empty", flags=("-fvisibility=default",)
        )
        members |= {name: library for name in members if name.startswith("binaries/")}
    for name in members:
        if name.endswith(".fmu") and package.suffix == ".ssp":
            with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
                full, hollow = Path(folder) / "full.fmu", Path(folder) / "hollow.fmu"
                full.write_bytes(members[name])
                members[name] = write_emptied(full, hollow).read_bytes()
    pack_zip(path, members)
    return path


def _members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def quiet(message: LogMessage) -> None:
    """Drop the messages of the units other than errors."""
    if message.status in ("error", "fatal"):
        logging.getLogger("benchmarks").error("%s", message)


quiet_run = partial(simulate, start=0.0, log=quiet)
"""Run a package, see :func:`vdfmu.engine.run.simulate`; messages of the units other than errors are dropped."""


def container_run(
    container: Path, *, step: float, stop: float, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Run a container FMU as the only component of a system; its signals have the names of its units'."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        package, member = Path(folder) / "container.ssp", f"resources/{container.name}"
        pack_zip(package, {member: container.read_bytes()})
        only = Component("container", member, "CoSimulation", {})
        results = quiet_run(
            FlatSystem(package, "container", (only,), (), {}), stop=stop, step=step, algorithm="jacobi",
            progress=progress, isolate=False,
        )  # fmt: skip
    return results.renamed(lambda name: name.removeprefix("container."))
