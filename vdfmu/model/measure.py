"""Units of measurement of a joint's quantities: a prismatic joint counts its link side in m and N."""

from __future__ import annotations

__all__ = ["unit_of"]

# Quantity to unit, for a revolute and for a prismatic joint. "_m" is motor-side, else link-side.
_QUANTITIES = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s2", "m/s2"),
    "jerk": ("rad/s3", "m/s3"),
    "snap": ("rad/s4", "m/s4"),
    "torque": ("N.m", "N"),
    "stiffness": ("N.m/rad", "N/m"),
    "damping": ("N.m.s/rad", "N.s/m"),
    "per torque": ("1/(N.m)", "1/N"),
    "ratio": ("1", "rad/m"),
    "per velocity": ("s/rad", "s/m"),
    "rotor inertia": ("kg.m2", "kg.m"),
    "damping_m": ("N.m.s/rad", "N.m.s/m"),
}


def unit_of(quantity: str, joint_type: str) -> str:
    """Return the unit of a joint's quantity: ``unit_of("torque", "prismatic")`` is ``"N"``.

    A unit's name stands for itself.
    """
    revolute, prismatic = _QUANTITIES.get(quantity, (quantity, quantity))
    return prismatic if joint_type == "prismatic" else revolute
