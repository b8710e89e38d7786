#ifndef OPERATIONS_H
#define OPERATIONS_H

#include <stdint.h>

/* a loop over the indices from first to last, also down, of what is from begin to end */
typedef struct {
    int first, last, begin, end;
} Span;

/* A function as operations of loops over an index. Places move with it, each by its slope. */
typedef struct {
    const int64_t *lines; /* four numbers each: code and slopes, places of the result and of both operands */
    const Span *blocks;   /* of lines */
    const Span *passes;   /* of blocks */
    int n_passes;
    int slope_bits;                  /* of the number of a slope */
    void (*move)(int i, int *moved); /* how far the places of each slope have moved at an index */
    const int *begins;               /* of arguments and results, and their end */
    int n_arguments, n_results;
    const double *constants;
    int n_constants, n;
} Operations;

/* Work of n numbers each: the values w; their changes or the derivatives by them d. */
typedef struct {
    double *w, *d;
    int *moved;
} Work;

/* Set what a function changes along a direction or, back, what a direction of its results is by its arguments; given
 * are arguments and direction. What is 0 times what is infinite is 0. */
void run_operations(const Operations *of, const double *const *given, double *const *made, const Work *work, int back);

#endif
