/* Runs the reference codec on a PC.
 *
 *   host_test vectors FOLDER   checks the codec against the shared vectors; exit status 1 on the first difference
 *   host_test driver           answers one line on stdout for each line on stdin, so that another program can compare:
 *     feed SIDE IDLE SIZE WIRE       items of the decoder fed in pieces of SIZE bytes, then "dropped:N"
 *     encode TYPE SEQUENCE UPTIME BODY                the frame in hex
 *     request TYPE BODY              result and offset; when done the body built again from what was parsed
 *     message TYPE BODY              "valid" and the body built again from what was parsed, or "invalid"
 *     check IMAGE                    offset of the first refused element of a configuration, 65535 for none
 *     slot COUNTER IMAGE             the EEPROM slot
 *     newest SLOT SLOT               index, counter and image of the newest valid slot, or -1
 *     stream TS N                    N frames of the stream on a free line, each "ms:offset+length[,offset+length...]"
 *     can IMAGE STEP...              CAN over a struct whose bytes behind the configuration are 7 times their offset; steps:
 *                                    n:MS send what is due, o:INDEX on demand, r:MS:ID:DATA receive, x:MS time-outs.
 *                                    Answers "id:data" and "lost:index", at the end the three masks
 * Numbers are decimal, bytes hex, no bytes "-".
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "vw_can.h"
#include "vw_codec.h"
#include "vw_config.h"
#include "vw_messages.h"
#include "vw_stream.h"

#define MAX_TEXT 65536u

typedef struct {
    char text[4u * MAX_TEXT];
    size_t length;
} items_t;

static items_t items;
static char file_text[MAX_TEXT];
static uint8_t bytes[MAX_TEXT / 2u];

static size_t from_hex(const char *hex, uint8_t *out)
{
    size_t n = 0;
    unsigned value;
    while (hex[0] != '-' && hex[0] != '\0' && hex[0] != '\n' && sscanf(hex, "%2x", &value) == 1) {
        out[n++] = (uint8_t)value;
        hex += 2;
    }
    return n;
}

static void add_text(const char *text)
{
    size_t n = strlen(text);
    if (items.length + n + 1u < sizeof items.text) {
        memcpy(items.text + items.length, text, n + 1u);
        items.length += n;
    }
}

static void add_hex(const uint8_t *data, size_t length)
{
    char pair[3];
    size_t i;
    if (length == 0u) {
        add_text("-");
    }
    for (i = 0; i < length; i++) {
        sprintf(pair, "%02x", data[i]);
        add_text(pair);
    }
}

static void on_item(void *context, vw_item_t item, const vw_frame_t *frame)
{
    static const char *const names[] = { "", "bad:cobs", "bad:short", "bad:long", "bad:crc", "start", "stop" };
    char head[40];
    (void)context;
    if (items.length != 0u) {
        add_text(" ");
    }
    if (item == VW_ITEM_FRAME) {
        sprintf(head, "frame:%02x:%02x:%08lx:", frame->type, frame->sequence, (unsigned long)frame->uptime_ms);
        add_text(head);
        add_hex(frame->body, frame->length);
    } else {
        add_text(names[item]);
    }
}

static uint32_t run_decoder(vw_side_t side, bool idle, size_t size, const uint8_t *wire, size_t length)
{
    static vw_decoder_t decoder;
    size_t at;
    items.length = 0;
    items.text[0] = '\0';
    vw_decoder_init(&decoder, side, on_item, NULL);
    for (at = 0; at < length; at += size) {
        vw_decoder_feed(&decoder, wire + at, length - at < size ? length - at : size);
    }
    if (idle) {
        vw_decoder_idle(&decoder);
    }
    return decoder.dropped_bytes;
}

/* -- vectors ------------------------------------------------------------------------------------------------------- */

/* The value of "key" in the flat object that begins at `object`, as text without quotes; "" where it is not there. */
static const char *value_of(const char *object, const char *key)
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

static unsigned long number_of(const char *object, const char *key)
{
    return strtoul(value_of(object, key), NULL, 10);
}

static const char *first_vector(const char *folder, const char *name)
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

static const char *next_vector(const char *object)
{
    const char *end = strchr(object, '}');
    return end == NULL ? NULL : strchr(end, '{');
}

static void expect(bool holds, const char *file, const char *object)
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

static unsigned check_messages(const char *folder)
{
    const char *v;
    unsigned count = 0;
    for (v = first_vector(folder, "messages.json"); v != NULL; v = next_vector(v), count++) {
        const char *kind = value_of(v, "kind");
        vw_frame_t frame = { 0 };
        frame.type = (uint8_t)number_of(v, "type");
        frame.length = (uint16_t)from_hex(value_of(v, "body"), bytes);
        frame.body = bytes;
        if (strcmp(kind, "event") == 0) {
            vw_event_t event;
            expect(vw_event_parse(&frame, &event) && event.code == number_of(v, "code")
                       && event.cell == number_of(v, "cell") && event.value == atol(value_of(v, "value"))
                       && event.limit == atol(value_of(v, "limit")),
                   "messages.json", v);
        } else if (strcmp(kind, "reply") == 0) {
            vw_reply_t reply;
            expect(vw_reply_parse(&frame, &reply) && reply.request_type == number_of(v, "request_type")
                       && reply.request_sequence == number_of(v, "request_sequence")
                       && reply.result == number_of(v, "result") && reply.offset == number_of(v, "offset")
                       && reply.length == strlen(value_of(v, "data")) / 2u,
                   "messages.json", v);
        } else if (strcmp(kind, "data") == 0) {
            expect(vw_data_is_valid(&frame), "messages.json", v);
        } else {
            vw_request_t request;
            uint16_t offset;
            expect(vw_request_parse(&frame, &request, &offset) == VW_RESULT_DONE
                       && request.offset == number_of(v, "offset") && request.command == number_of(v, "command")
                       && request.argument == atol(value_of(v, "argument")),
                   "messages.json", v);
        }
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

static int run_vectors(const char *folder)
{
    unsigned count = check_frames(folder);
    count += check_streams(folder);
    count += check_checksums(folder);
    count += check_messages(folder);
    count += check_config(folder);
    count += check_slots(folder);
    count += check_can(folder);
    printf("%u vectors agree\n", count);
    return 0;
}

/* -- driver -------------------------------------------------------------------------------------------------------- */

static void drive_feed(char *words)
{
    char *side = strtok(words, " ");
    char *idle = strtok(NULL, " ");
    char *size = strtok(NULL, " ");
    char *wire = strtok(NULL, " \n");
    size_t length = from_hex(wire, bytes);
    uint32_t dropped = run_decoder(strcmp(side, "host") == 0 ? VW_SIDE_HOST : VW_SIDE_MASTER, *idle == '1',
                                   (size_t)strtoul(size, NULL, 10), bytes, length);
    printf("%s%sdropped:%lu\n", items.text, items.length != 0u ? " " : "", (unsigned long)dropped);
}

static void print_hex(const uint8_t *data, size_t length)
{
    items.length = 0;
    items.text[0] = '\0';
    add_hex(data, length);
    printf("%s\n", items.text);
}

static void drive_encode(char *words)
{
    static uint8_t out[VW_MAX_FRAME];
    unsigned long type = strtoul(strtok(words, " "), NULL, 10);
    unsigned long sequence = strtoul(strtok(NULL, " "), NULL, 10);
    unsigned long uptime_ms = strtoul(strtok(NULL, " "), NULL, 10);
    size_t length = from_hex(strtok(NULL, " \n"), bytes);
    print_hex(out, vw_frame_encode((uint8_t)type, (uint8_t)sequence, (uint32_t)uptime_ms, bytes, length, out,
                                   sizeof out));
}

static vw_frame_t frame_of(char *words)
{
    vw_frame_t frame = { 0 };
    frame.type = (uint8_t)strtoul(strtok(words, " "), NULL, 10);
    frame.length = (uint16_t)from_hex(strtok(NULL, " \n"), bytes);
    frame.body = bytes;
    return frame;
}

static void drive_request(char *words)
{
    static uint8_t body[VW_MAX_BODY];
    vw_frame_t frame = frame_of(words);
    vw_request_t request;
    uint16_t offset;
    enum vw_result result = vw_request_parse(&frame, &request, &offset);
    printf("%u %u ", (unsigned)result, (unsigned)offset);
    print_hex(body, result == VW_RESULT_DONE ? vw_request_body(body, &request) : 0u);
}

static void drive_message(char *words)
{
    static uint8_t body[VW_MAX_BODY];
    static uint8_t master[VW_MASTER_SIZE];
    vw_frame_t frame = frame_of(words);
    vw_frame_t request = { 0 };
    vw_reply_t reply;
    vw_event_t event;
    vw_window_t window;
    size_t position = 0, length = 0;
    bool is_valid = false;
    if (vw_event_parse(&frame, &event)) {
        is_valid = true;
        length = vw_event_body(body, &event);
    } else if (vw_reply_parse(&frame, &reply)) {
        is_valid = true;
        request.type = reply.request_type;
        request.sequence = reply.request_sequence;
        length = vw_reply_body(body, &request, reply.result, reply.offset, reply.data, reply.length);
    } else if (vw_data_is_valid(&frame)) {
        is_valid = true;
        while (vw_data_next(&frame, &position, &window)) {
            memcpy(master + window.offset, window.data, window.length);
            length = vw_data_append(body, length, master, window.offset, window.length);
        }
    }
    if (!is_valid) {
        printf("invalid\n");
        return;
    }
    printf("valid ");
    print_hex(body, length);
}

static void drive_check(char *words)
{
    if (from_hex(strtok(words, " \n"), bytes) == VW_CONFIG_SIZE) {
        printf("%u\n", (unsigned)vw_config_check(bytes));
    }
}

static void drive_slot(char *words)
{
    static uint8_t slot[VW_EEPROM_SLOT_SIZE];
    unsigned long counter = strtoul(strtok(words, " "), NULL, 10);
    if (from_hex(strtok(NULL, " \n"), bytes) == VW_CONFIG_SIZE) {
        vw_slot_encode(slot, bytes, (uint32_t)counter);
        print_hex(slot, sizeof slot);
    }
}

static void drive_newest(char *words)
{
    static uint8_t slots[2][VW_EEPROM_SLOT_SIZE];
    uint32_t counter;
    const uint8_t *image;
    int newest;
    from_hex(strtok(words, " "), slots[0]);
    from_hex(strtok(NULL, " \n"), slots[1]);
    newest = vw_slot_newest(slots[0], slots[1]);
    if (newest < 0) {
        printf("-1\n");
        return;
    }
    image = vw_slot_image(slots[newest], &counter);
    printf("%d %lu ", newest, (unsigned long)counter);
    print_hex(image, VW_CONFIG_SIZE);
}

/* A frame holds the line for as long as its bytes take, rounded up. */
static void drive_stream(char *words)
{
    vw_stream_t stream;
    vw_span_t spans[VW_STREAM_MAX_SPANS];
    unsigned long ts = strtoul(strtok(words, " "), NULL, 10);
    unsigned long n = strtoul(strtok(NULL, " \n"), NULL, 10);
    uint32_t now_ms = 0u;
    vw_stream_start(&stream, (uint16_t)ts, now_ms);
    while (n != 0u) {
        uint8_t count = vw_stream_take(&stream, now_ms, spans);
        uint32_t length = 12u;
        uint8_t i;
        if (count == 0u) {
            now_ms++;
            continue;
        }
        printf("%lu:", (unsigned long)now_ms);
        for (i = 0; i < count; i++) {
            printf("%s%u+%u", i != 0u ? "," : "", (unsigned)spans[i].offset, (unsigned)spans[i].length);
            length += 4u + spans[i].length;
        }
        printf(" ");
        now_ms += length * VW_BITS_PER_BYTE * 1000u / VW_BAUD_RATE + 1u;
        n--;
    }
    printf("\n");
}

static void drive_can_step(vw_can_t *can, const char *step)
{
    char *end = NULL;
    unsigned long first = strtoul(step + 2, &end, 10);
    vw_can_frame_t frame = { 0 };
    uint8_t index;
    if (step[0] == 'n') {
        while (vw_can_next(can, (uint32_t)first, &frame)) {
            items.length = 0;
            items.text[0] = '\0';
            add_hex(frame.data, frame.length);
            printf("%lu:%s ", (unsigned long)(frame.id | (frame.is_extended ? VW_CAN_ID_EXTENDED : 0u)), items.text);
        }
    } else if (step[0] == 'o') {
        vw_can_send_once(can, (uint8_t)first);
    } else if (step[0] == 'r') {
        unsigned long id = strtoul(end + 1, &end, 10);
        frame.id = (uint32_t)id & ~VW_CAN_ID_EXTENDED;
        frame.is_extended = ((uint32_t)id & VW_CAN_ID_EXTENDED) != 0u;
        frame.length = (uint8_t)from_hex(end + 1, frame.data);
        vw_can_received(can, (uint32_t)first, &frame);
    } else {
        while ((index = vw_can_expire(can, (uint32_t)first)) < VW_N_CAN_MESSAGES) {
            printf("lost:%u ", (unsigned)index);
        }
    }
}

static void drive_can(char *words)
{
    static const vw_board_t board;
    static vw_master_t master;
    char *step;
    vw_can_t can;
    size_t i;
    for (i = VW_CONFIG_SIZE; i < VW_MASTER_SIZE; i++) {
        ((uint8_t *)&master)[i] = (uint8_t)(7u * i);
    }
    (void)from_hex(strtok(words, " "), (uint8_t *)&master);
    vw_can_init(&can, &board, &master);
    for (step = strtok(NULL, " \n"); step != NULL; step = strtok(NULL, " \n")) {
        drive_can_step(&can, step);
    }
    printf("%u %u %u ", (unsigned)can.tx_enabled, (unsigned)can.rx_enabled, (unsigned)can.rx_active);
    print_hex((const uint8_t *)&master + 1884, VW_MASTER_SIZE - 1884u);
}

static int run_driver(void)
{
    static char line[MAX_TEXT];
    (void)setvbuf(stdout, NULL, _IOLBF, MAX_TEXT);
    while (fgets(line, sizeof line, stdin) != NULL) {
        if (strncmp(line, "feed ", 5u) == 0) {
            drive_feed(line + 5);
        } else if (strncmp(line, "encode ", 7u) == 0) {
            drive_encode(line + 7);
        } else if (strncmp(line, "request ", 8u) == 0) {
            drive_request(line + 8);
        } else if (strncmp(line, "message ", 8u) == 0) {
            drive_message(line + 8);
        } else if (strncmp(line, "check ", 6u) == 0) {
            drive_check(line + 6);
        } else if (strncmp(line, "slot ", 5u) == 0) {
            drive_slot(line + 5);
        } else if (strncmp(line, "newest ", 7u) == 0) {
            drive_newest(line + 7);
        } else if (strncmp(line, "can ", 4u) == 0) {
            drive_can(line + 4);
        } else if (strncmp(line, "stream ", 7u) == 0) {
            drive_stream(line + 7);
        } else {
            fprintf(stderr, "unknown: %s", line);
            return 2;
        }
    }
    return 0;
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "vectors") == 0) {
        return run_vectors(argv[2]);
    }
    if (argc == 2 && strcmp(argv[1], "driver") == 0) {
        return run_driver();
    }
    fprintf(stderr, "usage: host_test vectors FOLDER | host_test driver\n");
    return 2;
}
