"""Which inputs and parameters each output depends on, read off the traced functions.

An entry of a Jacobian that is not zero by structure is a dependency, so the declaration follows the equations
and the robot's geometry. Written here is only how the variables of a unit feed its functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from vdfmu.kernel import Kernel, parameters

if TYPE_CHECKING:
    from vdfmu.fmu.interface import Interface

__all__ = ["dependencies"]

Pattern = npt.NDArray[np.bool_]
"""(N, N) for N value references: row `i` marks what variable `i` depends on."""

DESIRED = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot")


def dependencies(table: Interface) -> Pattern:
    """Return what each output depends on during initialization: inputs and parameters.

    At a communication point, where parameters are known, it depends on the inputs among them.
    """
    return _UNITS[table.unit](_Reader(table))


class _Reader:
    """Patterns of one unit."""

    def __init__(self, table: Interface) -> None:
        self.table = table
        self.kernel = Kernel(table.robot)

    def references(self, group: str) -> npt.NDArray[np.intp]:
        """Value references of a group; ``p`` are the robot's parameters, ``x`` the state of the plant."""
        reference, groups = self.table.reference, self.table.groups
        if group == "p":
            return np.array([reference[p.name] for p in parameters(self.table.robot)], np.intp)
        if group == "x":
            return np.arange(groups["q"].start, groups["tau_s"].stop)
        return np.arange(groups[group].start, groups[group].stop)

    def function(self, name: str, results: Iterable[str], arguments: Mapping[str, str]) -> Pattern:
        """Pattern of some results of a traced function; `arguments` maps its arguments to groups."""
        function = self.kernel.casadi_function(name)
        found = self.empty()
        for result in results:
            rows = self.references(result)
            for argument, group in arguments.items():
                sparsity = function.jac_sparsity(function.index_out(result), function.index_in(argument))
                i, j = (np.array(index, np.intp) for index in sparsity.get_triplet())
                found[rows[i], self.references(group)[j]] = True
        return found

    def copies(self, **sources: str) -> Pattern:
        """Pattern of groups that are copies of others: target to source."""
        found = self.empty()
        for target, source in sources.items():
            found[self.references(target), self.references(source)] = True
        return found

    def choice(self, parameter: str, *patterns: Pattern) -> Pattern:
        """Pattern of what a parameter chooses from."""
        found = np.logical_or.reduce(patterns)
        found[found.any(axis=1), self.references(parameter)] = True
        return found

    def empty(self) -> Pattern:
        return np.zeros((len(self.table), len(self.table)), dtype=bool)


def _same(*names: str) -> dict[str, str]:
    return {name: name for name in names}


def _trajectory(unit: _Reader) -> Pattern:
    return unit.function("trajectory", DESIRED, _same("q_start", "q_end", "T", "t_start"))


def _feedforward(unit: _Reader) -> Pattern:
    results, desired = ("tau_m", "tau_s"), _same(*DESIRED, "p")
    more = _same("q", "q_dot", "kappa_dot", "Lambda", "K_V", "k_vq", "k_vkappa")
    return unit.choice(
        "mode",
        unit.function("feedforward_inverse", results, desired),
        unit.function("feedforward_vdc", results, desired | more),
    )


def _controller(unit: _Reader) -> Pattern:
    arguments = _same("K_p", "K_v", "ell", "tau_max", "q_d", "q_d_dot", "q", "tau_m")
    return unit.choice(
        "velocity",
        unit.function("pd_control", ("tau", "tau_e"), arguments | {"velocity": "kappa_dot"}),
        unit.function("pd_control", ("tau", "tau_e"), arguments | {"velocity": "q_dot"}),
    )


def _plant(unit: _Reader) -> Pattern:
    at_rest = unit.function("equilibrium_torque", ("tau_s",), {"q": "q_0", "p": "p"})
    state = unit.copies(q="q_0", q_dot="q_dot_0") | unit.choice(
        "equilibrium",
        unit.copies(kappa_dot="q_dot_0") | at_rest,
        unit.copies(kappa_dot="kappa_dot_0", tau_s="tau_s_0"),
    )
    results = ("kappa", "p_O", "R_O", "E_kin", "E_pot", "E_spring")
    by_state = unit.function("plant_outputs", results, {"x": "x"})
    by_parameters = unit.function("plant_outputs", results, {"p": "p"})
    return state | by_parameters | by_state @ state


_UNITS: dict[str, Callable[[_Reader], Pattern]] = {
    "trajectory": _trajectory,
    "feedforward": _feedforward,
    "controller": _controller,
    "plant": _plant,
}
