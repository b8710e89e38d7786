"""The copy of the solver's step for processors with AVX2: the same bits, and only where the processor has it."""

from pathlib import Path

import numpy as np
import pytest

from tests.compiler.native.binding import Model
from tests.compiler.native.conftest import bits, driver_arguments, program, run
from vdfmu.base.compile import compile_library
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
