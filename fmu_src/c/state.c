#include "state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t n_values(void)
{
    return 3 * unit.n + unit.n_events;
}

size_t core_size(void)
{
    return sizeof(Core) + n_values() * sizeof(double);
}

/* ---------------------------------------------------------------- saved states */

static State *find(const Instance *I, const void *state)
{
    State *s = I->states;
    while (s && s != state)
        s = s->next;
    return s;
}

static const State *require_state(const Instance *I, const void *state)
{
    const State *s = find(I, state);
    if (!s)
        fail(I, "expected a saved state of this instance, got %s.", state ? "another pointer" : "a null pointer");
    return s;
}

static State *new_state(Instance *I)
{
    State *s = malloc(sizeof *s);
    Core *core = malloc(core_size());
    if (!s || !core) {
        free(s);
        free(core);
        fail(I, "out of memory.");
        return NULL;
    }
    s->core = core;
    s->next = I->states;
    I->states = s;
    return s;
}

Status state_get(Instance *I, void **state)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (!state)
        return fail_null(I, "a pointer to the state");
    if (*state && !require_state(I, *state))
        return STATUS_ERROR;
    State *s = *state ? find(I, *state) : new_state(I);
    if (!s)
        return STATUS_ERROR;
    memcpy(s->core, I->core, core_size());
    *state = s;
    return STATUS_OK;
}

Status state_set(Instance *I, const void *state)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    const State *s = require_state(I, state);
    if (!s)
        return STATUS_ERROR;
    memcpy(I->core, s->core, core_size());
    return STATUS_OK;
}

Status state_free(Instance *I, void **state)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (!state)
        return fail_null(I, "a pointer to the state");
    if (!*state)
        return STATUS_OK;
    if (!require_state(I, *state))
        return STATUS_ERROR;
    State **link = &I->states;
    while (*link != *state)
        link = &(*link)->next;
    State *s = *link;
    *link = s->next;
    free(s->core);
    free(s);
    *state = NULL;
    return STATUS_OK;
}

void states_free(Instance *I)
{
    while (I->states) {
        State *s = I->states;
        I->states = s->next;
        free(s->core);
        free(s);
    }
}

/* ---------------------------------------------------------------- bytes
 *
 *     magic 8 | version 4 | kind 4 | size of all 8 | length of GUID 4 | GUID |
 *     phase 4 | flags 4 | start time, stop time, tolerance, h, last sample 5 x 8 | n 8 | values 3 n x 8 |
 *     signs of events n_events x 8 | checksum of all before 8
 *
 * Numbers are little-endian whatever the machine.
 */

#define MAGIC "vdfmu-st"
#define VERSION 2
#define HEADER 28 /* up to the GUID */
#define SUM 8
enum { FLAG_STALE = STALE_ALL, FLAG_TOLERANCE = 8, FLAG_RATES = 16, FLAG_ALL = 31 };

typedef struct {
    const unsigned char *from;
    unsigned char *to;
} Cursor;

static void put(Cursor *c, uint64_t value, unsigned n)
{
    for (unsigned i = 0; i < n; i++)
        *c->to++ = (unsigned char)(value >> 8 * i & 0xff);
}

static uint64_t take(Cursor *c, unsigned n)
{
    uint64_t value = 0;
    for (unsigned i = 0; i < n; i++)
        value |= (uint64_t)*c->from++ << 8 * i;
    return value;
}

static void put_double(Cursor *c, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put(c, bits, 8);
}

static double take_double(Cursor *c)
{
    const uint64_t bits = take(c, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint64_t checksum(const unsigned char *bytes, size_t size) /* FNV-1a */
{
    uint64_t sum = 14695981039346656037u;
    for (size_t i = 0; i < size; i++)
        sum = (sum ^ bytes[i]) * 1099511628211u;
    return sum;
}

static size_t bytes_size(void)
{
    return HEADER + strlen(unit.guid) + 4 + 4 + 5 * 8 + 8 + n_values() * 8 + SUM;
}

Status state_size(const Instance *I, const void *state, size_t *size)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (!size)
        return fail_null(I, "a pointer to the size");
    if (!require_state(I, state))
        return STATUS_ERROR;
    *size = bytes_size();
    return STATUS_OK;
}

Status state_to_bytes(const Instance *I, const void *state, unsigned char *bytes, size_t size)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    const State *s = require_state(I, state);
    if (!s)
        return STATUS_ERROR;
    if (!bytes)
        return fail_null(I, "an array of bytes");
    if (size != bytes_size())
        return fail(I, "expected room for %llu bytes, got %llu.", (unsigned long long)bytes_size(), (unsigned long long)size);
    const Core *core = s->core;
    const size_t guid = strlen(unit.guid);
    Cursor c = {.to = bytes + 8};
    memcpy(bytes, MAGIC, 8);
    put(&c, VERSION, 4);
    put(&c, I->kind, 4);
    put(&c, size, 8);
    put(&c, guid, 4);
    memcpy(c.to, unit.guid, guid);
    c.to += guid;
    put(&c, core->phase, 4);
    put(&c, core->stale | (core->tolerance_defined ? FLAG_TOLERANCE : 0u) | (core->rates ? FLAG_RATES : 0u), 4);
    put_double(&c, core->start_time);
    put_double(&c, core->stop_time);
    put_double(&c, core->tolerance);
    put_double(&c, core->h);
    put_double(&c, core->sampled);
    put(&c, unit.n, 8);
    for (size_t i = 0; i < n_values(); i++)
        put_double(&c, core->values[i]);
    put(&c, checksum(bytes, size - SUM), SUM);
    return STATUS_OK;
}

/* Whether a value can be one of the variable: what is calculated may overflow, what is set is checked. */
static bool plausible(const Variable *v, double value)
{
    if (v->role == OUTPUT || v->role == DERIVATIVE)
        return true;
    if (!(isfinite(value) && value >= v->min && value <= v->max))
        return false;
    if (v->type == BOOLEAN)
        return value == 0.0 || value == 1.0;
    return v->type == REAL || (value == floor(value) && (!v->n_choices || (value >= 0.0 && value < (double)v->n_choices)));
}

static bool plausible_core(const Core *core, Kind kind)
{
    const unsigned of_kind = kind == CO_SIMULATION ? STEP : EVENT | CONTINUOUS;
    const unsigned phases = INSTANTIATED | INITIALIZATION | TERMINATED | of_kind;
    if (!(core->phase & phases) || core->phase & (core->phase - 1))
        return false;
    if (core->stale & STALE_START ? core->phase & ~(unsigned)(INSTANTIATED | INITIALIZATION)
                                  : core->phase & INSTANTIATED)
        return false;
    if (!isfinite(core->start_time) || !(core->stop_time >= core->start_time) || !(isfinite(core->h) && core->h > 0.0))
        return false;
    if (!(core->sampled < INFINITY))
        return false;
    if (!(core->tolerance_defined ? isfinite(core->tolerance) && core->tolerance > 0.0 : core->tolerance == 0.0))
        return false;
    const double *m = core->values, *rate = m + unit.n, *held = rate + unit.n, *above = held + unit.n;
    if (core->tolerance_defined && unit.tolerance < unit.n && kind == CO_SIMULATION &&
        !plausible(&unit.variables[unit.tolerance], core->tolerance))
        return false;
    for (size_t i = 0; i < unit.n; i++) {
        const Variable *v = &unit.variables[i];
        if (!plausible(v, m[i]) || !plausible(v, held[i]))
            return false;
        if (!isfinite(rate[i]) || (rate[i] != 0.0 && !(core->rates && v->role == INPUT)))
            return false;
    }
    for (size_t i = 0; i < unit.n_events; i++)
        if (above[i] != 0.0 && above[i] != 1.0)
            return false;
    return true;
}

/* Read what follows the checksum; what it says is believed only if all of it is plausible. */
static Status read_core(const Instance *I, Cursor *c, Core *core)
{
    core->phase = (unsigned)take(c, 4);
    const unsigned flags = (unsigned)take(c, 4);
    core->stale = flags & FLAG_STALE;
    core->tolerance_defined = (flags & FLAG_TOLERANCE) != 0;
    core->rates = (flags & FLAG_RATES) != 0;
    core->start_time = take_double(c);
    core->stop_time = take_double(c);
    core->tolerance = take_double(c);
    core->h = take_double(c);
    core->sampled = take_double(c);
    const uint64_t n = take(c, 8);
    for (size_t i = 0; i < n_values(); i++)
        core->values[i] = take_double(c);
    if (flags & ~(unsigned)FLAG_ALL || n != unit.n || !plausible_core(core, I->kind))
        return fail(I, "the state is damaged: it holds values that no state of %s has.", unit.name);
    return STATUS_OK;
}

/* The bytes may be anything: only what looks like a GUID is shown. */
static Status fail_guid(const Instance *I, const char *guid, size_t n)
{
    bool shown = n > 0 && n < 100;
    for (size_t i = 0; shown && i < n; i++)
        shown = guid[i] > ' ' && guid[i] <= '~';
    return fail(I, "expected a state of %s with GUID %s, got one with %s%.*s.", unit.name, unit.guid,
                shown ? "GUID " : "another GUID", shown ? (int)n : 0, guid);
}

Status state_from_bytes(Instance *I, const unsigned char *bytes, size_t size, void **state)
{
    if (!allowed(I, ANY_PHASE))
        return STATUS_ERROR;
    if (!bytes)
        return fail_null(I, "an array of bytes");
    if (!state)
        return fail_null(I, "a pointer to the state");
    if (size < HEADER + SUM || memcmp(bytes, MAGIC, 8) != 0)
        return fail(I, "expected the bytes of a state, got %llu other bytes.", (unsigned long long)size);
    Cursor c = {.from = bytes + 8};
    const uint64_t version = take(&c, 4), kind = take(&c, 4), whole = take(&c, 8), guid = take(&c, 4);
    if (version != VERSION)
        return fail(I, "expected a state of version %u, got one of version %llu.", (unsigned)VERSION,
                    (unsigned long long)version);
    if (whole != size)
        return fail(I, "the state is damaged: expected %llu bytes, got %llu.", (unsigned long long)whole,
                    (unsigned long long)size);
    Cursor end = {.from = bytes + size - SUM};
    if (take(&end, SUM) != checksum(bytes, size - SUM))
        return fail(I, "the state is damaged: its checksum is not that of its bytes.");
    const size_t room = size - HEADER - SUM;
    if (guid > room || guid != strlen(unit.guid) || memcmp(c.from, unit.guid, (size_t)guid) != 0)
        return fail_guid(I, (const char *)c.from, guid <= room ? (size_t)guid : 0);
    if (kind != (uint64_t)I->kind)
        return fail(I, "expected a state of an instance for %s, got one of an instance for %s.",
                    I->kind == CO_SIMULATION ? "co-simulation" : "model exchange",
                    kind == MODEL_EXCHANGE ? "model exchange" : kind == CO_SIMULATION ? "co-simulation" : "something else");
    if (size != bytes_size())
        return fail(I, "the state is damaged: expected %llu bytes, got %llu.", (unsigned long long)bytes_size(),
                    (unsigned long long)size);
    c.from += guid;
    Core *core = malloc(core_size());
    if (!core)
        return fail(I, "out of memory.");
    Status status = read_core(I, &c, core);
    if (status == STATUS_OK) {
        State *s = find(I, *state); /* an importer may pass a pointer that it never set */
        if (!s)
            s = new_state(I);
        if (s) {
            memcpy(s->core, core, core_size());
            *state = s;
        } else {
            status = STATUS_ERROR;
        }
    }
    free(core);
    return status;
}
