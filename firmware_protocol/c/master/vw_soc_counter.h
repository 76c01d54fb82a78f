/* The Coulomb counter: charge drawn since full in whole uAh and a remainder, started from the voltage at rest.
 *
 * The start table is what one reads off a data sheet: 21 points, no temperature, no hysteresis. The estimator knows more.
 */
#ifndef VW_SOC_COUNTER_H
#define VW_SOC_COUNTER_H

#include <stdbool.h>

#include "../generated/voltwall_protocol.h"

#define VW_REST_CURRENT 200 /* 2 A [10 mA]: below, the voltage is taken for that at rest */

typedef struct {
    uint32_t dod; /* [uAh] */
    uint16_t rest; /* beyond it [1/360 uAh, which is 10 mA for 1 ms] */
    bool is_started;
} vw_soc_counter_t;

void vw_soc_counter_init(vw_soc_counter_t *counter);

/* Start, also anew, from the mean cell voltage [100 uV]; false without one, or where a current [10 mA] flows. */
bool vw_soc_counter_from_rest(vw_soc_counter_t *counter, const vw_config_t *conf, uint16_t v_avg, int32_t i_fc);

/* Start from a stored count [uAh], or from a known state of charge [0.01 %]. */
void vw_soc_counter_from_journal(vw_soc_counter_t *counter, uint32_t dod);
void vw_soc_counter_set(vw_soc_counter_t *counter, const vw_config_t *conf, uint16_t soc);

/* Count a mean of the current [10 mA] over so many samples of 1 ms; it stays between full and empty. */
void vw_soc_counter_count(vw_soc_counter_t *counter, const vw_config_t *conf, int32_t mean, uint16_t n_samples);

/* The state of charge [0.01 %]; 0 before the start. */
uint16_t vw_soc_counter_soc(const vw_soc_counter_t *counter, const vw_config_t *conf);

#endif
