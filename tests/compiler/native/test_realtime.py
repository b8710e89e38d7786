"""A fixed number of internal steps: the same work in each communication step, without allocation or system call."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.compiler.native.binding import Instance
from tests.compiler.native.conftest import GCC, HEADERS, HERE, VERSIONS, program, run
from tests.conftest import heavy
from vdfmu.arm.units.plant import Plant
from vdfmu.base.platforms import this_platform
from vdfmu.compiler.unit.declaration import SOLVERS
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import Integrator

Native = Callable[..., Instance]
H = 2.0**-10  # [s], halved without rounding
X86_LINUX = pytest.mark.skipif(this_platform() != "x86_64-linux", reason="seccomp, and system calls of x86-64 Linux")


def start(native: Native, version: str, kind: str, **options: object) -> Instance:
    return native("plant", version, **options).start(q_0=[0.4, -0.3], solver=SOLVERS.index(kind), tau=[0.2, -0.1])


def test_two_internal_steps_are_two_communication_steps_of_one(native, version):
    once, twice = start(native, version, "fixed_2"), start(native, version, "fixed_1")
    for _ in range(20):
        np.testing.assert_array_equal(once.step(H).outputs(), twice.step(H / 2).step(H / 2).outputs())


def test_native_and_python_units_take_the_same_steps(native, planar):
    """Rounding of 20 steps, 1e-16 of tau_s of 20 N.m each, times the factors of stiff equations, 1e3 at most."""
    unit = start(native, "2.0", "fixed_3")
    evaluated = Traced(Interface(Plant, planar))
    for name, value in {"q_0": [0.4, -0.3], "solver": SOLVERS.index("fixed_3"), "tau": [0.2, -0.1]}.items():
        evaluated.group(name)[:] = value
    evaluated.start()
    solver = Integrator(evaluated)
    for k in range(20):
        solver.advance(k * H, H)
        unit.step(H)
    state = np.concatenate([unit.get(name) for name in ("q", "q_dot", "kappa_dot", "tau_s")])
    np.testing.assert_allclose(state, solver.x, rtol=1e-11, atol=1e-11)


def test_intermediate_updates_may_end_steps_and_states_that_are_not_finite_are_an_error(native, version):
    seen: list[float] = []

    def update(_: Instance, time: float, __: bool, early: bool) -> float | None:
        seen.append(time)
        return 0.6 * H if early and time > 0.4 * H else None

    unit = start(native, "3.0", "fixed_4", update=update, early=True).step(H)
    assert seen == [H / 4, H / 2, 0.6 * H]
    assert (unit.early, unit.time) == (True, 0.6 * H)
    unit = start(native, version, "fixed_2")
    before = unit.set(tau=[1e300, 0.0]).outputs()
    with unit.refuses(
        r"state .* is not finite, and the number of internal steps is fixed, 2\. .* or solver adaptive"
    ) as no:
        no("DoStep", *unit.step_arguments(0.0, H))
    np.testing.assert_array_equal(unit.outputs(), before)
    unit.step(H, tau=[0.2, -0.1])


@pytest.fixture
def stepping(model, tmp_path):
    """Command that steps the plant of an arm with a kind of solver in realtime.c."""
    binary = tmp_path / "realtime"
    run([program("gcc", "gcc"), *GCC, HERE / "realtime.c", "-rdynamic", "-o", binary, "-ldl"])

    def command(kind: str, steps: int, *more: str, robot: str = "manipulator_6dof") -> list[object]:
        fmu = model("plant", "2.0", robot)
        ranges = [
            f"{min(refs)}:{max(refs) + 1}"
            for refs in ([v.reference for v in fmu.of(causality)] for causality in ("input", "output"))
        ]
        solver = f"{fmu.group('solver')[0].reference}:{SOLVERS.index(kind)}"
        return [binary, fmu.library._name, fmu.guid, *ranges, solver, steps, *more]

    return command


@X86_LINUX
@pytest.mark.parametrize("kind", ["adaptive", "fixed_4"])
def test_steps_make_no_allocation_and_no_system_call(stepping, kind):
    """Under seccomp's strict mode the kernel kills a process at the first one but read, write and exit."""
    assert run(stepping(kind, 2000, robot="planar_2dof")) == "done\n"


@X86_LINUX
@pytest.mark.parametrize(("fault", "code"), [("allocate", 1), ("call", -9)])
def test_a_step_with_an_allocation_or_a_system_call_would_be_found(stepping, fault, code):
    command = [str(word) for word in stepping("fixed_1", 1, fault, robot="planar_2dof")]
    assert subprocess.run(command, capture_output=True, timeout=60, check=False).returncode == code


@X86_LINUX
def test_the_library_knows_no_lock(model):
    """Functions that it takes from elsewhere: those of texts and of memory, none of the mathematical library."""
    listed = run([program("nm", "binutils"), "-D", "--undefined-only", model("plant").library._name])
    names = {word.partition("@")[0] for word in re.findall(r" U (\S+)", listed)}
    assert "calloc" in names and names.isdisjoint({"exp", "tanh", "sin", "cos", "sincos", "pow", "log"})
    assert not [name for name in names if re.match(r"(__)?pthread|mtx_|sem_|cnd_|futex|syscall", name)]


@pytest.mark.heavy
@X86_LINUX
def test_each_step_has_the_same_instructions(stepping, tmp_path):
    """Exactly the unit's own; about the same those of glibc's exp and others, with shorter ways for some arguments."""
    plugin, counts = tmp_path / "count.so", tmp_path / "counts"
    run([program("gcc", "gcc"), *GCC, "-shared", "-fPIC", HERE / "count.c", "-o", plugin])
    emulator = [program("qemu-x86_64", "qemu-user"), "-plugin", plugin, "-d", "plugin", "-D", counts]
    for kind in ("fixed_1", "fixed_4"):
        run([*emulator, *stepping(kind, 3000, "count")], seconds=600)
        (_, median, worst, n), unit_counts = (list(map(int, line.split())) for line in counts.read_text().splitlines())
        assert n == 2999
        assert unit_counts[0] == unit_counts[2] > 10_000
        assert worst / median < 1.1  # of 10,000 steps 1.06; one internal step more or less is 1.25


@pytest.mark.parametrize("unit", ["controller", *heavy("plant")])
def test_the_sources_are_c99(model, unit, tmp_path, version):
    sources = model(unit, version).folder / "sources"
    flags = [
        "-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Wconversion", "-Wno-sign-conversion", "-Wshadow",
        "-Wmissing-prototypes", "-Werror", "-DDISABLE_PREFIX", "-fsyntax-only",
    ]  # fmt: skip
    places = [f"-I{HEADERS}", f"-I{sources}"]
    run([program("gcc", "gcc"), *flags, *places, *sorted(sources.glob("*.c"))], cwd=tmp_path)


@pytest.mark.heavy
def test_the_plant_compiles_for_a_microcontroller(model, tmp_path):
    """Newlib's integers of 32 bits are long; FMI 2.0 takes int, so the compiler is told."""
    files: dict[bytes, Path] = {}  # what both versions have is compiled once
    for version in VERSIONS:
        sources = model("plant", version, "manipulator_6dof").folder / "sources"
        files = {path.read_bytes(): path for path in sorted(sources.glob("*.c"))} | files
    compiler = program("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
    board = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16")
    words = ("-U__UINT32_TYPE__", "-D__UINT32_TYPE__=unsigned int", "-U__INT32_TYPE__", "-D__INT32_TYPE__=int")
    flags = ("-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-O2", "-DDISABLE_PREFIX")
    run([compiler, *board, *words, *flags, f"-I{HEADERS}", "-c", *files.values()], cwd=tmp_path, seconds=300)
