/* A unit of FMI 2.0, x' = u - 2 x, with directional derivatives and saved states. The environment variable BRITTLE names
   the call in which it crashes, or, after a dash, the call in which it never returns: "-doStep". Each process that
   loads it writes its number into the file BRITTLE_LOG. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

enum { U, X, RATE, N };

typedef struct { double values[N]; } Unit;

static void at(const char *call) {
    const char *wanted = getenv("BRITTLE");
    if (!wanted) return;
    if (*wanted == '-' && strcmp(wanted + 1, call) == 0) for (;;) pause();
    if (strcmp(wanted, call) == 0) raise(SIGSEGV);
}

__attribute__((constructor)) static void load(void) {
    FILE *log = getenv("BRITTLE_LOG") ? fopen(getenv("BRITTLE_LOG"), "a") : NULL;
    if (log) fprintf(log, "%d\n", (int)getpid()), fclose(log);
    at("load");
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *names) {
    return (void)c, (void)on, (void)n, (void)names, fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)place, (void)call, (void)visible, (void)logging;
    at("instantiate");
    Unit *m = calloc(1, sizeof *m);
    m->values[X] = 1.0;
    return m;
}
void fmi2FreeInstance(fmi2Component c) { at("freeInstance"), free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop) {
    return (void)c, (void)defined, (void)tolerance, (void)start, (void)stops, (void)stop, fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, at("enterInitializationMode"), fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return (void)c, at("terminate"), fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    memset(c, 0, sizeof(Unit));
    ((Unit *)c)->values[X] = 1.0;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Real *x) {
    Unit *m = c;
    at("getReal");
    m->values[RATE] = m->values[U] - 2.0 * m->values[X];
    while (n--) x[n] = m->values[r[n]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *x) {
    while (n--) ((Unit *)c)->values[r[n]] = x[n];
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference *unknown, size_t n,
                                        const fmi2ValueReference *known, size_t m, const fmi2Real *seed, fmi2Real *y) {
    double by[N] = {0.0};
    (void)c;
    at("getDirectionalDerivative");
    for (size_t i = 0; i < m; i++) by[known[i]] = seed[i];
    for (size_t i = 0; i < n; i++) y[i] = unknown[i] == RATE ? by[U] - 2.0 * by[X] : by[unknown[i]];
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean final) {
    double *v = ((Unit *)c)->values;
    (void)t, (void)final;
    at("doStep");
    v[X] += h * (v[U] - 2.0 * v[X]) * (1.0 - h);
    return fmi2OK;
}

#define NOT_THERE(name) \
    fmi2Status name(void) { return fmi2Error; }
NOT_THERE(fmi2CancelStep)
NOT_THERE(fmi2GetInteger)
NOT_THERE(fmi2GetBoolean)
NOT_THERE(fmi2GetString)
NOT_THERE(fmi2SetInteger)
NOT_THERE(fmi2SetBoolean)
NOT_THERE(fmi2SetString)
NOT_THERE(fmi2SerializedFMUstateSize)
NOT_THERE(fmi2SerializeFMUstate)
NOT_THERE(fmi2DeSerializeFMUstate)
NOT_THERE(fmi2SetRealInputDerivatives)
NOT_THERE(fmi2GetRealOutputDerivatives)
NOT_THERE(fmi2GetStatus)
NOT_THERE(fmi2GetRealStatus)
NOT_THERE(fmi2GetIntegerStatus)
NOT_THERE(fmi2GetBooleanStatus)
NOT_THERE(fmi2GetStringStatus)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state) *state = malloc(sizeof(Unit));
    return memcpy(*state, c, sizeof(Unit)), fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return memcpy(c, state, sizeof(Unit)), fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (void)c, free(*state), *state = NULL, fmi2OK;
}
