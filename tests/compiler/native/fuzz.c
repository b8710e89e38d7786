/* Sequences of calls, right and wrong, read from bytes: several instances, several saved states of each.
 *
 * A call that fails must leave the instance as it was, to the bit; all else is left to the sanitizers: no wrong access, no
 * undefined behaviour, no leak. FMI3 chooses the version. The target of libFuzzer, or with MAIN a program that makes its own
 * inputs:
 *
 *     fuzz CALLS [SEED]
 */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h" /* of the unit: its tables, and the time of an instance */

#include "fuzz_version.h"

#define N_INSTANCES 3
#define N_STATES 4
#define ROOM 512

typedef struct {
    Component c;
    SavedState states[N_STATES];
} Slot;

typedef struct {
    const uint8_t *bytes;
    size_t left;
} Source;

typedef struct {
    Reference refs[ROOM];
    double values[ROOM];
    size_t n, n_values;
} Group;

static Slot slots[N_INSTANCES];
static unsigned long n_calls, most_calls = ULONG_MAX;

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

#ifdef FMI3
static void receive(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)status;
    require(environment == &slots && category && text && text[0], "an empty message");
}
#else
static void receive(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String text, ...)
{
    (void)environment, (void)status;
    require(name && category && text && text[0], "an empty message");
    for (const char *p = text; *p; p++) /* "%%" alone: nothing that printf would read an argument for */
        if (*p == '%')
            require(*++p == '%', "a message that printf would misread");
}
#endif

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
static double value_of(Source *s, size_t ref)
{
    if (ref >= unit.n || unit.variables[ref].role == INPUT)
        return any_number(s);
    static const double factor[] = {1.0, 1.0, 1.01, 0.99, 2.0, 0.5, -1.0, 0.0};
    const unsigned k = take(s, 10);
    if (ref == unit.tolerance)
        return k < 8 ? 1e-4 : any_number(s);
    return k < 8 ? unit.variables[ref].start * factor[k] : k == 8 ? NAN : INFINITY;
}

static size_t any_variable(Source *s)
{
    const unsigned k = take(s, 32);
    if (k == 0)
        return N_NAMED + take(s, 3);
    if (k == 1)
        return 0xffffffffu - take(s, 2);
    return (take(s, 256) + 256 * take(s, 2)) % N_NAMED;
}

static Group group(Source *s)
{
    Group g = {.n = take(s, 6)};
    const size_t first = any_variable(s);
    const int scattered = take(s, 3) == 0;
    for (size_t k = 0; k < g.n; k++) {
        g.refs[k] = named(scattered ? any_variable(s) : first + k);
        for (size_t i = 0; i < size_of(g.refs[k]); i++)
            g.values[g.n_values++] = value_of(s, g.refs[k] + i);
    }
#ifdef FMI3
    if (take(s, 16) == 0)
        g.n_values = take(s, ROOM);
#endif
    return g;
}

static SavedState any_state(Source *s, const Slot *own)
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

#include "fuzz_own.h"

static int bytes(Source *s, Slot *slot)
{
    size_t size = 0;
    const SavedState state = any_state(s, slot);
    int status = STATE(Serialized, Size)(slot->c, state, &size);
    if (status != STATUS_OK)
        return status;
    require(size < 100000, "a large state");
    char *room = malloc(size);
    status = STATE(Serialize, )(slot->c, state, (void *)room, size - (take(s, 16) == 0));
    if (status == STATUS_OK) {
        if (take(s, 2)) /* damaged, and the checksum with it */
            room[(take(s, 256) * 256 + take(s, 256)) % size] ^= (char)(1 + take(s, 255));
        Slot *to = &slots[take(s, N_INSTANCES)];
        SavedState *place = &to->states[take(s, N_STATES)];
        const size_t n = take(s, 16) ? size : take(s, 256) % size;
        status = to->c ? (int)DESERIALIZE(to->c, (void *)room, n, place) : STATUS_ERROR;
        if (to != slot)
            status = STATUS_OK; /* said of the other */
    }
    free(room);
    return status;
}

static int call(Source *s, Slot *slot)
{
    const Component c = slot->c;
    Group g;
    double results[ROOM];
    Integer integers[ROOM] = {0};
    size_t n;
    SavedState state;
    const unsigned what = take(s, N_CALLS);
    switch (what) {
    case 0: return FMI(Reset)(c);
    case 1: return FMI(Terminate)(c);
    case 3: return FMI(EnterInitializationMode)(c ENTER_ARGUMENTS);
    case 4: return FMI(ExitInitializationMode)(c);
    case 5: case 6: return initialize(s, c);
    case 7: case 8: case 9: case 10: return step(s, c);
    case 11: case 12: case 13: g = group(s); return REAL_CALL(Set)(c, VALUES(g, take(s, 32) ? g.values : NULL));
    case 14: case 15:
        g = group(s);
        return take(s, 32) ? REAL_CALL(Get)(c, VALUES(g, results)) : REAL_CALL(Get)(c, NULL, VALUES_AFTER(g, results));
    case 16: g = group(s); integers[0] = (int)take(s, 4) - 1; return INTEGER_CALL(Set)(c, VALUES(g, integers));
    case 17: g = group(s); return INTEGER_CALL(Get)(c, VALUES(g, integers));
    case 21: case 22: return STATE(Get, )(c, &slot->states[take(s, N_STATES)]);
    case 23: case 24: return STATE(Set, )(c, any_state(s, slot));
    case 25:
        n = take(s, N_STATES);
        return STATE(Free, )(c, &slot->states[n]);
    case 26:
        state = any_state(s, slot);
        for (n = 0; n < N_STATES; n++) /* freed: no slot keeps it */
            if (state && slot->states[n] == state)
                return STATE(Free, )(c, &slot->states[n]);
        return STATE(Free, )(c, &state);
    case 27: case 28: return bytes(s, slot);
    case 31: return FMI(EnterEventMode)(c);
    case 32: return FMI(EnterContinuousTimeMode)(c);
    case 35: return FMI(SetTime)(c, any_number(s));
    case 36:
        for (n = 0; n < unit.n_x; n++)
            results[n] = any_number(s);
        return FMI(SetContinuousStates)(c, results, unit.n_x + (take(s, 16) == 0));
    case 37: return GET_DERIVATIVES(c, results, unit.n_x);
    case 38: return FMI(GetContinuousStates)(c, results, unit.n_x - (take(s, 16) == 0));
    default: return own_call(s, c, what);
    }
}

/* All that decides the future of an instance; the state that it is read from is freed at once. */
static char *snapshot(Component c, size_t *size)
{
    SavedState state = NULL;
    require(STATE(Get, )(c, &state) == 0, "a state that cannot be saved");
    require(STATE(Serialized, Size)(c, state, size) == 0, "a state without a size");
    char *room = malloc(*size);
    require(STATE(Serialize, )(c, state, (void *)room, *size) == 0, "a state without bytes");
    SavedState again = NULL; /* what an instance says of itself, it believes */
    require(DESERIALIZE(c, (void *)room, *size, &again) == 0, "bytes of a state that are refused");
    require(STATE(Free, )(c, &again) == 0, "a state that cannot be freed");
    require(STATE(Free, )(c, &state) == 0, "a state that cannot be freed");
    return room;
}

static void free_slot(Slot *slot)
{
    FMI(FreeInstance)(slot->c);
    *slot = (Slot){0};
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    Source s = {data, size};
    while (s.left && n_calls < most_calls) {
        n_calls++;
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
        const Component c = slot->c;
        const Source rest = s;
        char *before = snapshot(c, &before_size);
        const int status = call(&s, slot);
        require(status == STATUS_OK || status == STATUS_DISCARD || status == STATUS_ERROR, "an unknown status");
        const unsigned what = take(&(Source){rest.bytes, rest.left}, N_CALLS);
        const int excused = what == 5 || what == 6 || /* several calls, of which the last failed */
                            (what == 37 && status == STATUS_DISCARD); /* derivatives that are not finite stay calculated */
        if (status != STATUS_OK && !excused) {
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
    most_calls = argc > 1 ? strtoul(argv[1], NULL, 10) : 10000;
    uint64_t x = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    x = x * 0x9e3779b97f4a7c15u + 1;
    uint8_t room[1024];
    while (n_calls < most_calls) {
        for (size_t i = 0; i < sizeof room; i++) { /* xorshift64 */
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            room[i] = (uint8_t)(x >> 32);
        }
        LLVMFuzzerTestOneInput(room, 64 + (size_t)(x >> 40) % (sizeof room - 64));
    }
    printf("%lu calls\n", n_calls);
    return 0;
}
#endif
