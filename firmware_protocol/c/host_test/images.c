/* The codec against the vectors of whole frames, CAN frames, EEPROM images and configurations. */
#include <stdlib.h>
#include <string.h>

#include "text.h"
#include "vectors.h"
#include "vw_can.h"
#include "vw_config.h"
#include "vw_store.h"

static void vw_images_keep_frame(void *context, vw_item_t item, const vw_frame_t *frame)
{
    static uint8_t body[VW_MAX_BODY];
    vw_frame_t *kept = context;
    if (item == VW_ITEM_FRAME) {
        *kept = *frame;
        memcpy(body, frame->body, frame->length);
        kept->body = body;
    }
}

unsigned vw_images_check_whole_frames(const char *folder)
{
    static uint8_t wire[MAX_TEXT / 2u], out[VW_MAX_FRAME];
    static vw_decoder_t decoder;
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "whole_frames.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        size_t length = vw_text_read_hex(vw_vectors_find_value(v, "wire"), wire);
        vw_frame_t frame = { 0 };
        vw_decoder_init(&decoder, VW_SIDE_HOST, vw_images_keep_frame, &frame);
        vw_decoder_feed(&decoder, wire, length);
        vw_vectors_expect(frame.body != NULL && frame.type == vw_vectors_find_number(v, "type")
                          && frame.sequence == vw_vectors_find_number(v, "sequence")
                          && frame.uptime_ms == vw_vectors_find_number(v, "uptime_ms"), "whole_frames.json", v);
        vw_vectors_check_message(&frame, "whole_frames.json", v);
        vw_vectors_expect(vw_frame_encode(frame.type, frame.sequence, frame.uptime_ms, frame.body, frame.length, out,
                                          sizeof out) == length
                          && memcmp(out, wire, length) == 0, "whole_frames.json", v);
    }
    return count;
}

unsigned vw_images_check_config_limits(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    static uint8_t image[VW_CONFIG_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "config_limits.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        memcpy(image, &defaults, sizeof image);
        (void)vw_text_read_hex(vw_vectors_find_value(v, "data"), image + vw_vectors_find_number(v, "offset"));
        vw_vectors_expect(vw_config_check(image) == vw_vectors_find_number(v, "refused"), "config_limits.json", v);
    }
    return count;
}

unsigned vw_images_check_eeprom(const char *folder)
{
    static uint8_t slots[2][VW_EEPROM_SLOT_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "eeprom_images.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        uint32_t counter = 0;
        int newest;
        vw_text_read_hex(vw_vectors_find_value(v, "slot_0"), slots[0]);
        vw_text_read_hex(vw_vectors_find_value(v, "slot_1"), slots[1]);
        newest = vw_slot_newest(slots[0], slots[1]);
        vw_vectors_expect(newest == atol(vw_vectors_find_value(v, "newest")), "eeprom_images.json", v);
        if (newest >= 0) {
            static uint8_t image[VW_CONFIG_SIZE], meant[VW_CONFIG_SIZE];
            const uint8_t *found = vw_slot_image(slots[newest], &counter);
            vw_vectors_expect(found != NULL && counter == vw_vectors_find_number(v, "counter"), "eeprom_images.json",
                              v);
            memcpy(image, found, sizeof image);
            vw_slot_to_present(slots[newest], image);
            (void)vw_text_read_hex(vw_vectors_find_value(v, "image"), meant);
            vw_vectors_expect(memcmp(image, meant, sizeof image) == 0, "eeprom_images.json", v);
        }
    }
    return count;
}

static uint8_t eeprom[VW_EEPROM_SIZE];

static bool vw_images_read_eeprom(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(data, eeprom + address, length);
    return true;
}

static bool vw_images_write_eeprom(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(eeprom + address, data, length);
    return true;
}

unsigned vw_images_check_journal(const char *folder)
{
    static const vw_board_t board = { .eeprom_read = vw_images_read_eeprom, .eeprom_write = vw_images_write_eeprom };
    static uint8_t data[VW_EEPROM_PAGE_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "eeprom_journal.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        vw_journal_t found;
        size_t length = vw_text_read_hex(vw_vectors_find_value(v, "data"), data);
        memset(eeprom, 0xFF, sizeof eeprom);
        memcpy(eeprom + vw_vectors_find_number(v, "offset"), data, length);
        vw_journal_read(&board, &found);
        vw_vectors_expect(found.counter == vw_vectors_find_number(v, "counter")
                          && found.dod == vw_vectors_find_number(v, "dod")
                          && found.soc == vw_vectors_find_number(v, "soc"), "eeprom_journal.json", v);
        if (vw_vectors_find_number(v, "layout") == VW_EEPROM_LAYOUT_VERSION) {
            found.counter--;
            memset(eeprom, 0xFF, sizeof eeprom);
            vw_vectors_expect(vw_journal_write(&board, &found, (uint32_t)vw_vectors_find_number(v, "dod"),
                                               (uint16_t)vw_vectors_find_number(v, "soc"))
                              && memcmp(eeprom + vw_vectors_find_number(v, "offset"), data, length) == 0,
                              "eeprom_journal.json", v);
        }
    }
    return count;
}

/* The default tables: what is sent out of the struct, and what lands in it. */
unsigned vw_images_check_can_frames(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    static vw_master_t master, expected;
    static const vw_board_t board;
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "can_frames.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        bool is_tx = strcmp(vw_vectors_find_value(v, "direction"), "tx") == 0;
        vw_can_frame_t frame = { 0 }, sent;
        vw_can_t can;
        char *at;
        memset(&master, 0, sizeof master);
        master.conf = defaults;
        if (is_tx) {
            memset(master.conf.can_tx_msg_timing, 0, sizeof master.conf.can_tx_msg_timing);
        }
        expected = master;
        for (at = strtok((char *)vw_vectors_find_value(v, "struct"), " "); at != NULL; at = strtok(NULL, " ")) {
            uint8_t *target = is_tx ? (uint8_t *)&master : (uint8_t *)&expected;
            (void)vw_text_read_hex(strchr(at, ':') + 1, target + strtoul(at, NULL, 10));
        }
        frame.id = (uint32_t)vw_vectors_find_number(v, "id");
        frame.is_extended = vw_vectors_find_number(v, "is_extended") != 0u;
        frame.length = (uint8_t)vw_text_read_hex(vw_vectors_find_value(v, "data"), frame.data);
        vw_can_init(&can, &board, &master);
        if (is_tx) {
            vw_can_send_once(&can, (uint8_t)vw_vectors_find_number(v, "index"));
            vw_vectors_expect(vw_can_next(&can, 0u, &sent) && sent.id == frame.id
                              && sent.is_extended == frame.is_extended && sent.length == frame.length
                              && memcmp(sent.data, frame.data, sent.length) == 0, "can_frames.json", v);
        } else {
            vw_can_received(&can, 0u, &frame);
            vw_vectors_expect(memcmp(&master.charger, &expected.charger, sizeof master.charger) == 0, "can_frames.json",
                              v);
        }
    }
    return count;
}
