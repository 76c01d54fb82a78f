/* The codec against the vectors of whole frames, CAN frames, EEPROM images and configurations. */
#include <stdlib.h>
#include <string.h>

#include "text.h"
#include "vectors.h"
#include "vw_can.h"
#include "vw_config.h"
#include "vw_store.h"

static void keep_frame(void *context, vw_item_t item, const vw_frame_t *frame)
{
    static uint8_t body[VW_MAX_BODY];
    vw_frame_t *kept = context;
    if (item == VW_ITEM_FRAME) {
        *kept = *frame;
        memcpy(body, frame->body, frame->length);
        kept->body = body;
    }
}

unsigned check_whole_frames(const char *folder)
{
    static uint8_t wire[MAX_TEXT / 2u], out[VW_MAX_FRAME];
    static vw_decoder_t decoder;
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "whole_frames.json"); v != NULL; v = next_vector(v), count++) {
        size_t length = from_hex(value_of(v, "wire"), wire);
        vw_frame_t frame = { 0 };
        vw_decoder_init(&decoder, VW_SIDE_HOST, keep_frame, &frame);
        vw_decoder_feed(&decoder, wire, length);
        expect(frame.body != NULL && frame.type == number_of(v, "type") && frame.sequence == number_of(v, "sequence")
                   && frame.uptime_ms == number_of(v, "uptime_ms"),
               "whole_frames.json", v);
        check_message(&frame, "whole_frames.json", v);
        expect(vw_frame_encode(frame.type, frame.sequence, frame.uptime_ms, frame.body, frame.length, out, sizeof out)
                       == length
                   && memcmp(out, wire, length) == 0,
               "whole_frames.json", v);
    }
    return count;
}

unsigned check_config_limits(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    static uint8_t image[VW_CONFIG_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "config_limits.json"); v != NULL; v = next_vector(v), count++) {
        memcpy(image, &defaults, sizeof image);
        (void)from_hex(value_of(v, "data"), image + number_of(v, "offset"));
        expect(vw_config_check(image) == number_of(v, "refused"), "config_limits.json", v);
    }
    return count;
}

unsigned check_eeprom_images(const char *folder)
{
    static uint8_t slots[2][VW_EEPROM_SLOT_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "eeprom_images.json"); v != NULL; v = next_vector(v), count++) {
        uint32_t counter = 0;
        int newest;
        from_hex(value_of(v, "slot_0"), slots[0]);
        from_hex(value_of(v, "slot_1"), slots[1]);
        newest = vw_slot_newest(slots[0], slots[1]);
        expect(newest == atol(value_of(v, "newest")), "eeprom_images.json", v);
        if (newest >= 0) {
            static uint8_t image[VW_CONFIG_SIZE], meant[VW_CONFIG_SIZE];
            const uint8_t *found = vw_slot_image(slots[newest], &counter);
            expect(found != NULL && counter == number_of(v, "counter"), "eeprom_images.json", v);
            memcpy(image, found, sizeof image);
            vw_slot_to_present(slots[newest], image);
            (void)from_hex(value_of(v, "image"), meant);
            expect(memcmp(image, meant, sizeof image) == 0, "eeprom_images.json", v);
        }
    }
    return count;
}

static uint8_t eeprom[VW_EEPROM_SIZE];

static bool read_eeprom(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(data, eeprom + address, length);
    return true;
}

static bool write_eeprom(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(eeprom + address, data, length);
    return true;
}

unsigned check_journal(const char *folder)
{
    static const vw_board_t board = { .eeprom_read = read_eeprom, .eeprom_write = write_eeprom };
    static uint8_t data[VW_EEPROM_PAGE_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "eeprom_journal.json"); v != NULL; v = next_vector(v), count++) {
        vw_journal_t found;
        size_t length = from_hex(value_of(v, "data"), data);
        memset(eeprom, 0xFF, sizeof eeprom);
        memcpy(eeprom + number_of(v, "offset"), data, length);
        vw_journal_read(&board, &found);
        expect(found.counter == number_of(v, "counter") && found.dod == number_of(v, "dod")
                   && found.soc == number_of(v, "soc"),
               "eeprom_journal.json", v);
        if (number_of(v, "layout") == VW_EEPROM_LAYOUT_VERSION) {
            found.counter--;
            memset(eeprom, 0xFF, sizeof eeprom);
            expect(vw_journal_write(&board, &found, (uint32_t)number_of(v, "dod"), (uint16_t)number_of(v, "soc"))
                       && memcmp(eeprom + number_of(v, "offset"), data, length) == 0,
                   "eeprom_journal.json", v);
        }
    }
    return count;
}

/* The default tables: what is sent out of the struct, and what lands in it. */
unsigned check_can_frames(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    static vw_master_t master, expected;
    static const vw_board_t board;
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "can_frames.json"); v != NULL; v = next_vector(v), count++) {
        bool is_tx = strcmp(value_of(v, "direction"), "tx") == 0;
        vw_can_frame_t frame = { 0 }, sent;
        vw_can_t can;
        char *at;
        memset(&master, 0, sizeof master);
        master.conf = defaults;
        if (is_tx) {
            memset(master.conf.can_tx_msg_timing, 0, sizeof master.conf.can_tx_msg_timing);
        }
        expected = master;
        for (at = strtok((char *)value_of(v, "struct"), " "); at != NULL; at = strtok(NULL, " ")) {
            uint8_t *target = is_tx ? (uint8_t *)&master : (uint8_t *)&expected;
            (void)from_hex(strchr(at, ':') + 1, target + strtoul(at, NULL, 10));
        }
        frame.id = (uint32_t)number_of(v, "id");
        frame.is_extended = number_of(v, "is_extended") != 0u;
        frame.length = (uint8_t)from_hex(value_of(v, "data"), frame.data);
        vw_can_init(&can, &board, &master);
        if (is_tx) {
            vw_can_send_once(&can, (uint8_t)number_of(v, "index"));
            expect(vw_can_next(&can, 0u, &sent) && sent.id == frame.id && sent.is_extended == frame.is_extended
                       && sent.length == frame.length && memcmp(sent.data, frame.data, sent.length) == 0,
                   "can_frames.json", v);
        } else {
            vw_can_received(&can, 0u, &frame);
            expect(memcmp(&master.charger, &expected.charger, sizeof master.charger) == 0, "can_frames.json", v);
        }
    }
    return count;
}
