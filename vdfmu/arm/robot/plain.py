"""Plain words of a drive beside the paper's: `stiffness` and `rotor_inertia`, as numbers of (2), (3) and (56)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

from vdfmu.arm.robot.catalogue import catalogue
from vdfmu.base.measure import unit_of
from vdfmu.base.toml_tables import Problems, Table

RIGID, LINEAR = 1e11, 1e-6
"""K_w0 [N.m/rad] and c_f, c_w [1/(N.m), 1/N] of a linear spring. Its compliance differs from 1 / K_f0 by less than
(c_f tau)^2, 1e-8 of itself at 100 N.m, and the compliance 1 / (ell^2 K_w0) of the wave generator."""
PLAIN = {
    "stiffness": ("stiffness", ("K_f0", "c_f", "K_w0", "c_w"), "Stiffness of a linear spring, link-side",
                  f"K_f0 = stiffness, K_w0 = {RIGID:g} N.m/rad, c_f = c_w = {LINEAR:g}"),
    "rotor_inertia": ("kg.m2", ("I_m",), "Rotor inertia, motor-side", "I_m = ell * rotor_inertia"),
}  # fmt: skip
"""Word to its unit of measurement, or a key of `unit_of`, to the paper's keys, its meaning and its conversion."""


def in_paper_words(problems: Problems, joint: Any, path: str, kind: str = "") -> tuple[Any, dict[str, str]]:
    """Return a joint's table with the paper's keys for plain words, and sources. Both together are a problem."""
    drive = joint.get("drive") if isinstance(joint, dict) else None
    if not isinstance(drive, dict) or PLAIN.keys().isdisjoint(drive):
        return joint, {}
    drive = cast("dict[str, Any]", drive)
    paper = {key: value for key, value in drive.items() if key not in PLAIN}
    sources: dict[str, str] = {}
    for word, (quantity, keys, text, _) in PLAIN.items():
        if word not in drive:
            continue
        unit = unit_of(quantity, kind or joint.get("type", ""))
        table = Table(problems, {word: drive[word]}, f"{path}.drive", None)
        value = table.number(
            word, above=0.0, at_most=1e12, unit=unit, way_out=f"It is the {text[0].lower()}{text[1:]}."
        )
        value = 1.0 if math.isnan(value) else value  # of a wrong value one problem is enough
        if both := [key for key in keys if key in drive]:
            problems.add(
                table.key(word), f"{word} or {', '.join(keys)}", f"{word} and {', '.join(both)}", "Delete one."
            )
        if word == "stiffness":
            numbers = {"K_f0": value, "c_f": LINEAR, "K_w0": RIGID, "c_w": LINEAR}
        else:
            ell = drive.get("ell", catalogue()["gears"].get(str(joint.get("gear")), {}).get("ratio"))
            if ell is None:
                problems.add(table.key(word), "ell beside it", "nothing", "I_m is ell * rotor_inertia: add ell.")
            numbers = {"I_m": value * ell if isinstance(ell, int | float) else value}
        paper |= numbers
        sources |= {f"{path}.drive.{key}": f"{word} = {value:g} {unit}" for key in numbers}
    return {**joint, "drive": paper}, sources


def plain_notes(sources: Mapping[str, str]) -> list[str]:
    """Return a note on each word that a robot's file has, by the sources of its numbers."""
    words = {text.partition(" = ")[0] for text in sources.values()}
    return [f"{word} was converted: {note}." for word, (*_, note) in PLAIN.items() if word in words]
