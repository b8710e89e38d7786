/* Sequences of FMI 2.0 calls, right and wrong, read from bytes: several instances, several saved states of each.
 *
 * A call that fails must leave the instance as it was, to the bit; all else is left to the sanitizers: no wrong access, no
 * undefined behaviour, no leak. The target of libFuzzer, or with MAIN a program that makes its own inputs:
 *
 *     fuzz INPUTS [SEED]
 */
#include <fmi2Functions.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h" /* of the unit: its tables, and the time of an instance */

#define N_INSTANCES 3
#define N_STATES 4
#define ROOM 512

typedef struct {
    fmi2Component c;
    fmi2FMUstate states[N_STATES];
} Slot;

typedef struct {
    const uint8_t *bytes;
    size_t left;
} Source;

static Slot slots[N_INSTANCES];

static unsigned take(Source *s, unsigned n) /* a number below n */
{
    if (!s->left)
        return 0;
    s->left--;
    return *s->bytes++ % n;
}

static void require(int holds, const char *what)
{
    if (!holds) {
        fprintf(stderr, "fuzz: %s\n", what);
        abort();
    }
}

static void receive(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String text, ...)
{
    (void)environment, (void)status;
    require(name && category && text && text[0], "an empty message");
    for (const char *p = text; *p; p++) /* "%%" alone: nothing that printf would read an argument for */
        if (*p == '%')
            require(*++p == '%', "a message that printf would misread");
}

/* ---------------------------------------------------------------- arguments */

static double any_number(Source *s)
{
    static const double special[] = {0.0, -0.0, 1.0, -1.0, NAN, INFINITY, -INFINITY, 1e300, -1e300, 5e-324, 1e-12, 0.1, 1e10};
    const unsigned k = take(s, 24);
    if (k < sizeof special / sizeof *special)
        return special[k];
    return ((double)take(s, 256) - 128.0) / 64.0;
}

/* A value for a variable: for a parameter mostly one near its start, as an absurd arm would only keep the solver busy. */
static double value_of(Source *s, fmi2ValueReference ref)
{
    if (ref >= unit.n || unit.variables[ref].role == INPUT)
        return any_number(s);
    static const double factor[] = {1.0, 1.0, 1.01, 0.99, 2.0, 0.5, -1.0, 0.0};
    const unsigned k = take(s, 10);
    if (ref == unit.tolerance)
        return k < 8 ? 1e-4 : any_number(s);
    return k < 8 ? unit.variables[ref].start * factor[k] : k == 8 ? NAN : INFINITY;
}

static fmi2ValueReference reference(Source *s)
{
    const unsigned k = take(s, 32);
    if (k == 0)
        return (fmi2ValueReference)unit.n - 1 + take(s, 3);
    if (k == 1)
        return 0xffffffffu - take(s, 2);
    return (fmi2ValueReference)((take(s, 256) + 256 * take(s, 2)) % (unit.n - 1));
}

static size_t references(Source *s, fmi2ValueReference refs[], fmi2Real values[])
{
    const size_t n = take(s, 6);
    const fmi2ValueReference first = reference(s);
    const int scattered = take(s, 3) == 0;
    for (size_t k = 0; k < n; k++) {
        refs[k] = scattered ? reference(s) : first + (fmi2ValueReference)k;
        values[k] = value_of(s, refs[k]);
    }
    return n;
}

static fmi2FMUstate any_state(Source *s, const Slot *own)
{
    const unsigned k = take(s, 16);
    if (k == 0)
        return NULL;
    if (k == 1)
        return &slots;
    const Slot *slot = k == 2 ? &slots[take(s, N_INSTANCES)] : own; /* another's, or its own */
    return slot->states[take(s, N_STATES)];
}

/* ---------------------------------------------------------------- calls */

static fmi2Component make(Source *s)
{
    static const fmi2CallbackFunctions callbacks = {receive, calloc, free, NULL, NULL};
    const fmi2Type kind = take(s, 3) == 0 ? fmi2ModelExchange : fmi2CoSimulation;
    const char *guid = take(s, 16) ? unit.guid : "{%s}";
    const char *name = take(s, 16) ? "a 100% unit" : "";
    return fmi2Instantiate(name, kind, guid, NULL, &callbacks, 0, (fmi2Boolean)take(s, 2));
}

static fmi2Status initialize(Source *s, fmi2Component c)
{
    fmi2Status status = fmi2SetupExperiment(c, (fmi2Boolean)(take(s, 4) == 0), 1e-4, 0.0, 0, 0.0);
    if (status == fmi2OK)
        status = fmi2EnterInitializationMode(c);
    if (status == fmi2OK && take(s, 4))
        status = fmi2ExitInitializationMode(c);
    if (status == fmi2OK && ((const Instance *)c)->kind == MODEL_EXCHANGE && take(s, 2))
        status = fmi2EnterContinuousTimeMode(c);
    return status;
}

static fmi2Status step(Source *s, fmi2Component c)
{
    static const double size[] = {1e-4, 1e-5, 1e-6, 1e-9, 0.0, -1e-4, NAN, INFINITY};
    const double now = ((const Instance *)c)->m[unit.time];
    const double point = take(s, 8) ? now : any_number(s);
    return fmi2DoStep(c, point, size[take(s, 12) % 8], (fmi2Boolean)take(s, 2));
}

static fmi2Status bytes(Source *s, Slot *slot)
{
    size_t size = 0;
    const fmi2FMUstate state = any_state(s, slot);
    fmi2Status status = fmi2SerializedFMUstateSize(slot->c, state, &size);
    if (status != fmi2OK)
        return status;
    require(size < 100000, "a large state");
    char *room = malloc(size);
    status = fmi2SerializeFMUstate(slot->c, state, room, size - (take(s, 16) == 0));
    if (status == fmi2OK) {
        if (take(s, 2)) /* damaged, and the checksum with it */
            room[(take(s, 256) * 256 + take(s, 256)) % size] ^= (char)(1 + take(s, 255));
        Slot *to = &slots[take(s, N_INSTANCES)];
        fmi2FMUstate *place = &to->states[take(s, N_STATES)];
        const size_t n = take(s, 16) ? size : take(s, 256) % size;
        status = to->c ? fmi2DeSerializeFMUstate(to->c, room, n, place) : fmi2Error;
        if (to != slot)
            status = fmi2OK; /* said of the other */
    }
    free(room);
    return status;
}

static fmi2Status call(Source *s, Slot *slot)
{
    const fmi2Component c = slot->c;
    fmi2ValueReference refs[ROOM] = {0}, others[ROOM] = {0};
    fmi2Real values[ROOM] = {0}, results[ROOM];
    fmi2Integer integers[ROOM] = {0};
    fmi2String string = NULL;
    fmi2EventInfo info;
    fmi2Boolean flag, other;
    size_t n, m;
    fmi2FMUstate state;
    switch (take(s, 40)) {
    case 0: return fmi2Reset(c);
    case 1: return fmi2Terminate(c);
    case 2: return fmi2SetupExperiment(c, (fmi2Boolean)take(s, 2), any_number(s) * 1e-4, any_number(s), (fmi2Boolean)take(s, 2), any_number(s));
    case 3: return fmi2EnterInitializationMode(c);
    case 4: return fmi2ExitInitializationMode(c);
    case 5: case 6: return initialize(s, c);
    case 7: case 8: case 9: case 10: return step(s, c);
    case 11: case 12: case 13: n = references(s, refs, values); return fmi2SetReal(c, refs, n, take(s, 32) ? values : NULL);
    case 14: case 15: n = references(s, refs, values); return fmi2GetReal(c, take(s, 32) ? refs : NULL, n, results);
    case 16: n = references(s, refs, values); integers[0] = (int)take(s, 4) - 1; return fmi2SetInteger(c, refs, n, integers);
    case 17: n = references(s, refs, values); return fmi2GetInteger(c, refs, n, integers);
    case 18: n = references(s, refs, values); integers[0] = (int)take(s, 4) - 1; return fmi2SetBoolean(c, refs, n, integers);
    case 19: n = references(s, refs, values); return fmi2GetBoolean(c, refs, n, integers);
    case 20: n = references(s, refs, values); return fmi2GetString(c, refs, n, &string);
    case 21: case 22: return fmi2GetFMUstate(c, &slot->states[take(s, N_STATES)]);
    case 23: case 24: return fmi2SetFMUstate(c, any_state(s, slot));
    case 25:
        n = take(s, N_STATES);
        return fmi2FreeFMUstate(c, &slot->states[n]);
    case 26:
        state = any_state(s, slot);
        for (n = 0; n < N_STATES; n++) /* freed: no slot keeps it */
            if (state && slot->states[n] == state)
                return fmi2FreeFMUstate(c, &slot->states[n]);
        return fmi2FreeFMUstate(c, &state);
    case 27: case 28: return bytes(s, slot);
    case 29:
        n = references(s, refs, values);
        m = references(s, others, results);
        return fmi2GetDirectionalDerivative(c, refs, n, others, m, results, values);
    case 30:
        n = references(s, refs, values);
        for (m = 0; m < n; m++)
            integers[m] = take(s, 8) ? 1 : (int)take(s, 4);
        return fmi2SetRealInputDerivatives(c, refs, n, integers, values);
    case 31: return fmi2EnterEventMode(c);
    case 32: return fmi2EnterContinuousTimeMode(c);
    case 33: return fmi2NewDiscreteStates(c, take(s, 8) ? &info : NULL);
    case 34: return fmi2CompletedIntegratorStep(c, 1, &flag, take(s, 8) ? &other : NULL);
    case 35: return fmi2SetTime(c, any_number(s));
    case 36:
        for (n = 0; n < unit.n_x; n++)
            values[n] = any_number(s);
        return fmi2SetContinuousStates(c, values, unit.n_x + (take(s, 16) == 0));
    case 37: return fmi2GetDerivatives(c, results, unit.n_x);
    case 38: return fmi2GetContinuousStates(c, results, unit.n_x - (take(s, 16) == 0));
    default: return fmi2GetRealStatus(c, fmi2LastSuccessfulTime, results);
    }
}

/* All that decides the future of an instance; the state that it is read from is freed at once. */
static char *snapshot(fmi2Component c, size_t *size)
{
    fmi2FMUstate state = NULL;
    require(fmi2GetFMUstate(c, &state) == fmi2OK, "a state that cannot be saved");
    require(fmi2SerializedFMUstateSize(c, state, size) == fmi2OK, "a state without a size");
    char *room = malloc(*size);
    require(fmi2SerializeFMUstate(c, state, room, *size) == fmi2OK, "a state without bytes");
    fmi2FMUstate again = NULL; /* what an instance says of itself, it believes */
    require(fmi2DeSerializeFMUstate(c, room, *size, &again) == fmi2OK, "bytes of a state that are refused");
    require(fmi2FreeFMUstate(c, &again) == fmi2OK, "a state that cannot be freed");
    require(fmi2FreeFMUstate(c, &state) == fmi2OK, "a state that cannot be freed");
    return room;
}

static void free_slot(Slot *slot)
{
    fmi2FreeInstance(slot->c);
    *slot = (Slot){0};
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    Source s = {data, size};
    while (s.left) {
        Slot *slot = &slots[take(&s, N_INSTANCES)];
        if (!slot->c) {
            slot->c = make(&s);
            if (slot->c && take(&s, 4))
                initialize(&s, slot->c);
            continue;
        }
        if (take(&s, 64) == 63) {
            free_slot(slot);
            continue;
        }
        size_t before_size, after_size;
        const fmi2Component c = slot->c;
        const Source rest = s;
        char *before = snapshot(c, &before_size);
        const fmi2Status status = call(&s, slot);
        require(status == fmi2OK || status == fmi2Discard || status == fmi2Error, "an unknown status");
        const unsigned what = take(&(Source){rest.bytes, rest.left}, 40);
        const int excused = what == 5 || what == 6 || /* several calls, of which the last failed */
                            (what == 37 && status == fmi2Discard); /* derivatives that are not finite stay calculated */
        if (status != fmi2OK && !excused) {
            char *after = snapshot(c, &after_size);
            require(before_size == after_size && memcmp(before, after, after_size) == 0, "a call that failed changed the instance");
            free(after);
        }
        free(before);
    }
    for (size_t k = 0; k < N_INSTANCES; k++)
        if (slots[k].c)
            free_slot(&slots[k]);
    return 0;
}

#ifdef MAIN
int main(int argc, char **argv)
{
    const unsigned long inputs = argc > 1 ? strtoul(argv[1], NULL, 10) : 1000;
    uint64_t x = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    x = x * 0x9e3779b97f4a7c15u + 1;
    uint8_t room[1024];
    for (unsigned long k = 0; k < inputs; k++) {
        for (size_t i = 0; i < sizeof room; i++) { /* xorshift64 */
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            room[i] = (uint8_t)(x >> 32);
        }
        LLVMFuzzerTestOneInput(room, 64 + (size_t)(x >> 40) % (sizeof room - 64));
    }
    printf("%lu inputs\n", inputs);
    return 0;
}
#endif
