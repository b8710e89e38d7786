"""Who looks at a run is given its rows, all or now and then, and never changes it."""

import math

import numpy as np
import pytest

from vdfmu.base.errors import CosimError
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.run import Simulator, simulate


class Watcher:
    """Keeps what it is given."""

    def __init__(self, wanted=("*",), period=0.0):
        self.wanted, self.period = wanted, period
        self.names, self.about, self.rows, self.results = [], {}, [], None

    def begin(self, names, about):
        """Keep what there is."""
        self.names, self.about = list(names), dict(about)

    def row(self, time, values):
        """Keep a row."""
        self.rows.append((time, values))

    def end(self, results):
        """Keep the results."""
        self.results = results


@pytest.fixture
def fragile(pack):
    return pack(["source Ramp y:output", "arm Fragile y:output"])


@pytest.mark.few(2)
@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.parametrize("isolate", [False, True])
def test_every_row_is_seen_with_the_values_that_are_recorded(fragile, tmp_path, streamed, isolate):
    watcher = Watcher()
    results = simulate(
        fragile, stop=1.0, step=0.1, parameters={"arm.at": 9.0}, observer=watcher, isolate=isolate,
        stream=tmp_path / "rows.csv" if streamed else None, about={"scenario": "two"},
    )  # fmt: skip
    assert sorted(watcher.names) == sorted(n for n in results if results.kinds[n] == "real")
    assert (watcher.about["scenario"], watcher.about["stop"]) == ("two", 1.0)
    times, values = zip(*watcher.rows, strict=True)
    np.testing.assert_array_equal(times, 0.1 * np.arange(11.0))
    for name, column in zip(watcher.names, np.array(values).T, strict=True):
        np.testing.assert_array_equal(column, results[name])
    assert watcher.results is not None
    assert len(watcher.results) == 11


def test_an_observer_needs_nothing_but_row_and_sees_those_of_its_period_until_a_run_fails(fragile):
    watcher = Watcher(wanted=["source.*", "nobody.q[*]"], period=3600.0)
    simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 9.0}, observer=watcher)
    assert watcher.names == ["source.y"]
    assert [time for time, _ in watcher.rows] == [0.0]
    watcher = Watcher()
    with pytest.raises(CosimError):
        simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 0.5, "arm.mode": 0}, observer=watcher)
    assert len(watcher.rows) == len(watcher.results) == 6

    class Rows:
        def __init__(self):
            self.sizes = []

        def row(self, time, values):
            self.sizes.append(values.size)

    rows = Rows()
    results = simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 9.0}, observer=rows)
    assert rows.sizes == [sum(kind == "real" for kind in results.kinds.values())] * 11


@pytest.mark.few(1)
@pytest.mark.parametrize("isolate", [False, True])
def test_taps_see_the_rows_that_they_want_in_their_order(fragile, isolate):
    seen = []

    class Looker(Tap):
        def __init__(self, name, first):
            self.name, self.first = name, first

        wanted = ("source.*",)
        size = 4

        def begin(self, grid, names):
            self.last, self.blocks = grid.n - 1, []
            assert list(names) == ["source.y"]

        def due(self, k):
            row = max(self.first, k + (k - self.first) % 2)
            return row if row <= self.last else math.inf

        def block(self, times, values):
            self.blocks.append((times.tolist(), values[:, 0].tolist()))

        def take(self, k, time, components):
            seen.append((self.name, k, time, components.exchange.banks[0].outputs[0]))

    taps = [Looker("a", 1), Looker("b", 3)]
    results = simulate_with(taps, fragile, isolate)
    y = results["source.y"]
    whole = [(results.time[part].tolist(), y[part].tolist()) for part in (slice(4), slice(4, None))]
    assert [tap.blocks for tap in taps] == [whole, whole]
    assert seen == [("a", 1, 1.25, y[1]), ("a", 3, 1.75, y[3]), ("b", 3, 1.75, y[3])]


def simulate_with(taps, package, isolate):
    """Run from 1 s to 2.25 s, by five steps, with taps."""
    with Simulator(package, isolate=isolate, parameters={"arm.at": 9.0}) as simulator:
        return simulator.run(start=1.0, stop=2.25, step=0.25, taps=taps)


def test_a_row_that_is_not_finite_is_shown_to_no_tap(pack):
    seen = []

    class Looker(Tap):
        def due(self, k):
            return k

        def take(self, k, time, components):
            seen.append(k)

    package = pack(["mass Telling y:output", "inverse Dividing u:input y:output"], ["mass.y -> inverse.u"])
    falling = {"mass.x0": 1.0, "mass.u": -1.0}  # y = 1 - t, whose steps of 0.25 are exact: 0 in row 4, read in 5
    with (
        Simulator(package, isolate=False, algorithm="jacobi", parameters=falling) as simulator,
        pytest.raises(CosimError, match=r"y is inf at t = 1.25 s, expected a finite number") as failed,
    ):
        simulator.run(stop=2.0, step=0.25, taps=[Looker()])
    assert failed.value.results is not None
    assert seen == [*range(len(failed.value.results))] == [0, 1, 2, 3, 4]
