/* Charging: constant current, a pause in which the cells are balanced, constant voltage, done.
 *
 * The charger holds a voltage of the whole string, the master knows the cells: in constant voltage it trims the current
 * once a second so that the highest cell, not the string, stands at `v_cell_chrg`. What is asked goes into `charger` of the
 * struct, which the CAN tables carry. In double precision; on a Cortex-M4 that is software, once a second.
 */
#ifndef VW_CHARGING_H
#define VW_CHARGING_H

#include <stdbool.h>

#include "../generated/voltwall_protocol.h"
#include "vw_balance.h"

typedef struct {
    vw_master_t *master;
    vw_balance_t *balance;
    enum vw_charger_state state; /* the struct's copy may be overwritten by a message of CAN */
    bool is_active; /* the charge relays are closed */
    bool is_slope_known;
    bool is_full; /* since full_ms */
    uint32_t since_ms; /* in this state */
    uint32_t control_ms; /* when the current is trimmed next */
    uint32_t full_ms;
    double current; /* asked [0.1 A] */
    double slope; /* what the highest cell rises with the current [100 uV per 0.1 A] */
    uint16_t rest_v[VW_N_CELLS]; /* before the current rose [100 uV] */
} vw_charging_t;

/* Functions that return a bool: whether `state` changed, for VW_EVENT_CHARGER_STATE. */
void vw_charging_init(vw_charging_t *charging, vw_master_t *master, vw_balance_t *balance);

/* Start; a status message of the charger must arrive first. */
bool vw_charging_start(vw_charging_t *charging, uint32_t now_ms);

/* Stop, on request or because of a fault. */
bool vw_charging_stop(vw_charging_t *charging, bool is_fault, uint32_t now_ms);

/* A pass; `v_max` is the highest cell [100 uV]. */
bool vw_charging_step(vw_charging_t *charging, bool is_charger_alive, uint16_t v_max, uint32_t now_ms);

#endif
