#include "vw_codec.h"

#include "vw_bytes.h"

#define CRC_SIZE 2u

/* Both checksums four bits at a time: a fifth of the time of one bit at a time, for 96 bytes of table. */
static const uint16_t crc16_table[16] = {
    0x0000u, 0x1021u, 0x2042u, 0x3063u, 0x4084u, 0x50A5u, 0x60C6u, 0x70E7u,
    0x8108u, 0x9129u, 0xA14Au, 0xB16Bu, 0xC18Cu, 0xD1ADu, 0xE1CEu, 0xF1EFu,
};
static const uint32_t crc32_table[16] = {
    0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu,
    0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
    0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
    0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
};

static uint16_t vw_codec_update_crc16(uint16_t crc, uint8_t byte)
{
    crc = (uint16_t)((uint32_t)crc << 4) ^ crc16_table[(uint32_t)(crc >> 12) ^ (uint32_t)(byte >> 4)];
    crc = (uint16_t)((uint32_t)crc << 4) ^ crc16_table[(uint32_t)(crc >> 12) ^ (byte & 0x0Fu)];
    return crc;
}

uint16_t vw_crc16(const uint8_t *data, size_t length)
{
    uint16_t crc = 0xFFFFu;
    size_t i;
    for (i = 0; i < length; i++) {
        crc = vw_codec_update_crc16(crc, data[i]);
    }
    return crc;
}

uint32_t vw_crc32_update(uint32_t crc, const uint8_t *data, size_t length)
{
    size_t i;
    for (i = 0; i < length; i++) {
        crc = (crc >> 4) ^ crc32_table[(crc ^ data[i]) & 0x0Fu];
        crc = (crc >> 4) ^ crc32_table[(crc ^ ((uint32_t)data[i] >> 4)) & 0x0Fu];
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

static void vw_codec_cobs_put(cobs_t *cobs, uint8_t byte)
{
    if (cobs->length < cobs->size) {
        cobs->out[cobs->length++] = byte;
    } else {
        cobs->failed = true;
    }
}

static void vw_codec_cobs_open(cobs_t *cobs)
{
    cobs->count_at = cobs->length;
    vw_codec_cobs_put(cobs, 0u);
}

static void vw_codec_cobs_close(cobs_t *cobs)
{
    if (!cobs->failed) {
        cobs->out[cobs->count_at] = (uint8_t)(cobs->length - cobs->count_at);
    }
}

static void vw_codec_cobs_write(cobs_t *cobs, uint8_t byte)
{
    if (cobs->length - cobs->count_at == 255u) { /* a full block: the next one begins only when a byte follows */
        vw_codec_cobs_close(cobs);
        vw_codec_cobs_open(cobs);
    }
    if (byte == 0u) {
        vw_codec_cobs_close(cobs);
        vw_codec_cobs_open(cobs);
    } else {
        vw_codec_cobs_put(cobs, byte);
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
    vw_put_u32(&header[2], uptime_ms);
    cobs.out = out;
    cobs.size = out_size;
    cobs.length = 0;
    cobs.failed = false;
    vw_codec_cobs_put(&cobs, 0u);
    vw_codec_cobs_open(&cobs);
    for (i = 0; i < VW_HEADER_SIZE; i++) {
        crc = vw_codec_update_crc16(crc, header[i]);
        vw_codec_cobs_write(&cobs, header[i]);
    }
    for (i = 0; i < length; i++) {
        crc = vw_codec_update_crc16(crc, body[i]);
        vw_codec_cobs_write(&cobs, body[i]);
    }
    vw_codec_cobs_write(&cobs, (uint8_t)(crc & 0xFFu));
    vw_codec_cobs_write(&cobs, (uint8_t)(crc >> 8));
    vw_codec_cobs_close(&cobs);
    vw_codec_cobs_put(&cobs, 0u);
    return cobs.failed ? 0u : cobs.length;
}

/* -- decoding ------------------------------------------------------------------------------------------------------ */

/* Decode in place; returns the length, or 0 where the bytes are no COBS (no frame is empty). */
static size_t vw_codec_cobs_decode(uint8_t *bytes, size_t length)
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

static vw_item_t vw_codec_decode_chunk(vw_decoder_t *decoder, vw_frame_t *frame)
{
    size_t length = decoder->length;
    const uint8_t *payload = decoder->buffer;
    bool is_empty = length == 1u && payload[0] == 1u;

    if (length > VW_MAX_ENCODED) {
        return VW_ITEM_BAD_LONG;
    }
    length = vw_codec_cobs_decode(decoder->buffer, length);
    if (length == 0u && !is_empty) {
        return VW_ITEM_BAD_COBS;
    }
    if (length < VW_HEADER_SIZE + CRC_SIZE) {
        return VW_ITEM_BAD_SHORT;
    }
    if (length > VW_MAX_PAYLOAD) {
        return VW_ITEM_BAD_LONG;
    }
    if (vw_crc16(payload, length - CRC_SIZE) != vw_get_u16(payload + length - CRC_SIZE)) {
        return VW_ITEM_BAD_CRC;
    }
    frame->type = payload[0];
    frame->sequence = payload[1];
    frame->uptime_ms = vw_get_u32(payload + 2);
    frame->body = payload + VW_HEADER_SIZE;
    frame->length = (uint16_t)(length - VW_HEADER_SIZE - CRC_SIZE);
    return VW_ITEM_FRAME;
}

static bool vw_codec_is_command(uint8_t byte)
{
    return byte == VW_START_STREAM || byte == VW_STOP_STREAM;
}

static vw_item_t vw_codec_make_command_item(uint8_t byte)
{
    return byte == VW_START_STREAM ? VW_ITEM_START : VW_ITEM_STOP;
}

static bool vw_codec_has_only_commands(const vw_decoder_t *decoder)
{
    uint32_t i;
    if (decoder->length > VW_MAX_ENCODED) {
        return false;
    }
    for (i = 0; i < decoder->length; i++) {
        if (!vw_codec_is_command(decoder->buffer[i])) {
            return false;
        }
    }
    return true;
}

static void vw_codec_append_byte(vw_decoder_t *decoder, uint8_t byte)
{
    if (decoder->length < VW_MAX_ENCODED) {
        decoder->buffer[decoder->length] = byte;
    }
    if (decoder->length < UINT32_MAX) {
        decoder->length++;
    }
}

static void vw_codec_close_chunk(vw_decoder_t *decoder, bool has_ended)
{
    uint32_t length = decoder->length, i;
    vw_frame_t frame;
    vw_item_t item;

    decoder->inside = true;
    if (decoder->side == VW_SIDE_MASTER && vw_codec_has_only_commands(decoder)) {
        decoder->length = 0;
        for (i = 0; i < length; i++) {
            decoder->handler(decoder->context, vw_codec_make_command_item(decoder->buffer[i]), NULL);
        }
        return;
    }
    item = vw_codec_decode_chunk(decoder, &frame);
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

static void vw_codec_feed_host(vw_decoder_t *decoder, uint8_t byte)
{
    if (byte != 0u) {
        vw_codec_append_byte(decoder, byte);
    } else if (!decoder->inside) {
        decoder->dropped_bytes += decoder->length;
        decoder->length = 0;
        decoder->inside = true;
    } else if (decoder->length != 0u) {
        vw_codec_close_chunk(decoder, true);
    }
}

static void vw_codec_feed_master(vw_decoder_t *decoder, uint8_t byte)
{
    if (byte == 0u) {
        if (decoder->length != 0u) {
            vw_codec_close_chunk(decoder, true);
        } else {
            decoder->inside = true;
        }
    } else if (decoder->inside || !vw_codec_is_command(byte)) {
        decoder->inside = true;
        vw_codec_append_byte(decoder, byte);
    } else {
        decoder->handler(decoder->context, vw_codec_make_command_item(byte), NULL);
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
            vw_codec_feed_host(decoder, data[i]);
        } else {
            vw_codec_feed_master(decoder, data[i]);
        }
    }
}

void vw_decoder_idle(vw_decoder_t *decoder)
{
    if (decoder->side == VW_SIDE_MASTER) {
        if (decoder->length != 0u) {
            vw_codec_close_chunk(decoder, false);
        }
        decoder->inside = false;
    }
}
