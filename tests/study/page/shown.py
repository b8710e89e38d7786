"""Numbers of a page, and a run to show."""

import numpy as np

import vdfmu
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.run.scene import arm_of


def numbers(array: np.ndarray, kind: str = "<f4") -> np.ndarray:
    assert array.dtype == kind
    return array


def still_and_quick(rows: int, stop: float) -> Results:
    """Return a run of the planar arm: joints turn by 1 and by -0.5 rad from 0.5 to 2.5 s, and rest until `stop`."""
    t = np.linspace(0.0, stop, rows)
    s = np.clip((t - 0.5) / 2.0, 0.0, 1.0)
    q = np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), [1.0, -0.5])
    signals = [Signal(f"plant.q[{i + 1}]", "real", "rad", i) for i in range(2)]
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {})
    return Results(t, signals, {"real": q}, {"scenario": "still", "robot": "planar_2dof", "joints": 2, "arm": arm})
