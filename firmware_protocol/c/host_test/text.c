#include "text.h"

#include <stdio.h>
#include <string.h>

items_t items;
uint8_t bytes[MAX_TEXT / 2u];

size_t vw_text_read_hex(const char *hex, uint8_t *out)
{
    size_t n = 0;
    unsigned value;
    while (hex[0] != '-' && hex[0] != '\0' && hex[0] != '\n' && sscanf(hex, "%2x", &value) == 1) {
        out[n++] = (uint8_t)value;
        hex += 2;
    }
    return n;
}

static void vw_text_add_text(const char *text)
{
    size_t n = strlen(text);
    if (items.length + n + 1u < sizeof items.text) {
        memcpy(items.text + items.length, text, n + 1u);
        items.length += n;
    }
}

void vw_text_clear_items(void)
{
    items.length = 0;
    items.text[0] = '\0';
}

void vw_text_add_hex(const uint8_t *data, size_t length)
{
    char pair[3];
    size_t i;
    if (length == 0u) {
        vw_text_add_text("-");
    }
    for (i = 0; i < length; i++) {
        sprintf(pair, "%02x", data[i]);
        vw_text_add_text(pair);
    }
}

static void vw_text_add_item(void *context, vw_item_t item, const vw_frame_t *frame)
{
    static const char *const names[] = { "", "bad:cobs", "bad:short", "bad:long", "bad:crc", "start", "stop" };
    char head[40];
    (void)context;
    if (items.length != 0u) {
        vw_text_add_text(" ");
    }
    if (item == VW_ITEM_FRAME) {
        sprintf(head, "frame:%02x:%02x:%08lx:", frame->type, frame->sequence, (unsigned long)frame->uptime_ms);
        vw_text_add_text(head);
        vw_text_add_hex(frame->body, frame->length);
    } else {
        vw_text_add_text(names[item]);
    }
}

uint32_t vw_text_run_decoder(vw_side_t side, bool idle, size_t size, const uint8_t *wire, size_t length)
{
    static vw_decoder_t decoder;
    size_t at;
    vw_text_clear_items();
    vw_decoder_init(&decoder, side, vw_text_add_item, NULL);
    for (at = 0; at < length; at += size) {
        vw_decoder_feed(&decoder, wire + at, length - at < size ? length - at : size);
    }
    if (idle) {
        vw_decoder_idle(&decoder);
    }
    return decoder.dropped_bytes;
}
