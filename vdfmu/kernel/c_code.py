"""C text of traced functions, one C function each, from the instructions of the trace.

CasADi's own generator puts a check for null around every access, and around each function an interface that a
solver asks for; here a function is what the equations are, with plain pointers, so that a compiler sees all of
it. The arithmetic is that of the trace, operation by operation.
"""

from __future__ import annotations

import math

import casadi as ca

from vdfmu.errors import KernelError

__all__ = ["c_function", "c_prototype"]

# Operation: C expression of its operands {0} and {1}.
_EXPRESSIONS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_EXP: "exp({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_SIGN: "(double)(({0} > 0.0) - ({0} < 0.0))",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_FMIN: "fmin({0}, {1})",
    ca.OP_FMAX: "fmax({0}, {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_NOT: "(double)({0} == 0.0)",
    ca.OP_AND: "(double)({0} != 0.0 && {1} != 0.0)",
    ca.OP_OR: "(double)({0} != 0.0 || {1} != 0.0)",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}


def c_prototype(function: ca.Function) -> str:
    """Return the declaration of :func:`c_function`, without semicolon."""
    arguments = [f"const double *restrict {name}" for name in function.name_in()]
    results = [f"double *restrict {name}_out" for name in function.name_out()]
    return f"void {function.name()}({', '.join([*arguments, *results])})"


def c_function(function: ca.Function) -> str:
    """Return a C11 function of a trace.

    ``void name(const double *restrict argument, .., double *restrict result_out, ..)``, with a pointer for
    scalars too, matrices as in :class:`~vdfmu.kernel.functions.KernelFunction`. It needs ``<math.h>``.

    Raises
    ------
    KernelError
        If the trace has an operation that this module does not know.
    """
    arguments, results = function.name_in(), function.name_out()
    lines: list[str] = []
    used: set[int] = set()
    read: set[int] = set()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"{results[target[0]]}_out[{target[1]}] = w{source[0]};")
            continue
        if operation == ca.OP_CONST:
            value = _constant(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            read.add(source[0])
            value = f"{arguments[source[0]]}[{source[1]}]"
        else:
            pattern = _EXPRESSIONS.get(operation)
            if pattern is None:
                raise KernelError(f"{function.name()}: operation {operation} of the trace has no C text.")
            value = pattern.format(*[f"w{i}" for i in source])
        used.add(target[0])
        lines.append(f"w{target[0]} = {value};")
    head = [f"(void){name};" for i, name in enumerate(arguments) if i not in read]
    if used:
        head.append(f"double {', '.join(f'w{i}' for i in sorted(used))};")
    body = "\n".join(f"    {line}" for line in (*head, *lines))
    return f"{c_prototype(function)}\n{{\n{body}\n}}\n"


def _constant(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    return repr(float(value)) if math.isfinite(value) else f"({'-' if value < 0 else ''}INFINITY)"
