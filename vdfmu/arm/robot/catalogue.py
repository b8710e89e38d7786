"""Gears and motors by name: the tables of a joint that the catalogue has for them."""

from functools import cache
from typing import Any

from vdfmu.arm.robot.parameters import JOINT_OPTIONS, PARAMETERS
from vdfmu.base.files import data_path
from vdfmu.base.text import nearest
from vdfmu.base.toml_file import read_toml
from vdfmu.base.toml_tables import Problems, value_text

NAMED = ("gear", "motor")
"""Keys of a joint that name an entry."""
_ALWAYS = ("drive", "friction")
"""Tables of a joint that an entry fills where the file has none; options are filled where the file has their table."""
_SPRING = ("K1", "K2", "K3", "T1", "T2")
_CALCULATED_OF = {"drive": _SPRING, "hysteresis": (*_SPRING, "hysteresis_loss")}
"""Tables of a gear to its printed numbers from which they are calculated; others have none that is assumed."""
_FILE = "models/drives/catalogue.toml"

Tables = dict[str, dict[str, tuple[float, str]]]
"""Table of a joint to its numbers, and where each is from."""


@cache
def catalogue() -> dict[str, dict[str, Any]]:
    """Return ``gears`` and ``motors`` by name, and ``sources``, texts by key."""
    return read_toml(data_path("models") / "drives" / "catalogue.toml")


_OF_RATIO = {"N.m/rad": 2, "1/(N.m)": -1}
"""Units of motor-side numbers of springs, to the power of the ratio that makes them of those of the link side."""


def assumed(entry: dict[str, Any], part: str = "hysteresis") -> list[str]:
    """Names of the numbers of a gear, of which a table of it is calculated, that are assumed."""
    texts, of_part = catalogue()["sources"], _CALCULATED_OF.get(part, ())
    made_up = [keys for source, keys in entry["sources"].items() if texts[source].startswith("Assumed")]
    return [key for keys in made_up for key in keys if key in of_part]


def tables_of(problems: Problems, path: str, named: dict[str, Any], kind: str, ell: Any = None) -> Tables:
    """Return the tables that the catalogue has for the gear and the motor that a joint at `path` of a file names.

    `kind` is revolute or prismatic, and `ell` the joint's own reduction ratio, if it has one.
    """
    found: Tables = {}
    entries: dict[str, dict[str, Any]] = {}
    for what in NAMED:
        name, known = named.get(what), catalogue()[f"{what}s"]
        if isinstance(name, str) and name in known:
            entries[what] = known[name]
        elif what in named:
            way_out = nearest(name, list(known)) if isinstance(name, str) else "Give it as a string."
            problems.add(f"{path}.{what}", f"a {what} of the catalogue", value_text(name), way_out)
    gear, motor = (entries.get(what, {}) for what in NAMED)
    if gear and kind == "prismatic":
        problems.add(
            f"{path}.gear", "none on a prismatic joint", value_text(named["gear"]), "Give [joints.drive] itself."
        )
    ratio = ell if isinstance(ell, (int, float)) and ell > 0 else gear.get("ratio")
    for what, entry in entries.items():
        for part in (*_ALWAYS, *JOINT_OPTIONS):
            source = f"{_FILE}: {what} {named[what]}"
            if what == "gear" and assumed(entry, part):
                source += f"; assumed there: {', '.join(assumed(entry, part))}"
            for key, value in entry.get(part, {}).items():
                if PARAMETERS[key].quantity == "velocity" and what == "motor":
                    if not ratio:
                        continue
                    value = value / ratio
                power = _OF_RATIO.get(PARAMETERS[key].quantity)
                if (what, part) == ("gear", "drive") and power:  # the link side stays as printed
                    value = value * (gear["ratio"] / ratio) ** power
                found.setdefault(part, {})[key] = value, source
    if gear:
        found["drive"]["ell"] = gear["ratio"], f"{_FILE}: gear {named['gear']}"
    if motor and ratio:
        both = " and ".join(f"{what} {named[what]}" for what in entries)
        inertia = sum(entry["inertia"] for entry in entries.values())
        found.setdefault("drive", {})["I_m"] = ratio * inertia, f"{_FILE}: inertia of {both}, times ell"
    return found


def filled_from_catalogue(problems: Problems, joint: Any, path: str) -> tuple[Any, dict[str, str]]:
    """Return a joint's table, filled_from_catalogue from the catalogue, and the sources of what was added by key."""
    if not isinstance(joint, dict) or not any(what in joint for what in NAMED):
        return joint, {}
    own = {part: joint[part] for part in (*_ALWAYS, *JOINT_OPTIONS) if isinstance(joint.get(part), dict)}
    found = tables_of(problems, path, joint, joint.get("type", ""), own.get("drive", {}).get("ell"))
    sources: dict[str, str] = {}
    filled = {part: found[part] for part in found if part in own or (part in _ALWAYS and part not in joint)}
    for part, numbers in filled.items():
        missing = {key: number for key, number in numbers.items() if key not in own.get(part, {})}
        own[part] = {key: value for key, (value, _) in missing.items()} | own.get(part, {})
        sources |= {f"{path}.{part}.{key}": source for key, (_, source) in missing.items()}
    return {key: value for key, value in joint.items() if key not in NAMED} | own, sources
