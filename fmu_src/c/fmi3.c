/* The functions of FMI 3.0, co-simulation and model exchange. */
#include "config.h"

#include <fmi3Functions.h>
#include <math.h>
#include <stdlib.h>

#include "derivative.h"
#include "exchange.h"
#include "instance.h"
#include "processor.h"
#include "state.h"
#include "step.h"
#include "values.h"

/* Every function with an instance starts and ends so. */
#define ENTER(name)                                     \
    Instance *const I = instance;                       \
    if (!I)                                             \
        return fmi3Error;                               \
    const uint64_t arithmetic = use_usual_arithmetic(); \
    I->call = name

#define RETURN(status)                  \
    do {                                \
        const Status result = (status); \
        restore_arithmetic(arithmetic); \
        return (fmi3Status)result;      \
    } while (0)

/* A function that passes its arguments on. */
#define CALL(function, name, arguments, action) \
    fmi3Status function arguments               \
    {                                           \
        ENTER(name);                            \
        RETURN(action);                         \
    }

/* ---------------------------------------------------------------- importer */

static void log_message(const Host *host, const char *name, Status status, const char *category, const char *text)
{
    (void)name;
    const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)host->logger;
    if (logger)
        logger(host->environment, (fmi3Status)status, category, text);
}

static void tell_update(const Host *host, Update *u)
{
    const fmi3IntermediateUpdateCallback update = (fmi3IntermediateUpdateCallback)host->intermediate;
    fmi3Boolean requested = fmi3False;
    update(host->environment, u->time, u->set_requested, fmi3True, fmi3True, u->can_return_early, &requested, &u->return_time);
    u->return_requested = requested;
}

static Host host_of(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, fmi3Boolean logs)
{
    return (Host){
        .environment = environment,
        .log = log_message,
        .logger = (void (*)(void))logger,
        .type_names = {"Float64", "Int32", "Boolean"},
        .arrays = true,
        .logged = logged_at_start(logs),
    };
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

CALL(fmi3SetDebugLogging, "setDebugLogging",
     (fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[]),
     set_debug_logging(I, loggingOn, nCategories, categories))

/* ---------------------------------------------------------------- life cycle */

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                          fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage)
{
    (void)resourcePath, (void)visible;
    const Host host = host_of(instanceEnvironment, logMessage, loggingOn);
    return instance_new(&host, "instantiateModelExchange", instanceName, instantiationToken, MODEL_EXCHANGE);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                         fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)resourcePath, (void)visible;
    Host host = host_of(instanceEnvironment, logMessage, loggingOn);
    host.early_return_allowed = earlyReturnAllowed;
    host.intermediate = (void (*)(void))intermediateUpdate;
    host.update = intermediateUpdate ? tell_update : NULL;
    Instance *I = instance_new(&host, "instantiateCoSimulation", instanceName, instantiationToken, CO_SIMULATION);
    if (!I)
        return NULL;
    bool fits = true;
    if (eventModeUsed)
        fits = fail(I, "expected eventModeUsed = false, got true: this unit has no event mode in co-simulation.") == STATUS_OK;
    else if (nRequiredIntermediateVariables && !requiredIntermediateVariables)
        fits = fail_null(I, "an array of intermediate variables") == STATUS_OK;
    for (size_t k = 0; fits && k < nRequiredIntermediateVariables; k++)
        if (!size_of(I, requiredIntermediateVariables[k]))
            fits = fail_reference(I, requiredIntermediateVariables[k]) == STATUS_OK;
    if (fits)
        return I;
    instance_free(I);
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                               fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)resourcePath, (void)visible, (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    const Host host = host_of(instanceEnvironment, logMessage, loggingOn);
    Instance *I = instance_new(&host, "instantiateScheduledExecution", instanceName, instantiationToken, CO_SIMULATION);
    if (I)
        fail(I, "%s has no clocks and cannot be executed by a schedule.", unit.name);
    instance_free(I);
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    Instance *const I = instance;
    if (I)
        I->call = "freeInstance";
    instance_free(I);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    ENTER("enterInitializationMode");
    RETURN(enter_initialization(I, &(Experiment){.tolerance_defined = toleranceDefined, .tolerance = tolerance,
                                                 .start_time = startTime, .stop_time_defined = stopTimeDefined,
                                                 .stop_time = stopTime}));
}

CALL(fmi3ExitInitializationMode, "exitInitializationMode", (fmi3Instance instance), exit_initialization(I))
CALL(fmi3EnterConfigurationMode, "enterConfigurationMode", (fmi3Instance instance), refuse_configuration(I))
CALL(fmi3ExitConfigurationMode, "exitConfigurationMode", (fmi3Instance instance), refuse_configuration(I))
CALL(fmi3EnterEventMode, "enterEventMode", (fmi3Instance instance), enter_event_mode(I))
CALL(fmi3EnterContinuousTimeMode, "enterContinuousTimeMode", (fmi3Instance instance), enter_continuous_time_mode(I))
CALL(fmi3EnterStepMode, "enterStepMode", (fmi3Instance instance),
     fail(I, "this unit has no event mode in co-simulation to return from."))
CALL(fmi3Terminate, "terminate", (fmi3Instance instance), terminate(I))
CALL(fmi3Reset, "reset", (fmi3Instance instance), reset(I))
CALL(fmi3EvaluateDiscreteStates, "evaluateDiscreteStates", (fmi3Instance instance), check_event_iteration(I, true))

/* ---------------------------------------------------------------- values */

#define REFERENCES fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences

#define VARIABLES(name, type, getter, setter)                                           \
    CALL(fmi3Get##name, "get" #name, (REFERENCES, type values[], size_t nValues),       \
         getter(I, valueReferences, nValueReferences, values, nValues))                 \
    CALL(fmi3Set##name, "set" #name, (REFERENCES, const type values[], size_t nValues), \
         setter(I, valueReferences, nValueReferences, values, nValues))

VARIABLES(Float64, fmi3Float64, get_reals, set_reals)
VARIABLES(Int32, fmi3Int32, get_integers, set_integers)
VARIABLES(Boolean, fmi3Boolean, get_bools, set_bools)

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* Types that no variable has. */
#define NONE(function, name, type, arguments) \
    CALL(function, name, arguments, no_such_type(I, type, valueReferences, nValueReferences))

#define NO_VARIABLES(name, type)                                                                 \
    NONE(fmi3Get##name, "get" #name, #name, (REFERENCES, type values[], size_t nValues))         \
    NONE(fmi3Set##name, "set" #name, #name, (REFERENCES, const type values[], size_t nValues))

NO_VARIABLES(Float32, fmi3Float32)
NO_VARIABLES(Int8, fmi3Int8)
NO_VARIABLES(UInt8, fmi3UInt8)
NO_VARIABLES(Int16, fmi3Int16)
NO_VARIABLES(UInt16, fmi3UInt16)
NO_VARIABLES(UInt32, fmi3UInt32)
NO_VARIABLES(Int64, fmi3Int64)
NO_VARIABLES(UInt64, fmi3UInt64)
NO_VARIABLES(String, fmi3String)
NONE(fmi3GetBinary, "getBinary", "Binary", (REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues))
NONE(fmi3SetBinary, "setBinary", "Binary", (REFERENCES, const size_t valueSizes[], const fmi3Binary values[], size_t nValues))

NONE(fmi3GetClock, "getClock", "Clock", (REFERENCES, fmi3Clock values[]))
NONE(fmi3SetClock, "setClock", "Clock", (REFERENCES, const fmi3Clock values[]))
NONE(fmi3GetIntervalDecimal, "getIntervalDecimal", "Clock",
     (REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]))
NONE(fmi3GetIntervalFraction, "getIntervalFraction", "Clock",
     (REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]))
NONE(fmi3GetShiftDecimal, "getShiftDecimal", "Clock", (REFERENCES, fmi3Float64 shifts[]))
NONE(fmi3GetShiftFraction, "getShiftFraction", "Clock", (REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[]))
NONE(fmi3SetIntervalDecimal, "setIntervalDecimal", "Clock", (REFERENCES, const fmi3Float64 intervals[]))
NONE(fmi3SetIntervalFraction, "setIntervalFraction", "Clock",
     (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))
NONE(fmi3SetShiftDecimal, "setShiftDecimal", "Clock", (REFERENCES, const fmi3Float64 shifts[]))
NONE(fmi3SetShiftFraction, "setShiftFraction", "Clock",
     (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))

CALL(fmi3ActivateModelPartition, "activateModelPartition",
     (fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime),
     fail(I, "%s has no clocks and cannot be executed by a schedule.", unit.name))

CALL(fmi3GetOutputDerivatives, "getOutputDerivatives",
     (REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues), get_output_rates(I))

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

/* ---------------------------------------------------------------- dependencies, derivatives */

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference valueReference, size_t *nDependencies)
{
    ENTER("getNumberOfVariableDependencies");
    RETURN(count_dependencies(I, valueReference, nDependencies));
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    ENTER("getVariableDependencies");
    const Status status = get_dependencies(I, dependent, elementIndicesOfDependent, independents, elementIndicesOfIndependents,
                                           dependencyKinds != NULL, nDependencies);
    for (size_t k = 0; status == STATUS_OK && k < nDependencies; k++)
        dependencyKinds[k] = fmi3Dependent;
    RETURN(status);
}

#define DERIVATIVE(function, name, action)                                                                              \
    fmi3Status function(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,                   \
                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,      \
                        fmi3Float64 sensitivity[], size_t nSensitivity)                                                 \
    {                                                                                                                   \
        ENTER(name);                                                                                                    \
        RETURN(action(I, &(Direction){.unknowns = unknowns, .n_unknowns = nUnknowns, .knowns = knowns,                  \
                                      .n_knowns = nKnowns, .seed = seed, .n_seed = nSeed, .sensitivity = sensitivity,   \
                                      .n_sensitivity = nSensitivity}));                                                 \
    }

DERIVATIVE(fmi3GetDirectionalDerivative, "getDirectionalDerivative", directional_derivative)
DERIVATIVE(fmi3GetAdjointDerivative, "getAdjointDerivative", adjoint_derivative)

/* ---------------------------------------------------------------- saved states */

CALL(fmi3GetFMUState, "getFMUState", (fmi3Instance instance, fmi3FMUState *FMUState), state_get(I, FMUState))
CALL(fmi3SetFMUState, "setFMUState", (fmi3Instance instance, fmi3FMUState FMUState), state_set(I, FMUState))
CALL(fmi3FreeFMUState, "freeFMUState", (fmi3Instance instance, fmi3FMUState *FMUState), state_free(I, FMUState))
CALL(fmi3SerializedFMUStateSize, "serializedFMUStateSize", (fmi3Instance instance, fmi3FMUState FMUState, size_t *size),
     state_size(I, FMUState, size))
CALL(fmi3SerializeFMUState, "serializeFMUState",
     (fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size),
     state_to_bytes(I, FMUState, serializedState, size))
CALL(fmi3DeserializeFMUState, "deserializeFMUState",
     (fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState),
     state_from_bytes(I, serializedState, size, FMUState))

/* ---------------------------------------------------------------- model exchange */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    ENTER("updateDiscreteStates");
    double next;
    bool changed;
    const Status status =
        update_discrete_states(I, discreteStatesNeedUpdate && terminateSimulation && nominalsOfContinuousStatesChanged &&
                                      valuesOfContinuousStatesChanged && nextEventTimeDefined && nextEventTime, &next, &changed);
    if (status == STATUS_OK) {
        *discreteStatesNeedUpdate = *terminateSimulation = *nominalsOfContinuousStatesChanged = fmi3False;
        *valuesOfContinuousStatesChanged = changed;
        *nextEventTimeDefined = isfinite(next);
        *nextEventTime = isfinite(next) ? next : 0.0;
    }
    RETURN(status);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER("completedIntegratorStep");
    const Status status = check_integrator_step(I, enterEventMode && terminateSimulation);
    if (status == STATUS_OK)
        *enterEventMode = *terminateSimulation = fmi3False;
    RETURN(status);
}

CALL(fmi3SetTime, "setTime", (fmi3Instance instance, fmi3Float64 time), set_time(I, time))
CALL(fmi3SetContinuousStates, "setContinuousStates",
     (fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nContinuousStates),
     set_states(I, continuousStates, nContinuousStates))
CALL(fmi3GetContinuousStateDerivatives, "getContinuousStateDerivatives",
     (fmi3Instance instance, fmi3Float64 derivatives[], size_t nContinuousStates),
     get_derivatives(I, derivatives, nContinuousStates))

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    ENTER("getEventIndicators");
    RETURN(get_event_indicators(I, eventIndicators, nEventIndicators));
}

CALL(fmi3GetContinuousStates, "getContinuousStates",
     (fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates),
     get_states(I, continuousStates, nContinuousStates))
CALL(fmi3GetNominalsOfContinuousStates, "getNominalsOfContinuousStates",
     (fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates),
     get_nominals(I, nominals, nContinuousStates))
CALL(fmi3GetNumberOfEventIndicators, "getNumberOfEventIndicators", (fmi3Instance instance, size_t *nEventIndicators),
     get_number(I, nEventIndicators, unit.n_events))
CALL(fmi3GetNumberOfContinuousStates, "getNumberOfContinuousStates", (fmi3Instance instance, size_t *nContinuousStates),
     get_number(I, nContinuousStates, unit.n_x))

/* ---------------------------------------------------------------- co-simulation */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER("doStep");
    if (!(eventHandlingNeeded && terminateSimulation && earlyReturn && lastSuccessfulTime))
        RETURN(fail_null(I, "a pointer for each answer"));
    bool early = false;
    const Status status = do_step(I, currentCommunicationPoint, communicationStepSize, &early);
    *eventHandlingNeeded = *terminateSimulation = fmi3False;
    *earlyReturn = early;
    *lastSuccessfulTime = I->m[unit.time];
    RETURN(status);
}
