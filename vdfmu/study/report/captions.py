"""Captions of the pictures of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vdfmu.engine.results.results import Results
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import group_value

_SHOWN = 4
"""Settings that a caption shows; more would leave no room for the panels."""


def paper_table(scenario: Scenario) -> int:
    """Return the number of the table of the paper that a scenario compares with; 0 for none."""
    source = str(scenario.paper.get("source", ""))
    return next((table for table in (4, 5) if source.startswith(f"Table {table}")), 0)


def run_caption(results: Results, scenario: Scenario, figures: Mapping[int, int]) -> str:
    """Return which run a picture shows: scenario, robot, master, step, and how the plant deviates from the model.

    Master, step and settings in the summary override the scenario's. `figures`: table of the paper that the scenario
    compares with to the figure of the paper that the picture then is.
    """
    facts: Mapping[str, Any] = results.summary
    master = facts.get("master") or facts.get("algorithm") or scenario.master
    step = 1e3 * float(facts.get("step") or scenario.step)
    figure = figures.get(paper_table(scenario))
    before = f"As figure {figure} of the paper. " if figure else ""
    settings: Mapping[str, Any] = facts.get("settings") or {}
    chosen = {key: value for key, value in settings.items() if key == "feedforward.mode"}
    mode = group_value(scenario, "feedforward.mode", chosen)
    lines = [
        f"{before}Scenario {scenario.name}, robot {scenario.arm.name}, master {master}, "
        f"step {step:g} ms{'' if mode is None else f', feedforward {mode}'}."
    ]
    if scenario.plant_factors:
        factors = [
            f"{key} x {float(np.ravel(factor)[0]):g}" if np.ptp(factor) == 0.0 else f"{key} joint by joint"
            for key, factor in scenario.plant_factors.items()
        ]
        lines.append(f"Plant off the feedforward's model: {', '.join(factors)}.")
    if settings:
        shown = ", ".join(f"{key} = {value}" for key, value in list(settings.items())[:_SHOWN])
        more = f" and {len(settings) - _SHOWN} more" if len(settings) > _SHOWN else ""
        lines.append(f"Settings: {shown}{more}.")
    return "\n".join(lines)
