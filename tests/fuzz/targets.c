/* The targets: the master's whole side of the line with its EEPROM, bodies, configurations and slots, the CAN tables. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "targets.h"
#include "vw_can.h"
#include "vw_config.h"
#include "vw_link.h"
#include "vw_messages.h"

#define EEPROM_SIZE 32768u
#define PAGE 64u

static uint8_t eeprom[EEPROM_SIZE];
static uint32_t eeprom_trouble; /* bits: reads fail, writes fail, never ready */

static void must(int holds, const char *what)
{
    if (!holds) {
        (void)fprintf(stderr, "broken: %s\n", what);
        abort();
    }
}

static bool eeprom_read(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    must((uint32_t)address + length <= EEPROM_SIZE, "a read beyond the EEPROM");
    memcpy(data, eeprom + address, length);
    return (eeprom_trouble & 1u) == 0u;
}

static bool eeprom_write(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    (void)context;
    must(address % PAGE + length <= PAGE && (uint32_t)address + length <= EEPROM_SIZE, "a write beyond a page");
    memcpy(eeprom + address, data, length);
    return (eeprom_trouble & 2u) == 0u;
}

static bool eeprom_is_busy(void *context)
{
    (void)context;
    return (eeprom_trouble & 4u) != 0u;
}

static enum vw_result done(void *context, int32_t argument)
{
    (void)context;
    (void)argument;
    return VW_RESULT_DONE;
}

#define DONE_COMMAND(name, code, low, high) done,
static const vw_board_t board = { .eeprom_read = eeprom_read,
                                  .eeprom_write = eeprom_write,
                                  .eeprom_is_busy = eeprom_is_busy,
                                  .commands = { VW_COMMANDS(DONE_COMMAND) } };

static void no_item(void *context, vw_item_t item, const vw_frame_t *frame)
{
    unsigned long *sum = context;
    if (item == VW_ITEM_FRAME) {
        uint16_t i;
        must(frame->length <= VW_MAX_BODY, "a frame that is too long");
        for (i = 0; i < frame->length; i++) {
            *sum += frame->body[i];
        }
    }
}

/* Steps of kind, length and bytes: frames and noise from the host, time, CAN frames; what the master answers is read by
 * the host's decoder. */
static void link(const uint8_t *data, size_t length)
{
    static vw_master_t master;
    static vw_link_t master_link;
    static vw_can_t can;
    static vw_decoder_t host;
    static uint8_t out[VW_MAX_FRAME];
    vw_ident_t ident = { 0 };
    unsigned long sum = 0;
    uint32_t now_ms = 0;
    size_t at = 1;
    memset(&master, 0, sizeof master);
    memset(eeprom, 0xFF, sizeof eeprom);
    eeprom_trouble = length != 0u ? data[0] & 7u : 0u;
    vw_decoder_init(&host, VW_SIDE_HOST, no_item, &sum);
    vw_link_init(&master_link, &board, &master, &can, &ident);
    while (at + 2u <= length) {
        uint8_t kind = data[at];
        size_t n = data[at + 1u];
        const uint8_t *what = data + at + 2u;
        n = n > length - at - 2u ? length - at - 2u : n;
        at += 2u + n;
        now_ms += (uint32_t)(kind >> 4) * 7u;
        if (kind % 4u == 0u) {
            vw_link_received(&master_link, now_ms, what, n);
        } else if (kind % 4u == 1u && n >= 1u) { /* a sound frame */
            size_t count = vw_frame_encode(what[0], kind, now_ms, what + 1, n - 1u, out, sizeof out);
            vw_link_received(&master_link, now_ms, out, count);
        } else if (kind % 4u == 2u && n >= 5u) {
            vw_can_frame_t frame = { 0 };
            memcpy(&frame.id, what, 4u);
            frame.is_extended = (frame.id & 0x80000000u) != 0u;
            frame.id &= 0x1FFFFFFFu;
            frame.length = (uint8_t)(n - 5u > 8u ? 8u : n - 5u);
            memcpy(frame.data, what + 5, frame.length);
            vw_can_received(&can, now_ms, &frame);
        } else {
            vw_can_frame_t frame;
            unsigned most = 32u;
            now_ms += n * 50u;
            while (vw_can_next(&can, now_ms, &frame) && most-- != 0u) {
                must(frame.length <= 8u, "a CAN frame that is too long");
            }
            (void)vw_can_expire(&can, now_ms);
        }
        vw_link_run(&master_link, now_ms);
        for (n = 0; n < 8u; n++) {
            size_t count = vw_link_next(&master_link, now_ms, out);
            must(count <= VW_MAX_FRAME, "a frame that does not fit");
            if (count == 0u) {
                break;
            }
            vw_decoder_feed(&host, out, count);
        }
        must(vw_config_check((const uint8_t *)&master) == VW_NO_OFFSET, "a configuration in force that is not allowed");
    }
    must(host.dropped_bytes == 0u, "the master said what no host understands");
}

static void messages(const uint8_t *data, size_t length)
{
    static uint8_t body[VW_MAX_BODY];
    static uint8_t master[VW_MASTER_SIZE];
    vw_frame_t frame = { 0 };
    vw_request_t request;
    vw_reply_t reply;
    vw_event_t event;
    vw_ident_t ident;
    vw_window_t window;
    size_t position = 0, n = 0;
    uint16_t offset;
    frame.type = length != 0u ? data[0] : 0u;
    frame.body = data + (length != 0u);
    frame.length = (uint16_t)(length == 0u ? 0u : length - 1u > VW_MAX_BODY ? VW_MAX_BODY : length - 1u);
    if (vw_request_parse(&frame, &request, &offset) == VW_RESULT_DONE) {
        n = vw_request_body(body, &request);
        must(n == frame.length && memcmp(body, frame.body, n) == 0, "a request that is another one");
    }
    if (vw_data_is_valid(&frame)) {
        n = 0;
        while (vw_data_next(&frame, &position, &window)) {
            memcpy(master + window.offset, window.data, window.length);
            n = vw_data_append(body, n, master, window.offset, window.length);
        }
    }
    if (vw_reply_parse(&frame, &reply)) {
        (void)vw_ident_parse(reply.data, reply.length, &ident);
    }
    if (vw_event_parse(&frame, &event)) {
        n = vw_event_body(body, &event);
        must(n == frame.length && memcmp(body, frame.body, n) == 0, "an event that is another one");
    }
}

/* Both slots of an EEPROM are given; a configuration that is in one is checked, and stored again. */
static void config(const uint8_t *data, size_t length)
{
    static uint8_t slots[2][VW_EEPROM_SLOT_SIZE], image[VW_CONFIG_SIZE], again[VW_EEPROM_SLOT_SIZE];
    static vw_store_t store;
    uint32_t counter = 0, now_ms = 0;
    const uint8_t *found;
    vw_journal_t journal;
    size_t i;
    memset(slots, 0xFF, sizeof slots);
    memcpy(slots, data, length > sizeof slots ? sizeof slots : length);
    memset(image, 0, sizeof image);
    memcpy(image, data, length > sizeof image ? sizeof image : length);
    (void)vw_config_check(image);
    vw_config_clear_padding(image);
    vw_slot_encode(again, image, 7u);
    found = vw_slot_image(again, &counter);
    must(found != NULL && counter == 7u && memcmp(found, image, sizeof image) == 0, "a slot that is not found again");
    (void)vw_slot_newest(slots[0], slots[1]);
    memset(eeprom, 0xFF, sizeof eeprom);
    for (i = 0; length != 0u && i < sizeof eeprom; i += 37u) {
        eeprom[i] = data[i % length];
    }
    eeprom_trouble = length != 0u ? data[0] & 7u : 0u;
    vw_journal_read(&board, &journal);
    (void)vw_journal_write(&board, &journal, 5u, 6u);
    vw_store_init(&store, &board);
    (void)vw_store_read(&store, true);
    if (vw_store_begin(&store, image, now_ms) == VW_RESULT_DONE) {
        for (i = 0; i < 200u && vw_store_is_busy(&store); i++) {
            (void)vw_store_run(&store, now_ms);
            now_ms += 10u;
        }
        must(!vw_store_is_busy(&store), "a store without an end");
    }
}

/* A configuration's tables, then frames. */
static void can_tables(const uint8_t *data, size_t length)
{
    static vw_master_t master;
    static vw_can_t can;
    vw_can_frame_t frame;
    uint32_t now_ms = 0;
    size_t at = VW_CONFIG_SIZE;
    unsigned i;
    memset(&master, 0, sizeof master);
    memcpy(&master, data, length > VW_CONFIG_SIZE ? VW_CONFIG_SIZE : length);
    vw_can_init(&can, &board, &master);
    while (at + 5u <= length) {
        frame.id = (uint32_t)data[at] | (uint32_t)data[at + 1u] << 8;
        frame.is_extended = (data[at + 2u] & 1u) != 0u;
        frame.length = data[at + 3u] % 9u;
        memset(frame.data, data[at + 4u], sizeof frame.data);
        at += 5u;
        now_ms += data[at - 1u];
        vw_can_received(&can, now_ms, &frame);
        for (i = 0; i < 20u && vw_can_next(&can, now_ms, &frame); i++) {
            must(frame.length <= 8u, "a CAN frame that is too long");
        }
        (void)vw_can_expire(&can, now_ms);
        vw_can_enable(&can, (uint8_t)now_ms);
        vw_can_send_once(&can, (uint8_t)now_ms);
        vw_can_reload(&can);
    }
}

vw_fuzz_target_t vw_fuzz_target(const char *name)
{
    static const struct {
        const char *name;
        vw_fuzz_target_t target;
    } all[] = { { "link", link }, { "messages", messages }, { "config", config }, { "can", can_tables } };
    size_t i;
    for (i = 0; i < sizeof all / sizeof all[0]; i++) {
        if (strcmp(all[i].name, name) == 0) {
            return all[i].target;
        }
    }
    return NULL;
}
