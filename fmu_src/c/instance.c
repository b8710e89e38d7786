#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "events.h"
#include "processor.h"
#include "state.h"

/* ---------------------------------------------------------------- messages */

#define TIMED (STEP | INTERMEDIATE | EVENT | CONTINUOUS)

typedef enum { LOG_EVENTS, LOG_WARNING, LOG_DISCARD, LOG_ERROR, LOG_FATAL, LOG_ALL, N_CATEGORIES } Category;

static const char *const categories[] = {
    "logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "logAll",
};

static bool is_logged(const Instance *I, Category category)
{
    return I->host.logged >> category & 1;
}

static void say(const Instance *I, Status status, Category category, const char *format, va_list arguments)
{
    if (!is_logged(I, category))
        return;
    Text t = {0};
    text_add(&t, "%s: %s", I->name, I->call);
    if (I->core && I->core->phase & TIMED)
        text_add(&t, " at t = %s s", G9(I->m[unit.time]));
    text_add(&t, " failed: ");
    text_add_list(&t, format, arguments);
    I->host.log(&I->host, I->name, status, categories[category], t.text ? t.text : "out of memory");
    text_free(&t);
}

Status fail(const Instance *I, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    say(I, STATUS_ERROR, LOG_ERROR, format, arguments);
    va_end(arguments);
    return STATUS_ERROR;
}

Status discard(const Instance *I, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    say(I, STATUS_DISCARD, LOG_DISCARD, format, arguments);
    va_end(arguments);
    return STATUS_DISCARD;
}

static void say_event(const Instance *I, const char *what, const char *name, const char *time)
{
    if (!is_logged(I, LOG_EVENTS))
        return;
    Text t = {0};
    text_add(&t, "%s: %s%s at t = %s s", I->name, what, name, time);
    I->host.log(&I->host, I->name, STATUS_OK, categories[LOG_EVENTS], t.text ? t.text : "");
    text_free(&t);
}

void log_event(const Instance *I, size_t event)
{
    say_event(I, "event ", unit.variables[unit.event + event].name, EXACT(I->m[unit.time]));
}

Status fail_null(const Instance *I, const char *what)
{
    return fail(I, "expected %s, got a null pointer.", what);
}

Status fail_problem(const Instance *I, const Variable *v, double value)
{
    Text t = {0};
    text_add_problem(&t, v, value);
    fail(I, "%s: %s.", v->name, t.text ? t.text : "out of memory");
    text_free(&t);
    return STATUS_ERROR;
}

Status refuse_phase(const Instance *I, unsigned phases)
{
    static const struct {
        unsigned phase;
        const char *when;
    } all[] = {
        {INSTANTIATED, "before enterInitializationMode"},
        {INITIALIZATION, "between enterInitializationMode and exitInitializationMode"},
        {STEP, "after exitInitializationMode and before terminate"},
        {EVENT, "in event mode"},
        {CONTINUOUS, "in continuous-time mode"},
        {TERMINATED, "after terminate"},
    };
    if (I->core->phase == INTERMEDIATE)
        return fail(I, "it is not allowed in an intermediate update: there, variables can be read and inputs set.");
    if (!(phases & ~(unsigned)(EVENT | CONTINUOUS)) && I->kind == CO_SIMULATION)
        return fail(I, "it belongs to model exchange, and this instance is one for co-simulation.");
    if (phases == STEP && I->kind == MODEL_EXCHANGE)
        return fail(I, "it belongs to co-simulation, and this instance is one for model exchange.");
    const unsigned others = I->kind == CO_SIMULATION ? EVENT | CONTINUOUS : STEP;
    Text t = {0};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        if (phases & ~others & all[i].phase)
            text_add(&t, "%s%s", t.length ? " or " : "", all[i].when);
    fail(I, "it is allowed only %s.", t.text ? t.text : "in other phases");
    text_free(&t);
    return STATUS_ERROR;
}

#define ALL_CATEGORIES ((1u << N_CATEGORIES) - 1)
#define STATUS_CATEGORIES (1u << LOG_WARNING | 1u << LOG_DISCARD | 1u << LOG_ERROR | 1u << LOG_FATAL)

unsigned logged_at_start(bool logging_on)
{
    return logging_on ? ALL_CATEGORIES : STATUS_CATEGORIES;
}

Status set_debug_logging(Instance *I, bool on, size_t n, const char *const names[])
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (n && !names)
        return fail_null(I, "an array of categories");
    unsigned named = 0;
    for (size_t k = 0; k < n; k++) {
        if (!names[k])
            return fail_null(I, "the name of a category");
        size_t i = 0;
        while (i < N_CATEGORIES && strcmp(names[k], categories[i]) != 0)
            i++;
        if (i == N_CATEGORIES)
            return fail(I, "expected categories out of logEvents, logStatusWarning, logStatusDiscard, logStatusError, "
                           "logStatusFatal, logAll, got %.100s.", names[k]);
        named |= i == LOG_ALL ? ALL_CATEGORIES : 1u << i;
    }
    if (n == 0)
        I->host.logged = logged_at_start(on);
    else
        I->host.logged = on ? I->host.logged | named : I->host.logged & ~named;
    return STATUS_OK;
}

/* ---------------------------------------------------------------- making and freeing */

static void take_start_values(Instance *I)
{
    Core *c = I->core;
    *c = (Core){.phase = INSTANTIATED, .stale = STALE_ALL, .stop_time = INFINITY, .h = FIRST_STEP, .sampled = -INFINITY};
    for (size_t i = 0; i < unit.n; i++) {
        I->m[i] = I->held[i] = unit.variables[i].start;
        I->rate[i] = 0.0;
    }
    for (size_t i = 0; i < unit.n_events; i++)
        I->above[i] = 0.0;
}

static void *room(size_t n, size_t size)
{
    return calloc(n ? n : 1, size);
}

static void list_references(Instance *I)
{
    if (I->host.arrays)
        for (size_t i = 0; i < unit.n_arrays; i++)
            I->size_at[unit.arrays[i].first] = unit.arrays[i].size;
    else
        for (size_t i = 0; i < unit.n; i++)
            I->size_at[i] = i != unit.time;
    for (size_t ref = 0; ref < unit.n; ref++) {
        if (!I->size_at[ref] || unit.variables[ref].type != REAL)
            continue;
        bool unlimited = unit.variables[ref].role == INPUT;
        for (size_t i = 0; i < I->size_at[ref]; i++)
            unlimited = unlimited && isinf(unit.variables[ref + i].min) && isinf(unit.variables[ref + i].max);
        I->quick_at[ref] = (unsigned char)((unit.variables[ref].role != DERIVATIVE ? QUICK_GET : 0) | (unlimited ? QUICK_SET : 0));
    }
}

static bool allocate(Instance *I, const char *name)
{
    const size_t n = unit.n;
    I->name = room(strlen(name) + 1, 1);
    I->core = room(1, core_size());
    I->kept = room(1, core_size());
    I->size_at = room(n, sizeof *I->size_at);
    I->quick_at = room(n, sizeof *I->quick_at);
    const size_t for_events = unit.n_events ? n + 4 * unit.n_x + (PARTS + 3) * unit.n_events : 0;
    I->before = room(2 * (n + unit.n_x) + for_events, sizeof *I->before);
    if (!(I->name && I->core && I->kept && I->size_at && I->quick_at && I->before))
        return false;
    I->d = I->before + n;
    I->x_new = I->d + n;
    I->ratio = I->x_new + unit.n_x;
    if (unit.n_events) {
        I->trial = I->ratio + unit.n_x;
        I->end = I->trial + n;
        I->level = I->end + 4 * unit.n_x;
        I->above_before = I->level + (PARTS + 2) * unit.n_events;
    }
    strcpy(I->name, name);
    I->m = I->core->values;
    I->rate = I->m + n;
    I->held = I->rate + n;
    I->above = I->held + n;
    list_references(I);
    return true;
}

Instance *instance_new(const Host *host, const char *call, const char *name, const char *guid, Kind kind)
{
    char unit_name[64] = "";
    strncat(unit_name, unit.name, sizeof unit_name - 1);
    const Instance nameless = {.host = *host, .name = unit_name, .call = call};
    if (!name || !name[0]) {
        fail(&nameless, "expected a name of the instance, got %s.", name ? "an empty one" : "a null pointer");
        return NULL;
    }
    Instance *I = room(1, sizeof *I);
    if (I) {
        I->host = *host;
        I->kind = kind;
        I->call = call;
        I->solver_step = unit.solver_step_avx2 && processor_has_avx2() ? unit.solver_step_avx2 : unit.solver_step;
    }
    if (!I || !allocate(I, name)) {
        fail(&nameless, "out of memory.");
        instance_free(I);
        return NULL;
    }
    take_start_values(I);
    if (!guid || strcmp(guid, unit.guid) != 0)
        fail(I, "expected the GUID or instantiation token %s, got %.100s.", unit.guid, guid ? guid : "a null pointer");
    else if (kind == NO_KIND)
        fail(I, "expected an instance for model exchange (0) or co-simulation (1), got another type.");
    else if (kind == MODEL_EXCHANGE && !unit.exchange)
        fail(I, "%s has no continuous states and is for co-simulation only.", unit.name);
    else
        return I;
    instance_free(I);
    return NULL;
}

void instance_free(Instance *I)
{
    if (!I || (I->core && I->core->phase == INTERMEDIATE && refuse_phase(I, ANY_PHASE) != STATUS_OK))
        return;
    states_free(I);
    free(I->name);
    free(I->core);
    free(I->kept);
    free(I->size_at);
    free(I->quick_at);
    free(I->before);
    free(I);
}

/* ---------------------------------------------------------------- calculating what is stale */

void text_add_requirements(Text *t, const double *m)
{
    if (unit.n_requirements == 0)
        return;
    double *margin = room(unit.n_requirements, sizeof *margin);
    if (!margin) {
        text_add(t, "out of memory.");
        return;
    }
    unit.margins(m, margin);
    for (size_t i = 0; i < unit.n_requirements; i++) {
        if (margin[i] >= 0.0)
            continue;
        const Requirement *r = &unit.requirements[i];
        text_add(t, "%s%s: expected %s, got ", t->length ? " " : "", unit.variables[r->positions[0]].name, r->expected);
        for (size_t k = 0; k < r->n; k++) {
            const Variable *v = &unit.variables[r->positions[k]];
            text_add(t, "%s%s = %s%s%s", k ? ", " : "", v->name, G9(m[r->positions[k]]), measure_space(v), measure_name(v));
        }
        text_add(t, ".");
    }
    free(margin);
}

double tolerance_of(const Instance *I)
{
    const double own = I->m[unit.tolerance];
    return I->core->tolerance_defined ? fmin(own, I->core->tolerance) : own;
}

static Status start(Instance *I)
{
    Text problems = {0};
    text_add_requirements(&problems, I->m);
    if (problems.length) {
        fail(I, "%s", problems.text);
        text_free(&problems);
        return STATUS_ERROR;
    }
    unit.start(I->m);
    if (unit.n_x)
        I->core->h = FIRST_STEP;
    I->core->stale = STALE_OUTPUTS | STALE_DERIVATIVES;
    return STATUS_OK;
}

Status refresh(Instance *I, unsigned what)
{
    Core *c = I->core;
    if (c->stale & STALE_START && start(I) != STATUS_OK)
        return STATUS_ERROR;
    if (c->stale & what & STALE_OUTPUTS) {
        unit.outputs(I->m);
        c->stale &= ~(unsigned)STALE_OUTPUTS;
    }
    if (c->stale & what & STALE_DERIVATIVES && unit.n_x) {
        /* Between steps of a co-simulation, inputs that were set since belong to the next step. */
        const bool between = I->kind == CO_SIMULATION && c->phase & (STEP | TERMINATED);
        double *m = between ? I->held : I->m;
        unit.derivatives(m);
        if (between)
            memcpy(I->m + unit.x_dot, m + unit.x_dot, unit.n_x * sizeof *m);
        c->stale &= ~(unsigned)STALE_DERIVATIVES;
    }
    return STATUS_OK;
}

/* ---------------------------------------------------------------- life cycle */

static Status check_experiment(const Instance *I, const Experiment *e)
{
    if (!isfinite(e->start_time))
        return fail(I, "expected a finite start time, got %s s.", EXACT(e->start_time));
    if (e->stop_time_defined && !(isfinite(e->stop_time) && e->stop_time >= e->start_time))
        return fail(I, "expected a finite stop time not before the start time %s s, got %s s.", EXACT(e->start_time),
                    EXACT(e->stop_time));
    if (!e->tolerance_defined)
        return STATUS_OK;
    if (!(isfinite(e->tolerance) && e->tolerance > 0.0))
        return fail(I, "expected a finite positive tolerance, got %s.", EXACT(e->tolerance));
    if (unit.tolerance < unit.n && I->kind == CO_SIMULATION) { /* in model exchange the solver is the importer's */
        const Variable *v = &unit.variables[unit.tolerance];
        if (!(e->tolerance >= v->min && e->tolerance <= v->max))
            return fail_problem(I, v, e->tolerance);
    }
    return STATUS_OK;
}

static void take_experiment(Instance *I, const Experiment *e)
{
    Core *c = I->core;
    c->start_time = I->m[unit.time] = e->start_time;
    c->stop_time = e->stop_time_defined ? e->stop_time : INFINITY;
    c->tolerance_defined = e->tolerance_defined;
    c->tolerance = e->tolerance_defined ? e->tolerance : 0.0;
    c->stale = STALE_ALL;
}

Status setup_experiment(Instance *I, const Experiment *e)
{
    if (!allowed(I, INSTANTIATED) || check_experiment(I, e) != STATUS_OK)
        return STATUS_ERROR;
    take_experiment(I, e);
    return STATUS_OK;
}

Status enter_initialization(Instance *I, const Experiment *e)
{
    if (!allowed(I, INSTANTIATED) || (e && check_experiment(I, e) != STATUS_OK))
        return STATUS_ERROR;
    const Core before = *I->core; /* without its values */
    const double time = I->m[unit.time];
    if (e)
        take_experiment(I, e);
    if (refresh(I, STALE_OUTPUTS) != STATUS_OK) {
        *I->core = before;
        I->m[unit.time] = time;
        return STATUS_ERROR;
    }
    I->core->phase = INITIALIZATION;
    return STATUS_OK;
}

Status exit_initialization(Instance *I)
{
    if (!allowed(I, INITIALIZATION) || refresh(I, STALE_OUTPUTS) != STATUS_OK)
        return STATUS_ERROR;
    if (unit.n_events)
        events_begin(I->m, I->above);
    memcpy(I->held, I->m, unit.n * sizeof *I->m);
    I->core->phase = I->kind == CO_SIMULATION ? STEP : EVENT;
    say_event(I, "starts", "", G6(I->m[unit.time]));
    return STATUS_OK;
}

Status refuse_configuration(const Instance *I)
{
    return fail(I, "there is nothing to configure: %s has no structural parameters.", unit.name);
}

Status terminate(Instance *I)
{
    Core *c = I->core;
    if (!allowed(I, STEP | EVENT | CONTINUOUS))
        return STATUS_ERROR;
    refresh(I, STALE_OUTPUTS | STALE_DERIVATIVES);
    c->stale = 0; /* values stay as they are */
    c->phase = TERMINATED;
    return STATUS_OK;
}

Status reset(Instance *I)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    take_start_values(I);
    return STATUS_OK;
}
