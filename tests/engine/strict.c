/* A unit of FMI 2.0 that never steps beyond the stop time it was told, and, from times that are its parameters on, ends
   the simulation, puts out what is no number, or refuses with or without a reason. It logs every call as debug text. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

enum { Y, END, NAN_FROM, INF_FROM, REFUSE, MUTE, DISCARD, N };

typedef struct {
    double values[N], stop, last;
    int ended;
    void *environment;
    fmi2CallbackLogger log;
} Unit;

static fmi2Status say(Unit *m, fmi2Status status, const char *text) {
    m->log(m->environment, "unit", status, status == fmi2OK ? "logAll" : "logStatusError", "%s", text);
    return status;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *names) {
    return (void)c, (void)on, (void)n, (void)names, fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)place, (void)visible, (void)logging;
    Unit *m = calloc(1, sizeof *m);
    for (int i = END; i < N; i++) m->values[i] = 1e9;
    m->environment = call->componentEnvironment, m->log = call->logger;
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop) {
    (void)defined, (void)tolerance;
    ((Unit *)c)->stop = stops ? stop : INFINITY;
    ((Unit *)c)->values[Y] = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return (void)c, fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Real *x) {
    while (n--) x[n] = ((Unit *)c)->values[r[n]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *x) {
    while (n--) ((Unit *)c)->values[r[n]] = x[n];
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean final) {
    Unit *m = c;
    double *v = m->values, end = t + h;
    (void)final;
    say(m, fmi2OK, "debug: fmi2DoStep");
    if (end > m->stop) return say(m, fmi2Error, "the step ends beyond the stop time");
    if (t >= v[MUTE]) return say(m, fmi2OK, "debug: fmi2DoStep ends"), fmi2Error;
    if (t >= v[REFUSE]) {
        say(m, fmi2Error, "the oil is too cold");
        return say(m, fmi2OK, "debug: fmi2DoStep ends"), fmi2Error;
    }
    if (t >= v[DISCARD]) return say(m, fmi2Discard, "too long a step");
    if (end >= v[END]) {
        m->ended = 1;
        v[Y] = m->last = v[END];
        return fmi2Discard;
    }
    v[Y] = end >= v[NAN_FROM] ? NAN : end >= v[INF_FROM] ? -INFINITY : end;
    return fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return (void)c, fmi2Error; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *x) {
    *x = ((Unit *)c)->last;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *x) {
    *x = ((Unit *)c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state) *state = malloc(sizeof(Unit));
    return memcpy(*state, c, sizeof(Unit)), fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return memcpy(c, state, sizeof(Unit)), fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    return *state = NULL, fmi2OK;
}

#define NOT_THERE(name) \
    fmi2Status name(void) { return fmi2Error; }
NOT_THERE(fmi2GetInteger)
NOT_THERE(fmi2GetBoolean)
NOT_THERE(fmi2GetString)
NOT_THERE(fmi2SetInteger)
NOT_THERE(fmi2SetBoolean)
NOT_THERE(fmi2SetString)
NOT_THERE(fmi2SerializedFMUstateSize)
NOT_THERE(fmi2SerializeFMUstate)
NOT_THERE(fmi2DeSerializeFMUstate)
NOT_THERE(fmi2GetDirectionalDerivative)
NOT_THERE(fmi2SetRealInputDerivatives)
NOT_THERE(fmi2GetRealOutputDerivatives)
NOT_THERE(fmi2GetStatus)
NOT_THERE(fmi2GetIntegerStatus)
NOT_THERE(fmi2GetStringStatus)
