"""Causes of the error of a run that its page can reduce or take away one at a time, by running again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from vdfmu.arm.robot.parameters import PARAMETERS

LESS = 4
"""Factor by which causes that cannot be taken away are reduced. One to which the error is in proportion leaves a
quarter of it; much stiffer drives would cost a solver minutes."""

Names = Mapping[str, Mapping[str, float]]
"""Component, to parameter, to its value in the run."""


class Cause(NamedTuple):
    """Parameters, in all components that have them, that take a cause away; some of them is not 0 where it is there."""

    words: str
    """The run without it, in words."""
    names: tuple[str, ...]
    change: Mapping[str, float]
    """The new ``value``, or a ``factor``."""


def scaled_as(what: str) -> tuple[str, ...]:
    """Return the parameters of a robot that are scaled together."""
    return tuple(name for name, row in PARAMETERS.items() if row.scaled_as == what)


CAUSES = (
    Cause("No friction, and none expected", scaled_as("friction"), {"value": 0.0}),
    Cause(f"Drives {LESS} times as stiff, and known to be", scaled_as("stiffness"), {"factor": LESS}),
    Cause("No kinematic error of the drives", ("theta_err_amplitude",), {"value": 0.0}),
    Cause("No delay of signals", ("T_d",), {"value": 0.0}),
    Cause("No jitter and no lost samples", ("T_j", "loss"), {"value": 0.0}),
    Cause("Encoders of 48 bits", ("bits",), {"value": 48.0}),
    Cause("No noise", ("sigma",), {"value": 0.0}),
)


def causes(parameters: Names, knobs: Sequence[Mapping[str, Any]], fast: bool) -> Iterator[dict[str, Any]]:
    """Yield the causes that a run has, ready for JSON; `fast`: the page can sample it `LESS` times as often."""
    if fast:
        yield {"words": f"Sampled {LESS} times as often", "split": LESS, "changes": []}
    for cause in CAUSES:
        found = [
            {"unit": unit, "name": name, **cause.change}
            for unit, values in parameters.items()
            for name in cause.names
            if any(value for each, value in values.items() if each.partition("[")[0] == name)
        ]
        if found:
            yield {"words": cause.words, "changes": found}
    for knob in knobs:
        changes = list(_to_know(knob, parameters))
        if changes:
            yield {"words": f"{knob['words']} known to the feedforward", "changes": changes}


def _to_know(knob: Mapping[str, Any], parameters: Names) -> Iterator[dict[str, Any]]:
    """Yield the changes of a feedforward that make it know the parameters of a slider."""
    arm = parameters[knob["targets"][0]["unit"]]
    for known in knob["known"]:
        for name, value in parameters[known["unit"]].items():
            if name.partition("[")[0] == known["name"] and arm.get(name, value) != value:
                yield {"unit": known["unit"], "name": name, "value": arm[name]}
