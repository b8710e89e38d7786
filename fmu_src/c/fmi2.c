/* The functions of FMI 2.0, co-simulation and model exchange. */
#include "config.h"

#include <fmi2Functions.h>
#include <stdlib.h>
#include <string.h>

#include "derivative.h"
#include "exchange.h"
#include "instance.h"
#include "state.h"
#include "step.h"
#include "values.h"

/* Every function with an instance starts so. */
#define ENTER(name)                \
    Instance *const I = c;         \
    if (!I)                        \
        return fmi2Error;          \
    I->call = name

#define RETURN(status) return (fmi2Status)(status)

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

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
    ENTER("setDebugLogging");
    RETURN(set_debug_logging(I, loggingOn != 0, nCategories, categories));
}

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

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    ENTER("enterInitializationMode");
    RETURN(enter_initialization(I, NULL));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    ENTER("exitInitializationMode");
    RETURN(exit_initialization(I));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    ENTER("terminate");
    RETURN(terminate(I));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    ENTER("reset");
    RETURN(reset(I));
}

/* ---------------------------------------------------------------- values */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    ENTER("getReal");
    RETURN(get_reals(I, vr, nvr, value, nvr));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    ENTER("getInteger");
    RETURN(get_integers(I, vr, nvr, value, nvr));
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    ENTER("getBoolean");
    RETURN(get_booleans(I, vr, nvr, value, nvr));
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)value;
    ENTER("getString");
    RETURN(no_such_type(I, "String", vr, nvr));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    ENTER("setReal");
    RETURN(set_reals(I, vr, nvr, value, nvr));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    ENTER("setInteger");
    RETURN(set_integers(I, vr, nvr, value, nvr));
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    ENTER("setBoolean");
    RETURN(set_booleans(I, vr, nvr, value, nvr));
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)value;
    ENTER("setString");
    RETURN(no_such_type(I, "String", vr, nvr));
}

/* ---------------------------------------------------------------- saved states */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ENTER("getFMUstate");
    RETURN(state_get(I, FMUstate));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    ENTER("setFMUstate");
    RETURN(state_set(I, FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ENTER("freeFMUstate");
    RETURN(state_free(I, FMUstate));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    ENTER("serializedFMUstateSize");
    RETURN(state_size(I, FMUstate, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    ENTER("serializeFMUstate");
    RETURN(state_to_bytes(I, FMUstate, (unsigned char *)serializedState, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate)
{
    ENTER("deSerializeFMUstate");
    RETURN(state_from_bytes(I, (const unsigned char *)serializedState, size, FMUstate));
}

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

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    ENTER("enterEventMode");
    RETURN(enter_event_mode(I));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    ENTER("newDiscreteStates");
    const Status status = check_event_iteration(I, fmi2eventInfo != NULL);
    if (status == STATUS_OK)
        *fmi2eventInfo = (fmi2EventInfo){0};
    RETURN(status);
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    ENTER("enterContinuousTimeMode");
    RETURN(enter_continuous_time_mode(I));
}

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

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ENTER("setTime");
    RETURN(set_time(I, time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    ENTER("setContinuousStates");
    RETURN(set_states(I, x, nx));
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    ENTER("getDerivatives");
    RETURN(get_derivatives(I, derivatives, nx));
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    (void)eventIndicators;
    ENTER("getEventIndicators");
    RETURN(get_event_indicators(I, ni));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    ENTER("getContinuousStates");
    RETURN(get_states(I, x, nx));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    ENTER("getNominalsOfContinuousStates");
    RETURN(get_nominals(I, x_nominal, nx));
}

/* ---------------------------------------------------------------- co-simulation */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    ENTER("setRealInputDerivatives");
    RETURN(set_input_rates(I, vr, nvr, order, value));
}

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

fmi2Status fmi2CancelStep(fmi2Component c)
{
    ENTER("cancelStep");
    RETURN(fail(I, "there is no step to cancel: doStep returns when the step is done."));
}

/* Steps are never pending, so there is nothing to ask for. */
static fmi2Status no_status(fmi2Component c, const char *call)
{
    ENTER(call);
    RETURN(discard(I, "there is no status: doStep returns when the step is done, and tells by its own status how it went."));
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s, (void)value;
    return no_status(c, "getStatus");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    (void)s, (void)value;
    return no_status(c, "getRealStatus");
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s, (void)value;
    return no_status(c, "getIntegerStatus");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    (void)s, (void)value;
    return no_status(c, "getBooleanStatus");
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s, (void)value;
    return no_status(c, "getStringStatus");
}
