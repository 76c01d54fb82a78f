#include "vw_master.h"

static void vw_master_command_send_event(vw_master_task_t *task, enum vw_event code, int32_t value)
{
    vw_link_event(task->link, (uint8_t)code, VW_NO_OFFSET, value, 0);
}

void vw_master_send_charging_event(vw_master_task_t *task, bool has_changed)
{
    if (has_changed) {
        vw_master_command_send_event(task, VW_EVENT_CHARGER_STATE, (int32_t)task->charging.state);
    }
}

static bool vw_master_command_is_driving(const vw_master_task_t *task)
{
    return task->relays.state == VW_RELAYS_VEHICLE || task->relays.state == VW_RELAYS_PRECHARGE;
}

static bool vw_master_command_may_charge(const vw_master_task_t *task)
{
    return !vw_master_command_is_driving(task) && !task->is_drive_asked && !task->protection.is_open;
}

static bool vw_master_command_may_balance(const vw_master_task_t *task)
{
    return !vw_master_command_is_driving(task) && !task->charging.is_active && !task->protection.is_open;
}

bool vw_master_may_configure(const vw_master_task_t *task)
{
    return task->relays.state == VW_RELAYS_OPEN && !task->charging.is_active;
}

static enum vw_result vw_master_command_result_of(bool is_done)
{
    return is_done ? VW_RESULT_DONE : VW_RESULT_NOT_NOW;
}

static bool vw_master_command_clear_faults(vw_master_task_t *task)
{
    bool is_clear = vw_protection_clear(&task->protection);
    if (is_clear) {
        vw_master_send_charging_event(task, vw_charging_stop(&task->charging, false, task->now_ms));
        vw_relays_retry(&task->relays);
        vw_master_command_send_event(task, VW_EVENT_FAULTS_CLEARED, 0);
    }
    return is_clear;
}

static bool vw_master_command_balance_by_hand(vw_master_task_t *task, uint32_t argument)
{
    bool is_allowed = vw_master_command_may_balance(task);
    if (is_allowed) {
        uint8_t pack = (uint8_t)(argument >> VW_CELLS_PER_PACK);
        uint16_t cells = (uint16_t)(argument & ((1u << VW_CELLS_PER_PACK) - 1u));
        task->is_balance_asked = false;
        vw_balance_set_manual(&task->balance, pack, cells, task->now_ms);
        task->has_new_cells = true;
    }
    return is_allowed;
}

static bool vw_master_command_set_soc_from_ocv(vw_master_task_t *task)
{
    const vw_config_t *conf = &task->memory->conf;
    bool is_done =
        task->is_ready && vw_soc_counter_from_rest(&task->counter, conf, task->memory->v_avg, task->i_fc);
    if (is_done) {
        vw_master_command_send_event(task, VW_EVENT_SOC_SET, vw_soc_counter_soc(&task->counter, conf));
    }
    return is_done;
}

enum vw_result vw_master_command(vw_master_task_t *task, uint8_t command, int32_t argument)
{
    enum vw_result result = VW_RESULT_DONE;
    switch (command) {
    case VW_COMMAND_CHARGE_START:
        result = vw_master_command_result_of(vw_master_command_may_charge(task));
        if (result == VW_RESULT_DONE) {
            vw_master_send_charging_event(task, vw_charging_start(&task->charging, task->now_ms));
        }
        break;
    case VW_COMMAND_CHARGE_STOP:
        vw_master_send_charging_event(task, vw_charging_stop(&task->charging, false, task->now_ms));
        break;
    case VW_COMMAND_BALANCE_START:
        result = vw_master_command_result_of(vw_master_command_may_balance(task));
        if (result == VW_RESULT_DONE) {
            vw_balance_stop(&task->balance);
            task->is_balance_asked = true;
        }
        break;
    case VW_COMMAND_BALANCE_CELLS:
        result = vw_master_command_result_of(vw_master_command_balance_by_hand(task, (uint32_t)argument));
        break;
    case VW_COMMAND_BALANCE_STOP:
        task->is_balance_asked = false;
        if (!task->charging.is_active) {
            vw_balance_stop(&task->balance);
        }
        break;
    case VW_COMMAND_SOC_FROM_OCV:
        result = vw_master_command_result_of(vw_master_command_set_soc_from_ocv(task));
        break;
    case VW_COMMAND_FAN_OVERRIDE:
        vw_fans_command(&task->fans, argument, task->now_ms);
        break;
    case VW_COMMAND_CLEAR_FAULTS:
        result = vw_master_command_result_of(vw_master_command_clear_faults(task));
        break;
    case VW_COMMAND_SET_SOC:
        vw_soc_counter_set(&task->counter, &task->memory->conf, (uint16_t)argument);
        vw_master_command_send_event(task, VW_EVENT_SOC_SET, argument);
        break;
    case VW_COMMAND_CAN_TX_ENABLE:
        vw_can_enable(task->can, (uint8_t)argument);
        break;
    case VW_COMMAND_CAN_SEND:
        vw_can_send_once(task->can, (uint8_t)argument);
        break;
    case VW_COMMAND_RESET:
        result = vw_master_command_result_of(!vw_master_command_is_driving(task));
        break;
    default:
        result = VW_RESULT_UNKNOWN_REQUEST;
        break;
    }
    return result;
}
