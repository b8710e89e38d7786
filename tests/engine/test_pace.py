"""A run that is held back to the clock: no row before it is due, and how late rows were."""

import numpy as np
import pytest

from vdfmu.base.errors import UsageError
from vdfmu.engine.masters import observer
from vdfmu.engine.masters.observer import Pace, machine_name


class _Clock:
    """A clock that goes on by what is done, and by a microsecond each time that it is looked at."""

    def __init__(self):
        self.now = 10.0

    def perf_counter(self):
        """Time [s]."""
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        """Wait [s]."""
        assert 0.0 < seconds <= 0.1
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    fake = _Clock()
    monkeypatch.setattr(observer, "clock", fake)
    return fake


def test_rows_are_stored_and_left_when_they_are_due(clock):
    stored = []
    paced = Pace(2.0, 1.0)
    for k in range(5):
        stored.append((k, clock.now))
        paced.take(k, float(k), None)
        if k:  # A second of the run takes half a second; the clock is looked at once a microsecond.
            assert clock.now - stored[1][1] == pytest.approx(0.5 * (k - 1), abs=3e-6)
        clock.now += 0.1  # work
    assert [k for k, _ in stored] == [0, 1, 2, 3, 4]
    facts = paced.facts()
    assert (facts["speed"], facts["rows"], facts["overruns"]) == (2.0, 3, 0)
    assert 0.0 <= facts["late_p50_s"] <= facts["late_worst_s"] < 3e-6
    assert stored[1][1] - stored[0][1] == pytest.approx(0.1, abs=3e-6)  # the first step is not waited for
    assert paced.waited == pytest.approx(3 * 0.4, abs=2e-5)
    assert facts["machine"] == machine_name() != ""


def test_a_row_that_takes_too_long_is_late_and_a_run_that_the_user_stops_waits_no_longer(clock):
    taken = iter([0.0, 0.1, 0.1, 0.75, 0.1, 0.1])
    paced = Pace(1.0, 0.5)
    for k in range(6):
        clock.now += next(taken)
        paced.take(k, 0.5 * k, None)
    facts = paced.facts()
    assert (facts["overruns"], facts["worst_row"]) == (1, 3)
    assert facts["late_worst_s"] == pytest.approx(0.25, abs=1e-5)
    assert facts["late_p50_s"] < 1e-5  # row 5 is on time again
    begin, pressed = clock.now, iter([False, False, True, True, True])
    paced = Pace(1e-3, 1.0, lambda: next(pressed))
    for k in range(3):  # row 2 is due in 1000 s
        paced.take(k, float(k), None)
    assert clock.now - begin < 0.3


@pytest.mark.parametrize("speed", [0.0, -1.0, np.inf, np.nan])
def test_a_speed_is_positive(speed):
    with pytest.raises(UsageError, match="pace: expected a positive number of simulated seconds a second, got"):
        Pace(speed, 1e-3)
