"""An arm without dry friction, by the values of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vdfmu.arm.drive.options import OPTIONS
from vdfmu.arm.robot.parameters import PARAMETERS


def least_dry_friction(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the values of a unit's parameters with the least dry friction that an arm may have.

    Without parameters of a spring the unit is not an arm, and there are none. Names are those of
    :func:`vdfmu.arm.equations.friction.dry_friction`, with their indices.
    """
    groups = {name: name.partition("[")[0] for name in values}
    own = set(groups.values())
    if "K_f0" not in own:
        return {}
    replaced = any(option.replaces_dry_friction and own & {*option.dry_parameters} for option in OPTIONS.values())
    dry = {"f_ck", *(name for option in OPTIONS.values() for name in option.dry_parameters)}
    dry |= set() if replaced else {"f_c", "f_s"}
    return {name: PARAMETERS[group].smallest or 0.0 for name, group in groups.items() if group in dry}
