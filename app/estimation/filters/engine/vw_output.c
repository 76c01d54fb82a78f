/* What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.
 *
 * The output is nonlinear in one direction only: that of the SOC at the surface, z_s = g x, g = [1, -rho d_k], which in
 * a plain circuit is the SOC. With z_s first in the Cholesky factor, only the centre and the two points along its first
 * column see another z_s; every other pair lies symmetrically on a straight line. So three look-ups give the numbers of
 * the full set of sigma points:
 *
 *   D = (h+ - h-) / (2 c s),  s = sqrt(g P g)      statistical slope along the first column
 *   q = h+ + h- - 2 h0,       h = h0 + w q
 *   H = D g - [0, r]                               r = rho R_k(z_s)
 *
 * h+ and h- are counted from h0 and leave out what r makes of the shift p c / s of the currents, p = (P g)_k: what is
 * left of (h+ - h-) / (2 c s) is the slope with z_s itself, and no digits are lost where s is small.
 *
 * At both points the overpotential of a model of the surface follows its second-order expansion in u = ln(1 / i_ref):
 * x = i / i_ref,  d asinh(x) / du = x / sqrt(1 + x^2),  d^2 asinh(x) / du^2 = x / (1 + x^2)^(3/2).
 *
 * Source: SPKF-2020 and EKF-CDKF-2022; c, w and k of each rule: sigma_points.py.
 */
#include "vw_parts.h"

/* How the overpotential of a model is computed. */
enum { NO_OVERPOTENTIAL, ONE_REFERENCE, SURFACE };

static int vw_output_find_kinetics(const vw_cell_model *model)
{
    return model->has_surface ? SURFACE : model->has_overpotential ? ONE_REFERENCE : NO_OVERPOTENTIAL;
}

void vw_output_compute_drop(const vw_cell_model *model, const vw_motion *motion, const vw_cells *restrict x,
                            vw_lanes *restrict here, vw_lanes drop_v)
{
    const int n_pairs = vw_cell_model_count_pairs(model);
    VW_EACH_CELL(c) drop_v[c] = here[VW_R0][c] * motion->current_a;
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c) drop_v[c] += here[VW_R1 + k][c] * x->branch_a[k][c];
    if (model->has_surface)
        VW_EACH_CELL(c)
            drop_v[c] += here[VW_R1 + n_pairs][c] * vw_parts_compute_asinh(motion->current_a * here[VW_R1 + n_pairs + 1][c]);
    else if (model->has_overpotential)
        VW_EACH_CELL(c) drop_v[c] += here[VW_R1 + n_pairs][c] * motion->over;
}

/* d(R0 i + sum R_k i_k + e asinh(i / i_ref)) / dz_s */
static void vw_output_compute_drop_slope(const vw_cell_model *model, const vw_motion *motion,
                                         const vw_cells *restrict x, vw_lanes *restrict here, vw_lanes *restrict slope,
                                         vw_lanes drop_v)
{
    const int n_pairs = vw_cell_model_count_pairs(model);
    VW_EACH_CELL(c) drop_v[c] = slope[VW_R0][c] * motion->current_a;
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c) drop_v[c] += slope[VW_R1 + k][c] * x->branch_a[k][c];
    if (model->has_surface)
        VW_EACH_CELL(c)
        {
            const vw_real over_a = motion->current_a * here[VW_R1 + n_pairs + 1][c];
            drop_v[c] += slope[VW_R1 + n_pairs][c] * vw_parts_compute_asinh(over_a) +
                         here[VW_R1 + n_pairs][c] * motion->current_a * slope[VW_R1 + n_pairs + 1][c] /
                             vw_sqrt(1 + vw_square(over_a));
        }
    else if (model->has_overpotential)
        VW_EACH_CELL(c) drop_v[c] += slope[VW_R1 + n_pairs][c] * motion->over;
}

void vw_output_run_tangent(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                           vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    const int n_pairs = vw_cell_model_count_pairs(model);
    vw_soc_place at;
    vw_lanes soc, here[VW_COLUMNS_MAX], slope[VW_COLUMNS_MAX], drop_v, drop_slope_v;
    vw_segment fresh, *segment = vw_parts_find_segment(x, VW_AT_MEAN, &fresh);
    const vw_real per_step = 1 / model->soc_step;
    VW_EACH_CELL(c) soc[c] = vw_parts_compute_surface_soc(x, n_pairs, c);
    vw_cell_model_place_soc(model, soc, &at);
    vw_cell_model_read_circuit(model, &x->terms.place, &at, segment);
    vw_cell_model_read_values(model, segment, &at, here);
    vw_cell_model_read_ocv_slope(model, &at, slope[VW_OCV]);
    for (int q = VW_R0; q < vw_cell_model_count_columns(model); q++)
        VW_EACH_CELL(c) slope[q][c] = segment->rise[q][c] * per_step;
    vw_output_compute_drop(model, motion, x, here, drop_v);
    vw_output_compute_drop_slope(model, motion, x, here, slope, drop_slope_v);
    /* h = OCV - rho drop + M h_yst,  dh/dz = dh/dz_s = dOCV/dz_s - rho d drop/dz_s,  dh/di_k = -rho (R_k + d_k dh/dz_s);
     * R is 1 ohm of the last */
    VW_EACH_CELL(c)
    {
        const vw_real rho = x->resistance[c];
        work->h[c] = here[VW_OCV][c] - rho * (drop_v[c] + x->branch_a[n_pairs][c]) +
                     filter->model.hysteresis_v * x->hysteresis[c];
        work->ocv_slope_v[c] = slope[VW_OCV][c];
        work->bend_v2[c] = 0;
        work->H[0][c] = slope[VW_OCV][c] - rho * drop_slope_v[c];
        work->H[1 + n_pairs][c] = -rho;
    }
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c)
            work->H[1 + k][c] = -x->resistance[c] * (here[VW_R1 + k][c] + x->terms.surface[k][c] * work->H[0][c]);
}

#define N_POINTS (VW_AT_LEFT + 1) /* along the first column: at its centre, c s and -c s */

/* A point, and the tables there. */
typedef struct {
    vw_soc_place soc;
    const vw_segment *segment;
} vw_point;

/* The spread along the first column: c / s, and p_k. */
typedef struct {
    vw_lanes per_sd;
    vw_lanes shared[VW_RC_MAX]; /* of a model of the surface; else it is P_zk */
} vw_spread;

static inline vw_real vw_output_read(const vw_point *point, int column, int c)
{
    return vw_cell_model_interpolate(point->segment, &point->soc, column, c);
}

VW_INLINE void vw_output_run_points(const int n_pairs, const int kinetics, const vw_filter *filter,
                                    const vw_motion *motion, const vw_cells *restrict x,
                                    const vw_point *restrict points, const vw_spread *restrict spread,
                                    vw_work *restrict work)
{
    const vw_real half_per_c2 = (vw_real)0.5 / vw_square(filter->rule.spread);
    const vw_point *mean = &points[VW_AT_MEAN], *to_right = &points[VW_AT_RIGHT], *to_left = &points[VW_AT_LEFT];
    VW_EACH_CELL(c)
    {
        const vw_real rho = x->resistance[c], r0 = vw_output_read(mean, VW_R0, c), ocv = vw_output_read(mean, VW_OCV, c);
        const vw_real per_sd = spread->per_sd[c];
        vw_real drop = r0 * motion->current_a;
        vw_real right = (vw_output_read(to_right, VW_R0, c) - r0) * motion->current_a;
        vw_real left = (vw_output_read(to_left, VW_R0, c) - r0) * motion->current_a;
        VW_UNROLL for (int k = 0; k < n_pairs; k++)
        {
            const vw_real r = vw_output_read(mean, VW_R1 + k, c), i_k = x->branch_a[k][c];
            const vw_real shift = (kinetics == SURFACE ? spread->shared[k][c] : x->cov[VW_COV(1 + k, 0)][c]) * per_sd;
            drop += r * i_k;
            right += (vw_output_read(to_right, VW_R1 + k, c) - r) * (i_k + shift);
            left += (vw_output_read(to_left, VW_R1 + k, c) - r) * (i_k - shift);
            work->H[1 + k][c] = -rho * r;
        }
        if (kinetics != NO_OVERPOTENTIAL) {
            const vw_real e = vw_output_read(mean, VW_R1 + n_pairs, c);
            const vw_real e_right = vw_output_read(to_right, VW_R1 + n_pairs, c);
            const vw_real e_left = vw_output_read(to_left, VW_R1 + n_pairs, c);
            vw_real over = motion->over;
            if (kinetics == SURFACE) {
                const int column = VW_R1 + n_pairs + 1;
                const vw_real per_a = vw_output_read(mean, column, c), xx = motion->current_a * per_a;
                const vw_real right_a = vw_output_read(to_right, column, c), left_a = vw_output_read(to_left, column, c);
                /* u = 2 (b - a) / (b + a), ln(b / a) to 3rd order; one division for all three takes the least time */
                const vw_real root = vw_sqrt(1 + xx * xx), sum_right = right_a + per_a, sum_left = left_a + per_a;
                const vw_real per_all = 1 / (root * sum_right * sum_left), per_root = per_all * sum_right * sum_left;
                const vw_real u_right = 2 * (right_a - per_a) * per_all * root * sum_left;
                const vw_real u_left = 2 * (left_a - per_a) * per_all * root * sum_right;
                const vw_real first = xx * per_root, bend = vw_square(per_root) / 2;
                over = vw_parts_compute_asinh_with(xx, root);
                right += e_right * u_right * first * (1 + u_right * bend);
                left += e_left * u_left * first * (1 + u_left * bend);
            }
            drop += e * over;
            right += (e_right - e) * over;
            left += (e_left - e) * over;
        }
        const vw_real right_ocv = vw_output_read(to_right, VW_OCV, c) - ocv;
        const vw_real left_ocv = vw_output_read(to_left, VW_OCV, c) - ocv;
        const vw_real right_h = right_ocv - rho * right, left_h = left_ocv - rho * left;
        const vw_real q = right_h + left_h, half = half_per_c2 * per_sd; /* 1 / (2 c s) */
        const vw_real slope = (right_h - left_h) * half;
        work->H[1 + n_pairs][c] = -rho;
        work->ocv_slope_v[c] = (right_ocv - left_ocv) * half;
        work->H[0][c] = slope;
        if (kinetics == SURFACE)
            VW_UNROLL for (int k = 0; k < n_pairs; k++) work->H[1 + k][c] -= rho * x->terms.surface[k][c] * slope;
        work->h[c] = ocv - rho * (drop + x->branch_a[n_pairs][c]) + filter->model.hysteresis_v * x->hysteresis[c] +
                     filter->rule.weight * q;
        work->bend_v2[c] = filter->rule.curvature * q * q;
    }
}

/* Where the points lie, and the spread along them; n_pairs 0 for a plain circuit. */
VW_INLINE void vw_output_place_points(const int n_pairs, const vw_filter *filter, const vw_cells *restrict x,
                                      vw_lanes *restrict soc, vw_spread *restrict spread)
{
    VW_EACH_CELL(c)
    {
        vw_real variance = x->cov[0][c], mean = x->soc[c];
        if (n_pairs > 0) {
            vw_real d[VW_RC_MAX];
            VW_UNROLL for (int k = 0; k < n_pairs; k++) d[k] = x->resistance[c] * x->terms.surface[k][c];
            VW_UNROLL for (int k = 0; k < n_pairs; k++)
            {
                vw_real shared = x->cov[VW_COV(1 + k, 0)][c];
                mean -= d[k] * x->branch_a[k][c];
                VW_UNROLL for (int j = 0; j < n_pairs; j++)
                    shared -= d[j] * x->cov[j <= k ? VW_COV(1 + k, 1 + j) : VW_COV(1 + j, 1 + k)][c];
                spread->shared[k][c] = shared;
                variance -= d[k] * (x->cov[VW_COV(1 + k, 0)][c] + shared);
            }
            variance = vw_max(variance, VW_VARIANCE_STEP);
        }
        spread->per_sd[c] = filter->rule.spread / vw_sqrt(variance);
        const vw_real reach = variance * spread->per_sd[c];
        soc[VW_AT_MEAN][c] = mean;
        soc[VW_AT_RIGHT][c] = mean + reach;
        soc[VW_AT_LEFT][c] = mean - reach;
    }
}

/* With numbers that the compiler knows all of a cell stays in registers, as in the update. */
VW_INLINE void vw_output_choose_points(const int n_pairs, const vw_filter *filter, const vw_motion *motion,
                                       const vw_cells *restrict x, const vw_point *restrict points,
                                       const vw_spread *restrict spread, vw_work *restrict work)
{
    switch (vw_output_find_kinetics(&filter->model)) {
    case SURFACE: vw_output_run_points(n_pairs, SURFACE, filter, motion, x, points, spread, work); break;
    case ONE_REFERENCE: vw_output_run_points(n_pairs, ONE_REFERENCE, filter, motion, x, points, spread, work); break;
    default: vw_output_run_points(n_pairs, NO_OVERPOTENTIAL, filter, motion, x, points, spread, work);
    }
}

void vw_output_run_sigma(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    const int n_pairs = vw_cell_model_count_pairs(model);
    vw_point points[N_POINTS];
    vw_segment fresh[N_POINTS];
    vw_lanes soc[N_POINTS];
    vw_spread spread;
    if (!model->has_surface) vw_output_place_points(0, filter, x, soc, &spread);
    else if (VW_LANES > 1 && n_pairs == 2) vw_output_place_points(2, filter, x, soc, &spread);
    else vw_output_place_points(n_pairs, filter, x, soc, &spread);
    for (int k = 0; k < N_POINTS; k++) {
        vw_segment *segment = vw_parts_find_segment(x, k, &fresh[k]);
        vw_cell_model_place_soc(model, soc[k], &points[k].soc);
        vw_cell_model_read_circuit(model, &x->terms.place, &points[k].soc, segment);
        points[k].segment = segment;
    }
    switch (VW_LANES > 1 ? n_pairs : -1) {
    case 0: vw_output_choose_points(0, filter, motion, x, points, &spread, work); break;
    case 1: vw_output_choose_points(1, filter, motion, x, points, &spread, work); break;
    case 2: vw_output_choose_points(2, filter, motion, x, points, &spread, work); break;
    case 3: vw_output_choose_points(3, filter, motion, x, points, &spread, work); break;
    default: vw_output_choose_points(VW_LANES > 1 ? VW_RC_MAX - 1 : n_pairs, filter, motion, x, points, &spread, work);
    }
}
