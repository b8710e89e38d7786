/* The module beside a system as WebAssembly: a unit over a communication step, the row of a table, elementary functions.
 * `make vendor` compiles it to module.wasm. */
#define LANES 1
#include "lanes.h"

#include "advance.h"
#include "lookup.h"

#define EXPORTED(name) __attribute__((export_name(#name)))

EXPORTED(move_unit) int move_unit(const LaneUnit *u, real *m, real *h, scalar t, scalar size);
EXPORTED(table_row) int table_row(const scalar *edges, int n, scalar x);

/* Move a unit of a system from t by `size` [s], with `h` [s] the internal step to try next, 0 at the start. Returns whether
 * it reaches the end. */
int move_unit(const LaneUnit *u, real *m, real *h, scalar t, scalar size)
{
    if (h[0][0] == 0.0)
        *h = FIRST_STEP;
    const real from = t;
    return any(move(u, m, h, from == from, from, size));
}

int table_row(const scalar *edges, int n, scalar x)
{
    return lookup_place(edges, n, x);
}

#define OF_ONE(name)                                                                                                           \
    __attribute__((export_name(#name))) scalar wasm_##name(scalar x);                                                          \
    scalar wasm_##name(scalar x)                                                                                               \
    {                                                                                                                          \
        return one_##name(x);                                                                                                  \
    }
#define OF_TWO(name)                                                                                                           \
    __attribute__((export_name(#name))) scalar wasm_##name(scalar x, scalar y);                                                \
    scalar wasm_##name(scalar x, scalar y)                                                                                     \
    {                                                                                                                          \
        return one_##name(x, y);                                                                                               \
    }

OF_ONE(sin)
OF_ONE(cos)
OF_ONE(tan)
OF_ONE(asin)
OF_ONE(acos)
OF_ONE(atan)
OF_ONE(sinh)
OF_ONE(cosh)
OF_ONE(tanh)
OF_ONE(asinh)
OF_ONE(acosh)
OF_ONE(atanh)
OF_ONE(exp)
OF_ONE(expm1)
OF_ONE(log)
OF_ONE(log1p)
OF_TWO(atan2)
OF_TWO(hypot)
OF_TWO(pow)
OF_TWO(fmod)
OF_TWO(fmin)
OF_TWO(fmax)
