"""The numbers of a run as tables: of text, and in the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from rich import box
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from vdfmu.base.bars import plain_table
from vdfmu.base.measure import number, per_cent, quantity
from vdfmu.base.standards import FMI_2
from vdfmu.base.text import amount
from vdfmu.engine.results.verdict import (
    DOUBTFUL,
    FAILED,
    GOOD,
    SIGNS,
    UNJUDGED,
    checks_line,
    checks_of,
    outcome_of,
    results_of,
    state_of,
)
from vdfmu.study.limits import energies
from vdfmu.study.run.summary_keys import Summary


class Sheet(NamedTuple):
    """A table of texts."""

    title: str
    columns: tuple[str, ...]
    """Headings, with line breaks for narrow columns."""
    rows: list[tuple[str, ...]]
    notes: list[str]
    """Sentences below the table."""


TRACKING = (
    ("Position\nRMS", "rms_position_error_deg", "position_units"),
    ("Position\nmaximum", "max_position_error_deg", "position_units"),
    ("Torque\nRMS", "rms_torque_compensation_error_nm", "torque_units"),
)
_ESTIMATION = (
    ("Torque\nRMS", "rms_spring_torque_nm", "torque_units"),
    ("As printed\nRMS error", "rms_tau_f_hat_error_nm", "torque_units"),
    ("Consistent\nRMS error", "rms_tau_s_hat_error_nm", "torque_units"),
)
"""Heading, key in the summary, key of the units."""
_LIMITS = {"Torque\nlimit": "torque", "Speed\nlimit": "speed", "End\nstop": "stop"}
_DEFAULT_UNIT = {"position_units": "deg", "torque_units": "N.m"}
_SIGNALS = 12
"""Most signals of the table of coupling errors, the worst first; most lines on events."""
_TIMES = 12
"""Most times of an event in a note."""
LATEX = ".tex"
"""Suffix of a file of tables."""
COMPARED = ["paper", "%"]
"""Headings for the paper's numbers, and for ours in per cent of them."""
_NONE = "-"


def sheets(summary: Summary, *, fit: bool = False) -> list[Sheet]:
    """Return the tables of a run for which its summary has numbers. With `fit` each number has a suitable prefix."""
    makers = {
        "rms_position_error_deg": tracking_sheet, "limits": limits_sheet, "rms_spring_torque_nm": _estimation_sheet,
        "reference": reference_sheet, "judgement": coupling_sheet, "events": events_sheet,
    }  # fmt: skip
    made = [make(summary, fit) for key, make in makers.items() if summary.get(key)]
    return [sheet for sheet in made if sheet is not None]


def tracking_sheet(summary: Summary, fit: bool = False) -> Sheet:
    """Position and torque compensation errors of each joint, next to the paper's and in per cent of them."""
    paper: Summary = summary.get("paper") or {}
    n = len(summary["rms_position_error_deg"])
    columns, cells = ["Joint"], [_joints(summary, n)]
    for heading, key, unit_key in TRACKING:
        label, values = _column(summary, heading, key, unit_key, fit)
        columns.append(label)
        cells.append(values)
        if paper.get(key):
            theirs: Sequence[float] = paper[key]
            columns += COMPARED
            pairs = zip(theirs, units_of(summary, unit_key, n), strict=False)
            written = [quantity(*pair) if fit else f"{pair[0]:g}" for pair in pairs]
            cells.append([*written, *[_NONE] * (n - len(written))])
            cells.append([_per_cent(ours, theirs, i) for i, ours in enumerate(summary[key])])
    notes = ["Position: desired minus actual. Torque: control minus feedforward, link side."]
    if paper:
        notes.append(f"Paper: {paper['source']}." if paper.get("source") else "Paper.")
        set_plant = any(name.startswith("plant.") for name in summary.get("parameters") or ())
        notes.append(
            "The plant differs from the model by values of our choice. The gains are ours too."
            if summary.get("plant_factors") or set_plant
            else "An ideal case: the feedforward model equals the plant, and the gains are ours."
        )
    return Sheet("Tracking and compensation errors", tuple(columns), _rows(cells), notes)


def limits_sheet(summary: Summary, fit: bool = False) -> Sheet | None:
    """Fraction of the time for which each joint was at its limits; None if no joint was."""
    arms: Mapping[str, Summary] = summary["limits"]
    if not any(share > 0.0 for arm in arms.values() for shares in arm.values() for share in shares):
        return None
    rows = [
        (f"{arm} {joint}" if len(arms) > 1 else joint, *(f"{100.0 * shares[key][i]:.3g}" for key in _LIMITS.values()))
        for arm, shares in arms.items()
        for i, joint in enumerate(_joints(summary, len(shares["torque"])))
    ]
    notes = [
        "Share of the time. Torque: the motor, or the controller before it, gives its largest torque, and more is "
        "requested.",
        "Speed: the motor delivers less because it turns too fast. End stop: the joint pushes into it.",
    ]
    return Sheet("Joints at their limits", ("Joint", *(f"{heading}\n[%]" for heading in _LIMITS)), rows, notes)


def _estimation_sheet(summary: Summary, fit: bool = False) -> Sheet:
    """Errors of the estimated spring torques of each joint."""
    labels, values = zip(*(_column(summary, *row, fit) for row in _ESTIMATION), strict=True)
    joints = [str(i) for i in range(1, 1 + len(values[0]))]
    notes = [
        "Estimate minus the plant's spring torque, link side.",
        "As printed, the wave generator carries the motor's torque.",
    ]
    return Sheet("Torque estimates", ("Joint", *labels), _rows([joints, *values]), notes)


def reference_sheet(summary: Summary, fit: bool = False) -> Sheet:
    """Largest differences between the co-simulation and its references; of RMS values if solutions separate."""
    title, compared = "Difference to the references", summary.get("reference") or {}
    names = [str(entry.get("name", key)) for key, entry in compared.items()]
    if any("max_difference" in entry for entry in compared.values()):
        tables = [entry["max_difference"] for entry in compared.values()]
        rows = [
            (signal, *(number(table[signal]) for table in tables))
            for signal in dict.fromkeys(signal for table in tables for signal in table)
        ]
        note = "Largest over all elements and communication points, in the units of the signals."
        return Sheet(title, ("Signal", *names), rows, [note])
    n = len(summary.get("rms_position_error_deg", ()))
    position = "rad or m" if "mm" in units_of(summary, "position_units", n) else "rad"
    torque = "N.m or N" if "N" in units_of(summary, "torque_units", n) else "N.m"
    separation: Summary | None = summary.get("separation")
    headings = (f"Position\n[{position}]", f"Torque\n[{torque}]")
    keys, factor = ("max_position_difference_rad", "max_torque_difference_nm"), 1.0
    notes = ["Largest over all joints and communication points; torques link side."]
    if separation is not None:
        apart = max(entry["max_position_difference_rad"] for entry in compared.values())
        headings = ("Position RMS\n[%]", "Torque RMS\n[%]")
        keys, factor = ("rms_position_difference", "rms_torque_difference"), 100.0
        notes = [
            "Between the RMS errors of run and reference; largest of the joints.",
            f"Point by point they differ by up to {number(apart)} {position}. This is not an error: the loop is "
            f"chaotic, and a change of {separation['change']:g} moves the run by "
            f"{number(separation['max_position_difference_rad'])} {position}.",
        ]
    rows = [
        (name, *(number(factor * entry[value]) for value in keys))
        for name, entry in zip(names, compared.values(), strict=True)
    ]
    return Sheet(title, ("Reference", *headings), rows, notes if rows else ["No reference was solved."])


def coupling_sheet(summary: Summary, fit: bool = False) -> Sheet | None:
    """Coupling errors from the step, its half and its quarter; None if the run's judgement has no estimate."""
    judgement: Summary = summary["judgement"]
    signals, order = judgement["signals"], judgement.get("order", 0)
    if not signals or not order:
        return None
    heads = [quantity(judgement["step"] / divisor, "s") for divisor in (1, 2, 4)]
    rows = [
        (each["name"], *map(per_cent, (each["error"], half, half / 2**order)), f"{each['q']:.2g}")
        for each in signals[:_SIGNALS]
        for half in [each["error"] * each["q"]]
    ]
    notes = [
        f"Estimated from the differences d1 and d2 of runs with these steps, as shares of each signal's range. "
        f"d2 / d1 is near {0.5**order:g} where the steps show the order of {judgement['algorithm']}."
    ]
    if more := len(signals) - len(rows):
        notes.append(f"{amount(more, 'more signal')} with smaller errors in summary.json.")
    return Sheet("Coupling error", ("Signal", *(f"Step\n{head}" for head in heads), "d2 / d1"), rows, notes)


def events_sheet(summary: Summary, fit: bool = False) -> Sheet:
    """Return number and times of the events of each component, or of each event of a unit."""
    happened: Mapping[str, Summary] = summary["events"]
    rows = [
        (name, str(fact["count"]), f"{fact['times'][0]:.5g}", f"{fact['last']:.5g}") for name, fact in happened.items()
    ]
    notes: list[str] = []
    for name, fact in list(happened.items())[:_SIGNALS]:
        listed = ", ".join(f"{time:.5g}" for time in fact["times"][:_TIMES])
        left, kept = fact["count"] - _TIMES, len(fact["times"])
        more = f" and {left} more; summary.json has " if left > 0 else ""
        more += ("all" if kept == fact["count"] else f"the first {kept}") if more else ""
        notes.append(f"{name} at {listed} s{more}.")
    return Sheet("Events", ("Event", "Number", "First\n[s]", "Last\n[s]"), rows, notes)


def events_lines(summary: Summary) -> list[str]:
    """Return a line for each component with events, or for each event of a unit: number, first and last time."""
    lines: list[str] = []
    for name, fact in (summary.get("events") or {}).items():
        first, last = (f"{time:.4g} s" for time in (fact["times"][0], fact["last"]))
        at = f"at {first}" if fact["count"] == 1 else f"first at {first}, last at {last}"
        lines.append(f"{name}: {amount(fact['count'], 'event')}, {at}")
    more = len(lines) - _SIGNALS
    return [*lines[:_SIGNALS], f"{amount(more, 'more')} in summary.json"] if more > 0 else lines


_FACTS = {
    "Package": ("package", "{}"), "Scenario": ("scenario", "{}"), "Robot": ("robot", "{}"),
    "Friction": ("friction", "{}"), "Units": ("backend", "{} FMUs"), "Algorithm": ("algorithm", "{}"),
    "Error control": ("adaptive", "{:g} a step"), "Step": ("step", "{:g} s"), "Stop": ("stop", "{:g} s"),
    "Tolerance": ("tolerance", "{:g}"), "Steps": ("steps", "{}"), "Wall time": ("wall_s", "{:.3g} s"),
    "Real-time factor": ("real_time_factor", "{:.3g} simulated seconds a second"),
    "No reference": ("no_reference", "{}"),
    "Ended by": ("ended", "{0[component]} at {0[time]:.5g} s"), "Coupling": ("judgement", "{[text]}"),
}  # fmt: skip
"""Name to key and form."""


def facts(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield names and texts of the facts of the run: scenario, robot, units, algorithm, step, duration."""
    fmi = summary.get("fmi", FMI_2.name)
    for name, (key, form) in _FACTS.items():
        value = summary.get(key)
        if value is not None:
            more = f" of FMI {fmi}" if name == "Units" and fmi != FMI_2.name else ""
            more += f", {summary['compiler']}" if name == "Units" and summary.get("compiler") else ""
            yield name, form.format(value) + more
    if lines := events_lines(summary):
        yield "Events", "\n".join(lines)
    if (pace := summary.get("pace")) is not None:
        p50, p99_9, worst = (f"{1e6 * pace[f'late_{each}_s']:.3g}" for each in ("p50", "p99_9", "worst"))
        late = f"rows {p50} µs late (p50), {p99_9} (p99.9), {worst} (worst, row {pace['worst_row']})"
        yield "Pace", f"{pace['speed']:g} s a second; {late}; {pace['overruns']} of {pace['rows']} overran"
        yield "Machine", pace["machine"]
    if (done := summary.get("communication")) is not None:
        lengths = dict.fromkeys(f"{1e3 * done[key]:.3g}" for key in ("shortest_step", "longest_step"))
        text = f"{done['steps']} steps of {' to '.join(lengths)} ms"
        yield "Communication", f"{text}, {done['rejected']} rejected, {done['unit_steps']} steps of units"
    if (bond := summary.get("power_bond")) is not None:
        residual, exchanged = energies(bond)
        share = f" ({residual / exchanged:.2g} of it)" if exchanged > 0.0 else ""
        text = f"{residual:.3g} J, the sum of absolute values, at tau and kappa_dot"
        net = f"net {sum(bond['residual_energy_j']):.3g} J"
        yield "Coupling energy error", f"{text}, where {exchanged:.3g} J are exchanged{share}; {net}"
    if (mode := (summary.get("key_figures") or {}).get("mode")) is not None:
        yield "Lowest mode", f"{quantity(mode['value'], 'Hz')} at {mode['at_s']:.3g} s, motors held"
    if (separation := summary.get("separation")) is not None:
        moved = f"move the run by {number(separation['max_position_difference_rad'])} rad or m"
        yield "Chaotic loop", f"rotor inertias larger by {separation['change']:g} of themselves {moved}"
    if parameters := summary.get("parameters"):
        yield "Parameters", ", ".join(f"{key} = {value}" for key, value in parameters.items())


def _joints(summary: Summary, n: int) -> list[str]:
    """Return the number of each joint, and its name if it has one."""
    names: Sequence[str] = summary.get("joint_names") or [""] * n
    return [f"{i} {name}".rstrip() for i, name in enumerate(names, 1)]


def units_of(summary: Summary, key: str, n: int) -> list[str]:
    """Return the unit of each joint's values under a key of a summary."""
    return list(summary.get(key) or [_DEFAULT_UNIT[key]] * n)


def _column(summary: Summary, heading: str, key: str, unit_key: str, fit: bool) -> tuple[str, list[str]]:
    """Return heading and cells. The heading has the unit if all joints share it and numbers do not get prefixes."""
    values: Sequence[float] = summary[key]
    units = units_of(summary, unit_key, len(values))
    if fit:
        return heading, [quantity(value, unit) for value, unit in zip(values, units, strict=True)]
    if len(set(units)) == 1:
        return f"{heading}\n[{units[0]}]", [number(value) for value in values]
    return heading, [f"{number(value)} {unit}" for value, unit in zip(values, units, strict=True)]


def _per_cent(ours: float, theirs: Sequence[float], i: int) -> str:
    """Return `ours` in per cent of the paper's, two digits; `_NONE` if the paper prints no value or 0."""
    if i >= len(theirs) or theirs[i] == 0.0 or not math.isfinite(ours):
        return _NONE
    ratio = 100.0 * ours / theirs[i]
    if ratio < 0.01:
        return "<0.01"
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.2g}"


def _rows(columns: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    return list(zip(*columns, strict=True))


_STYLES = {UNJUDGED: "dim", GOOD: "green", DOUBTFUL: "yellow", FAILED: "red"}


def run_panel(summary: Summary) -> Panel:
    """Return the facts of the run for the terminal, one per line."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, text in facts(summary):
        grid.add_row(Text(name), Text(text))
    return Panel(grid, title="Run", title_align="left", expand=False, box=box.ROUNDED)


def sheet_table(sheet: Sheet) -> Table:
    """Return a sheet for the terminal."""
    table = plain_table(title=f"\n{sheet.title}")
    table.caption = Text("\n".join(sheet.notes), style="dim")
    for i, heading in enumerate(sheet.columns):
        justify = "left" if i == 0 else "right"
        table.add_column(Text(heading), justify=justify, overflow="fold")  # a digit is never cut off
    for row in sheet.rows:
        table.add_row(*map(Text, row))
    return table


def verdict_table(summary: Summary, limits: bool = False) -> Table:
    """Return the checks of a run for the terminal, one per line; with `limits` also these and their origin."""
    table = plain_table(show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for check in checks_of(summary):
        sign = Text(f"{SIGNS[check.state]} {check.state}", style=_STYLES[check.state])
        table.add_row(sign, Text("; ".join(filter(None, (check.text, check.source if limits else "")))))
    return table


def verdict_text(summary: Summary) -> Text:
    """Return the headline of a run, see `outcome_of`, and, below it, its results."""
    results = "; ".join(filter(None, (results_of(summary), checks_line(summary))))
    return outcome_text(summary).append(f"\n  {results}" if results else "")


def outcome_text(summary: Summary) -> Text:
    """Return the headline of a run behind the sign of its state, see `outcome_of`."""
    outcome = outcome_of(summary)
    return state_text(state_of(summary) or UNJUDGED, outcome) if outcome else Text()


def state_text(state: str, text: str) -> Text:
    """Return a line after the symbol of its state; empty without a state."""
    return Text.assemble((f"{SIGNS[state]} ", _STYLES[state]), (text, f"bold {_STYLES[state]}")) if state else Text()
