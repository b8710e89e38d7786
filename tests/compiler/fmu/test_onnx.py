"""The example that makes an FMU of a net in ONNX, against ONNX's own evaluation."""

import runpy
from pathlib import Path

import fmpy
import numpy as np
import pytest

import vdfmu

onnx = pytest.importorskip("onnx", reason="pip install onnx")
reference = pytest.importorskip("onnx.reference", reason="pip install onnx")
EXAMPLE = Path(__file__).parents[3] / "examples" / "trained" / "from_onnx.py"


@pytest.mark.parametrize("transposed", [0, 1])
def test_the_fmu_of_a_net_in_onnx(tmp_path, transposed):
    rng = np.random.default_rng(5)
    first, second, third = (rng.normal(size=size).astype(np.float32) / 8 for size in ((3, 64), (64, 64), (64, 2)))
    laws = onnx.helper.make_node
    nodes = [
        laws("MatMul", ["u", "A"], ["a"]), laws("Add", ["a", "a0"], ["b"]), laws("Relu", ["b"], ["c"]),
        laws("Gemm", ["c", "B", "b0"], ["d"], transB=transposed, alpha=0.5, beta=2.0),
        laws("Tanh", ["d"], ["e"]),
        laws("MatMul", ["e", "C"], ["f"]), laws("Sigmoid", ["f"], ["y"]),
    ]  # fmt: skip
    numbers = {"A": first, "a0": first[0], "B": second.T if transposed else second, "b0": first[1], "C": third}
    sizes = {"u": 3, "y": 2}
    u, y = (onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, n]) for name, n in sizes.items())
    stored = [onnx.numpy_helper.from_array(np.ascontiguousarray(value), name) for name, value in numbers.items()]
    model = onnx.helper.make_model(onnx.helper.make_graph(nodes, "net", [u], [y], stored))
    onnx.save(model, tmp_path / "net.onnx")
    unit = runpy.run_path(str(EXAMPLE))["onnx_unit"](tmp_path / "net.onnx")
    path = vdfmu.build(unit, tmp_path / "net.fmu")
    features = np.array([0.3, -1.2, 0.7], np.float32)
    start = {f"u[{k}]": float(value) for k, value in enumerate(features, 1)}
    rows = fmpy.simulate_fmu(str(path), stop_time=0.1, output_interval=0.1, start_values=start)
    (expected,) = reference.ReferenceEvaluator(model).run(None, {"u": features[None]})
    # ONNX calculates with 24 bits, 64 terms of each sum
    np.testing.assert_allclose([rows["y[1]"][-1], rows["y[2]"][-1]], expected[0], rtol=64 * 6e-8)
