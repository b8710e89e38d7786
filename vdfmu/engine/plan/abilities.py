"""Abilities that the algorithms for continuous coupling need from the units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.plan.link import Link
from vdfmu.engine.plan.schedule import Schedule


def check_abilities(
    descriptions: Mapping[str, Description], links: Sequence[Link], schedule: Schedule, algorithm: str, adaptive: bool
) -> tuple[list[str], list[str]]:
    """Return the problems and notes of units that an algorithm cannot step as it has to.

    `adaptive`: steps may be rejected and differ in length.
    """
    problems: list[str] = []
    how = ALGORITHMS[algorithm]
    for name, unit in descriptions.items():
        clocks = [v.name for v in unit.variables.values() if v.clock is not None]
        if clocks and unit.identifier and (how.continuous or not unit.event_mode):
            way = (
                f"use {choice(continuous=False)}"
                if unit.event_mode
                else "the FMU declares no event mode (hasEventMode)"
            )
            problems.append(f"{name}: {unit.source} has clocks, {', '.join(clocks)}, which tick in event mode; {way}")
    if not how.continuous:
        return problems, []
    # a unit alone in its block is repeated by error control only
    repeated = {name for block in schedule.blocks if adaptive or (how.repeats and len(block) > 1) for name in block}
    notes: list[str] = []
    for name, unit in descriptions.items():
        if name in repeated and not unit.saves_state:
            problems.append(
                f"{name}: {unit.source} cannot save and restore its state (canGetAndSetFMUstate), so its steps cannot "
                "be repeated; use extrapolated with a fixed step, gauss-seidel or jacobi"
            )
        if adaptive and not unit.varies_steps:
            problems.append(
                f"{name}: {unit.source} takes steps of one length only (canHandleVariableCommunicationStepSize); use a "
                "fixed step"
            )
        direct = [k.end[1] for k in links if k.end[0] == name and not k.discrete and k.end in schedule.through]
        if direct and not unit.interpolates_inputs and not unit.varies_steps:
            notes.append(
                f"{name}: takes no derivatives of its inputs and steps of one length only; {', '.join(direct)} are "
                "held at their values at the end of a step, as an output depends on them directly. If it integrates "
                "them, the coupling is of first order"
            )
    return problems, notes
