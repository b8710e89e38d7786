"""C expressions of the operations of a trace, numbers and prototypes of functions as C text."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import casadi as ca

from vdfmu.compiler.functions.derivatives import derivative_names

EXPRESSIONS = {
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
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_ASINH: "asinh({0})",
    ca.OP_ACOSH: "acosh({0})",
    ca.OP_ATANH: "atanh({0})",
    ca.OP_HYPOT: "hypot({0}, {1})",
    ca.OP_EXP: "exp({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_FMOD: "fmod({0}, {1})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_SIGN: "({0} > 0.0 ? 1.0 : 0.0) - ({0} < 0.0 ? 1.0 : 0.0)",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_FMIN: "fmin({0}, {1})",
    ca.OP_FMAX: "fmax({0}, {1})",
    ca.OP_LT: "{0} < {1} ? 1.0 : 0.0",
    ca.OP_LE: "{0} <= {1} ? 1.0 : 0.0",
    ca.OP_EQ: "{0} == {1} ? 1.0 : 0.0",
    ca.OP_NE: "{0} != {1} ? 1.0 : 0.0",
    ca.OP_NOT: "{0} == 0.0 ? 1.0 : 0.0",
    ca.OP_AND: "(({0} != 0.0) & ({1} != 0.0)) ? 1.0 : 0.0",
    ca.OP_OR: "(({0} != 0.0) | ({1} != 0.0)) ? 1.0 : 0.0",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}
"""Operation: C expression of its operands {0} and {1}, which may be vectors too (``fmu_src/batch/lanes.h``)."""
CALLED = frozenset(re.findall(r"\b(\w+)\(", " ".join(EXPRESSIONS.values())))
"""Functions of math.h that they call."""


@lru_cache
def slopes(operation: int) -> tuple[str, ...]:
    """Return the derivatives of an operation, one by each operand, as C expressions of its operands."""
    pattern = EXPRESSIONS[operation]
    operands = [ca.SX.sym(name) for name in ("a", "b")[: 2 if "{1}" in pattern else 1]]
    made = (ca.SX.unary if len(operands) == 1 else ca.SX.binary)(operation, *operands)
    function = ca.Function("slopes", operands, [ca.densify(ca.jacobian(made, ca.vertcat(*operands)))])
    texts: dict[int, str] = {}
    found = [""] * len(operands)
    for k in range(function.n_instructions()):
        code, read, place = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            found[place[1]] = texts[read[0]]
        elif code == ca.OP_INPUT:
            texts[place[0]] = f"{{{read[0]}}}"
        elif code == ca.OP_CONST:
            texts[place[0]] = c_constant(function.instruction_constant(k))
        else:
            texts[place[0]] = f"({EXPRESSIONS[code].format(*(texts[i] for i in read))})"
    return tuple(found)


def c_prototype(function: ca.Function, ending: str = "") -> str:
    """Return the declaration of :func:`~vdfmu.compiler.c.functions.c_texts`, or of a derivative, without semicolon."""
    given, made = function.name_in(), function.name_out()
    if ending:
        given, made = derivative_names(function, ending)
        ending = f"_{ending}"
    arguments = [f"const double *restrict {name}" for name in given]
    results = [f"double *restrict {name}_out" for name in made]
    return f"void {function.name()}{ending}({', '.join([*arguments, *results])})"


def c_constant(value: float) -> str:
    """Return a number as C text."""
    if math.isnan(value):
        return "NAN"
    return repr(float(value)) if math.isfinite(value) else f"({'-' if value < 0 else ''}INFINITY)"
