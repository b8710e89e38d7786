"""Gears and motors by name: the tables of a joint, and how well (2)-(3) fits the printed stiffnesses of gears."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from vdfmu.arm.equations.harmonic_drive import deformation
from vdfmu.arm.robot.parameters import JOINT_OPTIONS, PARAMETERS
from vdfmu.base.files import data_path
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.text import nearest
from vdfmu.base.toml_file import read_toml
from vdfmu.base.toml_tables import Problems, value_text

NAMED = ("gear", "motor")
"""Keys of a joint that name an entry."""
_ALWAYS = ("drive", "friction")
"""Tables that an entry adds if a joint lacks them. To tables of options it only adds keys."""
_SPRING = ("K1", "K2", "K3", "T1", "T2")
_PRINTED = {"drive": _SPRING, "hysteresis": (*_SPRING, "hysteresis_loss")}
"""Tables of a gear that are calculated from printed numbers, with these numbers."""
_FILE = "models/drives/catalogue.toml"
_OF_RATIO = {"N.m/rad": 2, "1/(N.m)": -1}
"""Units of a spring's motor-side numbers, and the power of the ratio that scales them to keep the link side."""

Tables = dict[str, dict[str, tuple[float, str]]]
"""Table of a joint to its numbers and their sources."""


@cache
def catalogue() -> dict[str, dict[str, Any]]:
    """Return ``gears`` and ``motors`` by name, and ``sources``, texts by key."""
    return read_toml(data_path("models") / "drives" / "catalogue.toml")


def assumed(gear: dict[str, Any], part: str = "hysteresis") -> list[str]:
    """Return the names of the assumed numbers from which a table of a gear is calculated."""
    texts = catalogue()["sources"]
    assumptions = [keys for source, keys in gear["sources"].items() if texts[source].startswith("Assumed")]
    return [key for keys in assumptions for key in keys if key in _PRINTED.get(part, ())]


def tables_of(problems: Problems, path: str, named: dict[str, Any], kind: str, ell: Any = None) -> Tables:
    """Return the tables of a joint's gear and motor for its `kind` and, if stated, its own reduction ratio `ell`."""
    tables: Tables = {}
    entries: dict[str, dict[str, Any]] = {}
    for part in NAMED:
        name, listed = named.get(part), catalogue()[f"{part}s"]
        if isinstance(name, str) and name in listed:
            entries[part] = listed[name]
        elif part in named:
            fix = nearest(name, list(listed)) if isinstance(name, str) else "Give it as a string."
            problems.add(f"{path}.{part}", f"a {part} of the catalogue", value_text(name), fix)
    gear, motor = (entries.get(part, {}) for part in NAMED)
    if gear and JOINT_TYPES[kind].slides:
        problems.add(
            f"{path}.gear", "none on a prismatic joint", value_text(named["gear"]), "Give [joints.drive] itself."
        )
    ratio = ell if isinstance(ell, (int, float)) and ell > 0 else gear.get("ratio")
    for part, entry in entries.items():
        for table in (*_ALWAYS, *JOINT_OPTIONS):
            source = f"{_FILE}: {part} {named[part]}"
            if part == "gear" and assumed(entry, table):
                source += f"; assumed there: {', '.join(assumed(entry, table))}"
            for key, value in entry.get(table, {}).items():
                if PARAMETERS[key].quantity == "velocity" and part == "motor":
                    if not ratio:
                        continue
                    value = value / ratio
                power = _OF_RATIO.get(PARAMETERS[key].quantity)
                if (part, table) == ("gear", "drive") and power:  # the link side keeps the printed values
                    value = value * (gear["ratio"] / ratio) ** power
                tables.setdefault(table, {})[key] = value, source
    if gear:
        tables["drive"]["ell"] = gear["ratio"], f"{_FILE}: gear {named['gear']}"
    if motor and ratio:
        both = " and ".join(f"{part} {named[part]}" for part in entries)
        inertia = sum(entry["inertia"] for entry in entries.values())
        tables.setdefault("drive", {})["I_m"] = ratio * inertia, f"{_FILE}: inertia of {both}, times ell"
    return tables


def filled_from_catalogue(
    problems: Problems, joint: dict[str, Any], path: str
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return a joint's table, filled from the catalogue if it names parts, and sources of the added numbers by key."""
    parts = {part: joint[part] for part in (*_ALWAYS, *JOINT_OPTIONS) if isinstance(joint.get(part), dict)}
    tables = tables_of(problems, path, joint, joint.get("type", ""), parts.get("drive", {}).get("ell"))
    sources: dict[str, str] = {}
    for part in (part for part in tables if part in parts or (part in _ALWAYS and part not in joint)):
        missing = {key: number for key, number in tables[part].items() if key not in parts.get(part, {})}
        parts[part] = {key: value for key, (value, _) in missing.items()} | parts.get(part, {})
        sources |= {f"{path}.{part}.{key}": source for key, (_, source) in missing.items()}
    return {key: value for key, value in joint.items() if key not in NAMED} | parts, sources


_POINTS = 60
"""Number of torques at which a spring is compared with printed stiffnesses."""


def catalogue_torsion(torque: Any, K: Any, T: Any) -> Any:
    """Piecewise linear torsion [rad] with stiffnesses K (3,) [N m/rad] and torques T (2,) [N m].

    Catalogues print K_1 up to the torque T_1, K_2 up to T_2 and K_3 beyond, with the wave generator held.
    """
    first, second = np.clip(torque, 0.0, T[0]), np.clip(torque - T[0], 0.0, T[1] - T[0])
    return first / K[0] + second / K[1] + np.clip(torque - T[1], 0.0, None) / K[2]


def spring_residual(gear: dict[str, Any]) -> tuple[float, float]:
    """Return the largest difference of (2)-(3) from the printed stiffnesses of a gear, up to its repeated peak torque.

    The difference is in rad, and relative to the largest torsion.
    """
    torque = np.linspace(0.0, gear["repeated"], _POINTS + 1)[1:]
    printed = catalogue_torsion(torque, [gear[f"K{i}"] for i in (1, 2, 3)], [gear["T1"], gear["T2"]])
    drive = SimpleNamespace(ell=gear["ratio"], **gear["drive"])
    residual = float(np.abs(deformation(drive, torque) - printed).max())
    return residual, residual / float(printed[-1])
