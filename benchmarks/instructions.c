/* Let the arm of an FMU 2.0 fall: ./fall LIBRARY GUID MILLISECONDS. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#define FUNCTION(type, name) type *const name = (type *)dlsym(library, #name)

int main(int count, char **argument)
{
    void *library = count > 3 ? dlopen(argument[1], RTLD_NOW) : NULL;
    if (!library)
        return 1;
    FUNCTION(fmi2InstantiateTYPE, fmi2Instantiate);
    FUNCTION(fmi2SetupExperimentTYPE, fmi2SetupExperiment);
    FUNCTION(fmi2EnterInitializationModeTYPE, fmi2EnterInitializationMode);
    FUNCTION(fmi2ExitInitializationModeTYPE, fmi2ExitInitializationMode);
    FUNCTION(fmi2DoStepTYPE, fmi2DoStep);
    const fmi2CallbackFunctions callbacks = {.allocateMemory = calloc, .freeMemory = free};
    fmi2Component arm = fmi2Instantiate("arm", fmi2CoSimulation, argument[2], "", &callbacks, fmi2False, fmi2False);
    if (!arm || fmi2SetupExperiment(arm, fmi2False, 0.0, 0.0, fmi2False, 0.0) || fmi2EnterInitializationMode(arm) ||
        fmi2ExitInitializationMode(arm))
        return 1;
    for (int k = 0; k < atoi(argument[3]); k++)
        if (fmi2DoStep(arm, k * 1e-3, 1e-3, fmi2True))
            return 1;
    return 0;
}
