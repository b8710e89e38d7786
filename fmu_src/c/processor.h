/* What the processor can run, and how it calculates.
 *
 * For x86-64 the generated step is compiled twice, for AVX2 too: instructions with three operands, but none that multiplies
 * and adds at once, so that both give the same bits. PLAIN_STEP leaves the copy out, as other compilers and processors do.
 */
#ifndef VDFMU_PROCESSOR_H
#define VDFMU_PROCESSOR_H

#include <stdbool.h>
#include <stdint.h>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(PLAIN_STEP)
#define AVX2_STEP
#endif

/* Whether processor and system have AVX2. */
bool processor_has_avx2(void);

/* The importer's thread may round in another direction, flush subnormal numbers to zero or trap on a division by zero. All
 * of it is in one register, whose usual value is that of IEEE 754: to nearest, gradual, without traps. WebAssembly knows
 * nothing else. A register that is read and not written costs a nanosecond in each call. */
#if defined(__x86_64__) || defined(_M_X64)
#include <xmmintrin.h>
#define USUAL_ARITHMETIC 0x1f80u
static inline uint64_t arithmetic_now(void)
{
    return _mm_getcsr() & ~0x3fu; /* without the flags of what has happened */
}
static inline void set_arithmetic(uint64_t mode)
{
    _mm_setcsr((unsigned)mode);
}
#elif defined(__aarch64__) && defined(__GNUC__)
#define USUAL_ARITHMETIC 0u
static inline uint64_t arithmetic_now(void)
{
    uint64_t mode;
    __asm__ volatile("mrs %0, fpcr" : "=r"(mode));
    return mode;
}
static inline void set_arithmetic(uint64_t mode)
{
    __asm__ volatile("msr fpcr, %0" : : "r"(mode) : "memory");
}
#else
#define USUAL_ARITHMETIC 0u
static inline uint64_t arithmetic_now(void)
{
    return USUAL_ARITHMETIC;
}
static inline void set_arithmetic(uint64_t mode)
{
    (void)mode;
}
#endif

/* Calculate as IEEE 754 does by default. Returns the importer's way, for `restore_arithmetic`. */
static inline uint64_t use_usual_arithmetic(void)
{
    const uint64_t mode = arithmetic_now();
    if (mode != USUAL_ARITHMETIC)
        set_arithmetic(USUAL_ARITHMETIC);
    return mode;
}

static inline void restore_arithmetic(uint64_t mode)
{
    if (mode != USUAL_ARITHMETIC)
        set_arithmetic(mode);
}

#endif
