"""When traced equations switch by time: the time that is left until the next choice on it changes."""

from __future__ import annotations

import casadi as ca

from vdfmu.compiler.functions.derivatives import rebuilt

NEVER = 1e300
"""Time that is left [s] where nothing will switch."""
_JUMPS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)
_BENDS = (ca.OP_FMIN, ca.OP_FMAX)
_SIGNS = {ca.OP_SIGN: 0, ca.OP_FABS: 0, ca.OP_COPYSIGN: 1}
"""Operation to which of what it reads changes it at 0."""
_WHOLE = (ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD)


def time_left(function: ca.Function, inputs: dict[str, ca.SX], changing: dict[str, ca.SX]) -> ca.SX | None:
    """Return the time [s] until a choice on the time changes, where all goes on as it changes now.

    It is exact for conditions that are linear in time; what else they depend on is followed along its tangent.

    Parameters
    ----------
    function : traced function of SX, with the time ``t``
    inputs : its arguments
    changing : argument to its derivative by time; others are constant

    Returns
    -------
    casadi.SX or None
        None if nothing switches by time.

    Raises
    ------
    ValueError
        For a jump at a condition that is not linear in time, or if a table is read.
    """
    t = inputs["t"]
    operations = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not operations & {*_JUMPS, *_BENDS, *_SIGNS, *_WHOLE, ca.OP_CALL}:
        return None
    if ca.OP_CALL in operations:
        raise ValueError("it reads a table by lookup, and the time, so it is not known when it switches")
    levels: list[tuple[ca.SX, bool]] = []

    def choice(operation: int, read: list[ca.SX]) -> None:
        whole = operation in _WHOLE
        if operation in (*_JUMPS, *_BENDS):
            level = read[0] - read[1]
        elif operation in _SIGNS:
            level = read[_SIGNS[operation]]
        elif whole:
            level = read[0] / read[1] if operation == ca.OP_FMOD else read[0]
        else:
            return
        if not ca.depends_on(level, t):
            return
        curve = ca.sparsify(ca.jacobian(ca.jacobian(level, t), t))
        if curve.nnz() == 0:
            levels.append((level, whole))
        elif operation not in (*_BENDS, ca.OP_FABS):
            raise ValueError("a condition is not linear in time, so it is not known when it switches")

    rebuilt(function, list(inputs.values()), choice)
    if not levels:
        return None
    found = ca.vertcat(*[level for level, _ in levels])
    known = {"t": ca.SX(1.0), **changing}
    rates = ca.jtimes(found, ca.vertcat(*[inputs[key] for key in known]), ca.vertcat(*known.values()))
    left = ca.SX(NEVER)
    for i, (level, whole) in enumerate(levels):
        rate = rates[i]
        if whole:
            up, down = (ca.floor(level) + 1.0 - level) / rate, (ca.ceil(level) - 1.0 - level) / rate
            time = ca.if_else(rate > 0.0, up, ca.if_else(rate < 0.0, down, NEVER))
        else:
            time = ca.if_else(level * rate < 0.0, -level / rate, NEVER)
        left = ca.fmin(left, time)
    return left
