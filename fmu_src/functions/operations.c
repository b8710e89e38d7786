#include <string.h>

#include "elementary.h"
#include "operations.h"

/* a value and its slopes along its operands */
static inline void operate(int code, double a, double b, double *value, double *by_a, double *by_b)
{
    switch (code) {
    /* CASES */
    default: *value = *by_a = *by_b = 0.0; return;
    }
}

static double times(double slope, double d)
{
    return slope == 0.0 || d == 0.0 ? 0.0 : slope * d;
}

static void run_forward(const Operations *of, double *w, double *d)
{
    for (int k = 0; k < of->n_lines; k++) {
        const int *line = of->lines + 4 * k, t = line[1], a = line[2], b = line[3];
        double value, by_a, by_b;
        operate(line[0], w[a], w[b], &value, &by_a, &by_b);
        w[t] = value;
        d[t] = times(by_a, d[a]) + times(by_b, d[b]);
    }
}

static void run_back(const Operations *of, const double *w, double *d)
{
    for (int k = of->n_lines - 1; k >= 0; k--) {
        const int *line = of->lines + 4 * k, t = line[1], a = line[2], b = line[3];
        double value, by_a, by_b;
        if (d[t] == 0.0)
            continue;
        operate(line[0], w[a], w[b], &value, &by_a, &by_b);
        d[a] += times(by_a, d[t]);
        d[b] += times(by_b, d[t]);
    }
}

static size_t size_of(const Operations *of, int k)
{
    return (size_t)(of->begins[k + 1] - of->begins[k]) * sizeof(double);
}

void run_operations(const Operations *of, const double *const *given, double *const *made, double *w, double *d,
    int back)
{
    const int n = of->n_arguments, m = of->n_results, *begins = of->begins;
    const double *const *direction = given + n;
    for (int k = 0; k < n; k++)
        memcpy(w + begins[k], given[k], size_of(of, k));
    memcpy(w + of->n - of->n_constants, of->constants, (size_t)of->n_constants * sizeof(double));
    memset(d, 0, (size_t)of->n * sizeof(double));
    if (back)
        run_forward(of, w, d);
    for (int k = back ? n : 0; k < (back ? n + m : n); k++)
        memcpy(d + begins[k], *direction++, size_of(of, k));
    if (back)
        run_back(of, w, d);
    else
        run_forward(of, w, d);
    for (int k = back ? 0 : n; k < (back ? n : n + m); k++)
        memcpy(*made++, d + begins[k], size_of(of, k));
}
