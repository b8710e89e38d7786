/* Getting and setting variables by value references. */
#ifndef VDFMU_VALUES_H
#define VDFMU_VALUES_H

#include "instance.h"

typedef uint32_t Reference;

/* Compiles only where a condition holds; C99 has no _Static_assert. */
#define HOLDS(name, condition) typedef char name[(condition) ? 1 : -1]

HOLDS(IntegersOfFmi2AndFmi3AreTheSame, sizeof(int) == sizeof(int32_t));
HOLDS(ReferencesOfFmi2AndFmi3AreTheSame, sizeof(unsigned) == sizeof(Reference));

/* `n` references stand for `n_values` values: as many in FMI 2, the sum of the sizes of the arrays in FMI 3. */
Status get_reals(Instance *I, const Reference refs[], size_t n, double values[], size_t n_values);
Status get_integers(Instance *I, const Reference refs[], size_t n, int values[], size_t n_values);
Status get_booleans(Instance *I, const Reference refs[], size_t n, int values[], size_t n_values);
Status get_bools(Instance *I, const Reference refs[], size_t n, bool values[], size_t n_values);

/* All of a call are set, or none. */
Status set_reals(Instance *I, const Reference refs[], size_t n, const double values[], size_t n_values);
Status set_integers(Instance *I, const Reference refs[], size_t n, const int values[], size_t n_values);
Status set_booleans(Instance *I, const Reference refs[], size_t n, const int values[], size_t n_values);
Status set_bools(Instance *I, const Reference refs[], size_t n, const bool values[], size_t n_values);

/* Types that no variable has: refused unless nothing is asked for. */
Status no_such_type(Instance *I, const char *type, const Reference refs[], size_t n);

/* Number of values of a reference, which is also the position of the first; 0 if there is none. */
static inline size_t size_of(const Instance *I, Reference ref)
{
    return ref < unit.n ? I->size_at[ref] : 0;
}

/* Say that there is no such reference. */
Status fail_reference(const Instance *I, Reference ref);

/* Say that a variable is not of the type that the call is for. */
Status fail_type(const Instance *I, const char *type, Reference ref);

#endif
