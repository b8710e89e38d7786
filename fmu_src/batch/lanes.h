/* Numbers of several runs at once: from the end of this file on a `double` is a vector of LANES of them, one a run.
 *
 * So the C of the traced functions, which is that of the FMUs, steps LANES parameter sets at once. `scalar` is a number as
 * it was. What is compared gives a `mask`; `a < b ? c : d` chooses lane by lane. Lanes do not meet: each has the bits that it
 * has beside any others.
 */
#ifndef VDFMU_LANES_H
#define VDFMU_LANES_H

#include <stdbool.h>

#include "elementary.h"

INLINE mask finite_lanes(real x)
{
    return x - x == 0.0;
}

/* ---------------------------------------------------------------- functions of one number, lane by lane */

#define APART static __attribute__((unused, const, noinline))
#define BY_LANE(name)                                                                                                          \
    APART real lanes_##name(real x)                                                                                            \
    {                                                                                                                          \
        for (int i = 0; i < LANES; i++)                                                                                        \
            x[i] = one_##name(x[i]);                                                                                           \
        return x;                                                                                                              \
    }
#define BY_LANE_OF_TWO(name)                                                                                                   \
    APART real lanes_##name(real x, real y)                                                                                    \
    {                                                                                                                          \
        for (int i = 0; i < LANES; i++)                                                                                        \
            x[i] = one_##name(x[i], y[i]);                                                                                     \
        return x;                                                                                                              \
    }

BY_LANE(tan)
BY_LANE(asin)
BY_LANE(acos)
BY_LANE(sinh)
BY_LANE(cosh)
BY_LANE(asinh)
BY_LANE(acosh)
BY_LANE(atanh)
BY_LANE(log)
BY_LANE(log1p)
BY_LANE_OF_TWO(pow)
BY_LANE_OF_TWO(atan2)
BY_LANE_OF_TWO(hypot)
BY_LANE_OF_TWO(fmod)

/* ---------------------------------------------------------------- several vectors of an array */

#define EACH(name)                                                                                                             \
    INLINE void each_##name(real *x, int n)                                                                                    \
    {                                                                                                                          \
        for (int i = 0; i < n; i++)                                                                                            \
            x[i] = lanes_##name(x[i]);                                                                                         \
    }

EACH(exp)
EACH(expm1)
EACH(tanh)
EACH(atan)

/* sin in their place, and cos */
INLINE void each_sin_cos(real *x, real *cosine, int n)
{
    for (int i = 0; i < n; i++)
        lanes_sin_cos(x[i], x + i, cosine + i);
}

/* ---------------------------------------------------------------- names */

#define sin lanes_sin
#define cos lanes_cos
#define tan lanes_tan
#define asin lanes_asin
#define acos lanes_acos
#define atan lanes_atan
#define atan2 lanes_atan2
#define sinh lanes_sinh
#define cosh lanes_cosh
#define tanh lanes_tanh
#define asinh lanes_asinh
#define acosh lanes_acosh
#define atanh lanes_atanh
#define hypot lanes_hypot
#define exp lanes_exp
#define expm1 lanes_expm1
#define log lanes_log
#define log1p lanes_log1p
#define pow lanes_pow
#define fmod lanes_fmod
#define sqrt __builtin_elementwise_sqrt
#define floor __builtin_elementwise_floor
#define ceil __builtin_elementwise_ceil
#define fabs __builtin_elementwise_abs
#define copysign __builtin_elementwise_copysign
#define fmin __builtin_elementwise_min
#define fmax __builtin_elementwise_max
#define double real

#endif
