#include <math.h>
#include <stdint.h>
#include <string.h>

#include "processor.h"

#ifdef AVX2_STEP

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif

/* RENAMED */
#include "FILE"

#ifdef __clang__
#pragma clang attribute pop
#endif

#endif
