"""Friction of the gear mesh that grows with the transmitted torque: load-dependent efficiency. Off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Array, DriveOption, Friction, Sliding, row


@dataclass(frozen=True, eq=False, kw_only=True)
class LoadLossRows:
    """Parameters of the loss."""

    load_loss: bool = False
    # fmt: off
    mu_l: Array = row(
        "load_loss", "1", "friction torque of the mesh divided by the torque that the drive transmits", "", 1.0, 0.0,
        scaled_as="friction")


def mesh_friction(robot: Any, kappa_dot: Any, load: Any) -> Any:
    """Friction ``mu |load| tanh(kappa_dot / eps) / ell`` on the rotor: (n,) [N m], motor-side.

    It acts against the rotor whichever way power flows: the drive needs ``(1 + mu) |load|`` to lift a load that returns
    ``(1 - mu) |load|``. With the friction f without load at that speed the efficiency is ``|load| / ((1 + mu) |load| +
    f)``. `load` is the torque of the drive (n,) [N m or N], link-side.
    """
    return robot.mu_l * abs(load) * np.tanh(kappa_dot / robot.eps) / robot.ell


def _friction(friction: Friction, robot: Any, sliding: Sliding, _: Any) -> Friction:
    return friction._replace(mesh=friction.mesh + mesh_friction(robot, sliding.kappa_dot, sliding.load))


LOAD_LOSS = DriveOption(friction=_friction, dry_parameters=("mu_l",))
