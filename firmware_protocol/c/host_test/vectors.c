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

const char *value_of(const char *object, const char *key)
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

unsigned long number_of(const char *object, const char *key)
{
    return strtoul(value_of(object, key), NULL, 10);
}

const char *first_vector(const char *folder, const char *name)
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

const char *next_vector(const char *object)
{
    const char *end = strchr(object, '}');
    return end == NULL ? NULL : strchr(end, '{');
}

void expect(bool holds, const char *file, const char *object)
{
    if (!holds) {
        fprintf(stderr, "%s: %s: differs\n", file, value_of(object, "name"));
        exit(1);
    }
}

static unsigned check_frames(const char *folder)
{
    static uint8_t body[MAX_TEXT / 4u], wire[MAX_TEXT / 4u], out[VW_MAX_FRAME];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "frames.json"); v != NULL; v = next_vector(v), count++) {
        size_t body_length = from_hex(value_of(v, "body"), body);
        size_t wire_length = from_hex(value_of(v, "wire"), wire);
        size_t n = vw_frame_encode((uint8_t)number_of(v, "type"), (uint8_t)number_of(v, "sequence"),
                                   (uint32_t)number_of(v, "uptime_ms"), body, body_length, out, sizeof out);
        expect(n == wire_length && memcmp(out, wire, n) == 0, "frames.json", v);
        run_decoder(VW_SIDE_HOST, false, 1u, wire, wire_length);
        expect(strncmp(items.text, "frame:", 6u) == 0, "frames.json", v);
    }
    return count;
}

static unsigned check_streams(const char *folder)
{
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "streams.json"); v != NULL; v = next_vector(v), count++) {
        size_t length = from_hex(value_of(v, "wire"), bytes);
        vw_side_t side = strcmp(value_of(v, "side"), "host") == 0 ? VW_SIDE_HOST : VW_SIDE_MASTER;
        run_decoder(side, number_of(v, "idle") != 0u, 3u, bytes, length);
        expect(strcmp(items.text, value_of(v, "items")) == 0, "streams.json", v);
    }
    return count;
}

static unsigned check_checksums(const char *folder)
{
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "checksums.json"); v != NULL; v = next_vector(v), count++) {
        size_t length = from_hex(value_of(v, "data"), bytes);
        unsigned long crc = strcmp(value_of(v, "name"), "crc16") == 0 ? vw_crc16(bytes, length)
                                                                       : ~vw_crc32_update(VW_CRC32_START, bytes, length);
        expect(crc == number_of(v, "crc"), "checksums.json", v);
    }
    return count;
}

static void check_request(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t expected[VW_MAX_BODY], body[VW_MAX_BODY];
    size_t data_length = from_hex(value_of(v, "data"), expected);
    vw_request_t request;
    uint16_t offset;
    expect(vw_request_parse(frame, &request, &offset) == VW_RESULT_DONE && request.offset == number_of(v, "offset")
               && request.command == number_of(v, "command") && request.argument == atol(value_of(v, "argument"))
               && (request.type != VW_MSG_READ || request.length == number_of(v, "length"))
               && (request.type != VW_MSG_WRITE
                   || (request.length == data_length && memcmp(request.data, expected, data_length) == 0)),
           file, v);
    expect(vw_request_body(body, &request) == frame->length && memcmp(body, frame->body, frame->length) == 0, file, v);
}

static void check_event(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t body[VW_MAX_BODY];
    vw_event_t event;
    expect(vw_event_parse(frame, &event) && event.code == number_of(v, "code")
               && event.argument == number_of(v, "argument") && event.cell == number_of(v, "cell")
               && event.value == atol(value_of(v, "value")) && event.limit == atol(value_of(v, "limit"))
               && vw_event_body(body, &event) == frame->length && memcmp(body, frame->body, frame->length) == 0,
           file, v);
}

static void check_reply(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t expected[VW_MAX_BODY], data[VW_IDENT_SIZE];
    size_t length = from_hex(value_of(v, "data"), expected);
    char firmware[16];
    vw_reply_t reply;
    vw_ident_t ident;
    expect(vw_reply_parse(frame, &reply) && reply.request_type == number_of(v, "request_type")
               && reply.request_sequence == number_of(v, "request_sequence") && reply.result == number_of(v, "result")
               && reply.length == length && memcmp(reply.data, expected, length) == 0,
           file, v);
    if (strcmp(value_of(v, "kind"), "ident reply") != 0) {
        expect(reply.offset == number_of(v, "offset"), file, v);
        return;
    }
    expect(vw_ident_parse(reply.data, reply.length, &ident) && ident.protocol == number_of(v, "protocol")
               && ident.reset_cause == number_of(v, "reset_cause") && ident.boots == number_of(v, "boots"),
           file, v);
    sprintf(firmware, "%u.%u.%u", ident.firmware[0], ident.firmware[1], ident.firmware[2]);
    expect(strcmp(firmware, value_of(v, "firmware")) == 0
               && from_hex(value_of(v, "map_hash"), expected) == sizeof ident.map_hash
               && memcmp(expected, ident.map_hash, sizeof ident.map_hash) == 0
               && vw_ident_data(data, &ident) == reply.length && memcmp(data, reply.data, reply.length) == 0,
           file, v);
}

/* The windows, and the numbers that they put into the struct. */
static void check_data(const vw_frame_t *frame, const char *file, const char *v)
{
    static uint8_t master[VW_MASTER_SIZE], expected[VW_MAX_BODY];
    char *at;
    size_t position = 0;
    vw_window_t window;
    expect(vw_data_is_valid(frame), file, v);
    memset(master, 0, sizeof master);
    for (at = strtok((char *)value_of(v, "windows"), " "); at != NULL; at = strtok(NULL, " ")) {
        size_t length = from_hex(strchr(at, ':') + 1, expected);
        expect(vw_data_next(frame, &position, &window) && window.offset == strtoul(at, NULL, 10)
                   && window.length == length && memcmp(window.data, expected, length) == 0,
               file, v);
        memcpy(master + window.offset, window.data, window.length);
    }
    expect(!vw_data_next(frame, &position, &window), file, v);
    for (at = strtok((char *)value_of(v, "counts"), " "); at != NULL; at = strtok(NULL, " ")) {
        const uint8_t *byte = master + strtoul(at, &at, 10);
        unsigned long size = strtoul(at + 1, &at, 10);
        uint32_t count = (uint32_t)strtoll(at + 1, NULL, 10);
        unsigned long i;
        for (i = 0; i < size; i++) {
            expect(byte[i] == (uint8_t)(count >> 8u * i), file, v);
        }
    }
}

void check_message(const vw_frame_t *frame, const char *file, const char *v)
{
    const char *kind = value_of(v, "kind");
    if (strcmp(kind, "event") == 0) {
        check_event(frame, file, v);
    } else if (strcmp(kind, "data") == 0) {
        check_data(frame, file, v);
    } else if (strcmp(kind, "reply") == 0 || strcmp(kind, "ident reply") == 0) {
        check_reply(frame, file, v);
    } else {
        check_request(frame, file, v);
    }
}

static unsigned check_messages(const char *folder)
{
    static uint8_t body[MAX_TEXT / 2u];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "messages.json"); v != NULL; v = next_vector(v), count++) {
        vw_frame_t frame = { 0 };
        frame.type = (uint8_t)number_of(v, "type");
        frame.length = (uint16_t)from_hex(value_of(v, "body"), body);
        frame.body = body;
        check_message(&frame, "messages.json", v);
    }
    return count;
}

/* The defaults as the compiler lays them out are the default image: the struct is the wire's layout. */
static unsigned check_config(const char *folder)
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    const char *v = first_vector(folder, "config_image.json");
    const uint16_t probe = 1;
    if (v != NULL && *(const uint8_t *)&probe == 1u) {
        size_t length = from_hex(value_of(v, "image"), bytes);
        expect(length == sizeof defaults && memcmp(bytes, &defaults, length) == 0, "config_image.json", v);
    }
    return 1;
}

static unsigned check_slots(const char *folder)
{
    static uint8_t slot[VW_EEPROM_SLOT_SIZE], made[VW_EEPROM_SLOT_SIZE];
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "eeprom_slots.json"); v != NULL; v = next_vector(v), count++) {
        uint32_t counter;
        from_hex(value_of(v, "image"), bytes);
        from_hex(value_of(v, "slot"), slot);
        vw_slot_encode(made, bytes, (uint32_t)number_of(v, "counter"));
        expect(memcmp(made, slot, sizeof slot) == 0, "eeprom_slots.json", v);
        expect(vw_slot_image(slot, &counter) != NULL && counter == number_of(v, "counter"), "eeprom_slots.json", v);
    }
    return count;
}

/* One message in either direction: its bytes and the bytes of the struct. */
static unsigned check_can(const char *folder)
{
    static vw_master_t master, expected;
    static const vw_board_t board;
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "can_messages.json"); v != NULL; v = next_vector(v), count++) {
        bool is_tx = strcmp(value_of(v, "direction"), "tx") == 0;
        vw_can_frame_t frame = { 0 };
        vw_can_t can;
        char *at = (char *)value_of(v, "offsets");
        char *windows = (char *)value_of(v, "struct");
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
            (void)from_hex(strchr(at, ':') + 1, target + strtoul(at, NULL, 10));
        }
        frame.length = (uint8_t)from_hex(value_of(v, "data"), frame.data);
        master.conf.can_tx_msg_len[0] = frame.length;
        master.conf.can_rx_msg_len[0] = frame.length;
        master.conf.can_rx_msg_en_startup = 1u;
        vw_can_init(&can, &board, &master);
        if (is_tx) {
            vw_can_frame_t sent;
            vw_can_send_once(&can, 0u);
            expect(vw_can_next(&can, 0u, &sent) && sent.length == frame.length
                       && memcmp(sent.data, frame.data, sent.length) == 0,
                   "can_messages.json", v);
        } else {
            vw_can_received(&can, 0u, &frame);
            expect(memcmp(&master.charger, &expected.charger, sizeof master.charger) == 0 && can.rx_active == 1u,
                   "can_messages.json", v);
        }
    }
    return count;
}

int run_vectors(const char *folder)
{
    unsigned count = check_frames(folder);
    count += check_streams(folder);
    count += check_checksums(folder);
    count += check_messages(folder);
    count += check_whole_frames(folder);
    count += check_config_limits(folder);
    count += check_eeprom_images(folder);
    count += check_journal(folder);
    count += check_can_frames(folder);
    count += check_config(folder);
    count += check_slots(folder);
    count += check_can(folder);
    printf("%u vectors agree\n", count);
    return 0;
}
