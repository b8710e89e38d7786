/* Calls of fuzz.c that FMI 2.0 and 3.0 have with other arguments, or one of them alone. */
#ifdef FMI3
static Source *updates; /* the input under way, for what happens inside a step */
static Component stepped;

static void intermediate(fmi3InstanceEnvironment environment, double time, bool set_requested, bool get_allowed,
                         bool step_finished, bool can_return_early, bool *return_requested, double *return_time)
{
    (void)set_requested, (void)get_allowed, (void)step_finished;
    require(environment == &slots, "another environment");
    if (take(updates, 4) == 0) {
        Group g = group(updates);
        if (take(updates, 2))
            fmi3GetFloat64(stepped, VALUES(g, g.values));
        else
            fmi3SetFloat64(stepped, VALUES(g, g.values));
    }
    if (take(updates, 8) == 0)
        fmi3Reset(stepped); /* refused: a step is under way */
    *return_requested = can_return_early ? take(updates, 16) == 0 : take(updates, 16) == 1;
    *return_time = take(updates, 4) ? time : any_number(updates);
}
#endif

static Component make(Source *s)
{
    const int exchange = take(s, 3) == 0;
    const char *guid = take(s, 16) ? unit.guid : "{%s}";
    const char *name = take(s, 16) ? "a 100% unit" : "";
    const Boolean logs = (Boolean)take(s, 2);
#ifdef FMI3
    if (exchange)
        return fmi3InstantiateModelExchange(name, guid, NULL, false, logs, &slots, receive);
    const Group g = group(s);
    return fmi3InstantiateCoSimulation(name, guid, NULL, false, logs, take(s, 32) == 0, take(s, 2), g.refs,
                                       take(s, 4) ? 0 : g.n, &slots, receive, take(s, 2) ? intermediate : NULL);
#else
    static const fmi2CallbackFunctions callbacks = {receive, calloc, free, NULL, NULL};
    return fmi2Instantiate(name, exchange ? fmi2ModelExchange : fmi2CoSimulation, guid, NULL, &callbacks, 0, logs);
#endif
}

static int initialize(Source *s, Component c)
{
#ifdef FMI3
    int status = fmi3EnterInitializationMode(c, take(s, 4) == 0, 1e-4, 0.0, 0, 0.0);
#else
    int status = fmi2SetupExperiment(c, (Boolean)(take(s, 4) == 0), 1e-4, 0.0, 0, 0.0);
    if (status == fmi2OK)
        status = fmi2EnterInitializationMode(c);
#endif
    if (status == STATUS_OK && take(s, 4))
        status = FMI(ExitInitializationMode)(c);
    if (status == STATUS_OK && ((const Instance *)c)->kind == MODEL_EXCHANGE && take(s, 2))
        status = FMI(EnterContinuousTimeMode)(c);
    return status;
}

static int step(Source *s, Component c)
{
    static const double size[] = {1e-4, 1e-5, 1e-6, 1e-9, 0.0, -1e-4, NAN, INFINITY};
    const double now = ((const Instance *)c)->m[unit.time];
    const double point = take(s, 8) ? now : any_number(s);
    const double h = size[take(s, 12) % 8];
    const Boolean kept = (Boolean)take(s, 2);
#ifdef FMI3
    bool event, end, early;
    double last;
    updates = s, stepped = c;
    return fmi3DoStep(c, point, h, kept, &event, &end, &early, take(s, 32) ? &last : NULL);
#else
    return fmi2DoStep(c, point, h, kept);
#endif
}

/* Calls that one version has and the other has not, or with other arguments. */
#ifdef FMI3
#define N_CALLS 54
static int own_call(Source *s, Component c, unsigned what)
{
    Group g = group(s), h = group(s);
    double results[ROOM];
    size_t sizes[ROOM] = {0}, others[ROOM] = {0}, n = 0;
    fmi3DependencyKind kinds[ROOM];
    fmi3Binary binaries[ROOM] = {0};
    fmi3String strings[ROOM] = {0};
    Boolean flags[ROOM] = {0};
    const fmi3ValueReference ref = named(any_variable(s));
    switch (what) {
    case 18: flags[0] = take(s, 2); return fmi3SetBoolean(c, VALUES(g, flags));
    case 19: return fmi3GetBoolean(c, VALUES(g, flags));
    case 20: return fmi3GetString(c, VALUES(g, strings));
    case 29: return fmi3GetDirectionalDerivative(c, g.refs, g.n, h.refs, h.n, h.values, h.n_values, results, g.n_values);
    case 33: return fmi3UpdateDiscreteStates(c, flags, flags + 1, flags + 2, flags + 3, flags + 4, take(s, 8) ? results : NULL);
    case 34: return fmi3CompletedIntegratorStep(c, true, flags, take(s, 8) ? flags + 1 : NULL);
    case 2: return fmi3EnterInitializationMode(c, take(s, 2), any_number(s) * 1e-4, any_number(s), take(s, 2), any_number(s));
    case 40: case 41: return fmi3GetAdjointDerivative(c, g.refs, g.n, h.refs, h.n, g.values, g.n_values, results, h.n_values);
    case 42: return fmi3GetNumberOfVariableDependencies(c, ref, take(s, 16) ? &n : NULL);
    case 43: case 44:
        if (fmi3GetNumberOfVariableDependencies(c, ref, &n) != fmi3OK || n >= ROOM || take(s, 8) == 0)
            n = take(s, ROOM);
        return fmi3GetVariableDependencies(c, ref, sizes, h.refs, others, take(s, 16) ? kinds : NULL, n);
    case 45: return fmi3EnterConfigurationMode(c);
    case 46: return fmi3EvaluateDiscreteStates(c);
    case 47: return fmi3EnterStepMode(c);
    case 48: return fmi3GetBinary(c, g.refs, g.n, sizes, binaries, g.n_values);
    case 49: return fmi3SetClock(c, g.refs, g.n, flags);
    case 50: return fmi3ActivateModelPartition(c, ref, any_number(s));
    case 51: return fmi3GetNominalsOfContinuousStates(c, results, unit.n_x + (take(s, 16) == 0));
    case 52: return fmi3SetDebugLogging(c, take(s, 2), 0, NULL);
    default: return fmi3GetNumberOfContinuousStates(c, take(s, 16) ? &n : NULL);
    }
}
#else
#define N_CALLS 40
static int own_call(Source *s, Component c, unsigned what)
{
    Group g, h;
    Integer integers[ROOM] = {0};
    fmi2String string = NULL;
    fmi2EventInfo info;
    Boolean flag, other;
    double results[ROOM];
    switch (what) {
    case 2: return fmi2SetupExperiment(c, (Boolean)take(s, 2), any_number(s) * 1e-4, any_number(s), (Boolean)take(s, 2), any_number(s));
    case 18: g = group(s); integers[0] = (int)take(s, 4) - 1; return fmi2SetBoolean(c, VALUES(g, integers));
    case 19: g = group(s); return fmi2GetBoolean(c, VALUES(g, integers));
    case 20: g = group(s); return fmi2GetString(c, g.refs, g.n, &string);
    case 29: g = group(s), h = group(s); return fmi2GetDirectionalDerivative(c, g.refs, g.n, h.refs, h.n, h.values, results);
    case 30:
        g = group(s);
        for (size_t k = 0; k < g.n; k++)
            integers[k] = take(s, 8) ? 1 : (int)take(s, 4);
        return fmi2SetRealInputDerivatives(c, g.refs, g.n, integers, g.values);
    case 33: return fmi2NewDiscreteStates(c, take(s, 8) ? &info : NULL);
    case 34: return fmi2CompletedIntegratorStep(c, 1, &flag, take(s, 8) ? &other : NULL);
    default: return fmi2GetRealStatus(c, fmi2LastSuccessfulTime, results);
    }
}
#endif
