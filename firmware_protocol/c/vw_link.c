#include "vw_link.h"

#include <string.h>

#include "vw_bytes.h"
#include "vw_config.h"
#include "vw_time.h"

#define NO_CELL 0xFFFFu
#define BOOT_POLLS 2000u /* of 25 us at 400 kHz: longer than the 10 ms of the slowest page */
#define EEPROM_ADDRESS(offset) ((uint16_t)((offset) - VW_EEPROM_READ_BASE))

static const vw_config_t default_config = VW_CONFIG_DEFAULTS;

static void lock(const vw_link_t *link)
{
    if (link->board->lock != NULL) {
        link->board->lock(link->board->context);
    }
}

static void unlock(const vw_link_t *link)
{
    if (link->board->unlock != NULL) {
        link->board->unlock(link->board->context);
    }
}

static void drop_event(vw_link_t *link)
{
    link->first_event = (uint8_t)((link->first_event + 1u) % VW_MAX_EVENTS);
    link->n_events--;
    if (link->events_ahead != 0u) {
        link->events_ahead--;
    }
}

void vw_link_event(vw_link_t *link, uint8_t code, uint16_t cell, int32_t value, int32_t limit)
{
    vw_event_t *event;
    if (link->n_events == VW_MAX_EVENTS) {
        drop_event(link);
    }
    event = &link->events[(link->first_event + link->n_events) % VW_MAX_EVENTS];
    link->n_events++;
    event->code = code;
    event->argument = 0u;
    event->cell = cell;
    event->value = value;
    event->limit = limit;
}

/* -- configuration ------------------------------------------------------------------------------------------------- */

/* Put an image that passes the check in force, in one step; the padding is 0. */
static enum vw_result use_config(vw_link_t *link, uint8_t image[VW_CONFIG_SIZE], uint16_t *offset)
{
    vw_config_clear_padding(image);
    *offset = vw_config_check(image);
    if (*offset != VW_NO_OFFSET) {
        return VW_RESULT_OUT_OF_RANGE;
    }
    lock(link);
    (void)memcpy(&link->master->conf, image, VW_CONFIG_SIZE);
    unlock(link);
    link->stream.ts_ms = link->master->conf.ts;
    if (link->can != NULL) {
        vw_can_reload(link->can);
    }
    if (link->board->config_changed != NULL) {
        link->board->config_changed(link->board->context);
    }
    return VW_RESULT_DONE;
}

static bool may_configure(const vw_link_t *link)
{
    return link->board->may_configure == NULL || link->board->may_configure(link->board->context);
}

static enum vw_result write_config(vw_link_t *link, const vw_request_t *request, uint16_t *offset)
{
    enum vw_result result;
    uint8_t *image = link->body; /* free outside vw_link_next */
    (void)memcpy(image, &link->master->conf, VW_CONFIG_SIZE);
    (void)memcpy(image + request->offset, request->data, request->length);
    if (!vw_config_is_live((const uint8_t *)&link->master->conf, image) && !may_configure(link)) {
        return VW_RESULT_NOT_NOW;
    }
    result = use_config(link, image, offset);
    if (result == VW_RESULT_DONE) {
        vw_link_event(link, VW_EVENT_CONFIG_WRITTEN, NO_CELL, request->offset, request->length);
    }
    return result;
}

static enum vw_result load_config(vw_link_t *link, uint16_t *offset)
{
    enum vw_result result;
    if (!may_configure(link)) {
        return VW_RESULT_NOT_NOW;
    }
    result = vw_store_read(&link->store, false);
    if (result == VW_RESULT_DONE) {
        result = use_config(link, link->store.image, offset);
    }
    if (result == VW_RESULT_DONE) {
        vw_link_event(link, VW_EVENT_CONFIG_WRITTEN, NO_CELL, 0, (int32_t)VW_CONFIG_SIZE);
    }
    return result;
}

static enum vw_result begin_store(vw_link_t *link)
{
    enum vw_result result = VW_RESULT_NOT_NOW;
    if (may_configure(link)) {
        (void)memcpy(link->body, &link->master->conf, VW_CONFIG_SIZE);
        result = vw_store_begin(&link->store, link->body, link->now_ms);
    }
    return result;
}

/* -- commands ------------------------------------------------------------------------------------------------------ */

static enum vw_result call(const vw_link_t *link, enum vw_result (*function)(void *context, int32_t argument),
                           int32_t argument)
{
    return function == NULL ? VW_RESULT_UNKNOWN_REQUEST : function(link->board->context, argument);
}

typedef struct {
    uint8_t code;
    int32_t low;
    int32_t high;
} argument_rule_t;

#define ARGUMENT_RULE(name, code, low, high) { (uint8_t)(code), low, high },
static const argument_rule_t argument_rules[] = { VW_COMMANDS(ARGUMENT_RULE) };

static bool is_argument_good(uint8_t code, int32_t argument)
{
    size_t i = 0u;
    while (i < sizeof argument_rules / sizeof argument_rules[0] && argument_rules[i].code != code) {
        i++;
    }
    return i == sizeof argument_rules / sizeof argument_rules[0]
           || (argument >= argument_rules[i].low && argument <= argument_rules[i].high);
}

#define COMMAND_CASE(name, code, low, high) \
    case code: \
        return call(link, link->board->commands.name, argument);

static enum vw_result call_by_code(const vw_link_t *link, uint8_t code, int32_t argument)
{
    switch (code) {
        VW_COMMANDS(COMMAND_CASE)
    default:
        return VW_RESULT_UNKNOWN_REQUEST;
    }
}

static enum vw_result do_command(vw_link_t *link, const vw_request_t *request)
{
    enum vw_result result = VW_RESULT_OUT_OF_RANGE;
    if (is_argument_good(request->command, request->argument)) {
        result = call_by_code(link, request->command, request->argument);
    }
    if (result == VW_RESULT_DONE && request->command == (uint8_t)VW_COMMAND_RESET) {
        link->restart_asked = true;
    }
    return result;
}

/* -- requests ------------------------------------------------------------------------------------------------------ */

static bool is_changing(uint8_t type)
{
    return type == VW_MSG_WRITE || type == VW_MSG_STORE || type == VW_MSG_LOAD || type == VW_MSG_COMMAND;
}

static void put_reply(vw_link_t *link, uint8_t type, uint8_t sequence, enum vw_result result, uint16_t offset,
                      size_t data_length)
{
    /* `data` of a READ or IDENT stands in `reply` already, behind the header. */
    link->reply[0] = type;
    link->reply[1] = sequence;
    link->reply[2] = (uint8_t)result;
    vw_put_u16(&link->reply[3], offset);
    link->reply_length = (uint16_t)(VW_REPLY_HEADER_SIZE + data_length);
    link->has_reply = true;
    link->events_ahead = link->n_events;
}

static uint32_t body_crc(const vw_frame_t *frame)
{
    return vw_crc32_update(VW_CRC32_START, frame->body, frame->length);
}

static bool is_repeated(const vw_link_t *link, const vw_frame_t *frame)
{
    const vw_done_t *last = &link->last;
    return link->has_last && !vw_is_due(link->now_ms, last->at_ms + VW_REPEAT_WINDOW_MS) && frame->type == last->type
           && frame->sequence == last->sequence && frame->length == last->length && body_crc(frame) == last->crc;
}

static bool is_store_under_way(const vw_link_t *link, const vw_frame_t *frame)
{
    return vw_store_is_busy(&link->store) && frame->type == VW_MSG_STORE && frame->length == 0u
           && frame->sequence == link->store_sequence;
}

/* Reply, and remember how the request ended. */
static void finish(vw_link_t *link, const vw_frame_t *frame, enum vw_result result, uint16_t offset)
{
    link->has_last = true;
    link->last.type = frame->type;
    link->last.sequence = frame->sequence;
    link->last.length = frame->length;
    link->last.crc = body_crc(frame);
    link->last.at_ms = link->now_ms;
    link->last.result = result;
    link->last.offset = offset;
    put_reply(link, frame->type, frame->sequence, result, offset, 0u);
}

static enum vw_result read_bytes(vw_link_t *link, const vw_request_t *request)
{
    uint8_t *out = link->reply + VW_REPLY_HEADER_SIZE;
    const vw_board_t *board = link->board;
    if (request->offset < VW_EEPROM_READ_BASE) {
        lock(link);
        (void)memcpy(out, (const uint8_t *)link->master + request->offset, request->length);
        unlock(link);
        return VW_RESULT_DONE;
    }
    if (vw_store_is_busy(&link->store) || board->eeprom_is_busy(board->context)) {
        return VW_RESULT_NOT_NOW;
    }
    return board->eeprom_read(board->context, EEPROM_ADDRESS(request->offset), out, request->length)
               ? VW_RESULT_DONE
               : VW_RESULT_EEPROM_FAILED;
}

/* IDENT and READ: nothing changes, so a repeated one is done anew. */
static void answer(vw_link_t *link, const vw_frame_t *frame, const vw_request_t *request)
{
    size_t length = 0u;
    enum vw_result result = VW_RESULT_DONE;
    if (request->type == VW_MSG_IDENT) {
        length = vw_ident_data(link->reply + VW_REPLY_HEADER_SIZE, &link->ident);
    } else {
        result = read_bytes(link, request);
        length = result == VW_RESULT_DONE ? request->length : 0u;
    }
    put_reply(link, frame->type, frame->sequence, result, VW_NO_OFFSET, length);
}

/* What changes something: done once, and the reply kept. */
static void carry_out(vw_link_t *link, const vw_frame_t *frame, const vw_request_t *request)
{
    uint16_t offset = VW_NO_OFFSET;
    enum vw_result result;
    switch (request->type) {
    case VW_MSG_WRITE:
        result = write_config(link, request, &offset);
        break;
    case VW_MSG_STORE:
        result = begin_store(link);
        if (result == VW_RESULT_DONE) { /* the reply comes when the EEPROM has it */
            link->store_sequence = frame->sequence;
            return;
        }
        break;
    case VW_MSG_LOAD:
        result = load_config(link, &offset);
        break;
    default:
        result = do_command(link, request);
        break;
    }
    finish(link, frame, result, offset);
}

static void on_request(vw_link_t *link, const vw_frame_t *frame)
{
    vw_request_t request;
    uint16_t offset;
    enum vw_result result;
    if (link->has_reply || is_store_under_way(link, frame)) {
        return; /* the reply leaves, or comes; a host that misses it asks again */
    }
    if (is_repeated(link, frame)) {
        put_reply(link, frame->type, frame->sequence, link->last.result, link->last.offset, 0u);
        return;
    }
    result = vw_request_parse(frame, &request, &offset);
    if (result == VW_RESULT_DONE && !is_changing(frame->type)) {
        answer(link, frame, &request);
    } else if (result == VW_RESULT_DONE) {
        carry_out(link, frame, &request);
    } else if (is_changing(frame->type)) {
        finish(link, frame, result, offset);
    } else {
        put_reply(link, frame->type, frame->sequence, result, offset, 0u);
    }
}

static void on_item(void *context, vw_item_t item, const vw_frame_t *frame)
{
    vw_link_t *link = context;
    if (item == VW_ITEM_FRAME) {
        on_request(link, frame);
    } else if (item == VW_ITEM_STOP) {
        link->is_streaming = false;
    } else if (item == VW_ITEM_START && !link->is_streaming) {
        link->is_streaming = true;
        vw_stream_start(&link->stream, link->master->conf.ts, link->now_ms);
    } else {
        /* a bad chunk, which the decoder has counted */
    }
}

/* -- in and out ---------------------------------------------------------------------------------------------------- */

void vw_link_init(vw_link_t *link, const vw_board_t *board, vw_master_t *master, vw_can_t *can, const vw_ident_t *ident)
{
    static const uint8_t map_hash[8] = VW_MAP_HASH;
    uint32_t polls;
    (void)memset(link, 0, sizeof *link);
    link->board = board;
    link->master = master;
    link->can = can;
    link->ident = *ident;
    link->ident.protocol = VW_PROTOCOL_VERSION;
    (void)memcpy(link->ident.map_hash, map_hash, sizeof map_hash);
    vw_decoder_init(&link->decoder, VW_SIDE_MASTER, on_item, link);
    vw_store_init(&link->store, board);
    vw_link_event(link, VW_EVENT_BOOT, NO_CELL, ident->reset_cause, 0);
    for (polls = 0u; polls < BOOT_POLLS && board->eeprom_is_busy(board->context); polls++) {
        /* a reset may have come in the middle of a page write */
    }
    if (vw_store_read(&link->store, true) != VW_RESULT_DONE) {
        (void)memcpy(link->store.image, &default_config, VW_CONFIG_SIZE);
        vw_link_event(link, VW_EVENT_EEPROM_INVALID, NO_CELL, 0, 0);
    }
    lock(link);
    (void)memcpy(&master->conf, link->store.image, VW_CONFIG_SIZE);
    unlock(link);
    if (can != NULL) {
        vw_can_init(can, board, master);
    }
}

void vw_link_received(vw_link_t *link, uint32_t now_ms, const uint8_t *data, size_t length)
{
    vw_link_run(link, now_ms);
    link->last_byte_ms = now_ms;
    vw_decoder_feed(&link->decoder, data, length);
}

static void run_store(vw_link_t *link)
{
    vw_store_state_t state = vw_store_run(&link->store, link->now_ms);
    vw_frame_t request = { 0 };
    if (state == VW_STORE_DONE) {
        vw_link_event(link, VW_EVENT_CONFIG_STORED, NO_CELL, (int32_t)link->store.counter, 0);
    }
    if (state == VW_STORE_DONE || state == VW_STORE_FAILED) {
        request.type = VW_MSG_STORE;
        request.sequence = link->store_sequence;
        request.body = link->body;
        finish(link, &request, state == VW_STORE_DONE ? VW_RESULT_DONE : VW_RESULT_EEPROM_FAILED, VW_NO_OFFSET);
    }
}

void vw_link_run(vw_link_t *link, uint32_t now_ms)
{
    link->now_ms = now_ms;
    if ((uint32_t)(now_ms - link->last_byte_ms) > VW_LINE_SILENCE_MS) {
        vw_decoder_idle(&link->decoder);
        link->last_byte_ms = now_ms;
    }
    if (!link->has_reply) {
        run_store(link);
    }
    if (link->can != NULL) {
        uint8_t lost = vw_can_expire(link->can, now_ms);
        if (lost < VW_N_CAN_MESSAGES) {
            vw_link_event(link, VW_EVENT_CAN_RX_TIMEOUT, NO_CELL, lost, link->master->conf.can_rx_msg_timeout[lost]);
        }
    }
}

static size_t data_body(vw_link_t *link)
{
    vw_span_t spans[VW_STREAM_MAX_SPANS];
    uint8_t i, n = link->is_streaming ? vw_stream_take(&link->stream, link->now_ms, spans) : 0u;
    size_t length = 0u;
    if (n == 0u) {
        return 0u;
    }
    lock(link);
    for (i = 0u; i < n; i++) {
        length = vw_data_append(link->body, length, (const uint8_t *)link->master, spans[i].offset, spans[i].length);
    }
    unlock(link);
    return length;
}

static size_t send(vw_link_t *link, uint8_t type, const uint8_t *body, size_t length, uint8_t *out)
{
    size_t n = vw_frame_encode(type, link->sequence, link->now_ms, body, length, out, VW_MAX_FRAME);
    link->sequence++;
    return n;
}

size_t vw_link_next(vw_link_t *link, uint32_t now_ms, uint8_t out[VW_MAX_FRAME])
{
    size_t length;
    link->now_ms = now_ms;
    if (link->has_reply && link->events_ahead == 0u) {
        link->has_reply = false;
        return send(link, VW_MSG_REPLY, link->reply, link->reply_length, out);
    }
    if (link->restart_asked && !link->has_reply) {
        link->restart_asked = false;
        if (link->board->restart != NULL) {
            link->board->restart(link->board->context);
        }
    }
    if (link->n_events != 0u) {
        length = vw_event_body(link->body, &link->events[link->first_event]);
        drop_event(link);
        return send(link, VW_MSG_EVENT, link->body, length, out);
    }
    length = data_body(link);
    return length == 0u ? 0u : send(link, VW_MSG_DATA, link->body, length, out);
}
