#include "exchange.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "events.h"
#include "state.h"
#include "step.h"

#define READABLE (INITIALIZATION | EVENT | CONTINUOUS | TERMINATED)

static void time_or_states_changed(Instance *I)
{
    I->core->stale |= STALE_OUTPUTS | STALE_DERIVATIVES;
}

Status enter_event_mode(Instance *I)
{
    /* FMI 2 allows it in event mode too, where nothing changes. */
    if (!allowed(I, I->host.arrays ? CONTINUOUS : EVENT | CONTINUOUS))
        return STATUS_ERROR;
    I->core->phase = EVENT;
    return STATUS_OK;
}

Status enter_continuous_time_mode(Instance *I)
{
    if (!allowed(I, EVENT))
        return STATUS_ERROR;
    I->core->phase = CONTINUOUS;
    return STATUS_OK;
}

Status check_event_iteration(const Instance *I, bool pointers_given)
{
    if (!allowed(I, EVENT))
        return STATUS_ERROR;
    return pointers_given ? STATUS_OK : fail_null(I, "a pointer for each answer");
}

Status update_discrete_states(Instance *I, bool pointers_given, double *next, bool *changed)
{
    if (check_event_iteration(I, pointers_given) != STATUS_OK)
        return STATUS_ERROR;
    *next = INFINITY;
    *changed = false;
    if (unit.n_events)
        memcpy(I->kept, I->core, core_size());
    const double time = I->m[unit.time];
    if (unit.period < unit.n) {
        const Samples at = samples_at(I, time);
        if (at.last > I->core->sampled) {
            unit.update(I->m);
            I->core->sampled = at.last;
            time_or_states_changed(I);
        }
        *next = at.next;
    }
    if (unit.n_events) {
        const int events = events_take(I->m, I->above, NULL, NULL); /* the importer finds them */
        if (events < 0) {
            memcpy(I->core, I->kept, core_size());
            return fail(I, "events do not end: there are more than %d at one time.", MAXIMUM_ROUNDS);
        }
        if (events) {
            *changed = true;
            time_or_states_changed(I);
        }
    }
    if (unit.left) {
        double left;
        I->m[unit.time] = time + 2.0 * SWITCH_MARGIN(time); /* after the switching that is now */
        unit.left(I->m, I->rate, &left);
        *next = fmin(*next, I->m[unit.time] + left);
        I->m[unit.time] = time;
    }
    if (*next > 1e299)
        *next = INFINITY;
    return STATUS_OK;
}

Status check_integrator_step(const Instance *I, bool pointers_given)
{
    if (!allowed(I, CONTINUOUS))
        return STATUS_ERROR;
    return pointers_given ? STATUS_OK : fail_null(I, "a pointer for each answer");
}

Status set_time(Instance *I, double time)
{
    if (!allowed(I, EVENT | CONTINUOUS))
        return STATUS_ERROR;
    if (!isfinite(time))
        return discard(I, "expected a finite time, got %s s.", EXACT(time));
    if (time != I->m[unit.time])
        time_or_states_changed(I);
    I->m[unit.time] = time;
    return STATUS_OK;
}

static Status check_states(const Instance *I, unsigned phases, const double values[], size_t n)
{
    if (I->kind == CO_SIMULATION)
        return refuse_phase(I, CONTINUOUS);
    if (!allowed(I, phases))
        return STATUS_ERROR;
    if (n != unit.n_x)
        return fail(I, "expected %llu values, one a state, got %llu.", (unsigned long long)unit.n_x, (unsigned long long)n);
    return values ? STATUS_OK : fail_null(I, "an array of values");
}

Status set_states(Instance *I, const double x[], size_t n)
{
    if (check_states(I, CONTINUOUS, x, n) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i])) {
            const Variable *v = &unit.variables[unit.x + i];
            return discard(I, "%s: expected a finite number, got %s%s%s.", v->name, G9(x[i]), measure_space(v), measure_name(v));
        }
    memcpy(I->m + unit.x, x, n * sizeof *x);
    time_or_states_changed(I);
    return STATUS_OK;
}

Status get_states(Instance *I, double x[], size_t n)
{
    if (check_states(I, READABLE, x, n) != STATUS_OK || refresh(I, 0) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(x, I->m + unit.x, n * sizeof *x);
    return STATUS_OK;
}

Status get_derivatives(Instance *I, double x_dot[], size_t n)
{
    if (check_states(I, READABLE, x_dot, n) != STATUS_OK || refresh(I, STALE_DERIVATIVES) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t i = 0; i < n; i++)
        if (!isfinite(I->m[unit.x_dot + i]))
            return discard(I, "%s is not finite.", unit.variables[unit.x_dot + i].name);
    memcpy(x_dot, I->m + unit.x_dot, n * sizeof *x_dot);
    return STATUS_OK;
}

Status get_nominals(Instance *I, double nominals[], size_t n)
{
    if (check_states(I, ANY_PHASE, nominals, n) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t i = 0; i < n; i++)
        nominals[i] = 1.0;
    return STATUS_OK;
}

Status get_event_indicators(Instance *I, double indicators[], size_t n)
{
    if (I->kind == CO_SIMULATION)
        return refuse_phase(I, CONTINUOUS);
    if (!allowed(I, READABLE))
        return STATUS_ERROR;
    if (n != unit.n_events)
        return fail(I, "expected %llu values, %s, got %llu.", (unsigned long long)unit.n_events,
                    unit.n_events ? "one an event indicator" : "as there are no event indicators", (unsigned long long)n);
    if (n == 0)
        return STATUS_OK;
    if (!indicators)
        return fail_null(I, "an array of values");
    if (refresh(I, 0) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(I->before, I->m, unit.n * sizeof *I->m);
    unit.events(I->before);
    for (size_t i = 0; i < n; i++) { /* 0 is not above 0: an importer that stops there must go on to the event */
        const double number = I->before[unit.event + i];
        indicators[i] = number == 0.0 ? -DBL_MIN : number;
    }
    return STATUS_OK;
}

Status get_number(const Instance *I, size_t *n, size_t value)
{
    if (I->kind == CO_SIMULATION)
        return refuse_phase(I, CONTINUOUS);
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (!n)
        return fail_null(I, "a pointer to the number");
    *n = value;
    return STATUS_OK;
}
