#include "vw_relays.h"

static void vw_relays_enter_state(vw_relays_t *relays, vw_relay_state_t state, uint32_t now_ms)
{
    if (state != relays->state) {
        relays->state = state;
        relays->since_ms = now_ms;
    }
}

void vw_relays_init(vw_relays_t *relays, uint32_t now_ms)
{
    relays->state = VW_RELAYS_OPEN;
    relays->since_ms = now_ms;
    relays->has_failed = false;
}

void vw_relays_retry(vw_relays_t *relays)
{
    relays->has_failed = false;
}

vw_relay_state_t vw_relays_step(vw_relays_t *relays, const vw_relay_inputs_t *inputs, uint32_t now_ms)
{
    if (!inputs->is_drive_asked) {
        relays->has_failed = false;
    }
    if (inputs->is_ok && inputs->is_charging) {
        vw_relays_enter_state(relays, VW_RELAYS_CHARGER, now_ms);
    } else if (!inputs->is_ok || !inputs->is_drive_asked || relays->has_failed) {
        vw_relays_enter_state(relays, VW_RELAYS_OPEN, now_ms);
    } else if (relays->state == VW_RELAYS_OPEN || relays->state == VW_RELAYS_CHARGER) {
        vw_relays_enter_state(relays, VW_RELAYS_PRECHARGE, now_ms);
    } else if (relays->state == VW_RELAYS_VEHICLE) {
        /* stays closed */
    } else if (inputs->link_permille >= VW_PRECHARGED_PERMILLE) {
        vw_relays_enter_state(relays, VW_RELAYS_VEHICLE, now_ms);
    } else if ((uint32_t)(now_ms - relays->since_ms) >= VW_PRECHARGE_LIMIT_MS) {
        relays->has_failed = true;
        vw_relays_enter_state(relays, VW_RELAYS_OPEN, now_ms);
    } else {
        /* pre-charging goes on */
    }
    return relays->state;
}
