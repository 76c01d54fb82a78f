/* The OK signal: limits with persistence, latched until cleared. A reference to compare yours with, not a certified
 * part.
 *
 * FS rules EV 5.8.7: 500 ms for voltage and current, 1 s for temperature, counted from the violation. The persistence
 * is
 * what measuring and filtering leave of those times. A lost measurement is critical like a passed limit.
 */
#ifndef VW_PROTECTION_H
#define VW_PROTECTION_H

#include <stdbool.h>

#include "../vw_messages.h"

#define VW_NONE 0xFFu                 /* no cell, no slave */
#define VW_CHARGE_TOLERANCE 100       /* 1 A [10 mA]: the sensor's accuracy, so that the asked current does not trip */
#define VW_FAST_PERSISTENCE_MS 300u
#define VW_PASS_MS 20u
#define VW_CURRENT_ALLOWED_MS 400u /* to the OK signal; the relays, and who has to show it, get the rest of the 500 */
#define VW_SLOW_PERSISTENCE_MS 400u   /* of a temperature's limit */
#define VW_WIRE_PERSISTENCE_MS 500u   /* of a lost cell: on a disturbed line it may come back */
#define VW_SENSOR_PERSISTENCE_MS 1000u /* of a lost temperature */
#define VW_N_TRIPS 8u                 /* VW_EVENT_TRIP_V_MIN to VW_EVENT_TRIP_SENSOR_LOST */

/* What is judged, in counts of the struct. Without any known cell the lowest is above every limit, the highest below.
 * */
typedef struct {
    uint16_t v_min;
    uint16_t v_max;
    int8_t t_min;
    int8_t t_max;
    uint8_t v_min_id;
    uint8_t v_max_id;
    uint8_t t_min_id;
    uint8_t t_max_id;
    int32_t i_fc; /* within +-2^30 */
    bool is_charging;
    bool is_current_lost;
    uint8_t lost_cell; /* a cell without a voltage though its slave answers; VW_NONE */
    uint8_t lost_temperature;
    uint8_t lost_slave;
} vw_reading_t;

typedef struct {
    uint32_t since_ms[VW_N_TRIPS]; /* when each began, where `critical` has its bit */
    uint8_t critical;              /* violated now: one bit for each trip */
    uint8_t tripped;               /* reported, and not cleared since */
    bool is_open;                  /* the latch: the OK signal is off */
} vw_protection_t;

/* `is_open`: how the flip-flop in the shutdown circuit stands; no restart of the firmware resets it (EV 6.1.6). */
void vw_protection_init(vw_protection_t *protection, bool is_open);

/* Judge a reading: how many trips have not been reported yet, and what they are. */
uint8_t vw_protection_check(vw_protection_t *protection, const vw_config_t *conf, const vw_reading_t *reading,
                            uint32_t now_ms, vw_event_t trips[VW_N_TRIPS]);

/* Close the latch; false while a limit is violated. */
bool vw_protection_clear(vw_protection_t *protection);

#endif
