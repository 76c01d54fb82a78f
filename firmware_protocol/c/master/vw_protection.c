#include "vw_protection.h"

#include <string.h>

typedef struct {
    uint8_t n;
    vw_event_t event[VW_N_TRIPS];
    uint16_t persistence_ms[VW_N_TRIPS];
} violations_t;

static void vw_protection_add_violation(violations_t *found, enum vw_event code, uint16_t persistence_ms,
                                        uint16_t cell, int32_t value,
                int32_t limit)
{
    vw_event_t *event = &found->event[found->n];
    event->code = (uint8_t)code;
    event->argument = 0u;
    event->cell = cell;
    event->value = value;
    event->limit = limit;
    found->persistence_ms[found->n] = persistence_ms;
    found->n++;
}

static void vw_protection_find_cell_violations(violations_t *found, const vw_config_t *conf, const vw_reading_t *is)
{
    if (is->v_min < conf->v_cell_min) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_V_MIN, VW_FAST_PERSISTENCE_MS, is->v_min_id, is->v_min,
                                    conf->v_cell_min);
    }
    if (is->v_max > conf->v_cell_max) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_V_MAX, VW_FAST_PERSISTENCE_MS, is->v_max_id, is->v_max,
                                    conf->v_cell_max);
    }
    if (is->t_min < conf->t_cell_min) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_T_MIN, VW_SLOW_PERSISTENCE_MS, is->t_min_id, is->t_min,
                                    conf->t_cell_min);
    }
    if (is->t_max > conf->t_cell_max) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_T_MAX, VW_SLOW_PERSISTENCE_MS, is->t_max_id, is->t_max,
                                    conf->t_cell_max);
    }
}

/* What the mean of the current leaves of the time: its buffers, and one more, in which the violation began. */
static uint16_t vw_protection_current_persistence_ms(const vw_config_t *conf)
{
    uint32_t ts = conf->ts;
    uint32_t n_buffers = conf->fc_avg > 0 ? ((uint32_t)conf->fc_avg + ts - 1u) / ts : 1u;
    uint32_t takes = VW_PASS_MS + (n_buffers + 1u) * ts;
    uint32_t left = takes < VW_CURRENT_ALLOWED_MS ? VW_CURRENT_ALLOWED_MS - takes : 0u;
    return (uint16_t)(left < VW_FAST_PERSISTENCE_MS ? left : VW_FAST_PERSISTENCE_MS);
}

static void vw_protection_find_current_violations(violations_t *found, const vw_config_t *conf, const vw_reading_t *is)
{
    enum vw_event code = is->is_charging ? VW_EVENT_TRIP_I_CHRG : VW_EVENT_TRIP_I_DISC;
    int32_t value = is->is_charging ? -is->i_fc : is->i_fc;
    int32_t tolerance = is->is_charging ? VW_CHARGE_TOLERANCE : 0;
    int32_t highest = is->is_charging ? conf->i_chrg_max : conf->i_disc_max;
    int32_t lowest = is->is_charging ? conf->i_chrg_min : conf->i_disc_min;
    if (value > highest + tolerance) {
        vw_protection_add_violation(found, code, vw_protection_current_persistence_ms(conf), VW_NO_OFFSET, value,
                                    highest);
    } else if (value < lowest - tolerance) {
        vw_protection_add_violation(found, code, vw_protection_current_persistence_ms(conf), VW_NO_OFFSET, value,
                                    lowest);
    } else {
        /* inside both */
    }
}

static void vw_protection_find_lost_sensors(violations_t *found, const vw_reading_t *is)
{
    if (is->lost_slave != VW_NONE) {
        uint16_t first = (uint16_t)(is->lost_slave * VW_CELLS_PER_PACK);
        vw_protection_add_violation(found, VW_EVENT_TRIP_SLAVE_LOST, VW_FAST_PERSISTENCE_MS, first, 0, 0);
    }
    if (is->lost_cell != VW_NONE) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_SENSOR_LOST, VW_WIRE_PERSISTENCE_MS, is->lost_cell, 0, 0);
    } else if (is->is_current_lost) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_SENSOR_LOST, VW_FAST_PERSISTENCE_MS, VW_NO_OFFSET, 0, 0);
    } else if (is->lost_temperature != VW_NONE) {
        vw_protection_add_violation(found, VW_EVENT_TRIP_SENSOR_LOST, VW_SENSOR_PERSISTENCE_MS,
                                    is->lost_temperature, 0, 0);
    } else {
        /* every sensor is read */
    }
}

void vw_protection_init(vw_protection_t *protection, bool is_open)
{
    (void)memset(protection, 0, sizeof *protection);
    protection->is_open = is_open;
}

uint8_t vw_protection_check(vw_protection_t *protection, const vw_config_t *conf, const vw_reading_t *reading,
                            uint32_t now_ms, vw_event_t trips[VW_N_TRIPS])
{
    violations_t found;
    uint8_t i, before = protection->critical, n_trips = 0u;
    found.n = 0u;
    vw_protection_find_cell_violations(&found, conf, reading);
    vw_protection_find_current_violations(&found, conf, reading);
    vw_protection_find_lost_sensors(&found, reading);
    protection->critical = 0u;
    for (i = 0u; i < found.n; i++) {
        uint8_t watch = (uint8_t)(found.event[i].code - (uint8_t)VW_EVENT_TRIP_V_MIN);
        uint8_t bit = (uint8_t)(1u << watch);
        protection->critical |= bit;
        if ((before & bit) == 0u) {
            protection->since_ms[watch] = now_ms;
        }
        if ((protection->tripped & bit) == 0u
            && (uint32_t)(now_ms - protection->since_ms[watch]) >= found.persistence_ms[i]) {
            protection->tripped |= bit;
            protection->is_open = true;
            trips[n_trips] = found.event[i];
            n_trips++;
        }
    }
    return n_trips;
}

bool vw_protection_clear(vw_protection_t *protection)
{
    if (protection->critical != 0u) {
        return false;
    }
    protection->tripped = 0u;
    protection->is_open = false;
    return true;
}
