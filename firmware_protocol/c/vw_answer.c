#include "vw_answer.h"

#include <string.h>

#include "vw_bytes.h"
#include "vw_config.h"
#include "vw_time.h"

#define EEPROM_ADDRESS(offset) ((uint16_t)((offset) - VW_EEPROM_READ_BASE))

/* -- configuration ------------------------------------------------------------------------------------------------- */

/* Put an image that passes the check in force, in one step; the padding is 0. */
static enum vw_result vw_answer_apply_config(vw_answer_t *answer, uint8_t image[VW_CONFIG_SIZE], uint16_t *offset)
{
    vw_config_clear_padding(image);
    *offset = vw_config_check(image);
    if (*offset != VW_NO_OFFSET) {
        return VW_RESULT_OUT_OF_RANGE;
    }
    vw_lock(answer->board);
    (void)memcpy(&answer->master->conf, image, VW_CONFIG_SIZE);
    vw_unlock(answer->board);
    answer->stream.period_ms = answer->master->conf.telemetry_period;
    if (answer->can != NULL) {
        vw_can_reload(answer->can);
    }
    if (answer->board->config_changed != NULL) {
        answer->board->config_changed(answer->board->context);
    }
    return VW_RESULT_DONE;
}

static bool vw_answer_may_configure(const vw_answer_t *answer)
{
    return answer->board->may_configure == NULL || answer->board->may_configure(answer->board->context);
}

static enum vw_result vw_answer_write_config(vw_answer_t *answer, const vw_request_t *request, uint16_t *offset)
{
    enum vw_result result;
    uint8_t *image = answer->body; /* free outside vw_link_next */
    (void)memcpy(image, &answer->master->conf, VW_CONFIG_SIZE);
    (void)memcpy(image + request->offset, request->data, request->length);
    if (!vw_config_is_live((const uint8_t *)&answer->master->conf, image) && !vw_answer_may_configure(answer)) {
        return VW_RESULT_NOT_NOW;
    }
    result = vw_answer_apply_config(answer, image, offset);
    if (result == VW_RESULT_DONE) {
        vw_outbox_event(&answer->outbox, VW_EVENT_CONFIG_WRITTEN, VW_NO_CELL, request->offset, request->length);
    }
    return result;
}

static enum vw_result vw_answer_load_config(vw_answer_t *answer, uint16_t *offset)
{
    enum vw_result result;
    if (!vw_answer_may_configure(answer)) {
        return VW_RESULT_NOT_NOW;
    }
    result = vw_store_read(&answer->store, false);
    if (result == VW_RESULT_DONE) {
        result = vw_answer_apply_config(answer, answer->store.image, offset);
    }
    if (result == VW_RESULT_DONE) {
        vw_outbox_event(&answer->outbox, VW_EVENT_CONFIG_WRITTEN, VW_NO_CELL, 0, (int32_t)VW_CONFIG_SIZE);
    }
    return result;
}

static enum vw_result vw_answer_begin_store(vw_answer_t *answer)
{
    enum vw_result result = VW_RESULT_NOT_NOW;
    if (vw_answer_may_configure(answer)) {
        (void)memcpy(answer->body, &answer->master->conf, VW_CONFIG_SIZE);
        result = vw_store_begin(&answer->store, answer->body, answer->now_ms);
    }
    return result;
}

/* -- commands ------------------------------------------------------------------------------------------------------ */

static enum vw_result vw_answer_run_command(const vw_answer_t *answer, enum vw_result (*function)(void *context,
                                            int32_t argument),
                           int32_t argument)
{
    return function == NULL ? VW_RESULT_UNKNOWN_REQUEST : function(answer->board->context, argument);
}

typedef struct {
    uint8_t code;
    int32_t low;
    int32_t high;
} argument_rule_t;

#define ARGUMENT_RULE(name, code, low, high) { (uint8_t)(code), low, high },
static const argument_rule_t argument_rules[] = { VW_COMMANDS(ARGUMENT_RULE) };

static bool vw_answer_is_argument_valid(uint8_t code, int32_t argument)
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
        return vw_answer_run_command(answer, answer->board->commands.name, argument);

static enum vw_result vw_answer_run_command_by_code(const vw_answer_t *answer, uint8_t code, int32_t argument)
{
    switch (code) {
        VW_COMMANDS(COMMAND_CASE)
    default:
        return VW_RESULT_UNKNOWN_REQUEST;
    }
}

static enum vw_result vw_answer_handle_command(vw_answer_t *answer, const vw_request_t *request)
{
    enum vw_result result = VW_RESULT_OUT_OF_RANGE;
    if (vw_answer_is_argument_valid(request->command, request->argument)) {
        result = vw_answer_run_command_by_code(answer, request->command, request->argument);
    }
    if (result == VW_RESULT_DONE && request->command == (uint8_t)VW_COMMAND_RESET) {
        answer->restart_asked = true;
    }
    return result;
}

/* -- requests ------------------------------------------------------------------------------------------------------ */

static bool vw_answer_is_write_request(uint8_t type)
{
    return type == VW_MSG_WRITE || type == VW_MSG_STORE || type == VW_MSG_LOAD || type == VW_MSG_COMMAND;
}

static void vw_answer_queue_reply(vw_answer_t *answer, const vw_frame_t *frame, enum vw_result result, uint16_t offset,
                      size_t data_length)
{
    vw_outbox_reply(&answer->outbox, frame->type, frame->sequence, result, offset, data_length);
}

static uint32_t vw_answer_compute_body_crc(const vw_frame_t *frame)
{
    return vw_crc32_update(VW_CRC32_START, frame->body, frame->length);
}

static bool vw_answer_is_repeated(const vw_answer_t *answer, const vw_frame_t *frame)
{
    const vw_done_t *last = &answer->last;
    return answer->has_last && !vw_is_due(answer->now_ms, last->at_ms + VW_REPEAT_WINDOW_MS)
           && frame->type == last->type && frame->sequence == last->sequence && frame->length == last->length &&
               vw_answer_compute_body_crc(frame) == last->crc;
}

static bool vw_answer_is_store_running(const vw_answer_t *answer, const vw_frame_t *frame)
{
    return vw_store_is_busy(&answer->store) && frame->type == VW_MSG_STORE && frame->length == 0u
           && frame->sequence == answer->store_sequence;
}

/* Reply, and remember how the request ended. */
static void vw_answer_finish_request(vw_answer_t *answer, const vw_frame_t *frame, enum vw_result result,
                                     uint16_t offset)
{
    answer->has_last = true;
    answer->last.type = frame->type;
    answer->last.sequence = frame->sequence;
    answer->last.length = frame->length;
    answer->last.crc = vw_answer_compute_body_crc(frame);
    answer->last.at_ms = answer->now_ms;
    answer->last.result = result;
    answer->last.offset = offset;
    vw_answer_queue_reply(answer, frame, result, offset, 0u);
}

static enum vw_result vw_answer_read_bytes(vw_answer_t *answer, const vw_request_t *request)
{
    uint8_t *out = answer->outbox.reply + VW_REPLY_HEADER_SIZE;
    const vw_board_t *board = answer->board;
    if (request->offset < VW_EEPROM_READ_BASE) {
        vw_lock(answer->board);
        (void)memcpy(out, (const uint8_t *)answer->master + request->offset, request->length);
        vw_unlock(answer->board);
        return VW_RESULT_DONE;
    }
    if (vw_store_is_busy(&answer->store) || board->eeprom_is_busy(board->context)) {
        return VW_RESULT_NOT_NOW;
    }
    return board->eeprom_read(board->context, EEPROM_ADDRESS(request->offset), out, request->length)
               ? VW_RESULT_DONE
               : VW_RESULT_EEPROM_FAILED;
}

/* IDENT and READ: nothing changes, so a repeated one is done anew. */
static void vw_answer_handle_read(vw_answer_t *answer, const vw_frame_t *frame, const vw_request_t *request)
{
    size_t length = 0u;
    enum vw_result result = VW_RESULT_DONE;
    if (request->type == VW_MSG_IDENT) {
        length = vw_ident_data(answer->outbox.reply + VW_REPLY_HEADER_SIZE, &answer->ident);
    } else {
        result = vw_answer_read_bytes(answer, request);
        length = result == VW_RESULT_DONE ? request->length : 0u;
    }
    vw_answer_queue_reply(answer, frame, result, VW_NO_OFFSET, length);
}

/* What changes something: done once, and the reply kept. */
static void vw_answer_handle_write(vw_answer_t *answer, const vw_frame_t *frame, const vw_request_t *request)
{
    uint16_t offset = VW_NO_OFFSET;
    enum vw_result result;
    switch (request->type) {
    case VW_MSG_WRITE:
        result = vw_answer_write_config(answer, request, &offset);
        break;
    case VW_MSG_STORE:
        result = vw_answer_begin_store(answer);
        if (result == VW_RESULT_DONE) { /* the reply comes when the EEPROM has it */
            answer->store_sequence = frame->sequence;
            return;
        }
        break;
    case VW_MSG_LOAD:
        result = vw_answer_load_config(answer, &offset);
        break;
    default:
        result = vw_answer_handle_command(answer, request);
        break;
    }
    vw_answer_finish_request(answer, frame, result, offset);
}

void vw_answer_request(vw_answer_t *answer, const vw_frame_t *frame)
{
    vw_request_t request;
    uint16_t offset;
    enum vw_result result;
    if (answer->outbox.has_reply || vw_answer_is_store_running(answer, frame)) {
        return; /* the reply leaves, or comes; a host that misses it asks again */
    }
    if (vw_answer_is_repeated(answer, frame)) {
        vw_answer_queue_reply(answer, frame, answer->last.result, answer->last.offset, 0u);
        return;
    }
    result = vw_request_parse(frame, &request, &offset);
    if (result == VW_RESULT_DONE && !vw_answer_is_write_request(frame->type)) {
        vw_answer_handle_read(answer, frame, &request);
    } else if (result == VW_RESULT_DONE) {
        vw_answer_handle_write(answer, frame, &request);
    } else if (vw_answer_is_write_request(frame->type)) {
        vw_answer_finish_request(answer, frame, result, offset);
    } else {
        vw_answer_queue_reply(answer, frame, result, offset, 0u);
    }
}

void vw_answer_store(vw_answer_t *answer, enum vw_result result)
{
    vw_frame_t request = { 0 };
    request.type = VW_MSG_STORE;
    request.sequence = answer->store_sequence;
    request.body = answer->body;
    vw_answer_finish_request(answer, &request, result, VW_NO_OFFSET);
}
