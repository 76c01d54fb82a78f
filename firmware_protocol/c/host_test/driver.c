/* One answer for each line, so that another program can compare; the lines are those of main.c. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "text.h"
#include "vw_can.h"
#include "vw_config.h"
#include "vw_messages.h"
#include "vw_stream.h"

static void vw_driver_feed(char *words)
{
    char *side = strtok(words, " ");
    char *idle = strtok(NULL, " ");
    char *size = strtok(NULL, " ");
    char *wire = strtok(NULL, " \n");
    size_t length = vw_text_read_hex(wire, bytes);
    uint32_t dropped = vw_text_run_decoder(strcmp(side, "host") == 0 ? VW_SIDE_HOST : VW_SIDE_MASTER, *idle == '1',
                                           (size_t)strtoul(size, NULL, 10), bytes, length);
    printf("%s%sdropped:%lu\n", items.text, items.length != 0u ? " " : "", (unsigned long)dropped);
}

static void vw_driver_print_hex(const uint8_t *data, size_t length)
{
    vw_text_clear_items();
    vw_text_add_hex(data, length);
    printf("%s\n", items.text);
}

static void vw_driver_encode(char *words)
{
    static uint8_t out[VW_MAX_FRAME];
    unsigned long type = strtoul(strtok(words, " "), NULL, 10);
    unsigned long sequence = strtoul(strtok(NULL, " "), NULL, 10);
    unsigned long uptime_ms = strtoul(strtok(NULL, " "), NULL, 10);
    size_t length = vw_text_read_hex(strtok(NULL, " \n"), bytes);
    vw_driver_print_hex(out, vw_frame_encode((uint8_t)type, (uint8_t)sequence, (uint32_t)uptime_ms, bytes, length, out,
                                             sizeof out));
}

static vw_frame_t vw_driver_read_frame(char *words)
{
    vw_frame_t frame = { 0 };
    frame.type = (uint8_t)strtoul(strtok(words, " "), NULL, 10);
    frame.length = (uint16_t)vw_text_read_hex(strtok(NULL, " \n"), bytes);
    frame.body = bytes;
    return frame;
}

static void vw_driver_parse_request(char *words)
{
    static uint8_t body[VW_MAX_BODY];
    vw_frame_t frame = vw_driver_read_frame(words);
    vw_request_t request;
    uint16_t offset;
    enum vw_result result = vw_request_parse(&frame, &request, &offset);
    printf("%u %u ", (unsigned)result, (unsigned)offset);
    vw_driver_print_hex(body, result == VW_RESULT_DONE ? vw_request_body(body, &request) : 0u);
}

static void vw_driver_parse_message(char *words)
{
    static uint8_t body[VW_MAX_BODY];
    static uint8_t master[VW_MASTER_SIZE];
    vw_frame_t frame = vw_driver_read_frame(words);
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
    vw_driver_print_hex(body, length);
}

static void vw_driver_check_config(char *words)
{
    if (vw_text_read_hex(strtok(words, " \n"), bytes) == VW_CONFIG_SIZE) {
        printf("%u\n", (unsigned)vw_config_check(bytes));
    }
}

static void vw_driver_encode_slot(char *words)
{
    static uint8_t slot[VW_EEPROM_SLOT_SIZE];
    unsigned long counter = strtoul(strtok(words, " "), NULL, 10);
    if (vw_text_read_hex(strtok(NULL, " \n"), bytes) == VW_CONFIG_SIZE) {
        vw_slot_encode(slot, bytes, (uint32_t)counter);
        vw_driver_print_hex(slot, sizeof slot);
    }
}

static void vw_driver_find_newest_slot(char *words)
{
    static uint8_t slots[2][VW_EEPROM_SLOT_SIZE];
    uint32_t counter;
    const uint8_t *image;
    int newest;
    vw_text_read_hex(strtok(words, " "), slots[0]);
    vw_text_read_hex(strtok(NULL, " \n"), slots[1]);
    newest = vw_slot_newest(slots[0], slots[1]);
    if (newest < 0) {
        printf("-1\n");
        return;
    }
    image = vw_slot_image(slots[newest], &counter);
    memcpy(bytes, image, VW_CONFIG_SIZE);
    vw_slot_to_present(slots[newest], bytes);
    printf("%d %lu ", newest, (unsigned long)counter);
    vw_driver_print_hex(bytes, VW_CONFIG_SIZE);
}

/* A frame holds the line for as long as its bytes take, rounded up. */
static void vw_driver_run_stream(char *words)
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

static void vw_driver_step_can(vw_can_t *can, const char *step)
{
    char *end = NULL;
    unsigned long first = strtoul(step + 2, &end, 10);
    vw_can_frame_t frame = { 0 };
    uint8_t index;
    if (step[0] == 'n') {
        while (vw_can_next(can, (uint32_t)first, &frame)) {
            vw_text_clear_items();
            vw_text_add_hex(frame.data, frame.length);
            printf("%lu:%s ", (unsigned long)(frame.id | (frame.is_extended ? VW_CAN_ID_EXTENDED : 0u)), items.text);
        }
    } else if (step[0] == 'o') {
        vw_can_send_once(can, (uint8_t)first);
    } else if (step[0] == 'r') {
        unsigned long id = strtoul(end + 1, &end, 10);
        frame.id = (uint32_t)id & ~VW_CAN_ID_EXTENDED;
        frame.is_extended = ((uint32_t)id & VW_CAN_ID_EXTENDED) != 0u;
        frame.length = (uint8_t)vw_text_read_hex(end + 1, frame.data);
        vw_can_received(can, (uint32_t)first, &frame);
    } else {
        while ((index = vw_can_expire(can, (uint32_t)first)) < VW_N_CAN_MESSAGES) {
            printf("lost:%u ", (unsigned)index);
        }
        printf("charge:%u ", (unsigned)vw_can_take_charge(can));
    }
}

static void vw_driver_run_can(char *words)
{
    static const vw_board_t board;
    static vw_master_t master;
    char *step;
    vw_can_t can;
    size_t i;
    for (i = VW_CONFIG_SIZE; i < VW_MASTER_SIZE; i++) {
        ((uint8_t *)&master)[i] = (uint8_t)(7u * i);
    }
    (void)vw_text_read_hex(strtok(words, " "), (uint8_t *)&master);
    vw_can_init(&can, &board, &master);
    for (step = strtok(NULL, " \n"); step != NULL; step = strtok(NULL, " \n")) {
        vw_driver_step_can(&can, step);
    }
    printf("%u %u %u ", (unsigned)can.tx_enabled, (unsigned)can.rx_enabled, (unsigned)can.rx_active);
    vw_driver_print_hex((const uint8_t *)&master + 1884, VW_MASTER_SIZE - 1884u);
}

int vw_driver_run(void)
{
    static char line[MAX_TEXT];
    (void)setvbuf(stdout, NULL, _IOLBF, MAX_TEXT);
    while (fgets(line, sizeof line, stdin) != NULL) {
        if (strncmp(line, "feed ", 5u) == 0) {
            vw_driver_feed(line + 5);
        } else if (strncmp(line, "encode ", 7u) == 0) {
            vw_driver_encode(line + 7);
        } else if (strncmp(line, "request ", 8u) == 0) {
            vw_driver_parse_request(line + 8);
        } else if (strncmp(line, "message ", 8u) == 0) {
            vw_driver_parse_message(line + 8);
        } else if (strncmp(line, "check ", 6u) == 0) {
            vw_driver_check_config(line + 6);
        } else if (strncmp(line, "slot ", 5u) == 0) {
            vw_driver_encode_slot(line + 5);
        } else if (strncmp(line, "newest ", 7u) == 0) {
            vw_driver_find_newest_slot(line + 7);
        } else if (strncmp(line, "can ", 4u) == 0) {
            vw_driver_run_can(line + 4);
        } else if (strncmp(line, "stream ", 7u) == 0) {
            vw_driver_run_stream(line + 7);
        } else {
            fprintf(stderr, "unknown: %s", line);
            return 2;
        }
    }
    return 0;
}
