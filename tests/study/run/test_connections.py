"""Connections that a run adds to its scenario, or replaces: `connections`, ``--connect``."""

import json

import pytest

import vdfmu
from tests.conftest import ran
from tests.warm import command
from vdfmu.base.errors import UsageError
from vdfmu.study.report.page import run_command
from vdfmu.study.run.prepare import prepare
from vdfmu.study.sweeps.plan import make_plan

OWN = """from vdfmu.unit import JOINTS, Input, Output, Unit

class Own(Unit):
    wanted = Input("position", JOINTS, "desired position, by another name")
    measured = Input("position", JOINTS, "position, by another name")
    torque = Output("N.m", JOINTS, "torque of the motor, by another name")

    def outputs(self) -> None:
        self.torque = 20.0 * (self.wanted - self.measured)
"""
PAIRS = [
    ("trajectory.q_d", "controller.wanted"),
    ("plant.q", "controller.measured"),
    ("controller.torque", "plant.tau"),
]


@pytest.fixture
def renamed(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN, encoding="utf-8")
    return {"controller": path}


def test_an_input_loses_the_connection_that_it_had():
    before = prepare("planar_tracking").system.connections
    assert "controller.q" in before["plant.q"]
    after = prepare("planar_tracking", connections={"trajectory.q_d": ["controller.q", "controller.q_d"]}).system
    assert "controller.q" not in after.connections["plant.q"]
    assert after.connections["trajectory.q_d"][-2:] == ["controller.q", "controller.q_d"]
    assert after.fed.keys() == {end for ends in before.values() for end in ends}


def test_a_unit_whose_signals_have_other_names_is_connected(renamed):
    with pytest.raises(UsageError, match="controller: none of its signals fits the system"):
        prepare("planar_tracking", units=renamed)
    scenario = prepare("planar_tracking", units=renamed, connections=PAIRS)
    assert not scenario.system.unfed
    assert scenario.system.fed["plant.tau"] == "controller.torque"
    results = vdfmu.run("planar_tracking", units=renamed, connections=PAIRS, stop=0.01, reference=False, out=False)
    error = results["trajectory.q_d"] - results["plant.q"]
    assert results["controller.torque"] == pytest.approx(20.0 * error, abs=1e-3)  # a step later
    assert results.summary["connections"] == [f"{source} -> {target}" for source, target in PAIRS]
    words = run_command(results.summary).split()
    assert [word for word in words if "=" in word][1:] == ["=".join(pair) for pair in PAIRS]


def test_an_input_that_nothing_feeds_is_refused_unless_it_is_connected_or_set_or_the_user_says_so(renamed):
    renamed["controller"].write_text(OWN.replace("torque =", "tau =").replace("self.torque", "self.tau"))
    measured, wanted = {"plant.q": "controller.measured"}, {"trajectory.q_d": "controller.wanted"}
    said = "controller.wanted: expected a connected output, such as trajectory.q_d or plant.q, got none. --connect "
    with pytest.raises(UsageError, match=f"^{said}") as error:
        prepare("planar_tracking", units=renamed)
    assert len(str(error.value).splitlines()) == 2
    with pytest.raises(UsageError, match=f"^{said}"):
        prepare("planar_tracking", units=renamed, connections=measured)
    with pytest.raises(UsageError, match=r"^unfed: expected ok, got no\.$"):
        prepare("planar_tracking", units=renamed, unfed="no")
    values = {f"controller.wanted[{k}]": 0.1 for k in (1, 2)}
    prepare("planar_tracking", units=renamed, connections=measured, parameters=values)
    del values["controller.wanted[2]"]  # an element is not the input
    with pytest.raises(UsageError, match=f"^{said}"):
        prepare("planar_tracking", units=renamed, connections=measured, parameters=values)
    prepare("planar_tracking", ["controller.wanted"], units=renamed, connections=measured)  # an axis of a study
    assert prepare("planar_tracking", units=renamed, connections=measured | wanted).system.unfed == {}
    left = prepare("planar_tracking", units=renamed, connections=measured, unfed="ok").system.unfed
    assert left == {"controller.wanted": ["trajectory.q_d", "plant.q"]}


def test_an_output_of_a_component_is_no_candidate_for_its_own_input(renamed):
    text = OWN.replace("torque =", "tau =").replace("self.torque", "self.tau").replace("measured", "q")
    text = text.replace(
        "    def outputs(self)", '    q_hat = Output("position", JOINTS, "estimate")\n\n    def outputs(self)'
    )
    renamed["controller"].write_text(f"{text}        self.q_hat = self.q\n")
    with pytest.raises(
        UsageError, match=r"^controller\.wanted: expected a connected output, such as trajectory\.q_d, "
    ):
        prepare("planar_tracking", units=renamed)


def test_a_run_prints_a_short_table_of_the_connections_of_units(tmp_path):
    said = []
    units = {"controller": "PDController", "feedforward": "Feedforward"}
    vdfmu.run("planar_tracking", units=units, stop=0.001, reference=False, out=False, log=said.append)
    head, *rows, last = next(message.text for message in said if message.status == "connections").splitlines()
    assert head == "connections of controller, feedforward:"
    assert len(rows) == 12 and rows[0] == "  trajectory.q_d          -> feedforward.q_d"
    assert last == "  and 4 more, see system.ssp or --verbose"
    words = ["planar_tracking", "--unit", "controller=PDController", "--stop", "0.001", "--no-reference"]
    words += ["--out", tmp_path / "run"]
    assert "  plant.q                 -> controller.q\n" in ran("run", *words).output
    assert "->" not in ran("-q", "run", *words).output


def test_an_input_of_a_plant_that_a_unit_no_longer_feeds_is_refused(renamed):
    """The controller has its inputs, and its torque another name: the plant would move without a torque."""
    text = OWN.replace("wanted", "q_d").replace("measured", "q")
    renamed["controller"].write_text(text)
    said = r"^plant\.tau: expected a connected output, such as .*controller\.torque, got none\."
    with pytest.raises(UsageError, match=said):
        prepare("planar_tracking", units=renamed)
    scenario = prepare("planar_tracking", units=renamed, connections={"controller.torque": "plant.tau"})
    assert not scenario.system.unfed


def test_an_element_is_connected_apart_from_its_vector():
    connections = prepare("planar_tracking", connections={"plant.kappa[1]": "controller.q[1]"}).system.connections
    assert connections["plant.kappa[1]"] == ["controller.q[1]"] and connections["plant.q[2]"] == ["controller.q[2]"]
    assert "controller.q" not in connections["plant.q"] and "plant.q[1]" not in connections


def test_a_new_input_is_connected_to_the_only_output_that_fits_by_name_shape_and_unit(renamed):
    text = OWN.replace("torque =", "tau =").replace("self.torque", "self.tau")
    text = text.replace("wanted", "q_d").replace("measured", "kappa")
    renamed["controller"].write_text(text)
    system = prepare("planar_tracking", units=renamed).system
    assert system.joined == ("plant.kappa -> controller.kappa",)  # the unit has no terminals
    renamed["controller"].write_text(text.replace("kappa", "tau_s"))  # an output of two components, of another unit
    assert list(prepare("planar_tracking", units=renamed, unfed="ok").system.unfed) == ["controller.tau_s"]
    renamed["controller"].write_text(text.replace("kappa", "p_O"))  # of another shape
    assert list(prepare("planar_tracking", units=renamed, unfed="ok").system.unfed) == ["controller.p_O"]


@pytest.mark.parametrize(("source", "target", "said"), [
    ("plant.qq", "controller.q", "connections: plant.qq: expected an output of plant, got 'qq'. Did you mean \"q\"?"),
    ("plant.q", "controller.q_dd", "connections: controller.q_dd: expected an input of controller, got 'q_dd'."),
    ("plnt.q", "controller.q", "connections: plnt.q: expected component.signal, got 'plnt'. Did you mean \"plant\"?"),
    ("plant.q", "controller.q_dot", "expected one unit of measurement, got rad and rad/s."),
    ("plant.q[1]", "controller.q", "expected signals of the same shape"),
])  # fmt: skip
def test_what_cannot_be_connected_is_named(source, target, said):
    with pytest.raises(UsageError) as error:
        prepare("planar_tracking", connections={source: target})
    assert said in str(error.value)


@pytest.mark.heavy
def test_load_and_sweep_take_connections(renamed):
    added = {"plant.q": "controller.q_d"}
    system = vdfmu.load("planar_tracking", added)
    assert "plant.q -> controller.q_d (2)" in system.connections
    assert "trajectory.q_d -> controller.q_d (2)" not in system.connections
    plan = make_plan(
        "planar_tracking",
        {"plant.mass": "*0.9, 1.1"},
        stop=0.02,
        measure=["e=peak(plant.q)"],
        units=renamed,
        connections=PAIRS,
    )
    assert plan.facts["options"]["connections"] == [list(pair) for pair in PAIRS]
    assert len(plan.job.systems) == 1


@pytest.mark.heavy
def test_a_point_of_a_study_is_run_with_its_connections(renamed, tmp_path):
    study = vdfmu.sweep(
        "planar_tracking", {"plant.mass": "*0.9, 1.1"}, stop=0.02, measure=["e=peak(plant.q)"], units=renamed,
        connections=PAIRS, out=tmp_path / "study",
    )  # fmt: skip
    done = command("run", "--from", str(study.folder), "--no-reference", "--no-simulate", "--out", "again",
                   "--connect", "trajectory.q_d=feedforward.q_d", cwd=tmp_path)  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    summary = json.loads((tmp_path / "again" / "summary.json").read_text())
    pairs = [*PAIRS, ("trajectory.q_d", "feedforward.q_d")]
    assert summary["connections"] == [f"{source} -> {target}" for source, target in pairs]
