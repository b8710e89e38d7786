"""A power failure at any moment of a study loses no point that is done, and the study goes on."""

import os
import sys

import numpy as np
import pytest

from tests.power import Power
from vdfmu.study.sweeps.ledger import Ledger, table_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the names of open files from /proc")
FACTS = {"n": 4, "axes": ["x=values"], "measures": {"y": "final(y)"}}
POINTS = {"x": np.arange(4.0)}


def rows(*points):
    return [{"point": k, "failed": None, "failed_at": None, "wall_s": 0.1, "y": 2.0 * k} for k in points]


def ledger(folder):
    return Ledger(folder, FACTS, "key", POINTS)


def resumed(folder, promised):
    """Go on with a study after a power failure, and return its table; points that are `promised` are there."""
    with ledger(folder) as again:
        done = again.done()
        assert done[promised].all(), (promised, done)
        for k in np.flatnonzero(~done).tolist():
            again.add(rows(k))
        return table_of(again.finish()).to_pydict()


def lasting(tmp_path, monkeypatch):
    root = tmp_path / "disk"
    root.mkdir()
    with monkeypatch.context() as patch:
        power = Power(root, patch)
        with ledger(root / "results" / "study") as study:
            for first in (0, 2):
                study.add(rows(first, first + 1))
                power.done([first, first + 1])
            whole = table_of(study.finish()).to_pydict()
    monkeypatch.setattr(os, "fsync", lambda handle: None)  # slow, and the power stays on from here
    count = 0
    for promised, folder in power.states(tmp_path):
        assert resumed(folder / "results" / "study", sum(promised, [])) == whole
        count += 1
    return count


def test_a_study_that_loses_power_keeps_its_points_and_goes_on(tmp_path, monkeypatch):
    # seven files and folders are made and some removed, each in some steps
    assert lasting(tmp_path, monkeypatch) > 15
