"""What Python units say alone: by pythonfmu's library, of states in JSON, and in phases of which it knows nothing."""

import ctypes as ct
import json

import pytest

H = 1e-3
BEFORE = "it is allowed only before enterInitializationMode"
AFTER = "it is allowed only after exitInitializationMode and before terminate"
BETWEEN = "it is allowed only between enterInitializationMode and exitInitializationMode"


@pytest.fixture
def version():
    return "python"


def test_a_call_in_the_wrong_phase_is_refused(open_unit, unit_name):
    unit, experiment = open_unit(unit_name), (0, 0.0, 0.0, 0, 0.0)
    for begin, calls in (
        (unit.setup, (("DoStep", AFTER, 0.0, H, 1), ("ExitInitializationMode", BETWEEN), ("Terminate", AFTER))),
        (unit.enter, (("DoStep", AFTER, 0.0, H, 1), ("SetupExperiment", BEFORE, *experiment),
                      ("EnterInitializationMode", BEFORE))),
        (lambda: unit.do("ExitInitializationMode").step(),
         (("SetupExperiment", BEFORE, *experiment), ("EnterInitializationMode", BEFORE),
          ("ExitInitializationMode", BETWEEN))),
        (lambda: unit.do("Terminate"), (("DoStep", AFTER, H, H, 1), ("Terminate", AFTER))),
    ):  # fmt: skip
        begin()
        before = unit.complete()
        for name, words, *arguments in calls:
            with unit.refuses(f"unit: {name[0].lower()}{name[1:]}.* failed: {words}") as no:
                no(name, *arguments)
        assert unit.complete() == before


def test_an_error_is_one_fatal_message_whatever_the_name_of_the_instance_holds(open_unit):
    """A percent sign must not reach the importer, whose printf would read arguments that are not there."""
    unit = open_unit("plant", name="arm 100%s %n 'a' \u00e4").start()
    (message,) = unit.messages
    assert (message.text, message.status) == ("arm 100 percents  percentn 'a' \u00e4: starts at t = 0 s", 0)
    with unit.refuses("^arm 100 percents  percentn 'a' \u00e4: doStep at t = 0 s failed: expected a finite pos") as no:
        no("DoStep", 0.0, -1.0, 1)
    head, _ = unit.messages[-1].text.splitlines()
    assert head == "Fatal py exception encountered: [doStep] PyObject_CallMethod"


def test_a_state_of_another_unit_or_robot_is_refused(open_unit):
    plant = open_unit("plant").start()
    before = plant.outputs()
    for other in (open_unit("controller"), open_unit("plant", "slider_3dof")):
        state = plant.deserialize(other.start().complete())
        with plant.refuses(r"unit: setFMUstate.* expected a state of Plant with GUID \{.*got one with GUID \{") as no:
            no("SetFMUstate", state)
        assert plant.outputs().tolist() == before.tolist()


@pytest.mark.parametrize(("change", "words"), [
    (lambda state: state | {"memory": state["memory"][:-1]}, r"the state is damaged: ValueError: .*reshape"),
    (lambda state: {"guid": state["guid"]}, r"the state is damaged: KeyError: 'phase'"),
    (lambda state: [1, 2, 3], r"expected a state of Plant with GUID .*, got something else"),
    (lambda state: state | {"guid": 3}, r"expected a state of Plant .*, got one with GUID 3"),
    (lambda state: state | {"phase": "ended"}, r"the state is damaged: KeyError"),
    (lambda state: state | {"solver": {}}, r"the state is damaged: KeyError: 'h'"),
])  # fmt: skip
def test_a_damaged_state_is_refused_and_changes_nothing(open_unit, change, words):
    unit = open_unit("plant").start(q_0=[0.3, -0.2]).step(H)
    saved = unit.complete()
    state = unit.deserialize(json.dumps(change(json.loads(saved))).encode())
    with unit.refuses(words) as no:
        no("SetFMUstate", state)
    assert unit.complete() == saved


@pytest.mark.parametrize("data", [b"", b"abc", b"{", b"\xff\xfe\x00", b"\x00" * 100])
def test_bytes_that_are_no_state_are_refused(open_unit, data):
    unit, pointer = open_unit("plant").start(), ct.c_void_p()
    words = rf"deSerializeFMUstate failed: expected the bytes of a state, got {len(data)} other bytes"
    with unit.refuses(words) as no:
        no("DeSerializeFMUstate", data, len(data), ct.byref(pointer))
