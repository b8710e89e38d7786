"""The verdict on a run as a sentence, and the numbers beside it: for the terminal and the first screen of the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from vdfmu.base.measure import quantity
from vdfmu.engine.results.verdict import checks_of
from vdfmu.study.report.sheets import energies
from vdfmu.study.report.summary_keys import Summary


class Tile(NamedTuple):
    """A number of the first screen."""

    name: str
    value: str
    note: str
    figure: str
    """Key of the figure that shows it, or what it begins with; ``facts`` for the table of facts."""
    at: float | None = None
    """Its time [s], if it has one."""


class Headline(NamedTuple):
    """What a run comes to."""

    text: str
    """A sentence; empty for a run that was not judged."""
    passed: bool
    tiles: list[Tile]


def headline(summary: Summary) -> Headline:
    """Return the verdict of a summary as a sentence, and a tile for each number that it has."""
    figures: Summary = summary.get("key_figures") or {}
    checks = checks_of(summary)
    failed = [check for check in checks if not check.passed]
    unstable: Summary | None = figures.get("unstable")
    if unstable is not None:
        text = f"Unstable {_since(unstable)}, {unstable['place']}"
    elif failed:
        text = f"{failed[0].name}: {' '.join(failed[0].text.split())}"
        text = f"{text[:1].upper()}{text[1:]}" if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    else:
        text = "; ".join(_told(figures))
        text = f"{text[:1].upper()}{text[1:]}" or checks_line(summary)
    return Headline(text, not failed and unstable is None, list(_tiles(summary, figures)))


_LONGEST = 160
"""Most characters of a sentence that quotes a check."""


def checks_line(summary: Summary) -> str:
    """Return how many checks of a run pass; empty if it has none."""
    checks = checks_of(summary)
    passed = sum(check.passed for check in checks)
    return f"{passed} of {len(checks)} checks pass" if checks else ""


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


def _since(figure: Summary) -> str:
    return f"since {_time(figure)}" if figure["at_s"] else "from the start"


def _told(figures: Summary) -> Iterator[str]:
    """Yield the parts of the sentence of a run that passed."""
    margin: Summary | None = figures.get("margin")
    if margin is not None:
        yield "stable" if margin["value"] else f"stable, without a margin at {margin['place']}"
    if "tool_error" in figures:
        yield f"tool error {quantity(figures['tool_error']['value'], 'm')} at most, at {_time(figures['tool_error'])}"
    if "joint_error" in figures:
        worst = figures["joint_error"]
        yield f"joint {worst['joint']} worst, {quantity(worst['value'], worst['unit'])}"
    if margin is not None and margin["value"]:
        yield f"modulus margin {margin['value']:.2g}"


def _tiles(summary: Summary, figures: Summary) -> Iterator[Tile]:
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
    if (margin := figures.get("margin")) is not None:
        note = f"{margin['place']} at {_time(margin)}"
        yield Tile(
            "Modulus margin", f"{margin['value']:.2g}" if margin["value"] else "none", note, "torque", margin["at_s"]
        )
    if (unstable := figures.get("unstable")) is not None:
        note = f"a step, {unstable['place']}, {_since(unstable)}"
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
