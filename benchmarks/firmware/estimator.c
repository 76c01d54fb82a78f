/* Counts instructions of the estimator on an emulated Cortex-M4F: N_CELLS cells, a race's current. */
#include "bare_metal.h"
#include "vw_filter.h"
#include "generated/vw_cell_of_team.h"

#ifndef N_CELLS
#define N_CELLS 96
#endif

#define SLAVE_CELLS 12

static vw_filter filter;
static vw_cells cells[VW_BLOCKS(N_CELLS)];
static vw_real voltage_v[N_CELLS], temperature_degc[N_CELLS], estimates[VW_ESTIMATES * N_CELLS];

int main(void)
{
    vw_sample sample = { .dt_s = 0.1f, .current_a = 40.0f };
    sample.voltage_v = voltage_v;
    sample.temperature_degc = temperature_degc;
    filter.n_cells = N_CELLS;
    filter.kind = VW_SIGMA_FUSED;
    filter.rule = vw_rule_of_team;
    filter.tuning = vw_tuning_of_team;
    filter.model = vw_cell_model_of_team;
    for (int c = 0; c < N_CELLS; c++) {
        voltage_v[c] = 3.7f + 0.001f * (vw_real)(c % 7);
        temperature_degc[c] = 25.0f + (vw_real)(c % 11);
    }
    calibrate();
    print_number("size of state", sizeof filter + sizeof cells);
    print_number("size of sample and answer", sizeof voltage_v + sizeof temperature_degc + sizeof estimates);
    vw_filter_init(&filter, cells);
    int first = 0;
    for (; first + SLAVE_CELLS < N_CELLS; first += SLAVE_CELLS)
        vw_filter_start_part(&filter, cells, &sample, NULL, NULL, first, SLAVE_CELLS);
    MEASURE("vw_filter_start_part", vw_filter_start_part(&filter, cells, &sample, NULL, NULL, first, SLAVE_CELLS));
    MEASURE("vw_filter_start", vw_filter_start(&filter, cells, &sample, NULL, NULL));
    for (int k = 0; k < 20; k++) vw_filter_step(&filter, cells, &sample, estimates);
    MEASURE("vw_filter_step", vw_filter_step(&filter, cells, &sample, estimates));
    finish();
    return 0;
}
