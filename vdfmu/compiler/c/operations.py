"""C text of long traced functions as a table of operations and a loop that runs it.

It compiles in a hundredth of the time that the text of :func:`~vdfmu.compiler.c.functions.c_texts` takes, has 8 bytes
an operation, and takes some 4 ns an operation, ten times as long. The values are the same bits.
"""

from __future__ import annotations

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.expressions import EXPRESSIONS, c_constant, c_prototype
from vdfmu.compiler.c.functions import lookups
from vdfmu.compiler.scalar.symbol import LOOKUP

_FIELD = 19
"""Bits of the target and of each operand in a word; the operation has the seven lowest."""


def c_table(function: ca.Function) -> str:
    """Return a C11 function of a trace, with the interface of :func:`~vdfmu.compiler.c.functions.c_texts`.

    It needs ``<math.h>`` and ``<stdint.h>``.

    Raises
    ------
    KernelError
        If the trace has an operation that has no C text, or more values than a word can name.
    """
    words: list[int] = []
    cases: dict[str, int] = {}  # statement of an operation to its number in the table
    constants: dict[str, int] = {}
    statements: dict[int, str] = {}  # of each operation, except calls
    size = 1
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        statement = statements.get(operation)
        if statement is None:
            statement = _statement(function, k, operation)
            if operation != ca.OP_CALL:
                statements[operation] = statement
        read, places = function.instruction_input(k), function.instruction_output(k)
        rows = [(places[0], read)]
        if operation == ca.OP_CONST:
            rows = [(places[0], [constants.setdefault(c_constant(function.instruction_constant(k)), len(constants))])]
        elif operation == ca.OP_OUTPUT:
            rows = [(places[0], [*read, places[1]])]
        elif operation == ca.OP_CALL:  # each number that is taken of a row; what overwrites the argument comes last
            rows = sorted(
                ((place, [read[0], j]) for j, place in enumerate(places) if place >= 0), key=lambda r: r[0] == read[0]
            )
        for target, operands in rows:
            if operation != ca.OP_OUTPUT:
                size = max(size, target + 1)
            word, shift = cases.setdefault(statement, len(cases)), 7
            for number in (target, *operands):
                if number >> _FIELD:
                    raise KernelError(f"{function.name()}: more than {2**_FIELD} values at a time have no table.")
                word |= number << shift
                shift += _FIELD
            words.append(word)
    name, mask = function.name(), f"0x{2**_FIELD - 1:x}u"
    given = ", ".join(function.name_in())
    made = ", ".join(f"{result}_out" for result in function.name_out())
    listed = ",\n    ".join(", ".join(f"0x{w:x}u" for w in words[i : i + 5]) for i in range(0, len(words), 5))
    lines = "\n".join(f"        case {case}: {statement} break;" for statement, case in cases.items())
    numbers = f"static const double {name}_constants[] = {{{', '.join(constants)}}};\n\n" if constants else ""
    return f"""{lookups(function)}{numbers}/* operation, target, operands: from the lowest bit 7, and {_FIELD} each */
static const uint64_t {name}_table[] = {{
    {listed}
}};

{c_prototype(function)}
{{
    const double *const given[] = {{{given}}};
    double *const made[] = {{{made}}};
    double w[{size}];
    for (int k = 0; k < {len(words)}; k++) {{
        const uint64_t word = {name}_table[k];
        const uint32_t t = (uint32_t)(word >> 7) & {mask};
        const uint32_t a = (uint32_t)(word >> {7 + _FIELD}) & {mask}, b = (uint32_t)(word >> {7 + 2 * _FIELD});
        switch (word & 127u) {{
{lines}
        default: break;
        }}
    }}
    (void)given;
}}
"""


def _statement(function: ca.Function, k: int, operation: int) -> str:
    """Return the C statement of an instruction: ``w[t]`` of the operands ``a`` and ``b``."""
    if operation == ca.OP_CONST:
        return f"w[t] = {function.name()}_constants[a];"
    if operation == ca.OP_INPUT:
        return "w[t] = given[a][b];"
    if operation == ca.OP_OUTPUT:
        return "made[t][b] = w[a];"
    if operation == ca.OP_CALL:
        called = function.instructions_sx()[k].which_function()
        if not called.name().startswith(LOOKUP):  # the derivative of a row
            return "w[t] = 0.0;"
        return f"{{ double row[{called.numel_out(0)}]; {called.name()}(&w[a], row); w[t] = row[b]; }}"
    pattern = EXPRESSIONS.get(operation)
    if pattern is None:
        raise KernelError(f"{function.name()}: operation {operation} of the trace has no C text.")
    return f"w[t] = {pattern.format('w[a]', 'w[b]')};"
