#include "derivative.h"

#include <math.h>
#include <string.h>

/* ---------------------------------------------------------------- what can be derived */

static bool is_state(Reference ref)
{
    return (unit.n_x && ref >= unit.x && ref < unit.x + unit.n_x) ||
           (unit.update && ref >= unit.sampled && ref < unit.sampled + unit.n_sampled);
}

static bool can_be_known(const Instance *I, Reference ref)
{
    const Variable *v = &unit.variables[ref];
    if (v->type != REAL)
        return false;
    if (v->role == INPUT || v->role == TIME)
        return true;
    if (I->core->phase == INITIALIZATION)
        return v->role == FIXED_PARAMETER || v->role == TUNABLE_PARAMETER;
    return is_state(ref);
}

static bool can_be_unknown(const Instance *I, Reference ref)
{
    (void)I;
    return unit.variables[ref].role == OUTPUT || unit.variables[ref].role == DERIVATIVE;
}

/* `total` is the number of values that the references stand for. */
static Status check_references(const Instance *I, const Reference refs[], size_t n, const char *kind,
                               bool (*fits)(const Instance *I, Reference ref), const char *expected, size_t *total)
{
    *total = 0;
    if (n && !refs)
        return fail(I, "expected an array of %s, got a null pointer.", kind);
    for (size_t k = 0; k < n; k++) {
        if (!size_of(I, refs[k]))
            return fail_reference(I, refs[k]);
        if (!fits(I, refs[k]))
            return fail(I, "expected as %s %s, got %s.", kind, expected, unit.variables[refs[k]].name);
        *total += size_of(I, refs[k]);
    }
    return STATUS_OK;
}

static Status check(Instance *I, const Direction *a, bool adjoint)
{
    size_t n_knowns, n_unknowns;
    if (!allowed(I, INITIALIZATION | STEP | EVENT | CONTINUOUS | TERMINATED) ||
        check_references(I, a->unknowns, a->n_unknowns, "unknowns", can_be_unknown, "outputs and derivatives of states",
                         &n_unknowns) != STATUS_OK ||
        check_references(I, a->knowns, a->n_knowns, "knowns", can_be_known,
                         I->core->phase == INITIALIZATION ? "inputs and real parameters, as it is initialization mode"
                                                          : "inputs and states, as the initialization is over",
                         &n_knowns) != STATUS_OK)
        return STATUS_ERROR;
    const size_t n_seed = adjoint ? n_unknowns : n_knowns, n_sensitivity = adjoint ? n_knowns : n_unknowns;
    if (a->n_seed != n_seed || a->n_sensitivity != n_sensitivity)
        return fail(I, "expected %llu seeds and %llu sensitivities, got %llu and %llu.", (unsigned long long)n_seed,
                    (unsigned long long)n_sensitivity, (unsigned long long)a->n_seed, (unsigned long long)a->n_sensitivity);
    if (n_seed && !a->seed)
        return fail_null(I, "an array of seeds");
    if (n_sensitivity && !a->sensitivity)
        return fail_null(I, "an array of sensitivities");
    for (size_t k = 0; k < n_seed; k++)
        if (!isfinite(a->seed[k]))
            return fail(I, "expected finite seeds, got %s.", G9(a->seed[k]));
    return refresh(I, 0);
}

/* ---------------------------------------------------------------- derivatives */

static void sow(const Instance *I, const Reference refs[], size_t n, const double seed[])
{
    memset(I->d, 0, unit.n * sizeof *I->d);
    for (size_t k = 0, j = 0; k < n; k++)
        for (size_t i = 0; i < I->size_at[refs[k]]; i++)
            I->d[refs[k] + i] += seed[j++];
}

static void reap(const Instance *I, const Reference refs[], size_t n, double sensitivity[])
{
    for (size_t k = 0, j = 0; k < n; k++)
        for (size_t i = 0; i < I->size_at[refs[k]]; i++)
            sensitivity[j++] = I->d[refs[k] + i];
}

Status directional_derivative(Instance *I, const Direction *a)
{
    if (check(I, a, false) != STATUS_OK)
        return STATUS_ERROR;
    sow(I, a->knowns, a->n_knowns, a->seed);
    if (I->core->phase == INITIALIZATION)
        unit.start_forward(I->m, I->d);
    unit.outputs_forward(I->m, I->d);
    if (unit.n_x)
        unit.derivatives_forward(I->m, I->d);
    if (unit.update && I->core->phase != INITIALIZATION)
        unit.update_forward(I->m, I->d); /* the last: it replaces the seeds of sampled states */
    reap(I, a->unknowns, a->n_unknowns, a->sensitivity);
    return STATUS_OK;
}

Status adjoint_derivative(Instance *I, const Direction *a)
{
    if (check(I, a, true) != STATUS_OK)
        return STATUS_ERROR;
    sow(I, a->unknowns, a->n_unknowns, a->seed);
    if (unit.update && I->core->phase != INITIALIZATION)
        unit.update_reverse(I->m, I->d);
    if (unit.n_x)
        unit.derivatives_reverse(I->m, I->d);
    unit.outputs_reverse(I->m, I->d);
    if (I->core->phase == INITIALIZATION)
        unit.start_reverse(I->m, I->d);
    reap(I, a->knowns, a->n_knowns, a->sensitivity);
    return STATUS_OK;
}

/* ---------------------------------------------------------------- dependencies */

static const Pattern *pattern_now(const Instance *I)
{
    const bool before = I->core->phase & (INSTANTIATED | INITIALIZATION);
    return before ? &unit.start_pattern : &unit.step_pattern;
}

static bool is_row_of(const Instance *I, const Pattern *p, size_t k, Reference dependent)
{
    return p->row[k] >= dependent && p->row[k] - dependent < I->size_at[dependent];
}

static size_t n_dependencies(const Instance *I, Reference dependent)
{
    const Pattern *p = pattern_now(I);
    size_t n = 0;
    for (size_t k = 0; k < p->n_rows; k++)
        if (is_row_of(I, p, k, dependent))
            for (size_t i = p->begin[k]; i < p->begin[k + 1]; i++)
                n += p->run[i].end - p->run[i].first;
    return n;
}

static const Array *array_of(size_t position)
{
    const Array *a = unit.arrays;
    while (position - a->first >= a->size)
        a++;
    return a;
}

Status count_dependencies(const Instance *I, Reference dependent, size_t *n)
{
    if (!allowed(I, ANY_PHASE | INTERMEDIATE))
        return STATUS_ERROR;
    if (!size_of(I, dependent))
        return fail_reference(I, dependent);
    if (!n)
        return fail_null(I, "a pointer to the number");
    *n = n_dependencies(I, dependent);
    return STATUS_OK;
}

Status get_dependencies(const Instance *I, Reference dependent, size_t elements_of_dependent[], Reference independents[],
                        size_t elements_of_independents[], bool kinds_given, size_t n)
{
    size_t expected;
    if (count_dependencies(I, dependent, &expected) != STATUS_OK)
        return STATUS_ERROR;
    if (n != expected)
        return fail(I, "expected room for %llu dependencies, got %llu.", (unsigned long long)expected, (unsigned long long)n);
    if (n && !(elements_of_dependent && independents && elements_of_independents && kinds_given))
        return fail_null(I, "arrays for elements, independents and kinds");
    const Pattern *p = pattern_now(I);
    size_t j = 0;
    for (size_t k = 0; k < p->n_rows; k++) {
        if (!is_row_of(I, p, k, dependent))
            continue;
        for (size_t i = p->begin[k]; i < p->begin[k + 1]; i++)
            for (size_t column = p->run[i].first; column < p->run[i].end; column++, j++) {
                const Array *a = array_of(column);
                elements_of_dependent[j] = p->row[k] - dependent + 1;
                independents[j] = (Reference)a->first;
                elements_of_independents[j] = column - a->first + 1;
            }
    }
    return STATUS_OK;
}
