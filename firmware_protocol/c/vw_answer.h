/* What the master does with a request: check, carry out once, reply. SPEC.md sections 5, 6 and 8; called by vw_link,
 * which it does not know. Replies and events go into its outbox.
 */
#ifndef VW_ANSWER_H
#define VW_ANSWER_H

#include "vw_board.h"
#include "vw_can.h"
#include "vw_codec.h"
#include "vw_outbox.h"
#include "vw_store.h"
#include "vw_stream.h"

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
    vw_store_t store;
    vw_stream_t stream;
    vw_outbox_t outbox;
    uint32_t now_ms;
    bool restart_asked;
    bool has_last; /* `last` counts */
    vw_done_t last;
    uint8_t store_sequence; /* of the STORE under way */
    uint8_t body[VW_MAX_BODY]; /* of a configuration being checked, or of the frame being made */
} vw_answer_t;

/* A frame from the host: carry it out, or repeat the reply to one that was carried out already. */
void vw_answer_request(vw_answer_t *answer, const vw_frame_t *frame);

/* The STORE under way is over. */
void vw_answer_store(vw_answer_t *answer, enum vw_result result);

#endif
