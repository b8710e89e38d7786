/* Model exchange: modes, time, states, derivatives. Samples have known times, other events indicators. */
#ifndef VDFMU_EXCHANGE_H
#define VDFMU_EXCHANGE_H

#include "instance.h"

Status enter_event_mode(Instance *I);
Status enter_continuous_time_mode(Instance *I);
/* Whether these are allowed: the FMI functions write the same answers always. */
Status check_event_iteration(const Instance *I, bool pointers_given);
/* Take the sample that is due, once, and the events; `next` is the time of the sample after it [s], INFINITY if nothing is
 * sampled; `changed`: an event may have set continuous states. */
Status update_discrete_states(Instance *I, bool pointers_given, double *next, bool *changed);
Status check_integrator_step(const Instance *I, bool pointers_given);
Status set_time(Instance *I, double time);
Status set_states(Instance *I, const double x[], size_t n);
Status get_states(Instance *I, double x[], size_t n);
Status get_derivatives(Instance *I, double x_dot[], size_t n);
Status get_nominals(Instance *I, double nominals[], size_t n);
Status get_event_indicators(Instance *I, double indicators[], size_t n);
Status get_number(const Instance *I, size_t *n, size_t value); /* of states or event indicators */

#endif
