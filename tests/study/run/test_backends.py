"""Python and native FMUs in the same system under the same master."""

import zipfile

import numpy as np
import pytest

import vdfmu

STOP = 0.2


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    finished = {}

    def once(**options):
        key = tuple(sorted(options.items()))
        if key not in finished:
            folder = tmp_path_factory.mktemp("run")
            finished[key] = (folder, vdfmu.run("planar_tracking", stop=STOP, out=folder, reference=False, **options))
        return finished[key]

    return once


def largest_difference(a, b, pattern=""):
    return max(np.abs(a[name] - b[name]).max() for name in a.names if pattern in name)


@pytest.mark.few(1)
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_python_and_native_fmus_compute_the_same(runs, algorithm):
    _, python = runs(backend="python", algorithm=algorithm)
    _, native = runs(backend="native", algorithm=algorithm)
    assert python.names == native.names
    assert largest_difference(python, native, "plant.q[") <= 1e-9
    # The same operations in the same order; libraries round sin, tanh, exp by an ulp at most differently. Snap
    # and torque are of order 10: 1e-9 is 1e6 roundings of them, and far below what one wrong sign would make.
    assert largest_difference(python, native) <= 1e-9


def test_the_package_of_a_run_holds_what_was_asked_for(runs):
    for backend, member in (("python", "resources/vdfmu.json"), ("native", "sources/unit.c")):
        folder, _ = runs(backend=backend, algorithm="jacobi")
        with zipfile.ZipFile(folder / "system.ssp") as package, package.open("resources/Plant.fmu") as fmu:
            assert member in zipfile.ZipFile(fmu).namelist()
