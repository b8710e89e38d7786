"""What the algorithms for continuous coupling need of the units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from vdfmu.model.scenario import CONTINUOUS

if TYPE_CHECKING:
    from vdfmu.cosim.check import Link
    from vdfmu.cosim.description import Description
    from vdfmu.cosim.schedule import Schedule

__all__ = ["check_abilities"]


def check_abilities(
    descriptions: Mapping[str, Description],
    links: Sequence[Link],
    schedule: Schedule,
    algorithm: str,
    adaptive: bool,
) -> tuple[list[str], list[str]]:
    """Return the problems and notes of units that an algorithm cannot step as it has to.

    Parameters
    ----------
    descriptions : mapping of str to Description
        By component name.
    links : sequence of Link
    schedule : Schedule
    algorithm : str
    adaptive : bool
        Whether steps may be rejected and differ in length.
    """
    if algorithm not in CONTINUOUS:
        return [], []
    problems: list[str] = []
    # a unit alone in its block is repeated by error control only
    repeated = {
        name
        for block in schedule.blocks
        if adaptive or (algorithm == "iterative" and len(block) > 1)
        for name in block
    }
    fed = {link.end[0] for link in links if link.stepped and link.sink.type == "Real"}
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
        if name not in fed or unit.interpolates_inputs:
            continue
        if None in unit.step_dependencies.values():
            notes.append(
                f"{name}: declares no dependencies of its outputs and takes no derivatives of its inputs, which are "
                "held at their values at the end of a step. If it integrates them, the coupling is of first order, and "
                "error control does not see it"
            )
        for link in links:
            if link.end[0] == name and not link.discrete and link.end in schedule.through:
                others = [
                    output
                    for output in sorted({k.start[1] for k in links if k.start[0] == name})
                    if not _depends(unit, output, link.end[1])
                ]
                if others:
                    notes.append(
                        f"{name}.{link.end[1]}: takes no derivatives and is held at its value at the end of a step, as "
                        f"an output depends on it directly. If {others[0]} integrates it, the coupling is of first "
                        "order, and error control does not see it"
                    )
    return problems, notes


def _depends(unit: Description, output: str, name: str) -> bool:
    known = unit.step_dependencies.get(output)
    return known is None or name in known
