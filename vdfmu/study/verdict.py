"""The verdict on a run, which compares measured values with the table of limits, the most important checks first.

A verdict is made only from the summary of a run, so that a page or a later command comes to the same result.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from vdfmu.base.errors import CosimError, FailureKind
from vdfmu.base.measure import number, quantity
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, STATES, UNJUDGED, Check, verdict_of
from vdfmu.engine.run import Interrupted
from vdfmu.study.coupling_error import RIGHT, WRONG
from vdfmu.study.expected import expected_check
from vdfmu.study.limits import LIMITS, Limit, energies
from vdfmu.study.run.summary_keys import Summary

Limits = Mapping[str, Limit]
ENERGY_FLOOR = 1e-3
"""Residual [J] below which its relative value is meaningless, as for an arm at rest."""


def verdict(summary: Summary, limits: Limits = LIMITS) -> dict[str, Any]:
    """Return the entry ``verdict`` of the summary of a complete run."""
    figures: Summary = summary.get("key_figures") or {}
    loops, ends = [*loop_checks(summary, limits)], [*_saturated(figures, limits)]
    loop = figures.get("unstable") or figures.get("margin")
    if ends and loop and figures["saturated"]["at_s"] < loop["at_s"]:
        first = [*ends, *loops]  # a joint at its limit has no feedback, so the gains are not to blame
    else:
        first = [*loops, *ends]
    checks = [
        *remark_checks(summary),
        *first,
        *_path(figures, limits),
        *_cut(summary),
        *calculated_checks(summary, limits),
    ]
    return verdict_of(checks, [*_results(summary, checks)])


def loop_checks(summary: Summary, limits: Limits = LIMITS) -> Iterator[Check]:
    """Yield the checks of a run's loops, or why they were not judged."""
    figures: Summary = summary.get("key_figures") or {}
    name = "Stability"
    if (lacking := summary.get("stability")) is not None:
        state = DOUBTFUL if lacking.get("expected") else UNJUDGED
        reason, _, more = lacking["reason"].partition(". ")
        yield Check("stability", name, state, f"stability not judged: {reason}", more)
        return
    if (excited := figures.get("excited")) is not None:
        yield Check(
            "friction", "Friction", DOUBTFUL, f"friction-induced oscillation, growing fastest at {excited['place']}",
            "the loops are judged without dry friction",
        )  # fmt: skip
    finer = _at_half_step(figures)
    if (unstable := figures.get("unstable")) is not None:
        factor = f"disturbances grow by a factor of {number(unstable['value'])} in each step"
        more = "; ".join(filter(None, (factor, finer or "the gains are too high or too low for this step")))
        yield Check("stability", name, FAILED, f"unstable {since(unstable['at_s'])}, {unstable['place']}", more)
        return
    if not figures.keys() & {"margin", "growth", "open"}:
        return
    grown = [*_growth(figures, limits)]
    if all(check.state == GOOD and not _excused(check) for check in grown):
        yield Check("stability", name, GOOD, "stable")
    if (silent := figures.get("open")) is not None:
        yield Check("feedback", "Feedback", DOUBTFUL, f"nothing is fed back to {silent['place']}")
        return
    yield from grown
    for key in ("margin", "delay"):
        if (figure := figures.get(key)) is not None:
            more = finer if key == "margin" else ""
            yield limits[key].check(figure["value"], more, place=figure["place"], time=_at(figure["at_s"]))


def _growth(figures: Summary, limits: Limits) -> Iterator[Check]:
    """Yield the check of the largest growth of a disturbance along the run."""
    if (growth := figures.get("growth")) is not None:
        times = {"time": _at(growth["at_s"]), "until": _at(growth["until_s"])}
        row, place = limits["growth"], growth["place"]
        check = row.check(growth["value"], place=place, **times)
        if check.state == GOOD and not _excused(check):
            little = f"disturbances at {place} grow by {row.shown(check.value)}, {times['time']} to {times['until']}"
            check = check._replace(sentence=little)
        yield check


def explain(error: CosimError | Interrupted, poses: Poses | None) -> dict[str, Any]:
    """Return the loops' numbers of a failed run if they are unstable, noting that in the error; else nothing."""
    if poses is None or isinstance(error, Interrupted) or poses.lacking or not poses.seconds:
        return {}
    from vdfmu.study.analysis.loops import judged  # needs CasADi, which runs of FMUs do without

    figures = judged(poses, 0.0, error.time, failed=True).figures
    if "unstable" not in figures:
        return {}
    error.kind = FailureKind.UNSTABLE
    error.add_note(f"Stability: {[*loop_checks({'key_figures': figures})][-1].text}")
    return figures


def loop_sentences(figures: Summary, limits: Limits = LIMITS) -> tuple[str, list[str]]:
    """Return the state of loops with these figures, and the sentences of the checks that are not good."""
    checks = [*loop_checks({"key_figures": figures}, limits)]
    state = max((check.state for check in checks), key=STATES.index, default=GOOD)
    sentences = [check.sentence for check in checks if check.state != GOOD]
    return state, [*sentences, *filter(None, [_at_half_step(figures)])]


def _at_half_step(figures: Summary) -> str:
    """Return a phrase with the modulus margin at half the step if only the longer step makes the loops unstable."""
    half: Summary | None = figures.get("half_step")
    return "" if half is None else f"with a step of {half['step']:g} s the modulus margin is {half['value']:.2g}"


def _saturated(figures: Summary, limits: Limits) -> Iterator[Check]:
    """Yield the check of the joint that spent most time at a motor limit or end stop."""
    if (figure := figures.get("saturated")) is not None:
        places = {"place": figure["place"], "time": since(figure["at_s"])}
        yield limits["saturated"].check(figure["value"], "without feedback there", **places)


def _path(figures: Summary, limits: Limits) -> Iterator[Check]:
    """Yield the check of whether the arm followed its motion or, in contact, moved at all."""
    figure: Summary | None = figures.get("path")
    if figure is None:
        return
    row = limits["joint" if "contact" in figures or figure["place"] != "tool" else "tool"]
    error, size = (quantity(figure[key], figure["unit"]) for key in ("value", "size"))
    if figure.get("rest"):
        sentence = f"at rest within {error}"
        yield row.check(figure["value"] / figure["size"], place="", error="", time="")._replace(sentence=sentence)
        return
    check = row.check(
        figure["value"] / figure["size"], f"maximum {figure['place']} error {error} over a motion of {size}",
        place=figure["place"], error=error, time=_at(figure["at_s"]),
    )  # fmt: skip
    yield check if check.state != GOOD or _excused(check) else check._replace(sentence=check.more, more="")


def remark_checks(summary: Summary) -> Iterator[Check]:
    """Yield notes on the system that often explain the rest: an implausible robot, unconnected inputs."""
    for name in ("implausible", "unfed"):
        notes: Sequence[str] = summary.get(name) or ()
        if notes:
            more = "; ".join(notes[1:])
            yield Check(name, {"unfed": "Inputs", "implausible": "Robot"}[name], DOUBTFUL, notes[0], more)


def _cut(summary: Summary) -> Iterator[Check]:
    """Yield a check if the run ends before its motion, unless the user requested this."""
    cut: Summary | None = summary.get("cut")
    if cut is not None and not cut["asked"]:
        yield Check("motion", "Motion", DOUBTFUL, f"the motion of {cut['end']:.3g} s is cut at {cut['stop']:.3g} s")


def calculated_checks(summary: Summary, limits: Limits = LIMITS) -> Iterator[Check]:
    """Yield the checks of a complete run's numbers against recorded or calculated ones, and of its energy."""
    if "expected" in summary:
        yield expected_check(summary["expected"])
    yield from _coupling(summary)
    yield from _reference(summary, limits)
    bond: Summary | None = summary.get("power_bond")
    if bond is not None:
        residual, exchanged = energies(bond)
        share = residual / exchanged if residual > ENERGY_FLOOR else 0.0
        places = {"error": quantity(residual, "J"), "place": quantity(exchanged, "J")}
        check = limits["energy"].check(share, **places)
        small = f"coupling energy error {places['error']} of {places['place']} exchanged"
        yield check if residual > ENERGY_FLOOR else check._replace(sentence=small)


def _coupling(summary: Summary) -> Iterator[Check]:
    judgement: Summary | None = summary.get("judgement")
    if judgement is not None:
        state = {RIGHT: GOOD, WRONG: FAILED}.get(judgement["verdict"], DOUBTFUL)
        sentence, _, more = judgement["text"].partition(". ")
        for words in ("Right to", "Not right:"):  # the state of the check says this
            sentence = sentence.replace(words, "coupling error", 1)
        sentence = sentence.replace("Not decided:", "coupling error not decided:", 1)
        numbers = judgement.get("error", math.nan), judgement["wanted"]
        yield Check("coupling", LIMITS["coupling"].name, state, sentence, more, *numbers, "the requested error")


def _reference(summary: Summary, limits: Limits) -> Iterator[Check]:
    """Yield the check against the sampled reference, which has the master's schedule."""
    name = "scipy reference"
    if "reference" not in summary or "no_reference" in summary:
        why = summary.get("no_reference") or "not requested"
        yield Check("reference", name, UNJUDGED, f"no scipy reference: {why}")
        return
    compared: Summary | None = summary["reference"].get("sampled")
    errors, units = summary.get("max_position_error_deg"), summary.get("position_units")
    if compared is None or "max_position_difference_rad" not in compared or not errors or not units:
        yield Check(
            "reference",
            name,
            UNJUDGED,
            "the difference from the reference has no scale, because the run has no tracking error",
        )
        return
    if "separation" in summary:
        apart = max(compared["rms_position_difference"], compared["rms_torque_difference"])
        yield limits["statistics"].check(apart)
        return
    from vdfmu.system.reference.reference import RESOLUTION  # needs CasADi, which runs of FMUs do without

    row = limits["reference"]
    si = {"deg": math.pi / 180.0, "mm": 1e-3}
    largest = max(si[u] * error for error, u in zip(errors, units, strict=True))
    if row.value * largest < RESOLUTION:  # an arm that has hardly moved: the reference is not more accurate
        largest = RESOLUTION / row.value
        row = row._replace(by="the absolute tolerance of the reference's solver")
    apart = compared["max_position_difference_rad"]
    more = f"positions differ by {number(apart)} rad at most; limit {number(row.value * largest)}"
    if "solved_by_scipy" in compared:
        more += (
            f"; solved in compiled code, {compared['solved_by_scipy']} of its intervals by scipy too: their "
            f"states differ by {number(compared['max_solver_difference'])} at most"
        )
    check = row.check(apart / largest, more, place=compared["name"])
    tolerance: float = summary.get("tolerance") or 0.0
    if check.state == GOOD and not _excused(check):
        sentence = f"matches the {compared['name']} scipy reference to {row.shown(check.value)} of the peak error"
        check = check._replace(sentence=sentence)
    elif check.state != GOOD and apart <= tolerance:  # the units' solvers may be off by this at a position of 1 rad
        more += f"; that is within the tolerance of the solvers, {number(tolerance)}"
        smaller = 10.0 ** math.floor(math.log10(tolerance * row.value * largest / apart))
        share = row.shown(check.value)
        noise = f"a difference of {share} of the peak error may be solver noise: try --tolerance {number(smaller)}"
        check = check._replace(state=DOUBTFUL, sentence=noise, more=more)
    if "reference_stop" in summary:
        part = f"{check.sentence}, compared over the first {number(summary['reference_stop'])} s"
        check = check._replace(sentence=part)
    yield check


def _results(summary: Summary, checks: Sequence[Check]) -> Iterator[str]:
    """Yield phrases on the results of a run, except those that a doubtful or failed check reports."""
    figures: Summary = summary.get("key_figures") or {}
    states = {check.key: check.state for check in checks}
    resting = (figures.get("path") or {}).get("rest")
    excused = [check for check in checks if _excused(check)]
    yield from (f"only because of {check.by}: {check.sentence.replace(f' by {check.by}', '')}" for check in excused)
    if states.get("margin") == GOOD and all(check.key != "margin" for check in excused):
        yield f"modulus margin {number(figures['margin']['value'], 2)}"
    if "contact" in figures:
        contact = figures["contact"]
        yield f"in contact {since(contact['at_s'])}, {quantity(contact['value'], contact['unit'])} at most"
    if resting:
        yield "at rest"
    elif "tool_error" in figures and states.get("tool", GOOD) == states.get("joint", GOOD) == GOOD:
        error = figures["tool_error"]
        yield f"maximum tool error {quantity(error['value'], 'm')} (at {_at(error['at_s'])})"
    if "joint_error" in figures and not resting:
        worst = figures["joint_error"]
        yield f"worst joint {worst['joint']}, {quantity(worst['value'], worst['unit'])}"
    cut: Summary | None = summary.get("cut")
    if cut is not None and cut["asked"]:
        yield f"stopped at {cut['stop']:.3g} s of a motion of {cut['end']:.3g} s"


def _excused(check: Check) -> bool:
    """Return whether a check is good only because of a limit that the user set."""
    row = LIMITS.get(check.key)
    return row is not None and row._replace(value=check.limit, by=check.by).excuses(check.value)


def since(time: float) -> str:
    """Return the phrase for a start time [s]."""
    return f"from {number(time)} s on" if time else "from the start"


def _at(time: float) -> str:
    return f"{number(time)} s"
