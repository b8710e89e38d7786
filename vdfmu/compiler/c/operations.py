"""C text of long traced functions as a table of operations and a loop that runs it.

It compiles in a hundredth of the time that the text of :func:`~vdfmu.compiler.c.functions.c_texts` takes, has 8 bytes
an operation, and takes some 4 ns an operation, ten times as long. The values are the same bits.
"""

from __future__ import annotations

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.expressions import EXPRESSIONS, c_constant, c_prototype

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
    cases: dict[int, int] = {}  # operation of the trace to that of the table
    constants: dict[str, int] = {}
    size = 1
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_CONST:
            value = c_constant(function.instruction_constant(k))
            operands, target = (
                [constants.setdefault(value, len(constants))],
                function.instruction_output(k)[0],
            )
        elif operation == ca.OP_OUTPUT:
            target, index = function.instruction_output(k)
            operands = [*function.instruction_input(k), index]
        else:
            operands, target = function.instruction_input(k), function.instruction_output(k)[0]
        if operation != ca.OP_OUTPUT:
            size = max(size, target + 1)
        if max(target, *operands, 0) >> _FIELD:
            raise KernelError(f"{function.name()}: more than {2**_FIELD} values at a time have no table.")
        word = cases.setdefault(operation, len(cases)) | target << 7
        for place, operand in enumerate(operands):
            word |= operand << 7 + _FIELD * (place + 1)
        words.append(word)
    name, mask = function.name(), f"0x{2**_FIELD - 1:x}u"
    given = ", ".join(function.name_in())
    made = ", ".join(f"{result}_out" for result in function.name_out())
    listed = ",\n    ".join(", ".join(f"0x{w:x}u" for w in words[i : i + 5]) for i in range(0, len(words), 5))
    lines = "\n".join(f"        case {case}: {_case(name, operation)} break;" for operation, case in cases.items())
    numbers = f"static const double {name}_constants[] = {{{', '.join(constants)}}};\n\n" if constants else ""
    return f"""{numbers}/* operation, target, operands: from the lowest bit 7, {_FIELD}, {_FIELD} and {_FIELD} bits */
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


def _case(name: str, operation: int) -> str:
    if operation == ca.OP_CONST:
        return f"w[t] = {name}_constants[a];"
    if operation == ca.OP_INPUT:
        return "w[t] = given[a][b];"
    if operation == ca.OP_OUTPUT:
        return "made[t][b] = w[a];"
    pattern = EXPRESSIONS.get(operation)
    if pattern is None:
        raise KernelError(f"{name}: operation {operation} of the trace has no C text.")
    return f"w[t] = {pattern.format('w[a]', 'w[b]')};"
