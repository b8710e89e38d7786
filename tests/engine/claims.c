/* The strict unit with an input, FMU state and directional derivatives, of which the one that the GUID names is broken. */
#define _DEFAULT_SOURCE
#include <unistd.h>
#define fmi2DoStep strictDoStep
#define fmi2SetReal strictSetReal
#define fmi2Instantiate strictInstantiate
#define fmi2GetFMUstate strictGetFMUstate
#define fmi2SetFMUstate strictSetFMUstate
#define fmi2FreeFMUstate strictFreeFMUstate
#define fmi2SerializedFMUstateSize strictSerializedFMUstateSize
#define fmi2SerializeFMUstate strictSerializeFMUstate
#define fmi2DeSerializeFMUstate strictDeSerializeFMUstate
#define fmi2GetDirectionalDerivative strictGetDirectionalDerivative
#include "strict.c"
#undef fmi2DoStep
#undef fmi2SetReal
#undef fmi2Instantiate
#undef fmi2GetFMUstate
#undef fmi2SetFMUstate
#undef fmi2FreeFMUstate
#undef fmi2SerializedFMUstateSize
#undef fmi2SerializeFMUstate
#undef fmi2DeSerializeFMUstate
#undef fmi2GetDirectionalDerivative
enum { SOUND, CRASH_SET, NO_STATE, STALE_STATE, NO_BYTES, NO_DERIVATIVE, NAN_DERIVATIVE, CLOSE_FILES, FAINTLY_STALE };
static int way, steps;
static volatile int *nowhere;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    way = atoi(guid);
    return strictInstantiate(name, type, guid, place, call, visible, logging);
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *x) {
    (void)c, (void)r, (void)n, (void)x;  /* the input, which has no effect */
    if (way == CRASH_SET) *nowhere = 1;
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean final) {
    if (way == CLOSE_FILES) for (int i = 0; i < 64; i++) close(i);
    const fmi2Status status = strictDoStep(c, t, h, final);
    ((Unit *)c)->values[Y] += way == STALE_STATE ? ++steps : 0;
    if (way == FAINTLY_STALE) ((Unit *)c)->values[Y] = 160285.1386 + 2e-4 * ++steps;
    return status;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) {
    if (way == NO_STATE) return say(c, fmi2Error, "this unit has no state");
    if (!*s) *s = malloc(sizeof(Unit));
    return memcpy(*s, c, sizeof(Unit)), fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return memcpy(c, s, sizeof(Unit)), fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) { return (void)c, free(*s), *s = NULL, fmi2OK; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) {
    return (void)c, (void)s, *n = sizeof(Unit), fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte *b, size_t n) {
    return (void)c, memcpy(b, s, n), fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte *b, size_t n, fmi2FMUstate *s) {
    if (way == NO_BYTES) return say(c, fmi2Error, "the bytes are of another version");
    return (void)c, *s = malloc(n), memcpy(*s, b, n), fmi2OK;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference *u, size_t n,
                                        const fmi2ValueReference *k, size_t m, const fmi2Real *seed, fmi2Real *x) {
    (void)u, (void)k, (void)m, (void)seed;
    if (way == NO_DERIVATIVE) return say(c, fmi2Error, "not implemented");
    while (n--) x[n] = way == NAN_DERIVATIVE ? NAN : 0.0;
    return fmi2OK;
}
