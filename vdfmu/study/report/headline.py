"""The numbers of the first screen of a run's page, beside its verdict, and the title of the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from vdfmu.base.measure import quantity
from vdfmu.study.run.summary_keys import Summary, energies


class Tile(NamedTuple):
    """A number of the first screen."""

    name: str
    value: str
    note: str
    figure: str
    """Key of the figure that shows it, or what it begins with; ``facts`` for the table of facts."""
    at: float | None = None
    """Its time [s], if it has one."""


def page_title(name: str, summary: Summary) -> str:
    """Return the title of the page of a run: ``tracking: tool 2.89 µm, 6 joints``."""
    figures: Summary = summary.get("key_figures") or {}
    joints = summary.get("joints")
    facts = [f"tool {quantity(figures['tool_error']['value'], 'm')}"] if "tool_error" in figures else []
    facts += [f"{joints} joint{'s' if joints > 1 else ''}"] if joints else []
    facts = ["unstable", *facts[1:]] if "unstable" in figures else facts
    return f"{name}: {', '.join(facts)}" if facts else name


def _time(figure: Summary) -> str:
    return f"{figure['at_s']:.3g} s"


def tiles_of(summary: Summary) -> Iterator[Tile]:
    """Yield a tile for each number of a summary that it has."""
    figures: Summary = summary.get("key_figures") or {}
    if (tool := figures.get("tool_error")) is not None:
        yield Tile("Tool error", quantity(tool["value"], "m"), f"at {_time(tool)}", "tool", tool["at_s"])
    if (worst := figures.get("joint_error")) is not None:
        note = f"joint {worst['joint']} at {_time(worst)}"
        yield Tile("Worst joint", quantity(worst["value"], worst["unit"]), note, "tracking", worst["at_s"])
    if (torque := figures.get("torque")) is not None:
        value, note = quantity(torque["value"], torque["unit"]), f"joint {torque['joint']} at {_time(torque)}"
        if "limit" in torque:
            value, note = f"{100 * torque['value'] / torque['limit']:.3g} %", f"of its limit, {value}, {note}"
        name = "Peak force" if torque["unit"] == "N" else "Peak torque"
        yield Tile(name, value, note, "torque", torque["at_s"])
    if (contact := figures.get("contact")) is not None:
        value, note = quantity(contact["value"], contact["unit"]), f"at the tool, since {_time(contact)}"
        yield Tile("Contact force", value, note, "plant.F_e.N", contact["at_s"])
    if (saturated := figures.get("saturated")) is not None:
        value, note = f"{100.0 * saturated['value']:.3g} %", f"{saturated['place']}, since {_time(saturated)}"
        yield Tile("Time at a limit", value, note, "torque", saturated["at_s"])
    if (margin := figures.get("margin")) is not None:
        note = f"{margin['place']} at {_time(margin)}"
        yield Tile(
            "Modulus margin", f"{margin['value']:.2g}" if margin["value"] else "none", note, "torque", margin["at_s"]
        )
    if (unstable := figures.get("unstable")) is not None:
        note = f"a step, {unstable['place']}, since {_time(unstable)}"
        yield Tile("Disturbances grow", f"× {unstable['value']:.3g}", note, "tracking", unstable["at_s"])
    if (mode := figures.get("mode")) is not None:
        rate = f"; loop {quantity(1.0 / summary['step'], 'Hz')}" if summary.get("step") else ""
        yield Tile("Lowest mode", quantity(mode["value"], "Hz"), f"motors held{rate}", "torsion", mode["at_s"])
    bond: Summary | None = summary.get("power_bond")
    if bond is not None:
        residual, exchanged = energies(bond)
        if exchanged > 0.0:
            note = f"of {quantity(exchanged, 'J')} exchanged"
            yield Tile("Energy residual", f"{100 * residual / exchanged:.2g} %", note, "facts")
