"""Run an arm under each control law and print the largest error of a joint and the smallest modulus margins.

    python examples/control_laws.py [SCENARIO ...]

The first margin is that of the algorithm `gauss-seidel`, the second that of `jacobi`, which delays each signal by a
step.
"""

import sys
from typing import Any

import numpy as np

import vdfmu
from vdfmu.extras.laws import state_gains
from vdfmu.system.scenario import load_scenario

LAWS = ("controller", "pd_gravity", "joint_torque", "state_feedback", "computed_torque")
JOINT_TORQUE = {
    "planar_tracking": {"K_v": [20.0, 10.0], "share": [0.5, 0.5]},
    "tracking": {
        "K_p": [2000.0, 2000.0, 2000.0, 1000.0, 1000.0, 500.0],
        "K_v": [25.0, 25.0, 20.0, 20.0, 20.0, 20.0],
        "share": [0.5, 0.5, 0.6, 0.9, 0.9, 1.0],
    },
}
"""Gains by scenario. Gains that are not listed, and those of `controller` and `pd_gravity`, are the scenario's."""


def gains_of(law: str, scenario: str) -> dict[str, Any]:
    """Return the gains of a law by name, K_p and K_v link-side, as arrays or numbers."""
    loaded = load_scenario(scenario)
    if law == "state_feedback":
        ends = loaded.sections["trajectory"]
        middle = np.add(ends["q_start"], ends["q_end"]) / 2.0
        return state_gains(loaded.arm, middle, error=1e-3, rate=0.02, torque=0.01)._asdict()
    if law == "computed_torque":
        return {"k_p": 2500.0, "k_v": 100.0, "K_v": np.full(loaded.arm.n, 20.0)}
    gains = {name: loaded.sections["controller"][name] for name in ("K_p", "K_v")}
    gains |= JOINT_TORQUE[scenario] if law == "joint_torque" else {}
    return {name: np.array(values) for name, values in gains.items()}


def run(law: str, scenario: str, **options: Any) -> vdfmu.Results:
    """Run a scenario under a law, by default without files and references."""
    settings = {f"controller.{name}": values for name, values in gains_of(law, scenario).items()}
    options = {"reference": False, "out": False, "log": lambda _: None, **options}
    return vdfmu.run(scenario, units={"controller": law}, parameters=settings, **options)


def margin(law: str, scenario: str, algorithm: str) -> tuple[str, float]:
    """Return the smallest modulus margin of a run, or the reason why it has none, and the largest joint error [rad]."""
    try:
        results = run(law, scenario, algorithm=algorithm)
    except vdfmu.VdfmuError as error:
        if not any("Unstable" in note for note in getattr(error, "__notes__", ())):
            raise
        return "unstable", np.nan
    figures = results.summary["key_figures"]
    smallest = figures.get("margin", {}).get("value")
    words = "unstable" if smallest is None else f"{smallest:.2f}" if smallest else "none"
    return words, float(np.abs(results["trajectory.q_d"] - results["plant.q"]).max())


def main(scenarios: list[str]) -> None:
    """Print a row of a table in Markdown for each law."""
    columns = [f"`{scenario}` mrad | margin | with delay" for scenario in scenarios]
    print(f"| law | {' | '.join(columns)} |\n|{' --- |' * (1 + 3 * len(scenarios))}")
    for law in LAWS:
        cells = []
        for scenario in scenarios:
            usual, error = margin(law, scenario, "gauss-seidel")
            cells += [f"{1e3 * error:.2g}", usual, margin(law, scenario, "jacobi")[0]]
        print(f"| `{law}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["planar_tracking", "tracking"])
