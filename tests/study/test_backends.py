"""Python and native FMUs, and the container FMU, in the same system under the same master."""

import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import vdfmu
from vdfmu.engine.cosim.container import simulate_container, write_container
from vdfmu.errors import CosimError, UsageError
from vdfmu.fmu import build

STOP = 0.2


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the function ``runs(**options)``: a short run of the small arm, once for each set of options."""
    known = {}

    def once(**options):
        key = tuple(sorted(options.items()))
        if key not in known:
            folder = tmp_path_factory.mktemp("run")
            known[key] = (
                folder,
                vdfmu.run("planar_tracking", stop=STOP, out=folder, reference=False, **options),
            )
        return known[key]

    return once


def largest_difference(a, b, pattern=""):
    return max(np.abs(a[name] - b[name]).max() for name in a.names if pattern in name)


@pytest.mark.parametrize("master", ["gauss-seidel", "jacobi"])
def test_python_and_native_fmus_compute_the_same(runs, master):
    _, python = runs(backend="python", master=master)
    _, native = runs(backend="native", master=master)
    assert python.names == native.names
    assert largest_difference(python, native, "plant.q[") <= 1e-9
    # The same operations in the same order; libraries round sin, tanh, exp by an ulp at most differently. Snap
    # and torque are of order 10: 1e-9 is 1e6 roundings of them, and far below what one wrong sign would make.
    assert largest_difference(python, native) <= 1e-9


@pytest.mark.slow
def test_python_and_native_fmus_agree_over_the_tracking_run(tmp_path):
    runs = [
        vdfmu.run("tracking", backend=backend, out=tmp_path / backend, reference=False)
        for backend in ("python", "native")
    ]
    assert largest_difference(*runs, "plant.q[") <= 1e-9


def test_the_container_runs_as_jacobi_does_to_the_bit(runs):
    folder, folded = runs(backend="native", container=True)
    _, jacobi = runs(backend="native", master="jacobi")
    assert set(folded.names) == set(jacobi.names)
    assert folded.units == {name: jacobi.units[name] for name in folded.names}
    # the same libraries on the same numbers
    assert largest_difference(folded, jacobi) == 0.0
    assert folded.summary["container"] and folded.summary["master"] == "jacobi"
    assert (folder / "container.fmu").is_file()


def test_the_container_is_valid_and_runs_in_plain_fmpy(runs):
    folder, folded = runs(backend="native", container=True)
    path = str(folder / "container.fmu")
    # FMPy's container says nothing of dependencies, so its outputs depend on all; nothing else is to be said
    assert validate_fmu(path) == []
    result = fmpy.simulate_fmu(
        path, stop_time=STOP, output_interval=1e-3, output=["plant.q[1]", "plant.q[2]"]
    )
    for name in ("plant.q[1]", "plant.q[2]"):
        np.testing.assert_array_equal(result[name], folded[name])


def test_a_parameter_of_the_container_is_that_of_its_unit(runs):
    folder, _ = runs(backend="native", container=True)
    _, jacobi = runs(backend="native", container=True, settings=None)
    changed = fmpy.simulate_fmu(
        str(folder / "container.fmu"), stop_time=STOP, output_interval=1e-3,
        start_values={"controller.K_p[1]": 100.0}, output=["plant.q[1]"],
    )  # fmt: skip
    assert np.abs(changed["plant.q[1]"] - jacobi["plant.q[1]"]).max() > 1e-7


def test_the_same_system_gives_the_same_container_to_the_bit(runs, tmp_path):
    folder, _ = runs(backend="native", container=True)
    token = fmpy.read_model_description(str(folder / "container.fmu")).guid
    again = write_container(folder / "system.ssp", tmp_path / "again.fmu", step=1e-3)
    assert again.read_bytes() == (folder / "container.fmu").read_bytes()
    other = write_container(folder / "system.ssp", tmp_path / "other.fmu", step=2e-3)
    assert fmpy.read_model_description(str(other)).guid != token


def test_a_container_that_cannot_be_made_says_why(runs, tmp_path):
    folder, _ = runs(backend="python", master="jacobi")
    with pytest.raises(UsageError, match="needs Python"):
        write_container(folder / "system.ssp", tmp_path / "x.fmu", step=1e-3)
    for step in (0.0, float("inf"), float("nan")):
        with pytest.raises(UsageError, match="step: expected a positive finite time"):
            write_container(folder / "system.ssp", tmp_path / "x.fmu", step=step)
    with pytest.raises(UsageError, match="needs native FMUs"):
        vdfmu.run("planar_tracking", stop=STOP, out=tmp_path, container=True, backend="python")
    with pytest.raises(UsageError, match="steps its units as jacobi does"):
        vdfmu.run("planar_tracking", stop=STOP, out=tmp_path, container=True, master="gauss-seidel")
    assert not (tmp_path / "x.fmu").exists()


def test_a_container_steps_by_multiples_of_its_own_step(runs, tmp_path):
    folder, folded = runs(backend="native", container=True)
    container, system = folder / "container.fmu", vdfmu.load_ssp(folder / "system.ssp")
    with pytest.raises(
        UsageError, match=r"expected a multiple of the container's step 0\.001 s, got 0\.0015 s"
    ):
        simulate_container(container, system, stop=STOP, step=1.5e-3)
    coarse = simulate_container(container, system, stop=STOP, step=1e-2)
    np.testing.assert_array_equal(coarse["plant.q[1]"], folded["plant.q[1]"][::10])
    assert "plant.tau[1]" in folded and "plant.tau[1]" not in coarse  # it changed ten times in a row


def test_a_unit_that_fails_in_a_container_is_named(tmp_path):
    # the container says which of its units failed, and why; the error is that unit's
    with pytest.raises(
        CosimError, match=r"^plant: doStep at t = \S+ s failed: at t = \S+ s .*state .*\[\d\]"
    ):
        vdfmu.run(
            "planar_tracking", stop=STOP, out=tmp_path, container=True, reference=False,
            settings={"controller.K_p": 1e12},
        )  # fmt: skip
    names = (tmp_path / "partial" / "results.csv").read_text().partition("\n")[0]
    assert "plant.q[1]" in names and "container." not in names


def test_native_is_the_default_where_the_compiler_is(monkeypatch, runs):
    _, results = runs()
    assert results.summary["backend"] == "native"
    assert build.choose_backend(None) == "native"
    monkeypatch.setattr(build, "native_available", lambda: False)
    assert build.choose_backend(None) == "python"
    with pytest.raises(UsageError, match="no backend 'c'"):
        build.choose_backend("c")


def test_the_package_of_a_run_holds_what_was_asked_for(runs):
    for backend, member in (("python", "resources/vdfmu.json"), ("native", "sources/unit.c")):
        folder, _ = runs(backend=backend, master="jacobi")
        with zipfile.ZipFile(folder / "system.ssp") as package, package.open("resources/Plant.fmu") as fmu:
            assert member in zipfile.ZipFile(fmu).namelist()
