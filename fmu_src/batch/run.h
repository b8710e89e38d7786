/* Runs of a system in lanes: the communication steps, and in them the internal steps of each lane.
 *
 * The generated part before this file has `start`, `communication_step` and MOVING (units with states).
 */
#include "shown.h"

SHOWN int lanes(void);
SHOWN int solvers(void);
SHOWN void begin_lanes(real *m, scalar *h, const bool *shown, bool *good);
SHOWN void step_lanes(real *m, real *h, const real *t, scalar size, const bool *shown, bool *good);
SHOWN int64_t run(real *m, const scalar *points, const scalar *sizes, int64_t n, const int64_t *fed, int64_t n_fed, const scalar *course,
               const bool *shown, const int64_t *recorded, int64_t n_recorded, scalar *rows, bool *good);

int lanes(void)
{
    return LANES;
}

/* Units with an internal step of their own. */
int solvers(void)
{
    return MOVING;
}

static void tell(mask alive, bool *good)
{
    for (int i = 0; i < LANES; i++)
        good[i] = alive[i] != 0;
}

/* Start all lanes at 0 s, for steps one by one: h (solvers, LANES) gets the first internal steps. */
void begin_lanes(real *m, scalar *h, const bool *shown, bool *good)
{
    for (int i = 0; i < MOVING * LANES; i++)
        h[i] = FIRST_STEP;
    tell(start(m, 0.0, shown), good);
}

/* Do a communication step over `size` [s], in each lane from its own time t (LANES), in those that are good. */
void step_lanes(real *m, real *h, const real *t, scalar size, const bool *shown, bool *good)
{
    mask alive;
    for (int i = 0; i < LANES; i++)
        alive[i] = good[i] ? -1 : 0;
    tell(communication_step(m, h, alive, shown, *t, size), good);
}

/* Keep the recorded values of all lanes; `rows` has those of a lane next to each other. Returns the lanes in which all are
 * finite. */
static mask keep(const real *m, const int64_t *recorded, int64_t n_recorded, scalar *rows, int64_t stride)
{
    mask good = finite_lanes(m[0] - m[0]);
    for (int64_t j = 0; j < n_recorded; j++) {
        const real value = m[recorded[j]];
        good &= finite_lanes(value);
        for (int i = 0; i < LANES; i++)
            rows[i * stride + j] = value[i];
    }
    return good;
}

/* Run from points[0] over n communication steps.
 *
 * m         (SIZE) memory with the parameters; on return that of the end
 * points    (n) begin of each step [s]
 * sizes     (n) length of each step [s]
 * fed       (n_fed) places of inputs from outside, `course` (n, n_fed) their values at the points
 * shown     by calls of outputs that nothing reads: whether they are recorded
 * recorded  (n_recorded) places
 * rows      (LANES, n + 1, n_recorded)
 * good      (LANES) whether the run of a lane has its end, with all its numbers finite and all requirements met
 *
 * Returns the number of steps that were done: n unless no lane is left.
 */
int64_t run(real *m, const scalar *points, const scalar *sizes, int64_t n, const int64_t *fed, int64_t n_fed, const scalar *course,
         const bool *shown, const int64_t *recorded, int64_t n_recorded, scalar *rows, bool *good)
{
    real h[MOVING + 1];
    for (int i = 0; i <= MOVING; i++)
        h[i] = FIRST_STEP;
    int64_t k = 0;
    mask alive;
    for (;; k++) {
        for (int64_t j = 0; j < n_fed; j++)
            m[fed[j]] = course[(k ? k - 1 : 0) * n_fed + j];
        if (k == 0)
            alive = start(m, points[0], shown);
        else
            alive &= communication_step(m, h, alive, shown, points[k - 1], sizes[k - 1]);
        alive &= keep(m, recorded, n_recorded, rows + k * n_recorded, (n + 1) * n_recorded);
        if (k == n || !any(alive))
            break;
    }
    tell(alive, good);
    return k;
}
