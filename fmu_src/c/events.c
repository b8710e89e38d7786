#include "events.h"

#include <float.h>
#include <math.h>
#include <string.h>

void events_begin(double *m, double *above)
{
    unit.events(m);
    for (size_t i = 0; i < unit.n_events; i++)
        above[i] = m[unit.event + i] > 0.0;
}

int events_take(double *m, double *above, Happened *happened, void *context)
{
    const double *number = m + unit.event;
    int count = 0;
    for (int round = 0; round < MAXIMUM_ROUNDS; round++) {
        const int before = count;
        unit.events(m);
        for (size_t i = 0; i < unit.n_events; i++) {
            const double was = above[i];
            above[i] = number[i] > 0.0 ? (was != 0.0 ? 1.0 : 2.0) : 0.0; /* 2: has risen */
        }
        for (size_t i = 0; i < unit.n_events; i++)
            if (above[i] == 2.0) {
                unit.at_event[i](m);
                above[i] = 1.0;
                count++;
                if (happened)
                    happened(context, i);
            }
        if (count == before)
            return count;
    }
    return -1;
}

/* ---------------------------------------------------------------- the motion in an internal step */

/* Put the memory at `part` [s] after the start of the internal step, with states x, into `trial`. */
static void place(const Solver *s, double done, double part, const double *x)
{
    double *m = s->trial;
    memcpy(m, s->m, unit.n * sizeof *m);
    memcpy(m + unit.x, x, unit.n_x * sizeof *x);
    m[unit.time] = s->m[unit.time] + part;
    if (s->rates)
        for (size_t i = 0; i < unit.n; i++)
            if (s->rate[i] != 0.0)
                m[i] = s->before[i] + s->rate[i] * (done + part);
}

/* Write the level of each event at that place: above 0 if its number has changed its sign. Returns the highest. */
static double levels_at(const Solver *s, double done, double part, const double *x, double *level)
{
    double highest = -INFINITY;
    place(s, done, part, x);
    unit.events(s->trial);
    for (size_t i = 0; i < unit.n_events; i++) {
        const double number = s->trial[unit.event + i];
        level[i] = s->above[i] == 0.0 ? number : number == 0.0 ? DBL_MIN : -number;
        highest = fmax(highest, level[i]);
    }
    return highest;
}

/* The highest level after a step of the solver of that length, whose states it leaves in `x_new`. */
static double level_after(const Solver *s, double done, double part)
{
    double error;
    s->step(s->m, s->rate, part, s->tolerance, s->x_new, &error, s->ratio);
    return levels_at(s, done, part, s->x_new, s->level + (size_t)(PARTS + 1) * unit.n_events);
}

/* The cubic polynomial through states and derivatives at both ends. */
static void interpolate(const Solver *s, double h, double share, double *x)
{
    const double *x0 = s->m + unit.x, *x1 = s->end, *d0 = s->end + unit.n_x, *d1 = d0 + unit.n_x;
    const double left = 1.0 - share;
    for (size_t i = 0; i < unit.n_x; i++)
        x[i] = left * x0[i] + share * x1[i] +
               share * left * (left * (h * d0[i] - (x1[i] - x0[i])) - share * (h * d1[i] - (x1[i] - x0[i])));
}

/* Place in part k, in parts of the step, where a parabola through the levels of an event comes above 0; 0: nowhere. */
static double top_in(const Solver *s, int k)
{
    const size_t n = unit.n_events;
    double first = 0.0;
    for (int j = k > 1 ? k - 1 : k; j <= k && j < PARTS; j++) /* the middle point */
        for (size_t i = 0; i < n; i++) {
            const double *b = s->level + (size_t)j * n + i, a = *(b - n), c = *(b + n), bend = a - 2.0 * *b + c;
            const double shift = 0.5 * (a - c) / bend, top = j + shift;
            if (bend < 0.0 && top > k - 1 && top < k && *b - 0.25 * (a - c) * shift > 0.0 && !(first > 0.0 && first < top))
                first = top;
        }
    return first;
}

/* ---------------------------------------------------------------- the first change of sign */

/* Just behind the first change between `low` and `high` [s], by false position (Illinois) on steps of the solver. */
static double locate(const Solver *s, double done, double low, double high, double above)
{
    const double close = SWITCH_MARGIN(s->m[unit.time] + high);
    double below = low > 0.0 ? level_after(s, done, low) : 0.0;
    if (below > 0.0) { /* where the polynomial has none */
        high = low;
        above = below;
        low = 0.0;
    }
    if (low == 0.0)
        below = levels_at(s, done, 0.0, s->m + unit.x, s->level);
    int side = 0;
    for (int k = 1; high - low > close; k++) {
        /* each third time bisection, because a level may jump */
        const bool straight = below < 0.0 && k % 3;
        double middle = straight ? high - above * (high - low) / (above - below) : 0.5 * (low + high);
        middle = fmin(fmax(middle, low + 0.5 * close), high - 0.5 * close);
        const double here = level_after(s, done, middle);
        if (here > 0.0) {
            high = middle;
            above = here;
            below *= side > 0 ? 0.5 : 1.0;
            side = 1;
        } else {
            low = middle;
            below = here;
            above *= side < 0 ? 0.5 : 1.0;
            side = -1;
        }
    }
    level_after(s, done, high);
    return high;
}

double events_until(const Solver *s, double done, double h)
{
    const size_t n = unit.n_events, bytes = unit.n_x * sizeof(double);
    double *x1 = s->end, *d0 = x1 + unit.n_x, *d1 = d0 + unit.n_x, *x = d1 + unit.n_x;
    memcpy(x1, s->x_new, bytes);
    place(s, done, 0.0, s->m + unit.x);
    unit.derivatives(s->trial);
    memcpy(d0, s->trial + unit.x_dot, bytes);
    place(s, done, h, x1);
    unit.derivatives(s->trial);
    memcpy(d1, s->trial + unit.x_dot, bytes);

    levels_at(s, done, 0.0, s->m + unit.x, s->level);
    double at_end = 0.0;
    for (int k = 1; k <= PARTS; k++) {
        interpolate(s, h, (double)k / PARTS, x);
        at_end = levels_at(s, done, h * k / PARTS, k < PARTS ? x : x1, s->level + (size_t)k * n);
    }
    double low = 0.0;
    for (int k = 1; k <= PARTS; k++) {
        const double top = top_in(s, k) * h / PARTS, end = h * k / PARTS;
        double level;
        if (top > 0.0 && (level = level_after(s, done, top)) > 0.0)
            return locate(s, done, low, top, level);
        bool changed = false;
        for (size_t i = 0; i < n; i++)
            changed = changed || s->level[(size_t)k * n + i] > 0.0;
        if (changed && (level = k < PARTS ? level_after(s, done, end) : at_end) > 0.0)
            return locate(s, done, low, end, level);
        low = end;
    }
    memcpy(s->x_new, x1, bytes);
    return h;
}
