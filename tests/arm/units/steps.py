"""Steps of a sampled unit."""

import numpy as np


def sampled(unit, steps, **inputs):
    """Return the rows of a sampled unit's outputs for functions of the time."""
    unit.start()
    rows = []
    for k in range(steps):
        unit.t = k * unit.period
        for name, value in inputs.items():
            setattr(unit, name, value(unit.t))
        unit.update()
        unit.outputs()
        rows.append({name: np.copy(value) for name, value in unit.store.items()})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
