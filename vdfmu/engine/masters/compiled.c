/* Steps of a master without the interpreter: calls of FMUs, copies of values, the check of outputs, and rows.
 *
 * `compiled.py` makes the plan. Every answer other than plain success goes back to it. */
#define _POSIX_C_SOURCE 199309L
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#ifdef _WIN32
__declspec(dllimport) unsigned long long __stdcall GetTickCount64(void); /* windows.h has types named LONG and BOOL */
#else
#include <time.h>
#endif

enum { COPY, SCALED, CHANGED, PREDICTED, LINE, RAMP, VALUES_2, VALUES_3, STEP_2, STEP_3, RATES_2, RATES_3 };
enum { DOUBLE, FLOAT, LONG, BOOL, INT, SHORT, BYTE, UNSIGNED_LONG, UNSIGNED_INT, UNSIGNED_SHORT, UNSIGNED_BYTE };
enum { REACHED, ASKS, NOT_FINITE, EVENT, BY_HAND };

typedef int Values2(void *, const unsigned *, size_t, void *);
typedef int Values3(void *, const unsigned *, size_t, void *, size_t);
typedef int Rates2(void *, const unsigned *, size_t, const int *, void *);
typedef int Rates3(void *, const unsigned *, size_t, const int *, void *, size_t);
typedef int Step2(void *, double, double, int);
typedef int Step3(void *, double, double, bool, unsigned char *, unsigned char *, unsigned char *, double *);

typedef struct {
    int kind, types; /* of a copy: 16 times the type of the source, plus the type of the target */
    int number;      /* of a call in a process of components, see isolated.py; else 0 */
    long every;      /* step of the component over the communication step */
    long at_end;     /* whether the action belongs to the end of this step, else to its begin */
    long from_row;   /* first row whose step has the action */
    long part, parts; /* of a step that is made in equal parts; else 0 */
    double last;     /* length of the last step of the run [s] */
    void *function, *component;
    const unsigned *references;
    size_t n_references, n;
    void *values; /* of a call; target of a copy */
    const void *source;
    const ptrdiff_t *to, *from;
    const double *factor, *offset;
    void *more; /* slopes of a ramp; orders of derivatives */
    unsigned char *flags; /* event, end of simulation, early return */
    double *reached;
} Action;

typedef struct {
    char *block;
    const char *memory;
    const ptrdiff_t *columns;
    size_t n, size;
    long first; /* row of the run that is first in the block */
} Rows;

typedef struct {
    const Action *actions;
    const Rows *rows;
    const double *outputs;
    const ptrdiff_t *watched;
    size_t n_actions, n_rows, n_watched;
    double *clock, *size, *time;
    const volatile int *waiting; /* whether a message waits */
    double begin, step, rest;
    long n;
    long *row;    /* last complete row */
    int *running; /* number of the call; negative after it */
    size_t action;
    int status;
    double point, length; /* arguments of the last call of a step */
    double event;         /* time of the next event that is known [s] */
    int pending;          /* whether there is an event at the end of this step */
} Master;

static double now(void)
{
#ifdef _WIN32
    return 1e-3 * (double)GetTickCount64();
#else
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
#endif
}

#define MOVE(from, to, From, To)                                                                                       \
    case 16 * from + to:                                                                                               \
        ((To *)a->values)[t] = (To)((const From *)a->source)[s];                                                       \
        break;
#define WHOLE(other, Other)                                                                                            \
    case 16 * LONG + other: {                                                                                          \
        const int64_t x = ((const int64_t *)a->source)[s];                                                             \
        const Other y = ((Other *)a->values)[t] = (Other)x;                                                            \
        bad |= (int64_t)y != x || (y < 1) != (x < 1);                                                                  \
        break;                                                                                                         \
    }                                                                                                                  \
    case 16 * other + LONG: {                                                                                          \
        const Other x = ((const Other *)a->source)[s];                                                                 \
        const int64_t y = ((int64_t *)a->values)[t] = (int64_t)x;                                                      \
        bad |= (y < 1) != (x < 1);                                                                                     \
        break;                                                                                                         \
    }                                                                                                                  \
    case 16 * other + DOUBLE: {                                                                                        \
        const Other x = ((const Other *)a->source)[s];                                                                 \
        ((double *)a->values)[t] = (double)x;                                                                          \
        bad |= ((int64_t)x < 1) != (x < 1);                                                                            \
        break;                                                                                                         \
    }
#define TRUTH(to, To)                                                                                                  \
    case 16 * BOOL + to: /* an FMU may set any bit, which a bool may not have */                                       \
        ((To *)a->values)[t] = ((const unsigned char *)a->source)[s] != 0;                                             \
        break;

/* Copy values; return whether an integer does not fit. */
static bool copy(const Action *a)
{
    bool bad = false;
    for (size_t j = 0; j < a->n; j++) {
        const ptrdiff_t t = a->to[j], s = a->from[j];
        switch (a->types) {
            MOVE(DOUBLE, DOUBLE, double, double)
            MOVE(DOUBLE, FLOAT, double, float)
            MOVE(FLOAT, DOUBLE, float, double)
            MOVE(LONG, LONG, int64_t, int64_t)
            MOVE(INT, INT, int32_t, int32_t)
            MOVE(INT, BOOL, int32_t, bool)
            MOVE(INT, BYTE, int32_t, int8_t) /* a boolean of FMI 1.0 */
            MOVE(BYTE, INT, int8_t, int32_t)
            MOVE(LONG, DOUBLE, int64_t, double)
            TRUTH(INT, int32_t)
            TRUTH(LONG, int64_t)
            TRUTH(DOUBLE, double)
            WHOLE(INT, int32_t)
            WHOLE(SHORT, int16_t)
            WHOLE(BYTE, int8_t)
            WHOLE(UNSIGNED_LONG, uint64_t)
            WHOLE(UNSIGNED_INT, uint32_t)
            WHOLE(UNSIGNED_SHORT, uint16_t)
            WHOLE(UNSIGNED_BYTE, uint8_t)
        default: bad = true; /* left to Python */
        }
    }
    return bad;
}

/* Return whether a discrete input differs from the value that was set last. */
static bool changed(const Action *a)
{
    bool differs = false;
    for (size_t j = 0; j < a->n; j++) {
        const ptrdiff_t s = a->from[j];
        switch (a->types) {
        case DOUBLE: differs |= ((const double *)a->source)[s] != ((const double *)a->values)[j]; break;
        case LONG: differs |= ((const int64_t *)a->source)[s] != ((const int64_t *)a->values)[j]; break;
        case INT: differs |= ((const int32_t *)a->source)[s] != ((const int32_t *)a->values)[j]; break;
        }
    }
    return differs;
}

/* Do a copy by lines over a step of h: a prediction from the last two values, a value by its rate, or inputs at a place
 * on their lines with their slopes. */
static void lines(const Action *a, double h, double ratio)
{
    double *values = a->values;
    const double *begin = a->source, *other = a->factor;
    for (size_t j = 0; j < a->n; j++)
        if (a->kind == PREDICTED)
            values[j] = (begin[j] - other[j]) * ratio + begin[j];
        else if (a->kind == LINE)
            values[a->to[j]] = begin[a->from[j]] + h * other[j];
        else {
            const double change = other[j] - begin[j];
            values[j] = begin[j] + a->offset[j] * change;
            ((double *)a->more)[j] = change * ((1.0 - a->offset[j]) / h);
        }
}

/* Return the step from a time to a stop that does not lead beyond it for any rounding. */
static double largest_step(double time, double stop)
{
    double step = stop - time;
    while (time + step > stop) { /* the next smaller number; math.h needs another library */
        int64_t bits;
        memcpy(&bits, &step, 8);
        bits--;
        memcpy(&step, &bits, 8);
    }
    return step;
}

/* Do an action; return whether Python must judge it. */
static bool act(Master *m, const Action *a)
{
    switch (a->kind) {
    case COPY: return copy(a);
    case CHANGED: m->pending |= changed(a); return false;
    case PREDICTED:
    case LINE:
    case RAMP: lines(a, m->length, m->length / m->step); return false;
    case RATES_2:
        m->status = ((Rates2 *)a->function)(a->component, a->references, a->n_references, a->more, a->values);
        break;
    case RATES_3:
        m->status = ((Rates3 *)a->function)(a->component, a->references, a->n_references, a->more, a->values, a->n);
        break;
    case SCALED:
        for (size_t j = 0; j < a->n; j++)
            ((double *)a->values)[a->to[j]] = ((const double *)a->source)[a->from[j]] * a->factor[j] + a->offset[j];
        return false;
    case VALUES_2: m->status = ((Values2 *)a->function)(a->component, a->references, a->n_references, a->values); break;
    case VALUES_3:
        m->status = ((Values3 *)a->function)(a->component, a->references, a->n_references, a->values, a->n);
        break;
    case STEP_2: m->status = ((Step2 *)a->function)(a->component, m->point, m->length, 1); break;
    case STEP_3:
        m->status = ((Step3 *)a->function)(a->component, m->point, m->length, true, a->flags, a->flags + 1,
                                           a->flags + 2, a->reached);
        return m->status || a->flags[0] || a->flags[1] || a->flags[2];
    }
    return m->status != 0;
}

/* Do steps from the last complete row to row `end`, the first from its action `first` on. Returns after a step with a
 * message, after `most` seconds, or when Python must judge an action, handle an event, or do a step with an event. */
SHOWN int do_steps(Master *m, size_t first, long end, double most)
{
    const double until = now() + most;
    while (*m->row < end) {
        const long k = *m->row;
        if (first == 0) {
            *m->clock = *m->time = m->begin + (double)k * m->step;
            *m->size = k < m->n - 1 ? m->step : m->rest;
            if (m->event <= *m->clock + *m->size * (1.0 + 1e-9))
                return BY_HAND;
        }
        for (size_t i = first; i < m->n_actions; i++) {
            const Action *a = &m->actions[i];
            const long begun = a->every == 1 ? k : k - k % a->every;
            const long last = (begun + a->every < m->n ? begun + a->every : m->n) - 1;
            if (k != (a->at_end ? last : begun) || k < a->from_row)
                continue;
            m->action = i;
            m->point = m->begin + (double)begun * m->step;
            m->length = last == m->n - 1 ? a->last : m->step * (double)(last + 1 - begun);
            if (a->parts) {
                const double stop = m->point + m->length;
                m->point = *m->clock = m->point + (double)a->part * m->length / (double)a->parts;
                m->length /= (double)a->parts;
                if (a->part && a->part == a->parts - 1)
                    m->length = largest_step(m->point, stop);
                *m->size = m->length;
            }
            if (a->number)
                *m->running = a->number;
            const bool asks = act(m, a);
            if (a->number)
                *m->running = -a->number;
            if (asks)
                return ASKS;
        }
        if (m->pending)
            return EVENT;
        first = 0;
        double zero = 0.0;
        for (size_t j = 0; j < m->n_watched; j++)
            zero += 0.0 * m->outputs[m->watched[j]];
        if (!(zero == 0.0))
            return NOT_FINITE;
        for (const Rows *r = m->rows; r < m->rows + m->n_rows; r++) {
            char *row = r->block + (size_t)(k + 1 - r->first) * r->n * r->size;
            for (size_t j = 0; j < r->n; j++)
                if (r->size == 8)
                    memcpy(row + 8 * j, r->memory + 8 * r->columns[j], 8);
                else
                    memcpy(row + 4 * j, r->memory + 4 * r->columns[j], 4);
        }
        *m->row = k + 1;
        if (*m->waiting || now() > until)
            break;
    }
    return REACHED;
}
