#include "vw_link.h"

#include <string.h>

#define BOOT_POLLS 2000u /* of 25 us at 400 kHz: longer than the 10 ms of the slowest page */

static const vw_config_t default_config = VW_CONFIG_DEFAULTS;

void vw_link_event(vw_link_t *link, uint8_t code, uint16_t cell, int32_t value, int32_t limit)
{
    vw_outbox_event(&link->answer.outbox, code, cell, value, limit);
}

static void vw_link_handle_item(void *context, vw_item_t item, const vw_frame_t *frame)
{
    vw_link_t *link = context;
    if (item == VW_ITEM_FRAME) {
        vw_answer_request(&link->answer, frame);
    } else if (item == VW_ITEM_STOP) {
        link->is_streaming = false;
    } else if (item == VW_ITEM_START && !link->is_streaming) {
        link->is_streaming = true;
        vw_stream_start(&link->answer.stream, link->answer.master->conf.telemetry_period, link->answer.now_ms);
    } else {
        /* a bad chunk, which the decoder has counted */
    }
}

void vw_link_init(vw_link_t *link, const vw_board_t *board, vw_master_t *master, vw_can_t *can, const vw_ident_t *ident)
{
    static const uint8_t map_hash[8] = VW_MAP_HASH;
    vw_answer_t *answer = &link->answer;
    uint32_t polls;
    (void)memset(link, 0, sizeof *link);
    answer->board = board;
    answer->master = master;
    answer->can = can;
    answer->ident = *ident;
    answer->ident.protocol = VW_PROTOCOL_VERSION;
    (void)memcpy(answer->ident.map_hash, map_hash, sizeof map_hash);
    vw_decoder_init(&link->decoder, VW_SIDE_MASTER, vw_link_handle_item, link);
    vw_store_init(&answer->store, board);
    vw_link_event(link, VW_EVENT_BOOT, VW_NO_CELL, ident->reset_cause, 0);
    for (polls = 0u; polls < BOOT_POLLS && board->eeprom_is_busy(board->context); polls++) {
        /* a reset may have come in the middle of a page write */
    }
    if (vw_store_read(&answer->store, true) != VW_RESULT_DONE) {
        (void)memcpy(answer->store.image, &default_config, VW_CONFIG_SIZE);
        vw_link_event(link, VW_EVENT_EEPROM_INVALID, VW_NO_CELL, 0, 0);
    }
    vw_lock(answer->board);
    (void)memcpy(&master->conf, answer->store.image, VW_CONFIG_SIZE);
    vw_unlock(answer->board);
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

static void vw_link_run_store(vw_link_t *link)
{
    vw_store_state_t state = vw_store_run(&link->answer.store, link->answer.now_ms);
    if (state == VW_STORE_DONE) {
        vw_link_event(link, VW_EVENT_CONFIG_STORED, VW_NO_CELL, (int32_t)link->answer.store.counter, 0);
    }
    if (state == VW_STORE_DONE || state == VW_STORE_FAILED) {
        vw_answer_store(&link->answer, state == VW_STORE_DONE ? VW_RESULT_DONE : VW_RESULT_EEPROM_FAILED);
    }
}

void vw_link_run(vw_link_t *link, uint32_t now_ms)
{
    link->answer.now_ms = now_ms;
    if ((uint32_t)(now_ms - link->last_byte_ms) > VW_LINE_SILENCE_MS) {
        vw_decoder_idle(&link->decoder);
        link->last_byte_ms = now_ms;
    }
    if (!link->answer.outbox.has_reply) {
        vw_link_run_store(link);
    }
    if (link->answer.can != NULL) {
        uint8_t lost = vw_can_expire(link->answer.can, now_ms);
        if (lost < VW_N_CAN_MESSAGES) {
            uint16_t timeout_ms = link->answer.master->conf.can_rx_msg_timeout[lost];
            vw_link_event(link, VW_EVENT_CAN_RX_TIMEOUT, VW_NO_CELL, lost, timeout_ms);
        }
    }
}

static size_t vw_link_fill_data_body(vw_link_t *link)
{
    vw_answer_t *answer = &link->answer;
    vw_span_t spans[VW_STREAM_MAX_SPANS];
    uint8_t i, n = link->is_streaming ? vw_stream_take(&answer->stream, answer->now_ms, spans) : 0u;
    size_t length = 0u;
    if (n == 0u) {
        return 0u;
    }
    vw_lock(answer->board);
    for (i = 0u; i < n; i++) {
        const uint8_t *master = (const uint8_t *)answer->master;
        length = vw_data_append(answer->body, length, master, spans[i].offset, spans[i].length);
    }
    vw_unlock(answer->board);
    return length;
}

static size_t vw_link_encode_frame(vw_link_t *link, uint8_t type, const uint8_t *body, size_t length, uint8_t *out)
{
    size_t n = vw_frame_encode(type, link->sequence, link->answer.now_ms, body, length, out, VW_MAX_FRAME);
    link->sequence++;
    return n;
}

size_t vw_link_next(vw_link_t *link, uint32_t now_ms, uint8_t out[VW_MAX_FRAME])
{
    vw_answer_t *answer = &link->answer;
    size_t length;
    answer->now_ms = now_ms;
    if (vw_outbox_is_reply_next(&answer->outbox)) {
        const uint8_t *reply = vw_outbox_take_reply(&answer->outbox, &length);
        return vw_link_encode_frame(link, VW_MSG_REPLY, reply, length, out);
    }
    if (answer->restart_asked && !answer->outbox.has_reply) {
        answer->restart_asked = false;
        if (answer->board->restart != NULL) {
            answer->board->restart(answer->board->context);
        }
    }
    length = vw_outbox_take_event(&answer->outbox, answer->body);
    if (length != 0u) {
        return vw_link_encode_frame(link, VW_MSG_EVENT, answer->body, length, out);
    }
    length = vw_link_fill_data_body(link);
    return length == 0u ? 0u : vw_link_encode_frame(link, VW_MSG_DATA, answer->body, length, out);
}
