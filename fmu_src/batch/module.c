/* The module beside a system as WebAssembly: a unit over a communication step, the row of a table, functions of the C
 * library. `make vendor` compiles it to module.wasm. */
#define LANES 1
#include "lanes.h"

#include "advance.h"
#include "lookup.h"
#include "shown.h"

SHOWN int move_unit(const LaneUnit *u, real *m, real *h, scalar t, scalar size);
SHOWN int table_row(const scalar *edges, int n, scalar x);

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
