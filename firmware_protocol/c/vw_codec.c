#include "vw_codec.h"

#include <string.h>

#define CRC_SIZE 2u
#define WINDOW_HEADER 4u
#define REPLY_HEADER 5u
#define EVENT_SIZE 12u
#define COMMAND_SIZE 5u

static void put_u16(uint8_t *out, uint16_t value)
{
    out[0] = (uint8_t)(value & 0xFFu);
    out[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *out, uint32_t value)
{
    put_u16(out, (uint16_t)(value & 0xFFFFu));
    put_u16(out + 2, (uint16_t)(value >> 16));
}

static uint16_t get_u16(const uint8_t *in)
{
    return (uint16_t)(in[0] | ((uint16_t)in[1] << 8));
}

static uint32_t get_u32(const uint8_t *in)
{
    return (uint32_t)get_u16(in) | ((uint32_t)get_u16(in + 2) << 16);
}

static int32_t get_i32(const uint8_t *in)
{
    uint32_t raw = get_u32(in);
    int32_t value;
    memcpy(&value, &raw, sizeof value);
    return value;
}

static uint16_t crc16_update(uint16_t crc, uint8_t byte)
{
    unsigned bit;
    crc = (uint16_t)(crc ^ ((uint16_t)byte << 8));
    for (bit = 0; bit < 8u; bit++) {
        crc = (uint16_t)((crc & 0x8000u) ? (uint16_t)(crc << 1) ^ 0x1021u : (uint16_t)(crc << 1));
    }
    return crc;
}

uint16_t vw_crc16(const uint8_t *data, size_t length)
{
    uint16_t crc = 0xFFFFu;
    size_t i;
    for (i = 0; i < length; i++) {
        crc = crc16_update(crc, data[i]);
    }
    return crc;
}

uint32_t vw_crc32_update(uint32_t crc, const uint8_t *data, size_t length)
{
    size_t i;
    unsigned bit;
    for (i = 0; i < length; i++) {
        crc ^= data[i];
        for (bit = 0; bit < 8u; bit++) {
            crc = (crc & 1u) ? (crc >> 1) ^ 0xEDB88320u : crc >> 1;
        }
    }
    return crc;
}

/* -- encoding ------------------------------------------------------------------------------------------------------ */

typedef struct {
    uint8_t *out;
    size_t size;
    size_t length;
    size_t count_at; /* where the running block's count goes */
    bool failed;
} cobs_t;

static void cobs_put(cobs_t *cobs, uint8_t byte)
{
    if (cobs->length < cobs->size) {
        cobs->out[cobs->length++] = byte;
    } else {
        cobs->failed = true;
    }
}

static void cobs_open(cobs_t *cobs)
{
    cobs->count_at = cobs->length;
    cobs_put(cobs, 0u);
}

static void cobs_close(cobs_t *cobs)
{
    if (!cobs->failed) {
        cobs->out[cobs->count_at] = (uint8_t)(cobs->length - cobs->count_at);
    }
}

static void cobs_write(cobs_t *cobs, uint8_t byte)
{
    if (cobs->length - cobs->count_at == 255u) { /* a full block: the next one begins only when a byte follows */
        cobs_close(cobs);
        cobs_open(cobs);
    }
    if (byte == 0u) {
        cobs_close(cobs);
        cobs_open(cobs);
    } else {
        cobs_put(cobs, byte);
    }
}

size_t vw_frame_encode(uint8_t type, uint8_t sequence, uint32_t uptime_ms, const uint8_t *body, size_t length,
                       uint8_t *out, size_t out_size)
{
    uint8_t header[VW_HEADER_SIZE];
    uint16_t crc = 0xFFFFu;
    cobs_t cobs;
    size_t i;

    if (length > VW_MAX_BODY || out_size == 0u) {
        return 0;
    }
    header[0] = type;
    header[1] = sequence;
    put_u32(&header[2], uptime_ms);
    cobs.out = out;
    cobs.size = out_size;
    cobs.length = 0;
    cobs.failed = false;
    cobs_put(&cobs, 0u);
    cobs_open(&cobs);
    for (i = 0; i < VW_HEADER_SIZE; i++) {
        crc = crc16_update(crc, header[i]);
        cobs_write(&cobs, header[i]);
    }
    for (i = 0; i < length; i++) {
        crc = crc16_update(crc, body[i]);
        cobs_write(&cobs, body[i]);
    }
    cobs_write(&cobs, (uint8_t)(crc & 0xFFu));
    cobs_write(&cobs, (uint8_t)(crc >> 8));
    cobs_close(&cobs);
    cobs_put(&cobs, 0u);
    return cobs.failed ? 0u : cobs.length;
}

/* -- decoding ------------------------------------------------------------------------------------------------------ */

/* Decode in place; returns the length, or 0 where the bytes are no COBS (no frame is empty). */
static size_t cobs_decode(uint8_t *bytes, size_t length)
{
    size_t in = 0, out = 0;
    while (in < length) {
        uint8_t count = bytes[in];
        size_t following = in + count;
        if (count == 0u || following > length) {
            return 0;
        }
        for (in++; in < following; in++) {
            bytes[out++] = bytes[in];
        }
        if (count != 255u && in < length) {
            bytes[out++] = 0u;
        }
    }
    return out;
}

static vw_item_t decode_chunk(vw_decoder_t *decoder, vw_frame_t *frame)
{
    size_t length = decoder->length;
    const uint8_t *payload = decoder->buffer;
    bool is_empty = length == 1u && payload[0] == 1u;

    if (length > VW_MAX_ENCODED) {
        return VW_ITEM_BAD_LONG;
    }
    length = cobs_decode(decoder->buffer, length);
    if (length == 0u && !is_empty) {
        return VW_ITEM_BAD_COBS;
    }
    if (length < VW_HEADER_SIZE + CRC_SIZE) {
        return VW_ITEM_BAD_SHORT;
    }
    if (length > VW_MAX_PAYLOAD) {
        return VW_ITEM_BAD_LONG;
    }
    if (vw_crc16(payload, length - CRC_SIZE) != get_u16(payload + length - CRC_SIZE)) {
        return VW_ITEM_BAD_CRC;
    }
    frame->type = payload[0];
    frame->sequence = payload[1];
    frame->uptime_ms = get_u32(payload + 2);
    frame->body = payload + VW_HEADER_SIZE;
    frame->length = (uint16_t)(length - VW_HEADER_SIZE - CRC_SIZE);
    return VW_ITEM_FRAME;
}

static bool is_command(uint8_t byte)
{
    return byte == VW_START_STREAM || byte == VW_STOP_STREAM;
}

static vw_item_t command_item(uint8_t byte)
{
    return byte == VW_START_STREAM ? VW_ITEM_START : VW_ITEM_STOP;
}

static bool is_all_commands(const vw_decoder_t *decoder)
{
    uint32_t i;
    if (decoder->length > VW_MAX_ENCODED) {
        return false;
    }
    for (i = 0; i < decoder->length; i++) {
        if (!is_command(decoder->buffer[i])) {
            return false;
        }
    }
    return true;
}

static void append(vw_decoder_t *decoder, uint8_t byte)
{
    if (decoder->length < VW_MAX_ENCODED) {
        decoder->buffer[decoder->length] = byte;
    }
    if (decoder->length < UINT32_MAX) {
        decoder->length++;
    }
}

static void close_chunk(vw_decoder_t *decoder, bool has_ended)
{
    uint32_t length = decoder->length, i;
    vw_frame_t frame;
    vw_item_t item;

    decoder->inside = true;
    if (decoder->side == VW_SIDE_MASTER && is_all_commands(decoder)) {
        decoder->length = 0;
        for (i = 0; i < length; i++) {
            decoder->handler(decoder->context, command_item(decoder->buffer[i]), NULL);
        }
        return;
    }
    item = decode_chunk(decoder, &frame);
    decoder->length = 0;
    if (item != VW_ITEM_FRAME || !has_ended) {
        decoder->dropped_bytes += decoder->side == VW_SIDE_MASTER ? length : 0u;
    } else if (decoder->side == VW_SIDE_MASTER) {
        decoder->inside = false;
    }
    if (item != VW_ITEM_FRAME || has_ended) {
        decoder->handler(decoder->context, item, item == VW_ITEM_FRAME ? &frame : NULL);
    }
}

static void feed_host(vw_decoder_t *decoder, uint8_t byte)
{
    if (byte != 0u) {
        append(decoder, byte);
    } else if (!decoder->inside) {
        decoder->dropped_bytes += decoder->length;
        decoder->length = 0;
        decoder->inside = true;
    } else if (decoder->length != 0u) {
        close_chunk(decoder, true);
    }
}

static void feed_master(vw_decoder_t *decoder, uint8_t byte)
{
    if (byte == 0u) {
        if (decoder->length != 0u) {
            close_chunk(decoder, true);
        } else {
            decoder->inside = true;
        }
    } else if (decoder->inside || !is_command(byte)) {
        decoder->inside = true;
        append(decoder, byte);
    } else {
        decoder->handler(decoder->context, command_item(byte), NULL);
    }
}

void vw_decoder_init(vw_decoder_t *decoder, vw_side_t side, vw_handler_t handler, void *context)
{
    decoder->side = side;
    decoder->handler = handler;
    decoder->context = context;
    decoder->length = 0;
    decoder->inside = false;
    decoder->dropped_bytes = 0;
}

void vw_decoder_feed(vw_decoder_t *decoder, const uint8_t *data, size_t length)
{
    size_t i;
    for (i = 0; i < length; i++) {
        if (decoder->side == VW_SIDE_HOST) {
            feed_host(decoder, data[i]);
        } else {
            feed_master(decoder, data[i]);
        }
    }
}

void vw_decoder_idle(vw_decoder_t *decoder)
{
    if (decoder->side == VW_SIDE_MASTER) {
        if (decoder->length != 0u) {
            close_chunk(decoder, false);
        }
        decoder->inside = false;
    }
}

/* -- bodies -------------------------------------------------------------------------------------------------------- */

size_t vw_data_append(uint8_t body[VW_MAX_BODY], size_t length, const uint8_t *master, uint16_t offset,
                      uint16_t count)
{
    if ((uint32_t)offset + count > VW_MASTER_SIZE || length + WINDOW_HEADER + count > VW_MAX_BODY) {
        return 0;
    }
    put_u16(body + length, offset);
    put_u16(body + length + 2, count);
    memcpy(body + length + WINDOW_HEADER, master + offset, count);
    return length + WINDOW_HEADER + count;
}

size_t vw_reply_body(uint8_t body[VW_MAX_BODY], const vw_frame_t *request, uint8_t result, uint16_t offset,
                     const uint8_t *data, size_t length)
{
    if (length > VW_MAX_BODY - REPLY_HEADER) {
        return 0;
    }
    body[0] = request->type;
    body[1] = request->sequence;
    body[2] = result;
    put_u16(body + 3, offset);
    if (length != 0u) {
        memcpy(body + REPLY_HEADER, data, length);
    }
    return REPLY_HEADER + length;
}

size_t vw_event_body(uint8_t body[VW_MAX_BODY], const vw_event_t *event)
{
    body[0] = event->code;
    body[1] = event->argument;
    put_u16(body + 2, event->cell);
    put_u32(body + 4, (uint32_t)event->value);
    put_u32(body + 8, (uint32_t)event->limit);
    return EVENT_SIZE;
}

size_t vw_ident_data(uint8_t data[VW_IDENT_SIZE], const vw_ident_t *ident)
{
    put_u16(data, ident->protocol);
    memcpy(data + 2, ident->firmware, 3);
    memcpy(data + 5, ident->map_hash, 8);
    data[13] = ident->reset_cause;
    put_u32(data + 14, ident->boots);
    return VW_IDENT_SIZE;
}

enum vw_result vw_request_parse(const vw_frame_t *frame, vw_request_t *request, uint16_t *offset)
{
    const uint8_t *body = frame->body;
    uint32_t limit;

    memset(request, 0, sizeof *request);
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
        request->offset = get_u16(body);
        request->length = get_u16(body + 2);
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
        request->argument = get_i32(body + 1);
        return VW_RESULT_DONE;
    default:
        return VW_RESULT_UNKNOWN_REQUEST;
    }
}

size_t vw_request_body(uint8_t body[VW_MAX_BODY], const vw_request_t *request)
{
    switch (request->type) {
    case VW_MSG_READ:
        put_u16(body, request->offset);
        put_u16(body + 2, request->length);
        return WINDOW_HEADER;
    case VW_MSG_WRITE:
        if (request->length > VW_MAX_BODY - WINDOW_HEADER) {
            return 0;
        }
        put_u16(body, request->offset);
        put_u16(body + 2, request->length);
        memcpy(body + WINDOW_HEADER, request->data, request->length);
        return WINDOW_HEADER + (size_t)request->length;
    case VW_MSG_COMMAND:
        body[0] = request->command;
        put_u32(body + 1, (uint32_t)request->argument);
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
    window->offset = get_u16(frame->body + *position);
    window->length = get_u16(frame->body + *position + 2);
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
    if (frame->type != VW_MSG_REPLY || frame->length < REPLY_HEADER) {
        return false;
    }
    reply->request_type = frame->body[0];
    reply->request_sequence = frame->body[1];
    reply->result = frame->body[2];
    reply->offset = get_u16(frame->body + 3);
    reply->data = frame->body + REPLY_HEADER;
    reply->length = (uint16_t)(frame->length - REPLY_HEADER);
    return true;
}

bool vw_event_parse(const vw_frame_t *frame, vw_event_t *event)
{
    if (frame->type != VW_MSG_EVENT || frame->length != EVENT_SIZE) {
        return false;
    }
    event->code = frame->body[0];
    event->argument = frame->body[1];
    event->cell = get_u16(frame->body + 2);
    event->value = get_i32(frame->body + 4);
    event->limit = get_i32(frame->body + 8);
    return true;
}

bool vw_ident_parse(const uint8_t *data, size_t length, vw_ident_t *ident)
{
    if (length < VW_IDENT_SIZE) {
        return false;
    }
    ident->protocol = get_u16(data);
    memcpy(ident->firmware, data + 2, 3);
    memcpy(ident->map_hash, data + 5, 8);
    ident->reset_cause = data[13];
    ident->boots = get_u32(data + 14);
    return true;
}
