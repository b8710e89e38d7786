#include "processor.h"

#ifdef AVX2_STEP

#include <cpuid.h>

bool processor_has_avx2(void)
{
    const unsigned both = bit_OSXSAVE | bit_AVX, saved = 6; /* the system saves the halves of the registers */
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & both) != both)
        return false;
    __asm__ volatile("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
    return (a & saved) == saved && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2);
}

#else

bool processor_has_avx2(void)
{
    return false;
}

#endif
