/* The solver: moves the states of a unit between communication points, by internal steps under error control or by a
 * fixed number of them. */
#ifndef VDFMU_SOLVER_H
#define VDFMU_SOLVER_H

#include <stdbool.h>
#include <stddef.h>

#include "control.h"
#include "unit.h"

/* Time before and after a switching within which it may be, by rounding: 18 units in the last place [s]. */
#define SWITCH_MARGIN(time) (4e-15 * fabs(time) + 1e-17)

typedef struct {
    SolverStep *step;
    double *m;            /* memory of the unit: states, inputs and time are moved */
    const double *before; /* memory at the start of the communication step */
    const double *rate;   /* of the inputs [1/s], zero where there is none */
    bool rates;           /* some rate is not zero */
    double *h;            /* [s] internal step to try next */
    double tolerance;     /* bound of the local error, relative and absolute in SI units */
    int fixed;            /* number of internal steps, whatever their error; 0: as many as the tolerance needs */
    double *x_new, *ratio; /* (n_x) room for results of a step */
    double *above;         /* (n_events) 1 if the number of an event was above 0, else 0 */
    double *trial, *end, *level; /* (n, 4 n_x, (PARTS + 2) n_events) room for events */

    /* Called after each internal step with the time since the start of the communication step and its length [s]; returns
     * the length from now on, at least `done`. NULL: nothing is called. */
    double (*accepted)(void *context, double done, double duration);
    void (*happened)(void *context, size_t event); /* called after each event */
    void *context;
} Solver;

/* Why a communication step failed. */
typedef struct {
    double time;      /* [s] that was reached */
    double last;      /* [s] the last internal step, if the end was not reached in MAXIMUM_STEPS; else 0, and what follows holds */
    size_t component; /* of the state */
    bool finite;      /* false: the component is not finite; true: its error is above the tolerance */
    int changes;      /* signs of events that changed, if these did not end: their number; else 0. First of all. */
    double error;     /* local error over the tolerance, root mean square over all components */
} SolverFailure;

/* Move the states from time `t` by `duration` [s]. After a failure the memory is that of the last internal step: the caller
 * puts `before` and `h` back. */
bool solver_advance(const Solver *s, double t, double duration, SolverFailure *failure);

#endif
