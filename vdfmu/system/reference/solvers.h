/* The compiled solvers of the references: what they integrate. */
#ifndef SOLVERS_H
#define SOLVERS_H

#include <stddef.h>

enum { FAILED = -1 };

typedef struct {
    void (*rate)(double); /* reads `x` and sets `x_dot` at a time [s] */
    double *x;
    const double *x_dot;
    double *room; /* memory of both solvers, numbers at first 0 */
    size_t n;
    double relative, absolute; /* tolerances */
} Problem;

typedef struct {
    const double *A, *B, *C, *E3, *E5; /* of DOP853; A has rows of 16 numbers */
} Tables;

enum { ORDER_OF_ESTIMATE = 6 };

typedef struct Radau Radau;

enum { EXPLICIT_ROOM = 14 };

int dop853(const Tables *tables, const Problem *problem, double t, double to, double h);

size_t radau_room(size_t n);
void new_radau(const Problem *problem);
Radau *radau_of(const Problem *problem);
void start_radau(Radau *radau);
int renew_slopes(Radau *radau, double t);
int try_step(Radau *radau, double t, double h, double *error);
void take_step(Radau *radau, double h);
void states_within(const Radau *radau, double t, double at, double *x);

#endif
