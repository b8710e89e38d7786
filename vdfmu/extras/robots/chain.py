"""Extracts the arm from a tree: its joints from base to tip, and the links that each joint moves as one body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vdfmu.arm.robot.parameters import read_only
from vdfmu.arm.robot.physical import check_inertia
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.text import nearest
from vdfmu.base.toml_tables import Problems
from vdfmu.extras.robots.tool import Tool, meters, tool_at_end
from vdfmu.extras.robots.tree import HERE, MOVING, Body, Joint, Mass, Placement, RigidLink, Tree, aligned, few, joined


@dataclass(frozen=True, eq=False)
class SerialChain:
    """An arm: bodies from base to tip, its tool in the frame of the last, gravity (3,) at the base, or `standard`."""

    base: str
    tip: str
    bodies: tuple[Body, ...]
    tool: Tool
    gravity: Floats
    standard: bool
    visuals: tuple[Visual, ...]


def choose_arm(tree: Tree, base: str | None, tip: str | None, tool: Placement | None = None) -> SerialChain | None:
    """Return the arm from a base to a tip, or None after adding problems.

    Other joints are held at 0, and their links become parts of the previous link. {I} is the frame of the base, by
    default the root. The tip is by default the last link, if the tree has only one arm. {O} is the `tool` in its frame,
    or else is derived from the tree.
    """
    problems = tree.problems
    root = _root(tree)
    for option, name in (("--base", base), ("--tip", tip)):
        if name is not None and name not in tree.links:
            problems.add(option, "a link of the file", repr(name), nearest(name, list(tree.links)))
    if problems.lines or root is None:
        return None
    base = root if base is None else base
    tip = _only_tip(tree, base) if tip is None else tip
    path = None if tip is None else _path(tree, base, tip)
    if tip is None or path is None:
        return None
    moving = [joint for joint in path if joint.kind != "fixed"]
    _refuse_joints(tree, moving)
    if not moving:
        expected = f"a joint that moves between {base} and {tip}"
        problems.add("the file", expected, "none", "Choose others by --base, --tip.")
    return None if problems.lines else _assemble(tree, base, tip, path, tool)


def _assemble(tree: Tree, base: str, tip: str, path: list[Joint], place: Placement | None) -> SerialChain:
    """Merge the links of each joint of the arm into one body."""
    on_path = {joint.name for joint in path if joint.kind != "fixed"}
    held: list[Joint] = []
    carried = _carried(tree, base, HERE, on_path, held)
    owner = {link.name: 0 for link, _ in carried}  # number of the joint that moves it
    visuals = _looks(0, np.eye(3), carried)
    bodies: list[Body] = []
    into = HERE  # the last body's frame, in the file's frame of the same link
    at = HERE
    for joint in path:
        at = at @ joint.placement
        if joint.kind == "fixed":
            continue
        frame = Placement(aligned(joint.axis), np.zeros(3))
        carried = _carried(tree, joint.child, HERE, on_path, held)
        placement = Placement(into.R.T, np.zeros(3)) @ at @ frame
        bodies.append(_body(tree, joint, frame.R, placement, carried))
        visuals += _looks(len(bodies), frame.R, carried)
        owner |= {link.name: len(bodies) for link, _ in carried}
        into, at = frame, HERE
    end = Placement(into.R.T, np.zeros(3)) @ at
    if place is not None:
        tool = Tool(end @ place, f"at {meters(place.p)} in the frame of {tip}, as given")
    elif path[-1].kind == "fixed":
        tool = Tool(end, f"at the origin of {tip}, which is fixed to the last link that moves")
    else:
        seen = [visual for visual in visuals if visual.joint == len(bodies)]
        tool = tool_at_end(tip, end, seen or bodies[-1].shapes)
    for name, first, second in tree.loops:
        if owner.get(first, 0) != owner.get(second, 0):
            tree.problems.add(
                name,
                "links of one chain",
                f"a loop: it connects {first} to {second} in addition to the joints",
                "An arm must be an open chain: delete it, or end the arm before it with --tip.",
            )
    if held:
        names = few([joint.name for joint in held])
        tree.notes.append(f"held at 0, because they are not part of the arm: {names}.")
    up = _pose(tree, base).R.T @ tree.gravity
    return SerialChain(base, tip, tuple(bodies), tool, up, tree.standard, tuple(visuals))


def _root(tree: Tree) -> str | None:
    """Return the root link, which no joint carries; add problems if the links are not a tree."""
    carriers: dict[str, list[str]] = {}
    for joint in tree.joints:
        carriers.setdefault(joint.child, []).append(joint.name)
    for link, joints in carriers.items():
        if len(joints) > 1:
            tree.problems.add(
                f"link {link}",
                "one joint that carries it",
                f"the joints {', '.join(joints)}",
                "An arm must be an open chain: delete all but one.",
            )
    roots = [link for link in tree.links if link not in carriers]
    if not tree.links:
        tree.problems.add("the file", "links", "none", "Is it complete? xacro writes a URDF from a .xacro file.")
    elif not roots:
        tree.problems.add("the file", "a link that no joint carries", "none", "The joints go in a circle.")
    elif len(roots) > 1:
        fix = "Join them by fixed joints, or delete what is not a part of the arm."
        tree.problems.add("the file", "one link that no joint carries", ", ".join(roots), fix)
    elif not tree.problems.lines:
        queue = roots[:]
        for link in queue:
            queue += [joint.child for joint in tree.below[link]]
        reached = set(queue)
        circle = [link for link in tree.links if link not in reached]
        if circle:
            tree.problems.add("the file", f"links that hang on {roots[0]}", few(circle), "Their joints go in a circle.")
    return roots[0] if len(roots) == 1 else None


def _only_tip(tree: Tree, base: str) -> str | None:
    """Return the last link of the only arm on a base; if there are several, add a problem with their tips."""
    link = base
    while True:
        last, onward = _onward(tree, link)
        if not onward:
            return last
        if len(onward) > 1:
            ends = tips(tree, base)
            names = few([f"{name} ({n} joint{'s' * (n > 1)})" for n, name in ends])
            tree.problems.add(
                "--tip",
                "a link",
                f"nothing, and {len(onward)} joints branch off from {link}",
                f"Choose where the arm ends; all other joints are held at 0. There are: {names}.",
            )
            return None
        link = onward[0].child


def _rigid(tree: Tree, link: str, far: int = 0) -> Iterator[tuple[int, str]]:
    """Yield a link and the links fixed to it, outward, with the number of fixed joints to them."""
    yield far, link
    for joint in tree.below[link]:
        if joint.kind == "fixed":
            yield from _rigid(tree, joint.child, far + 1)


def _onward(tree: Tree, link: str) -> tuple[str, list[Joint]]:
    """Return the last link that is fixed to a link, and the joints from there, except coupled ones, as of a gripper."""
    rigid = list(_rigid(tree, link))
    moving = [joint for _, name in rigid for joint in tree.below[name] if joint.kind != "fixed"]
    onward = [joint for joint in moving if not joint.follows and joint.name not in tree.coupled]
    return max(rigid, key=lambda entry: entry[0])[1], onward


def tips(tree: Tree, base: str) -> list[tuple[int, str]]:
    """Return possible ends of arms: the last links before a chain branches or ends, with the number of joints."""

    def walk(link: str, n: int) -> Iterator[tuple[int, str]]:
        last, onward = _onward(tree, link)
        if n and len(onward) != 1:
            yield n, last
        for joint in onward:
            yield from walk(joint.child, n + 1)

    return sorted(walk(base, 0), key=lambda tip: -tip[0])


def _path(tree: Tree, base: str, tip: str) -> list[Joint] | None:
    """Return the joints from a base to a tip; add a problem if the tip is not attached to the base."""
    path: list[Joint] = []
    link = tip
    while link != base:
        joint = tree.above.get(link)
        if joint is None:
            above = [joint.parent for joint in path]
            fix = f"Choose the base among {', '.join(above)}." if above else "It is the root of the file."
            tree.problems.add("--tip", f"a link that hangs on {base}", tip, fix)
            return None
        path.append(joint)
        link = joint.parent
    return path[::-1]


def _refuse_joints(tree: Tree, moving: list[Joint]) -> None:
    """Add a problem for each joint that is not allowed in an arm."""
    on_path = {joint.name for joint in moving}
    for joint in moving:
        key = f"joint {joint.name}"
        if joint.kind not in MOVING:
            fix = f'Choose a base above it, --base {joint.child}, or make it type="fixed".'
            tree.problems.add(key, f"one of {', '.join(MOVING)}, fixed", joint.kind, fix)
        if joint.follows:
            tree.problems.add(
                key,
                "a joint with its own drive",
                f"one that mimics {joint.follows}",
                f"End the arm before it, --tip {joint.parent}, or delete its <mimic>.",
            )
    for joint in tree.joints:
        if joint.name not in on_path and joint.follows in on_path:
            tree.problems.add(
                f"joint {joint.name}",
                "no other moving joint",
                f"one that mimics {joint.follows}, a joint of the arm",
                "End the arm before that by --tip, or delete the <mimic>: it is held at 0 then.",
            )


def _carried(
    tree: Tree, link: str, at: Placement, on_path: set[str], held: list[Joint]
) -> list[tuple[RigidLink, Placement]]:
    """Return the links that move with a link, and their placements in its frame."""
    carried = [(tree.links[link], at)]
    for joint in tree.below[link]:
        if joint.name in on_path:
            continue
        if joint.kind != "fixed":
            held.append(joint)
        carried += _carried(tree, joint.child, at @ joint.placement, on_path, held)
    return carried


def _body(
    tree: Tree, joint: Joint, R: Floats, placement: Placement, carried: list[tuple[RigidLink, Placement]]
) -> Body:
    """Merge links into one body, in the frame whose axes in the child's frame are the columns of R."""
    heavy = [(link, at) for link, at in carried if link.mass > 0.0 or link.inertia.any()]
    names = tuple(link.name for link, _ in heavy or carried)
    parts = heavy or [(RigidLink(""), HERE)]
    whole = joined([Mass(ln.mass, at.p + at.R @ ln.centroid, at.R @ ln.inertia @ at.R.T) for ln, at in parts])
    shapes = _looks(0, R, [(replace(link, visuals=link.solid), at) for link, at in carried])
    inertia = R.T @ whole.inertia @ R
    inertia = (inertia + inertia.T) / 2
    if whole.mass:
        bare = [link.name for link, _ in carried if link.visuals and not link.mass]
        if bare:
            tree.notes.append(f"joint {joint.name}: the file has no mass for {few(bare)}.")
        of_body, of_links = Problems(""), Problems("")
        check_inertia(of_body, "", inertia)
        for link, _ in heavy:
            check_inertia(of_links, f"link {link.name}", link.inertia)
        if not of_body.lines:
            tree.notes.extend(line.removeprefix(": ") for line in of_links.lines)
    return Body(joint, names, placement, whole.mass, R.T @ whole.centroid, inertia, tuple(shapes))


def _looks(joint: int, R: Floats, carried: list[tuple[RigidLink, Placement]]) -> list[Visual]:
    """Return the visuals of links in the frame of the body."""
    placed: list[Visual] = []
    for link, at in carried:
        for visual in link.visuals:
            rotation, offset = Placement(R.T, np.zeros(3)) @ at @ Placement(visual.rotation, visual.offset)
            placed.append(replace(visual, joint=joint, rotation=read_only(rotation), offset=read_only(offset)))
    return placed


def _pose(tree: Tree, link: str) -> Placement:
    """Return the placement of a link in the root's frame, all joints at 0."""
    joint = tree.above.get(link)
    return HERE if joint is None else _pose(tree, joint.parent) @ joint.placement
