/* Little-endian numbers in bytes, on any machine and at any alignment. */
#ifndef VW_BYTES_H
#define VW_BYTES_H

#include <stdint.h>
#include <string.h>

static inline void vw_put_u16(uint8_t *out, uint16_t value)
{
    out[0] = (uint8_t)(value & 0xFFu);
    out[1] = (uint8_t)(value >> 8);
}

static inline void vw_put_u32(uint8_t *out, uint32_t value)
{
    vw_put_u16(out, (uint16_t)(value & 0xFFFFu));
    vw_put_u16(out + 2, (uint16_t)(value >> 16));
}

static inline uint16_t vw_get_u16(const uint8_t *in)
{
    return (uint16_t)(in[0] | ((uint16_t)in[1] << 8));
}

static inline uint32_t vw_get_u32(const uint8_t *in)
{
    return (uint32_t)vw_get_u16(in) | ((uint32_t)vw_get_u16(in + 2) << 16);
}

static inline int32_t vw_get_i32(const uint8_t *in)
{
    uint32_t raw = vw_get_u32(in);
    int32_t value;
    (void)memcpy(&value, &raw, sizeof value);
    return value;
}

#endif
