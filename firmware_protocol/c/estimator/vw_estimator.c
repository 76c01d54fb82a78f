#include "vw_estimator.h"

#include <string.h>

#include "vw_cell_of_team.h"

#define PER_V ((vw_real)1e-4)     /* a voltage of the struct is in 100 uV */
#define PER_A ((vw_real)1e-2)     /* a current in 10 mA */
#define NO_TEMPERATURE (-128)     /* not measured */

void vw_estimator_init(vw_estimator_t *estimator)
{
    memset(estimator, 0, sizeof *estimator);
    estimator->filter.n_cells = VW_N_CELLS;
    estimator->filter.kind = VW_SIGMA_FUSED;
    estimator->filter.rule = vw_rule_of_team;
    estimator->filter.tuning = vw_tuning_of_team;
    estimator->filter.model = vw_cell_model_of_team;
    vw_filter_init(&estimator->filter, estimator->cells);
}

static vw_sample measured(vw_estimator_t *estimator, const vw_master_t *master, uint32_t dt_ms)
{
    vw_sample sample;
    for (uint32_t k = 0; k < VW_N_CELLS; k++) {
        estimator->voltage_v[k] = (vw_real)master->v[k] * PER_V;
        estimator->temperature_degc[k] = master->t[k] == NO_TEMPERATURE ? NAN : (vw_real)master->t[k];
    }
    sample.dt_s = (vw_real)dt_ms / 1000;
    sample.current_a = (vw_real)master->i_fs * PER_A;
    sample.voltage_v = estimator->voltage_v;
    sample.temperature_degc = estimator->temperature_degc;
    return sample;
}

/* Rounded, in units of 1e-4. */
static uint16_t in_units(vw_real value)
{
    return (uint16_t)(value * 10000 + (vw_real)0.5);
}

static void publish(const vw_estimator_t *estimator, vw_master_t *master)
{
    const vw_real *soc = &estimator->estimates[VW_SOC * VW_N_CELLS];
    const vw_real *ocv_v = &estimator->estimates[VW_OCV_V * VW_N_CELLS];
    vw_real sum = 0;
    for (uint32_t k = 0; k < VW_N_CELLS; k++) {
        master->ocv[k] = in_units(ocv_v[k]);
        sum += soc[k];
    }
    master->soc = in_units(sum / VW_N_CELLS);
}

void vw_estimator_run(vw_estimator_t *estimator, vw_master_t *master, uint32_t now_ms)
{
    const vw_sample sample = measured(estimator, master, estimator->is_started ? now_ms - estimator->stepped_ms : 0u);
    if (!estimator->is_started) {
        vw_filter_start(&estimator->filter, estimator->cells, &sample, NULL, NULL);
        estimator->is_started = true;
    }
    vw_filter_step(&estimator->filter, estimator->cells, &sample, estimator->estimates);
    estimator->stepped_ms = now_ms;
    publish(estimator, master);
}

void vw_estimator_set_soc(vw_estimator_t *estimator, vw_master_t *master, uint16_t soc)
{
    vw_sample sample = measured(estimator, master, 0u);
    vw_real known[VW_N_CELLS];
    for (uint32_t k = 0; k < VW_N_CELLS; k++) known[k] = (vw_real)soc / 10000;
    vw_filter_start(&estimator->filter, estimator->cells, &sample, known, NULL);
    vw_filter_step(&estimator->filter, estimator->cells, &sample, estimator->estimates);
    estimator->is_started = true;
    publish(estimator, master);
}
