"""The copy of the solver's step for processors with AVX2: the same bits, and only where the processor has it."""

from ctypes import byref, c_double, c_int, c_uint64, c_void_p, cast
from pathlib import Path

import numpy as np
import pytest

from tests.compiler.native.binding import Model
from tests.compiler.native.conftest import bits, driver_arguments, program, run
from vdfmu.base.compile import SHOWN, compile_library, loaded
from vdfmu.base.files import data_path
from vdfmu.base.platforms import PLATFORMS, this_platform
from vdfmu.compiler.fmu.native import fmi_headers

BROKEN = b"""#include "processor.h"
void plant_step_avx2(void);
void plant_step_avx2(void) { __builtin_trap(); }
"""


def library(model: Model, folder: Path, *flags: str, **replaced: bytes) -> Path:
    sources = {file.name: file.read_bytes() for file in (model.folder / "sources").glob("*.[ch]")}
    sources |= {f"{name}.c": text for name, text in replaced.items()}
    path = folder / f"{model.name}{PLATFORMS[this_platform()].suffix}"
    path.write_bytes(
        compile_library(sources | fmi_headers(model.version), this_platform(), name=model.name, flags=flags)
    )
    return path


@pytest.mark.heavy
@pytest.mark.skipif(not this_platform().startswith("x86_64"), reason="the copy is for x86-64")
def test_the_copy_for_avx2_gives_the_same_bits(model, driver, tmp_path):
    fmu = model("plant", "2.0", "manipulator_6dof")
    arguments = driver_arguments(fmu)
    shipped = run([driver("2.0"), fmu.library._name, *arguments])
    plain = library(fmu, tmp_path, "-DPLAIN_STEP")
    assert plain.read_bytes() != Path(fmu.library._name).read_bytes()
    assert bits(run([driver("2.0"), plain, *arguments])) == bits(shipped)
    states = np.frombuffer(b"".join(bits(shipped)["step"]), dtype="<f8")
    assert np.isfinite(states).all()


@pytest.mark.heavy
@pytest.mark.skipif(this_platform() != "x86_64-linux", reason="the emulator runs programs of x86-64 Linux")
def test_an_instance_takes_the_copy_where_the_processor_has_avx2_alone(model, driver, tmp_path):
    """Processors of an emulator, and a copy that ends the program."""
    emulator = program("qemu-x86_64", "qemu-user", "qemu-x86_64-static")
    fmu = model("plant", "2.0")
    broken = library(fmu, tmp_path, kernel_plant_step_avx2=BROKEN)
    command = [driver("2.0"), broken, *driver_arguments(fmu)]
    for cpu in ("Nehalem", "max,-avx2", "max,-xsave"):
        run([emulator, "-cpu", cpu, *command], seconds=300)
    with pytest.raises(AssertionError, match="exit code -"):
        run([emulator, "-cpu", "max", *command], seconds=300)


CALLED = f"""#include "processor.h"
{SHOWN}
typedef int Step(void *, double, double, int);
SHOWN uint64_t step_in(uint64_t mode, Step *step, void *unit, double from, double size, int *status);
uint64_t step_in(uint64_t mode, Step *step, void *unit, double from, double size, int *status)
{{
    set_arithmetic(mode);
    *status = step(unit, from, size, 1);
    const uint64_t after = arithmetic_now();
    set_arithmetic(USUAL_ARITHMETIC);
    return after;
}}
"""
MODES = {
    "x86_64": {"up": 0x5F80, "down": 0x3F80, "to zero": 0x7F80, "flush to zero": 0x9FC0, "traps": 0},
    "aarch64": {"up": 1 << 22, "down": 2 << 22, "to zero": 3 << 22, "flush to zero": 1 << 24},
}[this_platform().partition("-")[0]]
"""What programs set in the register MXCSR or FPCR."""


def test_a_step_has_its_bits_in_each_mode_of_the_processor_and_leaves_the_mode(native):
    """An importer that rounds up, flushes subnormal numbers or traps on a rounding: sin would be off by 2.5e-10."""
    header = (data_path("fmu_src") / "c" / "processor.h").read_bytes()
    caller = loaded({"processor.h": header, "called.c": CALLED.encode()}, "called").step_in
    caller.argtypes, caller.restype = (c_uint64, c_void_p, c_void_p, c_double, c_double, c_void_p), c_uint64

    def outputs(mode: int | None) -> bytes:
        unit = native("plant").start()
        for k in range(20):
            if mode is None:
                unit.step(2.0**-10, tau=[1.0, -0.3])
                continue
            unit.set(tau=[1.0, -0.3])
            status = c_int(-1)
            step = cast(unit.model.function("DoStep"), c_void_p)
            after = caller(mode, step, unit.pointer, k * 2.0**-10, 2.0**-10, byref(status))
            assert (status.value, after) == (0, mode)
        return unit.outputs().tobytes()

    usual = outputs(None)
    for name, mode in MODES.items():
        assert outputs(mode) == usual, name
