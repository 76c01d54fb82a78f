/* Where a filter begins: from one sample of voltages, from a SOC that was handed over, or both. */
#include "vw_parts.h"

#define TEMPERATURE_UNKNOWN_DEGC 25
#define START_POINTS 101 /* of the SOC, among which the first voltage chooses */
#define NEGLIGIBLE 40 /* exp(-40) of the likeliest SOC is no weight */
#define LEAST_VARIANCE ((vw_real)1e-8) /* of a SOC that was handed over */

enum { VW_OCV_SLOPE = VW_COLUMNS_MAX, N_ROWS }; /* after the columns of the tables: dOCV/dz_s [V] */

static vw_real vw_start_read_number(const vw_real *values, int k) { return values ? values[k] : NAN; }

/* Variance of the voltage at the start where the SOC is x->soc, and what each branch has of it: ohm^2 branch_v2 [V^2],
 * ohm = rho (R_k + d_k dOCV/dz_s). */
static vw_real vw_start_compute_voltage_v2(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x,
                                           vw_lanes *here, int c, vw_real *ohm, vw_real *branch_v2)
{
    const vw_tuning *t = &filter->tuning;
    const vw_cell_model *model = &filter->model;
    const vw_real pair_v2 =
        vw_square(t->driven_c * model->capacity_ah) + vw_square(t->start_branch_rel * motion->current_a);
    vw_real voltage_v2 = vw_parts_compute_noise_v2(motion, x, c);
    for (int k = 0; k < model->n_rc; k++) {
        const int is_pair = k < vw_cell_model_count_pairs(model);
        branch_v2[k] = is_pair ? pair_v2 : vw_parts_compute_lasting_v2(motion, x, model->slow_pair, c);
        ohm[k] = x->resistance[c] * (is_pair ? here[VW_R1 + k][c] + x->terms.surface[k][c] * here[VW_OCV_SLOPE][c] : 1);
        voltage_v2 += vw_square(ohm[k]) * branch_v2[k];
    }
    return voltage_v2;
}

/* Tables where the surface is at x->soc and the branch currents, and the slope of the OCV there: N_ROWS rows. */
static void vw_start_read_tables(const vw_filter *filter, const vw_cells *restrict x, vw_lanes *here)
{
    vw_soc_place at;
    vw_segment segment;
    vw_lanes soc;
    VW_EACH_CELL(c) segment.column[c] = VW_NOWHERE;
    VW_EACH_CELL(c) soc[c] = vw_parts_compute_surface_soc(x, vw_cell_model_count_pairs(&filter->model), c);
    vw_cell_model_place_soc(&filter->model, soc, &at);
    vw_cell_model_read_ocv_slope(&filter->model, &at, here[VW_OCV_SLOPE]);
    vw_cell_model_read_circuit(&filter->model, &x->terms.place, &at, &segment);
    vw_cell_model_read_values(&filter->model, &segment, &at, here);
}

/* RC currents: a fast pair has followed half of the current, a slow one what flowed before, in a drive far less.
 *
 *   i_k = start_branch_rel i / (1 + tau_k / start_branch_s)
 */
static void vw_start_init_branches(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x)
{
    const vw_cell_model *model = &filter->model;
    const vw_tuning *t = &filter->tuning;
    vw_lanes tau_s[VW_RC_MAX];
    vw_soc_place at;
    VW_EACH_CELL(c) x->soc[c] = (vw_real)0.5;
    vw_cell_model_place_soc(model, x->soc, &at);
    if (model->has_tau_table) vw_cell_model_read_time_constants(model, &x->terms.place, &at, tau_s);
    for (int k = 0; k < model->n_rc; k++)
        VW_EACH_CELL(c)
        {
            const vw_real tau = model->has_tau_table ? tau_s[k][c] : model->tau_s[k];
            x->branch_a[k][c] = k < vw_cell_model_count_pairs(model)
                ? t->start_branch_rel * motion->current_a / (1 + tau / t->start_branch_s) : 0;
        }
}

/* Mean and variance of the SOC over all SOC, each as likely as it makes the voltage:
 *
 *   p(z) ~ exp(-(v - h(z))^2 / 2 s^2) / s,   s^2 = r + sum ohm_k^2 P_kk
 *
 * In a plateau that is its middle, as unsure as it is wide. Exponents count from the likeliest SOC so far.
 */
static void vw_start_estimate_soc(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                  const vw_work *restrict work, vw_lanes *here, vw_lanes variance)
{
    const vw_cell_model *model = &filter->model;
    vw_lanes best, sum, first, second, drop_v;
    vw_start_init_branches(filter, motion, x);
    VW_EACH_CELL(c) sum[c] = first[c] = second[c] = best[c] = 0;
    for (int j = 0; j < START_POINTS; j++) {
        const vw_real z = (vw_real)j / (START_POINTS - 1);
        VW_EACH_CELL(c) x->soc[c] = z;
        vw_start_read_tables(filter, x, here);
        vw_output_compute_drop(model, motion, x, here, drop_v);
        VW_EACH_CELL(c)
        {
            vw_real ohm[VW_RC_MAX], branch_v2[VW_RC_MAX];
            const vw_real voltage_v2 = vw_start_compute_voltage_v2(filter, motion, x, here, c, ohm, branch_v2);
            const vw_real off_v = work->voltage_v[c] - (here[VW_OCV][c] - x->resistance[c] * drop_v[c]);
            const vw_real likely = -vw_square(off_v) / voltage_v2 / 2;
            const int is_best = j == 0 || likely > best[c];
            const vw_real apart = vw_abs(likely - best[c]), less = apart < NEGLIGIBLE ? vw_exp(-apart) : 0;
            const vw_real kept = is_best ? less : 1, weight = (is_best ? 1 : less) / vw_sqrt(voltage_v2);
            sum[c] = sum[c] * kept + weight;
            first[c] = first[c] * kept + weight * z;
            second[c] = second[c] * kept + weight * vw_square(z);
            best[c] = is_best ? likely : best[c];
        }
    }
    VW_EACH_CELL(c)
    {
        const int is_missing = vw_is_missing(work->voltage_v[c]);
        x->soc[c] = is_missing ? (vw_real)0.5 : first[c] / sum[c];
        variance[c] = vw_max(second[c] / sum[c] - vw_square(x->soc[c]), 0) + vw_square(filter->tuning.start_voltage_sigma);
        variance[c] = is_missing ? VW_SOC_VARIANCE_MAX : vw_min(variance[c], VW_SOC_VARIANCE_MAX);
    }
    vw_start_read_tables(filter, x, here);
}

/* The RC currents' spread is one of the SOC too, so both share a covariance: as over a line of slope s / sigma. */
static void vw_start_init_covariance(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                     const vw_work *restrict work, vw_lanes *here, const vw_lanes variance)
{
    VW_EACH_CELL(c)
    {
        vw_real branch_v2[VW_RC_MAX], ohm[VW_RC_MAX];
        const vw_real voltage_v2 = vw_start_compute_voltage_v2(filter, motion, x, here, c, ohm, branch_v2);
        const vw_real slope_v = vw_sqrt(voltage_v2 / variance[c]);
        x->cov[0][c] = variance[c];
        for (int k = 0; k < filter->model.n_rc; k++) {
            x->cov[VW_COV(1 + k, 0)][c] = vw_is_missing(work->voltage_v[c]) ? 0 : ohm[k] / slope_v * branch_v2[k];
            for (int q = 0; q < k; q++) x->cov[VW_COV(1 + k, 1 + q)][c] = 0;
            x->cov[VW_COV(1 + k, 1 + k)][c] = branch_v2[k];
        }
    }
}

static void vw_start_reset_state(const vw_filter *filter, vw_cells *restrict x)
{
    VW_EACH_CELL(c)
    {
        x->hysteresis[c] = x->refused_s[c] = x->wander_v2[c] = x->rest_moment[c] = x->unsettled_v2[c] = 0;
        x->gain_v2[c] = vw_square(filter->tuning.gain_sigma);
        for (int u = 0; u < VW_STATES_MAX; u++) x->gain_slope[u][c] = 0;
        x->gain[c] = x->gain_step[c] = x->fused_gain[c] = x->drawn[c] = x->conflict[c] = 0;
        x->count_gain[c] = x->count_offset[c] = 0;
        x->check_mean_v[c] = x->check_square_v2[c] = x->slow_mean_v[c] = 0;
        x->slow_square_v2[c] = vw_square(filter->tuning.lasting_v);
    }
}

/* A given SOC is right within its sigma, or roughly, or not at all. */
static void vw_start_init_hypotheses(const vw_tuning *t, vw_cells *restrict x, int c, vw_real soc, vw_real sigma)
{
    const int is_given = !vw_is_missing(soc);
    const vw_real exact = vw_is_missing(sigma) ? t->counter_soc_sigma : sigma;
    const vw_real spread[VW_STARTS] = {exact, vw_max(t->rough_soc, 3 * exact), 1, 1};
    const vw_real weight[VW_STARTS] = {t->start_exact, t->start_rough, 0, 0};
    for (int k = 0; k < VW_STARTS; k++) {
        x->start_soc[k][c] = is_given ? vw_clip(soc, VW_SOC_MIN, VW_SOC_MAX) : x->soc[c];
        x->start_v2[k][c] = vw_clip(vw_square(spread[k]), LEAST_VARIANCE, VW_SOC_VARIANCE_MAX);
        x->start_weight[k][c] = is_given ? weight[k] : 0;
    }
    x->best_soc[c] = x->soc[c];
    x->best_v2[c] = VW_SOC_VARIANCE_MAX;
    x->best_drawn[c] = x->best_offset[c] = 0;
    x->fused_soc[c] = x->soc[c];
    x->fused_v2[c] = x->cov[0][c];
}

/* The count begins at the SOC given, or else where the voltage says; a filter without a count begins there too. */
static void vw_start_init_cell(const vw_filter *filter, vw_cells *restrict x, int c, vw_real soc, vw_real sigma)
{
    x->count_soc[c] = vw_clip(x->soc[c], VW_SOC_MIN, VW_SOC_MAX);
    x->anchor_v2[c] = x->cov[0][c];
    x->soc[c] = x->count_soc[c];
    x->apart[c] = 0;
    x->apart_v2[c] = x->cov[0][c];
    vw_start_init_hypotheses(&filter->tuning, x, c, soc, sigma);
    if (vw_is_missing(soc)) return;
    const int is_counted = filter->kind == VW_COUNT || filter->kind == VW_SIGMA_FUSED;
    if (vw_is_missing(sigma))
        sigma = is_counted ? filter->tuning.counter_soc_sigma : filter->tuning.start_soc_sigma;
    x->count_soc[c] = vw_clip(soc, VW_SOC_MIN, VW_SOC_MAX);
    x->anchor_v2[c] = vw_clip(vw_square(sigma), LEAST_VARIANCE, VW_SOC_VARIANCE_MAX);
    x->apart[c] = x->soc[c] - x->count_soc[c];
    if (filter->kind == VW_SIGMA_FUSED) return;
    x->soc[c] = x->count_soc[c];
    x->cov[0][c] = x->anchor_v2[c];
    for (int k = 0; k < filter->model.n_rc; k++) x->cov[VW_COV(1 + k, 0)][c] = 0;
}

void vw_filter_init(vw_filter *filter, vw_cells *cells)
{
    filter->current_a = filter->since_s = 0;
    filter->flow_a = filter->beyond_a = 0;
    filter->rest_s = -1;
    for (int block = 0; block < VW_BLOCKS(filter->n_cells); block++) {
        vw_cells *restrict x = &cells[block];
        VW_EACH_CELL(c)
        {
            x->temperature_degc[c] = TEMPERATURE_UNKNOWN_DEGC;
            x->terms.degc[c] = NAN;
            x->capacity_ah[c] = filter->model.capacity_ah;
            x->resistance[c] = 1;
        }
    }
}

/* A block as its voltages alone say. */
static void vw_start_init_block(const vw_filter *filter, const vw_motion *motion, const vw_sample *sample, int block,
                                vw_cells *cells)
{
    vw_cells *restrict x = &cells[block];
    vw_work work;
    vw_lanes here[N_ROWS], variance;
    vw_filter_read_sample(filter, x, sample, block * VW_LANES, &work);
    vw_start_estimate_soc(filter, motion, x, &work, here, variance);
    vw_start_init_covariance(filter, motion, x, &work, here, variance);
    vw_start_reset_state(filter, x);
    VW_EACH_CELL(c) x->rest_mean_v[c] = vw_is_missing(work.voltage_v[c]) ? 0 : work.voltage_v[c];
}

/* Mean SOC of the cells that were measured. */
static vw_real vw_start_compute_mean_soc(const vw_filter *filter, vw_cells *cells, const vw_sample *sample)
{
    vw_real sum = 0;
    int n_seen = 0;
    vw_work work;
    for (int k = 0; k < filter->n_cells; k++) {
        vw_cells *restrict x = &cells[k / VW_LANES];
        const int c = k % VW_LANES;
        if (c == 0) vw_filter_read_sample(filter, x, sample, k, &work);
        if (vw_is_missing(work.voltage_v[c])) continue;
        sum += x->soc[c];
        n_seen++;
    }
    return n_seen > 0 ? sum / (vw_real)n_seen : (vw_real)0.5;
}

void vw_filter_start_part(vw_filter *filter, vw_cells *cells, const vw_sample *sample, const vw_real *soc,
                          const vw_real *soc_sigma, int32_t first, int32_t n)
{
    const int32_t n_blocks = VW_BLOCKS(filter->n_cells), end = first + n < n_blocks ? first + n : n_blocks;
    vw_filter_hold_current(filter, sample->current_a);
    filter->since_s = filter->tuning.weighing_s;
    filter->rest_s = 0;
    const vw_motion motion = vw_predict_make_motion(filter, 0, filter->current_a);
    for (int32_t block = first; block < end; block++) vw_start_init_block(filter, &motion, sample, block, cells);
    if (end < n_blocks) return;
    /* a cell that was not measured begins at the mean of the others, as unknown as can be */
    const vw_real mean = vw_start_compute_mean_soc(filter, cells, sample);
    vw_work work;
    for (int k = 0; k < filter->n_cells; k++) {
        vw_cells *restrict x = &cells[k / VW_LANES];
        const int c = k % VW_LANES;
        if (c == 0) vw_filter_read_sample(filter, x, sample, k, &work);
        if (vw_is_missing(work.voltage_v[c])) x->soc[c] = mean;
        vw_start_init_cell(filter, x, c, vw_start_read_number(soc, k), vw_start_read_number(soc_sigma, k));
    }
}

void vw_filter_start(vw_filter *filter, vw_cells *cells, const vw_sample *sample, const vw_real *soc,
                     const vw_real *soc_sigma)
{
    vw_filter_start_part(filter, cells, sample, soc, soc_sigma, 0, VW_BLOCKS(filter->n_cells));
}
