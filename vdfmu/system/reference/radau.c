/* Radau IIA of five stages, order 9, with an old Jacobian.
 *
 * Hairer, Wanner: Solving Ordinary Differential Equations II, 1996, section IV.8: simplified Newton iterations in the
 * eigenvectors of A^-1, (8.13), and the estimate (8.20) of the error. The polynomial of the stages is the solution
 * within a step. */
#include "solvers.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { STAGES = 5, BLOCKS = 3, MOST_ROUNDS = 10 };

/* Nodes c: the zeros of P_4 - P_5, of Legendre's polynomials on [0, 1]. */
static const double NODES[STAGES] = {
    0.057104196114517669, 0.27684301363812347, 0.58359043236891694, 0.86024013565621937, 1.0,
};
/* Eigenvalues of A^-1, one of each pair. */
static const double REAL[BLOCKS] = {6.2867047517293182, 3.6556943254635588, 5.7009532986718616};
/* Their imaginary parts. */
static const double IMAGINARY[BLOCKS] = {0.0, 6.5437368993600193, 3.2102656003084311};
/* Eigenvectors of A^-1 by columns: the first, then of each pair the real part and the negative imaginary part. */
static const double FROM[STAGES * STAGES] = {
    0.012517586220501465, 0.0085405461731274373, -0.039753861482457367, -0.010417478092524234, -0.012723908069058902,
    0.0014916701518936921, -0.0418376943426753, 0.078660563945728207, -0.0069599486125585626, 0.022424596625285564,
    0.072981876388086744, 0.19224022092404716, -0.085641086312469347, 0.017605332156911041, 0.074238991169293778,
    0.38009144000356565, -0.3151147483471976, -0.38920437270087388, 0.36992382532789075, 0.18122442421507376,
    0.92197897368121151, -0.83387095285722856, 0.0, 0.90756320489960995, 0.0,
};
/* Its inverse. */
static const double INTO[STAGES * STAGES] = {
    30.041567721546155, 13.865107856272331, 3.4800027747952913, -1.0320087978252417, 0.80430304507395678,
    -6.4088890727315428, -5.5087847250452873, 3.6412832381982416, -1.2599793608728218, 0.32712329279443503,
    -4.4947719963103729, 4.7788758232789359, 1.2524907337631803, -1.4200021766925577, 0.53955323496419094,
    -36.407249693618411, -19.146824579546809, -0.18966068955290963, -0.10927038188324766, 0.58533456730111877,
    -9.4885336176966817, 10.687951381416211, 2.1097468797324126, 2.6650397383095039, -1.1541493554172984,
};
/* Derivative at 0 of the polynomial that is 0 there, and a stage at its node, by stages. */
static const double SLOPE[STAGES] = {
    27.780933944064646, -3.6414784980492132, 1.2525477211691149, -0.59200316718454127, 0.2,
};

/* Last change of the stages, and the largest one at which only rounding is left, relative to the tolerance. A state
 * that converges more slowly than the others does not show in their norm, so the first is small. */
static const double LEFT = 0.001, ROUNDING = 0.1;
/* Largest error of the polynomial, relative to the estimate: the ratio for a smooth solution and a short step. */
static const double OF_ESTIMATE = 0.19;

struct Radau {
    Problem problem;
    double h;                 /* of `inverse` and the blocks after it; 0 without */
    double before;            /* length of the last step; 0 without */
    double rate_of_iteration; /* of the last iterations; 1 if unknown */
    /* by columns: df/dx (n, n); real and imaginary part of (lambda / h - J)^-1 of each block; two matrices of work */
    double *slopes, *inverses, *spare;
    double *start, *f, *scale, *work;           /* (n,) */
    double *z, *w, *rates, *left, *steps, *last; /* (STAGES, n); `last` is `z` of the last step */
};

enum { MATRICES = 3 + 2 * BLOCKS, VECTORS = 4, ALL_STAGES = 6 };

/* Numbers of `struct Radau`. */
enum { HEAD = (sizeof(Radau) + sizeof(double) - 1) / sizeof(double) };

/* Return the numbers of its memory. */
size_t radau_room(size_t n)
{
    return HEAD + n * (MATRICES * n + VECTORS + ALL_STAGES * STAGES);
}

/* Return the solver after the explicit solver's memory. */
Radau *radau_of(const Problem *problem)
{
    return (Radau *)(problem->room + EXPLICIT_ROOM * problem->n);
}

void new_radau(const Problem *problem)
{
    size_t n = problem->n, matrix = n * n, stages = STAGES * n;
    Radau *r = radau_of(problem);
    double *room = (double *)r + HEAD, **matrices[] = {&r->slopes, &r->inverses, &r->spare};
    double **vectors[] = {&r->start, &r->f, &r->scale, &r->work};
    double **all[] = {&r->z, &r->w, &r->rates, &r->left, &r->steps, &r->last};
    const size_t sizes[] = {matrix, 2 * BLOCKS * matrix, 2 * matrix};
    for (int i = 0; i < 3; i++) *matrices[i] = room, room += sizes[i];
    for (int i = 0; i < 4; i++) *vectors[i] = room, room += n;
    for (int i = 0; i < 6; i++) *all[i] = room, room += stages;
    r->problem = *problem;
}

/* Set `f` to the rates of states. */
static void evaluate(Radau *r, double t, const double *x, double *f)
{
    memcpy(r->problem.x, x, r->problem.n * sizeof(double));
    r->problem.rate(t);
    memcpy(f, r->problem.x_dot, r->problem.n * sizeof(double));
}

/* Begin at the states `x`, without a step before. */
void start_radau(Radau *r)
{
    r->before = 0.0;
    memcpy(r->start, r->problem.x, r->problem.n * sizeof(double));
}

/* Calculate the Jacobian at the start of a step by differences. Return whether it is finite. */
int renew_slopes(Radau *r, double t)
{
    size_t n = r->problem.n;
    double *x = r->problem.x, sum = 0.0;
    evaluate(r, t, r->start, r->f);
    for (size_t j = 0; j < n; j++) {
        double change = sqrt(DBL_EPSILON) * (1.0 + fabs(x[j]));
        x[j] += change;
        r->problem.rate(t);
        for (size_t i = 0; i < n; i++) {
            r->slopes[j * n + i] = (r->problem.x_dot[i] - r->f[i]) / change;
            sum += fabs(r->slopes[j * n + i]);
        }
        x[j] = r->start[j];
    }
    r->h = 0.0;
    return isfinite(sum);
}

static void swap(double *a, double *b, size_t n)
{
    for (size_t j = 0; j < n; j++) {
        double other = a[j];
        a[j] = b[j];
        b[j] = other;
    }
}

/* Subtract `factor` times a complex row from another. */
static void subtract(double *restrict re, double *restrict im, const double *row_re, const double *row_im, double f_re,
                     double f_im, size_t n)
{
    for (size_t j = 0; j < n; j++) {
        re[j] -= f_re * row_re[j] - f_im * row_im[j];
        im[j] -= f_re * row_im[j] + f_im * row_re[j];
    }
}

/* Set `p` + i `q` to the inverse of (real + i imaginary) - J by elimination with pivots. Both are by columns: the rows
 * of the transposed matrices. `a` and `b` are work. Return whether the matrix is regular. */
static int invert(const double *slopes, size_t n, double real, double imaginary, double *p, double *q, double *a,
                  double *b)
{
    for (size_t i = 0; i < n * n; i++) {
        int diagonal = i % (n + 1) == 0;
        a[i] = (diagonal ? real : 0.0) - slopes[i];
        b[i] = diagonal ? imaginary : 0.0;
        p[i] = diagonal;
        q[i] = 0.0;
    }
    for (size_t k = 0; k < n; k++) {
        size_t pivot = k;
        double most = 0.0;
        for (size_t i = k; i < n; i++) {
            double size = a[i * n + k] * a[i * n + k] + b[i * n + k] * b[i * n + k];
            if (size > most) most = size, pivot = i;
        }
        if (!(most > 0.0)) return 0;
        double *rows[] = {a, b, p, q};
        for (int i = 0; i < 4; i++) swap(rows[i] + k * n, rows[i] + pivot * n, pivot == k ? 0 : n);
        double *a_k = a + k * n, *b_k = b + k * n, *p_k = p + k * n, *q_k = q + k * n;
        double re = a_k[k] / most, im = -b_k[k] / most; /* of 1 / pivot */
        for (size_t j = 0; j < n; j++) {
            double x = a_k[j], y = b_k[j], u = p_k[j], v = q_k[j];
            a_k[j] = re * x - im * y;
            b_k[j] = re * y + im * x;
            p_k[j] = re * u - im * v;
            q_k[j] = re * v + im * u;
        }
        for (size_t i = 0; i < n; i++) {
            double f_re = a[i * n + k], f_im = b[i * n + k];
            if (i == k || (f_re == 0.0 && f_im == 0.0)) continue;
            subtract(a + i * n + k, b + i * n + k, a_k + k, b_k + k, f_re, f_im, n - k);
            subtract(p + i * n, q + i * n, p_k, q_k, f_re, f_im, n);
        }
    }
    return 1;
}

static int invert_blocks(Radau *r, double h)
{
    size_t n = r->problem.n, matrix = n * n;
    for (int k = 0; k < BLOCKS; k++) {
        double *p = r->inverses + 2 * k * matrix, re = REAL[k] / h, im = IMAGINARY[k] / h;
        if (!invert(r->slopes, n, re, im, p, p + matrix, r->spare, r->spare + matrix)) return 0;
    }
    r->h = h;
    r->rate_of_iteration = 1.0;
    return 1;
}

/* Add `sign` times a matrix by columns times `v`. */
static void add_product(double *restrict y, const double *restrict matrix, const double *restrict v, size_t n,
                        double sign)
{
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) y[i] += sign * v[j] * matrix[j * n + i];
}

/* Set the stages `y` to `matrix` (STAGES, STAGES) times `x`. */
static void mix(double *restrict y, const double *matrix, const double *restrict x, size_t n)
{
    memset(y, 0, STAGES * n * sizeof(double));
    for (size_t i = 0; i < STAGES; i++)
        for (size_t j = 0; j < STAGES; j++)
            for (size_t k = 0; k < n; k++) y[i * n + k] += matrix[i * STAGES + j] * x[j * n + k];
}

/* Root mean square of rows over the tolerance. */
static double size_of(const double *v, const double *scale, size_t rows, size_t n)
{
    double sum = 0.0;
    for (size_t i = 0; i < rows * n; i++) sum += v[i] / scale[i % n] * (v[i] / scale[i % n]);
    return sqrt(sum / (double)(rows * n));
}

/* Set `steps` to Newton's changes in eigenvectors, from the rates and `w`. `left` is the residual there. */
static void newton(Radau *r, double h)
{
    size_t n = r->problem.n, matrix = n * n;
    double *g = r->left, *d = r->steps;
    mix(g, INTO, r->rates, n);
    memset(d, 0, STAGES * n * sizeof(double));
    for (size_t k = 0; k < n; k++) g[k] -= REAL[0] / h * r->w[k];
    add_product(d, r->inverses, g, n, 1.0);
    for (int block = 1; block < BLOCKS; block++) {
        const double *p = r->inverses + 2 * block * matrix, *q = p + matrix;
        size_t first = (2 * block - 1) * n, second = first + n;
        double re = REAL[block] / h, im = IMAGINARY[block] / h;
        for (size_t k = 0; k < n; k++) {
            g[first + k] -= re * r->w[first + k] - im * r->w[second + k];
            g[second + k] -= re * r->w[second + k] + im * r->w[first + k];
        }
        add_product(d + first, p, g + first, n, 1.0);
        add_product(d + first, q, g + second, n, -1.0);
        add_product(d + second, p, g + second, n, 1.0);
        add_product(d + second, q, g + first, n, 1.0);
    }
}

/* Solve the stages from the guess `z`. Return the number of rounds; 0 if they do not converge. */
static int iterate(Radau *r, double t, double h)
{
    size_t n = r->problem.n;
    double before = 0.0;
    mix(r->w, INTO, r->z, n);
    r->rate_of_iteration = pow(r->rate_of_iteration, 0.8); /* which may have grown since the last step */
    for (int round = 1; round <= MOST_ROUNDS; round++) {
        for (size_t i = 0; i < STAGES; i++) {
            for (size_t k = 0; k < n; k++) r->work[k] = r->start[k] + r->z[i * n + k];
            evaluate(r, t + NODES[i] * h, r->work, r->rates + i * n);
        }
        newton(r, h);
        for (size_t k = 0; k < STAGES * n; k++) r->w[k] += r->steps[k];
        mix(r->z, FROM, r->w, n);
        mix(r->left, FROM, r->steps, n);
        double size = size_of(r->left, r->scale, STAGES, n);
        if (!isfinite(size)) return 0;
        if (round > 1) r->rate_of_iteration = fmax(size / before, DBL_EPSILON);
        double rate = r->rate_of_iteration;
        if (rate < 1.0 && rate / (1.0 - rate) * size <= LEFT) return round;
        if (round > 1 && rate >= 1.0) return size <= ROUNDING ? round : 0;
        before = size;
    }
    return 0;
}

/* Set `x` to the states less those at the end of the last step, by its polynomial at `part` of it: above 1 beyond. */
static void after_last(const Radau *r, double part, double *x)
{
    size_t n = r->problem.n;
    for (size_t k = 0; k < n; k++) x[k] = -r->last[(STAGES - 1) * n + k];
    for (int j = 0; j < STAGES; j++) {
        double weight = part / NODES[j];
        for (int i = 0; i < STAGES; i++) weight *= i == j ? 1.0 : (part - NODES[i]) / (NODES[j] - NODES[i]);
        for (size_t k = 0; k < n; k++) x[k] += weight * r->last[j * n + k];
    }
}

/* Solve the stages of a step. Return the rounds, 0 if they do not converge; set the error over the tolerance. */
int try_step(Radau *r, double t, double h, double *error)
{
    size_t n = r->problem.n;
    if (fabs(h - r->h) > 1e-6 * h && !invert_blocks(r, h)) return 0;
    for (size_t k = 0; k < n; k++) r->scale[k] = r->problem.absolute + r->problem.relative * fabs(r->start[k]);
    memset(r->z, 0, STAGES * n * sizeof(double));
    for (size_t i = 0; i < STAGES && r->before > 0.0; i++)
        after_last(r, 1.0 + NODES[i] * h / r->before, r->z + i * n);
    evaluate(r, t, r->start, r->f);
    int rounds = iterate(r, t, h);
    for (size_t k = 0; k < n; k++) {
        double slope = 0.0;
        for (size_t i = 0; i < STAGES; i++) slope += SLOPE[i] * r->z[i * n + k];
        r->left[k] = r->f[k] - slope / h;
    }
    memset(r->work, 0, n * sizeof(double));
    add_product(r->work, r->inverses, r->left, n, OF_ESTIMATE);
    *error = size_of(r->work, r->scale, 1, n);
    return isfinite(*error) ? rounds : 0;
}

/* Accept a step. The states are at its end. */
void take_step(Radau *r, double h)
{
    size_t n = r->problem.n;
    for (size_t k = 0; k < n; k++) r->problem.x[k] = r->start[k] + r->z[(STAGES - 1) * n + k];
    memcpy(r->start, r->problem.x, n * sizeof(double));
    memcpy(r->last, r->z, STAGES * n * sizeof(double));
    r->before = h;
}

/* Set `x` to the states at a time before the end `t` of the last step. */
void states_within(const Radau *r, double t, double at, double *x)
{
    after_last(r, 1.0 + (at - t) / r->before, x);
    for (size_t k = 0; k < r->problem.n; k++) x[k] += r->start[k];
}
