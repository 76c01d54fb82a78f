/* What a real firmware measures, made up: 96 cells at rest in the struct; and the master over it. */
#ifndef BATTERY_H
#define BATTERY_H

#include "../estimator/vw_estimator.h"
#include "../master/vw_master.h"

typedef struct {
    vw_master_t *memory;
    vw_master_task_t task;
    vw_estimator_t estimator; /* fills `soc` and `ocv` */
    bool is_driving; /* the driver asks for it: the relays close */
    int32_t current_sum; /* of the samples of 1 ms since the last mean */
    uint16_t n_samples;
    uint32_t sampled_ms;
} battery_t;

/* After vw_link_init, with its link; `is_latched`: the latch is open from before the restart. */
void battery_init(battery_t *battery, vw_link_t *link, bool is_driving, bool is_latched);

/* Every 20 ms: new measurements, judged. */
void battery_measure(battery_t *battery, uint32_t now_ms);

/* The commands, for a board whose context points at `battery`. */
enum vw_result battery_command(battery_t *battery, uint8_t command, int32_t argument);

#endif
