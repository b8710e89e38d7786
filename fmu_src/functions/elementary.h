/* Elementary functions bit-identical on every platform, in place of the C library's.
 *
 * They add, multiply, divide and take roots in double precision. IEEE 754 fixes these bits, without contraction. exp, expm1,
 * tanh, sin, cos and atan take LANES numbers at once and have no branch. Each lane has the bits that it has beside any
 * others. The other functions are called by no step of a shipped unit and take one number.
 *
 * Largest errors in units in the last place, measured against extended precision in every binade, beside multiples of pi/2 and
 * where branches meet (tests/compiler/native/test_elementary.py):
 *
 *     sin 2.6  cos 2.6  tan 4.1  asin 2.8  acos 2.8  atan 1.7  sinh 3.2  cosh 3.2  tanh 2.8  asinh 1.7  acosh 2.2  atanh 2.0
 *     exp 1.4  expm1 2.8  log 0.9  log1p 0.9
 *
 * An odd function of -0 is -0, and subnormal numbers are kept. exp is 0 below -708. All of it holds for rounding to nearest,
 * which the functions of an FMU set and restore (c/processor.h).
 */
#ifndef VDFMU_ELEMENTARY_H
#define VDFMU_ELEMENTARY_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifndef LANES
#define LANES 4
#define SCALARS /* a `double` stays a number */
#endif

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are passed within a file only */
#endif

typedef double scalar;
#if defined(__clang__)
typedef double real __attribute__((ext_vector_type(LANES)));
typedef __typeof__((real){0} == (real){0}) mask; /* integers as wide */
#define SELECT(condition, a, b) ((condition) ? (a) : (b))
#elif defined(__GNUC__)
typedef double real __attribute__((vector_size(8 * LANES)));
typedef __typeof__((real){0} == (real){0}) mask; /* integers as wide */
#define SELECT(condition, a, b) from_bits(((mask)(condition) & to_bits(a)) | (~(mask)(condition) & to_bits(b)))
#else
#undef LANES
#define LANES 1
typedef double real;
typedef int64_t mask;
#define SELECT(condition, a, b) ((condition) ? (a) : (b))
#endif

#ifdef __GNUC__
#define INLINE static inline __attribute__((unused))
#define WITHIN static inline __attribute__((unused, always_inline)) /* measured: a call takes a tenth of a step longer */
#else
#define INLINE static inline
#define WITHIN static inline
#endif

INLINE mask to_bits(real x)
{
    mask bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

INLINE real from_bits(mask bits)
{
    real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

INLINE real all(scalar x)
{
    return x - (real){0};
}

INLINE int any(mask m)
{
#if defined(__clang__)
    return __builtin_reduce_or(m) != 0;
#else
    int64_t bits[LANES], some = 0;
    memcpy(bits, &m, sizeof bits);
    for (int i = 0; i < LANES; i++)
        some |= bits[i];
    return some != 0;
#endif
}

#define SIGN INT64_MIN
#define MAGNITUDE(x) from_bits(to_bits(x) & INT64_MAX)
#define WITH_SIGN(x, of) from_bits((to_bits(x) & INT64_MAX) | (to_bits(of) & SIGN))
#define LAST_BITS 0x1.8p52 /* added to an integer below 2^51, it puts it into the last bits */

/* ---------------------------------------------------------------- exp, expm1, tanh */

#define TINY 0x1p-54 /* below, expm1(x) and tanh(x) are x, also for -0 and subnormal numbers, of which there is no half */

/* e^x = 2 half (1 + *less) for |x| < 2^20 with half = 2^(k - 1), -1021 <= k <= 1024: half. The polynomial interpolates at
 * Chebyshev's points. Its error is below 2^-54 of e^r. */
WITHIN real reduced_exp(real x, real *less)
{
    const real t = x * 0x1.71547652b82fep+0 + LAST_BITS, k = t - LAST_BITS;
    const real r = (x - k * 0x1.62e42feep-1) - k * 0x1.a39ef35793c76p-33; /* ln 2, of whose first part k times is exact */
    const real r2 = r * r, r4 = r2 * r2;
    const real a = 0.5 + r * 0x1.5555555555555p-3, b = 0x1.5555555554cb7p-5 + r * 0x1.1111111110e6ap-7;
    const real c = 0x1.6c16c1738ff55p-10 + r * 0x1.a01a01a4b322fp-13;
    const real d = 0x1.a019c9a5652d3p-16 + r * 0x1.71de17e40edfep-19;
    const real e = 0x1.2880411bad1aap-22 + r * 0x1.af236aac51d05p-26;
    *less = r + r2 * ((a + r2 * b) + r4 * ((c + r2 * d) + r4 * e));
    return from_bits((to_bits(t) + 1022) << 52);
}

WITHIN real lanes_exp(real x)
{
    real less;
    const real above = SELECT(x < -708.0, all(-708.0), x); /* NaN stays */
    const real half = reduced_exp(SELECT(above > 709.8, all(709.8), above), &less);
    return SELECT(x < -708.0, all(0.0), 2.0 * (half + half * less));
}

WITHIN real lanes_expm1(real x)
{
    real less;
    const real above = SELECT(x < -50.0, all(-50.0), x);
    const real half = reduced_exp(SELECT(above > 709.8, all(709.8), above), &less);
    return SELECT(MAGNITUDE(x) < TINY, x, 2.0 * (half * less + (half - 0.5)));
}

/* By g = (e^(-2 |x|) - 1) / 2, from -1/2 to 0. */
WITHIN real lanes_tanh(real x)
{
    real less;
    const real twice = -2.0 * MAGNITUDE(x);
    const real half = reduced_exp(SELECT(twice < -50.0, all(-50.0), twice), &less);
    const real g = half * less + (half - 0.5);
    return SELECT(MAGNITUDE(x) < TINY, x, WITH_SIGN(g / (g + 1.0), x));
}

/* ---------------------------------------------------------------- sin, cos */

#define FAR 1e5 /* [rad] up to here a product with the first two parts of pi/2 is exact */

/* Bits of 2/pi, 32 in each part, after 64 bits that are 0. */
static const uint32_t part_of_angle[] = {
    0x00000000, 0x00000000, 0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab, 0xdebbc561,
    0xb7246e3a, 0x424dd2e0, 0x06492eea, 0x09d1921c, 0xfe1deb1c, 0xb129a73e, 0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41,
    0x3991d639, 0x835339f4, 0x9c845f8b, 0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf, 0x27cb09b7,
    0x4f463f66, 0x9e5fea2d, 0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1, 0x1f8d5d08, 0x56033046,
};

/* x = n pi/2 + y for FAR < x < infinity: y. With x = m 2^e, m whole, 2/pi x is needed modulo 4. Bits of 2/pi before the one
 * that m 2^e makes 2 add multiples of 4. The 192 bits from there on leave an error of 2^-137. */
INLINE scalar far_angle(scalar x, int64_t *n)
{
    uint64_t m, r[7] = {0};
    memcpy(&m, &x, sizeof m);
    const int first = (int)(m >> 52) - 1075 - 2 + 64;
    m = (m & (UINT64_MAX >> 12)) | (uint64_t)1 << 52;
    for (int i = 0; i < 6; i++) {
        const int bit = first + 32 * (5 - i);
        const uint64_t two = (uint64_t)part_of_angle[bit / 32] << 32 | part_of_angle[bit / 32 + 1];
        const uint64_t part = two >> (32 - bit % 32) & UINT32_MAX;
        const uint64_t sum = part * (m & UINT32_MAX) + (r[i] & UINT32_MAX);
        r[i + 1] = (sum >> 32) + (r[i] >> 32) + part * (m >> 32);
        r[i] = sum & UINT32_MAX;
    }
    const uint64_t over = r[5] >> 29 & 1; /* the rest is above 1/2: less 1 it is negative */
    *n = (int64_t)((r[5] >> 30) + over);
    r[5] &= UINT32_MAX >> 2;
    scalar y = 0.0, weight = 0x1p-190;
    for (int i = 0; i < 6; i++, weight *= 0x1p32)
        y += (scalar)(over ? r[i] ^ (i < 5 ? UINT32_MAX : UINT32_MAX >> 2) : r[i]) * weight;
    return (over ? -y : y) * 0x1.921fb54442d18p+0;
}

/* The angles of lanes that are far, or not finite. */
static void far_lanes(const real *x, real *y, mask *n)
{
    scalar from[LANES], rest[LANES];
    int64_t turns[LANES];
    memcpy(from, x, sizeof from);
    memcpy(rest, y, sizeof rest);
    memcpy(turns, n, sizeof turns);
    for (int i = 0; i < LANES; i++) {
        const scalar size = fabs(from[i]);
        if (size <= FAR)
            continue;
        rest[i] = size < INFINITY ? far_angle(size, turns + i) : NAN;
        if (from[i] < 0.0) {
            rest[i] = -rest[i];
            turns[i] = -turns[i];
        }
    }
    memcpy(y, rest, sizeof rest);
    memcpy(n, turns, sizeof turns);
}

/* sin and cos. x = n pi/2 + y with |y| <= pi/4 and a little. The polynomials are of least error, below 2^-57 and 2^-63 of the
 * values. */
WITHIN void lanes_sin_cos(real x, real *sine, real *cosine)
{
    const real t = x * 0x1.45f306dc9c883p-1 + LAST_BITS, k = t - LAST_BITS;
    mask n = to_bits(t);
    real y = ((x - k * 0x1.921fb544p+0) - k * 0x1.0b4611a6p-34) - k * 0x1.3198a2e037073p-69;
    if (any(MAGNITUDE(x) > FAR))
        far_lanes(&x, &y, &n);
    const real z = y * y, z2 = z * z, half = 0.5 * z, one = 1.0 - half;
    const real a = -0x1.5555555555548p-3 + z * 0x1.111111110f731p-7;
    const real b = -0x1.a01a019be9540p-13 + z * 0x1.71de35553ccb4p-19;
    const real c = -0x1.ae5e4b6acda3ap-26 + z * 0x1.5d8b40d86dbe2p-33;
    const real d = 0x1.555555555554bp-5 + z * -0x1.6c16c16c15013p-10;
    const real e = 0x1.a01a019c8ed07p-16 + z * -0x1.27e4f7f14138fp-22;
    const real f = 0x1.1ee9db8e82c26p-29 + z * -0x1.8fa65ee02a55ep-37;
    const real near_sin = WITH_SIGN(y + y * z * (a + z2 * (b + z2 * c)), y); /* of -0 too */
    const real near_cos = one + (((1.0 - one) - half) + z2 * (d + z2 * (e + z2 * f)));
    const mask odd = (mask)((n & 1) != 0);
    *sine = from_bits(to_bits(SELECT(odd, near_cos, near_sin)) ^ (n << 62 & SIGN));
    *cosine = from_bits(to_bits(SELECT(odd, near_sin, near_cos)) ^ ((n + 1) << 62 & SIGN));
}

WITHIN real lanes_sin(real x)
{
    real sine, cosine;
    lanes_sin_cos(x, &sine, &cosine);
    return sine;
}

WITHIN real lanes_cos(real x)
{
    real sine, cosine;
    lanes_sin_cos(x, &sine, &cosine);
    return cosine;
}

/* ---------------------------------------------------------------- atan */

/* atan(x) = atan(c) + atan((x - c) / (1 + c x)) for c = 0, 53/128, 1, 309/128 and infinity, so that the polynomial is needed up
 * to tan(pi/16) = 0.199 only, where its error is below 2^-62. */
WITHIN real lanes_atan(real x)
{
    const real a = MAGNITUDE(x);
    const mask second = (mask)(a > 0.1989), third = (mask)(a > 0.6682), fourth = (mask)(a > 1.4966), last = (mask)(a > 5.0273);
#define OF_RANGE(p, q, r, s) SELECT(last, all(s), SELECT(fourth, all(r), SELECT(third, all(q), SELECT(second, all(p), all(0.0)))))
    const real c = OF_RANGE(0.4140625, 1.0, 2.4140625, 0.0);
    const real begin = OF_RANGE(0.3925701350118286, 0x1.921fb54442d18p-1, 1.1780751213422282, 0x1.921fb54442d18p+0);
    const real rest = OF_RANGE(1.4769733768267405e-17, 3.061616997868383e-17, 8.238221398137885e-17, 6.123233995736766e-17);
    const real y = SELECT(last, all(-1.0), a - c) / SELECT(last, a, 1.0 + c * a);
    const real z = y * y, z2 = z * z, z4 = z2 * z2;
    const real p = -0x1.5555555555551p-2 + z * 0x1.9999999997e02p-3, q = -0x1.24924922b1a65p-3 + z * 0x1.c71c6fcc8987bp-4;
    const real r = -0x1.745c835863d11p-4 + z * 0x1.3afa719e66b18p-4, s = -0x1.0e8d22d64a739p-4 + z * 0x1.9bd09bba1bd48p-5;
    return WITH_SIGN(begin + (y + (y * z * ((p + z2 * q) + z4 * (r + z2 * s)) + rest)), x);
}

#include "one_number.h"

/* ---------------------------------------------------------------- four numbers of an array, and names */

#ifdef SCALARS

/* Element by element, as wide loads wait for narrow stores. */
WITHIN real gathered(const scalar *x)
{
#ifdef __GNUC__
    const real y = {x[0], x[1], x[2], x[3]};
    return y;
#else
    return *x;
#endif
}

WITHIN void scattered(real y, scalar *x)
{
#ifdef __GNUC__
    for (int i = 0; i < LANES; i++)
        x[i] = y[i];
#else
    *x = y;
#endif
}

/* Of n numbers, in their place; the others up to a multiple of LANES are free. */
#define EACH(name) \
    WITHIN void each_##name(scalar *x, int n) \
    { \
        for (int i = 0; i < n; i += LANES) \
            scattered(lanes_##name(gathered(x + i)), x + i); \
    }

EACH(exp)
EACH(expm1)
EACH(tanh)
EACH(atan)

/* sin in their place, and cos */
WITHIN void each_sin_cos(scalar *x, scalar *cosine, int n)
{
    for (int i = 0; i < n; i += LANES) {
        real sine, other;
        lanes_sin_cos(gathered(x + i), &sine, &other);
        scattered(sine, x + i);
        scattered(other, cosine + i);
    }
}

#define sin(x) one_sin(x)
#define cos(x) one_cos(x)
#define tan(x) one_tan(x)
#define asin(x) one_asin(x)
#define acos(x) one_acos(x)
#define atan(x) one_atan(x)
#define sinh(x) one_sinh(x)
#define cosh(x) one_cosh(x)
#define tanh(x) one_tanh(x)
#define asinh(x) one_asinh(x)
#define acosh(x) one_acosh(x)
#define atanh(x) one_atanh(x)
#define exp(x) one_exp(x)
#define expm1(x) one_expm1(x)
#define log(x) one_log(x)
#define log1p(x) one_log1p(x)
#define atan2(x, y) one_atan2(x, y)
#define hypot(x, y) one_hypot(x, y)
#define pow(x, y) one_pow(x, y)
#define fmod(x, y) one_fmod(x, y)
#define fmin(x, y) one_fmin(x, y)
#define fmax(x, y) one_fmax(x, y)

#endif

#endif
