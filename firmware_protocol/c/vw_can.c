#include "vw_can.h"

#include <string.h>

#include "vw_time.h"

#define BIT(index) ((uint8_t)(1u << (index)))

static void vw_can_load_masks(vw_can_t *can)
{
    can->startup_tx = can->master->conf.can_tx_msg_en_startup;
    can->startup_rx = can->master->conf.can_rx_msg_en_startup;
}

/* The struct shows what the controller does. */
static void vw_can_publish_masks(const vw_can_t *can)
{
    can->master->status.can_tx_msg_en = can->tx_enabled;
    can->master->status.can_rx_msg_en = can->rx_enabled;
    can->master->status.can_rx_msg_active = can->rx_active;
}

void vw_can_init(vw_can_t *can, const vw_board_t *board, vw_master_t *master)
{
    (void)memset(can, 0, sizeof *can);
    can->board = board;
    can->master = master;
    vw_can_load_masks(can);
    can->tx_enabled = can->startup_tx;
    can->rx_enabled = can->startup_rx;
    vw_can_publish_masks(can);
}

static uint8_t vw_can_merge_mask(uint8_t enabled, uint8_t old_startup, uint8_t new_startup)
{
    return (uint8_t)((enabled & ~(old_startup & ~new_startup)) | (new_startup & ~old_startup));
}

void vw_can_reload(vw_can_t *can)
{
    uint8_t old_tx = can->startup_tx, old_rx = can->startup_rx;
    vw_can_load_masks(can);
    can->tx_enabled = vw_can_merge_mask(can->tx_enabled, old_tx, can->startup_tx);
    can->rx_enabled = vw_can_merge_mask(can->rx_enabled, old_rx, can->startup_rx);
    can->rx_active &= can->rx_enabled;
    vw_can_publish_masks(can);
}

static void vw_can_fill_frame(const vw_can_t *can, uint8_t index, vw_can_frame_t *frame)
{
    const vw_config_t *conf = &can->master->conf;
    const vw_board_t *board = can->board;
    const uint8_t *bytes = (const uint8_t *)can->master;
    uint32_t id = conf->can_tx_msg_id[index];
    uint8_t i, length = conf->can_tx_msg_len[index];
    frame->is_extended = (id & VW_CAN_ID_EXTENDED) != 0u;
    frame->id = id & ~VW_CAN_ID_EXTENDED;
    frame->length = length <= VW_CAN_DATA_BYTES ? length : (uint8_t)VW_CAN_DATA_BYTES;
    if (board->lock != NULL) {
        board->lock(board->context);
    }
    for (i = 0u; i < frame->length; i++) {
        uint16_t offset = conf->can_tx_msg_data[index][i];
        frame->data[i] = offset < VW_MASTER_SIZE ? bytes[offset] : 0u;
    }
    if (board->unlock != NULL) {
        board->unlock(board->context);
    }
}

bool vw_can_next(vw_can_t *can, uint32_t now_ms, vw_can_frame_t *frame)
{
    uint8_t i;
    for (i = 0u; i < VW_N_CAN_MESSAGES; i++) {
        if ((can->on_demand & BIT(i)) != 0u) {
            can->on_demand &= (uint8_t)~BIT(i);
            vw_can_fill_frame(can, i, frame);
            return true;
        }
    }
    for (i = 0u; i < VW_N_CAN_MESSAGES; i++) {
        uint16_t period_ms = can->master->conf.can_tx_msg_timing[i];
        if ((can->tx_enabled & BIT(i)) == 0u || period_ms == 0u) {
            can->scheduled &= (uint8_t)~BIT(i);
            continue;
        }
        if ((can->scheduled & BIT(i)) == 0u) {
            can->scheduled |= BIT(i);
            can->due_ms[i] = now_ms;
        }
        if (!vw_is_due(now_ms, can->due_ms[i])) {
            continue;
        }
        can->due_ms[i] += period_ms;
        if (vw_is_due(now_ms, can->due_ms[i])) {
            can->due_ms[i] = now_ms + period_ms;
        }
        vw_can_fill_frame(can, i, frame);
        return true;
    }
    return false;
}

static bool vw_can_is_match(const vw_can_t *can, uint8_t index, const vw_can_frame_t *frame)
{
    uint32_t id = frame->is_extended ? frame->id | VW_CAN_ID_EXTENDED : frame->id;
    return (can->rx_enabled & BIT(index)) != 0u && can->master->conf.can_rx_msg_id[index] == id;
}

static void vw_can_store_bytes(const vw_can_t *can, uint8_t index, const vw_can_frame_t *frame)
{
    const vw_config_t *conf = &can->master->conf;
    const vw_board_t *board = can->board;
    uint8_t *bytes = (uint8_t *)can->master;
    uint8_t i;
    if (board->lock != NULL) {
        board->lock(board->context);
    }
    for (i = 0u; i < frame->length && i < conf->can_rx_msg_len[index] && i < VW_CAN_DATA_BYTES; i++) {
        uint16_t offset = conf->can_rx_msg_data[index][i];
        if (offset >= VW_CONFIG_SIZE && offset < VW_MASTER_SIZE) {
            bytes[offset] = frame->data[i];
        }
    }
    if (board->unlock != NULL) {
        board->unlock(board->context);
    }
}

/* The tx message that a received one activates; VW_N_CAN_MESSAGES or more for none. */
static uint8_t vw_can_find_response(const vw_can_t *can, uint8_t index)
{
    return (uint8_t)(can->master->conf.can_rx_msg_response[index] & (uint8_t)~VW_RESPONSE_CHARGES);
}

static bool vw_can_starts_charging(const vw_can_t *can, uint8_t index)
{
    return vw_can_find_response(can, index) < VW_N_CAN_MESSAGES &&
           (can->master->conf.can_rx_msg_response[index] & VW_RESPONSE_CHARGES) != 0u;
}

void vw_can_received(vw_can_t *can, uint32_t now_ms, const vw_can_frame_t *frame)
{
    uint8_t i = 0u;
    while (i < VW_N_CAN_MESSAGES && !vw_can_is_match(can, i, frame)) {
        i++;
    }
    if (i < VW_N_CAN_MESSAGES) {
        uint8_t response = vw_can_find_response(can, i);
        vw_can_store_bytes(can, i, frame);
        if ((can->rx_active & BIT(i)) == 0u && vw_can_starts_charging(can, i)) {
            can->charge = VW_CHARGE_BEGIN;
        }
        can->seen_ms[i] = now_ms;
        can->rx_active |= BIT(i);
        if (response < VW_N_CAN_MESSAGES) {
            can->tx_enabled |= BIT(response);
        }
        vw_can_publish_masks(can);
    }
}

uint8_t vw_can_expire(vw_can_t *can, uint32_t now_ms)
{
    const vw_config_t *conf = &can->master->conf;
    uint8_t i;
    for (i = 0u; i < VW_N_CAN_MESSAGES; i++) {
        uint16_t timeout_ms = conf->can_rx_msg_timeout[i];
        if ((can->rx_active & BIT(i)) != 0u && timeout_ms != 0u && (uint32_t)(now_ms - can->seen_ms[i]) > timeout_ms) {
            uint8_t response = vw_can_find_response(can, i);
            can->rx_active &= (uint8_t)~BIT(i);
            if (vw_can_starts_charging(can, i)) {
                can->charge = VW_CHARGE_END;
            }
            if (response < VW_N_CAN_MESSAGES) {
                can->tx_enabled &= (uint8_t)~BIT(response);
            }
            vw_can_publish_masks(can);
            return i;
        }
    }
    return (uint8_t)VW_N_CAN_MESSAGES;
}

enum vw_charge vw_can_take_charge(vw_can_t *can)
{
    enum vw_charge charge = can->charge;
    can->charge = VW_CHARGE_UNCHANGED;
    return charge;
}

void vw_can_enable(vw_can_t *can, uint8_t mask)
{
    can->tx_enabled = mask;
    vw_can_publish_masks(can);
}

void vw_can_send_once(vw_can_t *can, uint8_t index)
{
    if (index < VW_N_CAN_MESSAGES) {
        can->on_demand |= BIT(index);
    }
}
