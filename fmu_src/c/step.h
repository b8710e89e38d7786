/* Co-simulation: communication steps, rates of inputs. */
#ifndef VDFMU_STEP_H
#define VDFMU_STEP_H

#include "instance.h"
#include "values.h"

/* Move from `point` by `size` [s]. `early`, if not NULL, is whether the importer asked to stop before the end. */
Status do_step(Instance *I, double point, double size, bool *early);

/* The last sample until a time, that within its rounding included, and the one after it [s]. */
typedef struct {
    double last, next;
} Samples;

Samples samples_at(const Instance *I, double time);

/* Input derivatives of FMI 2, of order 1: hold for the next step only. */
Status set_input_rates(Instance *I, const Reference refs[], size_t n, const int order[], const double value[]);
Status get_output_rates(Instance *I);

#endif
