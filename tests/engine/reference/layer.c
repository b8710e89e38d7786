/* The functions of FMI 2.0 (FMI=2) or 3.0 (FMI=3) for a model of models.py, for model exchange and co-simulation.

   Co-simulation takes steps of STEP by the explicit Euler method, or, with SECOND, by that of the middle. With event mode
   it returns at an event, without it handles the event itself. Derivatives are those of a linear model. model.h, which models.py writes, has the data of the model, its table of variables and

       begin(I)          after the initialization: the first event
       outputs(I)        derivatives and outputs, from states, inputs and time
       indicators(I, z)  event indicators
       event(I)          what happens at an event: of a state, at I->next, of a discrete input, of a clock that ticks */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FLOAT64, FLOAT32, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN, STRING, BINARY, CLOCK };
typedef struct {
    unsigned vr;
    int type;
    size_t place;
    int rows, columns; /* of an array: numbers, or, below 0, where in the sizes; 0 of a scalar */
} Variable;
typedef struct { size_t size; char bytes[64]; } Text;

typedef struct Instance Instance;
#include "model.h"

struct Instance {
    Data d;
    double time, start, next; /* the next event [s] */
    double z[NZ + 1];
    bool changed, end, event_mode, exchange; /* changed: the states, by an event */
    long steps;
    void *environment;
    void (*log)(void);
    void (*update)(void *, double, bool, bool, bool, bool, bool *, double *);
};

static void begin(Instance *I);
static void outputs(Instance *I);
static void indicators(Instance *I, double *z);
static void event(Instance *I);
#include "model.c"

static size_t count(const Instance *I, const Variable *v)
{
    const int sides[] = {v->rows, v->columns};
    size_t n = 1;
    for (int k = 0; k < 2; k++)
        n *= sides[k] > 0 ? (size_t)sides[k] : sides[k] < 0 ? (size_t)SIZES(I)[-sides[k] - 1] : 1;
    return n;
}

static const Variable *find(unsigned vr, int type)
{
    for (size_t k = 0; k < sizeof table / sizeof *table; k++)
        if (table[k].vr == vr && table[k].type == type)
            return &table[k];
    return NULL;
}

static int copy(Instance *I, bool set, int type, size_t size, const unsigned *vr, size_t n, char *values)
{
    for (size_t k = 0; k < n; k++) {
        const Variable *v = find(vr[k], type);
        if (!v)
            return 3;
        char *own = (char *)&I->d + v->place;
        const size_t bytes = size * count(I, v);
        memcpy(set ? own : values, set ? values : own, bytes);
        values += bytes;
    }
    return 0;
}

/* ---------------------------------------------------------------- co-simulation */

static void fresh(Instance *I)
{
    outputs(I);
    indicators(I, I->z);
}

static bool found_event(Instance *I)
{
    double z[NZ + 1];
    bool found = I->next <= I->time + 1e-9;
    indicators(I, z);
    for (int k = 0; k < NZ; k++) {
        found = found || (z[k] > 0) != (I->z[k] > 0);
        I->z[k] = z[k];
    }
    return found;
}

/* Step to `end`; true if an event is to be handled by the importer. */
static bool advance(Instance *I, double end)
{
    while (I->time + 0.5 * STEP < end) {
        outputs(I);
        if (SECOND) {
            Instance middle = *I;
            for (int k = 0; k < NX(I); k++)
                STATES(&middle)[k] += STEP / 2 * RATES(I)[k];
            outputs(&middle);
            memcpy(RATES(I), RATES(&middle), sizeof(double) * (size_t)NX(I));
        }
        for (int k = 0; k < NX(I); k++)
            STATES(I)[k] += STEP * RATES(I)[k];
        I->time = I->start + ++I->steps * STEP;
        if (I->update && I->time + 0.5 * STEP < end) {
            bool early = false;
            double wanted = 0;
            I->update(I->environment, I->time, true, true, true, false, &early, &wanted);
        }
        if (found_event(I)) {
            if (I->event_mode) {
                outputs(I);
                return true;
            }
            event(I);
            fresh(I);
        }
    }
    outputs(I);
    return false;
}

/* ---------------------------------------------------------------- derivatives: of a linear model differences, exactly */

static int differentiate(Instance *I, const unsigned *unknowns, size_t n, const unsigned *knowns, size_t m,
                         const double *seed, double *result)
{
    Instance moved = *I, still = *I;
    for (size_t k = 0; k < m; k++)
        *(double *)((char *)&moved.d + find(knowns[k], FLOAT64)->place) += seed[k];
    outputs(&moved), outputs(&still);
    for (size_t k = 0; k < n; k++) {
        const size_t place = find(unknowns[k], FLOAT64)->place;
        result[k] = *(double *)((char *)&moved.d + place) - *(double *)((char *)&still.d + place);
    }
    return 0;
}

/* By time, with inputs that stay. */
static int rates(Instance *I, const unsigned *vr, size_t n, double *result)
{
    Instance moved = *I;
    outputs(I);
    for (int k = 0; k < NX(I); k++)
        STATES(&moved)[k] += RATES(I)[k];
    outputs(&moved);
    for (size_t k = 0; k < n; k++) {
        const size_t place = find(vr[k], FLOAT64)->place;
        result[k] = *(double *)((char *)&moved.d + place) - *(double *)((char *)&I->d + place);
    }
    return 0;
}

#if FMI == 2
#include "fmi2Functions.h"

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)guid, (void)place, (void)call, (void)visible, (void)logging;
    Instance *I = calloc(1, sizeof *I);
    I->d = initial;
    I->next = INFINITY;
    I->exchange = type == fmi2ModelExchange;
    return I;
}
void fmi2FreeInstance(fmi2Component I) { free(I); }

#define OK(function, parameters, ...)                \
    fmi2Status function parameters                   \
    {                                                \
        Instance *I = (Instance *)c;                 \
        (void)I;                                     \
        __VA_ARGS__;                                 \
        return fmi2OK;                               \
    }
OK(fmi2SetupExperiment, (fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real start, fmi2Boolean e, fmi2Real f),
   (void)a, (void)b, (void)e, (void)f; I->time = I->start = start)
OK(fmi2EnterInitializationMode, (fmi2Component c), outputs(I))
OK(fmi2ExitInitializationMode, (fmi2Component c), begin(I); fresh(I))
OK(fmi2Terminate, (fmi2Component c), (void)I)
OK(fmi2Reset, (fmi2Component c), I->d = initial; I->next = INFINITY; I->steps = 0; I->changed = I->end = false)
OK(fmi2SetTime, (fmi2Component c, fmi2Real time), I->time = time; outputs(I))
OK(fmi2SetContinuousStates, (fmi2Component c, const fmi2Real *x, size_t n),
   memcpy(STATES(I), x, n * sizeof *x); outputs(I))
OK(fmi2GetContinuousStates, (fmi2Component c, fmi2Real *x, size_t n), memcpy(x, STATES(I), n * sizeof *x))
OK(fmi2GetDerivatives, (fmi2Component c, fmi2Real *x, size_t n), outputs(I); memcpy(x, RATES(I), n * sizeof *x))
OK(fmi2GetNominalsOfContinuousStates, (fmi2Component c, fmi2Real *x, size_t n), while (n--) x[n] = 1.0)
OK(fmi2GetEventIndicators, (fmi2Component c, fmi2Real *z, size_t n), (void)n; indicators(I, z))
OK(fmi2EnterEventMode, (fmi2Component c), (void)I)
OK(fmi2EnterContinuousTimeMode, (fmi2Component c), I->changed = false)
OK(fmi2CompletedIntegratorStep, (fmi2Component c, fmi2Boolean a, fmi2Boolean *enter, fmi2Boolean *end),
   (void)a; *enter = *end = 0)
OK(fmi2NewDiscreteStates, (fmi2Component c, fmi2EventInfo *info), event(I);
   *info = (fmi2EventInfo){0, I->end, 0, I->changed, isfinite(I->next), I->next}; fresh(I))
OK(fmi2GetFMUstate, (fmi2Component c, fmi2FMUstate *s), if (!*s) *s = malloc(sizeof *I); memcpy(*s, I, sizeof *I))
OK(fmi2SetFMUstate, (fmi2Component c, fmi2FMUstate s), memcpy(I, s, sizeof *I))
OK(fmi2FreeFMUstate, (fmi2Component c, fmi2FMUstate *s), free(*s); *s = NULL)

#define VALUES(name, type, kind)                                                                                  \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference *r, size_t n, type *x)                     \
    {                                                                                                             \
        outputs(c);                                                                                               \
        return copy(c, false, kind, sizeof *x, r, n, (char *)x);                                                  \
    }                                                                                                             \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference *r, size_t n, const type *x)               \
    {                                                                                                             \
        return copy(c, true, kind, sizeof *x, r, n, (char *)x);                                                   \
    }
VALUES(Real, fmi2Real, FLOAT64)
VALUES(Integer, fmi2Integer, INT32)

/* Booleans of FMI 2.0 have another length. */
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Boolean *x)
{
    outputs(c);
    for (bool b; n--; x[n] = b)
        if (copy(c, false, BOOLEAN, sizeof b, r + n, 1, (char *)&b))
            return fmi2Error;
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Boolean *x)
{
    while (n--) {
        bool b = x[n];
        if (copy(c, true, BOOLEAN, sizeof b, r + n, 1, (char *)&b))
            return fmi2Error;
    }
    return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2String *x)
{
    outputs(c);
    while (n--)
        x[n] = ((Text *)((char *)&((Instance *)c)->d + find(r[n], STRING)->place))->bytes;
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2String *x)
{
    while (n--)
        strncpy(((Text *)((char *)&((Instance *)c)->d + find(r[n], STRING)->place))->bytes, x[n], 63);
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference *u, size_t n, const fmi2ValueReference *k,
                                        size_t m, const fmi2Real *seed, fmi2Real *x)
{
    return differentiate(c, u, n, k, m, seed, x);
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Integer *order,
                                        fmi2Real *x)
{
    (void)order;
    return rates(c, r, n, x);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean keep)
{
    (void)keep;
    advance(c, time + h);
    return fmi2OK;
}

#else
#include "fmi3Functions.h"

const char *fmi3GetVersion(void) { return "3.0"; }
static Instance *make(void *environment, bool events, bool exchange)
{
    Instance *I = calloc(1, sizeof *I);
    I->d = initial;
    I->next = INFINITY;
    I->environment = environment, I->event_mode = events, I->exchange = exchange;
    return I;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                         fmi3Boolean logs, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference *r, size_t n, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)token, (void)place, (void)visible, (void)logs, (void)early, (void)r, (void)n, (void)log;
#ifdef REFUSES_EVENT_MODE
    if (events)
        return log(environment, fmi3Error, "logEvents", "Event mode is not supported."), NULL;
#endif
    Instance *I = make(environment, events, false);
    I->update = update;
    return I;
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                          fmi3Boolean logs, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)place, (void)visible, (void)logs, (void)log;
    return make(environment, false, true);
}
void fmi3FreeInstance(fmi3Instance I) { free(I); }

#define OK(function, parameters, ...)                \
    fmi3Status function parameters                   \
    {                                                \
        Instance *I = (Instance *)c;                 \
        (void)I;                                     \
        __VA_ARGS__;                                 \
        return fmi3OK;                               \
    }
OK(fmi3EnterInitializationMode, (fmi3Instance c, fmi3Boolean a, fmi3Float64 b, fmi3Float64 start, fmi3Boolean e, fmi3Float64 f),
   (void)a, (void)b, (void)e, (void)f; I->time = I->start = start; outputs(I))
OK(fmi3ExitInitializationMode, (fmi3Instance c), begin(I); fresh(I))
OK(fmi3EnterConfigurationMode, (fmi3Instance c), (void)I)
OK(fmi3ExitConfigurationMode, (fmi3Instance c), (void)I)
OK(fmi3EnterEventMode, (fmi3Instance c), (void)I)
OK(fmi3EnterStepMode, (fmi3Instance c), fresh(I))
OK(fmi3EnterContinuousTimeMode, (fmi3Instance c), I->changed = false)
OK(fmi3Terminate, (fmi3Instance c), (void)I)
OK(fmi3Reset, (fmi3Instance c), I->d = initial; I->next = INFINITY; I->steps = 0; I->changed = I->end = false)
OK(fmi3SetTime, (fmi3Instance c, fmi3Float64 time), I->time = time; outputs(I))
OK(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 *x, size_t n),
   memcpy(STATES(I), x, n * sizeof *x); outputs(I))
OK(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 *x, size_t n), memcpy(x, STATES(I), n * sizeof *x))
OK(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 *x, size_t n), outputs(I); memcpy(x, RATES(I), n * sizeof *x))
OK(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 *x, size_t n), while (n--) x[n] = 1.0)
OK(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 *z, size_t n), (void)n; indicators(I, z))
OK(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *n), *n = NX(I))
OK(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *n), *n = NZ)
OK(fmi3CompletedIntegratorStep, (fmi3Instance c, fmi3Boolean a, fmi3Boolean *enter, fmi3Boolean *end),
   (void)a; *enter = *end = false)
OK(fmi3UpdateDiscreteStates, (fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
   fmi3Boolean *changed, fmi3Boolean *defined, fmi3Float64 *next),
   event(I); *again = *nominals = false; *end = I->end; *changed = I->changed;
   *defined = isfinite(I->next); *next = I->next; fresh(I))
OK(fmi3GetFMUState, (fmi3Instance c, fmi3FMUState *s), if (!*s) *s = malloc(sizeof *I); memcpy(*s, I, sizeof *I))
OK(fmi3SetFMUState, (fmi3Instance c, fmi3FMUState s), memcpy(I, s, sizeof *I))
OK(fmi3FreeFMUState, (fmi3Instance c, fmi3FMUState *s), free(*s); *s = NULL)

#define VALUES(name, kind)                                                                                            \
    fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference *r, size_t n, fmi3##name *x, size_t m)          \
    {                                                                                                                 \
        (void)m;                                                                                                      \
        outputs(c);                                                                                                   \
        return copy(c, false, kind, sizeof *x, r, n, (char *)x);                                                      \
    }                                                                                                                 \
    fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference *r, size_t n, const fmi3##name *x, size_t m)    \
    {                                                                                                                 \
        (void)m;                                                                                                      \
        return copy(c, true, kind, sizeof *x, r, n, (char *)x);                                                       \
    }
VALUES(Float64, FLOAT64)
VALUES(Float32, FLOAT32)
VALUES(Int8, INT8)
VALUES(UInt8, UINT8)
VALUES(Int16, INT16)
VALUES(UInt16, UINT16)
VALUES(Int32, INT32)
VALUES(UInt32, UINT32)
VALUES(Int64, INT64)
VALUES(UInt64, UINT64)
VALUES(Boolean, BOOLEAN)

static Text *text(Instance *I, unsigned vr, int type) { return (Text *)((char *)&I->d + find(vr, type)->place); }
OK(fmi3GetString, (fmi3Instance c, const fmi3ValueReference *r, size_t n, fmi3String *x, size_t m),
   (void)m; outputs(I); while (n--) x[n] = text(I, r[n], STRING)->bytes)
OK(fmi3SetString, (fmi3Instance c, const fmi3ValueReference *r, size_t n, const fmi3String *x, size_t m),
   (void)m; while (n--) strncpy(text(I, r[n], STRING)->bytes, x[n], 63))
OK(fmi3GetBinary, (fmi3Instance c, const fmi3ValueReference *r, size_t n, size_t *sizes, fmi3Binary *x, size_t m),
   (void)m; outputs(I); while (n--) { Text *t = text(I, r[n], BINARY); x[n] = (fmi3Byte *)t->bytes; sizes[n] = t->size; })
OK(fmi3SetBinary, (fmi3Instance c, const fmi3ValueReference *r, size_t n, const size_t *sizes, const fmi3Binary *x, size_t m),
   (void)m; while (n--) { Text *t = text(I, r[n], BINARY); memcpy(t->bytes, x[n], t->size = sizes[n]); })

/* ---------------------------------------------------------------- clocks: an interval is set beside each, in seconds */

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference *r, size_t n, fmi3Clock *x)
{
    outputs(c);
    return copy(c, false, CLOCK, sizeof *x, r, n, (char *)x);
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference *r, size_t n, const fmi3Clock *x)
{
    return copy(c, true, CLOCK, sizeof *x, r, n, (char *)x);
}
OK(fmi3GetIntervalDecimal, (fmi3Instance c, const fmi3ValueReference *r, size_t n, fmi3Float64 *x, fmi3IntervalQualifier *q),
   for (size_t k = 0; k < n; k++) {
       double *interval = (double *)((char *)&I->d + find(r[k], CLOCK)->place + sizeof(double));
       q[k] = isnan(*interval) ? fmi3IntervalUnchanged : fmi3IntervalChanged;
       x[k] = *interval;
       *interval = NAN;
   })

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference *u, size_t n, const fmi3ValueReference *k,
                                        size_t m, const fmi3Float64 *seed, size_t ns, fmi3Float64 *x, size_t nx)
{
    (void)ns, (void)nx;
    return differentiate(c, u, n, k, m, seed, x);
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference *r, size_t n, const fmi3Int32 *order,
                                    fmi3Float64 *x, size_t nx)
{
    (void)order, (void)nx;
    return rates(c, r, n, x);
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean keep, fmi3Boolean *needed, fmi3Boolean *end,
                      fmi3Boolean *early, fmi3Float64 *last)
{
    Instance *I = c;
    (void)keep;
    *needed = advance(I, time + h);
    *early = *needed; /* at the end of the step too, as the Reference FMUs have it */
    *last = *early ? I->time : time + h;
    *end = I->end;
    return fmi3OK;
}
#endif
