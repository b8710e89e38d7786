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

static void run_block(const Operations *of, const Span *block, const Work *work, int back)
{
    const int bits = of->slope_bits, *moved = work->moved;
    const int64_t mask = ((int64_t)1 << bits) - 1;
    double *w = work->w, *d = work->d;
    for (int k = block->begin; k < block->end; k++) {
        const int64_t *line = of->lines + 4 * (back ? block->begin + block->end - 1 - k : k);
        const int64_t word = line[0] >> CODE_BITS;
        const int64_t t = line[1] + moved[word & mask];
        const int64_t a = line[2] + moved[word >> bits & mask], b = line[3] + moved[word >> 2 * bits];
        double value, by_a, by_b;
        if (back && d[t] == 0.0)
            continue;
        operate(line[0] & ((1 << CODE_BITS) - 1), w[a], w[b], &value, &by_a, &by_b);
        if (back) {
            d[a] += times(by_a, d[t]);
            d[b] += times(by_b, d[t]);
        } else {
            w[t] = value;
            d[t] = times(by_a, d[a]) + times(by_b, d[b]);
        }
    }
}

static void run_passes(const Operations *of, const Work *work, int back)
{
    for (int k = 0; k < of->n_passes; k++) {
        const Span *pass = of->passes + (back ? of->n_passes - 1 - k : k);
        const int first = back ? pass->last : pass->first, last = back ? pass->first : pass->last;
        const int change = first <= last ? 1 : -1;
        for (int i = first; i != last + change; i += change) {
            of->move(i, work->moved);
            for (int m = pass->begin; m < pass->end; m++) {
                const Span *block = of->blocks + (back ? pass->begin + pass->end - 1 - m : m);
                if (i >= block->first && i <= block->last)
                    run_block(of, block, work, back);
            }
        }
    }
}

static size_t size_of(const Operations *of, int k)
{
    return (size_t)(of->begins[k + 1] - of->begins[k]) * sizeof(double);
}

void run_operations(const Operations *of, const double *const *given, double *const *made, const Work *work, int back)
{
    const int n = of->n_arguments, m = of->n_results, *begins = of->begins;
    const double *const *direction = given + n;
    for (int k = 0; k < n; k++)
        memcpy(work->w + begins[k], given[k], size_of(of, k));
    memcpy(work->w + of->n - of->n_constants, of->constants, (size_t)of->n_constants * sizeof(double));
    memset(work->d, 0, (size_t)of->n * sizeof(double));
    if (back)
        run_passes(of, work, 0);
    for (int k = back ? n : 0; k < (back ? n + m : n); k++)
        memcpy(work->d + begins[k], *direction++, size_of(of, k));
    run_passes(of, work, back);
    for (int k = back ? 0 : n; k < (back ? n : n + m); k++)
        memcpy(*made++, work->d + begins[k], size_of(of, k));
}
