"""Each algorithm against the sampled recursion computed by hand, exactly."""

import numpy as np
import pytest

from vdfmu.engine.plan.graph import topological
from vdfmu.engine.run import simulate

H, G, K = 0.125, 0.75, 1.5  # K is that of `loop`


def simulate_loop(path, algorithm):
    parameters = {"trajectory.slope": 0.3, "feedforward.k": G, "plant.x0": 0.1}
    return simulate(path, stop=2.0, step=H, algorithm=algorithm, parameters=parameters, record=["*"])


def test_gauss_seidel_is_the_sampled_controller_without_extra_delay(loop):
    results = simulate_loop(loop, "gauss-seidel")
    n = 16
    r = 0.3 * (H * np.arange(n + 1))
    x, tau = np.empty(n + 1), np.empty(n + 1)
    x[0] = 0.1
    tau[0] = G * r[0] + K * (r[0] + -1.0 * x[0])
    for k in range(n):
        tau[k + 1] = G * r[k] + K * (r[k] + -1.0 * x[k])  # computed by the step that ends at k + 1
        x[k + 1] = x[k] + H * (tau[k + 1] + 0.0)
    np.testing.assert_array_equal(results["trajectory.y"], r)
    np.testing.assert_array_equal(results["plant.y"], x)
    np.testing.assert_array_equal(results["controller.y"], tau)
    # An input's row has what the unit used in the step that ended there.
    np.testing.assert_array_equal(results["plant.u"], tau)
    np.testing.assert_array_equal(results["feedforward.u"], np.r_[r[0], r[:-1]])
    np.testing.assert_array_equal(results["error.b"], -np.r_[x[0], x[:-1]])


def test_jacobi_passes_every_value_on_one_step_late(loop):
    results = simulate_loop(loop, "jacobi")
    n = 16
    r = 0.3 * (H * np.arange(n + 1))
    x, tau, e, w = (np.empty(n + 1) for _ in range(4))
    x[0] = 0.1
    e[0], w[0] = r[0] + -1.0 * x[0], G * r[0]
    tau[0] = w[0] + K * e[0]
    for k in range(n):
        e[k + 1] = r[k] + -1.0 * x[k]
        w[k + 1] = G * r[k]
        tau[k + 1] = w[k] + K * e[k]
        x[k + 1] = x[k] + H * (tau[k] + 0.0)
    np.testing.assert_array_equal(results["plant.y"], x)
    np.testing.assert_array_equal(results["controller.y"], tau)
    np.testing.assert_array_equal(results["plant.u"], np.r_[tau[0], tau[:-1]])


def test_order_follows_dependencies_and_row_0_has_the_start_values_through_the_whole_chain(loop):
    order = simulate_loop(loop, "gauss-seidel").summary["order"]
    assert order == ["error", "feedforward", "controller", "plant", "trajectory"]
    results = simulate_loop(loop, "gauss-seidel")
    assert results.time[0] == 0.0
    assert results["controller.y"][0] == results["plant.u"][0] == K * -0.1
    assert len(results) == 17


def test_states_are_read_as_at_the_start_of_the_step_whatever_feeds_through(pack):
    path = pack(["a Plant u:input y:output", "b Plant u:input y:output"], ["a.y -> b.u", "b.y -> a.u"])
    results = simulate(path, stop=1.0, step=0.25, parameters={"a.x0": 1.0})
    a, b = [1.0], [0.0]
    for k in range(4):
        a.append(a[k] + 0.25 * b[k])
        b.append(b[k] + 0.25 * a[k])
    np.testing.assert_array_equal(results["a.y"], a)
    np.testing.assert_array_equal(results["b.y"], b)
    path = pack(
        ["source Ramp y:output", "m Mixed u:input y:output z:output", "sum Adder a:input b:input y:output"],
        ["source.y -> m.u", "m.y -> sum.a", "m.z -> sum.b"],
    )
    results = simulate(path, stop=4.0, step=1.0, record=["sum.*"])
    # m.z is passed on fresh: the ramp at t_k. m.y is a counter that is k at t_k.
    np.testing.assert_array_equal(results["sum.b"], [0, 0, 1, 2, 3])
    np.testing.assert_array_equal(results["sum.a"], [0, 0, 1, 2, 3])


def test_time_is_not_accumulated_and_booleans_and_integers_are_passed(pack):
    path = pack(["source Ramp y:output"])
    results = simulate(path, start=0.3, stop=100.3, step=0.1)
    np.testing.assert_array_equal(results.time, 0.3 + 0.1 * np.arange(1001.0))
    assert results["source.y"][-1] == (0.3 + 0.1 * 999) + 0.1
    path = pack(
        ["count Counter n:output:Integer odd:output:Boolean",
         "logic Logic bi:input:Boolean ii:input:Integer bo:output:Boolean io:output:Integer",
         "second Logic bi:input ii:input bo:output io:output"],
        ["count.n -> logic.ii", "count.odd -> logic.bi", "logic.io -> second.ii", "logic.bo -> second.bi"],
    )  # fmt: skip
    results = simulate(path, stop=4.0, step=1.0)
    assert results["second.io"].tolist() == [2, 2, 3, 4, 5]
    assert results["second.io"].dtype == np.int64  # FMI 3.0 has integers of that length
    assert results["second.bo"].tolist() == [False, False, True, False, True]
    assert results["second.bo"].dtype == bool
    assert results.kinds["second.bo"] == "boolean"


def test_mapping_transformations_of_booleans_and_integers(pack, xml):
    swap = ('<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/>'
            '<ssc:MapEntry source="false" target="true"/></ssc:BooleanMappingTransformation>')  # fmt: skip
    table = "".join(f'<ssc:MapEntry source="{i}" target="{10 * i}"/>' for i in range(3))
    whole = f"<ssc:IntegerMappingTransformation>{table}</ssc:IntegerMappingTransformation>"
    path = pack(
        ["count Counter n:output odd:output", "logic Logic bi:input ii:input"],
        [xml.connection("count.n -> logic.ii", whole), xml.connection("count.odd -> logic.bi", swap)],
    )
    results = simulate(path, stop=4.0, step=1.0, record=["logic.*"])
    assert results["logic.ii"].tolist() == [0, 0, 10, 20, 3]  # SSP 1.0, 4.3: values without an entry stay
    assert results["logic.bi"].tolist() == [True, True, False, True, False]


def test_progress_is_called_a_hundred_times_at_most_and_record_chooses_signals(pack, loop):
    results = simulate(loop, stop=1.0, step=H, record=["plant.*", "controller.y"])
    assert results.names == ["plant.y", "plant.u", "controller.y"]
    calls = []
    path = pack(["source Ramp y:output"])
    simulate(path, stop=10.01, step=0.01, progress=lambda k, n: calls.append((k, n)))
    assert calls[0] == (0, 1001)
    assert calls[-1] == (1001, 1001)
    assert len(calls) <= 101


@pytest.mark.parametrize("seed", range(50))
def test_the_order_takes_the_first_of_those_whose_predecessors_are_done(seed):
    """Nothing else decides it, so that a run gives the same bits wherever and whenever it is ordered."""
    random = np.random.default_rng(seed)
    hidden = [int(k) for k in random.permutation(10)]
    edges = {(a, b) for i, a in enumerate(hidden) for b in hidden[i + 1 :] if random.random() < 0.3}
    left = [int(k) for k in random.permutation(10)]
    for node in topological(left, edges):
        ready = [k for k in left if not any(a in left and b == k for a, b in edges)]
        assert node == ready[0]
        left = [k for k in left if k != node]
    assert not left
