/* Events of a unit: changes of sign of its numbers, located inside internal steps, and what happens there. */
#ifndef VDFMU_EVENTS_H
#define VDFMU_EVENTS_H

#include "solver.h"

/* Take the signs of the numbers as they are now: those above 0 are no events. */
void events_begin(double *m, double *above);
/* Called after each event with its number; NULL: nothing is called. */
typedef void Happened(void *context, size_t event);
/* Let the events happen that are due, and those that they cause. Returns how many, or -1 if they do not end. */
int events_take(double *m, double *above, Happened *happened, void *context);
/* Return the length of an internal step of length h, shortened to just behind the first change of sign in it; `x_new` has
 * the states there. `done`: time from the start of the communication step to that of the internal step [s]. */
double events_until(const Solver *s, double done, double h);

#endif
