#include "vw_estimator.h"

#include <string.h>

#include "generated/vw_cell_of_team.h"

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
    estimator->known_soc = NAN;
    vw_filter_init(&estimator->filter, estimator->cells);
}

static void vw_estimator_fill_measurement(vw_estimator_t *estimator, const vw_master_t *master)
{
    for (uint32_t k = 0; k < VW_N_CELLS; k++) {
        estimator->voltage_v[k] = (vw_real)master->v[k] * PER_V;
        estimator->temperature_degc[k] = master->t[k] == NO_TEMPERATURE ? NAN : (vw_real)master->t[k];
    }
    estimator->current_a = (vw_real)master->i_fs * PER_A;
}

static vw_sample vw_estimator_make_sample(const vw_estimator_t *estimator, uint32_t dt_ms)
{
    const vw_sample sample = { (vw_real)dt_ms / 1000, estimator->current_a, estimator->voltage_v,
                               estimator->temperature_degc };
    return sample;
}

/* Rounded, in units of 1e-4. */
static uint16_t vw_estimator_convert_units(vw_real value)
{
    return (uint16_t)(value * 10000 + (vw_real)0.5);
}

static void vw_estimator_publish_state(const vw_estimator_t *estimator, vw_master_t *master)
{
    const vw_real *soc = &estimator->estimates[VW_SOC * VW_N_CELLS];
    const vw_real *ocv_v = &estimator->estimates[VW_OCV_V * VW_N_CELLS];
    vw_real sum = 0;
    for (uint32_t k = 0; k < VW_N_CELLS; k++) {
        master->ocv[k] = vw_estimator_convert_units(ocv_v[k]);
        sum += soc[k];
    }
    master->soc = vw_estimator_convert_units(sum / VW_N_CELLS);
}

/* The next cells of a start, all from the sample that it began with. */
static void vw_estimator_start_pack(vw_estimator_t *estimator)
{
    const vw_sample sample = vw_estimator_make_sample(estimator, 0u);
    vw_real *known = estimator->estimates; /* not in use before the first step */
    for (uint32_t k = 0; k < VW_N_CELLS; k++) known[k] = estimator->known_soc;
    vw_filter_start_part(&estimator->filter, estimator->cells, &sample, known, NULL, estimator->n_started / VW_LANES,
                         VW_BLOCKS(VW_START_CELLS));
    estimator->n_started += VW_BLOCKS(VW_START_CELLS) * VW_LANES;
}

bool vw_estimator_run(vw_estimator_t *estimator, vw_master_t *master, uint32_t now_ms)
{
    const bool is_starting = estimator->n_started < (int32_t)VW_N_CELLS;
    if (!is_starting || estimator->n_started == 0) vw_estimator_fill_measurement(estimator, master);
    if (estimator->n_started == 0) estimator->stepped_ms = now_ms;
    if (is_starting) {
        vw_estimator_start_pack(estimator);
        return true;
    }
    const vw_sample sample = vw_estimator_make_sample(estimator, now_ms - estimator->stepped_ms);
    vw_filter_step(&estimator->filter, estimator->cells, &sample, estimator->estimates);
    estimator->stepped_ms = now_ms;
    vw_estimator_publish_state(estimator, master);
    return false;
}

void vw_estimator_set_soc(vw_estimator_t *estimator, uint16_t soc)
{
    estimator->known_soc = (vw_real)soc / 10000;
    estimator->n_started = 0;
}
