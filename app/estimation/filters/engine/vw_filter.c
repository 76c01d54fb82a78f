/* One step of the estimator over all cells, block by block. */
#include "vw_parts.h"

#define TEMPERATURE_MAX_DEGC 200 /* beyond it, either way, the sensor is broken */
#define CURRENT_MAX_C 60         /* a larger reading is a broken sensor, not a current */
#define VOLTAGE_MIN_V ((vw_real)0.5) /* a cell that reads 0 is not connected */
#define VOLTAGE_MAX_V ((vw_real)6.0) /* 6.5535 V is what the cell monitor says when it has not measured */

/* The current in force: this one, or the last where this one is missing or impossible. */
void vw_filter_hold_current(vw_filter *filter, vw_real current_a)
{
    if (vw_abs(current_a) <= CURRENT_MAX_C * filter->model.capacity_ah) filter->current_a = current_a;
}

static int vw_filter_count_cells(const vw_filter *filter, int first)
{
    return filter->n_cells - first < VW_LANES ? filter->n_cells - first : VW_LANES;
}

/* The first n of a block's numbers; a whole block is the usual case. */
static void vw_filter_copy_lanes(vw_real *to, const vw_real *from, int n)
{
    if (n == VW_LANES) VW_EACH_CELL(c) to[c] = from[c];
    else
        for (int c = 0; c < n; c++) to[c] = from[c];
}

/* What the temperatures of a block set, beginning with the uncertainty about the model there. */
static void vw_filter_update_temperature_terms(const vw_filter *filter, const vw_lanes degc,
                                               vw_temperature_terms *terms)
{
    const vw_tuning *t = &filter->tuning;
    const vw_real hysteresis_v2 = vw_square(filter->model.hysteresis_v) / 3; /* anywhere between the branches */
    vw_lanes uncertainty[VW_UNCERTAINTIES];
    vw_cell_model_place_temperature(&filter->model, degc, &terms->place);
    vw_cell_model_read_uncertainty(&filter->model, degc, uncertainty);
    vw_cell_model_read_surface(&filter->model, &terms->place, terms->surface);
    VW_EACH_CELL(c)
    {
        const vw_real error2 = vw_square(uncertainty[VW_DROP_ERROR][c]), ohm2 = vw_square(uncertainty[VW_LASTING_DROP][c]);
        terms->degc[c] = degc[c];
        terms->drop_error[c] = uncertainty[VW_DROP_ERROR][c];
        terms->lowest_soc[c] = uncertainty[VW_LOWEST][c];
        terms->cold2[c] = vw_square(uncertainty[VW_COLD][c]);
        terms->noise_ohm2[c] = (vw_square(t->model_error_rel) + error2) * ohm2;
        terms->lasting_v2[c] = vw_square(t->lasting_v) + vw_square(uncertainty[VW_OCV_ERROR][c]) + hysteresis_v2;
        terms->lasting_ohm2[c] = (vw_square(t->lasting_rel) + error2) * ohm2;
        terms->relaxing_v2[c] = vw_square(t->driven_c * filter->model.capacity_ah) * ohm2;
        terms->empty_soc[c] = vw_min(t->empty_soc * uncertainty[VW_COLD][c], 1);
        terms->empty_rise[c] = (t->empty_factor * uncertainty[VW_COLD][c] - 1) / terms->empty_soc[c];
    }
}

/* Take the measurements of a block: what is impossible is missing, a missing temperature is the last one. */
void vw_filter_read_sample(const vw_filter *filter, vw_cells *restrict x, const vw_sample *sample, int first,
                           vw_work *restrict work)
{
    const int n = vw_filter_count_cells(filter, first);
    int n_changed = 0;
    vw_lanes degc;
    VW_EACH_CELL(c) work->voltage_v[c] = degc[c] = NAN;
    vw_filter_copy_lanes(work->voltage_v, sample->voltage_v + first, n);
    vw_filter_copy_lanes(degc, sample->temperature_degc + first, n);
    VW_EACH_CELL(c)
    {
        const vw_real v = work->voltage_v[c];
        work->voltage_v[c] = vw_pick((v > VOLTAGE_MIN_V) & (v < VOLTAGE_MAX_V), v, NAN);
        degc[c] = vw_pick(vw_abs(degc[c]) < TEMPERATURE_MAX_DEGC, degc[c], x->temperature_degc[c]);
        n_changed += degc[c] != x->terms.degc[c];
        x->temperature_degc[c] = degc[c];
    }
    if (n_changed == 0) return;
    vw_filter_update_temperature_terms(filter, degc, &x->terms);
#if VW_KEEPS_SEGMENTS
    for (int k = 0; k < VW_SEGMENTS; k++)
        VW_EACH_CELL(c) x->segments[k].column[c] = VW_NOWHERE;
#endif
}

/* The charge count alone: the voltage is predicted for the self-check only. */
static void vw_filter_count_charge(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                   vw_work *restrict work)
{
    VW_EACH_CELL(c) x->soc[c] = x->count_soc[c];
    vw_output_run_tangent(filter, motion, x, work);
    VW_EACH_CELL(c)
    {
        work->innovation_v[c] = work->voltage_v[c] - work->h[c];
        work->innovation_sigma_v[c] = vw_sqrt(vw_parts_compute_noise_v2(motion, x, c));
        work->used[c] = vw_pick(vw_is_missing(work->innovation_v[c]), 0, 1);
        work->soc[c] = x->count_soc[c];
        work->soc_v2[c] = vw_min(vw_parts_compute_count_v2(x, c), vw_square(VW_COUNT_SIGMA_MAX));
    }
    vw_fusion_check_model(filter, motion, x, work);
    VW_EACH_CELL(c) work->used[c] = 0;
}

/* Fuse with what a rest that goes on says up to now, and keep the starts as they were: it will be read as a whole. */
static void vw_filter_fuse_in_rest(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                   vw_work *restrict work)
{
    vw_lanes soc[VW_STARTS], v2[VW_STARTS], weight[VW_STARTS];
    for (int k = 0; k < VW_STARTS; k++) {
        vw_filter_copy_lanes(soc[k], x->start_soc[k], VW_LANES);
        vw_filter_copy_lanes(v2[k], x->start_v2[k], VW_LANES);
        vw_filter_copy_lanes(weight[k], x->start_weight[k], VW_LANES);
    }
    vw_fusion_update_from_rest(filter, motion, x, work);
    vw_fusion_fuse_block(filter, motion, x, work);
    for (int k = 0; k < VW_STARTS; k++) {
        vw_filter_copy_lanes(x->start_soc[k], soc[k], VW_LANES);
        vw_filter_copy_lanes(x->start_v2[k], v2[k], VW_LANES);
        vw_filter_copy_lanes(x->start_weight[k], weight[k], VW_LANES);
    }
}

static void vw_filter_step_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                 vw_work *restrict work)
{
    if (filter->kind == VW_TANGENT) vw_output_run_tangent(filter, motion, x, work);
    else vw_output_run_sigma(filter, motion, x, work);
    vw_update_block(filter, motion, x, work);
    /* fused, what the filter says by itself is asked for only where the starts are weighed */
    if (filter->kind != VW_SIGMA_FUSED || motion->weighed_s > 0) vw_fusion_compute_soc_variance(filter, x, work);
    if (motion->rest_share > 0) vw_fusion_accumulate_rest(filter, motion, x, work);
    if (motion->read_rest_s > 0 && !motion->is_rest_on) vw_fusion_update_from_rest(filter, motion, x, work);
    if (motion->is_rest_cut) VW_EACH_CELL(c) x->unsettled_v2[c] = 0;
    if (filter->kind == VW_SIGMA_FUSED) {
        if (motion->is_rest_on) vw_filter_fuse_in_rest(filter, motion, x, work);
        else vw_fusion_fuse_block(filter, motion, x, work);
    }
    vw_fusion_check_model(filter, motion, x, work);
}

/* Put the first n_rows of what a step says of a block into `estimates`. */
static void vw_filter_write_estimates(const vw_filter *filter, vw_cells *restrict x, vw_work *restrict work, int first,
                                      int n_rows, vw_real *estimates)
{
    const int n = vw_filter_count_cells(filter, first), n_cells = filter->n_cells;
    vw_real part[VW_ESTIMATES * VW_LANES]; /* of a block that is not whole */
    vw_real *restrict rows = n == VW_LANES && n_rows == VW_ESTIMATES ? estimates + first : part;
    const int width = rows == part ? VW_LANES : n_cells;
    if (n_rows > VW_OCV_V) {
        const int is_counted = filter->kind == VW_COUNT || filter->kind == VW_SIGMA_FUSED;
        /* else it is that of the filter's SOC */
        if (is_counted) vw_cell_model_place_soc(&filter->model, work->soc, &work->at);
        vw_segment fresh, *segment = vw_parts_find_segment(x, VW_AT_ANSWER, &fresh);
        vw_cell_model_read_ocv(&filter->model, &x->terms.place, &work->at, segment);
        VW_EACH_CELL(c) rows[VW_OCV_V * width + c] = vw_cell_model_interpolate(segment, &work->at, VW_OCV, c);
    }
    VW_EACH_CELL(c)
    {
        rows[VW_SOC * width + c] = vw_clip(work->soc[c], 0, 1);
        rows[VW_SOC_SIGMA * width + c] = vw_sqrt(work->soc_v2[c]);
        rows[VW_VOLTAGE_V * width + c] = work->h[c];
        rows[VW_INNOVATION_V * width + c] = work->innovation_v[c];
        rows[VW_INNOVATION_SIGMA * width + c] = work->innovation_sigma_v[c];
        rows[VW_MODEL_VALID * width + c] = work->valid[c];
        rows[VW_ACCEPTED * width + c] = work->used[c];
    }
    for (int row = 0; rows == part && row < n_rows; row++)
        vw_filter_copy_lanes(estimates + row * n_cells + first, rows + row * width, n);
}

/* q' = q + (1 - exp(-dt / wander_s)) (|i| - q) of the current's size, and of what of it was beyond `seen_a`. */
static void vw_filter_average_current(vw_filter *filter, vw_real dt_s)
{
    const vw_real size_a = vw_abs(filter->current_a), share = 1 - vw_exp(-dt_s / filter->tuning.wander_s);
    const vw_real beyond_a = size_a > filter->model.seen_a ? size_a : 0;
    filter->flow_a += share * (size_a - filter->flow_a);
    filter->beyond_a += share * (beyond_a - filter->beyond_a);
}

/* Mean of what the sample before moved the gains by. */
static vw_real vw_filter_compute_shared_gain(const vw_filter *filter, const vw_cells *cells)
{
    vw_real sum = 0;
    int n = 0;
    for (int k = 0; k < filter->n_cells; k++) {
        const vw_real moved = cells[k / VW_LANES].gain_step[k % VW_LANES];
        n += !vw_is_missing(moved);
        sum += vw_is_missing(moved) ? 0 : moved;
    }
    return n > 0 ? sum / (vw_real)n : 0;
}

static void vw_filter_step_rows(vw_filter *filter, vw_cells *cells, const vw_sample *sample, int n_rows,
                                vw_real *estimates)
{
    vw_filter_hold_current(filter, sample->current_a);
    vw_filter_average_current(filter, sample->dt_s);
    vw_motion motion = vw_predict_make_motion(filter, sample->dt_s, filter->current_a);
    if (motion.is_beyond) motion.shared_gain = vw_filter_compute_shared_gain(filter, cells);
    const int rests = motion.rest_share > 0 || (filter->rest_s == 0 && sample->dt_s == 0);
    filter->rest_s = rests && !motion.is_whole_rest ? filter->rest_s + sample->dt_s : -1;
    filter->since_s = motion.weighed_s > 0 ? 0 : filter->since_s + sample->dt_s;
    for (int first = 0; first < filter->n_cells; first += VW_LANES) {
        vw_cells *x = &cells[first / VW_LANES];
        vw_work work;
        vw_filter_read_sample(filter, x, sample, first, &work);
        vw_predict_block(filter, &motion, x);
        if (filter->kind == VW_COUNT) vw_filter_count_charge(filter, &motion, x, &work);
        else vw_filter_step_block(filter, &motion, x, &work);
        vw_filter_write_estimates(filter, x, &work, first, n_rows, estimates);
    }
}

void vw_filter_step(vw_filter *filter, vw_cells *cells, const vw_sample *sample, vw_real *estimates)
{
    vw_filter_step_rows(filter, cells, sample, VW_ESTIMATES, estimates);
}

void vw_filter_record(vw_filter *filter, vw_cells *cells, int64_t n_steps, const vw_real *dt_s,
                      const vw_real *current_a, const vw_real *voltage_v, const vw_real *temperature_degc,
                      int32_t n_rows, vw_real *estimates)
{
    const int64_t n = filter->n_cells;
    for (int64_t k = 0; k < n_steps; k++) {
        const vw_sample sample = {dt_s[k], current_a[k], voltage_v + k * n, temperature_degc + k * n};
        vw_filter_step_rows(filter, cells, &sample, n_rows, estimates + k * n_rows * n);
    }
}
