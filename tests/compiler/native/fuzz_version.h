/* What differs between FMI 2.0 and 3.0 for fuzz.c: names, types, and what a value reference is. */
#ifdef FMI3
#include <fmi3Functions.h>
#define FMI(name) fmi3##name
#define REAL_CALL(verb) fmi3##verb##Float64
#define INTEGER_CALL(verb) fmi3##verb##Int32
#define STATE(before, after) fmi3##before##FMUState##after
#define DESERIALIZE fmi3DeserializeFMUState
#define GET_DERIVATIVES fmi3GetContinuousStateDerivatives
#define VALUES(g, room) (g).refs, (g).n, room, (g).n_values
#define VALUES_AFTER(g, room) (g).n, room, (g).n_values
#define ENTER_ARGUMENTS , false, 0.0, 0.0, false, 0.0
typedef fmi3FMUState SavedState;
typedef int32_t Integer;
#else
#include <fmi2Functions.h>
#define FMI(name) fmi2##name
#define REAL_CALL(verb) fmi2##verb##Real
#define INTEGER_CALL(verb) fmi2##verb##Integer
#define STATE(before, after) fmi2##before##FMUstate##after
#define DESERIALIZE fmi2DeSerializeFMUstate
#define GET_DERIVATIVES fmi2GetDerivatives
#define VALUES(g, room) (g).refs, (g).n, room
#define VALUES_AFTER(g, room) (g).n, room
#define ENTER_ARGUMENTS
typedef fmi2FMUstate SavedState;
typedef int Integer;
#endif
typedef void *Component;
typedef FMI(Boolean) Boolean;
typedef FMI(ValueReference) Reference;

/* Variables that can be named, and the value reference of each: positions in FMI 2, arrays in FMI 3. */
#ifdef FMI3
#define N_NAMED unit.n_arrays
static Reference named(size_t k)
{
    return (Reference)(k < unit.n_arrays ? unit.arrays[k].first : k);
}
static size_t size_of(Reference ref)
{
    for (size_t i = 0; i < unit.n_arrays; i++)
        if (unit.arrays[i].first == ref)
            return unit.arrays[i].size;
    return 1;
}
#else
#define N_NAMED (unit.n - 1)
#define named(k) ((Reference)(k))
#define size_of(ref) ((void)(ref), (size_t)1)
#endif
