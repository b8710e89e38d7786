"""Points of the shipped units at which nothing is hidden, and which together show all that a unit can do."""

from typing import Any

import numpy as np

# Values at which nothing is hidden: no zeros, no saturation, friction and springs well curved.
VISIBLE = {
    "eps": 0.5, "v_s": 0.4, "f_c": 2.0, "f_s": 3.0, "f_v": 0.7, "K_f0": 20.0, "c_f": 1.0, "K_w0": 0.02, "c_w": 0.5,
    "ell": 10.0, "I_m": 0.1, "T": 3.0, "t_start": -1.0, "tau_max": 1e6,
}  # fmt: skip
# The values of each parameter that chooses, and points that together show all that a unit can do.
SWITCHES: dict[str, dict[str, tuple[Any, Any]]] = {
    "trajectory": {}, "feedforward": {"mode": (0, 1)}, "controller": {"velocity": (0, 1)},
    "plant": {"equilibrium": (True, False)}, "estimator": {},
}  # fmt: skip
POINTS: dict[str, list[dict[str, Any]]] = {
    "trajectory": [{}],
    "feedforward": [{"mode": 0}, {"mode": 1}],
    "controller": [{"velocity": 0}, {"velocity": 1}, {"velocity": 2}, {"tau_max": 1e-3}],
    "plant": [{"equilibrium": True}, {"equilibrium": False}],
    # below and at the limit
    "estimator": [{"K_f0": 0.3, "K_w0": 2.0, "tau_hat_max": 1e3}, {"tau_hat_max": 1e-3}],
}


def random_value(group: str, causality: str, start: float, positive: bool, rng: np.random.Generator) -> float:
    start = VISIBLE.get(group, start)
    if group == "tolerance":
        return start
    if start == 0.0 or causality == "input":
        sign = 1.0 if positive else rng.choice([-1.0, 1.0])
        return float(sign * rng.uniform(0.2, 0.9))
    # The inertia of a thin link stays within the triangle inequality.
    return float(start * (1.0 + (0.005 if group == "inertia" else 0.2) * rng.uniform(-1.0, 1.0)))
