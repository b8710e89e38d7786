/* A unit in lanes over a communication step: samples, and internal steps between them. Each lane has its own time, so it
 * takes the steps of a run by itself. The rules are in fmu_src/c/step.c and solver.c. */

#include "control.h"

#define CLOSE 1e-9 /* part of a period within which a time is that of a sample */

/* Places are numbers of the memory. Functions that a unit does not need are NULL. */
typedef struct {
    void (*step)(real *m, const real *h, real *x_new, real *norm, real *ratio); /* see `SolverStep` of fmu_src/c/unit.h */
    void (*left)(real *m, real *left); /* time until the derivatives switch by time [s] */
    void (*update)(real *m);           /* new sampled states */
    int time, x, n_x;                  /* place of the time; of the states, and their number */
    int period, sampled, n_sampled;    /* place of the period [s]; of the sampled states, and their number */
    int fixed;                         /* internal steps of one length; 0: as many as the tolerance needs */
} LaneUnit;

/* Time until a switching by time is approached to rounding, or, from there, crossed. */
INLINE real time_ahead(const LaneUnit *u, real *m)
{
    real left;
    u->left(m, &left);
    const real close = 4e-15 * fabs(m[u->time]) + 1e-17;
    return left > 2.0 * close ? left - close : left + close;
}

/* Move the states from t, of each lane, by `duration` [s]. Returns the lanes of `alive` that reach the end. */
INLINE mask advance(const LaneUnit *u, real *m, real *h, mask alive, real t, real duration)
{
    real x_new[u->n_x], ratio[u->n_x];
    const real end = duration, size = duration / (real)(u->fixed ? u->fixed : 1);
    real done = alive != 0 ? 0.0 : end;
    m[u->time] = t;
    for (long tried = 1; any(done < end); tried++) {
        const mask active = done < end;
        const real whole = end - done;
        const real rest = u->left && !u->fixed ? fmin(whole, time_ahead(u, m)) : whole;
        const mask last = u->fixed ? (mask)(tried < u->fixed ? 0 : -1) : *h >= rest * (1.0 - 1e-10);
        const real shorter = u->fixed ? fmin((real)tried * size, end) - done : 2.0 * *h > rest ? 0.5 * rest : *h;
        const real part = last ? rest : shorter;
        const real now = active ? part : end; /* lanes that wait get any step */
        real error;
        u->step(m, &now, x_new, &error, ratio);

        const real factor = error > 0.0 ? SAFETY / sqrt(sqrt(error)) : GROW;
        const real bounded = fmax(factor, (real)SHRINK);
        const mask good = active & (u->fixed ? finite_lanes(error) : error <= 1.0), bad = active & ~good;
        for (int i = 0; i < u->n_x; i++)
            m[u->x + i] = good ? x_new[i] : m[u->x + i];
        done = good ? ((last & (rest == whole)) ? end : done + now) : done;
        m[u->time] = good ? t + done : m[u->time];
        if (!u->fixed) {
            const real grown = now * fmin((real)GROW, bounded);
            const real after_good = (last & (now < *h)) ? fmax(grown, *h) : grown;
            const real after_bad = now * (finite_lanes(error) ? fmin((real)0.9, bounded) : SHRINK);
            *h = good ? after_good : bad ? after_bad : *h;
        }
        const mask stuck = u->fixed ? bad : bad & (*h < MINIMUM_STEP);
        alive &= ~stuck;
        done = stuck ? end : done;
        if (tried == MAXIMUM_STEPS) {
            alive &= done >= end;
            break;
        }
    }
    return alive;
}

/* The sampled states of some lanes change. */
INLINE void sample(const LaneUnit *u, real *m, mask lanes, real t)
{
    real before[u->n_sampled];
    memcpy(before, m + u->sampled, sizeof before);
    m[u->time] = t;
    u->update(m);
    for (int i = 0; i < u->n_sampled; i++)
        m[u->sampled + i] = lanes ? m[u->sampled + i] : before[i];
}

/* Move a unit from t, of each lane, by `size` [s]. A sample at t belongs to it, a sample at the end does not. */
INLINE mask move(const LaneUnit *u, real *m, real *h, mask alive, real t, scalar size)
{
    if (!u->update)
        return advance(u, m, h, alive, t, (real)0.0 + size);
    const real end = t + size, period = m[u->period], close = CLOSE * period;
    for (real from = t; any(from < end);) {
        const mask going = from < end;
        const real k = ceil((from - close) / period), next = k * period;
        const mask at = going & (next <= from + close);
        if (any(at))
            sample(u, m, at, from);
        const real after = at ? (k + 1.0) * period : next;
        const real to = (going & (after < end - close)) ? after : end;
        if (u->step) {
            const real part = ((from == t) & (to == end)) ? size : to - from; /* `size` has not the rounding of the time */
            const mask others = alive & ~going;
            alive = others | advance(u, m, h, alive & going, from, part);
        }
        from = to;
    }
    return alive;
}
