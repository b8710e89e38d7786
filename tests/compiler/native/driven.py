"""An instance that moves."""

import numpy as np

from tests.compiler.native.binding import Instance


def drive(instance: Instance, first: int, count: int, size: float = 0.02) -> np.ndarray:
    """Move with inputs that change; Euler's method in model exchange. Returns the outputs after each step."""
    n = sum(len(v.names) for v in instance.model.of("input"))
    rows = []
    for k in range(first, first + count):
        if n:
            instance.inputs(size * np.sin(0.9 * k + 0.1 * np.arange(n)))
        if instance.kind == "CoSimulation":
            instance.step()
        else:
            instance.time += 1e-5
            instance.do("SetTime", instance.time).states(instance.get_states() + 1e-5 * instance.derivatives())
        rows.append(instance.outputs())
    return np.array(rows)
