/* A unit of FMI 1.0 for co-simulation, as strict as its table of states: x' = k u, y = x + offset, direct = 2 u,
   n counts steps, even says whether n is, word comes back as said. With `warns` its initialization and its steps warn. A GUID of another unit and a step beyond `most`
   are refused with a message. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi1Functions.h"

#define F(name) first_fmi##name
enum { X, Y, U, K, MOST, DIRECT, WARNS, REALS };
enum { MADE, READY, ENDED };

typedef struct {
    double values[REALS], offset;
    int n, state;
    char even, word[64], name[64];
    fmi1CallbackLogger log;
} Unit;

static fmi1Status refuse(Unit *m, const char *text, double value) {
    m->log(m, m->name, fmi1Error, "error", text, value);
    return fmi1Error;
}

const char *F(GetVersion)(void) { return "1.0"; }
const char *F(GetTypesPlatform)(void) { return "standard32"; }
fmi1Status F(SetDebugLogging)(fmi1Component c, fmi1Boolean on) { return (void)c, (void)on, fmi1OK; }

static void start(Unit *m) {
    memset(m->values, 0, sizeof m->values);
    m->values[K] = 1.0, m->values[MOST] = 1e9, m->n = 0, m->even = 1, m->state = MADE;
}
fmi1Component F(InstantiateSlave)(fmi1String name, fmi1String guid, fmi1String place, fmi1String mime, fmi1Real timeout,
                                  fmi1Boolean visible, fmi1Boolean interactive, fmi1CallbackFunctions call,
                                  fmi1Boolean logging) {
    (void)place, (void)mime, (void)timeout, (void)visible, (void)interactive, (void)logging;
    if (strcmp(guid, "{first}")) return call.logger(NULL, name, fmi1Error, "error", "the GUID %s is wrong", guid), NULL;
    Unit *m = call.allocateMemory(1, sizeof *m);
    snprintf(m->name, sizeof m->name, "%s", name);
    m->log = call.logger;
    return start(m), m;
}
fmi1Status F(InitializeSlave)(fmi1Component c, fmi1Real begin, fmi1Boolean stops, fmi1Real stop) {
    Unit *m = c;
    (void)begin, (void)stops, (void)stop;
    if (m->state != MADE) return refuse(m, "initialized twice", 0.0);
    if (m->values[K] < 0.0) return refuse(m, "k = %g is negative", m->values[K]);
    return m->offset = m->values[U], m->state = READY, m->values[WARNS] ? fmi1Warning : fmi1OK;  /* the input that it has by then */
}
fmi1Status F(TerminateSlave)(fmi1Component c) { return ((Unit *)c)->state = ENDED, fmi1OK; }
fmi1Status F(ResetSlave)(fmi1Component c) {
    return ((Unit *)c)->state == READY ? start(c), fmi1OK : refuse(c, "reset after its end", 0.0);
}
void F(FreeSlaveInstance)(fmi1Component c) { free(c); }
fmi1Status F(DoStep)(fmi1Component c, fmi1Real t, fmi1Real h, fmi1Boolean new) {
    Unit *m = c;
    (void)new;
    if (t + h > m->values[MOST]) return refuse(m, "no step beyond %g s", m->values[MOST]);
    m->values[X] += h * m->values[K] * m->values[U];
    return m->even = ++m->n % 2 == 0, m->values[WARNS] ? fmi1Warning : fmi1OK;
}

#define EACH for (size_t i = 0; i < n; i++)
#define ACCESS(kind, type, get, set)                                                                       \
    fmi1Status F(Get##kind)(fmi1Component c, const fmi1ValueReference *r, size_t n, type *x) {             \
        Unit *m = c;                                                                                       \
        if (m->state == MADE) return refuse(m, "read before its initialization", 0.0);                    \
        EACH get;                                                                                          \
        return (void)r, fmi1OK;                                                                            \
    }                                                                                                      \
    fmi1Status F(Set##kind)(fmi1Component c, const fmi1ValueReference *r, size_t n, const type *x) {       \
        Unit *m = c;                                                                                       \
        EACH set;                                                                                          \
        return (void)r, fmi1OK;                                                                            \
    }
ACCESS(Real, fmi1Real, x[i] = r[i] == Y ? m->values[X] + m->offset : r[i] == DIRECT ? 2.0 * m->values[U]
       : m->values[r[i]], m->values[r[i]] = x[i])
ACCESS(Integer, fmi1Integer, x[i] = m->n, m->n = x[i])
ACCESS(Boolean, fmi1Boolean, x[i] = m->even, m->even = x[i])
ACCESS(String, fmi1String, x[i] = m->word, snprintf(m->word, sizeof m->word, "%s", x[i]))

#define NOT(name, ...) fmi1Status F(name)(fmi1Component c, __VA_ARGS__)
#define REFUSE return refuse(c, "not supported", 0.0)
NOT(SetRealInputDerivatives, const fmi1ValueReference *r, size_t n, const fmi1Integer *o, const fmi1Real *x) {
    (void)r, (void)n, (void)o, (void)x; REFUSE;
}
NOT(GetRealOutputDerivatives, const fmi1ValueReference *r, size_t n, const fmi1Integer *o, fmi1Real *x) {
    (void)r, (void)n, (void)o, (void)x; REFUSE;
}
fmi1Status F(CancelStep)(fmi1Component c) { REFUSE; }
NOT(GetStatus, const fmi1StatusKind s, fmi1Status *x) { (void)s, (void)x; REFUSE; }
NOT(GetRealStatus, const fmi1StatusKind s, fmi1Real *x) { (void)s, (void)x; REFUSE; }
NOT(GetIntegerStatus, const fmi1StatusKind s, fmi1Integer *x) { (void)s, (void)x; REFUSE; }
NOT(GetBooleanStatus, const fmi1StatusKind s, fmi1Boolean *x) { (void)s, (void)x; REFUSE; }
NOT(GetStringStatus, const fmi1StatusKind s, fmi1String *x) { (void)s, (void)x; REFUSE; }
