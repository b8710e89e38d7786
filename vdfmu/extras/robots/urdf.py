"""Reading of URDF.

No library for URDF is used, because the available ones stop at the first wrong number without naming its line, follow
XML entities to other files, and depend on readers of meshes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import read_only
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.text import nearest, printable
from vdfmu.base.toml_tables import Problems
from vdfmu.extras.robots.tree import HERE, MOVING, Joint, Placement, RigidLink, Tree, few, roll_pitch_yaw

_STANDARD_GRAVITY = np.array([0.0, 0.0, 9.81])
_KINDS = (*MOVING, "fixed", "floating", "planar")
_JOINT_NUMBERS = {"limit": ("lower", "upper", "effort", "velocity"), "dynamics": ("damping", "friction")}
_ONE = re.compile(r"\s*[-+]?1(\.0*)?\s*")
_GREY = (0.7, 0.7, 0.7, 1.0)


def read_urdf(root: Any, path: Path, problems: Problems) -> Tree:
    """Return the tree of a URDF and add its problems. The search for meshes starts at `path`."""
    reader = _UrdfReader(path, problems)
    materials = {m.get("name"): m for m in root.findall("material")}
    links: dict[str, RigidLink] = {}
    for element in root.findall("link"):
        name = reader.name(element, links)
        links[name] = reader.link(name, element, materials)
    joints: dict[str, Joint] = {}
    for element in root.findall("joint"):
        name = reader.name(element, joints)
        joints[name] = reader.joint(name, element, links)
    if reader.lost:
        reader.notes.append(f"meshes not found, their names are kept: {few(list(reader.lost))}.")
    geared = [
        printable(joint.get("name", ""))
        for transmission in root.findall("transmission")
        if any(not _ONE.fullmatch(ratio.text or "") for ratio in transmission.iter("mechanicalReduction"))
        for joint in transmission.findall("joint")
    ]
    if geared:
        reader.notes.append(f"ratios of transmissions are ignored; give them in the file of --drives: {few(geared)}.")
    return Tree(
        str(root.get("name") or path.stem),
        problems,
        links,
        tuple(joints.values()),
        _STANDARD_GRAVITY,
        True,
        reader.notes,
    )


class _UrdfReader:
    """Reads elements of a URDF; messages name their lines."""

    def __init__(self, path: Path, problems: Problems) -> None:
        self.path = path
        self.problems = problems
        self.notes: list[str] = []
        self.lost: dict[str, None] = {}

    def add(self, element: Any, label: str, expected: str, got: str, fix: str) -> None:
        """Add a problem about an element."""
        self.problems.add(f"line {element.sourceline}: {label}", expected, got, fix)

    def name(self, element: Any, taken: Mapping[str, Any]) -> str:
        """Return the name of a link or joint, adding a problem if it is already used."""
        kind, name = element.tag, element.get("name", "")
        if not name.strip() or printable(name) != name or "\n" in name:
            expected = "a name of at most 70 characters, none of them a control character"
            self.add(element, kind, expected, repr(name), "Name it.")
        elif name in taken:
            self.add(element, f"{kind} {name}", "one of this name", "a second one", "Rename it.")
        return printable(name) or f"line {element.sourceline}"

    def numbers(self, element: Any, attribute: str, n: int, label: str) -> Floats | None:
        """Return the numbers of an attribute; None if it is missing, ones if they are wrong."""
        text = element.get(attribute)
        if text is None:
            return None
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) == n and all(math.isfinite(number) for number in numbers):
            return np.array(numbers)
        expected = "a finite number" if n == 1 else f"{n} finite numbers"
        self.add(element, f"{label}: {attribute}", expected, repr(text[:60]), "Correct it.")
        return np.ones(n)

    def placement(self, parent: Any, label: str) -> Placement:
        """Return the placement of <origin>: xyz and, about fixed axes, roll, pitch, yaw."""
        origin = parent.find("origin")
        if origin is None:
            return HERE
        xyz, rpy = (self.numbers(origin, key, 3, f"{label}: origin") for key in ("xyz", "rpy"))
        return Placement(roll_pitch_yaw(np.zeros(3) if rpy is None else rpy), np.zeros(3) if xyz is None else xyz)

    def link(self, name: str, element: Any, materials: Mapping[str, Any]) -> RigidLink:
        """Return a link."""
        label = f"link {name}"
        visuals = tuple(v for e in element.findall("visual") for v in self.visual(label, e, materials))
        inertial = element.find("inertial")
        if inertial is None:
            return RigidLink(name, visuals=visuals, collisions=self.collisions(label, element))
        frame = self.placement(inertial, label)
        mass, matrix = inertial.find("mass"), inertial.find("inertia")
        value = None if mass is None else self.numbers(mass, "value", 1, f"{label}: mass")
        if value is None:
            self.add(inertial, label, '<mass value="..."/> in kg', "nothing", "Give it, or remove <inertial>.")
        elif value[0] < 0:
            self.add(mass, f"{label}: mass", "a finite number >= 0 in kg", f"{value[0]:g}", "Correct it.")
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        entries = [None if matrix is None else self.numbers(matrix, key, 1, label) for key in keys]
        missing = [key for key, entry in zip(keys, entries, strict=True) if entry is None]
        if missing:
            expected = "<inertia> with ixx, iyy, izz, ixy, ixz, iyz in kg.m2"
            got = "no <inertia>" if matrix is None else f"no {', '.join(missing)}"
            self.add(inertial, label, expected, got, "Give them about the centre of mass.")
        xx, yy, zz, xy, xz, yz = (0.0 if entry is None else entry[0] for entry in entries)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        mass = 0.0 if value is None else max(float(value[0]), 0.0)
        matrix = frame.R @ inertia @ frame.R.T
        return RigidLink(name, mass, frame.p, matrix, visuals, self.collisions(label, element))

    def collisions(self, label: str, element: Any) -> tuple[Visual, ...]:
        """Return the shapes of every <collision>."""
        return tuple(v for e in element.findall("collision") for v in self.visual(label, e, {}))

    def visual(self, label: str, element: Any, materials: Mapping[str, Any]) -> Iterator[Visual]:
        """Yield the shape of a <visual> or <collision>, if robot files support it."""
        geometry = element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        sizes = {"mesh": ("scale", 3), "box": ("size", 3), "sphere": ("radius", 1), "cylinder": ("radius", 1)}
        if shape is None or shape.tag not in sizes:
            return
        attribute, n = sizes[shape.tag]
        size = self.numbers(shape, attribute, n, f"{label}: {shape.tag}")
        if shape.tag == "cylinder":
            length = self.numbers(shape, "length", 1, f"{label}: cylinder")
            size = None if size is None or length is None else np.array([size[0], length[0]])
        if size is None and shape.tag == "mesh":
            size = np.ones(3)
        if size is None:
            self.add(shape, label, f"a {shape.tag} with its size in m", "no size", "Give it.")
            return
        material = element.find("material")
        if material is not None and material.find("color") is None:
            material = materials.get(material.get("name"))
        color = None if material is None else material.find("color")
        rgba = None if color is None else self.numbers(color, "rgba", 4, f"{label}: color")
        frame = self.placement(element, f"{label}: {element.tag}")
        yield Visual(
            joint=0,
            shape=shape.tag,
            size=read_only(size),
            rotation=frame.R,
            offset=frame.p,
            color=read_only(np.clip(_GREY if rgba is None else rgba, 0.0, 1.0)),
            file=self.mesh(shape.get("filename", ""), element.tag == "visual") if shape.tag == "mesh" else "",
        )

    def mesh(self, name: str, shown: bool) -> str:
        """Return a mesh's path, or its name if it is missing, noted if `shown`. Any folder above may be a package."""
        scheme, separator, rest = name.partition("://")
        rest = rest if separator else name
        places = [self.path.parent / rest]
        if scheme == "package" and separator:
            parts = [part for part in (rest, rest.partition("/")[2]) if part]
            places = [folder / part for folder in self.path.resolve().parents for part in parts]
        try:
            file = next((place for place in places if place.is_file()), None)
        except (OSError, ValueError):
            file = None
        if file is None and shown:
            self.lost[printable(name)] = None
        if file is None:
            return name
        return str(file.resolve())

    def joint(self, name: str, element: Any, links: Mapping[str, RigidLink]) -> Joint:
        """Return a joint."""
        label = f"joint {name}"
        kind = element.get("type", "")
        if kind not in _KINDS:
            self.add(element, f"{label}: type", f"one of {', '.join(_KINDS)}", repr(kind), "Correct it.")
        ends: dict[str, str] = {}
        for tag in ("parent", "child"):
            end = element.find(tag)
            ends[tag] = "" if end is None else end.get("link", "")
            if ends[tag] not in links:
                got = repr(ends[tag]) if ends[tag] else "nothing"
                self.add(element, f"{label}: {tag}", "a link of the file", got, nearest(ends[tag], list(links)))
        numbers: dict[str, float] = {}
        for tag, keys in _JOINT_NUMBERS.items():
            part = element.find(tag)
            for key in keys if part is not None else ():
                number = self.numbers(part, key, 1, f"{label}: {tag}")
                if number is not None:
                    numbers[key] = float(number[0])
        for key in ("damping", "friction"):
            if numbers.get(key, 0.0) < 0:
                self.add(element, f"{label}: {key}", "a number >= 0", f"{numbers[key]:g}", "Correct it.")
        mimic = element.find("mimic")
        follows = "" if mimic is None else mimic.get("joint", "")
        placement, axis = self.placement(element, label), self.axis(label, kind, element)
        return Joint(name, kind, ends["parent"], ends["child"], placement, axis, numbers, follows)

    def axis(self, label: str, kind: str, element: Any) -> Floats:
        """Return the unit axis of a joint, x by default."""
        part = element.find("axis")
        axis = None if part is None else self.numbers(part, "xyz", 3, f"{label}: axis")
        if axis is None or kind not in MOVING:
            return np.array([1.0, 0.0, 0.0])
        length = float(np.linalg.norm(axis))
        if length < 1e-6:  # as some tools write for joints that were made fixed
            self.add(part, f"{label}: axis", "a direction", "zeros", 'Give it, or type="fixed".')
            return np.array([1.0, 0.0, 0.0])
        return axis / length
