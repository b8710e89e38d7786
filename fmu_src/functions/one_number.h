/* Elementary functions of one number, bit-identical on every platform; see elementary.h. */

#define ONE(name) \
    INLINE scalar one_##name(scalar x) \
    { \
        const real y = lanes_##name(all(x)); \
        memcpy(&x, &y, sizeof x); \
        return x; \
    }

ONE(exp)
ONE(expm1)
ONE(tanh)
ONE(sin)
ONE(cos)
ONE(atan)

INLINE scalar one_tan(scalar x)
{
    return one_sin(x) / one_cos(x);
}

/* log(u + rest), rest small beside u. With u = 2^k (1 + f) and s = f / (2 + f), log(1 + f) = f - s (f - R(s^2)). */
INLINE scalar log_of(scalar u, scalar rest)
{
    if (!(u > 0.0) || u == INFINITY)
        return u == 0.0 ? -INFINITY : u < 0.0 ? NAN : u;
    int64_t bits;
    scalar k = u < 0x1p-1022 ? -54.0 : 0.0, m = u < 0x1p-1022 ? u * 0x1p54 : u;
    memcpy(&bits, &m, sizeof bits);
    const int64_t whole = (bits - 0x3fe6a09e667f3bcd) >> 52; /* 1 + f begins at sqrt(1/2) */
    bits -= (int64_t)((uint64_t)whole << 52);
    memcpy(&m, &bits, sizeof m);
    k += (scalar)whole;
    const scalar f = m - 1.0, s = f / (2.0 + f), z = s * s, half = 0.5 * f * f;
    const scalar low = 0x1.5555555555592p-1 + z * (0x1.999999997fef0p-2 + z * 0x1.24924941e50cap-2);
    const scalar high = 0x1.c71c52106a714p-3 + z * (0x1.74663de06d9afp-3 + z * (0x1.39a1ccf093e9ep-3 + z * 0x1.2f04ee66a232ap-3));
    const scalar series = z * (low + z * z * z * high);
    return k * 0x1.62e42fefa3800p-1 - ((half - (s * (half + series) + (k * 0x1.ef35793c76730p-45 + rest / u))) - f);
}

INLINE scalar one_log(scalar x)
{
    return log_of(x, 0.0);
}

INLINE scalar one_log1p(scalar x)
{
    const scalar u = 1.0 + x;
    if (!(u > 0.0) || u == INFINITY)
        return log_of(u, 0.0);
    return fabs(x) < 0x1p-54 ? x : log_of(u, x < 1.0 ? x - (u - 1.0) : 1.0 - (u - x));
}

INLINE scalar one_sinh(scalar x)
{
    const scalar a = fabs(x), grown = one_expm1(a), root = one_exp(0.5 * a);
    return copysign(a < 709.0 ? 0.5 * (grown + grown / (grown + 1.0)) : 0.5 * root * root, x);
}

INLINE scalar one_cosh(scalar x)
{
    const scalar a = fabs(x), grown = one_exp(a), root = one_exp(0.5 * a);
    return a < 709.0 ? 0.5 * (grown + 1.0 / grown) : 0.5 * root * root;
}

#define LARGE 0x1p28 /* above, the square of a number is that number's square less or more 1 */
#define LOG_2 0x1.62e42fefa39efp-1

INLINE scalar one_asinh(scalar x)
{
    const scalar a = fabs(x), square = a * a;
    return copysign(a < LARGE ? one_log1p(a + square / (1.0 + sqrt(square + 1.0))) : one_log(a) + LOG_2, x);
}

INLINE scalar one_acosh(scalar x)
{
    const scalar t = x - 1.0;
    if (t < 0.0)
        return NAN;
    return x < LARGE ? one_log1p(t + sqrt(2.0 * t + t * t)) : one_log(x) + LOG_2;
}

INLINE scalar one_atanh(scalar x)
{
    const scalar a = fabs(x);
    return copysign(0.5 * one_log1p(2.0 * a / (1.0 - a)), x);
}

INLINE scalar one_atan2(scalar y, scalar x)
{
    const scalar a = fabs(x), b = fabs(y);
    const scalar slope = a == b ? (a == 0.0 ? 0.0 : 1.0) : b / a; /* of infinities too */
    const scalar angle = one_atan(x == x && y == y ? slope : NAN);
    return copysign(copysign(1.0, x) < 0.0 ? 0x1.921fb54442d18p+1 - (angle - 0x1.1a62633145c07p-53) : angle, y);
}

INLINE scalar one_asin(scalar x)
{
    return one_atan2(x, sqrt((1.0 - x) * (1.0 + x)));
}

INLINE scalar one_acos(scalar x)
{
    return one_atan2(sqrt((1.0 - x) * (1.0 + x)), x);
}

INLINE scalar one_hypot(scalar x, scalar y)
{
    const scalar a = fabs(x), b = fabs(y), most = a > b ? a : b;
    if (a == INFINITY || b == INFINITY)
        return INFINITY;
    const scalar scale = most > 0x1p500 ? 0x1p-600 : most < 0x1p-400 ? 0x1p600 : 1.0;
    return sqrt((a * scale) * (a * scale) + (b * scale) * (b * scale)) / scale;
}

/* k with 2^k <= x < 2^(k + 1), for positive finite numbers */
INLINE int64_t exponent(scalar x)
{
    const int below = x < 0x1p-1022; /* the normal numbers */
    const scalar normal = below ? x * 0x1p54 : x;
    int64_t bits;
    memcpy(&bits, &normal, sizeof bits);
    return (bits >> 52) - 1023 - (below ? 54 : 0);
}

/* The rest of a division, exact: multiples of y by powers of 2 are taken away. */
INLINE scalar one_fmod(scalar x, scalar y)
{
    scalar a = fabs(x);
    const scalar b = fabs(y);
    if (!(a < INFINITY) || !(b > 0.0))
        return NAN;
    while (a >= b) {
        int64_t k = exponent(a) - exponent(b);
        scalar multiple = b;
        for (int64_t part; k > 0; k -= part) {
            part = k < 1000 ? k : 1000;
            const int64_t power = (part + 1023) << 52;
            scalar by;
            memcpy(&by, &power, sizeof by);
            multiple *= by;
        }
        a -= multiple > a ? 0.5 * multiple : multiple;
    }
    return copysign(a, x);
}

/* *rest: what the product lacks, by Dekker's parts of 26 bits */
INLINE scalar exact_product(scalar a, scalar b, scalar *rest)
{
#ifdef __clang__
#pragma clang fp contract(off)
#endif
    const scalar p = a * b, c = 0x1.0000002p27 * a, d = 0x1.0000002p27 * b;
    const scalar a_high = c - (c - a), b_high = d - (d - b), a_low = a - a_high, b_low = b - b_high;
    *rest = ((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low;
    return p;
}

/* a^y for a > 0, by the logarithm in two parts: with a = 2^k (1 + f), s = f / (2 + f) and z = s^2 it is
 * k log 2 + 2 s (1 + z/3 + z^2/5 + ..). */
INLINE scalar power(scalar a, scalar y)
{
    int64_t bits;
    scalar k = a < 0x1p-1022 ? -54.0 : 0.0, m = a < 0x1p-1022 ? a * 0x1p54 : a, rest, less;
    memcpy(&bits, &m, sizeof bits);
    const int64_t whole = (bits - 0x3fe6a09e667f3bcd) >> 52;
    bits -= (int64_t)((uint64_t)whole << 52);
    memcpy(&m, &bits, sizeof m);
    k += (scalar)whole;
    const scalar f = m - 1.0, divisor = m + 1.0, divisor_rest = (m - (divisor - 1.0)), s = f / divisor;
    const scalar product = exact_product(s, divisor, &rest), s_rest = ((f - product) - rest - s * divisor_rest) / divisor;
    const scalar z = exact_product(s, s, &less), z_rest = less + 2.0 * s * s_rest;
    const scalar third = exact_product(z, 0x1.5555555555555p-2, &less);
    scalar series = 1.0 / 23;
    for (int i = 21; i >= 5; i -= 2)
        series = 1.0 / i + z * series;
    const scalar tail = z * z * series + (z_rest * (1.0 / 3) + z * 0x1.5555555555555p-56 + less);
    const scalar q = third + tail, q_rest = (third - q) + tail; /* the series less 1 */
    const scalar more = exact_product(2.0 * s, q, &less);
    const scalar low = less + 2.0 * (s * q_rest + s_rest * (1.0 + q));
    const scalar first = k * 0x1.62e42fefa3800p-1, sum = first + 2.0 * s; /* |first| is 0 or above |2 s| */
    const scalar sum_rest = ((first - sum) + 2.0 * s) + k * 0x1.ef35793c76730p-45;
    const scalar log_a = sum + more, log_rest = ((sum - log_a) + more) + (sum_rest + low);
    if (fabs(y) > 0x1p80) /* a is not 1 or differs from it by 2^-53 and more */
        return a == 1.0 ? 1.0 : (log_a + log_rest > 0.0) == (y > 0.0) ? INFINITY : 0.0;
    const scalar p = exact_product(y, log_a, &less), p_rest = less + y * log_rest;
    if (!(fabs(p) < 1000.0))
        return p > 0.0 ? INFINITY : 0.0;
    /* e^p = 2^n e^(p - n log 2); half of n twice, for results below the normal numbers */
    const scalar n = floor(p * 0x1.71547652b82fep+0 + 0.5), n_half = floor(0.5 * n);
    const scalar near_1 = one_exp(((p - n * 0x1.62e42fefa3800p-1) - n * 0x1.ef35793c76730p-45) + p_rest);
    const int64_t one_bits = ((int64_t)n_half + 1023) << 52, other_bits = ((int64_t)(n - n_half) + 1023) << 52;
    scalar one_part, other_part;
    memcpy(&one_part, &one_bits, sizeof one_part);
    memcpy(&other_part, &other_bits, sizeof other_part);
    return near_1 * one_part * other_part;
}

INLINE scalar one_pow(scalar x, scalar y)
{
    if (y == 0.0 || x == 1.0)
        return 1.0;
    if (x != x || y != y)
        return NAN;
    const scalar a = fabs(x);
    const int odd = floor(y) == y && floor(0.5 * y) != 0.5 * y;
    if (x < 0.0 && a < INFINITY && floor(y) != y)
        return NAN;
    const scalar made = a == 0.0 || a == INFINITY ? ((a > 1.0) == (y > 0.0) ? INFINITY : 0.0) : power(a, y);
    return odd ? copysign(made, x) : made;
}

INLINE scalar one_fmin(scalar x, scalar y)
{
    return x < y || y != y ? x : y;
}

INLINE scalar one_fmax(scalar x, scalar y)
{
    return x > y || y != y ? x : y;
}
