"""Runs in several processes: the split of a system, and `federate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Unpack

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.option import with_options
from vdfmu.base.text import close_to
from vdfmu.engine.algorithms import DELAYED
from vdfmu.engine.federation.federated import Federated, FederationPlan, levels, sent_values, share
from vdfmu.engine.options import FederateOptions
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import SOURCE
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.isolated import Making
from vdfmu.engine.run.simulator import simulate

CORES = ("tcp_ss", "tcp", "zmq", "ipc")
"""Message transports of HELICS; ``tcp_ss`` needs one port, the broker's; ``ipc``, shared memory, works on one machine.

Not ``zmq_ss``: exchanges of four federates stall with it in HELICS 3.6.1, for a tenth of a second each.
"""


@dataclass(frozen=True)
class Federation:
    """Split of a system over processes, and their connection; for parameters see `federate`."""

    split: Sequence[str]
    only: str | None = None
    broker: str | None = None
    core: str = "tcp_ss"

    def algorithm(self, wanted: str | None) -> str:
        """Return the algorithm of federates; UsageError if the user wants another algorithm."""
        if wanted not in (None, DELAYED):
            raise UsageError(f"algorithm must be {DELAYED} for federates, got {wanted}")
        return DELAYED

    def apart(self, checked: Checked) -> tuple[Checked, Making]:
        """Return the part of a checked system that runs here, and the factory of its `Federated`.

        UsageError with all problems of the split; VdfmuError if HELICS is not installed.
        """
        if find_spec("helics") is None:
            text = "federates need the Python package helics, but it is not installed. Install it: "
            raise VdfmuError(f"{text}{sys.executable} -m pip install helics")
        plan = self._plan(checked)
        return share(checked, [name for part in plan.here for name in plan.parts[part]]), partial(Federated, plan)

    def _plan(self, checked: Checked) -> FederationPlan:
        owner: dict[str, str] = {}
        problems: list[str] = []
        groups = [tuple(name.strip() for name in text.split(",")) for text in self.split]
        for group in groups:
            for name in group:
                if name not in checked.descriptions:
                    similar = close_to(name, checked.descriptions)
                    problems.append(f"split: the system has no component {name!r}{similar}")
                elif name in owner:
                    text = f"split: {name} is named twice, for the federates {owner[name]} and {group[0]}"
                    problems.append(f"{text}; each component steps in one")
                owner.setdefault(name, group[0])
        rest = tuple(name for name in checked.descriptions if name not in owner)
        owner |= dict.fromkeys(rest, rest[0] if rest else "")
        parts = {group[0]: group for group in [*groups, rest] if group}
        if not problems and len(parts) < 2:
            text = f"split: expected at least two federates, got {', '.join(parts)}; name some of the components "
            problems.append(text + ", ".join(checked.descriptions))
        if self.only is not None and self.only not in parts and not problems:
            problems.append(f"no federate is named {self.only!r}; expected {', '.join(parts)}, by the first component")
        if self.only is not None and self.broker is None:
            text = f"federate {self.only} runs alone, and needs the address of a broker: --broker HOST:PORT"
            problems.append(f"{text}; 'helics_broker' starts a broker")
        if self.core not in CORES:
            problems.append(f"core: expected {', '.join(CORES)}, got {self.core!r}")
        if all(component.step is None for component in checked.system.components):
            text = "has event mode, and events need all components in one process; 'vdfmu run' runs it"
            problems += [f"{name}: {text}" for name, unit in checked.descriptions.items() if unit.event_mode]
        if problems:
            raise UsageError("\n".join(problems))
        crossing = [k for k in checked.links if k.start[0] != SOURCE and owner[k.start[0]] != owner[k.end[0]]]
        passed = sorted([*crossing, *checked.schedule.initial.torn], key=lambda link: not link.stepped)
        sent = {name: sent_values([k for k in passed if k.start[0] in part]) for name, part in parts.items()}
        here = tuple(parts) if self.only is None else (self.only,)
        return FederationPlan(parts, here, sent, levels(checked, crossing), self.core, self.broker)


@with_options
def federate(
    system: FlatSystem | str | Path,
    split: Sequence[str],
    *,
    only: str | None = None,
    broker: str | None = None,
    core: str = "tcp_ss",
    **options: Unpack[FederateOptions],
) -> Results:
    """Co-simulate a system in several processes, federates, that exchange values by HELICS.

    Every federate steps its components with the other federates' values at the start of the step. So the results are
    the same as with :func:`vdfmu.simulate` and the algorithm jacobi.

    Parameters
    ----------
    system : FlatSystem, str or Path
        See :func:`vdfmu.simulate`.
    split : sequence of str
        The components of each federate, such as ``["plant", "feedforward,controller"]``; all other components form
        one more. A federate has the name of its first component.
    only : str, optional
        The federate to run here; the results hold only its components. By default all run here.
    broker : str, optional
        Address, ``HOST:PORT``, of the common HELICS broker. By default a broker is started here, on loopback.
    core : str, optional
        Message transport of HELICS, one of `CORES`.
    **options
        :class:`vdfmu.engine.options.FederateOptions`.

    Returns
    -------
    Results
        See :func:`vdfmu.simulate`; the summary has the ``federates`` and their wall times of exchanges.

    Raises
    ------
    SspError, UsageError, VdfmuError
        See :func:`vdfmu.simulate`, and for a wrong split, or if HELICS is not installed.
    CosimError
        A component failed, a federate has ended, here or elsewhere, or cannot be reached; `results` holds the rows.
    """
    return simulate(system, federation=Federation(split, only, broker, core), **options)
