"""The default experiment of a system, and the annotations that say how it is run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.engine.rules import Finding, finding

EXPERIMENT_TYPE = "org.vdfmu.experiment"
OSP_TYPE = "com.opensimulationplatform"
FOREIGN = {"osp": "http://opensimulationplatform.com/SSP/OSPAnnotations", "vdfmu": "urn:org.vdfmu:experiment"}
"""Namespaces of the annotations' content, which the root declares: libcosim takes a declaration inside an annotation
for an algorithm."""


@dataclass(frozen=True)
class Experiment:
    """How a system is run unless told otherwise; None where its SSD does not say."""

    start: float | None = None
    """Simulated time [s], as the stop."""
    stop: float | None = None
    step: float | None = None
    """Communication step [s], from an annotation of this project or of libcosim."""
    algorithm: str | None = None
    """Master algorithm, from an annotation of this project."""
    adaptive: float | None = None
    """Largest relative error of a coupled signal in a step, for `algorithm`."""


def read_experiment(root: Any, where: str) -> tuple[Experiment, list[Finding]]:
    """Return the default experiment of an SSD, and its faults."""
    element = root.find("ssd:DefaultExperiment", NAMESPACES)
    if element is None:
        return Experiment(), []
    reader = _NumberReader(element, f"{where}, line {element.sourceline}: default experiment")
    start = reader.number(element, "startTime", "a time in s")
    stop = reader.number(element, "stopTime", "a time in s")
    if not reader.problems and stop is not None and stop <= (start or 0.0):
        reader.fault(f"expected a stopTime after startTime {start or 0.0:g} s, got {stop:g} s")
    ours = _content(element, EXPERIMENT_TYPE, f"{{{FOREIGN['vdfmu']}}}Experiment")
    osp = _content(element, OSP_TYPE, f"{{{FOREIGN['osp']}}}Algorithm/{{{FOREIGN['osp']}}}FixedStepAlgorithm")
    step = reader.number(osp, "baseStepSize", "a time in s", above=0.0)
    algorithm, adaptive = None, None
    if ours is not None:
        own = reader.number(ours, "communicationStepSize", "a time in s", above=0.0)
        step = step if own is None else own
        algorithm = ours.get("algorithm")
        adaptive = reader.number(ours, "adaptive", "a relative error below 1", above=0.0, below=1.0)
        if algorithm is not None and algorithm not in ALGORITHMS:
            reader.fault(f"expected algorithm {', '.join(ALGORITHMS.names())}, got {algorithm!r}")
        elif adaptive is not None and not (algorithm and ALGORITHMS[algorithm].continuous):
            reader.fault(f"adaptive is for {choice(continuous=True)}, not for {algorithm}")
    return Experiment(start, stop, step, algorithm, adaptive), reader.problems


def read_step(component: Any, where: str) -> tuple[float | None, list[Finding]]:
    """Return a component's own step [s], from an annotation of this project or of libcosim."""
    reader = _NumberReader(component, where)
    step = reader.number(
        _content(component, EXPERIMENT_TYPE, f"{{{FOREIGN['vdfmu']}}}Experiment"),
        "communicationStepSize", "a time in s", above=0.0,
    )  # fmt: skip
    if step is None:
        hint = _content(component, OSP_TYPE, f"{{{FOREIGN['osp']}}}StepSizeHint")
        step = reader.number(hint, "value", "a time in s", above=0.0)
    return step, reader.problems


def _content(experiment: Any, kind: str, path: str) -> Any:
    """Return the element at `path` in the annotation of a type; None if there is none."""
    for annotation in experiment.findall("ssd:Annotations/ssc:Annotation", NAMESPACES):
        if annotation.get("type") == kind and (found := annotation.find(path)) is not None:
            return found
    return None


class _NumberReader:
    """Reads numbers and collects their faults."""

    def __init__(self, element: Any, place: str) -> None:
        self.place = place
        self.problems: list[Finding] = []
        self._element = element

    def fault(self, text: str) -> None:
        self.problems.append(finding("SSP010", f"{self.place}: {text}", self._element))

    def number(
        self, element: Any, key: str, what: str, above: float = -math.inf, below: float = math.inf
    ) -> float | None:
        text = None if element is None else element.get(key)
        if text is None:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if above < value < below:
            return value
        limits = "finite" if above < 0.0 else "positive finite" if below > 1.0 else "positive"
        self.fault(f"expected a {limits} {key}, got {text}; write {what} or leave it out")
        return None
