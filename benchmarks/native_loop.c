/* Loops of compiled code around FMI 2.0 calls and generated functions, with clocks. */
#define _POSIX_C_SOURCE 199309L
#include <stddef.h>
#include <string.h>
#include <time.h>

typedef int Transfer(void *component, const unsigned reference[], size_t n, double value[]);
typedef int DoStep(void *component, double point, double size, int keep);

enum { COPY, TRANSFER, DO_STEP };

typedef struct {
    int kind;
    void *function, *component;
    const void *index; /* of a transfer: value references; of a copy: positions in `source` */
    size_t n;
    double *value;        /* of a transfer and a copy */
    const double *source; /* of a copy */
} Action;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int act(const Action *a, double point, double size)
{
    switch (a->kind) {
    case TRANSFER: return ((Transfer *)a->function)(a->component, a->index, a->n, a->value);
    case DO_STEP: return ((DoStep *)a->function)(a->component, point, size, 1);
    default:
        for (size_t i = 0; i < a->n; i++)
            a->value[i] = a->source[((const ptrdiff_t *)a->index)[i]];
        return 0;
    }
}

/* Do the steps `first` to `last` of a master, each followed by a copy of the memory to its row. `seconds` has a sum for
 * each action, or is NULL. Returns the time of all steps [s]; a negative number if a call failed. */
double run_plan(const Action *plan, size_t n_actions, long first, long last, double size, const double *memory,
                size_t width, double *rows, double *seconds)
{
    const double began = now();
    for (long k = first; k < last; k++) {
        const double point = (double)k * size;
        for (size_t i = 0; i < n_actions; i++) {
            const double before = seconds ? now() : 0.0;
            if (act(&plan[i], point, size) > 1)
                return -1.0;
            if (seconds)
                seconds[i] += now() - before;
        }
        memcpy(rows + (size_t)(k + 1) * width, memory, width * sizeof *memory);
    }
    return now() - began;
}

/* Time that the clock around an action adds to its sum [s]: least of some means. */
double clock_cost(void)
{
    double least = 1.0;
    for (int k = 0; k < 50; k++) {
        double sum = 0.0;
        for (int i = 0; i < 1000; i++) {
            const double before = now();
            sum += now() - before;
        }
        least = sum < 1000.0 * least ? sum / 1000.0 : least;
    }
    return least;
}
