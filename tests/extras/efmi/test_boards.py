"""Production code on Cortex-M4F and Cortex-M7, which QEMU emulates, over the paper's tracking run."""

import numpy as np
import pytest

from tests.extras.efmi.boards import BOARDS, on_board
from tests.extras.efmi.efmu import Efmu
from tests.extras.efmi.runs import ScenarioRun

pytestmark = pytest.mark.heavy

TOLERANCES = {"double": 1e-12, "float32": 1e-4}
"""Largest error over the largest value of an output.

In double precision the math libraries' sin, exp and tanh differ by a unit in the last place, 1e-16, and a torque is a
sum of some hundred such terms, some a hundred times as large as it: 1e-12. In single precision see test_code.py.
"""


@pytest.fixture(scope="module")
def tracking(tmp_path_factory, kernel_cache):
    return ScenarioRun("tracking", tmp_path_factory.mktemp("tracking"))


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
@pytest.mark.parametrize("precision", TOLERANCES)
@pytest.mark.parametrize("unit", ["controller", "feedforward"])
def test_board_gives_the_outputs_of_the_run(tracking, unit, precision, board, tmp_path):
    efmu = Efmu(tracking.efmus(tmp_path / "efmus", precision)[unit])
    made = on_board(efmu, board, tracking.inputs(unit, efmu), tmp_path)
    assert made.signals == 0
    expected = tracking.outputs(unit, efmu)
    for name, values in expected.items():
        # feedback is a small difference of two positions: its error is one of the torque, by the ratio 100 the motor's
        scale = 100.0 * np.abs(expected["tau"]).max() if name == "tau_e" else np.abs(values).max()
        tolerance = TOLERANCES[precision] * scale
        np.testing.assert_allclose(made.outputs[name], values, rtol=0.0, atol=tolerance, err_msg=name)
    assert made.ram < 1024
    assert made.stack < 8192
    assert made.most < 2.0 * made.mean  # straight-line code; what varies is in the math library
