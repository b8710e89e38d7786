"""The FMU of a net in an ONNX file: ``python from_onnx.py net.onnx``, after ``pip install onnx``.

It takes nets of one input and one output, (1, n) or (n,), of the layers that `LAWS` lists.
"""

import sys

import numpy as np
import onnx
from onnx import numpy_helper

import vdfmu
from vdfmu.unit import Input, Output, Unit, maximum


def gemm(node, x, W, b=0.0):
    """Return alpha W x + beta b. ONNX has the transposed matrix unless it says so."""
    options = {each.name: onnx.helper.get_attribute_value(each) for each in node.attribute}
    product = (W if options.get("transB", 0) else W.T) @ x
    return options.get("alpha", 1.0) * product + options.get("beta", 1.0) * b


LAWS = {
    "Gemm": gemm,
    "MatMul": lambda node, x, W: W.T @ x,
    "Add": lambda node, a, b: a + b,
    "Sub": lambda node, a, b: a - b,
    "Mul": lambda node, a, b: a * b,
    "Div": lambda node, a, b: a / b,
    "Relu": lambda node, x: maximum(x, 0.0),
    "Tanh": lambda node, x: np.tanh(x),
    "Sigmoid": lambda node, x: 1.0 / (1.0 + np.exp(-x)),
    "Identity": lambda node, x: x,
}


def onnx_unit(path, name="Net"):
    """Return the unit of the net in a file, with the input ``u`` and the output ``y``."""
    graph = onnx.load(path).graph
    numbers = {each.name: np.squeeze(numpy_helper.to_array(each)) for each in graph.initializer}
    (source,), (result,) = ([each for each in graph.input if each.name not in numbers], graph.output)
    n, m = (each.type.tensor_type.shape.dim[-1].dim_value for each in (source, result))
    if wrong := {node.op_type for node in graph.node} - LAWS.keys():
        raise ValueError(f"{path} has the operations {', '.join(sorted(wrong))}; there are {', '.join(LAWS)}.")

    class Net(Unit):
        """Net from an ONNX file."""

        u = Input("1", n, "features")
        y = Output("1", m, "predictions")

        def outputs(self):
            values = numbers | {source.name: self.u}
            for node in graph.node:
                values[node.output[0]] = LAWS[node.op_type](node, *(values[each] for each in node.input))
            self.y = values[result.name]

    Net.__name__ = name
    return Net


if __name__ == "__main__":
    print(vdfmu.build(onnx_unit(sys.argv[1])))
