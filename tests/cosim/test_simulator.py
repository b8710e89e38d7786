"""Runs of components that stay loaded: each is what it would be alone."""

import numpy as np
import pytest

import vdfmu
from vdfmu.engine.cosim import component
from vdfmu.errors import CosimError, SspError, UsageError

OPTIONS = {"stop": 0.05, "step": 1e-3}
CHANGED = {"plant.I_m[1]": 2e-3}  # another rotor, so another run


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packages")
    robot = vdfmu.load_robot("planar_2dof")
    found = {}
    for backend in ("native", "python"):
        fmus = vdfmu.build_fmus(robot, folder / backend, backend=backend)
        scenario = vdfmu.load_scenario("planar_tracking")
        found[backend] = vdfmu.write_ssp(scenario, fmus, folder / f"{backend}.ssp")
    return found


@pytest.fixture
def package(packages):
    return packages["native"]


def same(a, b):
    return a.names == b.names and all(np.array_equal(a[name], b[name]) for name in a)


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
@pytest.mark.parametrize("backend", ["native", "python"])
def test_each_run_is_that_of_components_that_are_new(packages, backend, algorithm):
    options = OPTIONS | {"stop": 0.02}
    alone = vdfmu.simulate(packages[backend], algorithm=algorithm, **options)
    changed = vdfmu.simulate(packages[backend], algorithm=algorithm, parameters=CHANGED, **options)
    assert not same(alone, changed)
    with vdfmu.Simulator(packages[backend], algorithm=algorithm) as simulator:
        first = simulator.run(**options)
        other = simulator.run(parameters=CHANGED, **options)
        again = simulator.run(**options)
    assert same(first, alone) and same(again, alone)
    assert same(other, changed)
    assert first.summary["notes"] == again.summary["notes"] == alone.summary["notes"]


def test_components_are_loaded_once(package, monkeypatch):
    made, plain = [], component.Slave.instantiate

    def instantiate(slave):
        made.append(slave.name)
        plain(slave)

    monkeypatch.setattr(component.Slave, "instantiate", instantiate)
    with vdfmu.Simulator(package) as simulator:
        for _ in range(3):
            simulator.run(**OPTIONS)
    assert sorted(made) == ["controller", "feedforward", "plant", "trajectory"]


def test_results_of_a_run_stay(package):
    with vdfmu.Simulator(package) as simulator:
        first = simulator.run(**OPTIONS)
        before = {name: first[name].copy() for name in first}
        simulator.run(parameters=CHANGED, **OPTIONS)
    for name, values in before.items():
        np.testing.assert_array_equal(first[name], values)


def test_other_times_and_signals_of_each_run(package):
    with vdfmu.Simulator(package) as simulator:
        short = simulator.run(stop=0.01, step=2e-3, record=["plant.q[*]"])
        long = simulator.run(start=0.5, stop=0.53, step=1e-3)
    assert short.names == ["plant.q[1]", "plant.q[2]"] and len(short) == 6
    alone = vdfmu.simulate(package, start=0.5, stop=0.53, step=1e-3)
    assert same(long, alone) and long.time[0] == 0.5


def test_a_run_that_fails_leaves_the_next_as_it_is(package):
    with vdfmu.Simulator(package) as simulator:
        alone = simulator.run(**OPTIONS)
        with pytest.raises(CosimError, match="plant"):
            simulator.run(parameters={"plant.I_m[1]": -1.0}, **OPTIONS)
        assert same(simulator.run(**OPTIONS), alone)


def test_isolated_components_run_again(package):
    with vdfmu.Simulator(package, isolate=True) as simulator:
        first = simulator.run(**OPTIONS)
        again = simulator.run(**OPTIONS)
    assert first.summary["isolated"]
    assert same(first, again)


def test_what_is_wrong_is_told_where_it_is_said(package):
    simulator = vdfmu.Simulator(package)
    with pytest.raises(UsageError, match="'with vdfmu.Simulator"):
        simulator.run(**OPTIONS)
    with simulator:
        with pytest.raises(UsageError, match=r"has no variable 'mess'"):
            simulator.run(parameters={"plant.mess": 1.0}, **OPTIONS)
        with pytest.raises(UsageError, match="expected a multiple of step = 0.001 s"):
            simulator.run(stop=0.0015, step=1e-3)
        assert len(simulator.run(**OPTIONS)) == 51
    with pytest.raises(UsageError, match="made in a block"):
        simulator.run(**OPTIONS)
    with pytest.raises(UsageError, match="tolerance must be positive"):
        vdfmu.Simulator(package, tolerance=0.0)
    with pytest.raises((SspError, UsageError)), vdfmu.Simulator(package, parameters={"plant.mess": 1.0}):
        pass
