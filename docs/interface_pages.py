"""Reference pages made from the tables of the package: the variables of the units, and the file of a robot."""

from __future__ import annotations

from itertools import groupby
from typing import Any
from xml.etree.ElementTree import Element

from vdfmu.arm.robot import load_robot
from vdfmu.arm.robot.parameters import JOINT_OPTIONS, PARAMETERS
from vdfmu.arm.units import package_units, shipped_units
from vdfmu.base.toml_tables import POSITIVE
from vdfmu.compiler.fmu.description import model_description, model_description_3
from vdfmu.compiler.unit.interface import Array, Interface, general_description
from vdfmu.compiler.unit.variable import Variable


def interface_page() -> str:
    """Return the reference of all variables of the units, in markdown."""
    arm, slider = load_robot("manipulator_6dof").unfolded(), load_robot("slider_3dof")
    lines = [_HEAD]
    for unit in package_units().values():
        interface = Interface(unit, arm if unit.needs_robot() else None)
        joints = Interface(unit, slider) if unit.needs_robot() else ()
        prismatic = {v.group: v.unit for v in joints if v.index[:1] == (1,)}
        lines += [f"## {interface.model_name}", "", f"{interface.description}. Unit `{interface.name}`."]
        for causality, title in _TITLES.items():
            groups = [
                list(g)
                for _, g in groupby((v for v in interface.memory if v.causality == causality), lambda v: v.group)
            ]
            if groups:
                lines += ["", f"**{title}**", "", *_rows(interface, causality, groups, prismatic)]
        lines.append("")
    return "\n".join([*lines, _FLAGS, _capabilities(), ""])


def robot_file_page() -> str:
    """Return the reference of a robot file, in markdown."""
    lines = [_ROBOT_HEAD]
    rows = sorted(PARAMETERS.values(), key=lambda row: list(_TABLES).index(row.table))
    for table, group in groupby(rows, lambda row: row.table):
        lines += ["", f"## {_TABLES[table]}", "", "| key | unit | numbers | default | equation | what it is |"]
        lines.append("| --- " * 6 + "|")
        for row in group:
            unit, prismatic = row.unit(), row.unit("prismatic")
            size = "symmetric 3 × 3" if row.fold == "inertia" else " × ".join(map(str, row.shape))
            low = "" if row.smallest is None else "> 0" if row.smallest == POSITIVE else f"≥ {row.smallest:g}"
            high = f"at most {row.largest:g}" if row.fold != "always" else ""
            cells = (
                f"`{row.key}`",
                unit + (f" [{prismatic}]" if prismatic != unit else ""),
                ", ".join(part for part in (size, low, high) if part),
                "" if row.default is None else f"{row.default:g}" if isinstance(row.default, float) else "unit matrix",
                row.equation,
                _text(row.text[0].upper() + row.text[1:].replace(", Eq. {}", "").replace(" of Eq. {}", "")),
            )
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


_TABLES = {
    "": "Top of the file",
    "payload": "[payload]",
    "joints": "[[joints]]",
    "joints.link": "[joints.link]",
    "joints.drive": "[joints.drive]",
    "joints.friction": "[joints.friction]",
    **{f"joints.{option}": f"[joints.{option}]" for option in JOINT_OPTIONS},
}
_TITLES = {
    "input": "Inputs",
    "output": "Outputs",
    "parameter": "Parameters",
    "local": "Derivatives of the states (native FMUs)",
}
_COLUMNS = {
    "input": ("name", "value reference", "FMI 3.0", "unit", "start", "description"),
    "output": ("name", "value reference", "FMI 3.0", "unit", "depends on inputs", "description"),
    "parameter": (
        "name", "value reference", "FMI 3.0", "variability", "unit", "start", "min", "max", "description",
    ),
    "local": ("name", "value reference", "FMI 3.0", "unit", "description"),
}  # fmt: skip


def _rows(
    interface: Interface, causality: str, groups: list[list[Variable]], prismatic: dict[str, str | None]
) -> list[str]:
    columns = _COLUMNS[causality]
    lines = ["| " + " | ".join(columns) + " |", "| --- " * len(columns) + "|"]
    position = {v.name: i for i, v in enumerate(interface.memory)}
    for group in groups:
        first, last = group[0], group[-1]
        unit = ", ".join(f"`{u}`" for u in dict.fromkeys(v.unit for v in group) if u)
        other = prismatic.get(first.group)
        if other and other != first.unit and first.unit:
            unit += f", prismatic `{other}`"
        references = [position[v.name] for v in (first, last)]
        outputs = group if causality == "output" else []
        sources = (interface.memory[i] for v in outputs for i in interface.step_dependencies(position[v.name]))
        used = {v.group: None for v in sources if v.causality == "input"}
        cells = {
            "name": f"`{first.name}`" + (f" .. `{last.name}`" if len(group) > 1 else ""),
            "value reference": str(references[0]) + (f" .. {references[1]}" if len(group) > 1 else ""),
            "FMI 3.0": _array(interface.arrays[interface.owners[references[0]]], len(group)),
            "variability": first.variability if first.type == "Real" else f"{first.variability}, {first.type}",
            "unit": unit,
            "start": _range([v.start for v in group]),
            "min": "" if first.minimum is None else f"{first.minimum:g}",
            "max": "" if first.maximum is None else f"{first.maximum:g}",
            "depends on inputs": ", ".join(f"`{name}`" for name in used) or "none",
            "description": _text("; ".join(dict.fromkeys(general_description(v.description) for v in group))),
        }
        lines.append("| " + " | ".join(cells[column] for column in columns) + " |")
    return lines


def _text(description: str) -> str:
    """Return a description whose frame, ``{I}``, is not taken for attributes of the cell."""
    return description.replace("{", "&#123;").replace("}", "&#125;")


def _array(array: Array, members: int) -> str:
    """Return what FMI 3.0 makes of a group: one array, or its elements by themselves."""
    if array.shape:
        return "array " + " × ".join(map(str, array.shape))
    return "scalar" if members == 1 else "scalars"


def _range(values: list[Any]) -> str:
    shown = list(dict.fromkeys(f"{v:g}" if isinstance(v, float) else str(v).lower() for v in values))
    if len(shown) <= 3:
        return ", ".join(shown)
    return f"{min(values):g} to {max(values):g}"


def _capabilities() -> str:
    plant = Interface(shipped_units()["plant"], load_robot("planar_2dof"))
    roots = (
        ("Python, co-simulation", model_description(plant, "{}", "", {}).find("CoSimulation")),
        *_interfaces("2.0", model_description(plant, "{}", "", {}, ())),
        *_interfaces("3.0", model_description_3(plant, "{}", "", {})),
    )
    flags: dict[str, None] = {}
    for _, element in roots:
        flags |= dict.fromkeys(element.attrib)  # pyright: ignore[reportOptionalMemberAccess]
    del flags["modelIdentifier"]
    lines = ["| flag | " + " | ".join(name for name, _ in roots) + " |", "| --- " * (len(roots) + 1) + "|"]
    for flag in flags:
        values = (element.get(flag) for _, element in roots)  # pyright: ignore[reportOptionalMemberAccess]
        lines.append(f"| `{flag}` | " + " | ".join(f"`{v}`" if v else "" for v in values) + " |")
    return "\n".join(lines)


def _interfaces(version: str, root: Element) -> list[tuple[str, Element | None]]:
    names = {"CoSimulation": "co-simulation", "ModelExchange": "model exchange"}
    return [(f"FMI {version}, {name}", root.find(tag)) for tag, name in names.items()]


_HEAD = """---
hide: [toc]
---

# FMU interface

All variables of the FMUs, with names, units, start values, bounds and dependencies. This page and the FMUs are
generated from the same declarations, in `vdfmu/arm/units/`.

It shows the interface for the paper's arm, `manipulator_6dof`. For another robot the variables are the same,
but the arrays have its number of joints. Indices in names count from 1. The start values of the robot's parameters are
those of its file. Numbers that are zero because of the arm's geometry, such as offsets, are
[folded](../native.md#limits) into the equations, so they are not variables. The parameters of the kinematic error exist
only if its amplitude is not zero, and `f_ck` only if the friction is `split`.

A *fixed* parameter can be set until the initialization ends, a *tunable* one at every communication point. A minimum
of 1e-12 means "positive", because FMI has no strict bounds. `1e+12` at `tau_max` means "no limit".

The column *FMI 3.0* shows the shapes of the arrays in FMI 3.0. An array has the value reference of its first element.
Native FMUs of FMI 3.0 also have `time`, with the last value reference. Only native FMUs have derivatives of states.
See [FMUs](../native.md#variables). The [capability flags](#capability-flags) are at the end.

"""

_ROBOT_HEAD = """---
hide: [toc]
---

# Robot file

Every key of a robot file, with its unit, bounds and default. This page is generated from the table with which files are
checked, `vdfmu/arm/robot/parameters.py`.

A robot is one TOML file. [Your own arm](../tutorials/own_arm.md) has examples, from a URDF and without one. All
problems of a file are reported together. In addition to the numbers below, a file can have these keys:

| key | value |
| --- | --- |
| `name`, `description` | text |
| `friction` | `"lumped"` (default) or `"split"`: [friction](../model.md#friction) |
| `rotor_coupling` | `true` (default) or `false`: [the rotor as a body](../model.md#the-rotor-as-a-body) |
| `moving_base`, `coupled_tool` | `false` (default) or `true`: [coupled ends](../world.md) |
| `tool_on_last_axis` | `true` if the tool is meant to be on the axis of the last joint, as a flange; default `false` |
| `folded` | `true` (default) or `false`: zeros are [constants or parameters](../native.md#limits) in runs |
| `type` of a joint | `"revolute"` or `"prismatic"` |
| `stiffness` in `[joints.drive]` | linear spring, link-side, N.m/rad [N/m]; instead of `K_f0`, `c_f`, `K_w0`, `c_w` |
| `rotor_inertia` in `[joints.drive]` | inertia of the motor, kg.m2; instead of `I_m`, which is `ell` times as large |
| `gear`, `motor` of a joint | [a name in the catalogue](../drives.md#the-catalogue) |
| `[sources]` | `"joints.link.mass" = ".."` for all joints, `"joints[2].link.mass"` for one |
| `[[visuals]]` | shapes of the links, for views only |

A visual has `joint` (0 for the base), `shape` (mesh, box, ellipsoid, cylinder, capsule, sphere), `file` of a mesh,
`size`, `rotation` and `offset` in the link frame, and `color` (red, green, blue, opacity). `size` is the scale of a
mesh, the sides of a box, the half-axes of an ellipsoid, radius and length along z of a cylinder or capsule, or the
radius of a sphere.

`[payload]` is optional. Tables of [options](../drives.md#options) such as `[joints.limits]` are optional too, but
either all joints must have such a table or none.

Units are SI, angles in rad. A unit in brackets belongs to a prismatic joint. [Notation](notation.md) has the
symbols. An inertia can be one number for all axes, or three principal moments. The inertia of a payload can be 0.
"""

_FLAGS = """## Capability flags

Those of the plant. The other units have no model exchange and no early return.
"""
