"""Runs of many rows: what is told of them comes from stretches, is the same, and takes memory that does not grow."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import UsageError
from vdfmu.engine.run import Results, Signal
from vdfmu.study.run import summary
from vdfmu.study.run.references import _Progress
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference import reference as references
from vdfmu.system.reference.reference import BLOCK, Reference, reference, reference_blocks
from vdfmu.system.scenario import load_scenario

VARIABLES = (
    "trajectory.q_d", "plant.q", "controller.tau", "plant.kappa_dot", "plant.tau_s", "estimator.tau_f_hat",
    "estimator.tau_s_hat", "feedforward.tau_m",
)  # fmt: skip
SOURCES = ("plant.q", "controller.tau", "feedforward.tau_m")


def facts_of(results, robot, name="sampled-delayed", substeps=1):
    """Return all that is computed of the rows, with another run's as the reference."""
    n = robot.n

    def solution():
        for part in results.blocks(BLOCK, overlap=1):
            signals = {signal: 1.125 * part[f"{signal}[1]"][:, None].repeat(n, axis=1) for signal in SOURCES}
            yield Reference(name, part.time, signals)

    absolute, relative = summary.compare(results, solution(), robot, substeps)
    return {
        **summary.tracking_errors(results, robot), **summary.estimation_errors(results, substeps), **absolute,
        **relative,
    }  # fmt: skip


def earlier(rows, lag):
    """Return the values up to a row earlier, before the first row this one."""
    k = np.arange(len(rows), dtype=float)
    columns = rows.reshape(len(rows), -1).T
    return np.array([np.interp(k - lag, k, column) for column in columns]).T.reshape(rows.shape)


def on_disk(folder, rows, n):
    """Return results of random numbers, real ones on disk as those of a run are."""
    columns = len(VARIABLES) * n
    data = np.memmap(folder / f"{rows}.bin", np.float64, "w+", shape=(rows, columns))
    dice = np.random.default_rng(1)
    for first in range(0, rows, BLOCK):
        data[first : first + BLOCK] = dice.standard_normal((len(data[first : first + BLOCK]), columns))
    signals = [Signal(f"{name}[{i + 1}]", "real", "", n * k + i) for k, name in enumerate(VARIABLES) for i in range(n)]
    return Results(1e-3 * np.arange(rows), signals, {"real": data})


@pytest.mark.parametrize(("substeps", "lag"), [(1, 1.0), (2, 0.5), (0, 0.0)])
def test_the_whole_tells_what_its_definition_does(tmp_path, substeps, lag):
    robot = vdfmu.load_robot("planar_2dof")
    results = on_disk(tmp_path, 50, robot.n)
    facts, first = facts_of(results, robot, substeps=substeps), int(lag > 0.0)
    true = earlier(results["plant.tau_s"], lag)[first:]
    late = results["estimator.tau_f_hat"][first:] - true
    ours = results["controller.tau"] - results["feedforward.tau_m"]
    theirs = 1.125 * (results["controller.tau[1]"] - results["feedforward.tau_m[1]"])
    a, b = np.sqrt(np.mean(ours**2, axis=0)), np.sqrt(np.mean(theirs**2))
    difference = np.abs(results["plant.q"] - 1.125 * results["plant.q[1]"][:, None])
    # sums of 50 squares in another order
    assert facts["rms_tau_f_hat_error_nm"] == pytest.approx(np.sqrt(np.mean(late**2, axis=0)), rel=1e-14)
    assert facts["rms_torque_difference"] == pytest.approx(np.max(np.abs(a - b) / b), rel=1e-13)
    assert facts["max_position_difference_rad"] == difference.max()
    assert facts["at_s"] == results.time[difference.max(axis=1).argmax()]


def test_memory_of_the_summary_does_not_grow_with_the_rows(tmp_path):
    robot = vdfmu.load_robot("planar_2dof")
    results = on_disk(tmp_path, 100 * BLOCK, robot.n)
    tracemalloc.start()
    facts_of(results, robot)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # one array of all rows and joints would take 1.6 MB; a stretch of all variables takes 0.2 MB
    assert peak < 8 * 100 * BLOCK * robot.n


@pytest.mark.parametrize("name", ["sampled", "sampled-delayed", "continuous"])
def test_a_reference_in_stretches_is_the_whole(monkeypatch, name):
    description = SystemDescription(load_scenario("planar_tracking"))
    whole = reference(name, description, step=1e-3, stop=0.05)
    monkeypatch.setattr(references, "BLOCK", 20)
    parts = list(reference_blocks(name, description, step=1e-3, stop=0.05))
    assert [len(part.t) for part in parts] == [20, 20, 11]
    np.testing.assert_array_equal(np.concatenate([part.t for part in parts]), whole.t)
    after = list(reference_blocks(name, description, step=1e-3, stop=0.05, overlap=3))
    assert [part.t[0] for part in after] == [parts[0].t[0], parts[0].t[-3], parts[1].t[-3]]
    np.testing.assert_array_equal(after[2].t[3:], parts[2].t)
    halves = list(reference_blocks(name, description, step=2e-3, stop=0.05, substeps=2))
    for signal, array in whole.signals.items():
        np.testing.assert_array_equal(np.concatenate([part[signal] for part in parts]), array)
        np.testing.assert_array_equal(np.concatenate([part[signal] for part in halves]), array[::2])
        np.testing.assert_array_equal(after[1][signal], array[17:40])


@pytest.mark.heavy
def test_a_comparison_with_references_may_end_before_the_run():
    part = vdfmu.run("planar_tracking", stop=0.2, out=False, reference_stop=0.1).summary
    short = vdfmu.run("planar_tracking", stop=0.1, out=False).summary
    # the same rows up to then, so the same numbers
    assert part["reference"] == short["reference"] and part["reference_stop"] == 0.1 and "reference_stop" not in short
    (check,) = [each for each in part["verdict"]["checks"] if each["key"] == "reference"]
    assert check["sentence"].endswith("of the peak error, compared over the first 0.1 s")


@pytest.mark.parametrize(("options", "message"), [
    ({"reference_stop": 0.0}, "must be finite and at least one step, 0.001 s, got 0"),
    ({"reference_stop": float("inf")}, "must be finite and at least one step, 0.001 s, got inf"),
    ({"reference_stop": 0.1, "reference": False}, "needs the references"),
])  # fmt: skip
def test_an_end_of_the_comparison_that_has_no_effect_is_refused(options, message):
    with pytest.raises(UsageError, match=f"reference_stop {message}"):
        vdfmu.run("planar_tracking", stop=0.2, out=False, **options)


def test_a_reference_that_takes_much_longer_than_its_run_is_named_once(monkeypatch):
    clock = SimpleNamespace(perf_counter=iter([1.0, 1.0, 1.8, 7.0, 9.0]).__next__)
    monkeypatch.setattr("vdfmu.study.run.references.time", clock)
    notes = []
    case = SimpleNamespace(options={"log": lambda message: notes.append(message.text)})
    progress = _Progress(case, "sampled reference", 3.0)
    # after the first rows, which a compiler may precede, 100 take 8 s, which is short, 15 s, and 10.7 s
    for done in (10, 20, 50, 85):
        progress(done, 100)
    assert [text.partition(":")[0] for text in notes] == [
        "the sampled reference takes about 15 s, 5 times as long as the run"
    ]
