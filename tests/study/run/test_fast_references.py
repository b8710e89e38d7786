"""References in seconds: compiled functions, and solutions that are kept by what decides them."""

import dataclasses

import numpy as np
import pytest

from vdfmu.base.arrays import scipy_part
from vdfmu.base.errors import VdfmuError
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference import compiled as compiled_rows
from vdfmu.system.reference import reference as compiled
from vdfmu.system.reference import solution
from vdfmu.system.reference.compiled import CompiledSampled
from vdfmu.system.reference.reference import reference, reference_blocks
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

NAMES = ("sampled", "sampled-delayed", "continuous")


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Use a cache of this test alone for references, but not for what is compiled."""
    return use(tmp_path / "cache", monkeypatch)


def use(folder, monkeypatch):
    monkeypatch.setattr("vdfmu.system.reference.reference.cache_folder", lambda: folder)
    return folder


def kept(folder):
    """Return how many solutions a cache has."""
    return len([*(folder / "references").iterdir()])


def described(name="planar_tracking", parameters=None):
    scenario = load_scenario(name)
    return SystemDescription(scenario, system_values(scenario, parameters))


@pytest.mark.few(2)
@pytest.mark.parametrize(("name", "scenario"), [
    *((name, "planar_tracking") for name in NAMES), ("continuous", "slider_tracking"), ("continuous", "two_arms"),
])  # fmt: skip
def test_without_the_compiler_a_reference_is_the_same(own_cache, monkeypatch, name, scenario):
    fast = reference(name, described(scenario), step=1e-3, stop=0.05)
    use(own_cache / "other", monkeypatch)
    monkeypatch.setattr(compiled, "native_available", lambda: False)
    plain = reference(name, described(scenario), step=1e-3, stop=0.05)
    for group, values in fast.signals.items():
        # rounding of other functions sin and exp, which changes the solver's steps within its tolerance of 1e-11
        np.testing.assert_allclose(plain[group], values, rtol=1e-9, atol=1e-9, err_msg=group)


@pytest.mark.few(2)
@pytest.mark.parametrize(("scenario", "step", "stop", "parameters"), [
    ("planar_tracking", 1e-3, 0.3, {}),
    ("two_joint", 1e-3, 0.3, {}),  # four joints stand still: stiff
    ("tracking", 0.02, 1.2, {"trajectory.T": 1e5}),  # all stand still, so that a run is judged by 1e-11 rad
])  # fmt: skip
@pytest.mark.parametrize("name", NAMES)
def test_references_are_exact_to_1e_11_rad(own_cache, monkeypatch, name, scenario, step, stop, parameters):
    usual = reference(name, described(scenario, parameters), step=step, stop=stop)["plant.q"]
    monkeypatch.setattr(solution, "compiles", lambda run: False)
    for tolerances in (solution.SHORT, solution._LONG):
        monkeypatch.setitem(tolerances, "rtol", 3e-14)
        monkeypatch.setitem(tolerances, "atol", 1e-15)
    use(own_cache / "other", monkeypatch)
    tight = reference(name, described(scenario, parameters), step=step, stop=stop)["plant.q"]
    # the local error of 1e-12 a step of a loop that forgets within some hundred steps
    assert np.abs(usual - tight).max() < 1e-11


@pytest.mark.parametrize("change", ["a value", "a signal from outside"])
def test_what_changes_a_reference_has_it_solved(own_cache, change):
    first, other = described(), described(parameters={"controller.K_p[1]": 1999.0})
    if change != "a value":
        inputs = {"plant.F_e[1]": ([0.0, 1.0], [0.0, 1.0])}
        other = SystemDescription(dataclasses.replace(first.scenario, inputs=inputs), first.values)
    q = [reference("continuous", each, step=1e-3, stop=0.05)["plant.q"] for each in (first, other)]
    assert kept(own_cache) == 2 and np.any(q[0] != q[1])


@pytest.mark.parametrize("options", [{"step": 5e-4}, {"stop": 0.06}, {"groups": ["plant.q"]}])
def test_other_rows_are_solved(own_cache, options):
    plain = {"step": 1e-3, "stop": 0.05}
    for chosen in (plain, plain | options):
        list(reference_blocks("sampled", described(), **chosen))
    assert kept(own_cache) == 2


@pytest.mark.heavy
@pytest.mark.parametrize("name", NAMES)
def test_a_reference_in_compiled_code_is_that_of_scipy(own_cache, monkeypatch, name):
    rows = []
    for block in reference_blocks(name, described("tracking"), step=1e-3, stop=1.2):
        block.repeat(block.t.size // 2)
        rows.append(block["plant.q"])
    (again, *_), count = reference_blocks(name, described("tracking"), step=1e-3, stop=1.2), 1200 // 12 + 2
    monkeypatch.setattr(solution, "compiles", lambda run: False)
    use(own_cache / "other", monkeypatch)
    slow = reference(name, described("tracking"), step=1e-3, stop=1.2)
    np.testing.assert_allclose(np.concatenate(rows), slow["plant.q"], rtol=0, atol=2e-12)
    assert (slow.repeated.intervals, block.repeated.intervals, again.repeated.intervals) == (0, count, count)
    # of states up to 10 at rtol = 1e-9
    assert 0.0 < again.repeated.difference == block.repeated.difference < 1e-8


@pytest.mark.heavy
def test_near_standstill_one_implicit_step_solves_an_interval(own_cache, monkeypatch):
    """Friction would take the explicit method five steps."""
    made = []
    monkeypatch.setattr(solution, "CompiledSampled", lambda *args: made.append(CompiledSampled(*args)) or made[0])
    usual = reference("sampled", described("tracking", {"trajectory.T": 1e5}), step=1e-3, stop=0.3)["plant.q"]
    waits = [mover.wait for mover in made[0]._movers]
    use(own_cache / "other", monkeypatch)
    monkeypatch.setattr(solution, "compiles", lambda run: False)
    slow = reference("sampled", described("tracking", {"trajectory.T": 1e5}), step=1e-3, stop=0.3)["plant.q"]
    assert min(waits) < -50
    np.testing.assert_allclose(usual, slow, rtol=0, atol=1e-12)


@pytest.mark.heavy
def test_a_compiled_solution_that_is_not_that_of_scipy_is_no_reference(own_cache, monkeypatch):
    tables = scipy_part("scipy.integrate._ivp.dop853_coefficients")
    monkeypatch.setattr(tables, "B", tables.B * (1.0 + 1e-5))  # of some 1e-3 in an interval, for 2e-10
    monkeypatch.setattr(compiled_rows, "_tables", compiled_rows._tables.__wrapped__)
    with pytest.raises(VdfmuError, match=r"from t = 0 s to 0.001 s its compiled solver and scipy's differ by \d"):
        reference("sampled", described("planar_tracking"), step=1e-3, stop=0.05)
    monkeypatch.setattr(solution, "_DENSE", {"rtol": 1e-4, "atol": 1e-5})
    with pytest.raises(VdfmuError, match=r"its compiled solver and scipy's differ by \d"):
        reference("continuous", described("planar_tracking"), step=1e-3, stop=1.0)


def test_a_damaged_solution_is_solved_again(own_cache):
    first = reference("sampled", described(), step=1e-3, stop=0.05)
    (file,) = (own_cache / "references").iterdir()
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(content)
    again = reference("sampled", described(), step=1e-3, stop=0.05)
    np.testing.assert_array_equal(again["plant.q"], first["plant.q"])


@pytest.mark.parametrize("name", ["sampled", "sampled-delayed"])
def test_a_solution_that_runs_away_says_where(own_cache, name):
    """A derivative gain at which each sample throws the rotors back 1e3 times as fast."""
    with pytest.raises(VdfmuError, match=r"plant has no finite state after t = 0[.\d]* s"):
        reference(name, described(parameters={"controller.K_v": 1e6}), step=1e-3, stop=0.5)
