/* Rows of the references: a system's memory `m` from one communication point to the next. */
#include "solvers.h"

#include <float.h>
#include <math.h>
#include <string.h>

typedef void (*Calculate)(double t);

/* Explicit steps in an interval from which the implicit method can be quicker, and its largest number of rounds. */
enum { STIFF = 4, MOST_ROUNDS_HELD = 3 };
/* Intervals until the implicit method is tried again. */
enum { WAIT = 100 };

typedef struct {
    Problem problem;
    int (*other)(double t, double to); /* moves the states instead, if there; it returns FAILED without a solution */
    int steps; /* of the last interval of the explicit method, at first 1 */
    int wait;  /* intervals until the implicit method is tried; negative: intervals in a row that it solved */
} Mover;

typedef struct {
    double *m;
    const Tables *tables;
    const size_t *shown, *fed, *x; /* places of the shown outputs, of the inputs from outside, and of the states */
    size_t size, shown_count, fed_count, x_count;
} Memory;

static void gather(const Memory *memory, const size_t *places, size_t count, double *out)
{
    for (size_t i = 0; i < count; i++) out[i] = memory->m[places[i]];
}

/* Move the states over an interval by one implicit step. Return whether this succeeded in a few rounds. */
static int in_one_step(Mover *mover, double t, double to)
{
    double error;
    Radau *radau = radau_of(&mover->problem);
    start_radau(radau);
    if (mover->wait == 0 && !renew_slopes(radau, t)) return 0;
    int rounds = try_step(radau, t, to - t, &error);
    if (rounds == 0 || rounds > MOST_ROUNDS_HELD || error > 1.0) return 0;
    take_step(radau, to - t);
    return 1;
}

/* Move the states over an interval with held inputs. Where the explicit method needs many steps only to be stable, one
 * implicit step takes less time. */
static int move(const Tables *tables, Mover *mover, double t, double to)
{
    const Problem *problem = &mover->problem;
    if (mover->other != NULL) return mover->other(t, to);
    if (mover->steps >= STIFF && mover->wait <= 0) {
        double *start = problem->room;
        memcpy(start, problem->x, problem->n * sizeof(double));
        if (in_one_step(mover, t, to)) {
            mover->wait -= mover->wait > -WAIT;
            return 1;
        }
        memcpy(problem->x, start, problem->n * sizeof(double));
        mover->wait += WAIT;
    } else {
        mover->wait -= mover->wait > 0;
    }
    mover->steps = dop853(tables, problem, t, to, (to - t) / mover->steps);
    return mover->steps;
}

/* Calculate rows of a sampled reference over intervals with held inputs, `every` intervals a row. Before the last
 * interval of a row, the memory is kept in `before` and the movers' steps in `steps`, after it the states in `after`.
 * `parts` are calculated before, between and after the movers. Return the number of intervals without a failure; set
 * `*failed` to the mover. */
SHOWN size_t sampled_rows(const Memory *memory, Mover *movers, size_t count, const Calculate *parts, const double *times,
                          const double *inputs, size_t rows, size_t every, double *before, int *steps, double *after,
                          double *out, size_t *failed)
{
    for (size_t k = 0; k < rows * every; k++) {
        size_t row = k / every;
        double t = times[k], to = times[k + 1], sum = 0.0;
        if (k % every == every - 1) {
            memcpy(before + row * memory->size, memory->m, memory->size * sizeof(double));
            for (size_t i = 0; i < count; i++) steps[row * count + i] = movers[i].steps;
        }
        for (size_t i = 0; i < memory->fed_count; i++) memory->m[memory->fed[i]] = inputs[k * memory->fed_count + i];
        parts[0](to);
        for (size_t i = 0; i < count; i++) {
            const Problem *problem = &movers[i].problem;
            int moved = move(memory->tables, movers + i, t, to);
            for (size_t j = 0; j < problem->n; j++) sum += problem->x[j] * problem->x[j];
            *failed = i;
            if (moved < 0 || !isfinite(sum)) return k;
            parts[i + 1](to);
        }
        gather(memory, memory->x, memory->x_count, after + row * memory->x_count);
        gather(memory, memory->shown, memory->shown_count, out + row * memory->shown_count);
    }
    return rows * every;
}

typedef struct {
    double t, stop, h, longest; /* end of the last step, end of the solution, next step, longest step [s] */
    int is_old;                 /* whether the Jacobian was calculated before the last step */
} Motion;

/* Integrate the next step. Return whether this succeeded. */
static int next_step(Motion *motion, Radau *radau)
{
    int converged = 1;
    while (motion->h > 10.0 * fabs(motion->t) * DBL_EPSILON) {
        double error, to = motion->t + motion->h;
        if (to + 1e-4 * motion->h >= motion->stop) to = motion->stop;
        double h = to - motion->t;
        int rounds = try_step(radau, motion->t, h, &error);
        if (rounds == 0) {
            if (!motion->is_old) motion->h = 0.5 * h;
            if (!renew_slopes(radau, motion->t)) return 0;
            motion->is_old = converged = 0;
            continue;
        }
        double factor = fmax(0.2, fmin(5.0, 0.9 * pow(fmax(error, 1e-12), -1.0 / ORDER_OF_ESTIMATE)));
        if (error > 1.0) {
            motion->h = h * factor;
            continue;
        }
        take_step(radau, h);
        motion->t = to;
        motion->is_old = 1;
        if (rounds > 4 && !renew_slopes(radau, to)) return 0;
        if (factor < 1.0 || (factor > 1.4 && converged)) motion->h = fmin(motion->longest, h * factor);
        return 1;
    }
    return 0;
}

/* Calculate rows of the continuous reference. `states` has the states before the first row, and gets those of each row.
 * Return the number of rows without a failure. */
SHOWN size_t continuous_rows(const Memory *memory, const Problem *problem, Motion *motion, Calculate outputs,
                             const double *times, size_t rows, double *states, double *out)
{
    size_t n = problem->n;
    Radau *radau = radau_of(problem);
    for (size_t row = 0; row < rows; row++) {
        while (times[row] > motion->t)
            if (!next_step(motion, radau)) return row;
        states_within(radau, motion->t, times[row], states + (row + 1) * n);
        memcpy(problem->x, states + (row + 1) * n, n * sizeof(double));
        outputs(times[row]);
        gather(memory, memory->shown, memory->shown_count, out + row * memory->shown_count);
    }
    return rows;
}

/* Return the numbers of the memory of both solvers. */
SHOWN size_t room(size_t n)
{
    return EXPLICIT_ROOM * n + radau_room(n);
}

SHOWN void begin(const Problem *problem)
{
    new_radau(problem);
    start_radau(radau_of(problem));
}
