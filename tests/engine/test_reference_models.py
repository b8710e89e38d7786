"""Models of the Reference FMUs under the master, against the solutions published with them (modelica/Reference-FMUs).

These are of the explicit Euler method with the step of each model, as our look-alikes have it: the same operations.
"""

import numpy as np
import pytest

from tests.engine.reference import models
from vdfmu.base.errors import UsageError
from vdfmu.engine.run import ALGORITHMS, Simulator, simulate

PUBLISHED = {
    # model: stop, step, {time: values of the outputs}
    "Dahlquist": (10.0, 0.1, {0.1: [0.9], 0.2: [0.81], 10.0: [0.00002656139888758746]}),
    "VanDerPol": (20.0, 0.01, {0.01: [2.0, -0.02], 0.02: [1.9998, -0.0394],
                               20.0: [2.0148418861546133, 0.24419470751904407]}),
    "BouncingBall": (3.0, 0.01, {0.01: [0.99955855, -0.0981], 0.02: [0.9981361, -0.1962],
                                 3.0: [2.2250738585072014e-308, 0.0]}),
    "Stair": (9.0, 0.2, {0.2: [1], 0.4: [1], 9.0: [10]}),
    "Resource": (1.0, 1.0, {1.0: [97]}),
    "StateSpace": (10.0, 1.0, {1.0: [2.7169239322358925, 5.433847864471785, 8.150771796707678],
                               2.0: [7.381675653556159, 14.763351307112318, 22.145026960668407],
                               10.0: [21916.681339078466, 43833.36267815693, 65750.0440172352]}),
}  # fmt: skip
MODELS = {
    model.name: model
    for model in (models.DAHLQUIST, models.VAN_DER_POL, models.BOUNCING_BALL, models.STAIR, models.RESOURCE,
                  models.STATE_SPACE)
}  # fmt: skip
CASES = [
    (name, version) for name in PUBLISHED for version in ("2.0", "3.0") if (name, version) != ("StateSpace", "2.0")
]


@pytest.mark.few(15)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("name", "version"), CASES)
def test_published_solutions(system, name, version, algorithm):
    stop, step, rows = PUBLISHED[name]
    results = simulate(system({"m": (MODELS[name], version)}), stop=stop, step=step, algorithm=algorithm)
    for time, values in rows.items():
        row = round(time / step)
        assert results.time[row] == pytest.approx(time)
        # the same operations, some in another order: 10,000 steps of a rounding each, 1e-16
        np.testing.assert_allclose([results[each][row] for each in results], values, rtol=1e-12, atol=0)


def test_sizes_of_arrays_are_the_same_in_all_runs_of_a_simulator(system):
    with Simulator(system({"m": (models.STATE_SPACE, "3.0")}), parameters={"m.n": 2}) as simulator:
        with pytest.raises(UsageError, match=r"m\.n: sizes of arrays must be constant"):
            simulator.run(parameters={"m.n": 3}, stop=0.2, step=0.1)
