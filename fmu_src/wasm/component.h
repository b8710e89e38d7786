/* One interface of the draft FMI-LS-WASM as exported functions: a resource whose methods are the functions of FMI 3.0.
 *
 * Included once for each interface, with INTERFACE and RESOURCE, its names there, and NAME, which makes names in C.
 */
#define METHOD(name) __attribute__((export_name(INTERFACE "#[method]" RESOURCE "." name)))

__attribute__((import_module("[export]" INTERFACE), import_name("[resource-new]" RESOURCE)))
int32_t NAME(new)(Resource *u);

__attribute__((export_name(INTERFACE "#[dtor]" RESOURCE)))
void NAME(free)(Resource *u)
{
    fmi3FreeInstance(u->fmi);
    free(u);
}

/* ---------------------------------------------------------------- a status alone */

#define PLAIN(name, function)                \
    METHOD(name) int32_t NAME(function)(Resource *u) \
    {                                        \
        return ended(fmi3##function(u->fmi)); \
    }

PLAIN("exit-initialization-mode", ExitInitializationMode)
PLAIN("enter-event-mode", EnterEventMode)
PLAIN("terminate", Terminate)
PLAIN("reset", Reset)
PLAIN("enter-configuration-mode", EnterConfigurationMode)
PLAIN("exit-configuration-mode", ExitConfigurationMode)
PLAIN("evaluate-discrete-states", EvaluateDiscreteStates)
PLAIN("enter-step-mode", EnterStepMode)

METHOD("set-debug-logging") int32_t NAME(log)(Resource *u, int32_t on, const String *categories, size_t n)
{
    fmi3String *texts = take(n * sizeof *texts);
    for (size_t k = 0; k < n; k++)
        texts[k] = terminated(categories[k].data, categories[k].n);
    return ended(fmi3SetDebugLogging(u->fmi, on, n, texts));
}

METHOD("enter-initialization-mode")
int32_t NAME(initialize)(Resource *u, int32_t tolerance_defined, double tolerance, double start, int32_t stop_defined, double stop)
{
    return ended(fmi3EnterInitializationMode(u->fmi, tolerance_defined, tolerance, start, stop_defined, stop));
}

/* ---------------------------------------------------------------- values */

#define VALUES(name, Type)                                                                                    \
    METHOD("get-" name) void *NAME(Get##Type)(Resource *u, REFS)                                               \
    {                                                                                                         \
        const size_t m = count(u, refs, n);                                                                   \
        fmi3##Type *values = take(m * sizeof *values);                                                        \
        return list(fmi3Get##Type(u->fmi, refs, n, values, m), values, m);                                    \
    }                                                                                                         \
    METHOD("set-" name) int32_t NAME(Set##Type)(Resource *u, REFS, const fmi3##Type *values, size_t n_values)  \
    {                                                                                                         \
        return ended(fmi3Set##Type(u->fmi, refs, n, values, n_values));                                       \
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

/* Types that no variable has. */
#define NO_GET(name, function, ...)                                    \
    METHOD(name) void *NAME(function)(Resource *u, REFS)                \
    {                                                                  \
        return list(fmi3##function(u->fmi, refs, n, __VA_ARGS__), NULL, 0); \
    }
#define NO_SET(name, function, ...)                                                               \
    METHOD(name) int32_t NAME(function)(Resource *u, REFS, const void *values, size_t n_values)    \
    {                                                                                             \
        (void)values, (void)n_values;                                                             \
        return ended(fmi3##function(u->fmi, refs, n, __VA_ARGS__));                               \
    }

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

/* ---------------------------------------------------------------- dependencies, derivatives, states */

METHOD("get-number-of-variable-dependencies") void *NAME(number)(Resource *u, fmi3ValueReference ref)
{
    size_t n = 0;
    return whole(fmi3GetNumberOfVariableDependencies(u->fmi, ref, &n), n);
}

METHOD("get-variable-dependencies") void *NAME(dependencies)(Resource *u, fmi3ValueReference ref)
{
    return dependencies(u, ref);
}

#define DERIVATIVE(name, function, to)                                                                        \
    METHOD(name) void *NAME(function)(Resource *u, const fmi3ValueReference *unknowns, size_t n_unknowns,      \
                                      const fmi3ValueReference *knowns, size_t n_knowns, const double *seed,  \
                                      size_t n_seed)                                                          \
    {                                                                                                         \
        const size_t m = count(u, to, n_##to);                                                                \
        double *found = take(m * sizeof *found);                                                              \
        return list(fmi3##function(u->fmi, unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, found, m), found, m); \
    }

DERIVATIVE("get-directional-derivative", GetDirectionalDerivative, unknowns)
DERIVATIVE("get-adjoint-derivative", GetAdjointDerivative, knowns)

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

#undef METHOD
#undef PLAIN
#undef VALUES
#undef NO_GET
#undef NO_SET
#undef DERIVATIVE
