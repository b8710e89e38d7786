/* The methods that both interfaces of the draft have; included for each, with INTERFACE, RESOURCE and NAME. */
__attribute__((import_module("[export]" INTERFACE), import_name("[resource-new]" RESOURCE)))
int32_t NAME(new)(Resource *u);

EXPORT("[dtor]" RESOURCE) void NAME(free)(Resource *u)
{
    fmi3FreeInstance(u->fmi);
    free(u);
}

PLAIN("exit-initialization-mode", ExitInitializationMode)
PLAIN("enter-event-mode", EnterEventMode)
PLAIN("terminate", Terminate)
PLAIN("reset", Reset)
PLAIN("enter-configuration-mode", EnterConfigurationMode)
PLAIN("exit-configuration-mode", ExitConfigurationMode)
PLAIN("evaluate-discrete-states", EvaluateDiscreteStates)
PLAIN("enter-step-mode", EnterStepMode)

METHOD("enter-initialization-mode")
int32_t NAME(initialize)(Resource *u, int32_t has_tolerance, double tolerance, double start, int32_t has_stop, double stop)
{
    return ended(fmi3EnterInitializationMode(u->fmi, has_tolerance, tolerance, start, has_stop, stop));
}

METHOD("set-debug-logging") int32_t NAME(log)(Resource *u, int32_t on, const String *categories, size_t n)
{
    return set_logging(u, on, categories, n);
}

VALUES("float32", Float32)
VALUES("float64", Float64)
VALUES("int8", Int8)
VALUES("int16", Int16)
VALUES("int32", Int32)
VALUES("int64", Int64)
VALUES("uint8", UInt8)
VALUES("uint16", UInt16)
VALUES("uint32", UInt32)
VALUES("uint64", UInt64)
VALUES("boolean", Boolean)

NO_GET("get-string", GetString, NULL, 0)
NO_SET("set-string", SetString, NULL, 0)
NO_GET("get-binary", GetBinary, NULL, NULL, 0)
NO_SET("set-binary", SetBinary, NULL, NULL, 0)
NO_GET("get-clock", GetClock, NULL)
NO_SET("set-clock", SetClock, NULL)
NO_GET("get-interval-decimal", GetIntervalDecimal, NULL, NULL)
NO_SET("set-interval-decimal", SetIntervalDecimal, NULL)
NO_GET("get-interval-fraction", GetIntervalFraction, NULL, NULL, NULL)
NO_SET("set-interval-fraction", SetIntervalFraction, NULL, NULL)
NO_GET("get-shift-decimal", GetShiftDecimal, NULL)
NO_SET("set-shift-decimal", SetShiftDecimal, NULL)
NO_GET("get-shift-fraction", GetShiftFraction, NULL, NULL)
NO_SET("set-shift-fraction", SetShiftFraction, NULL, NULL)
NO_GET("get-output-derivatives", GetOutputDerivatives, NULL, NULL, 0)

DERIVATIVE("get-directional-derivative", GetDirectionalDerivative, unknowns)
DERIVATIVE("get-adjoint-derivative", GetAdjointDerivative, knowns)

METHOD("get-number-of-variable-dependencies") void *NAME(number)(Resource *u, fmi3ValueReference ref)
{
    size_t n = 0;
    return whole(fmi3GetNumberOfVariableDependencies(u->fmi, ref, &n), n);
}

METHOD("get-variable-dependencies") void *NAME(dependencies)(Resource *u, fmi3ValueReference ref)
{
    return dependencies(u, ref);
}

METHOD("get-fmu-state") void *NAME(get_state)(Resource *u)
{
    return saved(u);
}

METHOD("set-fmu-state") int32_t NAME(set_state)(Resource *u, const fmi3Byte *bytes, size_t n)
{
    return restored(u, bytes, n);
}

METHOD("update-discrete-states") void *NAME(update)(Resource *u)
{
    RESULT(struct { bool again, ends, nominals, values, defined; double next; });
    return settle(fmi3UpdateDiscreteStates(u->fmi, &r.value.again, &r.value.ends, &r.value.nominals, &r.value.values,
                                           &r.value.defined, &r.value.next), &r.failed, &r.status);
}
