#ifndef OPERATIONS_H
#define OPERATIONS_H

/* A function as a list of operations on a memory of n numbers. */
typedef struct {
    const int *lines; /* four numbers each: code, places of the result and of both operands */
    int n_lines;
    const int *begins; /* of arguments and results, and their end */
    int n_arguments, n_results;
    const double *constants; /* at the end of the memory */
    int n_constants, n;
} Operations;

/* Set what a function changes along a direction or, back, what a direction of its results is by its arguments; given
 * are arguments and direction. w and d, n numbers each, are for values and their changes, or the derivatives by them.
 * What is 0 times what is infinite is 0. */
void run_operations(const Operations *of, const double *const *given, double *const *made, double *w, double *d,
    int back);

#endif
