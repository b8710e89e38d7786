"""Every key that a run writes into its summary is declared, with the type of its value."""

import json
from collections.abc import Mapping

import pytest

import vdfmu
from vdfmu.base.errors import UsageError
from vdfmu.engine.package_run import run_system
from vdfmu.study.run.summary_keys import KEYS, Keyed, List, Record, read_summary, typed


def undeclared(value, of, where=""):
    if isinstance(of, Record):
        of = {**of.of, **of.also}
    if isinstance(of, Mapping):
        for key, entry in (value or {}).items():
            yield from undeclared(entry, of[key], f"{where}.{key}") if key in of else [f"{where}.{key}"]
    elif isinstance(of, List | Keyed) and value is not None:
        for entry in value.values() if isinstance(of, Keyed) else value:
            yield from undeclared(entry, of.of, where)


@pytest.mark.heavy
def test_each_key_of_a_summary_is_declared(tmp_path, planar_run):
    runs = {name: tmp_path / name for name in ("estimation", "own", "simulate")}
    short = {"stop": 0.02, "reference": False}
    vdfmu.run("estimation", out=runs["estimation"], algorithm="iterative", adaptive=1e-4, **short)
    vdfmu.run("planar_tracking", out=runs["own"], formats=["csv", "parquet"], backend="python", **short)
    run_system(planar_run[0] / "system.ssp", stop=0.02, out=runs["simulate"], isolate=True)

    for folder in (planar_run[0], *runs.values()):
        file = folder / "summary.json"
        assert list(undeclared(json.loads(file.read_text()), KEYS)) == []
        assert read_summary(file)


@pytest.mark.parametrize(("faulty", "said"), [
    ({"separation": {"change": 1.0}}, "separation.max_position_difference_rad: is missing"),
    (
        {"verdict": {"state": "good", "headline": "", "results": "",
                         "checks": [{"key": "a", "name": "a", "state": "good"}]}},
        "verdict.checks[1].sentence: is missing",
    ),
    ({"position_units": ["deg", "ft"]}, 'position_units[2]: expected deg or mm, got "ft"'),
    ({"power_bond": 3}, "power_bond: expected a table, got 3"),
])  # fmt: skip
def test_faults_of_a_summary_are_said(faulty, said):
    assert typed(faulty, KEYS)[1] == [said]


def test_factors_of_joints_and_old_names_are_read_and_a_later_version_is_refused(tmp_path, planar_run):
    summary = planar_run[1].summary | {"plant_factors": {"mass": [1.1, 0.9]}}
    file = tmp_path / "summary.json"
    file.write_text(json.dumps(summary))
    assert read_summary(file)["plant_factors"] == {"mass": [1.1, 0.9]}
    file.write_text(json.dumps({"master": "jacobi", "settings": {"plant.mass": "2"}}))  # of an earlier version
    assert read_summary(file) == {"algorithm": "jacobi", "parameters": {"plant.mass": "2"}}
    file.write_text(json.dumps(planar_run[1].summary | {"format": 2}))
    with pytest.raises(UsageError, match=r"summary.json: format: expected 1, got 2. A version later than"):
        read_summary(file)
