/* An FMI 2.0 co-simulation unit that does nothing, with the interface of any other: the remaining time is that of its master. */
#include <stddef.h>

#define EMPTY(name) int name(void) { return 0; }

static char instance; /* there is no state, so one serves all */

void *fmi2Instantiate(void) { return &instance; }
void fmi2FreeInstance(void *component) { (void)component; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

EMPTY(fmi2SetDebugLogging)
EMPTY(fmi2SetupExperiment)
EMPTY(fmi2EnterInitializationMode)
EMPTY(fmi2ExitInitializationMode)
EMPTY(fmi2Terminate)
EMPTY(fmi2Reset)
EMPTY(fmi2GetReal)
EMPTY(fmi2GetInteger)
EMPTY(fmi2GetBoolean)
EMPTY(fmi2GetString)
EMPTY(fmi2SetReal)
EMPTY(fmi2SetInteger)
EMPTY(fmi2SetBoolean)
EMPTY(fmi2SetString)
EMPTY(fmi2GetFMUstate)
EMPTY(fmi2SetFMUstate)
EMPTY(fmi2FreeFMUstate)
EMPTY(fmi2SerializedFMUstateSize)
EMPTY(fmi2SerializeFMUstate)
EMPTY(fmi2DeSerializeFMUstate)
EMPTY(fmi2GetDirectionalDerivative)
EMPTY(fmi2SetRealInputDerivatives)
EMPTY(fmi2GetRealOutputDerivatives)
EMPTY(fmi2DoStep)
EMPTY(fmi2CancelStep)
EMPTY(fmi2GetStatus)
EMPTY(fmi2GetRealStatus)
EMPTY(fmi2GetIntegerStatus)
EMPTY(fmi2GetBooleanStatus)
EMPTY(fmi2GetStringStatus)
EMPTY(fmi2EnterEventMode)
EMPTY(fmi2NewDiscreteStates)
EMPTY(fmi2EnterContinuousTimeMode)
EMPTY(fmi2CompletedIntegratorStep)
EMPTY(fmi2SetTime)
EMPTY(fmi2SetContinuousStates)
EMPTY(fmi2GetDerivatives)
EMPTY(fmi2GetEventIndicators)
EMPTY(fmi2GetContinuousStates)
EMPTY(fmi2GetNominalsOfContinuousStates)
