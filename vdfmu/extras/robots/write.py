"""Writes the text of a robot file that is made from another file."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import PARAMETERS, Section, section
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.measure import unit_of
from vdfmu.base.text import amount
from vdfmu.base.toml_file import ROUNDING, toml_text
from vdfmu.extras.robots.chain import SerialChain
from vdfmu.extras.robots.drives import PARTS, DriveNumbers
from vdfmu.extras.robots.tree import MOVING, Body, few

_JOINT = "\n[[joints]]\n"
_HEAD = """\
# {file}, from {base} to {tip}, as a robot file of vdfmu.
# SI units, angles in rad. Frame B_i is fixed to link i; its z axis is the axis of joint i; B_0 is the frame of {base}.
#   rotation  maps B_i to B_(i-1) at q_i = 0: its columns are the axes of B_i in B_(i-1); written row by row
#   offset    origin of B_i in B_(i-1) at q_i = 0 [m]
#   inertia   about the centre of mass, axes of B_i [kg.m2]
# [sources] has the source of each number. Assumed numbers are not in {file}: replace them if you have better values.
"""


def robot_text(
    name: str, file: str, arm: SerialChain, driven: Sequence[DriveNumbers], folder: Path, on_axis: bool = False
) -> str:
    """Return the content of the robot file made from `file`; paths of meshes are relative to `folder`.

    `on_axis` declares that the tool lies on the axis of the last joint.
    """
    description = f"From {file}: {amount(len(arm.bodies), 'joint')} from {arm.base} to {arm.tip}"
    whole = {"gravity": arm.gravity, "tip": arm.tool.placement.p}
    if np.abs(arm.tool.placement.R - np.eye(3)).max() > 1e-9:
        whole["tip_axes"] = arm.tool.placement.R
    joints: list[dict[str, Any]] = []
    sources: list[dict[str, str]] = []
    for body, drive in zip(arm.bodies, driven, strict=True):
        chosen = {part: [row for row in section(part) if row.path in drive.numbers] for part in PARTS}
        joints.append(
            {
                "name": _line(body.joint.name),
                "type": MOVING[body.joint.kind],
                **_entries("joint", {"rotation": body.placement.R, "offset": body.placement.p}),
                "link": _entries("link", {"mass": body.mass, "centroid": body.centroid, "inertia": body.inertia}),
                **{part: {r.key: drive.numbers[r.path][0] for r in rows} for part, rows in chosen.items() if rows},
            }
        )
        placed = f"{file}: origins and axes of the joints; z turned onto the axis"
        where = {row.path: placed for row in section("joint")}
        where |= {row.path: f"{file}: the links in the comment above the joint" for row in section("link")}
        sources.append(where | {path: source for path, (_, source) in drive.numbers.items()})
    content = {
        "name": _line(name[:100]),
        "description": _line(description),
        **{row.key: whole[row.foreign] for row in section("robot") if row.foreign in whole},
        **({"tool_on_last_axis": True} if on_axis else {}),
        "joints": joints,
        "sources": {key: _line(text) for key, text in _sources(file, arm, whole, sources)},
        **({"visuals": [_look(visual, folder) for visual in arm.visuals]} if arm.visuals else {}),
    }
    text, *of_joints = toml_text(content, ROUNDING).split(_JOINT)
    for i, (part, body, drive) in enumerate(zip(of_joints, arm.bodies, driven, strict=True), 1):
        text += f"\n# Joint {i}: {_about(body, drive)}{_JOINT}{part}"
    return _HEAD.format(file=_line(file), base=arm.base, tip=arm.tip) + "\n" + text


def _entries(part: Section, values: dict[str, Any]) -> dict[str, Any]:
    return {row.key: values[row.name] for row in section(part) if row.name in values}


def _about(body: Body, drive: DriveNumbers) -> str:
    joint, unit = body.joint, unit_of("torque", MOVING[body.joint.kind])
    largest = f"# largest torque {drive.rating:.6g} {unit}: {drive.rated_by}"
    joined = ", joined to one body" if len(body.links) > 1 else ""
    return f"{joint.name}, {joint.kind}, moves {few(body.links)}{joined}\n{largest}"


def _sources(
    file: str, arm: SerialChain, imported: Collection[str], joints: list[dict[str, str]]
) -> Iterator[tuple[str, str]]:
    """Yield keys and texts of [sources], with one key for all joints that share a text."""
    texts = {"gravity": "Standard gravity, along z of the root" if arm.standard else f"{file}: gravity"}
    texts |= {"tip": f"{file}: tool {arm.tool.rule}", "tip_axes": f"{file}: tool {arm.tool.rule}"}
    yield from ((row.path, texts[row.foreign]) for row in section("robot") if row.foreign in imported)
    for row in (row for row in PARAMETERS.values() if row.per_joint):
        texts = [joint[row.path] for joint in joints if row.path in joint]
        if len(set(texts)) == 1 and len(texts) == len(joints):
            yield row.path, texts[0]
            continue
        for i, joint in enumerate(joints, 1):
            if row.path in joint:
                yield row.path.replace("joints", f"joints[{i}]", 1), joint[row.path]


def _look(visual: Visual, folder: Path) -> dict[str, Any]:
    table = visual.to_dict()
    if Path(visual.file).is_absolute():
        table["file"] = Path(os.path.relpath(visual.file, folder.resolve())).as_posix()
    return table


def _line(text: str) -> str:
    return " ".join(text.split())
