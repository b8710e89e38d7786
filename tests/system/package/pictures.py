"""Diagrams of scenarios."""

from functools import lru_cache

import pytest

from vdfmu.base.extras import extra_modules
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.drawing import draw_system
from vdfmu.system.scenario import load_scenario

DECOMPOSITION = extra_modules("decomposition")
NAMES = (
    "tracking", "two_joint", "two_arms", "screw", "wall", "estimation", "foreign",
    *(pytest.param("tracking, decomposed", marks=pytest.mark.heavy) for _ in DECOMPOSITION),
)  # fmt: skip


@lru_cache
def picture(name, version="1.0"):
    """Return the diagram of a scenario, or one as of another tool: no places, and an order against the flow."""
    scenario = load_scenario("tracking" if name == "foreign" else name.partition(",")[0])
    scenario, values = DECOMPOSITION[0].decomposed(scenario) if "," in name else (scenario, None)
    description = SystemDescription(scenario, values, version)
    if name == "foreign":
        description.tables = dict(reversed(description.tables.items()))
        description.corners = {}
    return draw_system(description, {})
