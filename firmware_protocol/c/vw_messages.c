#include "vw_messages.h"

#include <string.h>

#include "vw_bytes.h"

#define WINDOW_HEADER 4u
#define EVENT_SIZE 12u
#define COMMAND_SIZE 5u

/* -- bodies -------------------------------------------------------------------------------------------------------- */

size_t vw_data_append(uint8_t body[VW_MAX_BODY], size_t length, const uint8_t *master, uint16_t offset,
                      uint16_t count)
{
    if ((uint32_t)offset + count > VW_MASTER_SIZE || length + WINDOW_HEADER + count > VW_MAX_BODY) {
        return 0;
    }
    vw_put_u16(body + length, offset);
    vw_put_u16(body + length + 2, count);
    (void)memcpy(body + length + WINDOW_HEADER, master + offset, count);
    return length + WINDOW_HEADER + count;
}

size_t vw_reply_body(uint8_t body[VW_MAX_BODY], const vw_frame_t *request, uint8_t result, uint16_t offset,
                     const uint8_t *data, size_t length)
{
    if (length > VW_MAX_BODY - VW_REPLY_HEADER_SIZE) {
        return 0;
    }
    body[0] = request->type;
    body[1] = request->sequence;
    body[2] = result;
    vw_put_u16(body + 3, offset);
    if (length != 0u) {
        (void)memcpy(body + VW_REPLY_HEADER_SIZE, data, length);
    }
    return VW_REPLY_HEADER_SIZE + length;
}

size_t vw_event_body(uint8_t body[VW_MAX_BODY], const vw_event_t *event)
{
    body[0] = event->code;
    body[1] = event->argument;
    vw_put_u16(body + 2, event->cell);
    vw_put_u32(body + 4, (uint32_t)event->value);
    vw_put_u32(body + 8, (uint32_t)event->limit);
    return EVENT_SIZE;
}

size_t vw_ident_data(uint8_t data[VW_IDENT_SIZE], const vw_ident_t *ident)
{
    vw_put_u16(data, ident->protocol);
    (void)memcpy(data + 2, ident->firmware, 3);
    (void)memcpy(data + 5, ident->map_hash, 8);
    data[13] = ident->reset_cause;
    vw_put_u32(data + 14, ident->boots);
    return VW_IDENT_SIZE;
}

enum vw_result vw_request_parse(const vw_frame_t *frame, vw_request_t *request, uint16_t *offset)
{
    const uint8_t *body = frame->body;
    uint32_t limit;

    (void)memset(request, 0, sizeof *request);
    request->type = frame->type;
    *offset = VW_NO_OFFSET;
    switch (frame->type) {
    case VW_MSG_IDENT:
    case VW_MSG_STORE:
    case VW_MSG_LOAD:
        return frame->length == 0u ? VW_RESULT_DONE : VW_RESULT_BAD_LENGTH;
    case VW_MSG_READ:
    case VW_MSG_WRITE:
        if (frame->length < WINDOW_HEADER || (frame->type == VW_MSG_READ && frame->length != WINDOW_HEADER)) {
            return VW_RESULT_BAD_LENGTH;
        }
        request->offset = vw_get_u16(body);
        request->length = vw_get_u16(body + 2);
        if (frame->type == VW_MSG_WRITE) {
            request->data = body + WINDOW_HEADER;
            if (request->length != frame->length - WINDOW_HEADER) {
                return VW_RESULT_BAD_LENGTH;
            }
            limit = VW_CONFIG_SIZE;
        } else {
            limit = request->offset < VW_EEPROM_READ_BASE ? VW_MASTER_SIZE : VW_EEPROM_READ_BASE + VW_EEPROM_SIZE;
        }
        if (request->length == 0u || request->length > VW_MAX_BODY - WINDOW_HEADER
            || (frame->type == VW_MSG_READ && request->length > VW_MAX_READ)) {
            return VW_RESULT_BAD_LENGTH;
        }
        if ((uint32_t)request->offset + request->length > limit) {
            *offset = request->offset;
            return VW_RESULT_OUT_OF_BOUNDS;
        }
        return VW_RESULT_DONE;
    case VW_MSG_COMMAND:
        if (frame->length != COMMAND_SIZE) {
            return VW_RESULT_BAD_LENGTH;
        }
        request->command = body[0];
        request->argument = vw_get_i32(body + 1);
        return VW_RESULT_DONE;
    default:
        return VW_RESULT_UNKNOWN_REQUEST;
    }
}

size_t vw_request_body(uint8_t body[VW_MAX_BODY], const vw_request_t *request)
{
    switch (request->type) {
    case VW_MSG_READ:
        vw_put_u16(body, request->offset);
        vw_put_u16(body + 2, request->length);
        return WINDOW_HEADER;
    case VW_MSG_WRITE:
        if (request->length > VW_MAX_BODY - WINDOW_HEADER) {
            return 0;
        }
        vw_put_u16(body, request->offset);
        vw_put_u16(body + 2, request->length);
        (void)memcpy(body + WINDOW_HEADER, request->data, request->length);
        return WINDOW_HEADER + (size_t)request->length;
    case VW_MSG_COMMAND:
        body[0] = request->command;
        vw_put_u32(body + 1, (uint32_t)request->argument);
        return COMMAND_SIZE;
    default:
        return 0;
    }
}

/* -- messages ------------------------------------------------------------------------------------------------------ */

bool vw_data_next(const vw_frame_t *frame, size_t *position, vw_window_t *window)
{
    size_t left = frame->length - *position;
    if (left < WINDOW_HEADER) {
        return false;
    }
    window->offset = vw_get_u16(frame->body + *position);
    window->length = vw_get_u16(frame->body + *position + 2);
    window->data = frame->body + *position + WINDOW_HEADER;
    if (window->length > left - WINDOW_HEADER || (uint32_t)window->offset + window->length > VW_MASTER_SIZE) {
        return false;
    }
    *position += WINDOW_HEADER + window->length;
    return true;
}

bool vw_data_is_valid(const vw_frame_t *frame)
{
    size_t position = 0;
    vw_window_t window;
    if (frame->type != VW_MSG_DATA) {
        return false;
    }
    while (vw_data_next(frame, &position, &window)) {
    }
    return position == frame->length;
}

bool vw_reply_parse(const vw_frame_t *frame, vw_reply_t *reply)
{
    if (frame->type != VW_MSG_REPLY || frame->length < VW_REPLY_HEADER_SIZE) {
        return false;
    }
    reply->request_type = frame->body[0];
    reply->request_sequence = frame->body[1];
    reply->result = frame->body[2];
    reply->offset = vw_get_u16(frame->body + 3);
    reply->data = frame->body + VW_REPLY_HEADER_SIZE;
    reply->length = (uint16_t)(frame->length - VW_REPLY_HEADER_SIZE);
    return true;
}

bool vw_event_parse(const vw_frame_t *frame, vw_event_t *event)
{
    if (frame->type != VW_MSG_EVENT || frame->length != EVENT_SIZE) {
        return false;
    }
    event->code = frame->body[0];
    event->argument = frame->body[1];
    event->cell = vw_get_u16(frame->body + 2);
    event->value = vw_get_i32(frame->body + 4);
    event->limit = vw_get_i32(frame->body + 8);
    return true;
}

bool vw_ident_parse(const uint8_t *data, size_t length, vw_ident_t *ident)
{
    if (length < VW_IDENT_SIZE) {
        return false;
    }
    ident->protocol = vw_get_u16(data);
    (void)memcpy(ident->firmware, data + 2, 3);
    (void)memcpy(ident->map_hash, data + 5, 8);
    ident->reset_cause = data[13];
    ident->boots = vw_get_u32(data + 14);
    return true;
}
