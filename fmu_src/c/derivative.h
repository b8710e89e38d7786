/* Partial derivatives of a unit at its present values, and what depends on what. */
#ifndef VDFMU_DERIVATIVE_H
#define VDFMU_DERIVATIVE_H

#include "instance.h"
#include "values.h"

/* Unknowns and knowns by value references; seeds and sensitivities one for each value that these stand for. */
typedef struct {
    const Reference *unknowns, *knowns;
    size_t n_unknowns, n_knowns;
    const double *seed;
    double *sensitivity;
    size_t n_seed, n_sensitivity;
} Direction;

Status directional_derivative(Instance *I, const Direction *direction);
Status adjoint_derivative(Instance *I, const Direction *direction);

/* Dependencies of the elements of an array on elements of arrays, counted from 1. */
Status count_dependencies(const Instance *I, Reference dependent, size_t *n);
Status get_dependencies(const Instance *I, Reference dependent, size_t elements_of_dependent[], Reference independents[],
                        size_t elements_of_independents[], bool kinds_given, size_t n);

#endif
