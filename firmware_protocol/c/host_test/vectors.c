/* The codec against the vectors in tests/vectors. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "text.h"
#include "vectors.h"
#include "vw_can.h"
#include "vw_config.h"
#include "vw_messages.h"

static char file_text[MAX_TEXT];

const char *vw_vectors_find_value(const char *object, const char *key)
{
    static char values[8][MAX_TEXT / 4u];
    static unsigned turn;
    char *out = values[turn++ % 8u];
    char pattern[40];
    const char *end = strchr(object, '}');
    const char *at;
    size_t n = 0;
    sprintf(pattern, "\"%s\": ", key);
    at = strstr(object, pattern);
    out[0] = '\0';
    if (at == NULL || end == NULL || at > end) {
        return out;
    }
    at += strlen(pattern);
    if (*at == '"') {
        at++;
        n = strcspn(at, "\"");
    } else {
        n = strcspn(at, ",}");
    }
    memcpy(out, at, n);
    out[n] = '\0';
    return out;
}

unsigned long vw_vectors_find_number(const char *object, const char *key)
{
    return strtoul(vw_vectors_find_value(object, key), NULL, 10);
}

const char *vw_vectors_read_first(const char *folder, const char *name)
{
    char path[1024];
    FILE *file;
    size_t n;
    const char *list;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "rb");
    if (file == NULL) {
        fprintf(stderr, "cannot read %s\n", path);
        exit(2);
    }
    n = fread(file_text, 1, sizeof file_text - 1u, file);
    fclose(file);
    file_text[n] = '\0';
    list = strchr(file_text, '[');
    return list == NULL ? NULL : strchr(list, '{');
}

const char *vw_vectors_read_next(const char *object)
{
    const char *end = strchr(object, '}');
    return end == NULL ? NULL : strchr(end, '{');
}

void vw_vectors_expect(bool holds, const char *file, const char *object)
{
    if (!holds) {
        fprintf(stderr, "%s: %s: differs\n", file, vw_vectors_find_value(object, "name"));
        exit(1);
    }
}

static unsigned vw_vectors_check_frames(const char *folder)
{
    static uint8_t body[MAX_TEXT / 4u], wire[MAX_TEXT / 4u], out[VW_MAX_FRAME];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "frames.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        size_t body_length = vw_text_read_hex(vw_vectors_find_value(v, "body"), body);
        size_t wire_length = vw_text_read_hex(vw_vectors_find_value(v, "wire"), wire);
        size_t n = vw_frame_encode((uint8_t)vw_vectors_find_number(v, "type"),
                                   (uint8_t)vw_vectors_find_number(v, "sequence"),
                                   (uint32_t)vw_vectors_find_number(v, "uptime_ms"), body, body_length, out,
                                   sizeof out);
        vw_vectors_expect(n == wire_length && memcmp(out, wire, n) == 0, "frames.json", v);
        vw_text_run_decoder(VW_SIDE_HOST, false, 1u, wire, wire_length);
        vw_vectors_expect(strncmp(items.text, "frame:", 6u) == 0, "frames.json", v);
    }
    return count;
}

static unsigned vw_vectors_check_streams(const char *folder)
{
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "streams.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        size_t length = vw_text_read_hex(vw_vectors_find_value(v, "wire"), bytes);
        vw_side_t side = strcmp(vw_vectors_find_value(v, "side"), "host") == 0 ? VW_SIDE_HOST : VW_SIDE_MASTER;
        vw_text_run_decoder(side, vw_vectors_find_number(v, "idle") != 0u, 3u, bytes, length);
        vw_vectors_expect(strcmp(items.text, vw_vectors_find_value(v, "items")) == 0, "streams.json", v);
    }
    return count;
}

static unsigned vw_vectors_check_checksums(const char *folder)
{
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "checksums.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        size_t length = vw_text_read_hex(vw_vectors_find_value(v, "data"), bytes);
        unsigned long crc = strcmp(vw_vectors_find_value(v, "name"), "crc16") == 0 ? vw_crc16(bytes, length)
            : ~vw_crc32_update(VW_CRC32_START, bytes, length);
        vw_vectors_expect(crc == vw_vectors_find_number(v, "crc"), "checksums.json", v);
    }
    return count;
}

static void vw_vectors_check_request(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t expected[VW_MAX_BODY], body[VW_MAX_BODY];
    size_t data_length = vw_text_read_hex(vw_vectors_find_value(v, "data"), expected);
    vw_request_t request;
    uint16_t offset;
    vw_vectors_expect(vw_request_parse(frame, &request, &offset) == VW_RESULT_DONE
                      && request.offset == vw_vectors_find_number(v, "offset")
                      && request.command == vw_vectors_find_number(v, "command")
                      && request.argument == atol(vw_vectors_find_value(v, "argument"))
                      && (request.type != VW_MSG_READ || request.length == vw_vectors_find_number(v, "length"))
                      && (request.type != VW_MSG_WRITE || (request.length == data_length
                                                           && memcmp(request.data, expected, data_length) == 0)), file,
                      v);
    vw_vectors_expect(vw_request_body(body, &request) == frame->length
                      && memcmp(body, frame->body, frame->length) == 0, file, v);
}

static void vw_vectors_check_event(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t body[VW_MAX_BODY];
    vw_event_t event;
    vw_vectors_expect(vw_event_parse(frame, &event) && event.code == vw_vectors_find_number(v, "code")
                      && event.argument == vw_vectors_find_number(v, "argument")
                      && event.cell == vw_vectors_find_number(v, "cell")
                      && event.value == atol(vw_vectors_find_value(v, "value"))
                      && event.limit == atol(vw_vectors_find_value(v, "limit"))
                      && vw_event_body(body, &event) == frame->length
                      && memcmp(body, frame->body, frame->length) == 0, file, v);
}

static void vw_vectors_check_reply(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t expected[VW_MAX_BODY], data[VW_IDENT_SIZE];
    size_t length = vw_text_read_hex(vw_vectors_find_value(v, "data"), expected);
    char firmware[16];
    vw_reply_t reply;
    vw_ident_t ident;
    vw_vectors_expect(vw_reply_parse(frame, &reply) && reply.request_type == vw_vectors_find_number(v, "request_type")
                      && reply.request_sequence == vw_vectors_find_number(v, "request_sequence")
                      && reply.result == vw_vectors_find_number(v, "result") && reply.length == length
                      && memcmp(reply.data, expected, length) == 0, file, v);
    if (strcmp(vw_vectors_find_value(v, "kind"), "ident reply") != 0) {
        vw_vectors_expect(reply.offset == vw_vectors_find_number(v, "offset"), file, v);
        return;
    }
    vw_vectors_expect(vw_ident_parse(reply.data, reply.length, &ident)
                      && ident.protocol == vw_vectors_find_number(v, "protocol")
                      && ident.reset_cause == vw_vectors_find_number(v, "reset_cause")
                      && ident.boots == vw_vectors_find_number(v, "boots"), file, v);
    sprintf(firmware, "%u.%u.%u", ident.firmware[0], ident.firmware[1], ident.firmware[2]);
    vw_vectors_expect(strcmp(firmware, vw_vectors_find_value(v, "firmware")) == 0
                      && vw_text_read_hex(vw_vectors_find_value(v, "map_hash"), expected) == sizeof ident.map_hash
                      && memcmp(expected, ident.map_hash, sizeof ident.map_hash) == 0
                      && vw_ident_data(data, &ident) == reply.length
                      && memcmp(data, reply.data, reply.length) == 0, file, v);
}

/* The windows, and the numbers that they put into the struct. */
static void vw_vectors_check_data(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t master[VW_MASTER_SIZE], expected[VW_MAX_BODY];
    char *at;
    size_t position = 0;
    vw_window_t window;
    vw_vectors_expect(vw_data_is_valid(frame), file, v);
    memset(master, 0, sizeof master);
    for (at = strtok((char *)vw_vectors_find_value(v, "windows"), " "); at != NULL; at = strtok(NULL, " ")) {
        size_t length = vw_text_read_hex(strchr(at, ':') + 1, expected);
        vw_vectors_expect(vw_data_next(frame, &position, &window) && window.offset == strtoul(at, NULL, 10)
                          && window.length == length && memcmp(window.data, expected, length) == 0, file, v);
        memcpy(master + window.offset, window.data, window.length);
    }
    vw_vectors_expect(!vw_data_next(frame, &position, &window), file, v);
    for (at = strtok((char *)vw_vectors_find_value(v, "counts"), " "); at != NULL; at = strtok(NULL, " ")) {
        const uint8_t *byte = master + strtoul(at, &at, 10);
        unsigned long size = strtoul(at + 1, &at, 10);
        uint32_t count = (uint32_t)strtoll(at + 1, NULL, 10);
        unsigned long i;
        for (i = 0; i < size; i++) {
            vw_vectors_expect(byte[i] == (uint8_t)(count >> 8u * i), file, v);
        }
    }
}

void vw_vectors_check_message(const vw_frame_t *frame, const char *file, const char *v)
{
    const char *kind = vw_vectors_find_value(v, "kind");
    if (strcmp(kind, "event") == 0) {
        vw_vectors_check_event(frame, file, v);
    } else if (strcmp(kind, "data") == 0) {
        vw_vectors_check_data(frame, file, v);
    } else if (strcmp(kind, "reply") == 0 || strcmp(kind, "ident reply") == 0) {
        vw_vectors_check_reply(frame, file, v);
    } else {
        vw_vectors_check_request(frame, file, v);
    }
}

static unsigned vw_vectors_check_messages(const char *folder)
{
    static uint8_t body[MAX_TEXT / 2u];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "messages.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        vw_frame_t frame = { 0 };
        frame.type = (uint8_t)vw_vectors_find_number(v, "type");
        frame.length = (uint16_t)vw_text_read_hex(vw_vectors_find_value(v, "body"), body);
        frame.body = body;
        vw_vectors_check_message(&frame, "messages.json", v);
    }
    return count;
}

/* The defaults as the compiler lays them out are the default image: the struct is the wire's layout. */
static unsigned vw_vectors_check_config(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    const char *v = vw_vectors_read_first(folder, "config_image.json");
    const uint16_t probe = 1;
    if (v != NULL && *(const uint8_t *)&probe == 1u) {
        size_t length = vw_text_read_hex(vw_vectors_find_value(v, "image"), bytes);
        vw_vectors_expect(length == sizeof defaults && memcmp(bytes, &defaults, length) == 0, "config_image.json", v);
    }
    return 1;
}

static unsigned vw_vectors_check_slots(const char *folder)
{
    static uint8_t slot[VW_EEPROM_SLOT_SIZE], made[VW_EEPROM_SLOT_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "eeprom_slots.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        uint32_t counter;
        vw_text_read_hex(vw_vectors_find_value(v, "image"), bytes);
        vw_text_read_hex(vw_vectors_find_value(v, "slot"), slot);
        vw_slot_encode(made, bytes, (uint32_t)vw_vectors_find_number(v, "counter"));
        vw_vectors_expect(memcmp(made, slot, sizeof slot) == 0, "eeprom_slots.json", v);
        vw_vectors_expect(vw_slot_image(slot, &counter) != NULL
                          && counter == vw_vectors_find_number(v, "counter"), "eeprom_slots.json", v);
    }
    return count;
}

/* One message in either direction: its bytes and the bytes of the struct. */
static unsigned vw_vectors_check_can(const char *folder)
{
    static vw_master_t master, expected;
    static const vw_board_t board;
    const char *v;
    unsigned count = 0;
    for (v = vw_vectors_read_first(folder, "can_messages.json"); v != NULL; v = vw_vectors_read_next(v), count++) {
        bool is_tx = strcmp(vw_vectors_find_value(v, "direction"), "tx") == 0;
        vw_can_frame_t frame = { 0 };
        vw_can_t can;
        char *at = (char *)vw_vectors_find_value(v, "offsets");
        char *windows = (char *)vw_vectors_find_value(v, "struct");
        unsigned i;
        memset(&master, 0, sizeof master);
        memset(&expected, 0, sizeof expected);
        for (at = strtok(at, " "), i = 0; at != NULL && i < VW_CAN_DATA_BYTES; at = strtok(NULL, " "), i++) {
            uint16_t offset = (uint16_t)strtoul(at, NULL, 10);
            master.conf.can_tx_msg_data[0][i] = offset;
            master.conf.can_rx_msg_data[0][i] = offset;
        }
        for (at = strtok(windows, " "); at != NULL; at = strtok(NULL, " ")) {
            uint8_t *target = is_tx ? (uint8_t *)&master : (uint8_t *)&expected;
            (void)vw_text_read_hex(strchr(at, ':') + 1, target + strtoul(at, NULL, 10));
        }
        frame.length = (uint8_t)vw_text_read_hex(vw_vectors_find_value(v, "data"), frame.data);
        master.conf.can_tx_msg_len[0] = frame.length;
        master.conf.can_rx_msg_len[0] = frame.length;
        master.conf.can_rx_msg_en_startup = 1u;
        vw_can_init(&can, &board, &master);
        if (is_tx) {
            vw_can_frame_t sent;
            vw_can_send_once(&can, 0u);
            vw_vectors_expect(vw_can_next(&can, 0u, &sent) && sent.length == frame.length
                              && memcmp(sent.data, frame.data, sent.length) == 0, "can_messages.json", v);
        } else {
            vw_can_received(&can, 0u, &frame);
            vw_vectors_expect(memcmp(&master.charger, &expected.charger, sizeof master.charger) == 0
                              && can.rx_active == 1u, "can_messages.json", v);
        }
    }
    return count;
}

int vw_vectors_run(const char *folder)
{
    unsigned count = vw_vectors_check_frames(folder);
    count += vw_vectors_check_streams(folder);
    count += vw_vectors_check_checksums(folder);
    count += vw_vectors_check_messages(folder);
    count += vw_images_check_whole_frames(folder);
    count += vw_images_check_config_limits(folder);
    count += vw_images_check_eeprom(folder);
    count += vw_images_check_journal(folder);
    count += vw_images_check_can_frames(folder);
    count += vw_vectors_check_config(folder);
    count += vw_vectors_check_slots(folder);
    count += vw_vectors_check_can(folder);
    printf("%u vectors agree\n", count);
    return 0;
}
