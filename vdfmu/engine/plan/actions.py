"""The actions of one step of sampled coupling, a list that Python (`SampledStepper`) or C (`CompiledSteps`) runs."""

from __future__ import annotations

from typing import Literal, NamedTuple

from vdfmu.engine.plan.check import Checked


class Planned(NamedTuple):
    """An action of a step, on one component or, if several step together, on all of them."""

    verb: Literal["gather", "set", "step", "get"]
    """Update inputs from the outputs that they are connected to; set inputs; step; get outputs."""
    names: tuple[str, ...]
    """Its components; empty means all."""
    fresh: bool = False
    """Whether only inputs whose source has already made this step are updated, see `Schedule`."""
    at_end: bool = False
    """Whether the action belongs to the end of the component's own step instead of its beginning."""

    @property
    def name(self) -> str:
        """Its first component; empty means all."""
        return self.names[0] if self.names else ""


def step_actions(checked: Checked) -> list[Planned]:
    """Return the actions of a step in order.

    Inputs are held over a step. First all inputs are updated. Then each component takes its fresh inputs, steps, and
    its outputs are read, in the order of the schedule. Components that depend on each other within a step are stepped
    together. A component with its own step reads its inputs when this step begins and makes it when it ends, unless the
    component is early (see `Checked.early`).
    """
    units, own_steps = checked.schedule.units, bool(checked.multiples)
    actions = [Planned("gather", (name,)) for name in units] if own_steps else [Planned("gather", ())]
    group_of = {name: tuple(group) for group in checked.schedule.groups for name in group}
    for group in dict.fromkeys(group_of.get(name, (name,)) for name in units):
        late = own_steps and group[0] not in checked.early
        for name in group:
            actions += [Planned("gather", (name,), fresh=True), Planned("set", (name,))]
        actions.append(Planned("step", group, at_end=late))
        actions += [Planned("get", (name,), at_end=late) for name in group]
    return actions
