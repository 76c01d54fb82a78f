/* Reference codec for the RS232 protocol of SPEC.md, both directions. C99, no heap, no globals, no I/O.
 *
 * The decoders take the line byte by byte, at any grouping, and hand each thing they complete to a handler. Encoders
 * write into the caller's buffer and return how many bytes they wrote, 0 where it does not fit. All numbers on the line
 * are little endian whatever the machine is.
 */
#ifndef VW_CODEC_H
#define VW_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "generated/voltwall_protocol.h"

#define VW_MAX_FRAME (VW_MAX_ENCODED + 2u) /* on the line, both delimiters included */

typedef struct {
    uint8_t type;
    uint8_t sequence;
    uint32_t uptime_ms;
    const uint8_t *body;
    uint16_t length;
} vw_frame_t;

typedef enum {
    VW_ITEM_FRAME,
    VW_ITEM_BAD_COBS, /* a count points beyond the end or is zero */
    VW_ITEM_BAD_SHORT,
    VW_ITEM_BAD_LONG,
    VW_ITEM_BAD_CRC,
    VW_ITEM_START, /* bare x; master's side only */
    VW_ITEM_STOP   /* bare y; master's side only */
} vw_item_t;

/* `frame` is valid with VW_ITEM_FRAME only, and only until the handler returns. */
typedef void (*vw_handler_t)(void *context, vw_item_t item, const vw_frame_t *frame);

typedef enum { VW_SIDE_HOST, VW_SIDE_MASTER } vw_side_t;

typedef struct {
    vw_side_t side;
    vw_handler_t handler;
    void *context;
    uint8_t buffer[VW_MAX_ENCODED];
    uint32_t length;        /* of the chunk so far; the buffer keeps its first VW_MAX_ENCODED bytes */
    bool inside;            /* master: in a frame; host: a delimiter has been seen */
    uint32_t dropped_bytes; /* master: of chunks that were no frame; host: before the first delimiter */
} vw_decoder_t;

void vw_decoder_init(vw_decoder_t *decoder, vw_side_t side, vw_handler_t handler, void *context);
void vw_decoder_feed(vw_decoder_t *decoder, const uint8_t *data, size_t length);

/* Master's side: call after 100 ms without a byte. Closes what is open, so that the next x counts at once. */
void vw_decoder_idle(vw_decoder_t *decoder);

uint16_t vw_crc16(const uint8_t *data, size_t length);

/* CRC-32 in parts: begin with VW_CRC32_START, invert every bit of the last result. */
#define VW_CRC32_START 0xFFFFFFFFu
uint32_t vw_crc32_update(uint32_t crc, const uint8_t *data, size_t length);

/* `out` needs VW_MAX_FRAME bytes for the longest body. */
size_t vw_frame_encode(uint8_t type, uint8_t sequence, uint32_t uptime_ms, const uint8_t *body, size_t length,
                       uint8_t *out, size_t out_size);

#endif
