"""What one step of sampled coupling does, as data: Python runs the list (`SampledStepper`), or C (`CompiledSteps`)."""

from __future__ import annotations

from typing import Literal, NamedTuple

from vdfmu.engine.plan.check import Checked


class Planned(NamedTuple):
    """One action of a step, on one component or, for a joint step, on several."""

    verb: Literal["gather", "set", "step", "get"]
    """Update inputs from the outputs that they are connected to; set inputs; step; get outputs."""
    names: tuple[str, ...]
    """Its components. Empty for all."""
    fresh: bool = False
    """Whether only inputs are updated whose source has already made this step, see `Schedule`."""
    at_end: bool = False
    """Whether the action belongs to the end of the component's own step, else to its beginning."""

    @property
    def name(self) -> str:
        """Its first component; empty for all."""
        return self.names[0] if self.names else ""


def step_actions(checked: Checked) -> list[Planned]:
    """Return the actions of a step in their order.

    Inputs are held over a step. First all inputs are updated. Then each component takes its fresh inputs, steps, and
    its outputs are read, in the order of the schedule. Components that depend on each other within a step are stepped
    together. A component with a step of its own reads its inputs when that begins and makes it when that ends, unless
    it is early (see `Checked.early`).
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
