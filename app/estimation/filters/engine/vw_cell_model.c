#include "vw_cell_model.h"

/* x = sum_r clip((T - T_r) / (T_r+1 - T_r), 0, 1): whole part the row, the rest the weight of the next. */
void vw_cell_model_place_temperature(const vw_cell_model *model, const vw_lanes temperature_degc,
                                     vw_temperature_place *place)
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

void vw_cell_model_read_uncertainty(const vw_cell_model *model, const vw_lanes temperature_degc, vw_lanes *uncertainty)
{
    const vw_real last = (vw_real)(model->n_uncertainty - 1), per_step = 1 / model->uncertainty_step_k;
    VW_EACH_CELL(c)
    {
        const vw_real x = vw_clip((temperature_degc[c] - model->uncertainty_low_degc) * per_step, 0, last);
        const int j = (int)vw_min(x, last - 1);
        const vw_real *here = model->uncertainty + j * VW_UNCERTAINTIES;
        for (int q = 0; q < VW_UNCERTAINTIES; q++)
            uncertainty[q][c] = here[q] + (x - (vw_real)j) * (here[VW_UNCERTAINTIES + q] - here[q]);
    }
}

/* Beyond the ends of the tables their last values hold. */
void vw_cell_model_place_soc(const vw_cell_model *model, const vw_lanes soc, vw_soc_place *place)
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

/* Linear in temperature at both points; only cells that have left their segment are looked up. */
VW_INLINE void vw_cell_model_renew_segment(const vw_cell_model *model, const vw_real *table, const int width,
                                           const int n_columns, const vw_temperature_place *restrict at,
                                           const vw_soc_place *restrict soc, vw_segment *restrict segment)
{
    const int32_t warmer = model->n_temperatures > 1 ? model->n_soc * width : 0;
    int n_left = 0;
    VW_EACH_CELL(c) n_left += segment->column[c] != soc->column[c];
    if (n_left == 0) return;
    for (int c = 0; c < VW_LANES; c++) {
        if (segment->column[c] == soc->column[c]) continue;
        const vw_real *cool = table + ((int32_t)at->row[c] * model->n_soc + soc->column[c]) * width, *warm = cool + warmer;
        const vw_real g = at->row_weight[c];
        for (int q = 0; q < n_columns; q++) {
            const vw_real cool_rise = cool[width + q] - cool[q], warm_rise = warm[width + q] - warm[q];
            segment->low[q][c] = cool[q] + g * (warm[q] - cool[q]);
            segment->rise[q][c] = cool_rise + g * (warm_rise - cool_rise);
        }
        segment->column[c] = soc->column[c];
    }
}

void vw_cell_model_read_circuit(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                                vw_segment *segment)
{
    if (VW_LANES > 1 && model->width == 4) vw_cell_model_renew_segment(model, model->table, 4, 4, at, soc, segment);
    else vw_cell_model_renew_segment(model, model->table, model->width, vw_cell_model_count_columns(model), at, soc, segment);
}

void vw_cell_model_read_values(const vw_cell_model *model, const vw_segment *restrict segment,
                               const vw_soc_place *restrict soc, vw_lanes *restrict values)
{
    const int n_columns = vw_cell_model_count_columns(model);
    for (int q = 0; q < n_columns; q++)
        VW_EACH_CELL(c) values[q][c] = vw_cell_model_interpolate(segment, soc, q, c);
}

void vw_cell_model_read_ocv(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                            vw_segment *segment)
{
    vw_cell_model_renew_segment(model, model->table + VW_OCV, model->width, 1, at, soc, segment);
}

void vw_cell_model_read_time_constants(const vw_cell_model *model, const vw_temperature_place *at,
                                       const vw_soc_place *soc, vw_lanes *tau_s)
{
    vw_segment segment;
    VW_EACH_CELL(c) segment.column[c] = VW_NOWHERE;
    if (model->has_tau_table) vw_cell_model_renew_segment(model, model->tau_s, model->n_rc, model->n_rc, at, soc, &segment);
    for (int k = 0; k < model->n_rc; k++)
        VW_EACH_CELL(c) tau_s[k][c] = model->has_tau_table ? vw_cell_model_interpolate(&segment, soc, k, c) : model->tau_s[k];
}

void vw_cell_model_read_surface(const vw_cell_model *model, const vw_temperature_place *at, vw_lanes *surface)
{
    const int n_pairs = vw_cell_model_count_pairs(model), warmer = model->n_temperatures > 1 ? n_pairs : 0;
    for (int k = 0; k < VW_RC_MAX - 1; k++)
        VW_EACH_CELL(c)
        {
            const vw_real *cool = model->has_surface && k < n_pairs ? model->surface + (int32_t)at->row[c] * n_pairs + k : 0;
            surface[k][c] = cool ? cool[0] + at->row_weight[c] * (cool[warmer] - cool[0]) : 0;
        }
}

/* OCV at point j of the table, linear between the temperatures. */
static vw_real vw_cell_model_find_ocv(const vw_cell_model *model, const vw_temperature_place *at, int c, int j)
{
    const int width = model->width;
    const vw_real *here = model->table + ((int32_t)at->row[c] * model->n_soc + j) * width;
    const vw_real *above = model->n_temperatures > 1 ? here + model->n_soc * width : here;
    return here[VW_OCV] + at->row_weight[c] * (above[VW_OCV] - here[VW_OCV]);
}

/* Linear between the points of a table over SOC alone. */
static void vw_cell_model_interpolate_soc(const vw_real *table, const vw_soc_place *restrict soc, vw_lanes values)
{
    const vw_real *next = table + 1;
    VW_EACH_CELL(c)
    {
        const int j = soc->column[c];
        values[c] = table[j] + soc->weight[c] * (next[j] - table[j]);
    }
}

void vw_cell_model_read_ocv_slope(const vw_cell_model *model, const vw_soc_place *soc, vw_lanes slope_v)
{
    vw_cell_model_interpolate_soc(model->ocv_slope_v, soc, slope_v);
}

void vw_cell_model_read_reading_slope(const vw_cell_model *model, const vw_soc_place *soc, vw_lanes slope_v)
{
    vw_cell_model_interpolate_soc(model->reading_slope_v, soc, slope_v);
}

vw_real vw_cell_model_compute_ocv(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc)
{
    const vw_real end = (vw_real)(model->n_soc - 1), last = (vw_real)(model->n_soc - 2);
    const vw_real x = vw_clip((soc - model->soc_low) / model->soc_step, 0, end);
    const int j = (int)vw_min(x, last);
    const vw_real low_v = vw_cell_model_find_ocv(model, at, c, j);
    return low_v + (x - (vw_real)j) * (vw_cell_model_find_ocv(model, at, c, j + 1) - low_v);
}

/* The last point that does not lie above the voltage, by bisection; the OCV never falls. */
vw_real vw_cell_model_find_soc(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real voltage_v)
{
    int below = 0, above = model->n_soc - 1;
    while (above - below > 1) {
        const int middle = (below + above) / 2;
        if (vw_cell_model_find_ocv(model, at, c, middle) <= voltage_v) below = middle;
        else above = middle;
    }
    const vw_real low_v = vw_cell_model_find_ocv(model, at, c, below), high_v = vw_cell_model_find_ocv(model, at, c, above);
    const vw_real weight = high_v > low_v ? (voltage_v - low_v) / (high_v - low_v) : 0;
    const vw_real soc = model->soc_low + model->soc_step * ((vw_real)below + weight);
    return vw_clip(soc, (vw_real)-0.05, (vw_real)1.05);
}

/* The farther of both sides: at the foot of a step of the OCV the near one says little. */
vw_real vw_cell_model_compute_soc_sigma(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc,
                                        vw_real sigma_v)
{
    const vw_real ocv_v = vw_cell_model_compute_ocv(model, at, c, soc);
    const vw_real above = vw_cell_model_find_soc(model, at, c, ocv_v + sigma_v) - soc;
    const vw_real below = soc - vw_cell_model_find_soc(model, at, c, ocv_v - sigma_v);
    return vw_max(vw_max(above, below), (vw_real)1e-3);
}
