"""A run that must equal recorded results: by share of each range, at the recorded times, by name and unit."""

import json
import math

import numpy as np
import pytest

from tests.engine.reference import models
from tests.warm import command
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Results, Signal
from vdfmu.engine.results.verdict import FAILED, GOOD
from vdfmu.study.expected import expected_check, read_expected

TIME = np.arange(11) / 10


def rows(units=("K", "m", "", ""), **changes):
    """Return a run: a ramp of 10 K on 300 K, a constant of 2 m, zeros, and a counter."""
    real = np.column_stack([300.0 + 10.0 * TIME, np.full(11, 2.0), np.zeros(11)])
    for column, (place, value) in changes.items():
        real[place, "TLz".index(column)] += value
    names = "room.T", "room.L", "room.z"
    signals = [Signal(name, "real", unit, i) for i, (name, unit) in enumerate(zip(names, units, strict=False))]
    counter = Signal("clock.n", "integer", "", 0)
    return Results(TIME, [*signals, counter], {"real": real, "integer": np.arange(11)[:, None] // 2})


@pytest.fixture(name="check")
def _check(tmp_path):
    """Return a function that writes recorded results and returns the check of a run against them."""

    def check(run, recorded=None, within=None, text=None, edit=str):
        path = tmp_path / "reference.csv"
        (recorded or rows()).write(path)
        path.write_text(edit(path.read_text()) if text is None else text)
        entry = read_expected(path, within).compare(run)
        verdict = expected_check(json.loads(json.dumps(entry)))
        return verdict

    return check


def test_a_run_equals_itself_to_the_bit_and_a_small_difference_is_a_share_of_the_swing(check):
    same = check(rows(), within=0.0)
    assert (same.state, same.value) == (GOOD, 0.0)
    assert same.sentence == "equals reference.csv in 4 signals to 0 % of the range (allowed 0 %)"
    apart = check(rows(T=(3, 0.12)))
    assert apart.state == FAILED
    # 0.12 K of a range of 10 K, whatever the 300 K
    assert apart.sentence == "room.T differs from reference.csv by 1.2 % of its range at t = 0.3 s (allowed 1e-4 %)"
    assert check(rows(T=(3, 0.12)), within=0.0121).state == GOOD
    # a swing of 10 K on 310 K rounds by 2^-53 of them at most
    assert check(rows(T=(3, 0.12)), within=0.012 - 310 / 10 * 2**-53).state == FAILED


def test_a_constant_counts_by_its_value_and_nothing_is_close_to_zero(check):
    assert check(rows(L=(5, 1e-6))).state == GOOD
    apart = check(rows(L=(5, 1e-5)))
    assert apart.sentence == "room.L differs from reference.csv by 5e-4 % of its value at t = 0.5 s (allowed 1e-4 %)"
    zero = check(rows(z=(2, 1e-12)))
    assert zero.state == FAILED and math.isinf(zero.value)
    assert zero.sentence == "room.z differs from reference.csv at t = 0.2 s: 1e-12, expected 0"


def test_values_are_those_at_the_recorded_times(check):
    """A third of the rows, and rows between those of the run: reals on the line, integers as they hold."""
    recorded = rows().thinned(4)
    assert check(rows(), recorded).state == GOOD
    between = "time,room.T,clock.n\n0.05,300.5,0\n0.25,302.5,1\n0.25,302.5,1\n0.95,309.5,4\n"
    assert check(rows(), text=between).state == GOOD
    short = check(rows(), text="time,room.T\n0.05,300.5\n0.25,302.5\n")
    assert short.state == GOOD and short.sentence.startswith("equals reference.csv in 1 signal to ")
    assert short.sentence.endswith(", up to t = 0.25 s, where reference.csv ends")
    late = check(rows(), text=between.replace("0.95,309.5,4", "0.95,309.5,5"))
    assert late.sentence.startswith("clock.n differs from reference.csv by 20 % of its range at t = 0.95 s")
    # before and after an event
    assert check(rows(), text="time,clock.n\n0,0\n0.2,0\n0.2,1\n0.4,1\n0.4,2\n").state == GOOD


def test_names_units_and_times_that_do_not_fit_are_failures(check):
    assert check(rows(), edit=lambda text: text.replace("room.", "").replace("clock.", "")).state == GOOD
    lacks = check(rows(), edit=lambda text: text.replace("room.T", "room.X").replace("room.L", "room.Y"))
    assert (lacks.state, lacks.sentence) == (
        FAILED, "room.X and 1 more of reference.csv are not in the run; --record '*' records inputs too"
    )  # fmt: skip
    in_degrees = check(rows(units=("rad", "m", "")), rows(units=("deg", "m", "")))
    assert in_degrees.sentence == "room.T is in rad, in reference.csv in deg"
    both = Results(TIME, [Signal(f"{name}.y", "real", "", 0) for name in "ab"], {"real": TIME[:, None]})
    unclear = check(both, text="time,y\n0,0\n1,1\n")
    assert unclear.sentence == "y may be a.y or b.y: reference.csv must name the component"
    early = check(rows(), edit=lambda text: f"{text}1.5,315,2,0,7\n")
    assert early.sentence == "the run ends at t = 1 s, reference.csv at t = 1.5 s"
    assert early.more == ""  # the common rows agree
    assert check(rows(), edit=lambda text: text.replace("\n0", "\n-1", 1)).sentence.startswith("the run begins at t")


@pytest.mark.parametrize(("text", "within", "said"), [
    ("time\n0\n", None, "must have a signal and a row"),
    ("time,y\n", None, "must have a signal and a row"),
    ("time,y\n0,nan\n", None, "y must be finite numbers"),
    ("time,y\n1,0\n0,0\n", None, "in the order of their times"),
    ("time,y\n0,0\n", -1.0, r"within: must be 0 or a positive fraction of a signal's range, got -1\."),
    (None, 1e-3, "within: needs expect"),
])  # fmt: skip
def test_what_cannot_be_compared_is_said_before_the_run(tmp_path, text, within, said):
    path = tmp_path / "reference.csv"
    path.write_text(text or "")
    with pytest.raises(UsageError, match=said):
        read_expected(path if text else None, within)


@pytest.mark.heavy
def test_the_command_compares_runs_of_fmus_and_ends_with_the_exit_code(tmp_path):
    lag = models.build(models.LAG, "2.0", tmp_path)
    words = "run", f"a={lag.name}", f"b={lag.name}", "--connect", "a.x=b.u", "--stop", "1", "--step", "0.1"
    assert command(*words, "--set", "a.u=1", "--out", "first", cwd=tmp_path).returncode == 0
    expect = "--expect", "first/results.csv", "--within", "1e-9"
    assert command(*words, "--set", "a.u=1", *expect, "--out", "same", cwd=tmp_path).returncode == 0
    other = command(*words, "--set", "a.u=1.1", *expect, "--out", "other", cwd=tmp_path)
    assert other.returncode == 1
    # a linear system: all of the difference is 10 % of the range, which ends last
    said = "Failed: a.x differs from results.csv by 10 % of its range at t = 1 s (allowed 1e-7 %)"
    assert said in other.stdout + other.stderr
    missing = command(*words, "--expect", "none.csv", "--out", "none", cwd=tmp_path)
    assert missing.returncode == 2
    assert not (tmp_path / "none").exists()
