"""No wrong access, no undefined behaviour, no leak: init, 1000 steps, rollback, reset, serialization, end, wrong use.

driver.c does all of it with a unit, and also checks that every repeated run gives the same bits.
"""

import numpy as np
import pytest

from tests.compiler.native.binding import Model
from tests.compiler.native.conftest import GCC, HERE, SANITIZERS, bits, driver_arguments, program, run, version_flags

pytestmark = pytest.mark.heavy

UNITS = [("plant", "2.0"), ("plant", "3.0"), ("feedforward", "2.0"), ("trajectory", "3.0")]


def library(model: Model) -> str:
    return model.library._name


@pytest.mark.parametrize(("unit", "version"), UNITS)
def test_the_sources_are_clean_under_the_sanitizers(model, sanitized, driver, tmp_path, unit, version):
    """Compiled by gcc, with the leak check on; beside, the shipped library computes the same."""
    fmu = model(unit, version)
    program_path = tmp_path / "driver"
    run([program("gcc", "gcc"), *GCC, *SANITIZERS, *version_flags(version), "-DSTATIC", HERE / "driver.c",
         *sanitized(unit, version), "-o", program_path, "-lm"])  # fmt: skip
    options = {"ASAN_OPTIONS": "detect_leaks=1:abort_on_error=0", "UBSAN_OPTIONS": "print_stacktrace=1"}
    checked = run([program_path, "-", *driver_arguments(fmu)], **options)
    shipped = run([driver(version), library(fmu), *driver_arguments(fmu)])
    assert bits(checked) == bits(shipped)


@pytest.mark.parametrize(("unit", "version"), UNITS)
def test_the_shipped_library_is_clean_under_valgrind(model, driver, unit, version):
    valgrind = program("valgrind", "valgrind")
    fmu = model(unit, version)
    command = [driver(version), library(fmu), *driver_arguments(fmu)]
    checked = run([valgrind, "-q", "--error-exitcode=9", "--leak-check=full",
                   "--errors-for-leak-kinds=definite,indirect,possible", *command], seconds=300)  # fmt: skip
    assert close(bits(checked), bits(run(command)), 1e-9)


def test_the_driver_finds_the_faults_that_it_looks_for(model, driver):
    """With the outputs taken for inputs, setting fails: the driver says so and ends with 1."""
    fmu = model("plant", "2.0")
    guid, inputs, outputs, *rest = driver_arguments(fmu)
    with pytest.raises(AssertionError, match="exit code 1\n"):
        run([driver("2.0"), library(fmu), guid, outputs, inputs, *rest])
    with pytest.raises(AssertionError, match="driver: expected instances"):
        run([driver("2.0"), library(fmu), "{}", inputs, outputs, *rest])


def close(actual: dict[str, list[bytes]], expected: dict[str, list[bytes]], tolerance: float) -> bool:
    """Whether all numbers agree to a tolerance, relative and absolute."""
    assert actual.keys() == expected.keys()
    for name in expected:
        a, b = (np.frombuffer(b"".join(rows[name]), dtype="<f8") for rows in (actual, expected))
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance, err_msg=name)
    return True
