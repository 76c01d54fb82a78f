/* Milliseconds since the start as 32 bits, which go round after 49.7 days. */
#ifndef VW_TIME_H
#define VW_TIME_H

#include <stdbool.h>
#include <stdint.h>

/* Whether `due_ms` has come; the two must be less than 24 days apart. */
static inline bool vw_is_due(uint32_t now_ms, uint32_t due_ms)
{
    return (uint32_t)(now_ms - due_ms) < 0x80000000u;
}

#endif
