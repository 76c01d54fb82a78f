#include "battery.h"

#include <string.h>

#define REST_V 38950u /* 100 uV */
#define SPREAD_V 7u
#define N_SPREAD 13u

static void set_flag(battery_t *battery, uint32_t flag, bool on)
{
    uint32_t flags = battery->master->status.flags & ~flag;
    battery->master->status.flags = on ? flags | flag : flags;
}

void battery_init(battery_t *battery, vw_master_t *master, vw_link_t *link, bool is_driving)
{
    unsigned i;
    battery->master = master;
    battery->link = link;
    battery->is_driving = is_driving;
    battery->current_sum = 0;
    battery->n_samples = 0u;
    battery->sampled_ms = 0u;
    faults_init(&battery->faults);
    memset(&battery->protection, 0, sizeof battery->protection);
    memset((uint8_t *)master + VW_CONFIG_SIZE, 0, VW_MASTER_SIZE - VW_CONFIG_SIZE);
    master->n_slaves = VW_N_PACKS;
    master->status.charger_status = 255u;
    vw_estimator_init(&battery->estimator);
    for (i = 0; i < VW_N_PACKS; i++) {
        master->slave[i].status = 1u;
    }
    for (i = 0; i < VW_N_CELLS; i++) {
        master->c[i] = (uint16_t)master->conf.c_avg;
        master->r_fs[i] = (uint16_t)master->conf.r_fs_avg;
        master->t[i] = (int8_t)(24 + (int)(i / VW_CELLS_PER_PACK) % 3);
    }
    master->c_min = master->c_max = master->c_avg = (uint16_t)master->conf.c_avg;
    master->t_min = 24;
    master->t_max = 26;
    master->t_avg = 25;
    master->t_max_id = 2u * VW_CELLS_PER_PACK;
}

static void set_charging(battery_t *battery, bool on)
{
    uint8_t state = on ? VW_CHARGER_STATE_WAITING : VW_CHARGER_STATE_OFF;
    if (battery->master->charger.state != state) {
        battery->master->charger.state = state;
        vw_link_event(battery->link, VW_EVENT_CHARGER_STATE, VW_NO_OFFSET, state, 0);
    }
    set_flag(battery, VW_STATUS_CHARGING, on);
}

void battery_follow_charger(battery_t *battery, enum vw_charge charge)
{
    if (charge == VW_CHARGE_END) {
        set_charging(battery, false);
    } else if (charge == VW_CHARGE_BEGIN && !battery->is_driving && !battery->protection.is_open) {
        set_charging(battery, true);
    }
}

/* A sample for each millisecond since the last pass; `ts` of them are one mean. This car averages no further. */
static void take_current(battery_t *battery, uint32_t now_ms)
{
    const faults_t *faults = &battery->faults;
    vw_master_t *master = battery->master;
    int32_t sample = faults->has_current ? faults->current : battery->is_driving ? 4200 : 0;
    for (; battery->sampled_ms != now_ms; battery->sampled_ms++) {
        battery->current_sum += sample;
        battery->n_samples++;
        if (battery->n_samples >= master->conf.ts) {
            master->i_fs = battery->current_sum / battery->n_samples;
            master->i_fc = master->i_fc_hp = master->i_fs;
            battery->current_sum = 0;
            battery->n_samples = 0u;
        }
    }
}

bool battery_measure(battery_t *battery, uint32_t now_ms)
{
    vw_master_t *master = battery->master;
    uint32_t i, sum = 0, n_known = 0;
    bool has_opened;
    take_current(battery, now_ms);
    master->v_min = UINT16_MAX;
    master->v_max = 0;
    for (i = 0; i < VW_N_CELLS; i++) {
        uint16_t v = (uint16_t)(REST_V + SPREAD_V * (i * 5u % N_SPREAD) + (now_ms / 100u + i) % 3u);
        master->v[i] = v;
        master->slave[i / VW_CELLS_PER_PACK].cvr[i % VW_CELLS_PER_PACK] = v;
    }
    faults_apply(&battery->faults, master);
    for (i = 0; i < VW_N_CELLS; i++) {
        uint16_t v = master->v[i];
        sum += v;
        n_known += v != VW_V_MISSING;
        if (v != VW_V_MISSING && v < master->v_min) {
            master->v_min = v;
            master->v_min_id = (uint8_t)i;
        }
        if (v > master->v_max) {
            master->v_max = v;
            master->v_max_id = (uint8_t)i;
        }
    }
    master->v_avg = (uint16_t)(n_known == 0u ? VW_V_MISSING : sum / n_known);
    master->v_tot = (uint16_t)(sum / 100u);
    while (vw_estimator_run(&battery->estimator, master, now_ms)) continue; /* a PC is quick */
    has_opened = protection_judge(&battery->protection, master, battery->link, now_ms);
    set_flag(battery, VW_STATUS_I2C1, true);
    set_flag(battery, VW_STATUS_FIT, !battery->protection.is_open);
    set_flag(battery, VW_STATUS_USART1, battery->link->is_streaming);
    set_flag(battery, VW_STATUS_LOAD, battery->is_driving && !battery->protection.is_open);
    return has_opened;
}

bool battery_may_configure(const battery_t *battery)
{
    return (battery->master->status.flags & (VW_STATUS_LOAD | VW_STATUS_CHARGING)) == 0u;
}

enum vw_result battery_command(battery_t *battery, uint8_t command, int32_t argument)
{
    switch (command) {
    case VW_COMMAND_CHARGE_START:
    case VW_COMMAND_BALANCE_START:
    case VW_COMMAND_BALANCE_CELLS:
    case VW_COMMAND_RESET:
        if (battery->is_driving) {
            return VW_RESULT_NOT_NOW;
        }
        break;
    default:
        break;
    }
    switch (command) {
    case VW_COMMAND_CHARGE_START:
    case VW_COMMAND_CHARGE_STOP:
        set_charging(battery, command == VW_COMMAND_CHARGE_START);
        break;
    case VW_COMMAND_BALANCE_START:
    case VW_COMMAND_BALANCE_STOP:
        set_flag(battery, VW_STATUS_BALANCING, command == VW_COMMAND_BALANCE_START);
        break;
    case VW_COMMAND_FAN_OVERRIDE:
        /* the time in the upper bytes is left out here: this car has no clock for it */
        battery->master->charger.fan_duty =
            argument < 0 ? battery->master->conf.fan_ramp_min : (uint8_t)((uint32_t)argument & 0xFFu);
        break;
    case VW_COMMAND_BALANCE_CELLS:
        set_flag(battery, VW_STATUS_BALANCING, ((uint32_t)argument & 0xFFFu) != 0u);
        break;
    case VW_COMMAND_CLEAR_FAULTS:
        if (!protection_clear(&battery->protection)) {
            return VW_RESULT_NOT_NOW;
        }
        vw_link_event(battery->link, VW_EVENT_FAULTS_CLEARED, VW_NO_OFFSET, 0, 0);
        break;
    case VW_COMMAND_SET_SOC:
        vw_estimator_set_soc(&battery->estimator, (uint16_t)argument);
        vw_link_event(battery->link, VW_EVENT_SOC_SET, VW_NO_OFFSET, argument, 0);
        break;
    case VW_COMMAND_CAN_TX_ENABLE:
        vw_can_enable(battery->link->answer.can, (uint8_t)argument);
        break;
    case VW_COMMAND_CAN_SEND:
        vw_can_send_once(battery->link->answer.can, (uint8_t)argument);
        break;
    default:
        break;
    }
    return VW_RESULT_DONE;
}
