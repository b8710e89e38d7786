#include "step.h"

#include <math.h>
#include <string.h>

#include "events.h"
#include "state.h"

/* ---------------------------------------------------------------- intermediate updates */

typedef struct {
    Instance *I;
    double point, size, end; /* [s] */
    bool early;
} Step;

/* Let the importer read, set inputs and shorten the step. Returns the length of the step from now on. */
static double intermediate_update(void *context, double done, double duration)
{
    Step *s = context;
    Instance *I = s->I;
    const bool at_end = done >= duration;
    const double time = I->m[unit.time] = at_end ? s->end : s->point + done;
    Update u = {.time = time, .can_return_early = I->host.early_return_allowed && !at_end, .return_time = time};
    u.set_requested = I->set_requested = unit.n_x && !at_end;

    const char *call = I->call;
    I->core->phase = INTERMEDIATE;
    I->core->stale = unit.n_x ? STALE_OUTPUTS | STALE_DERIVATIVES : 0;
    I->host.update(&I->host, &u);
    I->core->phase = STEP;
    I->call = call;

    if (!(u.return_requested && u.can_return_early))
        return duration;
    const double wanted = u.return_time > time ? u.return_time : time; /* now, if it is not a number */
    if (!(wanted < s->end))
        return duration;
    s->end = wanted;
    s->early = true;
    return wanted > time ? fmax(wanted - s->point, done) : done;
}

static void happened(void *context, size_t event)
{
    const Step *s = context;
    log_event(s->I, event);
}

/* ---------------------------------------------------------------- doStep */

static Status check_step(const Instance *I, double point, double size)
{
    const double time = I->m[unit.time];
    if (!(isfinite(size) && size > 0.0))
        return fail(I, "expected a finite positive communication step, got %s s.", EXACT(size));
    if (!(fabs(point - time) <= 1e-6 * size + 1e-12 * fabs(time)))
        return fail(I, "expected the communication point t = %s s, where the last step ended, got t = %s s.", EXACT(time),
                    EXACT(point));
    if (!(point + size > point))
        return fail(I, "expected a step that moves the time t = %s s, got one of %s s, below its rounding.", EXACT(point),
                    EXACT(size));
    if (!isfinite(point + size))
        return fail(I, "expected a step that ends at a finite time, got %s s from t = %s s.", EXACT(size), EXACT(point));
    const double stop = I->core->stop_time;
    if (point + size > stop + 1e-6 * size + 1e-12 * fabs(stop))
        return fail(I, "expected a step that ends by the stop time t = %s s, got one that ends at t = %s s.", EXACT(stop),
                    EXACT(point + size));
    if (I->core->rates)
        for (size_t i = 0; i < unit.n; i++) {
            const Variable *v = &unit.variables[i];
            const double value = I->m[i] + I->rate[i] * size;
            if (I->rate[i] != 0.0 && !(isfinite(value) && value >= v->min && value <= v->max))
                return fail_problem(I, v, value);
        }
    return STATUS_OK;
}

static void clear_rates(Instance *I)
{
    if (I->core->rates)
        memset(I->rate, 0, unit.n * sizeof *I->rate);
    I->core->rates = false;
}

static Status fail_events(const Instance *I, double time, int changes)
{
    size_t i = 0;
    while (i + 1 < unit.n_events && I->above[i] == 0.0)
        i++;
    const char *name = unit.variables[unit.event + i].name;
    return fail(I, "at t = %s s events do not end: there are more than %d %s, the last of %s. Let at_%s end the motion, such "
                   "as by a Held state for rest.", G9(time), changes,
                changes == MAXIMUM_ROUNDS ? "at one time" : "in the step", name, name);
}

/* A unit without states: its outputs follow from the inputs at the end of the step, and so do its events. */
static Status calculate(Instance *I, Step *s)
{
    if (unit.n_events) {
        memcpy(I->before, I->m, unit.n * sizeof *I->m);
        memcpy(I->above_before, I->above, unit.n_events * sizeof *I->above);
    }
    if (I->core->rates)
        for (size_t i = 0; i < unit.n; i++)
            I->m[i] += I->rate[i] * s->size;
    I->m[unit.time] = s->end;
    if (unit.n_events && events_take(I->m, I->above, happened, s) < 0) {
        memcpy(I->m, I->before, unit.n * sizeof *I->m);
        fail_events(I, s->end, MAXIMUM_ROUNDS);
        memcpy(I->above, I->above_before, unit.n_events * sizeof *I->above);
        return STATUS_ERROR;
    }
    unit.outputs(I->m);
    if (I->host.update)
        intermediate_update(s, s->size, s->size);
    I->core->stale = 0;
    return STATUS_OK;
}

#define ADVICE "Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance."

/* The number that the kind of the solver fixes; 0: the tolerance decides. */
static int fixed_steps(const Instance *I)
{
    return (int)I->m[unit.solver];
}

static Status fail_solver(const Instance *I, const SolverFailure *f, double size)
{
    if (f->changes)
        return fail_events(I, f->time, f->changes);
    if (f->last > 0.0)
        return fail(I, "at t = %s s the communication step of %s s is not done after %d internal steps, the last of %s s. Take "
                       "shorter communication steps. " ADVICE,
                    G9(f->time), G6(size), MAXIMUM_STEPS, number((char[NUMBER_SIZE]){0}, 3, f->last));
    const char *name = unit.variables[unit.x + f->component].name;
    Text t = {0};
    if (f->finite)
        text_add(&t, "the local error of state %s is %s times the tolerance %s", name, number((char[NUMBER_SIZE]){0}, 3, f->error),
                 number((char[NUMBER_SIZE]){0}, 3, tolerance_of(I)));
    else
        text_add(&t, "state %s is not finite", name);
    if (fixed_steps(I))
        fail(I, "at t = %s s %s, and the number of internal steps is fixed, %d. Take shorter communication steps, or "
                "solver adaptive.", G9(f->time), t.text ? t.text : name, fixed_steps(I));
    else
        fail(I, "at t = %s s %s, and the internal step reached its minimum %s s. " ADVICE, G9(f->time), t.text ? t.text : name,
             G6(MINIMUM_STEP));
    text_free(&t);
    return STATUS_ERROR;
}

static Status integrate(Instance *I, Step *s)
{
    Core *c = I->core;
    const size_t bytes = unit.n * sizeof *I->m;
    const double h = c->h;
    const unsigned stale = c->stale;
    memcpy(I->before, I->m, bytes);
    I->m[unit.time] = s->point;
    const Solver solver = {
        .step = I->solver_step,
        .m = I->m, .before = I->before, .rate = I->rate, .rates = c->rates, .h = &c->h, .tolerance = tolerance_of(I),
        .fixed = fixed_steps(I),
        .x_new = I->x_new, .ratio = I->ratio, .accepted = I->host.update ? intermediate_update : NULL,
        .happened = happened, .context = s,
        .above = I->above, .trial = I->trial, .end = I->end, .level = I->level,
    };
    SolverFailure failure = {.time = s->point, .changes = MAXIMUM_ROUNDS};
    if (unit.n_events)
        memcpy(I->above_before, I->above, unit.n_events * sizeof *I->above);
    if ((unit.n_events && events_take(I->m, I->above, happened, s) < 0) || /* of inputs that have jumped */
        !solver_advance(&solver, s->point, s->size, &failure)) {
        memcpy(I->m, I->before, bytes);
        c->h = h;
        c->stale = stale;
        fail_solver(I, &failure, s->size);
        if (unit.n_events)
            memcpy(I->above, I->above_before, unit.n_events * sizeof *I->above);
        return STATUS_ERROR;
    }
    I->m[unit.time] = s->end;
    unit.outputs(I->m);
    c->stale = STALE_DERIVATIVES;
    memcpy(I->held, I->m, bytes);
    return STATUS_OK;
}

static Status step_to_end(Instance *I, Step *s)
{
    return unit.n_x ? integrate(I, s) : calculate(I, s);
}

#define CLOSE 1e-9 /* part of a period within which a time is that of a sample */

Samples samples_at(const Instance *I, double time)
{
    const double period = I->m[unit.period], start = I->core->start_time, close = CLOSE * period;
    const double k = ceil((time - start - close) / period), sample = start + k * period;
    if (sample <= time + close)
        return (Samples){sample, start + (k + 1.0) * period};
    return (Samples){start + (k - 1.0) * period, sample};
}

/* Sampled states change at the samples from the start of the step on, that at its end excluded: those see the inputs of
 * the next step. */
static Status step_by_samples(Instance *I, Step *s)
{
    const double close = CLOSE * I->m[unit.period], point = s->point, size = s->size, end = s->end;
    memcpy(I->kept, I->core, core_size());
    for (double from = s->point; from < end;) {
        const Samples at = samples_at(I, from);
        if (at.last >= from - close) {
            I->m[unit.time] = from;
            unit.update(I->m);
        }
        const double to = at.next < end - close ? at.next : end;
        const bool whole = from == point && to == end; /* of which to - from has the rounding of the time */
        *s = (Step){.I = I, .point = from, .size = whole ? size : to - from, .end = to};
        if (step_to_end(I, s) != STATUS_OK) {
            memcpy(I->core, I->kept, core_size());
            return STATUS_ERROR;
        }
        if (s->early)
            break;
        from = to;
    }
    return STATUS_OK;
}

#ifdef __GNUC__
__attribute__((noinline)) /* else its sums may come before the processor is told how to round them */
#endif
Status do_step(Instance *I, double point, double size, bool *early)
{
    if (!allowed(I, STEP) || check_step(I, point, size) != STATUS_OK)
        return STATUS_ERROR;
    Step s = {.I = I, .point = point, .size = size, .end = point + size};
    const Status status = unit.period < unit.n ? step_by_samples(I, &s) : step_to_end(I, &s);
    if (status == STATUS_OK)
        clear_rates(I);
    if (early)
        *early = s.early && status == STATUS_OK;
    return status;
}

/* ---------------------------------------------------------------- rates */

Status set_input_rates(Instance *I, const Reference refs[], size_t n, const int order[], const double value[])
{
    if (I->kind == MODEL_EXCHANGE)
        return refuse_phase(I, STEP);
    if (!allowed(I, INSTANTIATED | INITIALIZATION | STEP))
        return STATUS_ERROR;
    if (n && !(refs && order && value))
        return fail_null(I, !refs ? "an array of value references" : !order ? "an array of orders" : "an array of values");
    for (size_t k = 0; k < n; k++) {
        if (!size_of(I, refs[k]))
            return fail_reference(I, refs[k]);
        const Variable *v = &unit.variables[refs[k]];
        if (v->role != INPUT)
            return fail(I, "expected inputs, got %s.", v->name);
        if (order[k] != 1)
            return fail(I, "%s: expected a derivative of order 1, got one of order %d.", v->name, order[k]);
        if (!isfinite(value[k]))
            return fail(I, "%s: expected a finite derivative, got %s.", v->name, G9(value[k]));
    }
    for (size_t k = 0; k < n; k++) {
        I->rate[refs[k]] = value[k];
        I->core->rates = true;
    }
    return STATUS_OK;
}

Status get_output_rates(Instance *I)
{
    return fail(I, "derivatives of the outputs are not offered: the model description says that their order is at most 0.");
}
