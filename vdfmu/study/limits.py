"""The limits of all verdicts, each with the measured value, the limit, its source, and the sentence.

Runs, studies, logs and the page of a run are all judged by this table. A scenario sets its own limits in ``[limits]``,
and ``--limit margin=0.3`` sets one for a run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.base.measure import number
from vdfmu.base.text import nearest
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, Check

_DIGITS = 9
"""Most additional digits of a number that rounds to its limit."""


class Limit(NamedTuple):
    """A row of the table of limits."""

    key: str
    """Name in ``[limits]`` and ``--limit``."""
    name: str
    """Name of the check."""
    value: float
    beyond: str
    """State of a run that exceeds the limit."""
    unit: str
    """Unit of the number and the limit: ``1``, ``%`` for a fraction, or a unit of measurement."""
    sentence: str
    """Sentence on the measured value, with placeholders for ``value``, ``place``, ``time`` and others."""
    by: str
    """Reason for the value of the limit."""
    at_least: bool = False
    """Whether numbers below the limit, instead of those above it, exceed it."""
    failed: float = math.inf
    """A second limit, beyond which a run has failed; infinite without one."""

    def shown(self, value: float, more: int = 0) -> str:
        """Return a number of the row as text, with `more` additional digits."""
        if self.unit == "1":
            return number(value, 2 + more)
        return f"{number(100.0 * value if self.unit == '%' else value, 3 + more)} {self.unit}"

    def state(self, value: float) -> str:
        """Return the state of a number; NaN exceeds every limit."""
        if self.at_least:
            return GOOD if value >= self.value else self.beyond
        if value <= self.value:
            return GOOD
        return self.beyond if value <= max(self.failed, self.value) or math.isinf(self.failed) else FAILED

    def excuses(self, value: float) -> bool:
        """Return whether a number is good only because of the limit that a user set."""
        usual = LIMITS[self.key]
        return self.by != usual.by and self.state(value) == GOOD != usual.state(value)

    def check(self, value: float, more: str = "", **places: Any) -> Check:
        """Judge a number; `places` fill the sentence's other placeholders. The limit is named if it matters."""
        state, digits = self.state(value), 0
        limit = self.failed if state == FAILED and self.beyond != FAILED else self.value
        while state != GOOD and digits < _DIGITS and self.shown(value, digits) == self.shown(limit, digits):
            digits += 1  # a number that exceeds its limit must not look equal to it
        text = self.shown(value, digits)
        sentence = self.sentence.format(value=text, samples="sample" if text == "1" else "samples", **places)
        if state != GOOD or self.excuses(value):
            bound = f"limit {self.shown(limit)}{'' if self.by == LIMITS[self.key].by else f' by {self.by}'})"
            sentence = f"{sentence.removesuffix(')')}, {bound}" if sentence.endswith(")") else f"{sentence} ({bound}"
        return Check(self.key, self.name, state, sentence, more, value, self.value, self.by)


_ASTROM = "Astrom and Hagglund, Advanced PID Control, 2006, section 4.5: a largest sensitivity of 2"
ROWS = (
    Limit(
        "margin", "Modulus margin", 0.5, DOUBTFUL, "1", "modulus margin {value} at {place}, {time}", _ASTROM,
        at_least=True,
    ),
    Limit(
        "delay", "Delay margin", 1.0, DOUBTFUL, "1", "delay margin of {value} {samples} at {place}, {time}",
        "one additional sample of delay in the computer must not make the loop unstable", at_least=True,
    ),
    Limit(
        "growth", "Growth of disturbances", 0.1, DOUBTFUL, "%",
        "{place} is unstable from {time} to {until} (grows {value})",
        "vibration lets disturbances grow for a while; growth by a tenth does not show in the errors",
    ),
    Limit(
        "saturated", "Joint limits", 0.01, DOUBTFUL, "%", "{place} for {value} of the run, {time}",
        "tables of these shares are rounded to 1 %",
    ),
    Limit(
        "tool", "Tracking", 0.1, DOUBTFUL, "%", "{place} off its path by {error}, {value} of the motion, at {time}",
        "a motion counts as completed within a tenth of its size of the target, as for rise times from 10 to 90 %",
        failed=0.5,
    ),
    Limit(
        "joint", "Tracking", 0.5, FAILED, "%", "{place} off its path by {error}, {value} of the motion, at {time}",
        "an arm that stops in the middle of its motion is off by half of the motion",
    ),
    Limit(
        "coupling", "Coupling error", 0.01, FAILED, "%", "coupling error {value} at {place}",
        "the requested error",
    ),
    Limit(
        "reference", "Reference", 1e-3, FAILED, "%",
        "differs from the {place} scipy reference by {value} of the peak error",
        "smaller differences do not show in tables with three digits",
    ),
    Limit(
        "statistics", "Reference statistics", 0.05, FAILED, "%",
        "RMS errors of a chaotic loop differ by {value} from the scipy reference's",
        "finite samples of a chaotic loop differ by up to 2.4 %",
    ),
    Limit(
        "energy", "Coupling energy", 0.1, FAILED, "%", "coupling energy error {error}, {value} of {place} exchanged",
        "4 % with friction-induced oscillation, 31 % in a limit cycle, below 0.2 % in all other shipped scenarios",
    ),
    Limit(
        "speed", "Speed in the log", 60.0, FAILED, "rad/s", "{place} moves at {value}: check the unit of the times",
        "wrists of SCARA robots reach 45 rad/s; linear motors reach 15 m/s, and their limit is 20 m/s",
    ),
    Limit(
        "ratio", "Gear ratio", 0.05, DOUBTFUL, "%",
        "gear ratio of {place} is {ratio}, not {ell}: the link moves {factor} times as far",
        "springs and encoders cause a difference of a few per mille", failed=0.1,
    ),
    Limit(
        "torque", "Size of the torques", 10.0, FAILED, "1",
        "torques are {factor} times the robot file's: {cause}",
        "friction makes torques two to three times as large as those of the links, and masses are not wrong by a "
        "factor of ten",
    ),
    Limit(
        "scale", "Scale of the links", 1.1, DOUBTFUL, "1", "torques are {factor} times the file's: {cause}",
        "the ratios in a series of gears differ by at least 20 %, so half of that tells them apart; a measured KUKA "
        "KR 300 has 1.01; 1.6 is three times the 20 % by which masses in robot files are wrong", failed=1.6,
    ),
    Limit(
        "residual", "Residual torque", 0.3, DOUBTFUL, "%", "{place} has a residual of {value} of its torque's RMS",
        "on a measured arm, a KUKA KR 300, 4 to 29 % remain", failed=0.5,
    ),
)  # fmt: skip
LIMITS: Mapping[str, Limit] = {row.key: row for row in ROWS}
"""The limits by name."""


OF_SCENARIO = "[limits] of the scenario"
"""Origin of the limits in a scenario's file, for messages."""


def own_limits(limits: Mapping[str, Limit]) -> dict[str, dict[str, Any]]:
    """Return the changed limits by name: their ``value``, and ``by`` whom it was set."""
    return {key: {"value": row.value, "by": row.by} for key, row in limits.items() if row.by != LIMITS[key].by}


def read_limits(values: Mapping[str, Any], by: str, limits: Mapping[str, Limit] = LIMITS) -> dict[str, Limit]:
    """Return limits, some with a user's values; `by` names their origin, such as ``--limit``.

    UsageError for unknown names, and for values that are not positive numbers.
    """
    changed = dict(limits)
    for key, wanted in values.items():
        if key not in limits:
            raise UsageError(f"{by}: {key!r} is not a limit. {nearest(key, [*limits])}")
        try:
            value = float(str(wanted).strip().removesuffix("%")) / (100.0 if str(wanted).strip().endswith("%") else 1.0)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise UsageError(
                f"{by}: {key} must be a positive number, got {wanted!r}. The default is {limits[key].value:g}."
            )
        changed[key] = limits[key]._replace(value=value, by=by)
    return changed


def energies(bond: Mapping[str, Any]) -> tuple[float, float]:
    """Return the total energy error of the coupling, a sum of absolute values, and the total exchanged energy [J]."""
    return sum(bond["residual_energy_abs_j"]), sum(bond["exchanged_energy_j"])
