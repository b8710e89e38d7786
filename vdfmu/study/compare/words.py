"""A comparison in words, made of its numbers: which law to take when, by how much, and which fail."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from vdfmu.study.compare.axes import LAWS, MISMATCHES
from vdfmu.study.compare.comparison import GOOD, VERDICTS, Comparison
from vdfmu.study.compare.measures import MEASURES

BY = "rms_tool"
"""Measure by which laws are ranked."""
_CLOSE = 1.1
"""Ratio below which two laws are said to be equally good."""


def in_words(study: Comparison) -> str:
    """Return the comparison as Markdown."""
    about = study.about
    title = MEASURES[BY].title
    count = {verdict: sum(row["verdict"] == verdict for row in study.rows) for verdict in VERDICTS}
    lines = [
        "# Control laws compared",
        "",
        f"{len(study)} cells: {', '.join(f'{n} {len(about[n])}' for n in ('laws', 'arms', 'motions', 'mismatches'))}. "
        f"Each law is tuned on each arm by {about['budget']} evaluations, seed {about['seed']}, to a modulus margin of "
        f"at least {about['margin']:g}. {'; '.join(f'{n} {v}' for v, n in count.items() if n)}.",
        "",
        f"## By {title}",
        "",
        "The mean is geometric, over arms and motions, of the ratio to the best law of each. A law with a cell that is "
        "unstable, failed or off its path is not ranked.",
        "",
        *_ranking(study),
        "",
        "## Not stable, or not on the path",
        "",
        *(_broken(study) or ["All cells are stable, and keep their path."]),
        "",
        "## Tuning",
        "",
        *_tunings(study),
    ]
    return "\n".join(lines) + "\n"


def ranked(study: Comparison, mismatch: str, measure: str = BY) -> list[tuple[str, float]]:
    """Return laws without a broken cell and the geometric mean of their ratio to the best, the best law first."""
    best: dict[tuple[str, str], list[tuple[str, float]]] = {}
    broken: set[str] = {law for laws in study.about["tunings"].values() for law, t in laws.items() if t["why_not"]}
    for row in study.rows:
        if row["mismatch"] == mismatch:
            if row["verdict"] not in GOOD:
                broken.add(row["law"])
            elif row[measure] is not None and np.isfinite(row[measure]):
                best.setdefault((row["arm"], row["motion"]), []).append((row["law"], max(row[measure], 1e-12)))
    ratios: dict[str, list[float]] = {}
    for cells in best.values():
        least = min(value for law, value in cells if law not in broken or broken.issuperset(n for n, _ in cells))
        for law, value in cells:
            ratios.setdefault(law, []).append(value / least)
    means = {law: float(np.exp(np.mean(np.log(each)))) for law, each in ratios.items() if law not in broken}
    return sorted(means.items(), key=lambda pair: pair[1])


def _ranking(study: Comparison) -> Iterator[str]:
    yield "| mismatch | best | times better than the next | of all |"
    yield "| --- | --- | ---: | --- |"
    for mismatch in study.about["mismatches"]:
        order = ranked(study, mismatch)
        if not order:
            yield f"| {MISMATCHES[mismatch].text} | no law keeps all arms and motions | | |"
            continue
        names = [law for law, mean in order if mean <= _CLOSE * order[0][1]]
        rest = [mean for law, mean in order if law not in names]
        by = _times(rest[0] / order[0][1]) if rest else ""
        whole = ", ".join(f"{law} {_times(mean / order[0][1])}" for law, mean in order)
        yield f"| {MISMATCHES[mismatch].text} | {' and '.join(f'`{n}`' for n in names)} | {by} | {whole} |"


def _times(ratio: float) -> str:
    return f"{ratio:.3g}" if ratio < 999.5 else f"{ratio:,.0f}"


def _broken(study: Comparison) -> list[str]:
    found: dict[tuple[str, str, str], list[str]] = {}
    for row in study.rows:
        if row["verdict"] not in GOOD:
            found.setdefault((row["verdict"], row["mismatch"], row["law"]), []).append(f"{row['arm']} {row['motion']}")
    lines: list[str] = []
    for verdict, mismatch in dict.fromkeys(key[:2] for key in found):
        laws = {law: cells for (v, m, law), cells in found.items() if (v, m) == (verdict, mismatch)}
        each = "; ".join(f"`{law}` on {_places(cells)}" for law, cells in laws.items())
        lines.append(f"- {MISMATCHES[mismatch].text}: {verdict}: {each}.")
    return lines


def _places(cells: list[str]) -> str:
    arms: dict[str, list[str]] = {}
    for cell in cells:
        arm, motion = cell.split(" ")
        arms.setdefault(arm, []).append(motion)
    return ", ".join(f"{arm} ({', '.join(motions)})" for arm, motions in arms.items())


def _tunings(study: Comparison) -> Iterator[str]:
    tunings: dict[str, dict[str, Any]] = study.about["tunings"]
    heads = "| law | what it is | " + " | ".join(tunings) + " | step [us] |"
    yield f"{MEASURES[study.about['cost']].title} [mm] of the motion with a push, before and after the search."
    yield ""
    yield heads
    yield "| --- | --- | " + " | ".join("---" for _ in tunings) + " | ---: |"
    for law in study.about["laws"]:
        cells = [
            t["why_not"] or f"{1e3 * t['before']:.3g} → {1e3 * t['after']:.3g}"
            for t in (laws[law] for laws in tunings.values())
        ]
        steps = [laws[law]["step_us"] for laws in tunings.values() if laws[law]["step_us"]]
        span = f"{min(steps):.2g} to {max(steps):.2g}" if steps else ""
        yield f"| `{law}` | {LAWS[law].text} | {' | '.join(cells)} | {span} |"
