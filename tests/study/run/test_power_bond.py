"""The energy that the coupling adds, of rows that a run shows."""

import numpy as np
import pytest

import vdfmu
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.recorder import Blocks
from vdfmu.study.run import measure
from vdfmu.study.run.measure import PowerBond
from vdfmu.study.verdict import calculated_checks

NAMES = [f"{name}[{i}]" for name in ("plant.kappa_dot", "controller.tau", "x.y", "plant.tau", "controller.kappa_dot")
         for i in (2, 1)]  # fmt: skip


def shown(tap, times, rows, names=NAMES):
    recorded = [name for name in names if name in tap.wanted]
    grid = Grid(times[0], times[-1], times[1] - times[0], len(times) - 1)
    tap.begin(grid, recorded)
    columns = [NAMES.index(name) for name in recorded]
    memory = np.zeros(len(recorded))
    blocks = Blocks(tap, grid, recorded, memory, range(len(recorded)))
    for k, row in enumerate(rows[:, columns]):
        memory[:] = row
        blocks.keep(k)
    blocks.flush(len(times))
    return tap.summary()


@pytest.mark.parametrize("count", [7, 14, 50])
def test_energies_are_those_of_the_whole_run_in_stretches_of_seven_rows(count):
    robot = vdfmu.load_robot("planar_2dof")
    dice = np.random.default_rng(2)
    times, rows = 1.0 + 0.01 * np.arange(count), dice.standard_normal((count, len(NAMES)))
    signals = {name: rows[:, [NAMES.index(f"{name}[{i}]") for i in (1, 2)]] for name in measure.POWER}
    taken = robot.ell * signals["plant.tau"] * signals["plant.kappa_dot"]
    supplied = robot.ell * signals["controller.tau"] * signals["controller.kappa_dot"]
    residual = 0.5 * np.diff(times, prepend=times[0])[:, None] * (taken - supplied)
    tap = PowerBond(robot)
    tap.size = 7  # rows of a block
    for _ in range(2):  # a tap begins each run anew
        energies = shown(tap, times, rows)["power_bond"]
        # sums of 50 numbers in another order: 50 roundings of 1.1e-16 of sums of absolute values, which are up to 50
        # times the sum
        np.testing.assert_allclose(energies["residual_energy_j"], residual.sum(axis=0), rtol=1e-12)
        np.testing.assert_allclose(energies["residual_energy_abs_j"], np.abs(residual).sum(axis=0), rtol=1e-12)
        exchanged = np.abs(0.01 * taken[1:]).sum(axis=0)
        np.testing.assert_allclose(energies["exchanged_energy_j"], exchanged, rtol=1e-12)


def test_a_run_without_one_of_the_signals_has_no_entry():
    tap = PowerBond(vdfmu.load_robot("planar_2dof"))
    assert shown(tap, np.array([0.0, 1.0]), np.zeros((2, len(NAMES))), NAMES[1:]) == {}


ENERGIES = [(0.5, 10.0, "failed"), (0.3, 10.0, "failed"), (0.01, 10.0, "good"), (1.0, 1e-5, "good")]


@pytest.mark.parametrize(("share", "exchanged", "state"), ENERGIES)
def test_a_coupling_that_makes_half_of_the_energy_it_passes_on_is_not_good(share, exchanged, state):
    """Half would be more than a real drive loses by friction. A residual below 1 mJ is that of an arm at rest."""
    energies = {"residual_energy_abs_j": [share * exchanged, 0.0], "exchanged_energy_j": [exchanged, 0.0]}
    *_, check = calculated_checks({"power_bond": energies})
    assert check.state == state
