/* The functions of FMI 2.0, co-simulation and model exchange. */
#include "config.h"

#include <fmi2Functions.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "derivative.h"
#include "exchange.h"
#include "instance.h"
#include "processor.h"
#include "state.h"
#include "step.h"
#include "values.h"

/* Every function with an instance starts and ends so. */
#define ENTER(name)                                     \
    Instance *const I = c;                              \
    if (!I)                                             \
        return fmi2Error;                               \
    const uint64_t arithmetic = use_usual_arithmetic(); \
    I->call = name

#define RETURN(status)                  \
    do {                                \
        const Status result = (status); \
        restore_arithmetic(arithmetic); \
        return (fmi2Status)result;      \
    } while (0)

/* A function that passes its arguments on. */
#define CALL(function, name, arguments, action) \
    fmi2Status function arguments               \
    {                                           \
        ENTER(name);                            \
        RETURN(action);                         \
    }

/* ---------------------------------------------------------------- importer */

/* The text is the format of the importer's logger: '%' is doubled. */
static void log_message(const Host *host, const char *name, Status status, const char *category, const char *text)
{
    const fmi2CallbackLogger logger = (fmi2CallbackLogger)host->logger;
    if (!logger)
        return;
    char *escaped = malloc(2 * strlen(text) + 1);
    if (!escaped)
        return;
    char *to = escaped;
    for (const char *from = text; *from; from++) {
        *to++ = *from;
        if (*from == '%')
            *to++ = '%';
    }
    *to = '\0';
    logger(host->environment, name, (fmi2Status)status, category, escaped);
    free(escaped);
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return "2.0";
}

CALL(fmi2SetDebugLogging, "setDebugLogging",
     (fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[]),
     set_debug_logging(I, loggingOn != 0, nCategories, categories))

/* ---------------------------------------------------------------- life cycle */

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
    (void)fmuResourceLocation;
    (void)visible;
    if (!functions)
        return NULL;
    const Host host = {
        .environment = functions->componentEnvironment,
        .log = log_message,
        .logger = (void (*)(void))functions->logger,
        .type_names = {"Real", "Integer", "Boolean"},
        .logged = logged_at_start(loggingOn != 0),
    };
    const Kind kind = fmuType == fmi2CoSimulation ? CO_SIMULATION : fmuType == fmi2ModelExchange ? MODEL_EXCHANGE : NO_KIND;
    return instance_new(&host, "instantiate", instanceName, fmuGUID, kind);
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *const I = c;
    if (I)
        I->call = "freeInstance";
    instance_free(I);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    ENTER("setupExperiment");
    RETURN(setup_experiment(I, &(Experiment){.tolerance_defined = toleranceDefined != 0, .tolerance = tolerance,
                                             .start_time = startTime, .stop_time_defined = stopTimeDefined != 0,
                                             .stop_time = stopTime}));
}

CALL(fmi2EnterInitializationMode, "enterInitializationMode", (fmi2Component c), enter_initialization(I, NULL))
CALL(fmi2ExitInitializationMode, "exitInitializationMode", (fmi2Component c), exit_initialization(I))
CALL(fmi2Terminate, "terminate", (fmi2Component c), terminate(I))
CALL(fmi2Reset, "reset", (fmi2Component c), reset(I))

/* ---------------------------------------------------------------- values */

CALL(fmi2GetReal, "getReal", (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]),
     get_reals(I, vr, nvr, value, nvr))
CALL(fmi2GetInteger, "getInteger", (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]),
     get_integers(I, vr, nvr, value, nvr))
CALL(fmi2GetBoolean, "getBoolean", (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]),
     get_booleans(I, vr, nvr, value, nvr))

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)value;
    ENTER("getString");
    RETURN(no_such_type(I, "String", vr, nvr));
}

CALL(fmi2SetReal, "setReal", (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]),
     set_reals(I, vr, nvr, value, nvr))
CALL(fmi2SetInteger, "setInteger",
     (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[]),
     set_integers(I, vr, nvr, value, nvr))
CALL(fmi2SetBoolean, "setBoolean",
     (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]),
     set_booleans(I, vr, nvr, value, nvr))

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)value;
    ENTER("setString");
    RETURN(no_such_type(I, "String", vr, nvr));
}

/* ---------------------------------------------------------------- saved states */

CALL(fmi2GetFMUstate, "getFMUstate", (fmi2Component c, fmi2FMUstate *FMUstate), state_get(I, FMUstate))
CALL(fmi2SetFMUstate, "setFMUstate", (fmi2Component c, fmi2FMUstate FMUstate), state_set(I, FMUstate))
CALL(fmi2FreeFMUstate, "freeFMUstate", (fmi2Component c, fmi2FMUstate *FMUstate), state_free(I, FMUstate))
CALL(fmi2SerializedFMUstateSize, "serializedFMUstateSize", (fmi2Component c, fmi2FMUstate FMUstate, size_t *size),
     state_size(I, FMUstate, size))
CALL(fmi2SerializeFMUstate, "serializeFMUstate",
     (fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size),
     state_to_bytes(I, FMUstate, (unsigned char *)serializedState, size))
CALL(fmi2DeSerializeFMUstate, "deSerializeFMUstate",
     (fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate),
     state_from_bytes(I, (const unsigned char *)serializedState, size, FMUstate))

/* ---------------------------------------------------------------- derivatives */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    ENTER("getDirectionalDerivative");
    RETURN(directional_derivative(I, &(Direction){.unknowns = vUnknown_ref, .n_unknowns = nUnknown, .knowns = vKnown_ref,
                                                  .n_knowns = nKnown, .seed = dvKnown, .n_seed = nKnown,
                                                  .sensitivity = dvUnknown, .n_sensitivity = nUnknown}));
}

/* ---------------------------------------------------------------- model exchange */

CALL(fmi2EnterEventMode, "enterEventMode", (fmi2Component c), enter_event_mode(I))

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    ENTER("newDiscreteStates");
    double next;
    bool changed;
    const Status status = update_discrete_states(I, fmi2eventInfo != NULL, &next, &changed);
    if (status == STATUS_OK)
        *fmi2eventInfo = (fmi2EventInfo){.valuesOfContinuousStatesChanged = changed,
                                         .nextEventTimeDefined = isfinite(next), .nextEventTime = isfinite(next) ? next : 0.0};
    RETURN(status);
}

CALL(fmi2EnterContinuousTimeMode, "enterContinuousTimeMode", (fmi2Component c), enter_continuous_time_mode(I))

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER("completedIntegratorStep");
    const Status status = check_integrator_step(I, enterEventMode && terminateSimulation);
    if (status == STATUS_OK)
        *enterEventMode = *terminateSimulation = fmi2False;
    RETURN(status);
}

CALL(fmi2SetTime, "setTime", (fmi2Component c, fmi2Real time), set_time(I, time))
CALL(fmi2SetContinuousStates, "setContinuousStates", (fmi2Component c, const fmi2Real x[], size_t nx),
     set_states(I, x, nx))
CALL(fmi2GetDerivatives, "getDerivatives", (fmi2Component c, fmi2Real derivatives[], size_t nx),
     get_derivatives(I, derivatives, nx))

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    ENTER("getEventIndicators");
    RETURN(get_event_indicators(I, eventIndicators, ni));
}

CALL(fmi2GetContinuousStates, "getContinuousStates", (fmi2Component c, fmi2Real x[], size_t nx), get_states(I, x, nx))
CALL(fmi2GetNominalsOfContinuousStates, "getNominalsOfContinuousStates",
     (fmi2Component c, fmi2Real x_nominal[], size_t nx), get_nominals(I, x_nominal, nx))

/* ---------------------------------------------------------------- co-simulation */

CALL(fmi2SetRealInputDerivatives, "setRealInputDerivatives",
     (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], const fmi2Real value[]),
     set_input_rates(I, vr, nvr, order, value))

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[])
{
    (void)vr, (void)nvr, (void)order, (void)value;
    ENTER("getRealOutputDerivatives");
    RETURN(get_output_rates(I));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER("doStep");
    RETURN(do_step(I, currentCommunicationPoint, communicationStepSize, NULL));
}

CALL(fmi2CancelStep, "cancelStep", (fmi2Component c),
     fail(I, "there is no step to cancel: doStep returns when the step is done."))

/* Steps are never pending, so there is nothing to ask for. */
static fmi2Status no_status(fmi2Component c, const char *call)
{
    ENTER(call);
    RETURN(discard(I, "there is no status: doStep returns when the step is done, and its own status says how it went."));
}

#define NO_STATUS(name, type)                                                                 \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind s, type *value)            \
    {                                                                                         \
        (void)s, (void)value;                                                                 \
        return no_status(c, "get" #name);                                                     \
    }

NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)
