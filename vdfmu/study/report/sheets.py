"""The numbers of a run as rows of text, for the terminal.

A summary is the content of ``summary.json``. Its lists run over the joints; lists of ``paper`` may end earlier.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from vdfmu.base.measure import number, quantity
from vdfmu.base.standards import FMI_2
from vdfmu.study.run.summary_keys import Summary, energies


class Sheet(NamedTuple):
    """A table as text."""

    title: str
    columns: tuple[str, ...]
    """Headings; a line break parts them where space is short."""
    rows: list[tuple[str, ...]]
    notes: list[str]
    """Sentences below the table."""


TRACKING = (
    ("Position\nRMS", "rms_position_error_deg", "position_units"),
    ("Position\nmaximum", "max_position_error_deg", "position_units"),
    ("Torque\nRMS", "rms_torque_compensation_error_nm", "torque_units"),
)
_LIMITS = {"Torque\nlimit": "torque", "Speed\nlimit": "speed", "End\nstop": "stop"}
_DEFAULT_UNIT = {"position_units": "deg", "torque_units": "N.m"}
_NONE = "-"


def sheets(summary: Summary, *, fit: bool = False) -> list[Sheet]:
    """Return the tables of a run for which its summary has the numbers; `fit`: each with a unit that fits it."""
    made = {
        "rms_position_error_deg": partial(tracking_sheet, fit=fit),
        "limits": limits_sheet,
        "rms_spring_torque_nm": partial(estimation_sheet, fit=fit),
        "reference": reference_sheet,
    }
    return [
        sheet(summary) for key, sheet in made.items() if summary.get(key) and (key != "limits" or at_limits(summary))
    ]


def tracking_sheet(summary: Summary, *, fit: bool = False) -> Sheet:
    """Position and torque compensation errors of each joint, next to the paper's and in per cent of them."""
    paper: Summary = summary.get("paper") or {}
    n = len(summary["rms_position_error_deg"])
    columns = ["Joint"]
    cells: list[list[str]] = [_joints(summary, n)]
    for heading, key, unit_key in TRACKING:
        units = units_of(summary, unit_key, n)
        label, values = _with_units(heading, summary[key], units, fit)
        columns.append(label)
        cells.append(values)
        if paper.get(key):
            theirs: Sequence[float] = paper[key]
            columns += ["paper", "%"]
            written = [quantity(*each) if fit else f"{each[0]:g}" for each in zip(theirs, units, strict=False)]
            cells.append([*written, *[_NONE] * (n - len(written))])
            cells.append([_per_cent(ours, theirs, i) for i, ours in enumerate(summary[key])])
    notes = ["Position: desired minus actual. Torque: control minus feedforward, link side."]
    if paper:
        notes.append(f"Paper: {paper['source']}." if paper.get("source") else "Paper.")
        differs = summary.get("plant_factors") or any(
            name.startswith("plant.") for name in summary.get("settings") or ()
        )
        notes.append(
            "The plant differs from the model by chosen values. The gains are chosen too."
            if differs
            else "An ideal case: plant and model are identical, and the gains are chosen."
        )
    return Sheet("Tracking and compensation errors", tuple(columns), _rows(cells), notes)


def at_limits(summary: Summary) -> bool:
    """Whether a joint of the run was at a limit."""
    return any(share > 0.0 for arm in summary["limits"].values() for shares in arm.values() for share in shares)


def limits_sheet(summary: Summary) -> Sheet:
    """Share of the time that each joint was at its limits."""
    arms: Mapping[str, Summary] = summary["limits"]
    rows = [
        (f"{arm} {joint}" if len(arms) > 1 else joint, *(f"{100.0 * shares[key][i]:.3g}" for key in _LIMITS.values()))
        for arm, shares in arms.items()
        for i, joint in enumerate(_joints(summary, len(shares["torque"])))
    ]
    notes = [
        "Share of the time. Torque: the motor, or the controller before it, gives its largest, and more is asked for.",
        "Speed: the motor gives less than that, as it turns too fast. End stop: the joint pushes into it.",
    ]
    return Sheet("Joints at their limits", ("Joint", *(f"{heading}\n[%]" for heading in _LIMITS)), rows, notes)


_ESTIMATION = {
    "Torque\nRMS": "rms_spring_torque_nm",
    "As printed\nRMS error": "rms_tau_f_hat_error_nm",
    "Consistent\nRMS error": "rms_tau_s_hat_error_nm",
}


def estimation_sheet(summary: Summary, *, fit: bool = False) -> Sheet:
    """Errors of the estimated spring torques of each joint."""
    n = len(summary["rms_spring_torque_nm"])
    units = units_of(summary, "torque_units", n)
    labelled = [_with_units(heading, summary[key], units, fit) for heading, key in _ESTIMATION.items()]
    columns = ("Joint", *(label for label, _ in labelled))
    cells = [[str(i + 1) for i in range(n)], *(values for _, values in labelled)]
    notes = [
        "Estimate minus the plant's spring torque, link side.",
        "As printed, the wave generator carries the motor's torque.",
    ]
    return Sheet("Torque estimates", columns, _rows(cells), notes)


def reference_sheet(summary: Summary) -> Sheet:
    """Largest differences between the co-simulation and its references; or of RMS values where solutions separate."""
    n = len(summary.get("rms_position_error_deg", ()))
    position = "rad or m" if "mm" in units_of(summary, "position_units", n) else "rad"
    torque = "N.m or N" if "N" in units_of(summary, "torque_units", n) else "N.m"
    compared: Summary = summary.get("reference") or {}
    separation: Summary | None = summary.get("separation")
    if any("max_difference" in entry for entry in compared.values()):
        return _signals_sheet(compared)
    headings = (f"Position\n[{position}]", f"Torque\n[{torque}]")
    keys, factor = ("max_position_difference_rad", "max_torque_difference_nm"), 1.0
    notes = ["Largest over all joints and communication points; torques link side."]
    if separation is not None:
        apart = max(entry["max_position_difference_rad"] for entry in compared.values())
        headings = ("Position RMS\n[%]", "Torque RMS\n[%]")
        keys, factor = ("rms_position_difference", "rms_torque_difference"), 100.0
        notes = [
            "Between the RMS errors of run and reference; largest of the joints.",
            f"Point by point they differ by up to {number(apart)} {position}, which shows no error: the loop is "
            f"chaotic, and a change of {separation['change']:g} moves the run by "
            f"{number(separation['max_position_difference_rad'])} {position}.",
        ]
    rows = [
        (str(entry.get("name", key)), *(number(factor * entry[value]) for value in keys))
        for key, entry in compared.items()
    ]
    return Sheet(
        "Difference to the references", ("Reference", *headings), rows, notes if rows else ["No reference was solved."]
    )


def _signals_sheet(compared: Summary) -> Sheet:
    """Largest difference of every output of a system without the paper's signals."""
    order = [signal for entry in compared.values() for signal in entry["max_difference"]]
    return Sheet(
        "Difference to the references",
        ("Signal", *(str(entry.get("name", key)) for key, entry in compared.items())),
        [
            (signal, *(number(entry["max_difference"][signal]) for entry in compared.values()))
            for signal in dict.fromkeys(order)
        ],
        ["Largest over all elements and communication points, in the units of the signals."],
    )


def facts(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield names and texts of the facts of the run: scenario, robot, units, master, step, duration."""
    lines = {
        "Package": ("package", "{}"),
        "Scenario": ("scenario", "{}"),
        "Robot": ("robot", "{}"),
        "Friction": ("friction", "{}"),
        "Units": ("backend", "{} FMUs"),
        "Master": ("master" if "master" in summary else "algorithm", "{}"),
        "Error control": ("adaptive", "{:g} a step"),
        "Step": ("step", "{:g} s"),
        "Stop": ("stop", "{:g} s"),
        "Tolerance": ("tolerance", "{:g}"),
        "Steps": ("steps", "{}"),
        "Wall time": ("wall_s", "{:.3g} s"),
        "Real-time factor": ("real_time_factor", "{:.3g}"),
        "No reference": ("no_reference", "{}"),
    }
    fmi = summary.get("fmi", FMI_2.name)
    for name, (key, form) in lines.items():
        if summary.get(key) is not None:
            more = f" of FMI {fmi}" if name == "Units" and fmi != FMI_2.name else ""
            more += f", {summary['compiler']}" if name == "Units" and summary.get("compiler") else ""
            yield name, form.format(summary[key]) + more
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
        text = (
            f"{residual:.3g} J, the sum of absolute values, at tau and kappa_dot, where {exchanged:.3g} J are exchanged"
        )
        yield "Energy residual", f"{text}{share}; net {sum(bond['residual_energy_j']):.3g} J"
    if (separation := summary.get("separation")) is not None:
        moved = f"move the run by {number(separation['max_position_difference_rad'])} rad or m"
        yield "Chaotic loop", f"rotor inertias larger by {separation['change']:g} of themselves {moved}"
    if settings := summary.get("settings"):
        yield "Settings", ", ".join(f"{key} = {value}" for key, value in settings.items())


def _joints(summary: Summary, n: int) -> list[str]:
    """Return the number of each joint, and its name, if it has one."""
    names: Sequence[str] = summary.get("joint_names") or [""] * n
    return [f"{i} {name}".rstrip() for i, name in enumerate(names, 1)]


def units_of(summary: Summary, key: str, n: int) -> list[str]:
    """Return the unit of each joint's values, which a summary has under a key."""
    return list(summary.get(key) or [_DEFAULT_UNIT[key]] * n)


def _with_units(heading: str, values: Sequence[float], units: Sequence[str], fit: bool) -> tuple[str, list[str]]:
    """Put the unit into the heading if all joints share it, otherwise, or if it is to fit, behind every number."""
    if fit:
        return heading, [quantity(value, unit) for value, unit in zip(values, units, strict=True)]
    if len(set(units)) == 1:
        return f"{heading}\n[{units[0]}]", [number(value) for value in values]
    return heading, [f"{number(value)} {unit}" for value, unit in zip(values, units, strict=True)]


def _per_cent(ours: float, theirs: Sequence[float], i: int) -> str:
    """Return `ours` in per cent of the paper's, two digits; nothing where the paper has none or prints 0."""
    if i >= len(theirs) or theirs[i] == 0.0 or not math.isfinite(ours):
        return _NONE
    ratio = 100.0 * ours / theirs[i]
    if ratio < 0.01:
        return "<0.01"
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.2g}"


def _rows(columns: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    return list(zip(*columns, strict=True))
