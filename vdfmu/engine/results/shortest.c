/* Lines of numbers in the shortest decimal form that reads back to the same bits, of several the closest.
   Method: Raffaello Giulietti, "The Schubfach way to render doubles", 2021, with the names of that paper. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

__extension__ typedef unsigned __int128 wide;

enum { LEAST_POWER = -292 }; /* of ten in the table `g`: its entries are 10^k as 128 bits, rounded up, in two halves */

static uint64_t rounded_to_odd(const uint64_t *g, uint64_t c) {
    wide high = (wide)g[0] * c, low = (wide)g[1] * c;
    uint64_t rest = (uint64_t)high + (uint64_t)(low >> 64);
    return ((uint64_t)(high >> 64) + (rest < (uint64_t)high)) | (rest > 1);
}

/* Return the decimal d of a positive number c 2^q, and its exponent k: d 10^k. */
static uint64_t decimal_of(uint64_t bits, const uint64_t *powers, int *k) {
    uint64_t fraction = bits & ((1ull << 52) - 1), biased = bits >> 52;
    uint64_t c = biased ? fraction | 1ull << 52 : fraction;
    int q = (biased ? (int)biased : 1) - 1075, close = fraction == 0 && biased > 1, odd = (int)(c & 1);
    if (q <= 0 && q > -53 && (c & ((1ull << -q) - 1)) == 0) return *k = 0, c >> -q; /* an integer */
    *k = (q * 1262611 - (close ? 524031 : 0)) >> 22; /* floor(log10(2^q)), or of 3/4 of it */
    int h = q + ((-*k * 1741647) >> 19) + 1;         /* floor(log2(10^-k)) */
    const uint64_t *g = powers + 2 * (-*k - LEAST_POWER);
    uint64_t lower = rounded_to_odd(g, (4 * c - 2 + (uint64_t)close) << h) + (uint64_t)odd;
    uint64_t upper = rounded_to_odd(g, (4 * c + 2) << h) - (uint64_t)odd;
    uint64_t v = rounded_to_odd(g, (4 * c) << h), s = v / 4;
    for (uint64_t step = 10; step; step /= 10) { /* with a digit less, or not */
        uint64_t floor = s / step * step;
        int below = s >= step && lower <= 4 * floor, above = s >= step && 4 * (floor + step) <= upper;
        if (below != above) return *k += step == 10, floor / step + (uint64_t)above;
    }
    return s + (v > 4 * s + 2 || (v == 4 * s + 2 && s & 1)); /* both or none: the closer one */
}

static char *put(char *text, double x, const uint64_t *powers) {
    uint64_t bits;
    char digits[20];
    int n = 0, k = 0, exponent;
    if (isnan(x)) return memcpy(text, "NaN", 3), text + 3;
    if (signbit(x)) *text++ = '-';
    if (isinf(x)) return memcpy(text, "Infinity", 8), text + 8;
    if (x == 0.0) return *text = '0', text + 1;
    x = fabs(x), memcpy(&bits, &x, sizeof bits);
    uint64_t d = decimal_of(bits, powers, &k);
    while (d % 10 == 0) d /= 10, k++;
    for (; d; d /= 10) digits[n++] = (char)('0' + d % 10);
    *text++ = digits[--n], exponent = k + n;
    if (n) *text++ = '.';
    while (n) *text++ = digits[--n];
    if (exponent == 0) return text;
    *text++ = 'E';
    if (exponent < 0) *text++ = '-', exponent = -exponent;
    if (exponent >= 100) *text++ = (char)('0' + exponent / 100);
    if (exponent >= 10) *text++ = (char)('0' + exponent / 10 % 10);
    *text++ = (char)('0' + exponent % 10);
    return text;
}

/* Write m lines of n numbers, separated by commas, into a text with 25 bytes a number; return its length. */
SHOWN size_t write_lines(const double *x, size_t m, size_t n, const uint64_t *powers, char *text) {
    char *end = text;
    for (size_t i = 0; i < m * n; i++) end = put(end, x[i], powers), *end++ = (i + 1) % n ? ',' : '\n';
    return (size_t)(end - text);
}
