#include "vw_cell_model.h"

/* x = sum_r clip((T - T_r) / (T_r+1 - T_r), 0, 1): whole part the row, the rest the weight of the next. */
void vw_place_temperature(const vw_cell_model *model, const vw_lanes temperature_degc, vw_temperature_place *place)
{
    const vw_real *grid = model->temperature_degc;
    const vw_real last = (vw_real)(model->n_temperatures > 1 ? model->n_temperatures - 2 : 0);
    vw_lanes x;
    VW_EACH_CELL(c) x[c] = 0;
    for (int r = 0; r + 1 < model->n_temperatures; r++) {
        const vw_real per_k = 1 / (grid[r + 1] - grid[r]);
        VW_EACH_CELL(c) x[c] += vw_clip((temperature_degc[c] - grid[r]) * per_k, 0, 1);
    }
    VW_EACH_CELL(c)
    {
        place->row[c] = (vw_real)(int32_t)vw_min(x[c], last);
        place->row_weight[c] = x[c] - place->row[c];
    }
}

void vw_doubt(const vw_cell_model *model, const vw_lanes temperature_degc, vw_lanes *doubt)
{
    const vw_real last = (vw_real)(model->n_doubt - 1), per_step = 1 / model->doubt_step_k;
    VW_EACH_CELL(c)
    {
        const vw_real x = vw_clip((temperature_degc[c] - model->doubt_low_degc) * per_step, 0, last);
        const int j = (int)vw_min(x, last - 1);
        const vw_real *here = model->doubt + j * VW_DOUBTS;
        for (int q = 0; q < VW_DOUBTS; q++)
            doubt[q][c] = here[q] + (x - (vw_real)j) * (here[VW_DOUBTS + q] - here[q]);
    }
}

/* Beyond the ends of the tables their last values hold. */
void vw_place_soc(const vw_cell_model *model, const vw_lanes soc, vw_soc_place *place)
{
    const vw_real low = model->soc_low, per_step = 1 / model->soc_step;
    const vw_real end = (vw_real)(model->n_soc - 1), last = (vw_real)(model->n_soc - 2);
    VW_EACH_CELL(c)
    {
        const vw_real x = vw_clip((soc[c] - low) * per_step, 0, end);
        place->column[c] = (int32_t)vw_min(x, last);
        place->weight[c] = x - (vw_real)place->column[c];
    }
}

/* Linear in SOC at both temperatures, then linear between them. The numbers at a point of the table are neighbours in
 * memory, so `width` of them are computed at a time, cell after cell, and turned into rows of cells in the end. */
static inline void interpolate(const vw_cell_model *model, const vw_real *table, const int width,
                               const vw_temperature_place *restrict at, const vw_soc_place *restrict soc,
                               vw_lanes *restrict values)
{
    const int32_t n_soc = model->n_soc, warmer = model->n_temperatures > 1 ? n_soc * width : 0;
    int32_t place[VW_LANES];
    vw_real found[VW_LANES * VW_COLUMNS_MAX];
    VW_EACH_CELL(c) place[c] = ((int32_t)at->row[c] * n_soc + soc->column[c]) * width;
    VW_EACH_CELL(c)
    {
        const vw_real *cool = table + place[c], *warm = cool + warmer;
        const vw_real f = soc->weight[c], g = at->row_weight[c];
        for (int q = 0; q < width; q++) {
            const vw_real at_cool = cool[q] + f * (cool[width + q] - cool[q]);
            const vw_real at_warm = warm[q] + f * (warm[width + q] - warm[q]);
            found[c * width + q] = at_cool + g * (at_warm - at_cool);
        }
    }
    for (int q = 0; q < width; q++)
        VW_EACH_CELL(c) values[q][c] = found[c * width + q];
}

void vw_circuit(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc, vw_lanes *values)
{
    /* with a width that the compiler knows the numbers of a point are one vector */
    if (VW_LANES > 1 && model->width == 4) interpolate(model, model->table, 4, at, soc, values);
    else if (VW_LANES > 1 && model->width == 8) interpolate(model, model->table, 8, at, soc, values);
    else interpolate(model, model->table, model->width, at, soc, values);
}

void vw_circuit_slope(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                      vw_lanes *slopes)
{
    const int width = model->width, n_soc = model->n_soc, n_columns = vw_columns(model);
    const vw_real per_step = 1 / model->soc_step;
    VW_EACH_CELL(c)
    {
        const int j = soc->column[c];
        const vw_real *here = model->table + ((int32_t)at->row[c] * n_soc + j) * width;
        const vw_real *above = model->n_temperatures > 1 ? here + n_soc * width : here;
        const vw_real f = soc->weight[c], g = at->row_weight[c];
        slopes[VW_OCV][c] = model->ocv_slope_v[j] + f * (model->ocv_slope_v[j + 1] - model->ocv_slope_v[j]);
        for (int q = VW_R0; q < n_columns; q++) {
            const vw_real cool = here[width + q] - here[q], warm = above[width + q] - above[q];
            slopes[q][c] = (cool + g * (warm - cool)) * per_step;
        }
    }
}

void vw_time_constants(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                       vw_lanes *tau_s)
{
    if (model->has_tau_table) {
        interpolate(model, model->tau_s, model->n_rc, at, soc, tau_s);
        return;
    }
    for (int k = 0; k < model->n_rc; k++)
        VW_EACH_CELL(c) tau_s[k][c] = model->tau_s[k];
}

/* OCV at point j of the table, linear between the temperatures. */
static vw_real ocv_at(const vw_cell_model *model, const vw_temperature_place *at, int c, int j)
{
    const int width = model->width;
    const vw_real *here = model->table + ((int32_t)at->row[c] * model->n_soc + j) * width;
    const vw_real *above = model->n_temperatures > 1 ? here + model->n_soc * width : here;
    return here[VW_OCV] + at->row_weight[c] * (above[VW_OCV] - here[VW_OCV]);
}

void vw_ocv(const vw_cell_model *model, const vw_temperature_place *restrict at, const vw_soc_place *restrict soc,
            vw_lanes ocv_v)
{
    const int32_t n_soc = model->n_soc, width = model->width;
    const vw_real *cool = model->table + VW_OCV, *cool_next = cool + width;
    const vw_real *warm = cool + (model->n_temperatures > 1 ? n_soc * width : 0), *warm_next = warm + width;
    VW_EACH_CELL(c)
    {
        const int32_t k = ((int32_t)at->row[c] * n_soc + soc->column[c]) * width;
        const vw_real at_cool = cool[k] + soc->weight[c] * (cool_next[k] - cool[k]);
        const vw_real at_warm = warm[k] + soc->weight[c] * (warm_next[k] - warm[k]);
        ocv_v[c] = at_cool + at->row_weight[c] * (at_warm - at_cool);
    }
}

void vw_reading_slope(const vw_cell_model *model, const vw_soc_place *restrict soc, vw_lanes slope_v)
{
    const vw_real *here = model->reading_slope_v, *next = here + 1;
    VW_EACH_CELL(c)
    {
        const int j = soc->column[c];
        slope_v[c] = here[j] + soc->weight[c] * (next[j] - here[j]);
    }
}

vw_real vw_ocv_of(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc)
{
    const vw_real end = (vw_real)(model->n_soc - 1), last = (vw_real)(model->n_soc - 2);
    const vw_real x = vw_clip((soc - model->soc_low) / model->soc_step, 0, end);
    const int j = (int)vw_min(x, last);
    const vw_real low_v = ocv_at(model, at, c, j);
    return low_v + (x - (vw_real)j) * (ocv_at(model, at, c, j + 1) - low_v);
}

/* The last point that does not lie above the voltage, by bisection; the OCV never falls. */
vw_real vw_soc_of_ocv(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real voltage_v)
{
    int below = 0, above = model->n_soc - 1;
    while (above - below > 1) {
        const int middle = (below + above) / 2;
        if (ocv_at(model, at, c, middle) <= voltage_v) below = middle;
        else above = middle;
    }
    const vw_real low_v = ocv_at(model, at, c, below), high_v = ocv_at(model, at, c, above);
    const vw_real weight = high_v > low_v ? (voltage_v - low_v) / (high_v - low_v) : 0;
    const vw_real soc = model->soc_low + model->soc_step * ((vw_real)below + weight);
    return vw_clip(soc, (vw_real)-0.05, (vw_real)1.05);
}

/* The farther of both sides: at the foot of a step of the OCV the near one says little. */
vw_real vw_reading_sigma(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc,
                         vw_real sigma_v)
{
    const vw_real ocv_v = vw_ocv_of(model, at, c, soc);
    const vw_real above = vw_soc_of_ocv(model, at, c, ocv_v + sigma_v) - soc;
    const vw_real below = soc - vw_soc_of_ocv(model, at, c, ocv_v - sigma_v);
    return vw_max(vw_max(above, below), (vw_real)1e-3);
}
