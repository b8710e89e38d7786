/* An instance of a unit: phases, life cycle, messages, and what all other layers work on. Knows no FMI header. */
#ifndef VDFMU_INSTANCE_H
#define VDFMU_INSTANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "message.h"
#include "unit.h"

/* The numbers are those of fmi2Status and fmi3Status. */
typedef enum { STATUS_OK = 0, STATUS_DISCARD = 2, STATUS_ERROR = 3 } Status;

typedef enum { CO_SIMULATION, MODEL_EXCHANGE, NO_KIND } Kind;

/* One bit each, so that a call names those in which it is allowed. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    STEP = 4,         /* co-simulation */
    INTERMEDIATE = 8, /* FMI 3 co-simulation: inside an intermediate update */
    EVENT = 16,       /* model exchange */
    CONTINUOUS = 32,  /* model exchange */
    TERMINATED = 64
} Phase;

#define LAST_PHASE TERMINATED
#define ANY_PHASE (2 * LAST_PHASE - 1 - INTERMEDIATE)

/* What does not follow from the values that were set. */
enum { STALE_START = 1, STALE_OUTPUTS = 2, STALE_DERIVATIVES = 4, STALE_ALL = 7 };

/* Everything that decides the future of an instance: a copy of it is a saved state. */
typedef struct {
    unsigned phase, stale;
    bool tolerance_defined; /* by the experiment */
    bool rates;             /* some rate is not zero */
    double start_time, stop_time, tolerance; /* stop_time: INFINITY if it is not defined */
    double h;        /* [s] internal step that the solver tries next */
    double sampled;  /* [s] last sample taken in event mode; -INFINITY: none */
    /* Memory, rates of the inputs, memory at the end of the last step; n each. Whether the number of each event was above 0
     * at the last look: not in the memory, because reading outputs must not lose an event. */
    double values[];
} Core;

typedef struct State {
    struct State *next;
    Core *core;
} State;

/* An intermediate update of FMI 3. */
typedef struct {
    double time;
    bool set_requested, can_return_early;
    bool return_requested; /* the importer's answer */
    double return_time;
} Update;

/* The importer, and how its version of FMI speaks to it. */
typedef struct Host {
    void *environment;
    void (*log)(const struct Host *host, const char *name, Status status, const char *category, const char *text);
    void (*update)(const struct Host *host, Update *update); /* NULL: not wanted */
    void (*logger)(void);       /* callbacks of the importer, of the types that `log` and `update` know */
    void (*intermediate)(void);
    const char *type_names[3];  /* of REAL, INTEGER, BOOLEAN */
    bool arrays;                /* a value reference names an array, and time is offered */
    unsigned logged; /* categories that are turned on, one bit each */
    bool early_return_allowed;
} Host;

typedef struct {
    Host host;
    Kind kind;
    char *name;
    const char *call; /* FMI function under way */
    Core *core, *kept; /* `kept`: a copy from the start of a step by samples, or of an update of discrete states */
    double *m, *rate, *held, *above; /* parts of `core->values` */
    size_t *size_at;         /* (n) number of values of a value reference, 0 if there is none */
    unsigned char *quick_at; /* (n) what a value reference allows without a closer look, of the bits below */
    double *before, *d;      /* (n) room for a copy of the memory, for a derivative; `before` owns these four */
    SolverStep *solver_step; /* the copy for this processor */
    double *x_new, *ratio;   /* (n_x) room for the solver */
    double *trial, *end, *level, *above_before; /* room for events, the last (n_events) for a copy of `above` */
    bool set_requested;      /* in the intermediate update under way */
    State *states;
} Instance;

/* Reals that are not derivatives of states; real inputs without limits. */
enum { QUICK_GET = 1, QUICK_SET = 2 };

/* Messages: `<name>: <call> at t = .. s failed: <text>`. They return STATUS_ERROR and STATUS_DISCARD. */
Status fail(const Instance *I, const char *format, ...);
Status discard(const Instance *I, const char *format, ...);
Status fail_null(const Instance *I, const char *what);
Status fail_problem(const Instance *I, const Variable *v, double value);

/* Message about an event: `<name>: event <event> at t = .. s`, with all digits of the time. */
void log_event(const Instance *I, size_t event);

/* Refuse a call outside of some phases. */
Status refuse_phase(const Instance *I, unsigned phases);
static inline bool allowed(const Instance *I, unsigned phases)
{
    return (I->core->phase & phases) || refuse_phase(I, phases) == STATUS_OK;
}

/* Life cycle. `call` is the name of the FMI function that makes the instance. */
Instance *instance_new(const Host *host, const char *call, const char *name, const char *guid, Kind kind);
void instance_free(Instance *I);
/* Messages about a status are on from the start, others with `logging_on`. */
unsigned logged_at_start(bool logging_on);
Status set_debug_logging(Instance *I, bool on, size_t n, const char *const categories[]);

typedef struct {
    bool tolerance_defined, stop_time_defined;
    double tolerance, start_time, stop_time;
} Experiment;

Status setup_experiment(Instance *I, const Experiment *e);
Status enter_initialization(Instance *I, const Experiment *e); /* NULL: that of setup_experiment */
Status exit_initialization(Instance *I);
Status refuse_configuration(const Instance *I);
Status terminate(Instance *I);
Status reset(Instance *I);

/* Calculate what is stale: the start always, of STALE_OUTPUTS and STALE_DERIVATIVES what is asked for. */
Status refresh(Instance *I, unsigned what);

/* Tolerance of the solver. */
double tolerance_of(const Instance *I);

/* Append what is wrong with the parameters together. */
void text_add_requirements(Text *t, const double *m);

#endif
