/* The accumulator's relays: open, pre-charging, closed onto the vehicle or onto the charger. */
#ifndef VW_RELAYS_H
#define VW_RELAYS_H

#include <stdbool.h>
#include <stdint.h>

#define VW_PRECHARGED_PERMILLE 950u  /* of the accumulator's voltage, before the second relay closes (EV 5.7.1) */
#define VW_PRECHARGE_LIMIT_MS 3000u  /* ten time constants: what is not charged by then never will be */

typedef enum { VW_RELAYS_OPEN, VW_RELAYS_PRECHARGE, VW_RELAYS_VEHICLE, VW_RELAYS_CHARGER } vw_relay_state_t;

typedef struct {
    vw_relay_state_t state;
    uint32_t since_ms; /* in this state */
    bool has_failed;   /* a pre-charge, not tried again before the driver asks anew: each try heats the resistor */
} vw_relays_t;

typedef struct {
    bool is_ok; /* the OK signal, and the rest of the shutdown circuit */
    bool is_drive_asked;
    bool is_charging;
    uint16_t link_permille; /* the link's voltage over the accumulator's */
} vw_relay_inputs_t;

void vw_relays_init(vw_relays_t *relays, uint32_t now_ms);
vw_relay_state_t vw_relays_step(vw_relays_t *relays, const vw_relay_inputs_t *inputs, uint32_t now_ms);

/* Allow another try after a failed pre-charge: faults have been cleared. */
void vw_relays_retry(vw_relays_t *relays);

#endif
