#include "vw_outbox.h"

#include "vw_bytes.h"

static void vw_outbox_drop_event(vw_outbox_t *outbox)
{
    outbox->first_event = (uint8_t)((outbox->first_event + 1u) % VW_MAX_EVENTS);
    outbox->n_events--;
    if (outbox->events_ahead != 0u) {
        outbox->events_ahead--;
    }
}

void vw_outbox_event(vw_outbox_t *outbox, uint8_t code, uint16_t cell, int32_t value, int32_t limit)
{
    vw_event_t *event;
    if (outbox->n_events == VW_MAX_EVENTS) {
        vw_outbox_drop_event(outbox);
    }
    event = &outbox->events[(outbox->first_event + outbox->n_events) % VW_MAX_EVENTS];
    outbox->n_events++;
    event->code = code;
    event->argument = 0u;
    event->cell = cell;
    event->value = value;
    event->limit = limit;
}

void vw_outbox_reply(vw_outbox_t *outbox, uint8_t type, uint8_t sequence, enum vw_result result, uint16_t offset,
                     size_t data_length)
{
    outbox->reply[0] = type;
    outbox->reply[1] = sequence;
    outbox->reply[2] = (uint8_t)result;
    vw_put_u16(&outbox->reply[3], offset);
    outbox->reply_length = (uint16_t)(VW_REPLY_HEADER_SIZE + data_length);
    outbox->has_reply = true;
    outbox->events_ahead = outbox->n_events;
}

bool vw_outbox_is_reply_next(const vw_outbox_t *outbox)
{
    return outbox->has_reply && outbox->events_ahead == 0u;
}

const uint8_t *vw_outbox_take_reply(vw_outbox_t *outbox, size_t *length)
{
    outbox->has_reply = false;
    *length = outbox->reply_length;
    return outbox->reply;
}

size_t vw_outbox_take_event(vw_outbox_t *outbox, uint8_t body[VW_MAX_BODY])
{
    size_t length = 0u;
    if (outbox->n_events != 0u) {
        length = vw_event_body(body, &outbox->events[outbox->first_event]);
        vw_outbox_drop_event(outbox);
    }
    return length;
}
