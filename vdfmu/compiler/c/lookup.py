"""C text of tables in which traced functions look rows up, see :func:`vdfmu.compiler.scalar.symbol.lookup_function`."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

_SEARCH = """\
#ifndef LOOKUP_PLACE
#define LOOKUP_PLACE
#ifdef LANES /* a double is a vector: fmu_src/batch/lanes.h */
typedef scalar table_number;
#define LOOKUP_LANES LANES
#define LANE(x, i) (x)[i]
#else
typedef double table_number;
#define LOOKUP_LANES 1
#define LANE(x, i) (x)
#endif

/* the last k below m with edges[k] <= x, or 0 */
static int lookup_place(const table_number *edges, int m, table_number x)
{
    int low = 0;
    for (int high = m; high - low > 1;) {
        const int middle = (low + high) / 2;
        if (x >= edges[middle])
            low = middle;
        else
            high = middle;
    }
    return low;
}
#endif
"""


def c_lookup(function: ca.Function) -> str:
    """Return the C text of a table and the static function ``name(const double *x, double *row)`` that reads it.

    In a file that has it already it does nothing.
    """
    edges, rows = lookup_table(function)
    name, w = function.name(), function.numel_out(0)
    return f"""{_SEARCH}
#ifndef {name.upper()}
#define {name.upper()}
static const table_number {name}_edges[] = {{
{_listed(edges)}
}};
static const table_number {name}_rows[] = {{
{_listed(rows)}
}};

static void {name}(const double *x, double *row)
{{
    (void)x;
    for (int i = 0; i < LOOKUP_LANES; i++) {{
        const table_number *from = {name}_rows + {w} * lookup_place({name}_edges, {len(edges) - 1}, LANE(*x, i));
        for (int j = 0; j < {w}; j++)
            LANE(row[j], i) = from[j];
    }}
}}
#endif

"""


def lookup_table(function: ca.Function) -> tuple[list[float], list[float]]:
    """Return the edges of a table, and its rows one after the other."""
    constants = [k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CONST]
    edges, rows = (function.instruction_MX(k).to_DM().nonzeros() for k in constants)
    return edges, rows


def _listed(numbers: Iterable[float]) -> str:
    found = [repr(number) for number in numbers]
    return ",\n".join("    " + ", ".join(found[i : i + 5]) for i in range(0, len(found), 5))
