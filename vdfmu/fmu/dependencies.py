"""Which inputs, parameters and states each calculated variable depends on, read off the unit's program.

An entry of a traced function's Jacobian that is not zero by structure is a dependency, so the declaration
follows the equations and the robot's geometry.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from vdfmu.fmu.program import PROGRAMS, Copy, Statement
from vdfmu.kernel import Kernel

if TYPE_CHECKING:
    from vdfmu.fmu.interface import Interface

__all__ = ["dependencies", "patterns"]

Pattern = npt.NDArray[np.bool_]
"""(N, N): row `i` marks the positions on which position `i` depends."""


def dependencies(table: Interface) -> tuple[Pattern, Pattern]:
    """Return what each variable of the table depends on at a communication point, and during initialization.

    Returns
    -------
    direct : (len(table), len(table))
        Inputs; a state that they decided at the start is known.
    initial : (len(table), len(table))
        Inputs and parameters.
    """
    N, program = len(table), PROGRAMS[table.unit]
    reader = _Reader(table)
    direct = reader.run(program.outputs) & reader.positions("input")
    initial = reader.run((*program.start, *program.outputs)) & reader.positions("input", "parameter")
    return direct[:N, :N], initial[:N, :N]


def patterns(table: Interface) -> tuple[Pattern, Pattern]:
    """Return the patterns over the whole memory of a unit: variables, derivatives of the states, time.

    Returns
    -------
    step : (N, N)
        What outputs and derivatives depend on after initialization: inputs, states and time. A state depends
        on itself.
    start : (N, N)
        What they depend on during initialization: inputs, parameters and time.
    """
    reader, program = _Reader(table), PROGRAMS[table.unit]
    moving = (*program.outputs, *program.derivatives)
    step, start = reader.run(moving), reader.run((*program.start, *moving))
    of_state = np.zeros(table.size, dtype=bool)
    of_state[table.slice("x")] = True
    time = np.arange(table.size) == table.slice("t").start
    calculated = reader.positions("output")
    calculated[table.slice("x_dot")] = True
    inputs, given = reader.positions("input"), reader.positions("input", "parameter")
    for found, known in ((step, inputs | of_state | time), (start, given | time)):
        found[~calculated] = False
        found[:, ~known] = False
    return step, start


class _Reader:
    """Reads the patterns of one unit's statements."""

    def __init__(self, table: Interface) -> None:
        self.table = table
        self.kernel = Kernel(table.robot)

    def positions(self, *kinds: str) -> npt.NDArray[np.bool_]:
        """Mark the variables of some causalities."""
        found = np.zeros(self.table.size, dtype=bool)
        found[: len(self.table)] = [v.causality in kinds for v in self.table]
        return found

    def run(self, statements: Iterable[Statement]) -> Pattern:
        """Return what each position depends on after the statements, in terms of the positions before them."""
        found = np.eye(self.table.size, dtype=bool)
        chosen = np.zeros(self.table.size, dtype=bool)  # what an earlier choice has written
        for statement in statements:
            direct, rows = self._pattern(statement), self._targets(statement)
            through = direct[rows] @ found
            if statement.when is not None:
                through[through.any(axis=1), self.table.reference[statement.when[0]]] = True
                through |= found[rows] & chosen[rows, None]
                chosen |= rows
            found[rows] = through
        return found

    def _targets(self, statement: Statement) -> npt.NDArray[np.bool_]:
        found = np.zeros(self.table.size, dtype=bool)
        if isinstance(statement, Copy):
            found[self.table.slice(statement.target)] = True
        else:
            for result in self.kernel.casadi_function(statement.function).name_out():
                found[self.table.slice(statement.group(result))] = True
        return found

    def _pattern(self, statement: Statement) -> Pattern:
        """Pattern of what one statement writes."""
        table = self.table
        found = np.zeros((table.size, table.size), dtype=bool)
        if isinstance(statement, Copy):
            found[_positions(table.slice(statement.target)), _positions(table.slice(statement.source))] = True
            return found
        function = self.kernel.casadi_function(statement.function)
        for result in function.name_out():
            rows = _positions(table.slice(statement.group(result)))
            for argument in function.name_in():
                columns = _positions(table.slice(statement.group(argument)))
                sparsity = function.jac_sparsity(function.index_out(result), function.index_in(argument))
                i, j = (np.array(index, np.intp) for index in sparsity.get_triplet())
                found[rows[i], columns[j]] = True
        return found


def _positions(where: slice) -> npt.NDArray[np.intp]:
    return np.arange(where.start, where.stop)
