/* What waits for the line from the master to the host: one reply, and a ring of events. Sends nothing itself. */
#ifndef VW_OUTBOX_H
#define VW_OUTBOX_H

#include "vw_messages.h"

#define VW_MAX_EVENTS 16u

typedef struct {
    bool has_reply; /* it waits for the line, behind so many events */
    uint8_t events_ahead;
    uint16_t reply_length;
    uint8_t reply[VW_MAX_BODY];

    vw_event_t events[VW_MAX_EVENTS]; /* a ring; the oldest is lost where too many wait */
    uint8_t first_event;
    uint8_t n_events;
} vw_outbox_t;

void vw_outbox_event(vw_outbox_t *outbox, uint8_t code, uint16_t cell, int32_t value, int32_t limit);

/* Queue a reply behind the events that wait already. A READ or an IDENT has put `data_length` bytes of data into `reply`
 * before, behind the header.
 */
void vw_outbox_reply(vw_outbox_t *outbox, uint8_t type, uint8_t sequence, enum vw_result result, uint16_t offset,
                     size_t data_length);

/* Whether the reply is what leaves next; taken with vw_outbox_take_reply. */
bool vw_outbox_is_reply_next(const vw_outbox_t *outbox);

/* The reply's body, which stays valid until the next one is queued. */
const uint8_t *vw_outbox_take_reply(vw_outbox_t *outbox, size_t *length);

/* The body of the oldest event; 0 where none waits. */
size_t vw_outbox_take_event(vw_outbox_t *outbox, uint8_t body[VW_MAX_BODY]);

#endif
