"""Figures of the wrenches that act on arms, and of the forces of what they touch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vdfmu.engine.results.results import Results
from vdfmu.study.report.curves import Curve, Figure

BASE = "base"
"""Position of an arm's base in {I}, then its rotation, row by row: 12 signals."""
WRENCHES = {
    "F_e": ("of the arm on its surroundings in {O}", "wrench of {} on its surroundings"),
    "F_S": ("of the base on the arm in {S}", "wrench of the base on {}"),
}
"""Six signals, force and moment: words for a title, and for the arrow."""


def force_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield force and moment of each wrench that acts in the run, and the forces of contacts."""
    scene = summary.get("scene", {})
    names = {*results.names}
    for arm in scene.get("arms", []):
        for key, (words, _) in WRENCHES.items():
            signals = arm["signals"].get(key, [])
            for what, unit, part in (("Force", "N", signals[:3]), ("Moment", "N.m", signals[3:])):
                known = [(axis, name) for axis, name in zip("xyz", part, strict=False) if name in names]
                if any(np.any(results[name]) for _, name in known):
                    curves = [Curve(axis, 0, [(1.0, name)]) for axis, name in known]
                    title = f"{arm['component']}: {what.lower()} {words}"
                    yield Figure(f"{arm['component']}.{key}.{unit}", title, unit, curves, f"{what} {words}")
    for one in scene.get("objects", []):
        for name, words in one.get("forces", {}).items():
            if name in names:
                title = f"{one['component']}: {words[:1].lower()}{words[1:]}"
                yield Figure(name, title, results.units[name], [Curve(name, 0, [(1.0, name)])], words)
