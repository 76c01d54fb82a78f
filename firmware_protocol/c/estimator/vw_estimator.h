/* The state of charge on the master: Voltwall's estimator over the cells of the struct, which fills `soc` and `ocv`.
 *
 *     vw_estimator_init(&estimator);                                   once
 *     vw_estimator_run(&estimator, &vw_memory, HAL_GetTick());         after each measurement of all cells
 *
 * The first run, and the first after SET_SOC, is a start, which takes as long as 17 others. It is spread: while a run
 * returns true call it again, after whatever else cannot wait.
 *
 * Compile it with the engine, `app/estimation/filters/engine/vw_*.c`, and with -DVW_SINGLE -DVW_LANES=1 -DVW_RC_MAX=3
 * (one more than your cell has RC pairs). The cell is `generated/vw_cell_of_team.h`; write your own from a cell file with
 * `voltwall firmware --cell`. Missing voltages and temperatures are those of the struct.
 */
#ifndef VW_ESTIMATOR_H
#define VW_ESTIMATOR_H

#include <stdbool.h>

#include "../generated/voltwall_protocol.h"
#include "vw_filter.h"

#define VW_START_CELLS 12 /* computed in a run while the filter starts: a slave's */

typedef struct {
    vw_filter filter;
    vw_cells cells[VW_BLOCKS(VW_N_CELLS)];
    vw_real voltage_v[VW_N_CELLS];
    vw_real temperature_degc[VW_N_CELLS];
    vw_real estimates[VW_ESTIMATES * VW_N_CELLS]; /* of the last step: rows of vw_filter.h */
    vw_real current_a, known_soc; /* of the start; NaN: not known */
    uint32_t stepped_ms;
    int32_t n_started; /* cells */
} vw_estimator_t;

void vw_estimator_init(vw_estimator_t *estimator);

/* Estimate from the measurements in the struct; `soc` becomes the mean of the cells, `ocv` each cell's own.
 * Returns true while a start has not come to its end: call again. Until then `soc` and `ocv` are what they were. */
bool vw_estimator_run(vw_estimator_t *estimator, vw_master_t *master, uint32_t now_ms);

/* Start anew at the next measurement, with a SOC that is known (1e-4), as by the command SET_SOC. */
void vw_estimator_set_soc(vw_estimator_t *estimator, uint16_t soc);

#endif
