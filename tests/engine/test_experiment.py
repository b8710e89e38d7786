"""What is not given to `simulate` is taken from the default experiment of the system."""

import json

import pytest

from vdfmu.base.errors import UsageError
from vdfmu.engine.package.parse import FOREIGN
from vdfmu.engine.package_run import run_system
from vdfmu.engine.run import simulate

EXPERIMENT = (
    '<ssd:DefaultExperiment startTime="1" stopTime="2"><ssd:Annotations>'
    '<ssc:Annotation type="org.vdfmu.experiment">'
    f'<own:Experiment xmlns:own="{FOREIGN["vdfmu"]}" {{}}/></ssc:Annotation>'
    "</ssd:Annotations></ssd:DefaultExperiment>"
)


@pytest.fixture
def packed(pack, xml):
    c = xml.component
    elements = [
        c("plant", "Plant", "u:input y:output", xml.values(xml.real("x0", 1.0))),
        c("gain", "Gain", "u:input y:output", xml.values(xml.real("k", -1.0))),
    ]

    def write(annotation=None):
        experiment = '<ssd:DefaultExperiment startTime="1" stopTime="2"/>'
        if annotation is not None:
            experiment = EXPERIMENT.format(annotation)
        return pack(elements, ["plant.y -> gain.u", "gain.y -> plant.u"], experiment=experiment)

    return write


def test_the_annotation_says_how_it_is_run_and_what_is_given_wins(packed):
    path = packed('communicationStepSize="0.25" algorithm="jacobi"')
    results = simulate(path)
    assert results.time.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert results.summary["algorithm"] == "jacobi"
    # one step late: y[k+1] = y[k] - h y[k-1], from y = 1 with the input of the start
    assert results["plant.y"].tolist() == [1.0, 0.75, 0.5, 0.3125, 0.1875]
    path = packed('communicationStepSize="0.25" algorithm="iterative" adaptive="0.1"')
    results = simulate(path, start=0.0, stop=1.0, step=0.5, algorithm="gauss-seidel")  # and adaptive is not for it
    assert results.time.tolist() == [0.0, 0.5, 1.0]
    assert results["plant.y"].tolist() == [1.0, 0.5, 0.25]
    assert results.summary["adaptive"] is None


@pytest.mark.heavy
def test_the_error_control_of_the_annotation_is_that_of_its_algorithm(packed):
    path = packed('communicationStepSize="0.25" algorithm="iterative" adaptive="1e-3"')
    controlled = simulate(path)
    assert (controlled.summary["algorithm"], controlled.summary["adaptive"]) == ("iterative", 1e-3)
    loose = simulate(path, adaptive=0.5).summary
    assert loose["adaptive"] == 0.5
    assert controlled.summary["communication"]["steps"] > loose["communication"]["steps"] > 4
    assert simulate(path, algorithm="iterative").summary["communication"]["steps"] == 4


def test_without_annotation_a_step_is_needed(packed):
    path = packed()
    with pytest.raises(UsageError, match="step: expected a communication step, because"):
        simulate(path)
    assert simulate(path, step=0.5).summary["algorithm"] == "gauss-seidel"


def test_a_parameter_without_index_is_that_of_all_elements_and_one_that_is_overruled_noted(pack):
    path = pack(["a Array"])
    results = simulate(path, step=1.0, parameters={"a.k": 3.0, "a.k[2]": "4"})
    assert results["a.y"][-1] == 34.0
    with pytest.raises(UsageError) as info:
        simulate(path, step=1.0, parameters={"a.k": "x", "a.kk": 1.0})
    assert str(info.value).splitlines() == [
        "parameter 'a.k': expected a number, got 'x'.",
        "parameter 'a.kk': a has no variable 'kk'; did you mean k? Its parameters: k.",
    ]
    path = pack(
        ["d Derived twice:calculatedParameter", "g Gain k:parameter u:input y:output", "r Ramp y:output"],
        ["d.twice -> g.k", "r.y -> g.u"],
    )
    results = simulate(path, step=0.5, parameters={"g.k": 50.0, "g.u": 7.0}, record=["*"])
    assert results["g.y"][-1] == 2.0 * results["g.u"][-1]
    assert [note for note in results.summary["notes"] if "no effect" in note] == [
        "g.k: the value that was given has no effect, because d.twice is connected to it",
        "g.u: the value that was given has no effect, because r.y is connected to it",
    ]


def test_a_picture_that_cannot_be_drawn_is_a_note_and_the_results_stay(packed, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise ValueError("no ink")

    pytest.importorskip("vdfmu.extras.pictures")
    monkeypatch.setattr("vdfmu.extras.pictures.picture.draw", fail)
    said = []
    path = packed('communicationStepSize="0.25"')
    run_system(path, out=tmp_path / "out", log=said.append, pictures=["png"])
    note = "the picture could not be drawn: no ink"
    assert [message.text for message in said if message.status == "note"][-1] == note
    assert note in json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert len((tmp_path / "out" / "results.csv").read_text().splitlines()) == 2 + 5
