/* The explicit method of order 8 by Dormand and Prince, between two communication points.
 *
 * Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 1993, section II.10. Step control and error norm
 * are those of `dop853` in `scipy.integrate.ode`: safety 0.9, factors 0.3 and 6, beta 0. `compiled.py` has the
 * coefficients from scipy. */
#include "solvers.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { DOP_STAGES = 12, ROW = 16, MOST_STEPS = 100000 };

/* Error of a step over the tolerance, a root mean square over the states. */
static double error_of(const Tables *tables, const Problem *problem, const double *x, const double *moved,
                       const double *k, size_t n, double h)
{
    double fifth = 0.0, third = 0.0;
    for (size_t i = 0; i < n; i++) {
        double e3 = 0.0, e5 = 0.0;
        for (size_t s = 0; s < DOP_STAGES; s++) {
            e3 += tables->E3[s] * k[s * n + i];
            e5 += tables->E5[s] * k[s * n + i];
        }
        double size = fmax(fabs(x[i]), fabs(moved[i]));
        double scale = problem->absolute + problem->relative * size;
        fifth += e5 / scale * (e5 / scale);
        third += e3 / scale * (e3 / scale);
    }
    double both = fifth + 0.01 * third;
    return both > 0.0 || isnan(both) ? h * fifth / sqrt((double)n * both) : 0.0;
}

/* Set `x` to `start` plus `h` times the sum of the stages `k`, each times its weight. */
static void combine(double *x, const double *start, const double *weights, const double *k, size_t stages, size_t n,
                    double h)
{
    for (size_t i = 0; i < n; i++) x[i] = 0.0;
    for (size_t s = 0; s < stages; s++) {
        if (weights[s] == 0.0) continue;
        for (size_t i = 0; i < n; i++) x[i] += weights[s] * k[s * n + i];
    }
    for (size_t i = 0; i < n; i++) x[i] = start[i] + h * x[i];
}

/* Move the states `x` from `t` to `to`, at first by a step `h`. Return the number of accepted steps, or FAILED
 * without a finite solution. */
int dop853(const Tables *tables, const Problem *problem, double t, double to, double h)
{
    size_t n = problem->n;
    double *x = problem->x;
    double *k = problem->room, *start = k + DOP_STAGES * n, *moved = start + n;
    size_t bytes = n * sizeof(double);
    int accepted = 0, rejected = 0;
    memcpy(start, x, bytes);
    problem->rate(t);
    memcpy(k, problem->x_dot, bytes);
    for (int tried = 0; tried < MOST_STEPS; tried++) {
        if (!(0.1 * h > fabs(t) * DBL_EPSILON)) return FAILED;
        int last = t + 1.01 * h - to > 0.0;
        if (last) h = to - t;
        for (size_t s = 1; s < DOP_STAGES; s++) {
            combine(x, start, tables->A + ROW * s, k, s, n, h);
            problem->rate(t + tables->C[s] * h);
            memcpy(k + s * n, problem->x_dot, bytes);
        }
        combine(moved, start, tables->B, k, DOP_STAGES, n, h);
        double error = error_of(tables, problem, start, moved, k, n, h);
        if (!isfinite(error)) return FAILED;
        double factor = sqrt(sqrt(sqrt(error))) / 0.9;
        if (error <= 1.0) {
            accepted++;
            memcpy(start, moved, bytes);
            memcpy(x, moved, bytes);
            if (last) return accepted;
            t += h;
            problem->rate(t);
            memcpy(k, problem->x_dot, bytes);
            double next = fmin(h / fmax(1.0 / 6.0, fmin(1.0 / 0.3, factor)), to - t);
            h = rejected ? fmin(next, h) : next;
            rejected = 0;
        } else {
            h /= fmin(1.0 / 0.3, factor);
            rejected = 1;
        }
    }
    return FAILED;
}
