"""Reads MJCF files with MuJoCo, whose compiler resolves defaults, includes, and inertia from shapes."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot.parameters import read_only
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import open_regular
from vdfmu.base.text import printable
from vdfmu.base.toml_file import read_bytes
from vdfmu.base.toml_tables import Problems
from vdfmu.extras.robots.tree import HERE, Joint, Placement, RigidLink, Tree, aligned

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_CONNECT, _WELD, _JOINT = range(3)
_SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
"""Shapes by number in MuJoCo's mjtGeom."""
_OF_JOINT = 1
"""Kind of a tendon's part along a joint in MuJoCo's mjtWrap."""
_SQUARED = ("damping", "armature")
"""Parameters of a rotor that are ell^2 times as large link-side; the others are ell times as large."""
_REST = 1e-9
"""Fraction of a rotor's axial inertia that stays in its link, so that the link's inertia is valid."""
_VISIBLE = 3
"""First group of shapes that MuJoCo's viewer hides."""


def read_mjcf(path: Path, problems: Problems, sites: bool = False) -> Tree:
    """Return the tree of a MuJoCo file with bodies, and optionally `sites`, as links.

    Raises ModelError if MuJoCo rejects the file, and UsageError without MuJoCo.
    """
    try:
        mujoco: Any = import_module("mujoco")
    except ImportError as error:
        raise UsageError(
            f"{path}: MJCF needs the package mujoco: {error}. Install it: pip install 'vdfmu[robots]'."
        ) from None
    _require_regular(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except Exception as error:  # the error's type depends on the version
        text = " ".join(str(error).split())
        raise ModelError(f"{path}: expected a model that MuJoCo compiles, got: {text}. Correct it.") from None
    return _MjcfReader(model, path, problems).tree(sites)


_NAMED = re.compile(rb"""\bfile\s*=\s*["']([^"']+)["']""")
_FOLDERS = re.compile(rb"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"']+)["']""")
_LARGEST = 2**26
"""Largest file that is included [byte]."""


def _require_regular(path: Path) -> None:
    """Raise ModelError if the model names a pipe, a device or a folder, because MuJoCo would wait for a pipe."""
    texts, folders, names = [read_bytes(path, "an MJCF file", _LARGEST)], {path.parent}, dict[str, None]()
    for text in texts:  # names from includes are added below
        folders |= {path.parent / html.unescape(name.decode(errors="replace")) for name in _FOLDERS.findall(text)}
        for name in (html.unescape(quoted.decode(errors="replace")) for quoted in _NAMED.findall(text)):
            if name not in names and Path(name).suffix.lower() == ".xml" and (path.parent / name).exists():
                texts.append(read_bytes(path.parent / name, "an MJCF file", _LARGEST))
            names[name] = None
    for place in (folder / name for name in names for folder in folders):
        if place.exists():
            try:
                open_regular(place).close()
            except OSError as error:
                raise ModelError(f"{path}: {place} must be a regular file: {error.strerror}.") from None


class _Rotor(NamedTuple):
    """The rotor of a joint: its joint, inertia, the tendon that is its spring, gear ratio, link-side stiffness."""

    joint: int
    inertia: float
    tendon: int
    ell: float
    K: float


class _MjcfReader:
    """A compiled model."""

    def __init__(self, model: Any, path: Path, problems: Problems) -> None:
        self.model = model
        self.path = path
        self.problems = problems
        self.notes: list[str] = []
        self.bodies = [printable(model.body(i).name) or f"body {i}" for i in range(model.nbody)]
        self.names = [printable(model.joint(j).name) or self._unnamed(j) for j in range(model.njnt)]
        self.rotors = dict(self._rotors())
        self.rotor_of = {int(model.jnt_bodyid[rotor.joint]): rotor for rotor in self.rotors.values()}

    def _unnamed(self, j: int) -> str:
        body = int(self.model.jnt_bodyid[j])
        number = j - int(self.model.body_jntadr[body]) + 1
        return f"joint {number} of {self.bodies[body]}"

    def _rotors(self) -> Iterator[tuple[int, _Rotor]]:
        """Yield each joint with its rotor: a body without children on the same parent, coupled by a tendon."""
        m = self.model
        for t in range(m.ntendon):
            wraps = [int(m.tendon_adr[t]) + k for k in range(int(m.tendon_num[t]))]
            if len(wraps) != 2 or any(int(m.wrap_type[w]) != _OF_JOINT for w in wraps):
                continue
            for ours, its in (wraps, wraps[::-1]):
                joint, rotor = int(m.wrap_objid[ours]), int(m.wrap_objid[its])
                link, body = int(m.jnt_bodyid[joint]), int(m.jnt_bodyid[rotor])
                ell = -float(m.wrap_prm[ours] / m.wrap_prm[its])
                K = float(np.ravel(m.tendon_stiffness[t])[0]) * float(m.wrap_prm[ours]) ** 2
                alone = body not in m.body_parentid and m.body_jntnum[body] == 1 and m.jnt_type[rotor] == _HINGE
                if alone and m.body_parentid[body] == m.body_parentid[link] and ell >= 1.0 and K > 0.0:
                    axis = _rotation(m.body_iquat[body]).T @ m.jnt_axis[rotor]
                    yield joint, _Rotor(rotor, float(m.body_inertia[body] @ axis**2), t, ell, K)
                    break

    def tree(self, sites: bool) -> Tree:
        """Return the tree of the model, optionally with sites as links fixed to bodies."""
        m = self.model
        links: dict[str, RigidLink] = {}
        joints: list[Joint] = []
        for i, name in enumerate(self.bodies):
            links[name] = self.link(i, name)
            if i:
                joints += self.carriers(i, links)
        for s in range(m.nsite if sites else 0):
            name, place = printable(m.site(s).name), Placement(_rotation(m.site_quat[s]), np.array(m.site_pos[s]))
            if name and links.setdefault(name, site := RigidLink(name)) is site:  # a body keeps its name
                parent = self.bodies[int(m.site_bodyid[s])]
                joints.append(Joint(f"{name} (site)", "fixed", parent, name, place, np.array([1.0, 0.0, 0.0])))
        stiff = [self.names[j] for j in range(m.njnt) if np.any(m.jnt_stiffness[j])]
        if stiff:
            self.notes.append(f"springs at joints are ignored: {', '.join(stiff)}.")
        unread = {*range(m.ntendon)} - {rotor.tendon for rotor in self.rotors.values()}
        tendons = [printable(m.tendon(i).name) or f"tendon {i}" for i in sorted(unread)]
        if tendons:
            self.notes.append(f"tendons are ignored: {', '.join(tendons)}.")
        return Tree(
            self.path.stem,
            self.problems,
            links,
            tuple(joints),
            -np.array(m.opt.gravity),
            False,
            self.notes,
            self.loops(),
        )

    def link(self, i: int, name: str) -> RigidLink:
        """Return a body as a link."""
        m = self.model
        R = _rotation(m.body_iquat[i])
        inertia = R @ np.diag(m.body_inertia[i]) @ R.T
        if i in self.rotor_of:  # the rotating part belongs to the drive, the rest to the link that carries it
            axis = np.array(m.jnt_axis[self.rotor_of[i].joint])
            inertia = inertia - (1.0 - _REST) * self.rotor_of[i].inertia * np.outer(axis, axis)
        first, count = int(m.body_geomadr[i]), int(m.body_geomnum[i])
        shapes = [self.visual(g) for g in range(first, first + count) if m.geom_group[g] < _VISIBLE]
        visuals = tuple(shape for shape in shapes if shape is not None)
        return RigidLink(name, float(m.body_mass[i]), np.array(m.body_ipos[i]), (inertia + inertia.T) / 2, visuals)

    def carriers(self, i: int, links: dict[str, RigidLink]) -> list[Joint]:
        """Return the joints that carry a body, with added links between several joints or to a joint off its origin."""
        m, name = self.model, self.bodies[i]
        parent = self.bodies[int(m.body_parentid[i])]
        at = Placement(_rotation(m.body_quat[i]), np.array(m.body_pos[i]))
        first, count = int(m.body_jntadr[i]), int(m.body_jntnum[i])
        if i in self.rotor_of:
            return [Joint(f"{name} (fixed)", "fixed", parent, name, at, np.array([1.0, 0.0, 0.0]))]
        joints: list[Joint] = []
        here = np.zeros(3)  # the last joint's origin in the body's frame
        for j in range(first, first + count):
            kind, axis = int(m.jnt_type[j]), np.array(m.jnt_axis[j])
            anchor = np.array(m.jnt_pos[j]) if kind in (_SLIDE, _HINGE) else here
            zero = self.zero(j, kind, axis)
            last = j == first + count - 1
            child = name if last and not anchor.any() else f"{name} at {self.names[j]}"
            links.setdefault(child, RigidLink(child))
            joints.append(
                Joint(
                    self.names[j],
                    self.kind(j, kind),
                    parent,
                    child,
                    at @ Placement(np.eye(3), anchor - here) @ zero,
                    axis,
                    self.joint_numbers(j, kind),
                    self.follows(j),
                )
            )
            parent, at, here = child, HERE, anchor
        if parent != name:
            fixed = at @ Placement(np.eye(3), -here)
            joints.append(Joint(f"{name} (fixed)", "fixed", parent, name, fixed, np.array([1.0, 0.0, 0.0])))
        return joints

    def kind(self, j: int, kind: int) -> str:
        """Return the kind of a joint, as in URDF."""
        turns = "revolute" if self.model.jnt_limited[j] else "continuous"
        return {_FREE: "floating", _BALL: "ball", _SLIDE: "prismatic", _HINGE: turns}[kind]

    def zero(self, j: int, kind: int, axis: Floats) -> Placement:
        """Return the position in the file's pose that is q = 0, since that pose is at the joint's `ref`."""
        if kind not in (_SLIDE, _HINGE):
            return HERE
        ref = float(self.model.qpos0[self.model.jnt_qposadr[j]])
        if kind == _SLIDE:
            return Placement(np.eye(3), -ref * axis)
        R, (c, s) = aligned(axis), (np.cos(ref), np.sin(ref))
        return Placement(R @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R.T, np.zeros(3))

    def joint_numbers(self, j: int, kind: int) -> dict[str, float]:
        """Return limits, damping, friction, armature and effort of a joint; the default 0 is treated as missing."""
        m = self.model
        if kind not in (_SLIDE, _HINGE):
            return {}
        numbers: dict[str, float] = {}
        if m.jnt_limited[j]:
            numbers |= {"lower": float(m.jnt_range[j][0]), "upper": float(m.jnt_range[j][1])}
        sizes = self.sizes(j)
        if j in self.rotors:
            rotor, inertia, _, ell, K = self.rotors[j]
            of_rotor = self.sizes(rotor)
            of_rotor["armature"] += inertia
            sizes = {key: size + ell ** (1 + (key in _SQUARED)) * of_rotor[key] for key, size in sizes.items()}
            sizes |= {"ell": ell, "stiffness": K}
        return numbers | {key: size for key, size in sizes.items() if size > 0.0}

    def sizes(self, j: int) -> dict[str, float]:
        """Return damping, friction, armature and effort of a joint."""
        m, at = self.model, int(self.model.jnt_dofadr[j])
        sizes = {"damping": m.dof_damping[at], "friction": m.dof_frictionloss[at], "armature": m.dof_armature[at]}
        return {key: float(np.ravel(size)[0]) for key, size in sizes.items()} | {"effort": self.effort(j)}

    def effort(self, j: int) -> float:
        """Return the largest torque of a joint's actuators; 0 without a bound."""
        m, whole = self.model, 0.0
        for a in range(m.nu):
            if int(m.actuator_trntype[a]) != 0 or int(m.actuator_trnid[a][0]) != j:
                continue
            if m.actuator_forcelimited[a]:
                force = float(np.abs(m.actuator_forcerange[a]).max())
            elif m.actuator_ctrllimited[a] and int(m.actuator_biastype[a]) == int(m.actuator_gaintype[a]) == 0:
                force = float(np.abs(m.actuator_gainprm[a][0] * m.actuator_ctrlrange[a]).max())
            else:
                return float(np.abs(m.jnt_actfrcrange[j]).max()) if m.jnt_actfrclimited[j] else 0.0
            whole += force * abs(float(m.actuator_gear[a][0]))
        if m.jnt_actfrclimited[j]:
            bound = float(np.abs(m.jnt_actfrcrange[j]).max())
            whole = min(whole, bound) if whole else bound
        return whole

    def follows(self, j: int) -> str:
        """Return the joint that an equality couples a joint to."""
        m = self.model
        for e in range(m.neq):
            if int(m.eq_type[e]) == _JOINT and int(m.eq_obj1id[e]) == j and m.eq_active0[e]:
                other = int(m.eq_obj2id[e])
                return self.names[other] if other >= 0 else "a fixed position"
        return ""

    def loops(self) -> tuple[tuple[str, str, str], ...]:
        """Return the equality constraints that close chains: their names and the connected links."""
        m = self.model
        loops: list[tuple[str, str, str]] = []
        for e in range(m.neq):
            if int(m.eq_type[e]) in (_CONNECT, _WELD) and m.eq_active0[e]:
                ends = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
                if int(m.eq_objtype[e]) != 1:  # sites, not bodies
                    ends = int(m.site_bodyid[ends[0]]), int(m.site_bodyid[ends[1]])
                name = printable(m.equality(e).name) or f"equality {e + 1}"
                loops.append((name, self.bodies[ends[0]], self.bodies[ends[1]]))
        return tuple(loops)

    def visual(self, g: int) -> Visual | None:
        """Return a visible shape."""
        m = self.model
        shape = _SHAPES.get(int(m.geom_type[g]))
        if shape is None:
            return None
        at = Placement(_rotation(m.geom_quat[g]), np.array(m.geom_pos[g]))
        a, b, c = (float(k) for k in m.geom_size[g])
        file, size = "", {
            "sphere": [a], "capsule": [a, 2 * b], "cylinder": [a, 2 * b], "box": [2 * a, 2 * b, 2 * c],
            "ellipsoid": [a, b, c], "mesh": [1.0] * 3,
        }[shape]  # fmt: skip
        if shape == "mesh":
            k = int(m.geom_dataid[g])
            moved = Placement(_rotation(m.mesh_quat[k]), np.array(m.mesh_pos[k]))  # rotation to the principal axes
            at = at @ Placement(moved.R.T, -moved.R.T @ moved.p)
            size = [float(scale) for scale in m.mesh_scale[k]]
            file = self.mesh(k)
            if not file:
                return None
        rgba = m.mat_rgba[m.geom_matid[g]] if int(m.geom_matid[g]) >= 0 else m.geom_rgba[g]
        return Visual(
            joint=0,
            shape=shape,
            size=read_only(size),
            rotation=at.R,
            offset=at.p,
            color=read_only(np.clip(rgba, 0.0, 1.0)),
            file=file,
        )

    def mesh(self, k: int) -> str:
        """Return the path of a mesh; empty without a file."""
        m = self.model
        start = int(m.mesh_pathadr[k])
        if start < 0:
            return ""
        name = bytes(m.paths[start:]).split(b"\0", 1)[0].decode("utf-8", "replace")
        place = self.path.parent / name
        return str(place.resolve()) if place.is_file() else name


def _rotation(quaternion: Any) -> Floats:
    """Rotation matrix of a quaternion w, x, y, z."""
    w, x, y, z = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    v = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * v + 2.0 * v @ v
