/* A unit of FMI 3.0 for co-simulation that reports odd times and flags, by its parameter `way`. Its flags have all bits set,
   which no `bool` has. */
#include <math.h>
#include <stdlib.h>

#include "fmi3Functions.h"

enum { WELL, ENDS, EARLY, EVENT };
typedef struct {
    double way, reported, from, time; /* `reported`: last successful time in steps from the begin of the step from `from` on */
    int steps;
} Unit;
static const char *version = "3.0";
static void set(fmi3Boolean *flag) { *(unsigned char *)flag = 255; }

const char *fmi3GetVersion(void) { return version; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t n, fmi3InstanceEnvironment host,
                                         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)place, (void)visible, (void)logging, (void)events, (void)early, (void)needed, (void)n;
    (void)host, (void)log, (void)update;
    return calloc(1, sizeof(Unit));
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean known, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stops, fmi3Float64 stop) {
    (void)known, (void)tolerance, (void)stops, (void)stop;
    return ((Unit *)c)->time = start, fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return (void)c, fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance c) { return (void)c, fmi3OK; }
fmi3Status fmi3EnterEventMode(fmi3Instance c) { return (void)c, fmi3OK; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next) {
    (void)c;
    *again = *end = *nominals = *states = *defined = fmi3False, *next = 0.0;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return (void)c, fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { return *(Unit *)c = (Unit){0}, fmi3OK; }
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[], size_t m) {
    for (size_t i = 0; i < n && i < m; i++)
        *(r[i] == 1 ? &((Unit *)c)->way : r[i] == 2 ? &((Unit *)c)->reported : &((Unit *)c)->from) = x[i] == 1e99 ? (fmi3Float64)NAN : x[i]; // an FMU may not be given NaN
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t m) {
    (void)r;
    for (size_t i = 0; i < n && i < m; i++) x[i] = ((Unit *)c)->time;
    return fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Boolean x[], size_t m) {
    (void)c, (void)r;
    for (size_t i = 0; i < n && i < m; i++) set(x + i);
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean keep, fmi3Boolean *event, fmi3Boolean *end,
                      fmi3Boolean *early, fmi3Float64 *last) {
    Unit *m = c;
    (void)keep;
    *event = *end = *early = fmi3False, *last = m->time = t + h;
    if (t < m->from || m->way == WELL) return fmi3OK;
    *last = t + m->reported * h;
    set(m->way == ENDS ? end : early);
    if (m->way == EVENT) set(event);
    return fmi3OK;
}
