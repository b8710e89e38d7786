#include "values.h"

#include <math.h>

/* ---------------------------------------------------------------- what is refused */

static const char *name_at(const Instance *I, Reference ref) /* of the variable that a valid reference names */
{
    if (I->host.arrays)
        for (size_t i = 0; i < unit.n_arrays; i++)
            if (unit.arrays[i].first == ref)
                return unit.arrays[i].name;
    return unit.variables[ref].name;
}

Status fail_reference(const Instance *I, Reference ref)
{
    if (!I->host.arrays)
        return fail(I, "there is no value reference %lu; they go from 0 to %lu.", (unsigned long)ref,
                    (unsigned long)unit.n - 2);
    if (ref >= unit.n)
        return fail(I, "there is no value reference %lu; the last is %lu.", (unsigned long)ref, (unsigned long)unit.time);
    size_t i = 0;
    while (i + 1 < unit.n_arrays && unit.arrays[i + 1].first < ref)
        i++;
    return fail(I, "there is no value reference %lu; that of %s is %lu, and stands for all of its %lu values.",
                (unsigned long)ref, unit.arrays[i].name, (unsigned long)unit.arrays[i].first,
                (unsigned long)unit.arrays[i].size);
}

Status fail_type(const Instance *I, const char *type, Reference ref)
{
    return fail(I, "expected variables of type %s, got %s (value reference %lu) of type %s.", type, name_at(I, ref),
                (unsigned long)ref, I->host.type_names[unit.variables[ref].type]);
}

static Status fail_size(const Instance *I, size_t expected, size_t got)
{
    return fail(I, "expected %llu values, got %llu.", (unsigned long long)expected, (unsigned long long)got);
}

/* Arrays that hold something must be there. */
static inline bool given(const Instance *I, const Reference refs[], size_t n, const void *values, size_t n_values)
{
    if (n && !refs) {
        fail_null(I, "an array of value references");
        return false;
    }
    if (n_values && !values) {
        fail_null(I, "an array of values");
        return false;
    }
    return true;
}

static inline bool resolve(const Instance *I, Type type, Reference ref, size_t *size)
{
    *size = size_of(I, ref);
    if (*size == 0) {
        fail_reference(I, ref);
        return false;
    }
    if (unit.variables[ref].type != type) {
        fail_type(I, I->host.type_names[type], ref);
        return false;
    }
    return true;
}

Status no_such_type(Instance *I, const char *type, const Reference refs[], size_t n)
{
    if (n == 0)
        return STATUS_OK;
    if (!refs)
        return fail_null(I, "an array of value references");
    return size_of(I, refs[0]) ? fail_type(I, type, refs[0]) : fail_reference(I, refs[0]);
}

/* ---------------------------------------------------------------- values of the importer */

typedef enum { AS_DOUBLE, AS_INT, AS_INT_BOOLEAN, AS_BOOL } Format;

static inline double load(const void *values, Format format, size_t k)
{
    switch (format) {
    case AS_INT:
        return ((const int *)values)[k];
    case AS_INT_BOOLEAN:
        return ((const int *)values)[k] != 0;
    case AS_BOOL: /* read as a byte: another value than 0 and 1 is not a bool */
        return ((const unsigned char *)values)[k] != 0;
    default:
        return ((const double *)values)[k];
    }
}

static inline void store(void *values, Format format, size_t k, double value)
{
    switch (format) {
    case AS_INT:
    case AS_INT_BOOLEAN:
        ((int *)values)[k] = (int)value;
        break;
    case AS_BOOL:
        ((bool *)values)[k] = value != 0.0;
        break;
    default:
        ((double *)values)[k] = value;
    }
}

HOLDS(BoolIsByte, sizeof(bool) == 1);

/* ---------------------------------------------------------------- getting */

enum { CALCULATED = 1 << OUTPUT | 1 << DERIVATIVE };

static Status ready_to_read(Instance *I, unsigned roles, const Reference refs[], size_t n)
{
    if (I->core->phase & INSTANTIATED)
        for (size_t k = 0; k < n; k++) {
            const Role role = unit.variables[refs[k]].role;
            if (role == OUTPUT || role == DERIVATIVE)
                return fail(I, "%s is %s: it has no value before enterInitializationMode.", name_at(I, refs[k]),
                            role == OUTPUT ? "an output" : "the derivative of a state");
        }
    return refresh(I, (roles & 1u << OUTPUT ? STALE_OUTPUTS : 0u) |
                      (roles & 1u << DERIVATIVE ? STALE_DERIVATIVES : 0u));
}

static inline Status get(Instance *I, Type type, Format format, const Reference refs[], size_t n, void *values,
                         size_t n_values)
{
    if (!given(I, refs, n, values, n_values))
        return STATUS_ERROR;
    unsigned roles = 0;
    size_t total = 0, size;
    for (size_t k = 0; k < n; k++) {
        if (!resolve(I, type, refs[k], &size))
            return STATUS_ERROR;
        roles |= 1u << unit.variables[refs[k]].role;
        total += size;
    }
    if (total != n_values)
        return fail_size(I, total, n_values);
    if (I->core->stale && roles & CALCULATED && ready_to_read(I, roles, refs, n) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t k = 0, j = 0; k < n; k++) {
        size = I->size_at[refs[k]];
        for (size_t i = 0; i < size; i++)
            store(values, format, j++, I->m[refs[k] + i]);
    }
    return STATUS_OK;
}

/* What importers do at every step: reals that are up to date. False: take a closer look. */
static inline bool get_quickly(const Instance *I, const Reference refs[], size_t n, double values[], size_t n_values)
{
    if (!refs || !values || I->core->stale & (STALE_START | STALE_OUTPUTS))
        return false;
    if (!I->host.arrays) {
        for (size_t k = 0; k < n; k++) {
            if (refs[k] >= unit.n || !(I->quick_at[refs[k]] & QUICK_GET))
                return false;
            values[k] = I->m[refs[k]];
        }
        return true;
    }
    size_t j = 0;
    for (size_t k = 0; k < n; k++) {
        const Reference ref = refs[k];
        if (ref >= unit.n || !(I->quick_at[ref] & QUICK_GET) || I->size_at[ref] > n_values - j)
            return false;
        for (size_t i = 0; i < I->size_at[ref]; i++)
            values[j++] = I->m[ref + i];
    }
    return j == n_values;
}

Status get_reals(Instance *I, const Reference refs[], size_t n, double values[], size_t n_values)
{
    if (get_quickly(I, refs, n, values, n_values))
        return STATUS_OK;
    return get(I, REAL, AS_DOUBLE, refs, n, values, n_values);
}

Status get_integers(Instance *I, const Reference refs[], size_t n, int values[], size_t n_values)
{
    return get(I, INTEGER, AS_INT, refs, n, values, n_values);
}

Status get_booleans(Instance *I, const Reference refs[], size_t n, int values[], size_t n_values)
{
    return get(I, BOOLEAN, AS_INT_BOOLEAN, refs, n, values, n_values);
}

Status get_bools(Instance *I, const Reference refs[], size_t n, bool values[], size_t n_values)
{
    return get(I, BOOLEAN, AS_BOOL, refs, n, values, n_values);
}

/* ---------------------------------------------------------------- setting */

static inline unsigned settable_roles(const Instance *I)
{
    switch (I->core->phase) {
    case INSTANTIATED:
    case INITIALIZATION:
        return 1 << INPUT | 1 << FIXED_PARAMETER | 1 << TUNABLE_PARAMETER;
    case STEP:
    case EVENT:
        return 1 << INPUT | 1 << TUNABLE_PARAMETER;
    case CONTINUOUS:
        return 1 << INPUT;
    case INTERMEDIATE:
        return I->set_requested ? 1 << INPUT : 0;
    default:
        return 0;
    }
}

/* FMI has a function of its own for states; CasADi and others set them as variables, which comes to the same. */
static inline bool settable_state(const Instance *I, Reference ref)
{
    return I->core->phase == CONTINUOUS && unit.n_x && ref >= unit.x && ref < unit.x + unit.n_x;
}

static Status refuse_setting(const Instance *I, Reference ref)
{
    const char *name = name_at(I, ref);
    const unsigned phase = I->core->phase;
    switch (unit.variables[ref].role) {
    case OUTPUT:
        return fail(I, "%s is an output and cannot be set.", name);
    case DERIVATIVE:
        return fail(I, "%s is the derivative of a state and cannot be set.", name);
    case TIME:
        return fail(I, "%s is the independent variable and cannot be set.", name);
    case FIXED_PARAMETER:
        if (phase & (STEP | INTERMEDIATE | EVENT | CONTINUOUS))
            return fail(I, "%s is a fixed parameter and can be set only before exitInitializationMode. "
                           "Reset the unit to set it.", name);
        break;
    case TUNABLE_PARAMETER:
        if (phase & (INTERMEDIATE | CONTINUOUS))
            return fail(I, "%s is a tunable parameter and cannot be set %s.", name,
                        phase == CONTINUOUS ? "in continuous-time mode. Enter event mode to set it"
                                            : "in an intermediate update");
        break;
    case INPUT:
        if (phase == INTERMEDIATE)
            return fail(I, "%s cannot be set in this intermediate update, which did not request it.", name);
        break;
    }
    return refuse_phase(I, INSTANTIATED | INITIALIZATION | STEP | EVENT | CONTINUOUS);
}

static inline bool acceptable(const Variable *v, double value)
{
    const bool chosen = !v->n_choices || (value >= 0.0 && value < (double)v->n_choices);
    return value >= v->min && value <= v->max && isfinite(value) && chosen;
}

static inline void note_set(Instance *I)
{
    if (I->core->phase == STEP) /* a step calculates all that depends on what was set before it */
        return;
    I->core->stale |= STALE_OUTPUTS | STALE_DERIVATIVES;
    if (I->core->phase & (INSTANTIATED | INITIALIZATION)) /* inputs too decide the start */
        I->core->stale |= STALE_START;
}

static inline Status set(Instance *I, Type type, Format format, const Reference refs[], size_t n, const void *values,
                         size_t n_values)
{
    if (!given(I, refs, n, values, n_values))
        return STATUS_ERROR;
    const unsigned settable = settable_roles(I);
    size_t total = 0, size;
    for (size_t k = 0; k < n; k++) {
        if (!resolve(I, type, refs[k], &size))
            return STATUS_ERROR;
        const unsigned role = 1u << unit.variables[refs[k]].role;
        if (!(role & settable) && !settable_state(I, refs[k]))
            return refuse_setting(I, refs[k]);
        total += size;
    }
    if (total != n_values)
        return fail_size(I, total, n_values);
    for (size_t k = 0, j = 0; k < n; k++) {
        size = I->size_at[refs[k]];
        for (size_t i = 0; i < size; i++, j++) {
            const Variable *v = &unit.variables[refs[k] + i];
            const double value = load(values, format, j);
            if (!acceptable(v, value))
                return fail_problem(I, v, value);
        }
    }
    for (size_t k = 0, j = 0; k < n; k++) {
        size = I->size_at[refs[k]];
        for (size_t i = 0; i < size; i++)
            I->m[refs[k] + i] = load(values, format, j++);
    }
    if (n)
        note_set(I);
    return STATUS_OK;
}

/* What importers do at every step: real inputs without limits. False: take a closer look. */
static inline bool set_quickly(Instance *I, const Reference refs[], size_t n, const double values[], size_t n_values)
{
    if (!n || !refs || !values || !(settable_roles(I) & 1u << INPUT))
        return false;
    size_t total = 0;
    for (size_t k = 0; k < n; k++) {
        if (refs[k] >= unit.n || !(I->quick_at[refs[k]] & QUICK_SET))
            return false;
        total += I->size_at[refs[k]];
    }
    if (total != n_values)
        return false;
    for (size_t j = 0; j < n_values; j++)
        if (!isfinite(values[j]))
            return false;
    if (!I->host.arrays)
        for (size_t k = 0; k < n; k++)
            I->m[refs[k]] = values[k];
    else
        for (size_t k = 0, j = 0; k < n; k++)
            for (size_t i = 0; i < I->size_at[refs[k]]; i++)
                I->m[refs[k] + i] = values[j++];
    note_set(I);
    return true;
}

Status set_reals(Instance *I, const Reference refs[], size_t n, const double values[], size_t n_values)
{
    if (set_quickly(I, refs, n, values, n_values))
        return STATUS_OK;
    return set(I, REAL, AS_DOUBLE, refs, n, values, n_values);
}

Status set_integers(Instance *I, const Reference refs[], size_t n, const int values[], size_t n_values)
{
    return set(I, INTEGER, AS_INT, refs, n, values, n_values);
}

Status set_booleans(Instance *I, const Reference refs[], size_t n, const int values[], size_t n_values)
{
    return set(I, BOOLEAN, AS_INT_BOOLEAN, refs, n, values, n_values);
}

Status set_bools(Instance *I, const Reference refs[], size_t n, const bool values[], size_t n_values)
{
    return set(I, BOOLEAN, AS_BOOL, refs, n, values, n_values);
}
