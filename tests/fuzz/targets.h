/* What of the C library is fuzzed: each takes any bytes, and the sanitizers or an abort say that they broke it. */
#ifndef VW_FUZZ_TARGETS_H
#define VW_FUZZ_TARGETS_H

#include <stddef.h>
#include <stdint.h>

typedef void (*vw_fuzz_target_t)(const uint8_t *data, size_t length);

vw_fuzz_target_t vw_fuzz_target(const char *name);

#endif
