/* What a real firmware measures, made up: 96 cells at rest in the struct, faults on request, and the commands. */
#ifndef BATTERY_H
#define BATTERY_H

#include "../estimator/vw_estimator.h"
#include "../vw_link.h"
#include "protection.h"

typedef struct {
    vw_master_t *master;
    vw_link_t *link;
    vw_estimator_t estimator; /* fills `soc` and `ocv` */
    int32_t current_sum; /* of the samples of 1 ms since the last mean */
    uint16_t n_samples;
    uint32_t sampled_ms;
    bool is_driving; /* relays closed: configuration and most commands are refused */
    faults_t faults;
    protection_t protection;
} battery_t;

void battery_init(battery_t *battery, vw_master_t *master, vw_link_t *link, bool is_driving);

/* Every 20 ms: new measurements, judged; true when the protection has just opened the circuit. */
bool battery_measure(battery_t *battery, uint32_t now_ms);

/* Begin or end charging as a charger on CAN says, where the configuration lets it; before each measurement. */
void battery_follow_charger(battery_t *battery, enum vw_charge charge);

bool battery_may_configure(const battery_t *battery);

/* The commands, for a board whose context points at `battery`. */
enum vw_result battery_command(battery_t *battery, uint8_t command, int32_t argument);

#endif
