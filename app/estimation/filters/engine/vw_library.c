/* What a program that loads the engine as a shared library asks first: does it fit? */
#include "vw_filter.h"

#ifndef VW_SOURCES
#define VW_SOURCES "unknown"
#endif

/* SHA-256 of the sources that the library was built from, in hexadecimal. */
const char *vw_library_sources(void) { return VW_SOURCES; }

int32_t vw_library_size_of_filter(void) { return (int32_t)sizeof(vw_filter); }

int32_t vw_library_size_of_cells(void) { return (int32_t)sizeof(vw_cells); }

/* One step, as it is asked for from Python, where each argument of a call and each array takes time. */
typedef struct {
    vw_filter *filter;
    vw_cells *cells;
    vw_sample sample;
    vw_real *estimates; /* of the next step; those of the step after it follow */
} vw_library_call;

void vw_library_step(vw_library_call *call)
{
    vw_filter_step(call->filter, call->cells, &call->sample, call->estimates);
    call->estimates += VW_ESTIMATES * call->filter->n_cells;
}

/* Which variant of the library is the fastest that this processor runs: 1 with AVX2, 2 with AVX-512, 0 any. */
#if defined(__x86_64__)
#include <cpuid.h>

#define XMM_AND_YMM 0x06u /* registers that the operating system keeps */
#define ZMM_TOO 0xe6u

int32_t vw_library_level(void)
{
    const unsigned wide = bit_AVX512F | bit_AVX512DQ | bit_AVX512VL;
    unsigned a, b, c, d, kept, unused;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE)) return 0;
    __asm__ volatile("xgetbv" : "=a"(kept), "=d"(unused) : "c"(0));
    if ((kept & XMM_AND_YMM) != XMM_AND_YMM || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & bit_AVX2)) return 0;
    return (kept & ZMM_TOO) == ZMM_TOO && (b & wide) == wide ? 2 : 1;
}
#else
int32_t vw_library_level(void) { return 0; }
#endif
