"""Determines which components of a system are sampled, and whether their sample times are declared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vdfmu.engine.fmu.access import TEXTS
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.check import Checked


def declared_samples(checked: Checked, system: FlatSystem) -> set[str]:
    """Return the components that declare sample times by a step, a period, or a clock."""
    stepped = {component.name for component in system.components if component.step is not None}
    described = checked.descriptions.items()
    return stepped | {name for name, each in described if each.period or any(v.clock for v in each.variables.values())}


def timed_samples(checked: Checked, system: FlatSystem) -> set[str]:
    """Return components whose samples take effect at declared times: with their own step, or passed on in the step."""
    stepped = {component.name for component in system.components if component.step is not None}
    late = {link.start[0] for link in checked.links if link.stepped and link.end not in checked.schedule.fresh}
    return stepped | declared_samples(checked, system) - late


def ambiguous(checked: Checked) -> list[str]:
    """Return the components that may be sampled: those with discrete outputs, or with held inputs and without states.

    Components for model exchange have no steps at which they could sample.
    """
    declared, names = declared_samples(checked, checked.system), dict[str, None]()
    fed = {link.end[0] for link in checked.links if link.stepped and checked.how.substeps}
    for link in checked.links:
        name, each = link.start[0], checked.descriptions.get(link.start[0])
        if each is not None and name not in declared and link.stepped and link.source.type == "Real":
            law = name in fed and not each.states and not each.exchange
            names |= {name: None} if law or link.source.variability == "discrete" else {}
    return list(names)


def keeping_steps(system: FlatSystem, names: Sequence[str], step: float) -> FlatSystem:
    """Return the system in which some components keep a given step."""
    parts = tuple(replace(each, step=step) if each.name in names else each for each in system.components)
    return replace(system, components=parts, inspected={})


def exchanged_at_samples(checked: Checked, system: FlatSystem) -> bool:
    """Return whether all signals between components are exchanged at declared samples, whatever the step."""
    kept = {component.name for component in system.components if component.step is not None}
    timed = timed_samples(checked, system) if checked.how.substeps else kept
    links = [link for link in checked.links if link.stepped and link.start[0] in checked.descriptions]
    return all(
        kept.intersection((link.start[0], link.end[0]))
        or (link.start[0] in timed and link.source.variability == "discrete")
        for link in links
    )


def judged_signals(checked: Checked) -> tuple[list[str], int]:
    """Return all real outputs, first those that count as read, and the number of these.

    An output counts as read if another component reads it or if its component is at the end of a chain.
    """
    descriptions = checked.descriptions
    links = [link for link in checked.links if link.stepped and link.start[0] in descriptions]
    read = dict.fromkeys(".".join(link.start) for link in links if link.source.type not in TEXTS)
    feeding, fed = ({getattr(link, end)[0] for link in links} for end in ("start", "end"))
    outputs = {
        name: [f"{name}.{v.name}" for v in descriptions[name].named("output") if v.type == "Real"]
        for name in descriptions
        if name in feeding | fed
    }
    for name in fed - feeding:
        read |= dict.fromkeys(outputs[name])
    return [*dict.fromkeys([*read, *(each for some in outputs.values() for each in some)])], len(read)
