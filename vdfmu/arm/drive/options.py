"""The options of drives, one file each. A new one needs a file like `hysteresis` and three entries here."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from vdfmu.arm.drive.backlash import BACKLASH, BacklashRows
from vdfmu.arm.drive.bristles import BRISTLES, BristlesRows
from vdfmu.arm.drive.counterbalance import COUNTERBALANCE, CounterbalanceRows
from vdfmu.arm.drive.hysteresis import HYSTERESIS, HysteresisRows
from vdfmu.arm.drive.limits import LIMITS, LimitsRows
from vdfmu.arm.drive.load_loss import LOAD_LOSS, LoadLossRows
from vdfmu.arm.drive.option import DriveOption
from vdfmu.arm.drive.thermal import THERMAL, ThermalRows
from vdfmu.arm.drive.winding import WINDING, WindingRows

OptionName = Literal[
    "limits", "hysteresis", "load_loss", "backlash", "bristles", "winding", "thermal", "counterbalance"
]

OPTIONS: dict[OptionName, DriveOption] = {
    "limits": LIMITS,
    "hysteresis": HYSTERESIS,
    "load_loss": LOAD_LOSS,
    "backlash": BACKLASH,
    "bristles": BRISTLES,
    "winding": WINDING,
    "thermal": THERMAL,
    "counterbalance": COUNTERBALANCE,
}
"""Name of a robot's flag and table to the option, in the order in which options are summed."""
STATELESS: tuple[OptionName, ...] = tuple(name for name, option in OPTIONS.items() if option.state is None)
"""Options of every joint unit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OptionRows(
    CounterbalanceRows, ThermalRows, WindingRows, BristlesRows, BacklashRows, LoadLossRows, HysteresisRows, LimitsRows
):
    """Parameters of all options, and flags for those that a robot has; the fields of the last base class come first."""


def options_of(robot: Any, states: Mapping[str, Any] | None = None) -> list[tuple[DriveOption, Any]]:
    """Return each option of a robot with its state, or None if it is not in `states`. Its own drive comes last."""
    options = [option for name, option in OPTIONS.items() if getattr(robot, name)]
    options += getattr(robot, "own_options", ())
    return [(option, (states or {}).get(option.state.name) if option.state else None) for option in options]


def dry_friction(names: Collection[str]) -> set[str]:
    """Return `names` of an arm's parameters that are minimal without dry friction; none for a unit without springs."""
    if "K_f0" not in names:
        return set()
    replaced = any(option.replaces_dry_friction and {*option.dry_parameters} & {*names} for option in OPTIONS.values())
    dry = {"f_ck", *(name for option in OPTIONS.values() for name in option.dry_parameters)}
    return {*names} & (dry if replaced else dry | {"f_c", "f_s"})
