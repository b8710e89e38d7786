/* The functions of FMI 3.0 as a component of WebAssembly, by the draft FMI-LS-WASM (`wit`).
 *
 * Exported names, arguments and results are as the canonical ABI of the Component Model has them: a list or a string is
 * an address and a length, an option a flag and a value, a result that is more than one number lies in the memory. The
 * lists of a call lie in blocks that live until the next call; a component has one thread.
 */
#include <fmi3Functions.h>
#include <stdlib.h>
#include <string.h>

#include "values.h"

typedef struct {
    fmi3Instance fmi;
    char *name;
} Resource;

typedef struct {
    char *data;
    size_t n;
} String;

#define REFS const fmi3ValueReference *refs, size_t n

/* ---------------------------------------------------------------- memory */

typedef struct Block {
    struct Block *next;
    _Alignas(16) char data[];
} Block;

static Block *blocks;
static bool over; /* the call to which the blocks belong has ended */

static void *take(size_t size)
{
    while (over && blocks) {
        Block *next = blocks->next;
        free(blocks);
        blocks = next;
    }
    over = false;
    Block *block = malloc(sizeof *block + size);
    if (!block)
        __builtin_trap();
    block->next = blocks;
    blocks = block;
    return block->data;
}

__attribute__((export_name("cabi_realloc"))) void *cabi_realloc(void *old, size_t old_size, size_t align, size_t size)
{
    (void)align;
    void *made = take(size);
    return old ? memcpy(made, old, old_size < size ? old_size : size) : made;
}

static char *terminated(const char *data, size_t n)
{
    char *text = take(n + 1);
    memcpy(text, data, n);
    text[n] = '\0';
    return text;
}

/* ---------------------------------------------------------------- results */

/* A value, or a status above warning. */
#define RESULT(...)                 \
    static struct {                 \
        uint8_t failed;             \
        union {                     \
            uint8_t status;         \
            __VA_ARGS__ value;      \
        };                          \
    } r

static int32_t ended(fmi3Status status)
{
    over = true;
    return (int32_t)status;
}

static void *settle(fmi3Status status, uint8_t *failed, uint8_t *place)
{
    *failed = ended(status) > fmi3Warning;
    if (*failed)
        *place = (uint8_t)status;
    return failed;
}

static void *list(fmi3Status status, void *data, size_t n)
{
    RESULT(struct { void *data; size_t n; });
    r.value.data = data, r.value.n = n;
    return settle(status, &r.failed, &r.status);
}

static void *whole(fmi3Status status, size_t n)
{
    RESULT(uint64_t);
    r.value = n;
    return settle(status, &r.failed, &r.status);
}

/* ---------------------------------------------------------------- what both interfaces do */

__attribute__((import_module("fmi:fmi3/callbacks@3.0.0"), import_name("log-message")))
void import_log(const char *name, size_t n_name, int32_t status, const char *category, size_t n_category,
                const char *text, size_t n_text);

static void log_message(fmi3InstanceEnvironment name, fmi3Status status, fmi3String category, fmi3String text)
{
    import_log(name, strlen(name), (int32_t)status, category, strlen(category), text, strlen(text));
}

static Resource *resource_new(const char *name, size_t n)
{
    Resource *u = malloc(sizeof *u + n + 1);
    if (!u)
        __builtin_trap();
    u->name = (char *)(u + 1);
    memcpy(u->name, name, n);
    u->name[n] = '\0';
    return u;
}

/* Number of values of references; a wrong one is refused later. */
static size_t count(const Resource *u, REFS)
{
    size_t m = 0;
    for (size_t k = 0; k < n; k++)
        m += size_of(u->fmi, refs[k]);
    return m;
}

static void *dependencies(const Resource *u, fmi3ValueReference ref)
{
    size_t n = 0;
    fmi3Status status = fmi3GetNumberOfVariableDependencies(u->fmi, ref, &n);
    if (status > fmi3Warning)
        return list(status, NULL, 0);
    struct { uint32_t dependent, index, independent, other; uint8_t kind; } *rows = take(n * sizeof *rows);
    size_t *indices = take(2 * n * sizeof *indices);
    fmi3ValueReference *independents = take(n * sizeof *independents);
    fmi3DependencyKind *kinds = take(n * sizeof *kinds);
    status = fmi3GetVariableDependencies(u->fmi, ref, indices, independents, indices + n, kinds, n);
    for (size_t k = 0; status <= fmi3Warning && k < n; k++) {
        rows[k].dependent = ref, rows[k].independent = independents[k];
        rows[k].index = (uint32_t)indices[k], rows[k].other = (uint32_t)indices[n + k];
        rows[k].kind = 0; /* dependent; all of ours are */
    }
    return list(status, rows, n);
}

static void *saved(const Resource *u)
{
    fmi3FMUState state = NULL;
    fmi3Status status = fmi3GetFMUState(u->fmi, &state);
    size_t n = 0;
    if (status == fmi3OK)
        status = fmi3SerializedFMUStateSize(u->fmi, state, &n);
    fmi3Byte *bytes = take(n);
    if (status == fmi3OK)
        status = fmi3SerializeFMUState(u->fmi, state, bytes, n);
    if (state)
        fmi3FreeFMUState(u->fmi, &state);
    return list(status, bytes, n);
}

static int32_t restored(const Resource *u, const fmi3Byte *bytes, size_t n)
{
    fmi3FMUState state = NULL;
    fmi3Status status = fmi3DeserializeFMUState(u->fmi, bytes, n, &state);
    if (status == fmi3OK)
        status = fmi3SetFMUState(u->fmi, state);
    if (state)
        fmi3FreeFMUState(u->fmi, &state);
    return ended(status);
}

static int32_t set_logging(const Resource *u, int32_t on, const String *categories, size_t n)
{
    fmi3String *texts = take(n * sizeof *texts);
    for (size_t k = 0; k < n; k++)
        texts[k] = terminated(categories[k].data, categories[k].n);
    return ended(fmi3SetDebugLogging(u->fmi, on, n, texts));
}

/* The handle of a new instance, or nothing. */
static void *handle(Resource *u, int32_t (*new)(Resource *))
{
    static struct { uint8_t some; int32_t handle; } r;
    r.some = u->fmi != NULL;
    if (u->fmi)
        r.handle = new(u);
    else
        free(u);
    over = true;
    return &r;
}

__attribute__((export_name("fmi:fmi3/common@3.0.0#get-version"))) void *get_version(void)
{
    static String r;
    r.data = (char *)fmi3GetVersion(), r.n = strlen(r.data);
    return &r;
}

/* ---------------------------------------------------------------- kinds of methods */

#define EXPORT(name) __attribute__((export_name(INTERFACE "#" name)))
#define METHOD(name) EXPORT("[method]" RESOURCE "." name)

/* A status alone. */
#define PLAIN(name, function) \
    METHOD(name) int32_t NAME(function)(Resource *u) { return ended(fmi3##function(u->fmi)); }

#define VALUES(name, Type)                                                                                    \
    METHOD("get-" name) void *NAME(Get##Type)(Resource *u, REFS)                                              \
    {                                                                                                         \
        const size_t m = count(u, refs, n);                                                                   \
        fmi3##Type *values = take(m * sizeof *values);                                                        \
        return list(fmi3Get##Type(u->fmi, refs, n, values, m), values, m);                                    \
    }                                                                                                         \
    METHOD("set-" name) int32_t NAME(Set##Type)(Resource *u, REFS, const fmi3##Type *values, size_t n_values) \
    {                                                                                                         \
        return ended(fmi3Set##Type(u->fmi, refs, n, values, n_values));                                       \
    }

/* Types that no variable has. */
#define NO_GET(name, function, ...)                                         \
    METHOD(name) void *NAME(function)(Resource *u, REFS)                    \
    {                                                                       \
        return list(fmi3##function(u->fmi, refs, n, __VA_ARGS__), NULL, 0); \
    }
#define NO_SET(name, function, ...)                                                                \
    METHOD(name) int32_t NAME(function)(Resource *u, REFS, const void *values, size_t n_values)    \
    {                                                                                              \
        (void)values, (void)n_values;                                                              \
        return ended(fmi3##function(u->fmi, refs, n, __VA_ARGS__));                                \
    }

#define DERIVATIVE(name, function, to)                                                                                 \
    METHOD(name) void *NAME(function)(Resource *u, const fmi3ValueReference *unknowns, size_t n_unknowns,              \
                                      const fmi3ValueReference *knowns, size_t n_knowns, const double *seed,           \
                                      size_t n_seed)                                                                   \
    {                                                                                                                  \
        const size_t m = count(u, to, n_##to);                                                                         \
        double *found = take(m * sizeof *found);                                                                       \
        return list(fmi3##function(u->fmi, unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, found, m), found, m); \
    }

#define STATES(name, function)                                         \
    METHOD(name) void *NAME(function)(Resource *u)                     \
    {                                                                  \
        double *x = take(unit.n_x * sizeof *x);                        \
        return list(fmi3##function(u->fmi, x, unit.n_x), x, unit.n_x); \
    }

#define NUMBER(name, function)                       \
    METHOD(name) void *NAME(function)(Resource *u)   \
    {                                                \
        size_t n = 0;                                \
        return whole(fmi3##function(u->fmi, &n), n); \
    }

/* ---------------------------------------------------------------- co-simulation */

#define INTERFACE "fmi:fmi3/co-simulation@3.0.0"
#define RESOURCE "co-simulation-instance"
#define NAME(name) simulation_##name
#include "component.h"

EXPORT("[static]" RESOURCE ".instantiate-co-simulation")
void *instantiate_simulation(const char *name, size_t n_name, const char *token, size_t n_token, const char *path,
                             size_t n_path, int32_t visible, int32_t logging_on, int32_t event_mode, int32_t early_return,
                             REFS)
{
    (void)path, (void)n_path;
    Resource *u = resource_new(name, n_name);
    u->fmi = fmi3InstantiateCoSimulation(u->name, terminated(token, n_token), NULL, visible, logging_on, event_mode,
                                         early_return, refs, n, u->name, log_message, NULL);
    return handle(u, simulation_new);
}

METHOD("do-step") void *do_one_step(Resource *u, double time, double size, int32_t no_set_state)
{
    RESULT(struct { double last; bool event, ends, early; });
    return settle(fmi3DoStep(u->fmi, time, size, no_set_state, &r.value.event, &r.value.ends, &r.value.early,
                             &r.value.last), &r.failed, &r.status);
}

/* In the draft, but not a function of FMI 3.0. */
METHOD("set-input-derivatives")
int32_t set_input_derivatives(Resource *u, const void *requests, size_t n, const double *values, size_t n_values)
{
    (void)requests, (void)n, (void)values, (void)n_values;
    ((Instance *)u->fmi)->call = "setInputDerivatives";
    return ended((fmi3Status)fail(u->fmi, "FMI 3.0 has no derivatives of inputs."));
}

#undef INTERFACE
#undef RESOURCE
#undef NAME

/* ---------------------------------------------------------------- model exchange */

#ifdef EXCHANGE
#define INTERFACE "fmi:fmi3/model-exchange@3.0.0"
#define RESOURCE "model-exchange-instance"
#define NAME(name) exchange_##name
#include "component.h"

EXPORT("[static]" RESOURCE ".instantiate-model-exchange")
void *instantiate_exchange(const char *name, size_t n_name, const char *token, size_t n_token, const char *path,
                           size_t n_path, int32_t visible, int32_t logging_on)
{
    (void)path, (void)n_path;
    Resource *u = resource_new(name, n_name);
    u->fmi = fmi3InstantiateModelExchange(u->name, terminated(token, n_token), NULL, visible, logging_on, u->name,
                                          log_message);
    return handle(u, exchange_new);
}

PLAIN("enter-continuous-time-mode", EnterContinuousTimeMode)
STATES("get-continuous-state-derivatives", GetContinuousStateDerivatives)
STATES("get-continuous-states", GetContinuousStates)
STATES("get-nominals-of-continuous-states", GetNominalsOfContinuousStates)
NUMBER("get-number-of-event-indicators", GetNumberOfEventIndicators)
NUMBER("get-number-of-continuous-states", GetNumberOfContinuousStates)

METHOD("set-time") int32_t set_the_time(Resource *u, double time)
{
    return ended(fmi3SetTime(u->fmi, time));
}

METHOD("set-continuous-states") int32_t set_continuous(Resource *u, const double *x, size_t n)
{
    return ended(fmi3SetContinuousStates(u->fmi, x, n));
}

METHOD("get-event-indicators") void *event_indicators(Resource *u)
{
    return list(fmi3GetEventIndicators(u->fmi, NULL, 0), NULL, 0);
}

METHOD("completed-integrator-step") void *completed(Resource *u, int32_t no_set_state)
{
    RESULT(struct { bool event, ends; });
    return settle(fmi3CompletedIntegratorStep(u->fmi, no_set_state, &r.value.event, &r.value.ends), &r.failed, &r.status);
}
#endif
