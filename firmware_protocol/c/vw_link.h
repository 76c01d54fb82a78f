/* The master's side of the RS232 line: requests, replies, events, the stream. SPEC.md sections 2 to 8.
 *
 * The firmware hands over what the UART received, calls vw_link_run from its main loop, and asks vw_link_next for a
 * frame whenever the UART has nothing to send. Time is milliseconds since the start, the same that goes out as uptime.
 */
#ifndef VW_LINK_H
#define VW_LINK_H

#include "vw_answer.h"

typedef struct {
    vw_answer_t answer;
    vw_decoder_t decoder;
    bool is_streaming;
    uint8_t sequence;
    uint32_t last_byte_ms;
} vw_link_t;

/* Boot: put the stored configuration in force, or the defaults, and announce it. The rest of the struct is left as it
 * is. `ident.protocol` and `ident.map_hash` are filled in. `can` may be NULL; it is initialised here.
 */
void vw_link_init(vw_link_t *link, const vw_board_t *board, vw_master_t *master, vw_can_t *can, const vw_ident_t *ident);

/* What the UART received, in any pieces. */
void vw_link_received(vw_link_t *link, uint32_t now_ms, const uint8_t *data, size_t length);

/* Every millisecond or oftener: silence on the line, a store under way, CAN time-outs. */
void vw_link_run(vw_link_t *link, uint32_t now_ms);

/* The next frame, to be called when the UART is free; 0 when there is none. */
size_t vw_link_next(vw_link_t *link, uint32_t now_ms, uint8_t out[VW_MAX_FRAME]);

void vw_link_event(vw_link_t *link, uint8_t code, uint16_t cell, int32_t value, int32_t limit);

#endif
