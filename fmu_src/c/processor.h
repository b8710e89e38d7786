/* Which of the copies of the solver's step the processor can run.
 *
 * For x86-64 the generated step is compiled twice, for AVX2 too: instructions with three operands, but none that multiplies
 * and adds at once, so that both give the same bits. PLAIN_STEP leaves the copy out, as other compilers and processors do.
 */
#ifndef VDFMU_PROCESSOR_H
#define VDFMU_PROCESSOR_H

#include <stdbool.h>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(PLAIN_STEP)
#define AVX2_STEP
#endif

/* Whether processor and system have AVX2. */
bool processor_has_avx2(void);

#endif
