/* What the generated part of a unit offers to the hand-written layers.
 *
 * `unit.c` (tables and program) and `kernel_*.c` (traced equations) are generated for each unit; everything else in
 * this folder is the same for all. The values of a unit are in one array, its memory:
 *
 *     [ variables of the interface | derivatives of the states | time ]
 *
 * The position in the memory is the FMI 2 value reference. An array variable of FMI 3 lies in consecutive positions, row
 * by row, and its value reference is the position of its first element.
 */
#ifndef VDFMU_UNIT_H
#define VDFMU_UNIT_H

#include <stdbool.h>
#include <stddef.h>

typedef enum { REAL, INTEGER, BOOLEAN } Type;

typedef enum {
    INPUT,            /* real, continuous */
    OUTPUT,           /* real, continuous, calculated */
    FIXED_PARAMETER,  /* settable until initialization ends */
    TUNABLE_PARAMETER,
    DERIVATIVE,       /* of a state, local, calculated */
    TIME              /* the independent variable */
} Role;

typedef struct {
    const char *name;            /* "q[1]" */
    const char *measure;         /* unit, "rad"; "" if none */
    Type type;
    Role role;
    double start;                /* 0 for what is calculated */
    double min, max;             /* -INFINITY, INFINITY without limit */
    const char *const *choices;  /* names of the values 0, 1, .. of an integer; NULL for others */
    size_t n_choices;
} Variable;

/* A variable as FMI 3 sees it: `size` values from position `first`. */
typedef struct {
    const char *name;  /* "q", or "offset[2,1]" for an element that stands alone */
    size_t first, size;
} Array;

/* A condition on several parameters together. */
typedef struct {
    const char *expected;     /* "f_s >= f_c" */
    const size_t *positions;  /* of the parameters that it is about */
    size_t n;
} Requirement;

/* Positions from `first` to `end` - 1. */
typedef struct {
    size_t first, end;
} Run;

/* Rows of a sparse pattern: row k says that position `row[k]` depends on `run[begin[k]] .. run[begin[k+1]-1]`. */
typedef struct {
    size_t n_rows;
    const size_t *row, *begin;
    const Run *run;
} Pattern;

typedef void SolverStep(const double *m, const double *rate, double h, double tolerance,
                        double *x_new, double *norm, double *ratio);

typedef struct {
    const char *name;  /* "Plant" */
    const char *guid;  /* "{...}", also the instantiation token of FMI 3 */

    size_t n;          /* length of the memory */
    const Variable *variables;
    size_t n_arrays;
    const Array *arrays;      /* in the order of their first positions; the last is time */
    size_t time;              /* position of time, n - 1 */
    size_t n_x, x, x_dot;     /* states: number, position of the first, position of the first derivative; 0 if none */
    int exchange;             /* whether it is for model exchange, too */
    size_t tolerance, solver; /* positions of the solver's tolerance and of its kind; n if the unit has no solver */

    size_t period;            /* position of the time from one sample to the next [s]; n if nothing is sampled */
    size_t sampled, n_sampled; /* sampled states: position of the first, number */

    Pattern step_pattern;     /* outputs and derivatives on inputs, states and time, after initialization */
    Pattern start_pattern;    /* outputs and derivatives on inputs, parameters and time, during initialization */

    size_t n_requirements;
    const Requirement *requirements;
    void (*margins)(const double *m, double *margin);  /* (n_requirements); a requirement holds where margin >= 0 */

    /* The program of the unit, on its memory. */
    void (*start)(double *m);        /* parameters to states */
    void (*outputs)(double *m);      /* inputs, parameters, states, time to outputs */
    void (*derivatives)(double *m);  /* inputs, parameters, states to derivatives of the states */
    void (*update)(double *m);       /* to the sampled states of the time until the next sample; NULL if there are none */

    /* Its derivative. `d` has the layout of the memory: seeds in what is known, zero elsewhere; on return the tangent of
     * what was calculated. `*_reverse` goes backwards: seeds in what is calculated; the adjoint is added to what is
     * known, and what was calculated is zero on return. */
    void (*start_forward)(const double *m, double *d);
    void (*outputs_forward)(const double *m, double *d);
    void (*derivatives_forward)(const double *m, double *d);
    void (*start_reverse)(const double *m, double *d);
    void (*outputs_reverse)(const double *m, double *d);
    void (*derivatives_reverse)(const double *m, double *d);
    void (*update_forward)(const double *m, double *d); /* sampled states are both: known, and calculated for the next sample */
    void (*update_reverse)(const double *m, double *d);

    /* One step of the solver over h [s]; the inputs are m[i] + rate[i] * (time since the start of the step). NULL if the
     * unit has no states. `ratio` is the local error by component over the tolerance, `norm` its root mean square. */
    SolverStep *solver_step;
    /* Time until the derivatives switch by time [s], where all goes on as it changes now; NULL if they never do. */
    void (*left)(const double *m, const double *rate, double *left);
    /* Events: real outputs, an event each when it rises above 0. */
    size_t n_events, event;              /* number, position of the first */
    void (*events)(double *m);           /* inputs, parameters, states, time to these outputs */
    void (*const *at_event)(double *m);  /* (n_events); each sets states */
    SolverStep *solver_step_avx2; /* the same bits, for processors with AVX2; NULL if there is none */
} Unit;

extern const Unit unit;

#endif
