/* Numbers of several runs at once: from the end of this file on a `double` is a vector of LANES of them, one a run.
 *
 * So the C of the traced functions, which is that of the FMUs, steps LANES parameter sets at once. `scalar` is a number as
 * it was. What is compared gives a `mask`; `a < b ? c : d` chooses lane by lane. Lanes do not meet: each has the bits that it
 * has beside any others.
 *
 * The functions are below 3 units in the last place of their values (tests/study/batch/test_lanes.py): Taylor polynomials on
 * short intervals, to which arguments are reduced exactly or with the rest kept. Those that no shipped unit calls in a step
 * are the C library's, lane by lane.
 */
#ifndef VDFMU_LANES_H
#define VDFMU_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

typedef double scalar;
typedef double real __attribute__((ext_vector_type(LANES)));
typedef int64_t mask __attribute__((ext_vector_type(LANES)));

#define INLINE static inline __attribute__((unused))
#define APART static __attribute__((unused, const, noinline)) /* measured: inlined, exp and tanh take a step longer */

INLINE bool any(mask m)
{
    return __builtin_reduce_or(m) != 0;
}

INLINE mask finite_lanes(real x)
{
    return x - x == 0.0;
}

/* ---------------------------------------------------------------- functions of the C library, lane by lane */

#define BY_LANE(name)                                                                                                          \
    APART real lanes_##name(real x)                                                                                            \
    {                                                                                                                          \
        for (int i = 0; i < LANES; i++)                                                                                        \
            x[i] = name(x[i]);                                                                                                 \
        return x;                                                                                                              \
    }
#define BY_LANE_OF_TWO(name)                                                                                                   \
    APART real lanes_##name(real x, real y)                                                                                    \
    {                                                                                                                          \
        for (int i = 0; i < LANES; i++)                                                                                        \
            x[i] = name(x[i], y[i]);                                                                                           \
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

/* ---------------------------------------------------------------- exp, expm1, tanh */

#define INTEGER 0x1.8p52 /* added to an integer below 2^51, it puts it into the last bits */

/* 2^k, -1022 <= k <= 1023; infinity for k = 1024 */
INLINE real power_of_2(real k)
{
    return __builtin_bit_cast(real, __builtin_bit_cast(mask, k + (INTEGER + 1023.0)) << 52);
}

/* e^x = 2^k (1 + *less), |x| < 2^20: k. The rest of the series is below 2^-58 at |r| = ln(2)/2. */
INLINE real reduced_exp(real x, real *less)
{
    const real k = __builtin_elementwise_roundeven(x * 0x1.71547652b82fep+0);
    const real r = (x - k * 0x1.62e42feep-1) - k * 0x1.a39ef35793c76p-33; /* ln 2, of whose first part k times is exact */
    const real r2 = r * r, r4 = r2 * r2;
    const real low = (1.0 / 2 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120));
    const real middle = (1.0 / 720 + r * (1.0 / 5040)) + r2 * (1.0 / 40320 + r * (1.0 / 362880));
    const real high = (1.0 / 3628800 + r * (1.0 / 39916800)) + r2 * (1.0 / 479001600 + r * (1.0 / 6227020800));
    *less = r + r2 * (low + r4 * (middle + r4 * high));
    return k;
}

APART real lanes_exp(real x)
{
    real less;
    const real kept = x < -708.0 ? -708.0 : x > 709.8 ? 709.8 : x; /* NaN stays */
    const real k = reduced_exp(kept, &less);
    return x < -708.0 ? 0.0 : (1.0 + less) * power_of_2(k); /* of k = 1024, from 709.44 on, infinity */
}

APART real lanes_expm1(real x)
{
    real less;
    const real kept = x < -50.0 ? -50.0 : x > 710.0 ? 710.0 : x;
    const real k = reduced_exp(kept, &less), half = __builtin_elementwise_floor(0.5 * k);
    const real p = power_of_2(half), q = power_of_2(k - half);
    return p * less * q + (p * q - 1.0);
}

APART real lanes_tanh(real x)
{
    real less;
    const real twice = -2.0 * __builtin_elementwise_abs(x);
    const real k = reduced_exp(twice < -50.0 ? -50.0 : twice, &less), p = power_of_2(k);
    const real e = p * less + (p - 1.0);
    return __builtin_elementwise_copysign(-e / (e + 2.0), x);
}

/* ---------------------------------------------------------------- sin, cos */

#define FAR 1e5 /* [rad] beyond it the C library reduces the argument */

APART real far_lanes(real x, real value, scalar function(scalar))
{
    for (int i = 0; i < LANES; i++)
        value[i] = fabs(x[i]) > FAR ? function(x[i]) : value[i];
    return value;
}

INLINE real with_far(real x, real value, scalar function(scalar))
{
    return any(__builtin_elementwise_abs(x) > FAR) ? far_lanes(x, value, function) : value;
}

/* x = n pi/2 + y + *rest: the last bits of *n are those of n */
INLINE real reduced_angle(real x, mask *n, real *rest)
{
    const real k = __builtin_elementwise_roundeven(x * 0x1.45f306dc9c883p-1);
    const real a = x - k * 0x1.921fb544p+0; /* pi/2 in three parts, of the first two of which k times is exact */
    const real second = k * 0x1.0b4611a6p-34;
    const real b = a - second;
    const real less = k * 0x1.3198a2e037073p-69 - ((a - b) - second);
    const real y = b - less;
    *n = __builtin_bit_cast(mask, k + INTEGER);
    *rest = (b - y) - less;
    return y;
}

/* sin(y + rest), |y| <= pi/4; what is left out is below 2^-60 of it */
INLINE real sin_near(real y, real rest)
{
    const real z = y * y, z2 = z * z;
    const real low = -1.0 / 6 + z * (1.0 / 120) + z2 * (-1.0 / 5040 + z * (1.0 / 362880));
    const real high = -1.0 / 39916800 + z * (1.0 / 6227020800) + z2 * (-1.0 / 1307674368000 + z * (1.0 / 355687428096000));
    return y + (y * z * (low + z2 * z2 * high) + rest * (1.0 - 0.5 * z));
}

/* cos(y + rest), |y| <= pi/4; what is left out is below 2^-58 of it */
INLINE real cos_near(real y, real rest)
{
    const real z = y * y, z2 = z * z, half = 0.5 * z, one = 1.0 - half;
    const real low = 1.0 / 24 + z * (-1.0 / 720) + z2 * (1.0 / 40320 + z * (-1.0 / 3628800));
    const real high = 1.0 / 479001600 + z * (-1.0 / 87178291200) + z2 * (1.0 / 20922789888000);
    return one + (((1.0 - one) - half) + (z2 * (low + z2 * z2 * high) - y * rest));
}

INLINE real lanes_sin(real x)
{
    mask n;
    real rest;
    const real y = reduced_angle(x, &n, &rest);
    const real value = (n & 1) != 0 ? cos_near(y, rest) : sin_near(y, rest);
    return with_far(x, (n & 2) != 0 ? -value : value, sin);
}

INLINE real lanes_cos(real x)
{
    mask n;
    real rest;
    const real y = reduced_angle(x, &n, &rest);
    const real value = (n & 1) != 0 ? sin_near(y, rest) : cos_near(y, rest);
    return with_far(x, ((n + 1) & 2) != 0 ? -value : value, cos);
}

/* ---------------------------------------------------------------- atan */

/* atan(x) = atan(c) + atan((x - c) / (1 + c x)) for c = 0, 53/128, 1, 309/128 and infinity, so that the series is needed up
 * to tan(pi/16) = 0.199 only, where the rest is below 2^-60. */
APART real lanes_atan(real x)
{
    const real a = __builtin_elementwise_abs(x);
    const mask second = a > 0.1989, third = a > 0.6682, fourth = a > 1.4966, last = a > 5.0273;
    const real c = fourth ? 2.4140625 : third ? 1.0 : second ? 0.4140625 : (real)0.0;
    const real begin = last     ? 0x1.921fb54442d18p+0
                       : fourth ? 1.1780751213422282
                       : third  ? 0x1.921fb54442d18p-1
                       : second ? 0.3925701350118286
                                : (real)0.0;
    const real rest = last     ? 6.123233995736766e-17
                      : fourth ? 8.238221398137885e-17
                      : third  ? 3.061616997868383e-17
                      : second ? 1.4769733768267405e-17
                               : (real)0.0;
    const real y = (last ? -1.0 : a - c) / (last ? a : 1.0 + c * a);
    const real z = y * y, z2 = z * z, z4 = z2 * z2;
    const real low = (-1.0 / 3 + z * (1.0 / 5)) + z2 * (-1.0 / 7 + z * (1.0 / 9));
    const real middle = (-1.0 / 11 + z * (1.0 / 13)) + z2 * (-1.0 / 15 + z * (1.0 / 17));
    const real high = (-1.0 / 19 + z * (1.0 / 21)) + z2 * (-1.0 / 23 + z * (1.0 / 25));
    return __builtin_elementwise_copysign(begin + (y + (y * z * (low + z4 * (middle + z4 * high)) + rest)), x);
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
