"""What limits a scenario: each row is the run that its words name."""

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import UsageError
from vdfmu.study.environment.arm import opened
from vdfmu.study.run import error_budget as module

FRICTION = ("f_c", "f_s", "f_v", "f_ck")


def test_rows_are_runs_with_one_cause_changed():
    found = {row.cause: row for row in vdfmu.error_budget("planar_tracking", stop=0.5)}
    assert list(found) == [
        "As it is", "Sampled 4 times as often", "No friction, and none expected",
        "Drives 4 times as stiff, and known to be",
    ]  # fmt: skip
    none = {f"robot.{name}": 0.0 for name in FRICTION if f"robot.{name}" in _parameters()}
    for cause, changed in {
        "As it is": {},
        "Sampled 4 times as often": {"step": 2.5e-4},
        "No friction, and none expected": {"settings": none},
    }.items():
        options = {"stop": 0.5, "out": False, "reference": False, **changed}
        run = vdfmu.run("planar_tracking", **options)
        # the same FMUs, steps and start values: the same bits
        assert found[cause].largest == run.summary["key_figures"]["tool_error"]["value"]
        assert 0.0 < found[cause].rms < found[cause].largest


def _parameters() -> set[str]:
    scenario = vdfmu.load_scenario("planar_tracking")
    return {f"robot.{v.group}" for v in scenario.resolved.tables["plant"]}


def test_a_cause_whose_run_fails_says_why(monkeypatch):
    wild = {"words": "Wild", "changes": [{"unit": "controller", "name": "K_v", "factor": 1e9}]}
    monkeypatch.setattr(module, "causes", lambda *_: iter([wild]))
    first, last = vdfmu.error_budget("planar_tracking", stop=0.2)
    assert not first.failed and last.cause == "Wild" and "s in doStep: " in last.failed and np.isnan(last.largest)


def test_a_scenario_without_a_motion_is_refused():
    alone = opened(vdfmu.load_scenario("planar_tracking"), "plant.tau", ("plant.q",))
    with pytest.raises(UsageError, match=r"expected an arm that follows a motion, with trajectory\.q_d and plant\.q"):
        vdfmu.error_budget(alone)


def test_a_plant_of_another_geometry_is_refused():
    """The joints' errors would be some micrometres of the tool's, whose links are a centimetre longer."""
    with pytest.raises(UsageError, match=r"planar_tracking: expected a plant with the geometry of planar_2dof"):
        vdfmu.error_budget("planar_tracking", settings={"plant.offset[2,1]": 0.51}, backend="python")
