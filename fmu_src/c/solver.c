#include "events.h"

#include <math.h>
#include <string.h>

/* Inputs that change linearly in time, at `done` [s] after the start of the communication step. */
static void move_inputs(const Solver *s, double done)
{
    for (size_t i = 0; i < unit.n; i++)
        if (s->rate[i] != 0.0)
            s->m[i] = s->before[i] + s->rate[i] * done;
}

static SolverFailure failure_of(const Solver *s, double time, double error)
{
    SolverFailure failure = {.time = time, .error = error};
    for (size_t i = 0; i < unit.n_x; i++)
        if (!isfinite(s->x_new[i])) {
            failure.component = i;
            return failure;
        }
    failure.finite = true;
    for (size_t i = 1; i < unit.n_x; i++)
        if (fabs(s->ratio[i]) > fabs(s->ratio[failure.component]))
            failure.component = i;
    return failure;
}

/* Time until a switching by time is approached to rounding, or, from there, crossed. */
static double ahead(const Solver *s)
{
    double left;
    unit.left(s->m, s->rate, &left);
    const double close = SWITCH_MARGIN(s->m[unit.time]);
    return left > 2.0 * close ? left - close : left + close;
}

/* Take the states after an internal step that ends `done` [s] after the start of the communication step at `t`. */
static void take_states(const Solver *s, double t, double done)
{
    memcpy(s->m + unit.x, s->x_new, unit.n_x * sizeof *s->x_new);
    s->m[unit.time] = t + done;
    if (s->rates)
        move_inputs(s, done);
}

/* Let events happen at the end of an internal step; `cut`: one ended it. False if they do not end. */
static bool take_events(const Solver *s, bool cut, int *changes, SolverFailure *failure)
{
    *changes += cut;
    if (events_take(s->m, s->above, s->happened, s->context) >= 0 && *changes <= MAXIMUM_CHANGES)
        return true;
    *failure = (SolverFailure){.time = s->m[unit.time], .changes = *changes > MAXIMUM_CHANGES ? MAXIMUM_CHANGES : MAXIMUM_ROUNDS};
    return false;
}

/* `fixed` internal steps of one length: the same work in each communication step. */
static bool advance_fixed(const Solver *s, double t, double duration, SolverFailure *failure)
{
    const double size = duration / s->fixed;
    double done = 0.0, error;
    int changes = 0;
    for (int k = 1; k <= s->fixed && done < duration; k++) {
        const double to = k < s->fixed ? fmin(k * size, duration) : duration;
        s->step(s->m, s->rate, to - done, s->tolerance, s->x_new, &error, s->ratio);
        if (!isfinite(error)) {
            *failure = failure_of(s, t + done, error);
            return false;
        }
        const double whole = to - done, part = unit.n_events ? events_until(s, done, whole) : whole;
        take_states(s, t, done = part < whole ? done + part : to);
        if (unit.n_events && !take_events(s, part < whole, &changes, failure))
            return false;
        k -= part < whole; /* its rest follows */
        if (s->accepted) {
            duration = s->accepted(s->context, done, duration);
            if (unit.n_events && !take_events(s, false, &changes, failure)) /* of inputs that it has set */
                return false;
        }
    }
    return true;
}

bool solver_advance(const Solver *s, double t, double duration, SolverFailure *failure)
{
    if (s->fixed)
        return advance_fixed(s, t, duration, failure);
    double done = 0.0;
    int changes = 0;
    for (long tried = 1; done < duration; tried++) {
        const double whole = duration - done, rest = unit.left ? fmin(whole, ahead(s)) : whole;
        double h = *s->h;
        const bool last = h >= rest * (1.0 - 1e-10);
        if (last)
            h = rest;
        else if (2.0 * h > rest) /* two equal steps instead of a long and a short one */
            h = 0.5 * rest;

        double error;
        s->step(s->m, s->rate, h, s->tolerance, s->x_new, &error, s->ratio);
        const double factor = error > 0.0 ? SAFETY / sqrt(sqrt(error)) : GROW; /* the method has order 4 */
        if (error <= 1.0) {
            const double part = unit.n_events ? events_until(s, done, h) : h;
            done = last && rest == whole && part == h ? duration : done + part;
            take_states(s, t, done);
            if (unit.n_events && !take_events(s, part < h, &changes, failure))
                return false;
            /* A step cut short by the communication point says little about the next one: it never shrinks h. */
            const double grown = h * fmin(GROW, fmax(factor, SHRINK));
            *s->h = last && h < *s->h ? fmax(grown, *s->h) : grown;
            if (s->accepted) {
                duration = s->accepted(s->context, done, duration);
                if (unit.n_events && !take_events(s, false, &changes, failure)) /* of inputs that it has set */
                    return false;
            }
        } else {
            *s->h = h * (isfinite(error) ? fmin(0.9, fmax(factor, SHRINK)) : SHRINK);
            if (*s->h < MINIMUM_STEP) {
                *failure = failure_of(s, t + done, error);
                return false;
            }
        }
        if (tried == MAXIMUM_STEPS && done < duration) {
            *failure = (SolverFailure){.time = t + done, .last = h};
            return false;
        }
    }
    return true;
}
