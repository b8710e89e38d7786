"""The scenario files of a comparison: arm, motion, law, and what is in the loop; each can be run by itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics, inverse_dynamics
from vdfmu.arm.robot import load_robot
from vdfmu.base.files import write_whole
from vdfmu.base.toml_file import locate
from vdfmu.base.toml_text import toml_text
from vdfmu.study.analysis.reach import reach_scenario
from vdfmu.study.compare.axes import MOTIONS, ComparedLaw, Mismatch, PlannedMotion
from vdfmu.study.run.key_figures import length
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.replace import with_units
from vdfmu.system.scenario.values import system_values

_PUSH = 0.05
"""Force at the tool while a law is tuned, in each of its axes, as a share of the weight of the links."""
_BEHIND = 0.002
"""How far the farthest place of a path is behind the wall [m]."""
_LOOKS = 501
"""Places of a motion at which its torques, and its way to the wall, are looked at."""
PAYLOAD = "plant.payload_mass"

Wires = dict[str, list[str]]


def _sensed(wires: Wires, units: dict[str, Any]) -> None:
    """Put an encoder between the links, and one between the rotors, and what reads them."""
    for encoder, position, velocity in (("link_encoder", "q", "q_dot"), ("motor_encoder", "kappa", "kappa_dot")):
        units[encoder] = "encoder"
        wires[f"{encoder}.q_m"] = wires.pop(f"plant.{position}", [])
        wires[f"{encoder}.q_dot_m"] = wires.pop(f"plant.{velocity}", [])
        wires[f"plant.{position}"] = [f"{encoder}.q"]


def _driven(wires: Wires, units: dict[str, Any]) -> None:
    """Put noise, and communication with delay, between the torques of the law and the motors."""
    units |= {"noise": "torque_noise", "communication": "communication"}
    wires |= {"controller.tau": ["noise.tau_c"], "noise.tau": ["communication.tau_c"]}
    wires["communication.tau"] = ["plant.tau"]


def _contact(wires: Wires, units: dict[str, Any]) -> None:
    """Put a wall in the way of the tool."""
    units |= {"plant": {"unit": "plant", "coupled_tool": True}, "wall": "wall"}
    wires |= {f"plant.{name}": [f"wall.{name}"] for name in ("p_O", "R_O", "V_O")} | {"wall.F_e": ["plant.F_e"]}


STRUCTURES: dict[str, Callable[[Wires, dict[str, Any]], None]] = {
    "plain": lambda wires, units: None, "sensed": _sensed, "driven": _driven, "contact": _contact,
}  # fmt: skip
"""Name to what changes connections and units of a system."""


class ComparedArm:
    """An arm of a comparison, and the scenario files of it in a folder.

    Parameters
    ----------
    robot : str
        Name or path.
    folder : Path
    """

    def __init__(self, robot: str, folder: Path) -> None:
        place, reach = locate(robot, "robots"), reach_scenario(robot)
        self.name, self.folder, self.robot = place.stem, folder / place.stem, load_robot(robot)
        self._written = str(place.resolve()) if place == Path(robot) else robot
        self.rule: Mapping[str, Any] = {n: np.array(reach.sections["controller"][n]) for n in ("K_p", "K_v")}
        motion = reach.sections["trajectory"]
        self.start, self.end, self.T = np.array(motion["q_start"]), np.array(motion["q_end"]), float(motion["T"])
        self.length = length(self.robot)
        self._motions: dict[str, PlannedMotion] = {}
        self.tuning = self._write_tuning()

    def motion(self, name: str) -> PlannedMotion:
        """Return a motion, which is worked out once."""
        if name not in self._motions:
            self._motions[name] = MOTIONS[name](self.robot, self.start, self.end, self.T)
        return self._motions[name]

    def started(self, law: ComparedLaw) -> dict[str, Any]:
        """Return the settings from which the search of a law starts, and the empty payload that all runs have."""
        start = law.start(self.rule, self.robot) | ({"q_pose": 0.5 * (self.start + self.end)} if law.kept else {})
        return {PAYLOAD: 0.0} | {f"controller.{name}": np.asarray(x).tolist() for name, x in start.items()}

    def write(self, motion: str, law: ComparedLaw, values: Mapping[str, Any], structure: str) -> Path:
        """Write the scenario of a motion under a law with values of its parameters, and its system."""
        folder = self.folder / law.unit
        system = with_units(load_scenario(self.tuning), {"controller": law.unit}).system
        wires: Wires = {source: list(targets) for source, targets in system.connections.items()}
        units: dict[str, Any] = {name: {"unit": str(part.unit)} for name, part in system.parts.items()}
        STRUCTURES[structure](wires, units)
        wires = {source: targets for source, targets in wires.items() if targets}
        name, text = f"{self.name}_{law.unit}_{structure}", f"{law.text}, {structure} loop"
        content = {"name": name, "description": text, "units": units, "shared": system.shared, "connections": wires}
        _write(folder / f"{structure}.toml", content)
        tables = self._head(f"{self.name}_{law.unit}_{motion}_{structure}", f"{self.name}, {motion}: {text}", motion)
        tables |= {"system": f"{structure}.toml", "controller": dict(values)}
        if structure == "contact":
            tables["wall"] = self._wall(motion)
        if structure == "sensed":
            turn = np.where(np.array(self.robot.joint_types) == "revolute", 2.0 * np.pi, 1.0)  # rad, m
            tables |= {"link_encoder": {"span": turn}, "motor_encoder": {"span": 2.0 * np.pi / self.robot.ell}}
        return _write(folder / f"{motion}_{structure}.toml", tables)

    def differences(self, scenario: Scenario, mismatch: Mismatch, seed: int) -> dict[str, Any]:
        """Return the settings that make a scenario differ from what its law knows."""
        found: dict[str, Any] = {PAYLOAD: mismatch.payload * float(self.robot.mass.sum())}
        if mismatch.factors:
            other = dataclasses.replace(scenario, plant_factors=mismatch.factors)
            known = system_values(scenario)["plant"]
            found |= {f"plant.{n}": x for n, x in system_values(other)["plant"].items() if known.get(n) != x}
        if mismatch.structure == "driven":
            q, q_dot, q_ddot = self.motion("point_to_point").at(np.linspace(0.0, self.T, _LOOKS))[:3]
            torque = inverse_dynamics(self.robot, q, q_dot, q_ddot) / self.robot.ell + self.robot.I_m * q_ddot
            sigma = mismatch.noise * np.abs(torque).max(axis=0)
            found |= {f"noise.sigma[{i}]": float(x) for i, x in enumerate(sigma, 1)}
            found |= {"noise.seed": float(seed), "communication.T_d": 0.0}
        return found | dict(mismatch.values)

    def _head(self, name: str, description: str, motion: str) -> dict[str, Any]:
        head = {"name": name, "description": description, "robot": self._written, "step": 1e-3, "tolerance": 1e-8}
        return head | self.motion(motion).tables

    def _write_tuning(self) -> Path:
        """Write the scenario in which laws are tuned: point to point, with a force at the tool on the way."""
        T, force = self.T, _PUSH * 9.81 * float(self.robot.mass.sum()) / math.sqrt(3.0)
        shares = ((0.0, 0.0), (0.25 * T, 0.0), (0.25 * T + 0.02, 1.0), (0.6 * T, 1.0), (0.6 * T + 0.02, 0.0), (T, 0.0))
        rows = [f"{t!r},{','.join(3 * [repr(force * share)])}" for t, share in shares]
        names = ",".join(f"plant.F_e[{k}] [N]" for k in (1, 2, 3))
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / "push.csv", ["\n".join([f"time,{names}", *rows, ""]).encode()])
        tables = self._head(f"{self.name}_tuning", f"{self.name}, pushed on its way", "point_to_point")
        return _write(self.folder / "tuning.toml", tables | {"inputs": "push.csv"})

    def _wall(self, motion: str) -> dict[str, Any]:
        """Return a wall across the way from the start of a path to its farthest place."""
        tables, at = self.motion(motion)
        path, _ = forward_kinematics(self.robot, at(np.linspace(0.0, tables["stop"], _LOOKS))[0])
        far = path[np.linalg.norm(path - path[0], axis=1).argmax()] - path[0]
        normal = far / np.linalg.norm(far)
        return {"normal": normal, "distance": float((path @ normal).max()) - _BEHIND, "k": 2e4, "c": 2.0, "mu": 0.3}


def _write(path: Path, tables: Mapping[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, [toml_text(tables).encode()])
    return path
