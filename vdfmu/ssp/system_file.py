"""The files in ``ssp/``: which units a system has, where they are drawn, and what is connected to what."""

from __future__ import annotations

import tomllib
from typing import Any

from vdfmu.data import data_path
from vdfmu.model import Scenario

__all__ = ["read_system", "units_of"]


def read_system(name: str) -> dict[str, Any]:
    """Return the content of ``ssp/<name>.toml``, with the tables of the file that it extends before its own."""
    content = tomllib.loads((data_path("ssp") / f"{name}.toml").read_text(encoding="utf-8"))
    if "extends" not in content:
        return content
    base = read_system(content.pop("extends"))
    connections = {**base["connections"]}
    for source, targets in content.get("connections", {}).items():
        connections[source] = [*connections.get(source, []), *targets]
    return base | content | {"units": base["units"] | content["units"], "connections": connections}


def units_of(scenario: Scenario) -> tuple[str, ...]:
    """Units of the scenario's system."""
    return tuple(read_system(scenario.system)["units"])
