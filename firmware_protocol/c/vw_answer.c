#include "vw_answer.h"

#include <string.h>

#include "vw_bytes.h"
#include "vw_config.h"
#include "vw_time.h"

#define EEPROM_ADDRESS(offset) ((uint16_t)((offset) - VW_EEPROM_READ_BASE))

/* -- configuration ------------------------------------------------------------------------------------------------- */

/* Put an image that passes the check in force, in one step; the padding is 0. */
static enum vw_result use_config(vw_link_t *link, uint8_t image[VW_CONFIG_SIZE], uint16_t *offset)
{
    vw_config_clear_padding(image);
    *offset = vw_config_check(image);
    if (*offset != VW_NO_OFFSET) {
        return VW_RESULT_OUT_OF_RANGE;
    }
    vw_lock(link->board);
    (void)memcpy(&link->master->conf, image, VW_CONFIG_SIZE);
    vw_unlock(link->board);
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
        vw_link_event(link, VW_EVENT_CONFIG_WRITTEN, VW_NO_CELL, request->offset, request->length);
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
        vw_link_event(link, VW_EVENT_CONFIG_WRITTEN, VW_NO_CELL, 0, (int32_t)VW_CONFIG_SIZE);
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
        vw_lock(link->board);
        (void)memcpy(out, (const uint8_t *)link->master + request->offset, request->length);
        vw_unlock(link->board);
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

void vw_answer_request(vw_link_t *link, const vw_frame_t *frame)
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

void vw_answer_store(vw_link_t *link, enum vw_result result)
{
    vw_frame_t request = { 0 };
    request.type = VW_MSG_STORE;
    request.sequence = link->store_sequence;
    request.body = link->body;
    finish(link, &request, result, VW_NO_OFFSET);
}
