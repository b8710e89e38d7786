"""Generated rigid-body dynamics against Pinocchio, both in loops of compiled code."""

from __future__ import annotations

import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.chains import random_motion, repeated_link
from benchmarks.compiled import write_library
from benchmarks.report import COLOURS, Report, Table, machine, new_figure, tidy
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.errors import FmuError
from vdfmu.compiler.c.compile import compiler_version, native_available
from vdfmu.compiler.functions.cache import cache_folder, load, store

TITLE = "Generated rigid-body dynamics against Pinocchio, from loops of compiled code"
ALGORITHMS = {"inverse_dynamics": ("rnea",), "forward_dynamics": ("aba_local", "aba_world")}
"""Generated function to Pinocchio's, of which the faster counts."""

PROCESSORS = ("x86-64-v2", "native")
"""Of -march: that of the FMUs, and what this machine has."""

_SOURCE = Path(__file__).with_suffix(".cpp")
_STATES = 64
# the definitions with which Pinocchio's own build configures Boost
_FLAGS = (
    "-std=c++17", "-O3", "-DNDEBUG", "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """Processor times of one call [s]: medians of the rounds of each process, in which all functions take turns.

    Attributes
    ----------
    ours : list of float
    theirs : dict of function of Pinocchio to list of float
    difference : float
        Largest relative difference of the results.
    """

    robot: str
    n: int
    processor: str
    algorithm: str
    ours: list[float]
    theirs: dict[str, list[float]]
    difference: float

    @property
    def fastest(self) -> str:
        """Fastest function of Pinocchio."""
        return min(self.theirs, key=lambda name: statistics.median(self.theirs[name]))

    @property
    def times(self) -> tuple[float, float]:
        """Our time and that of the fastest, each the median over the processes [s]."""
        return statistics.median(self.ours), statistics.median(self.theirs[self.fastest])

    @property
    def ratio(self) -> float:
        """Our time over that of the fastest."""
        return self.times[0] / self.times[1]


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    lacking = missing()
    if lacking:
        report.say(f"skipped: {lacking}")
        report.facts["skipped"] = lacking
        return
    robots = [load_robot("manipulator_6dof"), repeated_link(6)]
    processors = PROCESSORS[:1] if quick else PROCESSORS
    found = list(
        compare(robots, processors, processes=2 if quick else 5, rounds=21, calls=2000, say=report.say)
    )
    tabulate(found, report)
    report.save(draw(found))


def missing() -> str:
    """Say what this benchmark needs and does not find; empty if nothing."""
    if shutil.which("g++") is None:
        return "g++ is not installed"
    if platform.machine() != "x86_64" or sys.platform != "linux":
        return "it compiles for x86-64 Linux only"
    if not native_available():
        return "the compiler of native FMUs is not installed (pip install .[native])"
    headers = _headers()
    for name, header in (("pin", "pinocchio/config.hpp"), ("cmeel-eigen", "eigen3/Eigen/Core")):
        if headers is None or not (headers / header).is_file():
            return f"the headers of {name} are not installed (pip install .[bench])"
    return ""


def _headers() -> Path | None:
    """Folder of the headers that the packages of Pinocchio, Boost and Eigen install."""
    spec = find_spec("pinocchio")
    if spec is None or spec.origin is None:
        return None
    for folder in Path(spec.origin).parents:
        if folder.name == "cmeel.prefix":
            return folder / "include"
        if (folder / "cmeel.prefix").is_dir():
            return folder / "cmeel.prefix" / "include"
    return None


def compare(
    robots: Sequence[Robot],
    processors: Sequence[str],
    *,
    processes: int,
    rounds: int,
    calls: int,
    say: Callable[[str], None],
    compiler: str = "g++",
    flags: Sequence[str] = (),
) -> Iterator[Comparison]:
    """Time inverse and forward dynamics of both on the same random states, all in turns.

    Parameters
    ----------
    processors : sequence of str
        Values of ``-march``, for which both are compiled.
    processes : int
        How often the program is run.
    rounds : int
        Samples in each process.
    calls : int
        In one sample.
    compiler : str, optional
        Of Pinocchio.
    flags : sequence of str, optional
        Its further flags.
    """
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        for processor in processors:
            program = folder / f"c_loops_{processor}"
            program.write_bytes(_program(compiler, processor, flags, say))
            program.chmod(0o755)
            for robot in robots:
                # code for this very processor must not be taken from a cache that another one filled
                native = ("-march=native", f"-DPROCESSOR={_digest(machine()['processor'])[:8]}")
                kernel = Kernel(robot)
                library = write_library(
                    kernel, tuple(ALGORITHMS), folder, native if processor == "native" else ()
                )
                say(f"{robot.name}, {processor}: {processes} processes")
                text = _input(robot, kernel)
                seen = [_run(program, library, rounds, calls, text) for _ in range(processes)]
                for algorithm, others in ALGORITHMS.items():
                    difference = max(rows[name][0] for rows in seen for name in others)
                    ours, *theirs = (
                        [statistics.median(rows[name][1:]) for rows in seen] for name in (algorithm, *others)
                    )
                    pairs = dict(zip(others, theirs, strict=True))
                    yield Comparison(robot.name, robot.n, processor, algorithm, ours, pairs, difference)


def _run(program: Path, library: Path, rounds: int, calls: int, text: str) -> dict[str, list[float]]:
    """Return of each function the difference of its results and the times of its rounds."""
    command = [program, library, str(rounds), str(calls)]
    done = subprocess.run(command, input=text, text=True, capture_output=True, check=False)
    if done.returncode != 0:
        raise FmuError(f"the program of the benchmark failed: {done.stderr.strip()}")
    return {name: [float(v) for v in values] for name, *values in map(str.split, done.stdout.splitlines())}


def _program(compiler: str, processor: str, flags: Sequence[str], say: Callable[[str], None]) -> bytes:
    """Compiled program with Pinocchio inside; kept, as its compilation takes minutes."""
    headers = _headers()
    version = subprocess.run([compiler, "--version"], capture_output=True, check=True).stdout
    options = [*_FLAGS, f"-march={processor}", *flags]
    pinocchio, own = (headers or Path()) / "pinocchio" / "config.hpp", _SOURCE.read_bytes()
    key = _digest(version, options, pinocchio.read_bytes(), own, machine()["processor"])
    program = load(cache_folder() / "bench" / key)
    if program is not None:
        return program
    say(f"compiling Pinocchio for {processor}, which takes a minute or two")
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        path = Path(folder) / "program"
        command: list[Any] = [compiler, *options, "-isystem", headers, "-isystem", f"{headers}/eigen3"]
        done = subprocess.run(
            [*command, _SOURCE, "-o", path, "-ldl"], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise FmuError(f"{_SOURCE.name} cannot be compiled:\n{done.stderr[:2000]}")
        program = path.read_bytes()
    store(cache_folder() / "bench" / key, program)
    return program


def _digest(*values: Any) -> str:
    return sha256(repr(values).encode()).hexdigest()


def _input(robot: Robot, kernel: Kernel) -> str:
    """Numbers that the program reads: model, parameters and states."""
    arrays: list[Iterable[float]] = [[robot.n], robot.gravity]
    for i in range(robot.n):
        arrays.append([float(robot.joint_types[i] == "prismatic")])
        arrays += [
            np.ravel(getattr(robot, name)[i])
            for name in ("rotation", "offset", "mass", "centroid", "inertia")
        ]
    arrays += [[len(kernel.p)], kernel.p, [_STATES]]
    for seed in range(_STATES):
        arrays += random_motion(robot.n, seed)
    return "\n".join(" ".join(repr(float(v)) for v in array) for array in arrays)


def tabulate(found: Sequence[Comparison], report: Report) -> None:
    """Show and keep the table and facts."""
    us = 1e6
    table = Table(
        "c_loops",
        "Rigid-body dynamics in loops of compiled code, one call [us]",
        [("robot", ""), ("n", "d"), ("-march", ""), ("algorithm", ""), ("generated", ".3f"), ("Pinocchio", ".3f"),
         ("its function", ""), ("ratio", ".3f"), ("difference", ".0e")],
    )  # fmt: skip
    for c in found:
        ours, theirs = c.times
        table.add(
            c.robot, c.n, c.processor, c.algorithm, us * ours, us * theirs, c.fastest, c.ratio, c.difference
        )  # fmt: skip
    table.notes += [
        f"Processor times: medians over {len(found[0].ours)} processes of the medians of their rounds, in which all "
        f"functions take turns, over {_STATES} random states.",
        f"Generated: {compiler_version()} with the flags of the FMUs, called through a pointer. Pinocchio: g++ -O3 "
        "-DNDEBUG, its templates compiled in the program for the same -march.",
        "aba_local, aba_world: aba in either convention; the faster one is compared. "
        "Difference of the results: largest, relative to the largest entry.",
    ]
    report.show(table)
    report.facts["comparisons"] = [
        {
            "robot": c.robot, "n": c.n, "processor": c.processor, "algorithm": c.algorithm,
            "generated_us": us * statistics.median(c.ours),
            "pinocchio_us": {name: us * statistics.median(times) for name, times in c.theirs.items()},
            "ratio": c.ratio, "difference": c.difference,
        }
        for c in found
    ]  # fmt: skip


def draw(found: Sequence[Comparison]) -> Figure:
    """Bars: both times of every robot, algorithm and processor."""
    figure = new_figure(7.6, 0.9 + 0.55 * len(found))
    axes = figure.add_subplot()
    for i, c in enumerate(found):
        pairs = (
            ("generated", c.ours, COLOURS["blue"]),
            ("Pinocchio", c.theirs[c.fastest], COLOURS["orange"]),
        )
        for k, (label, times, colour) in enumerate(pairs):
            value, y = 1e6 * statistics.median(times), i + 0.34 * (k - 0.5)
            axes.barh(y, value, height=0.3, color=colour, label=label if i == 0 else None)
            text = f"{value:.2f}" + (f", {c.ratio:.0%} of Pinocchio's" if k == 0 else "")
            axes.annotate(text, (value, y), (3, 0), textcoords="offset points", va="center", fontsize=7.5)
    names = {"inverse_dynamics": "inverse", "forward_dynamics": "forward"}
    axes.set_yticks(
        range(len(found)), [f"{c.robot}\n{names[c.algorithm]}, {c.processor}" for c in found], fontsize=8
    )
    axes.invert_yaxis()
    axes.margins(x=0.08)
    axes.set_xlabel("time of one call in compiled code [µs]")
    tidy(axes, "x")
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    axes.set_title("inverse and forward dynamics, 6 joints", loc="left")
    return figure
