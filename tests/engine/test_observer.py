"""Who looks at a run is given its rows, all or now and then, and never changes it."""

from __future__ import annotations

import numpy as np
import pytest

from vdfmu.base.errors import CosimError
from vdfmu.engine.masters.observer import visited
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.run import simulate


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


def test_a_period_leaves_rows_out_and_names_may_be_missing(fragile):
    watcher = Watcher(wanted=["source.*", "nobody.q[*]"], period=3600.0)
    simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 9.0}, observer=watcher)
    assert watcher.names == ["source.y"]
    assert [time for time, _ in watcher.rows] == [0.0]


def test_of_a_run_that_fails_the_rows_so_far_are_seen(fragile):
    watcher = Watcher()
    with pytest.raises(CosimError):
        simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 0.5, "arm.mode": 0}, observer=watcher)
    assert len(watcher.rows) == len(watcher.results) == 6


def test_an_observer_needs_nothing_but_row(fragile):
    class Rows:
        def __init__(self):
            self.sizes = []

        def row(self, time, values):
            self.sizes.append(values.size)

    rows = Rows()
    results = simulate(fragile, stop=1.0, step=0.1, parameters={"arm.at": 9.0}, observer=rows)
    assert rows.sizes == [sum(kind == "real" for kind in results.kinds.values())] * 11


def test_a_visitor_is_told_the_time_of_its_rows():
    class Visitor:
        seen = []

        def rows(self, n):
            return range(1, n, 2)

        def visit(self, components, time, step):
            self.seen.append((components, time, step))

    stored = []
    storing = visited(Visitor(), "components", Grid(1.0, 2.25, 0.25, 5), stored.append)
    for k in range(5):
        storing(k)
    assert stored == list(range(5))
    assert Visitor.seen == [("components", 1.25, 0.25), ("components", 1.75, 0.25)]
