#include "vw_master.h"

#include <string.h>

#include "../vw_time.h"

#define POWER_ON 0u
#define JOURNAL_PERIOD_MS 10000u
#define JOURNAL_STEP 25000u /* 0.1 % of 25 Ah: less is not worth a page [uAh] */
#define CHARGER_FLAGS ((uint16_t)(offsetof(vw_master_t, charger) + offsetof(vw_charger_t, flags)))

/* A message that writes the charger's flags is alive. */
static bool vw_master_is_charger_alive(const vw_master_task_t *task)
{
    const vw_config_t *conf = &task->memory->conf;
    uint32_t i, k;
    for (i = 0u; i < VW_N_CAN_MESSAGES; i++) {
        for (k = 0u; (task->can->rx_active & (1u << i)) != 0u && k < conf->can_rx_msg_len[i]; k++) {
            if (conf->can_rx_msg_data[i][k] == CHARGER_FLAGS) {
                return true;
            }
        }
    }
    return false;
}

static void vw_master_save_journal(vw_master_task_t *task, uint32_t now_ms)
{
    const vw_board_t *board = task->link->answer.board;
    uint32_t dod = task->counter.dod, known = task->journal.dod;
    uint32_t moved = dod > known ? dod - known : known - dod;
    if (!vw_is_due(now_ms, task->journal_ms) || vw_store_is_busy(&task->link->answer.store)
        || board->eeprom_is_busy(board->context)) {
        return;
    }
    task->journal_ms = now_ms + JOURNAL_PERIOD_MS;
    if (task->journal.counter == 0u || moved >= JOURNAL_STEP) {
        (void)vw_journal_write(board, &task->journal, dod, task->memory->soc);
    }
}

static void vw_master_count_charge(vw_master_task_t *task, const vw_inputs_t *inputs, uint32_t now_ms)
{
    vw_master_t *memory = task->memory;
    if (task->counter.is_started) {
        uint8_t i;
        for (i = 0u; i < inputs->n_means; i++) {
            vw_soc_counter_count(&task->counter, &memory->conf, inputs->means[i], memory->conf.ts);
        }
    } else if (inputs->is_ready) {
        (void)vw_soc_counter_from_rest(&task->counter, &memory->conf, memory->v_avg, inputs->reading.i_fc);
    } else {
        /* not measured yet */
    }
    memory->dod = task->counter.dod;
    if (!task->is_soc_estimated) {
        memory->soc = vw_soc_counter_soc(&task->counter, &memory->conf);
    }
    if (task->counter.is_started) {
        vw_master_save_journal(task, now_ms);
    }
}

static void vw_master_step_protection(vw_master_task_t *task, const vw_inputs_t *inputs, uint32_t now_ms)
{
    vw_event_t trips[VW_N_TRIPS];
    vw_reading_t reading = inputs->reading;
    uint8_t i, n = 0u;
    reading.is_charging = task->charging.is_active;
    if (inputs->is_ready) {
        n = vw_protection_check(&task->protection, &task->memory->conf, &reading, now_ms, trips);
    }
    for (i = 0u; i < n; i++) {
        vw_link_event(task->link, trips[i].code, trips[i].cell, trips[i].value, trips[i].limit);
    }
}

/* Charging begins and ends with the message that the configuration names; by hand it ends as ever. */
static void vw_master_step_charging(vw_master_task_t *task, const vw_inputs_t *inputs, bool is_alive, uint32_t now_ms)
{
    vw_charging_t *charging = &task->charging;
    enum vw_charge asked = vw_can_take_charge(task->can);
    if (asked == VW_CHARGE_BEGIN) {
        (void)vw_master_command(task, (uint8_t)VW_COMMAND_CHARGE_START, 0);
    } else if (asked == VW_CHARGE_END) {
        (void)vw_master_command(task, (uint8_t)VW_COMMAND_CHARGE_STOP, 0);
    } else {
        /* no news */
    }
    if (task->protection.is_open) {
        (void)vw_master_command(task, (uint8_t)VW_COMMAND_BALANCE_STOP, 0);
        vw_master_send_charging_event(task, vw_charging_stop(charging, true, now_ms));
    }
    if (inputs->is_drive_asked && !charging->is_active) {
        vw_master_send_charging_event(task, vw_charging_stop(charging, false, now_ms));
    }
    vw_master_send_charging_event(task, vw_charging_step(charging, is_alive, inputs->reading.v_max, now_ms));
}

static void vw_master_step_balancing(vw_master_task_t *task, uint32_t now_ms)
{
    const vw_config_t *conf = &task->memory->conf;
    vw_balance_end_manual(&task->balance, conf->v_cell_min, task->memory->v, now_ms);
    if (task->is_balance_asked && task->charging.state != VW_CHARGER_STATE_BALANCING) {
        task->is_balance_asked = vw_balance_choose(&task->balance, conf->balance_threshold, task->memory->v);
    }
}

static void vw_master_write_status(vw_master_task_t *task, uint32_t hardware, bool is_alive)
{
    vw_status_t *status = &task->memory->status;
    status->flags = hardware | (task->protection.is_open ? 0u : (uint32_t)VW_STATUS_FIT)
                    | (task->link->is_streaming ? (uint32_t)VW_STATUS_USART1 : 0u)
                    | (is_alive ? (uint32_t)VW_STATUS_CHARGER : 0u)
                    | (task->charging.is_active ? (uint32_t)VW_STATUS_CHARGING : 0u)
                    | (task->balance.is_active ? (uint32_t)VW_STATUS_BALANCING : 0u)
                    | (task->relays.state == VW_RELAYS_VEHICLE ? (uint32_t)VW_STATUS_LOAD : 0u);
    status->charger_status = is_alive ? task->memory->charger.flags : VW_NO_CHARGER;
}

void vw_master_init(vw_master_task_t *task, vw_link_t *link, bool is_open, uint32_t now_ms)
{
    (void)memset(task, 0, sizeof *task);
    task->link = link;
    task->memory = link->answer.master;
    task->can = link->answer.can;
    vw_protection_init(&task->protection, is_open);
    vw_balance_init(&task->balance);
    vw_charging_init(&task->charging, task->memory, &task->balance);
    vw_relays_init(&task->relays, now_ms);
    vw_fans_init(&task->fans);
    vw_soc_counter_init(&task->counter);
    vw_journal_read(link->answer.board, &task->journal);
    task->journal_ms = now_ms + JOURNAL_PERIOD_MS;
    task->now_ms = now_ms;
    if (link->answer.ident.reset_cause != POWER_ON && task->journal.counter != 0u) {
        vw_soc_counter_from_journal(&task->counter, task->journal.dod);
    }
}

void vw_master_step(vw_master_task_t *task, const vw_inputs_t *inputs, uint32_t now_ms)
{
    bool is_alive = vw_master_is_charger_alive(task);
    vw_relay_inputs_t relays = { 0 };
    task->now_ms = now_ms;
    task->i_fc = inputs->reading.i_fc;
    task->is_ready = inputs->is_ready;
    task->is_drive_asked = inputs->is_drive_asked;
    vw_master_count_charge(task, inputs, now_ms);
    vw_master_step_protection(task, inputs, now_ms);
    vw_master_step_charging(task, inputs, is_alive, now_ms);
    relays.is_ok = !task->protection.is_open && inputs->is_shutdown_closed;
    relays.is_drive_asked = inputs->is_drive_asked && inputs->is_ready;
    relays.is_charging = task->charging.is_active;
    relays.link_permille = inputs->link_permille;
    (void)vw_relays_step(&task->relays, &relays, now_ms);
    vw_master_step_balancing(task, now_ms);
    task->memory->charger.fan_duty = vw_fans_duty(&task->fans, &task->memory->conf, inputs->reading.t_max, now_ms);
    vw_master_write_status(task, inputs->hardware, is_alive);
}
