"""Scenario files of the comparison: arm, motion, law, and the devices between law and plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from laws import Law

import vdfmu
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.motion.read import kinds
from vdfmu.base.toml_file import toml_text
from vdfmu.extras.robots.reach import reach_scenario
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.replace import with_units
from vdfmu.system.scenario.values import system_values

PAYLOAD = "plant.payload_mass"
HOLD = 0.5  # rest after a motion [s]
PUSH = 0.05  # force at the tool while a law is tuned, as a share of the weight of the links
BEHIND = 0.002  # distance of the farthest place of the path behind the wall [m]
MOTIONS = ("point_to_point", "circle", "time_optimal")


@dataclasses.dataclass(frozen=True)
class Mismatch:
    """A difference between the plant and the model of the law.

    The mass `payload` at the tool is a share of the links' mass, `noise` a share of the motion's largest torque.
    """

    text: str
    factors: Mapping[str, float] = dataclasses.field(default_factory=dict)
    payload: float = 0.0
    loop: str = "plain"
    values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    noise: float = 0.0


BITS = ("link_encoder.bits", "motor_encoder.bits")
DELAYS = ("link_encoder.T_d", "motor_encoder.T_d")
MISMATCHES = {
    "none": Mismatch("The plant that the law is designed for"),
    "payload": Mismatch("A payload of 10 % of the mass of the links", payload=0.1),
    "masses": Mismatch("Masses and inertias of the links +20 %", {"mass": 1.2, "inertia": 1.2}),
    "stiffness": Mismatch("Stiffness of the drives -30 %", {"K_f0": 0.7, "K_w0": 0.7}),
    "friction": Mismatch("Friction +50 %", dict.fromkeys(("f_c", "f_s", "f_v", "f_ck"), 1.5)),
    "encoder": Mismatch("Encoders of 17 bits on links and motors", loop="sensed", values=dict.fromkeys(BITS, 17.0)),
    "encoder_delay": Mismatch("Encoders of 30 bits that are 1 ms late", loop="sensed",
        values=dict.fromkeys(BITS, 30.0) | dict.fromkeys(DELAYS, 1e-3)),
    "torque_noise": Mismatch("White noise of the motor torques, 2 % of the largest", loop="driven", noise=0.02),
    "delay_1": Mismatch("Torques that arrive 1 ms late", loop="driven", values={"communication.T_d": 1e-3}),
    "delay_2": Mismatch("Torques that arrive 2 ms late", loop="driven", values={"communication.T_d": 2e-3}),
    "contact": Mismatch("A wall, 2 mm before the farthest place of the path", loop="contact"),
}  # fmt: skip


class Arm:
    """An arm of the comparison and its scenario files in a folder."""

    def __init__(self, robot: str, folder: Path) -> None:
        self.robot, self.folder, self._given = vdfmu.load_robot(robot), folder / Path(robot).stem, robot
        reach = reach_scenario(robot)
        self.step = reach.step
        self.rule = {name: np.array(reach.sections["controller"][name]) for name in ("K_p", "K_v")}
        motion = reach.sections["trajectory"]
        self.start, self.end, self.T = np.array(motion["q_start"]), np.array(motion["q_end"]), float(motion["T"])
        self.length = float(
            np.linalg.norm(self.robot.offset[1:], axis=1).sum() + np.linalg.norm(self.robot.tool_offset)
        )
        self.mass = float(self.robot.mass.sum())
        self.pose = 0.5 * (self.start + self.end)
        self.tuning = self._write("tuning", self._tables("tuning", "point_to_point") | {"inputs": self._push()})

    def start_of(self, law: Law) -> dict[str, Any]:
        """Return the start values of the search of a law."""
        return {name: np.asarray(x).tolist() for name, x in law.start(self.rule, self.robot, self.pose).items()}

    def write(self, motion: str, law: Law, values: Mapping[str, Any], loop: str) -> Path:
        """Write the scenario of a motion under a law with values of its parameters, and its system."""
        system = with_units(load_scenario(self.tuning), {"controller": law.unit}).system
        wires = {source: list(targets) for source, targets in system.connections.items()}
        units: dict[str, Any] = {name: {"unit": str(part.unit)} for name, part in system.parts.items()}
        if loop == "sensed":
            for encoder, position, velocity in (
                ("link_encoder", "q", "q_dot"),
                ("motor_encoder", "kappa", "kappa_dot"),
            ):
                units[encoder] = "encoder"
                wires[f"{encoder}.q_m"] = wires.pop(f"plant.{position}", [])
                wires[f"{encoder}.q_dot_m"] = wires.pop(f"plant.{velocity}", [])
                wires[f"plant.{position}"] = [f"{encoder}.q"]
        elif loop == "driven":
            units |= {"noise": "torque_noise", "communication": "communication"}
            wires |= {"controller.tau": ["noise.tau_c"], "noise.tau": ["communication.tau_c"]}
            wires["communication.tau"] = ["plant.tau"]
        elif loop == "contact":
            units |= {"plant": {"unit": "plant", "coupled_tool": True}, "wall": "wall"}
            wires |= {f"plant.{name}": [f"wall.{name}"] for name in ("p_O", "R_O", "V_O")}
            wires["wall.F_e"] = ["plant.F_e"]
        name = f"{law.name}_{motion}_{loop}"
        content = {"name": name, "description": law.text, "components": units, "shared": system.shared}
        self._write(f"{name}_system", content | {"connections": {a: b for a, b in wires.items() if b}})
        tables = self._tables(name, motion) | {"system": f"{name}_system.toml", "controller": dict(values)}
        if loop == "contact":
            tables["wall"] = self._wall(motion)
        elif loop == "sensed":
            turn = np.where(np.array(self.robot.joint_types) == "revolute", 2.0 * np.pi, 1.0)  # rad, m
            tables |= {"link_encoder": {"span": turn}, "motor_encoder": {"span": 2.0 * np.pi / self.robot.ell}}
        return self._write(name, tables)

    def differences(self, path: Path, mismatch: Mismatch, seed: int) -> dict[str, float]:
        """Return the settings with which a mismatch makes a scenario differ from the model of its law."""
        scenario = load_scenario(path)
        settings = {PAYLOAD: mismatch.payload * self.mass}
        if mismatch.factors:
            nominal = system_values(scenario)["plant"]
            other = system_values(dataclasses.replace(scenario, plant_factors=mismatch.factors))["plant"]
            settings |= {f"plant.{name}": x for name, x in other.items() if nominal.get(name) != x}
        if mismatch.loop == "driven":
            q, q_dot, q_ddot = self._planned("point_to_point")[1]
            torque = (
                vdfmu.dynamics.inverse_dynamics(self.robot, q, q_dot, q_ddot) / self.robot.ell + self.robot.I_m * q_ddot
            )
            sigma = mismatch.noise * np.abs(torque).max(axis=0)
            settings |= {f"noise.sigma[{i}]": float(x) for i, x in enumerate(sigma, 1)}
            settings |= {"noise.seed": float(seed), "communication.T_d": 0.0}
        return settings | dict(mismatch.values)

    def _tables(self, name: str, motion: str) -> dict[str, Any]:
        head = {"name": name, "description": f"{self.robot.name}, {motion}", "robot": self._given}
        empty = {"mass": 0.0, "known": False}  # a mismatch fills it
        return head | {"step": self.step, "tolerance": 1e-8, "payload": empty} | self._planned(motion)[0]

    def _planned(self, motion: str) -> tuple[dict[str, Any], Any]:
        """Return the tables of a motion, and 501 of its positions, velocities and accelerations, (3, 501, n)."""
        start, end, T = self.start, self.end, self.T
        if motion == "point_to_point":
            tables = {"trajectory": {"q_start": start, "q_end": end, "T": T}, "stop": T + HOLD}
            rows = [desired_motion(t, start, end, T)[:3] for t in np.linspace(0.0, T, 501).tolist()]
            return tables, np.stack(rows, axis=1)
        way = np.abs(end - start)
        limits: dict[str, Any] = {"velocity": 2.0 * way / T, "acceleration": 2.0 * np.pi * way / T**2}  # of Eq. (57)
        if motion == "time_optimal":  # the corner is off by a quarter of each joint's travel, with alternating sign
            corner = self.pose + 0.25 * (end - start) * (-1.0) ** np.arange(len(way))
            tried = [("fastest", {"points": [start, corner, end]})]
        else:  # a circle of 4 % of the arm's length, horizontal if the arm can
            p, _ = vdfmu.dynamics.forward_kinematics(self.robot, end)
            tried = []
            for axis in np.eye(3)[::-1]:
                inward = axis * (axis @ p) - p
                centre = p + 0.04 * self.length * inward / np.linalg.norm(inward)
                tried.append(("circle", {"start": end, "centre": centre, "axis": axis, "orientation": "free"}))
        for kind, keys in tried:
            try:
                planned = kinds()[kind].make(**keys, **limits, robot=self.robot)
            except vdfmu.VdfmuError as error:
                problem = error
                continue
            tables = {"motion": {"kind": kind, **keys, **limits}, "stop": round(planned.duration + HOLD, 3)}
            return tables, planned.at(np.linspace(0.0, planned.duration, 501))[:3]
        raise problem

    def _push(self) -> str:
        """Write the force along the tuned motion to a file, and return the file."""
        T, force = self.T, PUSH * 9.81 * self.mass / np.sqrt(3.0)
        shares = ((0.0, 0.0), (0.25 * T, 0.0), (0.25 * T + 0.02, 1.0), (0.6 * T, 1.0), (0.6 * T + 0.02, 0.0), (T, 0.0))
        rows = [f"{t!r},{','.join(3 * [repr(float(force) * share)])}" for t, share in shares]
        self.folder.mkdir(parents=True, exist_ok=True)
        head = "time," + ",".join(f"plant.F_e[{k}] [N]" for k in (1, 2, 3))
        (self.folder / "push.csv").write_text("\n".join([head, *rows, ""]))
        return "push.csv"

    def _wall(self, motion: str) -> dict[str, Any]:
        """Return a wall across the line from the start of a path to its farthest point."""
        path, _ = vdfmu.dynamics.forward_kinematics(self.robot, self._planned(motion)[1][0])
        far = path[np.linalg.norm(path - path[0], axis=1).argmax()] - path[0]
        normal = far / np.linalg.norm(far)
        return {"normal": normal, "distance": float((path @ normal).max()) - BEHIND, "k": 2e4, "c": 2.0, "mu": 0.3}

    def _write(self, name: str, tables: Mapping[str, Any]) -> Path:
        path = self.folder / f"{name}.toml"
        path.write_text(toml_text(tables))
        return path
