/* Uses a unit as an importer in C does, well and badly, and prints the bits of what it computes.
 *
 *     driver LIBRARY GUID INPUTS OUTPUTS PARAMETER [states]
 *
 * INPUTS, OUTPUTS: value references and numbers of values, "0:2,4:1". PARAMETER: value reference of a fixed parameter of
 * one value. "states": the unit has that many continuous states, and model exchange. The library is loaded, or linked with
 * the program if STATIC is defined. FMI3 chooses the version. Exit code 1: a run was not repeated to the bit, or wrong use
 * was not refused.
 */
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef FMI3
#include <fmi3Functions.h>
#define FMI(name) fmi3##name
#define PREFIX "fmi3"
#define REAL(verb) CALL(verb##Float64)
#define STATE(before, after) CALL(before##FMUState##after)
#define DESERIALIZE CALL(DeserializeFMUState)
#define GET_DERIVATIVES CALL(GetContinuousStateDerivatives)
#else
#include <fmi2Functions.h>
#define FMI(name) fmi2##name
#define PREFIX "fmi2"
#define REAL(verb) CALL(verb##Real)
#define STATE(before, after) CALL(before##FMUstate##after)
#define DESERIALIZE CALL(DeSerializeFMUstate)
#define GET_DERIVATIVES CALL(GetDerivatives)
#endif

/* ---------------------------------------------------------------- functions of the unit */

#ifdef STATIC
#define CALL(name) FMI(name)
#define LOAD(path) (void)(path)
#else
#ifdef _WIN32
#include <windows.h>
static HMODULE library;
#define LOAD(path) require((library = LoadLibraryA(path)) != NULL, "a library that can be loaded")
static void *symbol(const char *name)
{
    return (void *)(uintptr_t)GetProcAddress(library, name);
}
#else
#include <dlfcn.h>
static void *library;
#define LOAD(path) require((library = dlopen(path, RTLD_NOW | RTLD_LOCAL)) != NULL, dlerror())
static void *symbol(const char *name)
{
    return dlsym(library, name);
}
#endif
/* Every use looks its function up: slow, and short. */
#define CALL(name) ((FMI(name##TYPE) *)(uintptr_t)symbol(PREFIX #name))
#endif

/* ---------------------------------------------------------------- checks */

#define ROOM 512
static unsigned n_messages;

static void require(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "driver: expected %s\n", what);
    exit(1);
}
#define OK(call) require((call) == 0, #call " done")

/* A call that must be refused, with words. */
#define NO(call)                                      \
    do {                                              \
        const unsigned n_before = n_messages;         \
        require((int)(call) == 3, #call " refused");  \
        require(n_messages == n_before + 1, "words"); \
    } while (0)

#ifdef FMI3
static void receive(void *environment, fmi3Status status, fmi3String category, fmi3String text)
{
    require(environment == &n_messages && category && text[0], "a message");
    n_messages += status != fmi3OK;
}
#else
static void receive(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    char room[4096];
    va_list arguments;
    va_start(arguments, text);
    vsnprintf(room, sizeof room, text, arguments); /* as many importers do: the text must have no conversions */
    va_end(arguments);
    require(environment == &n_messages && name && category && room[0], "a message");
    n_messages += status != fmi2OK;
}
#endif

typedef FMI(ValueReference) Reference;
typedef struct {
    Reference refs[ROOM];
    size_t n, n_values;
} Group;

static Group group(const char *text)
{
    Group g = {.n = 0};
    while (*text) {
        char *end;
        g.refs[g.n++] = (Reference)strtoul(text, &end, 10);
        g.n_values += strtoul(end + 1, &end, 10);
        text = *end ? end + 1 : end;
    }
    require(g.n_values <= ROOM, "fewer values");
    return g;
}

static const char *guid;
static Group inputs, outputs;
static Reference parameter;
static size_t n_states;
typedef void *Instance;

#ifdef FMI3
#define VALUES(g, room) (g).refs, (g).n, room, (g).n_values
#define ONE(ref, room) &(ref), 1, room, 1
#else
#define VALUES(g, room) (g).refs, (g).n, room
#define ONE(ref, room) &(ref), 1, room
#endif

static Instance make(const char *token, int exchange)
{
#ifdef FMI3
    return exchange ? CALL(InstantiateModelExchange)("100% unit", token, NULL, false, true, &n_messages, receive)
                    : CALL(InstantiateCoSimulation)("100% unit", token, NULL, false, true, false, false, NULL, 0, &n_messages,
                                                  receive, NULL);
#else
    static const fmi2CallbackFunctions callbacks = {receive, calloc, free, NULL, &n_messages};
    return CALL(Instantiate)("100% unit", exchange ? fmi2ModelExchange : fmi2CoSimulation, token, NULL, &callbacks, 0, 1);
#endif
}

static int enter(Instance c, int tolerance_defined, double tolerance, double start)
{
#ifdef FMI3
    return CALL(EnterInitializationMode)(c, tolerance_defined != 0, tolerance, start, false, 0.0);
#else
    const int status = CALL(SetupExperiment)(c, tolerance_defined, tolerance, start, 0, 0.0);
    return status ? status : (int)CALL(EnterInitializationMode)(c);
#endif
}

static void start(Instance c)
{
    OK(enter(c, 0, 0.0, 0.0));
    OK(CALL(ExitInitializationMode)(c));
}

static int step_once(Instance c, double point, double size)
{
#ifdef FMI3
    bool event, end, early;
    double last;
    return CALL(DoStep)(c, point, size, true, &event, &end, &early, &last);
#else
    return CALL(DoStep)(c, point, size, fmi2True);
#endif
}

/* Inputs that need no function of the C library, the same on every machine. */
static void excite(Instance c, unsigned k)
{
    double values[ROOM];
    for (size_t i = 0; i < inputs.n_values; i++)
        values[i] = ((double)((k / 5 * 7 + 3 * i) % 17) - 8.0) / 256.0;
    if (inputs.n)
        OK(REAL(Set)(c, VALUES(inputs, values)));
}

#define H 0x1p-10 /* [s] exact in binary */

static void drive(Instance c, unsigned from, unsigned to)
{
    for (unsigned k = from; k < to; k++) {
        excite(c, k);
        OK(step_once(c, k * H, H));
    }
}

static void read_outputs(Instance c, double values[])
{
    OK(REAL(Get)(c, VALUES(outputs, values)));
}

static void print(const char *what, const double values[], size_t n)
{
    printf("%s", what);
    for (size_t i = 0; i < n; i++) {
        uint64_t bits;
        memcpy(&bits, &values[i], 8);
        printf(" %016llx", (unsigned long long)bits);
    }
    printf("\n");
}

static void require_outputs(Instance c, const double expected[], const char *what)
{
    double values[ROOM];
    read_outputs(c, values);
    require(memcmp(values, expected, outputs.n_values * sizeof *values) == 0, what);
}

/* ---------------------------------------------------------------- use and misuse */

static unsigned char *serialize(Instance c, void *state, size_t *size)
{
    OK(STATE(Serialized, Size)(c, state, size));
    unsigned char *bytes = malloc(*size);
    OK(STATE(Serialize, )(c, state, (void *)bytes, *size));
    return bytes;
}

static void use(unsigned steps)
{
    double first[ROOM], middle[ROOM], last[ROOM];
    Instance c = make(guid, 0), other = make(guid, 0);
    require(c && other, "instances");
    start(c);
    read_outputs(c, first);
    print("start", first, outputs.n_values);
    void *state = NULL, *left = NULL, *moved = NULL;
    for (unsigned k = 0; k < steps; k += steps / 10) {
        drive(c, k, k + steps / 10);
        read_outputs(c, last);
        print("step", last, outputs.n_values);
        if (2 * (k + steps / 10) == steps) {
            OK(STATE(Get, )(c, &state));
            memcpy(middle, last, sizeof middle);
        }
    }
    OK(STATE(Set, )(c, state));
    require_outputs(c, middle, "a rollback to the bit");
    drive(c, steps / 2, steps);
    require_outputs(c, last, "a run after a rollback to the bit");

    size_t size;
    unsigned char *bytes = serialize(c, state, &size);
    OK(DESERIALIZE(other, (void *)bytes, size, &moved));
    bytes[size / 2] ^= 4;
    NO(DESERIALIZE(other, (void *)bytes, size, &left));
    bytes[size / 2] ^= 4;
    for (size_t n = 0; n < size; n += 17)
        NO(DESERIALIZE(other, (void *)bytes, n, &left));
    free(bytes);
    OK(STATE(Set, )(other, moved));
    NO(STATE(Set, )(other, state));
    drive(other, steps / 2, steps);
    require_outputs(other, last, "a run of a moved state to the bit");

    OK(CALL(Reset)(c));
    start(c);
    require_outputs(c, first, "a reset to the bit");
    drive(c, 0, steps / 2);
    require_outputs(c, middle, "a run after a reset to the bit");
    OK(STATE(Get, )(c, &left)); /* freed with the instance */
    OK(STATE(Free, )(c, &state));
    require(!state, "a null pointer");
    OK(CALL(Terminate)(c));
    require_outputs(c, middle, "outputs after the end");
    CALL(FreeInstance)(c);
    CALL(FreeInstance)(other); /* without terminate */
}

static void exchange(void)
{
    double x[ROOM], x_dot[ROOM], seed[ROOM], product[ROOM], values[ROOM];
    Instance c = make(guid, 1);
    require(c != NULL, "an instance for model exchange");
    start(c);
    OK(CALL(EnterContinuousTimeMode)(c));
    for (unsigned k = 0; k < 100; k++) { /* Euler's method */
        excite(c, k);
        OK(CALL(SetTime)(c, k * 0x1p-17));
        OK(CALL(GetContinuousStates)(c, x, n_states));
        OK(GET_DERIVATIVES(c, x_dot, n_states));
        for (size_t i = 0; i < n_states; i++)
            x[i] += 0x1p-17 * x_dot[i];
        OK(CALL(SetContinuousStates)(c, x, n_states));
    }
    print("x", x, n_states);
    for (size_t i = 0; i < ROOM; i++)
        seed[i] = 1.0;
#ifdef FMI3
    OK(CALL(GetDirectionalDerivative)(c, outputs.refs, outputs.n, inputs.refs, inputs.n, seed, inputs.n_values, product,
                                    outputs.n_values));
    OK(CALL(GetAdjointDerivative)(c, outputs.refs, outputs.n, inputs.refs, inputs.n, seed, outputs.n_values, values,
                                inputs.n_values));
    NO(CALL(GetAdjointDerivative)(c, outputs.refs, outputs.n, inputs.refs, inputs.n, seed, 0, values, inputs.n_values));
#else
    OK(CALL(GetDirectionalDerivative)(c, outputs.refs, outputs.n, inputs.refs, inputs.n, seed, product));
    NO(CALL(GetDirectionalDerivative)(c, inputs.refs, 1, outputs.refs, 1, seed, product));
#endif
    read_outputs(c, values);
    print("outputs", values, outputs.n_values);
    x[0] = NAN;
    require(CALL(SetContinuousStates)(c, x, n_states) == 2, "discard");
    require(CALL(SetTime)(c, INFINITY) == 2, "discard");
    NO(CALL(SetContinuousStates)(c, x, n_states + 1));
    NO(CALL(SetContinuousStates)(c, NULL, n_states));
    NO(step_once(c, 0.0, H));
    require_outputs(c, values, "outputs as before");
    CALL(FreeInstance)(c);
}

static void misuse(void)
{
    double before[ROOM], values[ROOM] = {0};
    const Reference nowhere[] = {4000000000u, 100000u};
    char longest[20000];
    memset(longest, '%', sizeof longest);
    longest[sizeof longest - 1] = '\0';
    require(!make(longest, 0) && !make("", 0) && !make(NULL, 0), "no instance for another GUID");
    if (!n_states)
        require(!make(guid, 1), "no instance for model exchange");

    Instance c = make(guid, 0);
    NO(step_once(c, 0.0, H));
    NO(CALL(ExitInitializationMode)(c));
    NO(CALL(Terminate)(c));
    NO(REAL(Get)(c, VALUES(outputs, values)));
    NO(enter(c, 1, -1.0, 0.0));
    NO(enter(c, 1, NAN, 0.0));
    NO(enter(c, 0, 0.0, INFINITY));
    values[0] = NAN;
    NO(REAL(Set)(c, ONE(parameter, values)));
    values[0] = 0.0;
    start(c);
    drive(c, 0, 3);
    read_outputs(c, before);

    NO(REAL(Set)(c, ONE(parameter, values)));
    NO(REAL(Set)(c, VALUES(outputs, before)));
    if (inputs.n) {
        values[inputs.n_values - 1] = INFINITY;
        NO(REAL(Set)(c, VALUES(inputs, values)));
        values[inputs.n_values - 1] = 0.0;
    }
    NO(REAL(Set)(c, ONE(nowhere[0], values)));
    NO(REAL(Get)(c, ONE(nowhere[1], values)));
#ifdef FMI3
    NO(CALL(GetFloat64)(c, NULL, 3, values, 3));
    NO(CALL(GetFloat64)(c, outputs.refs, outputs.n, NULL, outputs.n_values));
    NO(CALL(GetFloat64)(c, outputs.refs, outputs.n, values, outputs.n_values - 1));
    NO(CALL(SetFloat64)(c, outputs.refs, 1, values, (size_t)-1));
    NO(CALL(DoStep)(c, 3 * H, H, true, NULL, NULL, NULL, NULL));
#else
    fmi2String string;
    NO(CALL(GetReal)(c, NULL, 3, values));
    NO(CALL(GetReal)(c, outputs.refs, outputs.n, NULL));
    NO(CALL(GetString)(c, outputs.refs, 1, &string));
    NO(CALL(SetRealInputDerivatives)(c, outputs.refs, 1, (int[]){1}, values));
#endif
    const double wrong[] = {0.0, -H, NAN, INFINITY, -INFINITY};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        NO(step_once(c, 3 * H, wrong[i]));
        if (wrong[i] != 3 * H)
            NO(step_once(c, wrong[i], H));
    }
    if (n_states) {
        values[0] = 1e300;
        OK(REAL(Set)(c, VALUES(inputs, values)));
        NO(step_once(c, 3 * H, H));
        values[0] = 0.0;
    }
    void *state = NULL, *stray = &state;
    NO(STATE(Get, )(c, NULL));
    NO(STATE(Get, )(c, &stray));
    NO(STATE(Set, )(c, NULL));
    NO(STATE(Set, )(c, stray));
    NO(STATE(Free, )(c, &stray));
    OK(STATE(Free, )(c, &state));
    NO(CALL(ExitInitializationMode)(c));
    require(step_once(NULL, 0.0, H) == 3, "an error without an instance");
    require_outputs(c, before, "outputs as before");
    drive(c, 3, 5);
    OK(CALL(Terminate)(c));
    NO(CALL(Terminate)(c));
    NO(step_once(c, 5 * H, H));
    CALL(FreeInstance)(c);
    CALL(FreeInstance)(NULL);
}

int main(int argc, char **argv)
{
    require(argc >= 6, "LIBRARY GUID INPUTS OUTPUTS PARAMETER [states]");
    LOAD(argv[1]);
    guid = argv[2];
    inputs = group(argv[3]);
    outputs = group(argv[4]);
    parameter = (Reference)strtoul(argv[5], NULL, 10);
    n_states = argc > 6 ? strtoul(argv[6], NULL, 10) : 0;
    use(1000);
    misuse();
    if (n_states)
        exchange();
    printf("done\n");
    return 0;
}
