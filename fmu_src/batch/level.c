/* Which of the libraries of a system the processor can run: 0 any, 1 that for AVX2, 2 that for AVX-512. */
#include "processor.h"
#include "shown.h"

SHOWN int level(void);

#ifdef AVX2_STEP

#include <cpuid.h>

int level(void)
{
    const unsigned wide = 0xe6; /* the system saves the registers of AVX-512 */
    const unsigned needed = bit_AVX512F | bit_AVX512DQ | bit_AVX512VL;
    unsigned a, b, c, d, saved, high;
    if (!processor_has_avx2() || !__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA))
        return 0;
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    __get_cpuid_count(7, 0, &a, &b, &c, &d);
    return (saved & wide) == wide && (b & needed) == needed ? 2 : 1;
}

#else

int level(void)
{
    return 0;
}

#endif
