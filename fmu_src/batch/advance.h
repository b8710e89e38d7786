/* Control of the internal step in lanes: what `solver_advance` of fmu_src/c/solver.c does, with a step of its own in each
 * lane, so that each takes the steps of a run by itself. */

#include "control.h"

/* A step over h [s] from the memory; see `SolverStep` of fmu_src/c/unit.h. */
typedef void LaneStep(real *m, const real *h, real *x_new, real *norm, real *ratio);

/* Move n_x states at x from t, of each lane, by `duration` [s], with the time at m[time]. Returns the lanes of `alive` that reach the end. */
INLINE mask advance(LaneStep *step, real *m, size_t time, size_t x, size_t n_x, real *h, mask alive, real t, scalar duration)
{
    real x_new[MOST_STATES], ratio[MOST_STATES];
    const real end = duration;
    real done = alive != 0 ? 0.0 : end;
    m[time] = t;
    for (long tried = 1; any(done < duration); tried++) {
        const mask active = done < duration;
        const real rest = duration - done;
        const mask last = *h >= rest * (1.0 - 1e-10);
        const real part = last ? rest : 2.0 * *h > rest ? 0.5 * rest : *h;
        const real now = active ? part : end; /* those that wait get any step */
        real error;
        step(m, &now, x_new, &error, ratio);

        const real factor = error > 0.0 ? SAFETY / sqrt(sqrt(error)) : GROW;
        const real bounded = fmax(factor, (real)SHRINK);
        const mask good = active & (error <= 1.0), bad = active & ~good;
        for (size_t i = 0; i < n_x; i++)
            m[x + i] = good ? x_new[i] : m[x + i];
        const real grown = now * fmin((real)GROW, bounded);
        const real after_good = (last & (now < *h)) ? fmax(grown, *h) : grown;
        const real after_bad = now * (finite_lanes(error) ? fmin((real)0.9, bounded) : SHRINK);
        done = good ? (last ? end : done + now) : done;
        *h = good ? after_good : bad ? after_bad : *h;
        m[time] = good ? t + done : m[time];

        const mask stuck = bad & (*h < MINIMUM_STEP);
        alive &= ~stuck;
        done = stuck ? end : done;
        if (tried == MAXIMUM_STEPS) {
            alive &= done >= duration;
            break;
        }
    }
    return alive;
}
