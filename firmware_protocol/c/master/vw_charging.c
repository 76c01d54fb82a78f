#include "vw_charging.h"

#include <string.h>

#include "../vw_time.h"

#define CONTROL_PERIOD_MS 1000u
#define DONE_CURRENT 10u /* 1 A [0.1 A] */
#define DONE_PERSISTENCE_MS 20000u
#define SETTLE_MS 30000u /* of rest before balancing is judged, so that polarisation does not count as imbalance */
#define RISE_PER_PERIOD 3.0 /* [0.1 A] */
#define FALL_PER_PERIOD 20.0
#define RISE_SHARE 0.18 /* of what is missing, that a period's change closes */
#define FALL_SHARE 0.45
#define CELL_SLOPE 3.0 /* 3 mohm, what a sound cell answers [100 uV per 0.1 A] */
#define UNKNOWN_SLOPE 30.0 /* taken for it at first: a loose joint and all */
#define UNKNOWN_DECAY 0.9 /* a period of it: where the cells are so full that no current flows, nothing is learned */
#define SLOPE_CURRENT 5u /* 0.5 A, from which on the slope of a cell is known [0.1 A] */
#define HEADROOM_COUNTS 5 /* held below the limit, for the time that a command takes to act [100 uV] */
#define FULL_COUNTS 15.0 /* a cell this near what is held counts as having reached it [100 uV] */
#define TRIP_MARGIN_COUNTS 20 /* 2 mV between the charge's end and the trip, whatever is configured */
#define STRING_MARGIN 40000 /* 4 V [100 uV]: cables and the charger's error must not end the charge before the cells do */
#define CABLE_MARGIN 10000 /* 1 V of it, where no more is left below the sum of all trips [100 uV] */
#define FATAL ((uint8_t)VW_CHARGER_HARDWARE | (uint8_t)VW_CHARGER_OVER_TEMPERATURE | (uint8_t)VW_CHARGER_INPUT_VOLTAGE \
               | (uint8_t)VW_CHARGER_BATTERY)
#define PER_STRING_COUNT 1000 /* 0.1 V in 100 uV */

static bool vw_charging_has_fatal_flag(const vw_charging_t *charging)
{
    return (charging->master->charger.flags & FATAL) != 0u;
}

/* The voltage that no cell is charged beyond [100 uV]: configured, and with a margin below the trip. */
static int32_t vw_charging_compute_max_voltage(const vw_config_t *conf)
{
    int32_t below_trip = (int32_t)conf->v_cell_max - TRIP_MARGIN_COUNTS;
    return conf->v_cell_chrg < below_trip ? conf->v_cell_chrg : below_trip;
}

/* The target of the highest cell: lower, the more one count of current lifts this cell. Both phases aim at it, so
 * that a
 * current which is trimmed on the way there ends constant current all the same. */
static double vw_charging_compute_target_voltage(const vw_charging_t *charging)
{
    return (double)(vw_charging_compute_max_voltage(&charging->master->conf) - HEADROOM_COUNTS) - 0.5 * (charging->slope - CELL_SLOPE);
}

/* From where on it counts as held: one count more of current may not fit in between. */
static double vw_charging_compute_reached_voltage(const vw_charging_t *charging)
{
    return vw_charging_compute_target_voltage(charging) - (charging->slope - CELL_SLOPE);
}

static void vw_charging_set_request(vw_charging_t *charging, uint16_t v_set, uint16_t i_set,
                                    enum vw_charger_control control)
{
    vw_charger_t *charger = &charging->master->charger;
    charger->v_set = v_set;
    charger->i_set = i_set;
    charger->control = (uint8_t)control;
}

static bool vw_charging_enter_state(vw_charging_t *charging, enum vw_charger_state state, uint32_t now_ms)
{
    bool is_with_current = state == VW_CHARGER_STATE_CONSTANT_CURRENT || state == VW_CHARGER_STATE_CONSTANT_VOLTAGE;
    charging->is_active =
        is_with_current || state == VW_CHARGER_STATE_WAITING || state == VW_CHARGER_STATE_BALANCING;
    charging->since_ms = now_ms;
    charging->control_ms = now_ms;
    charging->is_full = false;
    vw_balance_stop(charging->balance);
    if (is_with_current) {
        (void)memcpy(charging->rest_v, charging->master->v, sizeof charging->rest_v);
    } else {
        charging->current = 0.0;
        vw_charging_set_request(charging, 0u, 0u, VW_CHARGER_CONTROL_STOP);
    }
    charging->state = state;
    charging->master->charger.state = (uint8_t)state;
    return true;
}

/* How much more the highest cell has risen than the median of all [100 uV]. */
static double vw_charging_compute_rise(const vw_charging_t *charging)
{
    const uint16_t *v = charging->master->v;
    int32_t sorted[VW_N_CELLS] = { 0 };
    int32_t of_highest;
    uint32_t i, k, highest = 0u;
    for (i = 0u; i < VW_N_CELLS; i++) {
        int32_t risen = (int32_t)v[i] - (int32_t)charging->rest_v[i];
        highest = v[i] > v[highest] ? i : highest;
        for (k = i; k > 0u && sorted[k - 1u] > risen; k--) {
            sorted[k] = sorted[k - 1u];
        }
        sorted[k] = risen;
    }
    of_highest = (int32_t)v[highest] - (int32_t)charging->rest_v[highest];
    return (double)of_highest - (double)(sorted[VW_N_CELLS / 2u - 1u] + sorted[VW_N_CELLS / 2u]) / 2.0;
}

/* A loose joint inside the span of one cell makes it many times stiffer than the others. */
static void vw_charging_update_slope(vw_charging_t *charging)
{
    uint16_t current = charging->master->charger.i_out;
    if (current < SLOPE_CURRENT && charging->is_slope_known) {
        return;
    }
    charging->is_slope_known = current >= SLOPE_CURRENT;
    if (current > 0u) {
        double more = vw_charging_compute_rise(charging);
        charging->slope = CELL_SLOPE + (more > 0.0 ? more : 0.0) / (double)current;
    } else {
        charging->slope = CELL_SLOPE + UNKNOWN_DECAY * (charging->slope - CELL_SLOPE);
    }
}

static double vw_charging_clamp(double value, double low, double high)
{
    double raised = value > low ? value : low;
    return raised < high ? raised : high;
}

/* Trim the asked current: an integrator on the highest cell's distance to its target. */
static void vw_charging_trim_current(vw_charging_t *charging, uint16_t v_max, uint32_t now_ms)
{
    const vw_config_t *conf = &charging->master->conf;
    int32_t string, highest_string;
    double missing, change = 0.0;
    if (!vw_is_due(now_ms, charging->control_ms)) {
        return;
    }
    charging->control_ms = now_ms + CONTROL_PERIOD_MS;
    vw_charging_update_slope(charging);
    missing = vw_charging_compute_target_voltage(charging) - (double)v_max;
    if (missing < 0.0) {
        change = missing * FALL_SHARE / charging->slope;
    } else if (missing > charging->slope) {
        change = missing * RISE_SHARE / charging->slope;
    } else {
        /* no count more fits in */
    }
    charging->current += vw_charging_clamp(change, -FALL_PER_PERIOD, RISE_PER_PERIOD);
    charging->current = vw_charging_clamp(charging->current, 0.0, (double)conf->i_chrg_max / 10.0);
    string = (int32_t)VW_N_CELLS * vw_charging_compute_max_voltage(conf) + STRING_MARGIN;
    highest_string = (int32_t)VW_N_CELLS * (int32_t)conf->v_cell_max + CABLE_MARGIN;
    string = string < highest_string ? string : highest_string;
    vw_charging_set_request(charging, (uint16_t)((string + PER_STRING_COUNT / 2) / PER_STRING_COUNT),
                            (uint16_t)charging->current,
        VW_CHARGER_CONTROL_CHARGE);
}

static bool vw_charging_step_constant_voltage(vw_charging_t *charging, uint16_t v_max, uint32_t now_ms)
{
    bool was_full = charging->is_full;
    vw_charging_trim_current(charging, v_max, now_ms);
    charging->is_full =
        (double)v_max >= vw_charging_compute_reached_voltage(charging) - FULL_COUNTS &&
         charging->master->charger.i_out < DONE_CURRENT;
    if (charging->is_full && !was_full) {
        charging->full_ms = now_ms;
    }
    return charging->is_full && was_full && (uint32_t)(now_ms - charging->full_ms) >= DONE_PERSISTENCE_MS
           && vw_charging_enter_state(charging, VW_CHARGER_STATE_DONE, now_ms);
}

void vw_charging_init(vw_charging_t *charging, vw_master_t *master, vw_balance_t *balance)
{
    (void)memset(charging, 0, sizeof *charging);
    charging->master = master;
    charging->balance = balance;
    charging->slope = UNKNOWN_SLOPE;
    charging->state = VW_CHARGER_STATE_OFF;
    master->charger.state = (uint8_t)VW_CHARGER_STATE_OFF;
    vw_charging_set_request(charging, 0u, 0u, VW_CHARGER_CONTROL_STOP);
}

bool vw_charging_start(vw_charging_t *charging, uint32_t now_ms)
{
    if (charging->is_active) {
        return false;
    }
    charging->slope = UNKNOWN_SLOPE;
    charging->is_slope_known = false;
    return vw_charging_enter_state(charging, VW_CHARGER_STATE_WAITING, now_ms);
}

bool vw_charging_stop(vw_charging_t *charging, bool is_fault, uint32_t now_ms)
{
    if (charging->state == VW_CHARGER_STATE_OFF || (is_fault && !charging->is_active)) {
        return false;
    }
    return vw_charging_enter_state(charging, is_fault ? VW_CHARGER_STATE_FAULT : VW_CHARGER_STATE_OFF, now_ms);
}

bool vw_charging_step(vw_charging_t *charging, bool is_charger_alive, uint16_t v_max, uint32_t now_ms)
{
    bool is_charger_well = is_charger_alive && !vw_charging_has_fatal_flag(charging);
    bool has_changed = false;
    switch (charging->state) {
    case VW_CHARGER_STATE_WAITING:
        has_changed = is_charger_well && vw_charging_enter_state(charging, VW_CHARGER_STATE_CONSTANT_CURRENT, now_ms);
        break;
    case VW_CHARGER_STATE_CONSTANT_CURRENT:
        if (!is_charger_well) {
            has_changed = vw_charging_stop(charging, true, now_ms);
        } else if ((double)v_max >= vw_charging_compute_reached_voltage(charging)) {
            has_changed = vw_charging_enter_state(charging, VW_CHARGER_STATE_BALANCING, now_ms);
        } else {
            vw_charging_trim_current(charging, v_max, now_ms);
        }
        break;
    case VW_CHARGER_STATE_BALANCING:
        if (!is_charger_well) {
            has_changed = vw_charging_stop(charging, true, now_ms);
        } else if ((uint32_t)(now_ms - charging->since_ms) >= SETTLE_MS
                   && !vw_balance_choose(charging->balance, charging->master->conf.balance_threshold,
                                         charging->master->v)) {
            has_changed = vw_charging_enter_state(charging, VW_CHARGER_STATE_CONSTANT_VOLTAGE, now_ms);
        } else {
            /* cells are bled, or rest first */
        }
        break;
    case VW_CHARGER_STATE_CONSTANT_VOLTAGE:
        has_changed = is_charger_well ? vw_charging_step_constant_voltage(charging, v_max,
            now_ms) : vw_charging_stop(charging, true, now_ms);
        break;
    default: /* nothing is charged */
        break;
    }
    return has_changed;
}
