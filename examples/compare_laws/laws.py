"""Control laws: the unit, the parameters that a search varies, and their start."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.extras.laws import state_gains

Start = Callable[[Mapping[str, Any], Any, Any], Mapping[str, Any]]


class Law(NamedTuple):
    """A control law."""

    unit: str
    """Name of a unit, or ``my_law.py:MyLaw``."""
    text: str
    vary: Mapping[str, tuple[float, float]]
    """Parameter to the smallest and largest factor of its start, the same for all joints."""
    start: Start
    """From the gains K_p and K_v (n,) of `vdfmu robot reach`, link-side, the robot and the pose in the middle of the
    motion to values of parameters."""

    @property
    def name(self) -> str:
        """Name of the unit, or of its file."""
        return Path(self.unit.partition(":")[0]).stem


def _pd(rule: Mapping[str, Any], robot: Any, pose: Any) -> Mapping[str, Any]:
    return {"K_p": rule["K_p"], "K_v": rule["K_v"]}


def _optimal(rule: Mapping[str, Any], robot: Any, pose: Any) -> Mapping[str, Any]:
    rate, torque = 1e-3 * rule["K_p"] / rule["K_v"], 1e-3 * rule["K_p"] / robot.ell
    return state_gains(robot, pose, error=1e-3, rate=rate, torque=torque)._asdict()


_GAINS = {"K_p": (0.1, 10.0), "K_v": (0.1, 3.0)}
LAWS = {
    law.unit: law
    for law in (
        Law("controller", "PD with the exact feedforward", _GAINS, _pd),
        Law("pd_gravity", "PD of the rotors with gravity", _GAINS, _pd),
        Law("computed_torque", "computed torque of the rigid arm",
            {"k_p": (0.04, 10.0), "k_v": (0.1, 3.0), "K_v": (0.1, 3.0)},
            lambda rule, robot, pose: {"k_p": 2500.0, "k_v": 100.0, "K_v": rule["K_v"]}),
        Law("state_feedback", "state feedback with gravity, from the optimal gains",
            dict.fromkeys(("K_q", "K_q_dot", "K_kappa", "K_kappa_dot"), (0.1, 10.0)), _optimal),
        Law("joint_torque", "torque feedback around PD with gravity", {**_GAINS, "share": (0.4, 1.1)},
            lambda rule, robot, pose: {**_pd(rule, robot, pose), "share": 0.9}),
        Law("disturbance_observer", "PD with the exact feedforward and a disturbance observer",
            {**_GAINS, "T_Q": (0.1, 10.0)}, lambda rule, robot, pose: {**_pd(rule, robot, pose), "T_Q": 0.05}),
        Law("virtual_decomposition", "virtual decomposition with adaptation",
            {"Lambda": (0.1, 10.0), "k_vkappa": (0.1, 3.0), "gamma": (0.01, 100.0)},
            lambda rule, robot, pose: {"Lambda": 0.1 * rule["K_p"] / rule["K_v"],
                                       "k_vkappa": rule["K_v"] / robot.ell, "gamma": 1.0, "gamma_j": 0.1}),
    )
}  # fmt: skip


def load_law(name: str) -> Law:
    """Return a law by its name, or the LAW of a Python file, such as ``my_law.py``."""
    if name in LAWS:
        return LAWS[name]
    if not name.endswith(".py"):
        raise SystemExit(f"laws: must be {', '.join(LAWS)} or a Python file, got {name}.")
    law = runpy.run_path(name).get("LAW")
    if not isinstance(law, Mapping) or set(law) != set(Law._fields):
        raise SystemExit(f"{name}: LAW must be a dict with {', '.join(Law._fields)}, got {law!r}.")
    loaded = Law(**law)
    unit, _, cls = loaded.unit.partition(":")
    return loaded._replace(unit=f"{Path(name).resolve().parent / unit}:{cls}") if cls else loaded
