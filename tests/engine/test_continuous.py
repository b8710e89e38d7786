"""Algorithms for continuous coupling: by hand on small systems, and their order on the manipulator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.engine.files import edited
from vdfmu.base.errors import CosimError, SspError, UsageError
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.run import simulate

# A plant x' = u under u = G r + K (r - x), r = 0.3 t. No unit takes derivatives of its inputs, so the plant gets the
# mean of the torques at both ends of the step, which for x' = u is the integral of the line between them.
H, G, K = 0.125, 0.75, 1.5  # K is that of `loop`
ROUNDING = 1e-14  # some ten operations on numbers of order 1


def run(path, algorithm, **options):
    parameters = {"trajectory.slope": 0.3, "feedforward.k": G, "plant.x0": 0.1}
    return simulate(path, stop=2.0, step=H, algorithm=algorithm, parameters=parameters, record=["*"], **options)


def test_extrapolated_predicts_what_is_not_computed_yet_and_runs_on_a_line(loop):
    results = run(loop, "extrapolated")
    n = 16
    r = 0.3 * (H * np.arange(n + 1))
    x, tau = np.empty(n + 1), np.empty(n + 1)
    x[0], tau[0] = 0.1, (G + K) * r[0] - K * 0.1
    for k in range(n):
        predicted = 2 * x[k] - x[k - 1] if k else x[0]
        tau[k + 1] = (G + K) * r[k + 1] - K * predicted
        x[k + 1] = x[k] + H * 0.5 * (tau[k] + tau[k + 1])
    np.testing.assert_allclose(results["plant.y"], x, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(results["controller.y"], tau, rtol=0, atol=ROUNDING)
    # a row holds what an input was at the end of the step
    np.testing.assert_array_equal(results["plant.u"], results["controller.y"])
    # of the units, three have feed-through and step in two halves
    assert results.summary["communication"] == {
        "steps": n, "convergence": None, "rejected": 0, "jumps": 0, "unit_steps": (2 + 3 * 2) * n, "shortest_step": H,
        "longest_step": H,
    }  # fmt: skip


def test_iterative_is_the_trapezoidal_rule_and_units_outside_a_loop_step_once(loop):
    convergence = 1e-12
    results = run(loop, "iterative", convergence=convergence)
    n = 16
    r = 0.3 * (H * np.arange(n + 1))
    x = np.empty(n + 1)
    x[0] = 0.1
    for k in range(n):  # x' = (G + K) r - K x, solved for the new x
        right_side = x[k] + 0.5 * H * ((G + K) * (r[k] + r[k + 1]) - K * x[k])
        x[k + 1] = right_side / (1 + 0.5 * H * K)
    # a step leaves at most the last change, times the contraction K H / 2 < 0.1; 16 steps add up
    np.testing.assert_allclose(results["plant.y"], x, rtol=0, atol=16 * 0.1 * convergence + ROUNDING)
    feedback = (G + K) * r - K * results["plant.y"]
    np.testing.assert_allclose(results["controller.y"], feedback, rtol=0, atol=K * convergence + ROUNDING)
    # Trajectory and feedforward feed the loop and are not in it; the others are linear, which takes 3 sweeps.
    # Units with feed-through step in two halves: the feedforward, and the two in the loop beside the plant.
    summary = run(loop, "iterative").summary
    assert summary["order"][:2] == ["trajectory", "feedforward"]
    assert set(summary["order"][2:4]) == {"error", "controller"}
    first_step_learns = 3
    assert 3 * 16 + 5 * 16 <= summary["communication"]["unit_steps"] <= 3 * 16 + 5 * 2 * 16 + 5 * first_step_learns


@pytest.mark.heavy
def test_what_gauss_seidel_cannot_order(pack, xml):
    """Two units of two channels each, cross-connected: a loop of units that is none of variables."""
    c = xml.component
    both = "a:input b:input y:output z:output"
    path = pack(
        ["source Ramp y:output", c("p", "Crossed", both), c("q", "Crossed", both),
         "end Adder a:input b:input y:output"],
        ["source.y -> p.a", "source.y -> q.b", "p.y -> q.a", "q.z -> p.b", "p.z -> end.a", "q.y -> end.b"],
    )  # fmt: skip
    with pytest.raises(SspError, match="gauss-seidel cannot order"):
        simulate(path, stop=1.0, step=0.25)
    for algorithm in ("iterative", "extrapolated"):
        results = simulate(path, stop=1.0, step=0.25, algorithm=algorithm)
        r = results.time
        np.testing.assert_array_equal(results["q.y"], r + 2.0)
        # a line is predicted exactly from its second point on
        late = 2 if algorithm == "extrapolated" else 0
        np.testing.assert_array_equal(results["p.z"][late:], r[late:])


def test_a_system_without_connections(pack):
    path = pack(["source Ramp y:output"])
    for options in ({}, {"adaptive": 1e-3}):
        results = simulate(path, stop=1.0, step=0.25, algorithm="iterative", **options)
        np.testing.assert_allclose(results["source.y"], results.time, rtol=0, atol=ROUNDING)


@pytest.mark.heavy
def test_a_unit_that_refuses_long_steps_gets_shorter_ones_without_any_real_output_too(pack):
    path = pack(["source Ramp y:output", "plant Choosy u:input y:output"], ["source.y -> plant.u"])
    # pythonfmu calls a refusal the end of the simulation
    assert simulate(path, stop=1.0, step=0.5, algorithm="iterative").summary["ended"]["time"] == 0.0
    seen = []
    results = simulate(path, stop=1.0, step=0.5, algorithm="iterative", adaptive=0.5, log=seen.append)
    facts = results.summary["communication"]
    assert facts["rejected"] > 0
    assert facts["longest_step"] <= 0.1
    # u = t runs on a line: its integral is exact
    np.testing.assert_allclose(results["plant.y"], 0.5 * results.time**2, rtol=0, atol=100 * ROUNDING)
    assert not [m for m in seen if "too long" in m.text]  # it was no trouble
    path = pack(["counter Refuser n:output:Integer"])
    results = simulate(path, stop=1.0, step=0.5, algorithm="iterative", adaptive=1e-3)
    assert results.summary["communication"]["longest_step"] <= 0.1
    # the shortest step is 1e-11 of the run: 10 s, and refused, which pythonfmu calls the end of the simulation
    results = simulate(path, stop=1e12, step=1e12, algorithm="iterative", adaptive=1e-3)
    assert results.summary["ended"] == {"component": "counter", "time": 0.0}
    assert len(results) == 1


def test_saved_states_are_freed(loop, monkeypatch):
    calls = []
    call = Instance.call

    def counted(self, name, *arguments):
        calls.append(name)
        call(self, name, *arguments)

    monkeypatch.setattr(Instance, "call", counted)
    run(loop, "iterative", adaptive=1e-3, isolate=False)
    assert calls.count("FreeFMUstate") == calls.count("GetFMUstate") > 0


def test_a_repeated_step_says_things_once_and_a_fatal_refusal_is_final(pack):
    path = pack(
        ["plant Talker u:input y:output", "gain Gain u:input y:output"], ["plant.y -> gain.u", "gain.y -> plant.u"]
    )
    seen = []
    results = simulate(path, stop=1.0, step=0.25, algorithm="iterative", log=seen.append)
    assert results.summary["communication"]["unit_steps"] > 2 * 4
    assert [m.time for m in seen if m.text == "a step"] == [0.0, 0.25, 0.5, 0.75]
    path = pack(["source Ramp y:output", "arm Fragile y:output"])
    with pytest.raises(CosimError, match="status fatal") as info:
        simulate(path, stop=1.0, step=0.25, algorithm="iterative", adaptive=0.1, parameters={"arm.at": 0.5})
    assert len(info.value.results) == 3


def slider(pack, options, k=4.0):
    """Return the errors of a mass whose spring is pulled at its other end, and of what that end does with the force."""
    # The end moves with p' = cos(t) - f / 4, the mass with x'' = f, f = k (p - x); x is neither read nor passed on.
    path = pack(
        ["mass Sprung p:input f:output x:output v:output", "end Carrier f:input p:output"],
        ["end.p -> mass.p", "mass.f -> end.f"],
    )  # fmt: skip
    options = {"stop": 4.0, "algorithm": "iterative", "parameters": {"mass.k": k}} | options
    results = simulate(path, **options)

    def rates(t, y):
        p, x, v = y
        force = k * (p - x)
        return np.cos(t) - 0.25 * force, v, force

    exact = solve_ivp(rates, (0.0, 4.0), np.zeros(3), "DOP853", results.time, rtol=1e-12, atol=1e-12).y
    motion = np.array([results["end.p"], results["mass.x"], results["mass.v"]])
    return np.abs(motion - exact).max(), results.summary


@pytest.mark.heavy
def test_a_mass_behind_a_spring_is_of_second_order_without_input_derivatives(pack):
    """State and feed-through of one input: it steps in halves, with the input at the start and at the end."""
    coarse, summary = slider(pack, {"step": 0.0625})
    fine, _ = slider(pack, {"step": 0.03125})
    # an error of order 2 falls by 4 (1 + O(h)); 10 % for the next order
    assert np.log2(coarse / fine) == pytest.approx(2.0, rel=0.1)
    assert not any("first order" in note for note in summary["notes"])


@pytest.mark.parametrize("adaptive", [1e-3, 1e-4, 1e-5])
def test_error_control_holds_the_states_of_a_mass_behind_a_spring(pack, adaptive):
    """Without the halves they err by 40 to 2600 times the allowed error, as a coupling of first order does."""
    error, _ = slider(pack, {"step": 0.25, "adaptive": adaptive})
    # A line of p or f that is off by e in one direction all the time moves the mass by at most 4 e t^2 / 2 = 32 e; the
    # oscillation of period pi averages that over half a period, 4 e (pi / 2)^2 / 2 = 5 e.
    assert error < 5 * adaptive


@pytest.mark.heavy
@pytest.mark.parametrize("algorithm", ["extrapolated", "iterative"])
def test_a_stiff_spring_passes_its_input_on_and_does_not_jump(pack, algorithm):
    """The force starts a step with k times the error that the prediction of p had: no shorter step lowers that."""
    k, adaptive = 100.0, 1e-6
    error, _ = slider(pack, {"step": 0.1, "adaptive": adaptive, "algorithm": algorithm}, k)
    # Forces up to 5 are allowed 5e: p moves by at most 0.25 * 5e * 4 = 5e, x follows it, and v by sqrt(k) times that.
    assert error < 50 * adaptive


@pytest.mark.parametrize(("options", "words"), [
    ({"algorithm": "jacobi", "adaptive": 1e-3}, "jacobi samples the signals .* use extrapolated or iterative"),
    ({"algorithm": "iterative", "adaptive": 2.0}, "adaptive: expected a relative error between 0 and 1, got 2"),
    ({"algorithm": "iterative", "adaptive": float("nan")}, "adaptive: .* got nan"),
    ({"algorithm": "extrapolated", "convergence": 1e-9}, "because extrapolated repeats no steps"),
    ({"algorithm": "iterative", "convergence": 0.0}, "convergence: .* got 0"),
    ({"algorithm": "implicit"}, "unknown algorithm 'implicit'; there are .*extrapolated, iterative"),
])  # fmt: skip
def test_options_that_do_not_fit(loop, options, words):
    with pytest.raises(UsageError, match=words):
        simulate(loop, step=H, **options)


def test_units_that_cannot_repeat_a_step_are_named_before_the_run(pack):
    path = pack(["a Stock u:input y:output", "b Plant u:input y:output"], ["a.y -> b.u", "b.y -> a.u"])
    with pytest.raises(SspError, match="a: .*cannot save and restore its state .*use extrapolated"):
        simulate(path, stop=1.0, step=0.25, algorithm="iterative")
    with pytest.raises(SspError, match="cannot save and restore"):
        simulate(path, stop=1.0, step=0.25, algorithm="extrapolated", adaptive=1e-3)
    assert len(simulate(path, stop=1.0, step=0.25, algorithm="extrapolated")) == 5


def test_units_of_one_step_length_and_steps_below_the_resolution_of_time_are_named_before_the_run(pack, fmus, loop):
    with pytest.raises(CosimError, match=r"below the resolution of time at 1e\+09 s"):
        simulate(loop, start=1e9, stop=1e9 + 2**-8, step=2**-10, algorithm="iterative", adaptive=1e-3)
    path = pack(["a Plant u:input y:output"])
    rigid = path.with_name("rigid.ssp")
    key = b'canHandleVariableCommunicationStepSize="'
    plant = edited(fmus["Plant"], [(key + b"true", key + b"false")])
    rigid.write_bytes(edited(path, add={"resources/Plant.fmu": plant}))
    with pytest.raises(SspError, match="a: .* takes steps of one length only"):
        simulate(rigid, stop=1.0, step=0.25, algorithm="iterative", adaptive=1e-3)
    assert len(simulate(rigid, stop=1.0, step=0.25, algorithm="iterative")) == 5


def test_a_coupling_that_does_not_converge_says_so(pack, xml):
    """Far beyond the contraction of plain repetition it does converge, but not to less than rounding errors."""
    times = '<ssc:LinearTransformation factor="-1000"/>'  # x' = -1000 x
    path = pack(["plant Plant u:input y:output"], [xml.connection("plant.y -> plant.u", times)])
    results = simulate(path, stop=1.0, step=0.25, algorithm="iterative", parameters={"plant.x0": 1.0})
    # trapezoidal rule: (1 - 125) / (1 + 125) a step; the guesses end within 1e-8 of it
    factor = (1 - 125.0) / (1 + 125.0)
    np.testing.assert_allclose(results["plant.y"], factor ** np.arange(5), rtol=0, atol=5e-8)
    with pytest.raises(CosimError, match="does not converge: y still changes by .*choose a shorter step") as info:
        simulate(path, stop=1.0, step=0.25, algorithm="iterative", convergence=1e-300, parameters={"plant.x0": 1 / 3})
    assert len(info.value.results) == 1
    assert "adaptive" in str(info.value)
