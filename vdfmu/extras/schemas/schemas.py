"""JSON schemas of the TOML files, for completion and checks in editors.

They are generated from the readers' tables. Conditions between values, such as ``f_s >= f_c``, and the number of joints
are only checked by the readers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.motion import kinds as kinds_of_motion
from vdfmu.arm.robot import FRICTION_ARRANGEMENTS, SHAPES
from vdfmu.arm.robot.catalogue import NAMED, catalogue
from vdfmu.arm.robot.parameters import ENDS, JOINT_OPTIONS, PARAMETERS, Row, Section, section
from vdfmu.arm.robot.robot_file import PLAIN
from vdfmu.base.measure import JOINT_TYPES, unit_of
from vdfmu.base.version import FORMAT
from vdfmu.compiler.unit import Choice, Input, Parameter, Switch, Unit
from vdfmu.compiler.unit.declaration import Declared
from vdfmu.compiler.unit.interface import general_description
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.system.scenario.scenario import FACTOR_FIELDS, resolve
from vdfmu.system.scenario.scenario_file import KEYS, PAPER_LISTS, load_system

Schema = dict[str, Any]
_TEXT: Schema = {"type": "string"}
_FORMAT: Schema = {"type": "integer", "minimum": 1, "maximum": FORMAT, "description": "Version of the file's layout"}
_FLAG: Schema = {"type": "boolean"}
_POSITIVE: Schema = {"type": "number", "exclusiveMinimum": 0}
_FRICTION: Schema = {"enum": list(FRICTION_ARRANGEMENTS)}
_SIGNAL: Schema = {"type": "string", "pattern": r"^[^.]+\.[^.]+$"}


def robot_schema() -> Schema:
    """Return the schema of a robot file."""
    payload = _table(_rows("payload"), _required("payload"))
    parts: tuple[Section, ...] = ("link", "drive", "friction", *JOINT_OPTIONS)
    tables = {part: _table(_rows(part), _required(part)) for part in parts}
    words = {word: _POSITIVE | {"description": f"{row[2]} [{_units(row[0])}]"} for word, row in PLAIN.items()}
    tables["drive"] = _table(_rows("drive") | words, [])  # a gear, a motor or a plain word may replace the others
    named: Schema = {noun: {"enum": list(catalogue()[f"{noun}s"])} for noun in NAMED}
    joint = _table(
        {"type": {"enum": list(JOINT_TYPES)}} | named | _rows("joint") | tables, ["type", *_required("joint"), "link"]
    )
    keys: Schema = {
        "name": _TEXT,
        "description": _TEXT,
        "friction": _FRICTION,
        **dict.fromkeys(("rotor_coupling", *ENDS, "folded", "tool_on_last_axis"), _FLAG),
        "drive": _TEXT,
        "payload": payload,
        "joints": {"type": "array", "minItems": 1, "items": joint},
        "sources": {"type": "object", "description": "Key of this file to where its number is from"},
        "visuals": _list(_visual()),
    }
    return _file("Robot of vdfmu", keys | _rows("robot"), ["name", *_required("robot"), "joints"])


def scenario_schema(system: str = "system") -> Schema:
    """Return the schema of a scenario file with the sections of a system: a shipped name, or a path."""
    file = load_system(system)
    share: Schema = _POSITIVE | {"exclusiveMaximum": 1}
    factors = {name: _one_or_more(_POSITIVE) for name in FACTOR_FIELDS}
    paper: Schema = {"source": _TEXT} | {name: _list({"type": "number", "minimum": 0}) for name in PAPER_LISTS}
    sections: Schema = {name: {"type": "object"} for name in file.parts}  # an FMU accepts any key
    sections |= {name: _table(_values(unit), []) for name, unit in resolve(file, None).units.items()}
    types: Schema = {
        **dict.fromkeys(("name", "description", "system", "robot", "inputs"), _TEXT),
        "friction": _FRICTION,
        **dict.fromkeys(("stop", "step"), _POSITIVE),
        "algorithm": {"enum": ALGORITHMS.names()},
        **dict.fromkeys(("adaptive", "tolerance"), share),
        "input_hold": _FLAG,
        "payload": _table(_rows("payload") | {"known": _FLAG}, _required("payload")),
        "joints": {"type": "object", "required": ["drive"], "properties": {"drive": _TEXT}},
        "motion": _motion(),
        "plant_factors": _table(factors, []),
        "limits": {"type": "object", "additionalProperties": _POSITIVE},
        "paper": _table(paper, []),
    }
    keys: Schema = {key: types[key] | ({"description": text} if text else {}) for key, text in KEYS.items()}
    return _file("Scenario of vdfmu", sections | keys, ["name", "stop", "step"])


def system_schema() -> Schema:
    """Return the schema of a system file."""
    box = _list({"type": "number"}, 4)
    part = {"unit": _TEXT, "box": box, "robot": _TEXT, **dict.fromkeys(ENDS, _FLAG)}
    keys: Schema = {
        **dict.fromkeys(("extends", "name", "description"), _TEXT),
        "components": {"type": "object", "additionalProperties": {"anyOf": [_TEXT, box, _table(part, [])]}},
        "shared": {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": _TEXT}},
        "connections": {
            "type": "object",
            "propertyNames": _SIGNAL,
            "additionalProperties": {"anyOf": [_SIGNAL, _list(_SIGNAL)]},
        },
    }
    return _file("System of vdfmu", keys, [])


def _file(title: str, properties: Mapping[str, Any], required: Sequence[str]) -> Schema:
    schema = _table({"format": _FORMAT, **properties}, required)
    return {"$schema": "http://json-schema.org/draft-07/schema#", "title": title, **schema}


def _table(properties: Mapping[str, Any], required: Sequence[str]) -> Schema:
    return {"type": "object", "properties": dict(properties), "required": list(required), "additionalProperties": False}


def _motion() -> Schema:
    kinds = [
        _table({"kind": {"const": name}, **dict.fromkeys((*kind.keys, *["file"] * kind.of_file), {})}, ["kind"])
        for name, kind in kinds_of_motion().items()
    ]
    return {"anyOf": [_TEXT, *kinds]}


def _visual() -> Schema:
    number: Schema = {"type": "number"}
    return _table(
        {
            "joint": {"type": "integer", "minimum": 0, "description": "Moving joint; 0 for the base"},
            "shape": {"enum": list(SHAPES)},
            "file": _TEXT | {"description": "Of a mesh"},
            "size": _list(number | {"minimum": 0}) | {"minItems": 1, "maxItems": 3},
            "rotation": _list(_list(number, 3), 3),
            "offset": _list(number, 3) | {"description": "In the link frame [m]"},
            "color": _list(number | {"minimum": 0, "maximum": 1}, 4) | {"description": "Red, green, blue, opacity"},
        },
        ["joint", "shape"],
    )


def _list(items: Schema, size: int | None = None) -> Schema:
    return {"type": "array", "items": items} | ({} if size is None else {"minItems": size, "maxItems": size})


def _one_or_more(item: Schema) -> Schema:
    """Return the schema of a value for all elements, or a list."""
    return {"anyOf": [item, _list(item)]}


def _rows(part: Section) -> Schema:
    return {row.key: _row(row) for row in section(part)}


def _required(part: Section) -> list[str]:
    return [row.key for row in section(part) if row.default is None]


def _row(row: Row) -> Schema:
    smallest = -row.largest if row.smallest is None else row.smallest
    number: Schema = {"type": "number", "minimum": smallest, "maximum": row.largest}
    text: Schema = {"description": f"{row.description} [{_units(row.quantity)}]"}
    if row.default is not None:
        text["default"] = np.asarray(row.default).tolist()
    shaped = number
    for size in reversed(row.shape):
        shaped = _list(shaped, size)
    if row.fold == "inertia":
        return text | {"anyOf": [number, _list(number, 3), shaped]}
    return text | shaped


def _units(quantity: str) -> str:
    """Return the units of a quantity for both types of joint."""
    return " or ".join(dict.fromkeys(unit_of(quantity, joint) for joint in JOINT_TYPES))


def _values(unit: type[Unit]) -> Schema:
    """Return the schema of the parameters and inputs of a unit."""
    kinds = (Parameter, Choice, Switch, Input)
    rows = () if unit.robot_fields is None else (PARAMETERS[name] for name in unit.robot_fields or PARAMETERS)
    texts: Schema = {row.name: {"description": f"{row.description} [{_units(row.quantity)}]"} for row in rows}
    return texts | {d.name: _declared(d) for d in unit.declared.values() if isinstance(d, kinds)}


def _declared(declared: Declared) -> Schema:
    texts = (declared.text,) if isinstance(declared.text, str) else declared.text
    text = "; ".join(dict.fromkeys(map(general_description, texts)))
    quantities = (declared.unit,) if isinstance(declared.unit, str) else declared.unit
    unit = ", ".join(dict.fromkeys(_units(quantity) for quantity in quantities))
    if isinstance(declared, Choice):
        return {"description": text, "enum": list(declared.choices)}
    if isinstance(declared, Switch):
        return {"description": text, "type": "boolean"}
    number: Schema = {"type": "number"}
    number |= {} if declared.minimum is None else {"minimum": declared.minimum}
    number |= {} if declared.maximum is None else {"maximum": declared.maximum}
    return {"description": f"{text} [{unit}]", **(_one_or_more(number) if declared.shape else number)}
