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

#include "voltwall_protocol.h"

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

/* -- bodies, master to host ------------------------------------------------------------------------------------- */

/* Append one window of the struct to a DATA body of `length` bytes; returns its new length, 0 where it does not fit. */
size_t vw_data_append(uint8_t body[VW_MAX_BODY], size_t length, const uint8_t *master, uint16_t offset,
                      uint16_t count);

size_t vw_reply_body(uint8_t body[VW_MAX_BODY], const vw_frame_t *request, uint8_t result, uint16_t offset,
                     const uint8_t *data, size_t length);

typedef struct {
    uint8_t code;
    uint8_t argument;
    uint16_t cell;
    int32_t value;
    int32_t limit;
} vw_event_t;

size_t vw_event_body(uint8_t body[VW_MAX_BODY], const vw_event_t *event);

typedef struct {
    uint16_t protocol;
    uint8_t firmware[3];
    uint8_t map_hash[8];
    uint8_t reset_cause;
    uint32_t boots;
} vw_ident_t;

#define VW_IDENT_SIZE 18u
size_t vw_ident_data(uint8_t data[VW_IDENT_SIZE], const vw_ident_t *ident);

/* -- requests, host to master ----------------------------------------------------------------------------------- */

typedef struct {
    uint8_t type;
    uint16_t offset; /* READ, WRITE */
    uint16_t length; /* READ, WRITE */
    const uint8_t *data; /* WRITE; points into the frame's body */
    uint8_t command; /* COMMAND */
    int32_t argument; /* COMMAND */
} vw_request_t;

/* VW_RESULT_DONE, or the refusal to send back. `offset` gets the offset at fault. Ranges of values are not checked. */
enum vw_result vw_request_parse(const vw_frame_t *frame, vw_request_t *request, uint16_t *offset);

/* Returns the body's length, 0 also for requests without a body. */
size_t vw_request_body(uint8_t body[VW_MAX_BODY], const vw_request_t *request);

/* -- messages, on the host's side --------------------------------------------------------------------------------- */

typedef struct {
    uint16_t offset;
    uint16_t length;
    const uint8_t *data;
} vw_window_t;

/* Whether every window of a DATA frame is whole and inside the struct; where one is not, none counts. */
bool vw_data_is_valid(const vw_frame_t *frame);

/* The next window of a valid DATA frame, from `*position` = 0 on; false at the end. */
bool vw_data_next(const vw_frame_t *frame, size_t *position, vw_window_t *window);

typedef struct {
    uint8_t request_type;
    uint8_t request_sequence;
    uint8_t result;
    uint16_t offset;
    const uint8_t *data;
    uint16_t length;
} vw_reply_t;

bool vw_reply_parse(const vw_frame_t *frame, vw_reply_t *reply);
bool vw_event_parse(const vw_frame_t *frame, vw_event_t *event);
bool vw_ident_parse(const uint8_t *data, size_t length, vw_ident_t *ident);

#endif
