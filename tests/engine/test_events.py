"""What is not smooth under the algorithms for continuous coupling: discrete signals, jumps, tiny signals."""

import numpy as np
import pytest

from tests.engine.files import edited
from vdfmu.base.errors import CosimError
from vdfmu.engine.run import simulate

ROUNDING = 1e-14  # some roundings of numbers of order 1


@pytest.mark.heavy
def test_what_is_discrete_is_read_as_at_the_start_of_the_step_by_units_before_its_source(pack):
    """Whatever the number of repetitions, and after rejected steps: b reads a's counter, a steps after b."""
    path = pack(
        ["plant Clock u:input y:output n:output:Integer",
         "gain Reader u:input i:input:Integer y:output seen:output:Integer"],
        ["plant.n -> gain.i", "plant.y -> gain.u", "gain.y -> plant.u"],
    )  # fmt: skip
    for options in ({}, {"convergence": 0.5}, {"adaptive": 1e-6}):
        results = simulate(path, stop=4.0, step=1.0, algorithm="iterative", **options)
        assert results["plant.n"].tolist() == [0, 1, 2, 3, 4]
        # n is the whole number of seconds; at the start of the last step of a row it is that of the row before
        assert results["gain.seen"].tolist() == [0, 0, 1, 2, 3]
    assert results.summary["communication"]["rejected"] > 0


@pytest.mark.heavy
def test_a_discrete_real_acts_from_its_change_on_and_a_discrete_controller_holds_it(pack):
    path = pack(["jump Jump y:output", "plant Plant u:input y:output"], ["jump.y -> plant.u"])
    for options in ({"algorithm": "extrapolated"}, {"algorithm": "iterative"}, {"adaptive": 1e-3}):
        results = simulate(path, stop=1.0, step=0.25, **{"algorithm": "iterative", **options})
        assert results["jump.y"].tolist() == [0, 0, 1, 1, 1]  # jumps at 0.5 s
        np.testing.assert_allclose(results["plant.y"], [0, 0, 0, 0.25, 0.5], rtol=0, atol=ROUNDING)
    # It is the zero-order hold that `gauss-seidel` is, whatever the order of the units: x' = -3 x(t_k).
    units = ["plant Plant u:input y:output", "digital Digital x:input u:output"]
    for elements in (units, units[::-1]):
        path = pack(elements, ["plant.y -> digital.x", "digital.u -> plant.u"])
        for algorithm in ("gauss-seidel", "extrapolated", "iterative"):
            results = simulate(
                path, stop=1.0, step=0.125, algorithm=algorithm, parameters={"plant.x0": 1.0, "digital.k": -3.0}
            )
            expected = (1 - 3 * 0.125) ** np.arange(9)
            np.testing.assert_allclose(results["plant.y"], expected, rtol=0, atol=ROUNDING)
        # nothing to repeat; the controller, which passes x on, steps in halves
        assert results.summary["communication"]["unit_steps"] == 8 + 2 * 8


@pytest.mark.parametrize("motor", ["Motor", "DirectMotor"])
def test_a_switch_in_a_loop_acts_from_the_next_step_on(pack, xml, motor):
    """A relay holds the state of an integrator between -0.1 and 0.1; it acts a step late, and always converges."""
    c = xml.component
    path = pack(
        ["relay Relay u:input up:output:Boolean", c("plant", motor, "up:input:Boolean y:output")],
        ["plant.y -> relay.u", "relay.up -> plant.up"],
    )
    h = 2**-6
    y = simulate(path, stop=4.0, step=h, algorithm="iterative")["plant.y"]
    turns = np.count_nonzero(np.diff(np.sign(np.diff(y))))
    # from one end to the other, up to two steps too far on either side
    assert 4.1 / (0.2 + 4 * h) - 1 <= turns <= 4.1 / 0.2
    assert 0.1 < np.abs(y).max() <= 0.1 + 2 * h  # a step to see it, and one to act


def test_error_control_finds_when_a_discrete_signal_changes(pack):
    """An integrator that a relay drives: its times of switching, and with them the values, are as in closed form."""
    path = pack(
        ["relay Relay u:input up:output:Boolean", "plant Motor up:input:Boolean y:output"],
        ["plant.y -> relay.u", "relay.up -> plant.up"],
    )
    longest = 0.05
    results = simulate(path, stop=2.0, step=longest, algorithm="iterative", adaptive=1e-3)
    # a triangle between -0.1 and 0.1 of slope 1, from 0 upwards
    phase = (results.time + 0.1) % 0.4
    expected = np.where(phase < 0.2, phase - 0.1, 0.3 - phase)
    # each of ten switches is late by at most five shortest steps, and so is each value after it, twice
    np.testing.assert_allclose(results["plant.y"], expected, rtol=0, atol=10 * 2 * 5 * 1e-6 * longest)
    assert results.summary["communication"]["jumps"] == 10


def test_a_signal_that_changes_with_every_step_is_not_looked_for(pack):
    path = pack(
        ["plant Plant u:input y:output", "digital Digital x:input u:output"],
        ["plant.y -> digital.x", "digital.u -> plant.u"],
    )
    results = simulate(
        path, stop=1.0, step=0.1, algorithm="iterative", adaptive=1e-2, parameters={"plant.x0": 1.0, "digital.k": -1.0}
    )
    assert results.summary["communication"]["steps"] < 100
    # zero-order hold at steps that error control has chosen: of first order in them
    longest = results.summary["communication"]["longest_step"]
    assert np.abs(results["plant.y"] - np.exp(-results.time)).max() <= longest


@pytest.mark.parametrize("algorithm", ["extrapolated", "iterative"])
def test_booleans_and_integers_are_passed_without_delay(pack, algorithm):
    path = pack(
        ["logic Logic bi:input:Boolean ii:input:Integer bo:output:Boolean io:output:Integer",
         "count Counter n:output:Integer odd:output:Boolean"],
        ["count.n -> logic.ii", "count.odd -> logic.bi"],
    )  # fmt: skip
    results = simulate(path, stop=4.0, step=1.0, algorithm=algorithm)
    assert results["logic.io"].tolist() == [1, 2, 3, 4, 5]
    assert results["logic.bo"].tolist() == [True, False, True, False, True]


def test_a_signal_that_jumps_again_and_again_is_named(pack):
    path = pack(
        ["count Mixed u:input y:output z:output", "plant Plant u:input y:output"],
        ["count.y -> plant.u", "plant.y -> count.u"],
    )  # y counts the steps
    with pytest.raises(CosimError, match=r"count failed .*the error of y in a step of .* the signal jumps repeatedly"):
        simulate(path, stop=1.0, step=0.25, algorithm="extrapolated", adaptive=1e-3)


@pytest.mark.heavy
@pytest.mark.parametrize("at", [0.5, 0.537])
def test_a_jump_is_stepped_over_where_it_is(pack, at):
    """A step of a signal that declares itself continuous, into x' = u - x: found to 1e-6 of the longest step."""
    path = pack(["jump Late y:output", "lag Lag u:input y:output"], ["jump.y -> lag.u"])
    options = {"stop": 2.0, "step": 0.25, "parameters": {"jump.at": at}, "adaptive": 1e-4}
    for algorithm in ("extrapolated", "iterative"):
        results = simulate(path, algorithm=algorithm, **options)
        assert results.summary["communication"]["jumps"] == 1
        expected = np.where(results.time > at, 1.0 - np.exp(-np.maximum(results.time - at, 0.0)), 0.0)
        # the longest step times 1e-6, and the error control's own 1e-4, which the lag forgets within 1 s
        np.testing.assert_allclose(results["lag.y"], expected, rtol=0, atol=2e-4)


@pytest.mark.heavy
def test_signals_too_small_for_the_allowed_error_are_noted(pack):
    path = pack(
        ["plant Plant u:input y:output", "gain Gain u:input y:output"], ["plant.y -> gain.u", "gain.y -> plant.u"]
    )
    small = {"plant.x0": 1e-12, "gain.k": -20.0}

    def notes(parameters, **options):
        results = simulate(path, stop=1.0, step=0.1, algorithm="iterative", parameters=parameters, **options)
        return [note for note in results.summary["notes"] if "nominal" in note]

    (note,) = notes(small)
    assert note.startswith("plant.y, gain.y: smaller than 1e-07 all the time")
    assert notes(small, convergence=1e-20) == []
    assert notes({**small, "plant.x0": 1.0}) == []
    assert notes({"plant.x0": 0.0}) == []
    (note,) = notes({**small, "plant.x0": 1e-3}, adaptive=1e-3)
    assert "an error of 0.001 relative to 1 is allowed" in note


@pytest.mark.heavy
def test_an_output_that_nobody_reads_does_not_decide_how_the_others_are_coupled(pack):
    """X' = -x / 2 with u = -x / 2; the unit also tells u, which would be right for its value at the end only."""
    # where it is read, it decides, and the unit steps in halves
    for output, wire in (("", []), (" told:output", ["mass.told -> end.u"])):
        path = pack(
            [f"mass Telling u:input y:output{output}", "spring Gain u:input y:output", "end Gain u:input"],
            ["mass.y -> spring.u", "spring.y -> mass.u", *wire],
        )
        errors, options = [], {"algorithm": "iterative", "parameters": {"mass.x0": 1.0, "spring.k": -0.5}}
        for step in (0.125, 0.0625):
            results = simulate(path, stop=2.0, step=step, record=["*"], **options)
            if output:
                np.testing.assert_array_equal(results["mass.told"], results["mass.u"])  # of the end of the step
            errors.append(np.abs(results["mass.y"] - np.exp(-0.5 * results.time)).max())
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)  # second order
        assert output or not any("first order" in note for note in results.summary["notes"])


@pytest.mark.heavy
def test_a_unit_of_one_step_length_that_may_integrate_what_it_passes_through_is_noted(pack, fmus):
    key = b'canHandleVariableCommunicationStepSize="'
    rigid = edited(fmus["Stock"], [(key + b"true", key + b"false")])
    path = pack(["r Ramp y:output", "a Rigid u:input y:output"], ["r.y -> a.u"], extra={"resources/Rigid.fmu": rigid})
    notes = simulate(path, stop=1.0, step=0.25, algorithm="extrapolated").summary["notes"]
    assert any(note.startswith("a: takes no derivatives of its inputs") and "first order" in note for note in notes)
    notes = simulate(path, stop=1.0, step=0.25).summary["notes"]
    assert not any("first order" in note for note in notes)


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
def test_texts_are_passed_on(pack, algorithm):
    """As other discrete signals are: what passes them through passes fresh ones, except for jacobi."""
    path = pack(
        ["speaker Speaker word:output:String", "echo Echo word:input:String again:output:String",
         "listener Listener word:input:String n:output:Integer"],
        ["speaker.word -> echo.word", "echo.again -> listener.word"],
    )  # fmt: skip
    results = simulate(path, stop=4.0, step=1.0, algorithm=algorithm)
    # the speaker says one letter more each second, of two bytes each; the listener counts them
    late = {"gauss-seidel": [0, 0, 1, 2, 3], "jacobi": [0, 0, 0, 1, 2]}
    assert results["listener.n"].tolist() == late.get(algorithm, [0, 1, 2, 3, 4])
    assert "speaker.word" not in results  # tables hold numbers
