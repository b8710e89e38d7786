"""Looking at what others made runs nothing of it; the user's own is run again, and the rest if they say so."""

import shutil
from contextlib import chdir, nullcontext, suppress

import pytest

from tests.hostile import foreign, unpacked
from tests.hostile.results import arm_run
from tests.hostile.studies import done_study
from vdfmu.base import cache
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.study.report.shown_run import read_run
from vdfmu.study.report.simulation import NOT_MADE, simulation_of
from vdfmu.study.sweeps.sweep import Sweep


@pytest.mark.parametrize("number", range(len(foreign.LOOKS)), ids=[each.__name__ for each in foreign.LOOKS])
def test_a_look_runs_nothing_and_writes_nothing_elsewhere(number, tmp_path):
    try:
        foreign.look(number, tmp_path)
    except UsageError as refused:
        assert " must be " in str(refused) or "--trust" in str(refused)


def test_what_the_user_trusts_runs(tmp_path):
    attempt = foreign.point_code(tmp_path / "given", "--trust")
    assert not (tmp_path / "ran").exists()
    with chdir(tmp_path), suppress(VdfmuError):  # the code is no unit
        attempt()
    assert (tmp_path / "ran").exists()


def test_a_run_and_a_study_of_this_user_run_again(tmp_path, monkeypatch):
    run, study = read_run(arm_run()), Sweep(done_study())
    assert simulation_of(run, None)["reason"] == NOT_MADE
    assert study.options(0)["parameters"]
    moved = Sweep(shutil.copytree(done_study(), tmp_path / "moved"))
    with pytest.raises(UsageError, match=r"was not run, because the study was made elsewhere.*--trust"):
        moved.options(0)
    assert moved.options(0, trust=True)["parameters"] == study.options(0)["parameters"]
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_NEW_KEY", b"key of another process")
    assert "this cache has no simulation of it" in simulation_of(run, None)["reason"]
    with pytest.raises(UsageError, match="--trust"):
        study.options(0)


@pytest.mark.few(5)
@pytest.mark.parametrize("number", range(len(unpacked.MAKERS)), ids=[each.__name__ for each in unpacked.MAKERS])
def test_a_log_that_unpacks_to_much_is_refused_and_no_other_file_is_read(number, tmp_path, monkeypatch):
    """4,096 chunks are few enough to be read."""
    monkeypatch.setattr("vdfmu.base.foreign.LEAST", 2**20)
    make = [*unpacked.MAKERS][number]
    words = "" if make is unpacked.small_chunks else unpacked.MAKERS[make]
    monkeypatch.setitem(unpacked.MAKERS, make, words)
    with pytest.raises(UsageError, match=words) if words else nullcontext():
        unpacked.read(number, tmp_path, 4)
