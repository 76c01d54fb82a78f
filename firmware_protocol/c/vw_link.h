/* The master's side of the RS232 line: requests, replies, events, the stream. SPEC.md sections 2 to 8.
 *
 * The firmware hands over what the UART received, calls vw_link_run from its main loop, and asks vw_link_next for a
 * frame whenever the UART has nothing to send. Time is milliseconds since the start, the same that goes out as uptime.
 */
#ifndef VW_LINK_H
#define VW_LINK_H

#include "vw_board.h"
#include "vw_can.h"
#include "vw_codec.h"
#include "vw_messages.h"
#include "vw_store.h"
#include "vw_stream.h"

#define VW_MAX_EVENTS 16u
#define VW_NO_CELL 0xFFFFu /* an event that concerns no cell */

/* The last request that changed something, by which a repeated one is known, and how it ended. */
typedef struct {
    uint8_t type;
    uint8_t sequence;
    uint16_t length;
    uint32_t crc; /* CRC-32 of its body */
    uint32_t at_ms;
    enum vw_result result;
    uint16_t offset;
} vw_done_t;

typedef struct {
    const vw_board_t *board;
    vw_master_t *master;
    vw_can_t *can; /* NULL without CAN tables */
    vw_ident_t ident;
    vw_decoder_t decoder;
    vw_store_t store;
    vw_stream_t stream;
    bool is_streaming;
    bool restart_asked;
    uint8_t sequence;
    uint32_t now_ms;
    uint32_t last_byte_ms;

    bool has_reply; /* one that waits for the line, behind so many events */
    uint8_t events_ahead;
    uint16_t reply_length;
    uint8_t reply[VW_MAX_BODY];

    vw_event_t events[VW_MAX_EVENTS]; /* a ring; the oldest is lost where too many wait */
    uint8_t first_event;
    uint8_t n_events;

    bool has_last; /* `last` counts */
    vw_done_t last;
    uint8_t store_sequence; /* of the STORE under way */
    uint8_t body[VW_MAX_BODY]; /* of the frame being made */
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
