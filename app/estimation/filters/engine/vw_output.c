/* What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.
 *
 * The output is nonlinear in SOC only. With SOC first in the Cholesky factor, only the centre and the two points along
 * its first column see another SOC; every other pair lies symmetrically on a straight line. So three look-ups give the
 * numbers of the full set of sigma points:
 *
 *   D = (h+ - h-) / (2 c s),  s = sqrt(P_zz)       statistical slope along the first column
 *   q = h+ + h- - 2 h0,       h = h0 + w q
 *   H = [D + p r / P_zz, -r]                       r = rho R_k(z),  p = P_zi
 *
 * h+ and h- are counted from h0 and leave out what r makes of the shift p c / s of the currents: what is left of
 * (h+ - h-) / (2 c s) is H_z itself, and no digits are lost where s is small.
 */
#include "vw_parts.h"

/* R0 i + sum R_k i_k + e asinh(i / i_ref): what the RC pairs and the current drop at the resistances of `here`. */
static void drop_of(const vw_cell_model *model, const vw_motion *motion, const vw_cells *restrict x, vw_lanes *restrict here,
                    vw_lanes drop_v)
{
    const int n_pairs = vw_pairs(model);
    VW_EACH_CELL(c) drop_v[c] = here[VW_R0][c] * motion->current_a;
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c) drop_v[c] += here[VW_R1 + k][c] * x->branch_a[k][c];
    if (model->has_overpotential)
        VW_EACH_CELL(c) drop_v[c] += here[VW_R1 + n_pairs][c] * motion->over;
}

/* h = OCV - rho (R0 i + e asinh(i / i_ref) + sum R_k i_k) + M h_yst,  and the slopes -rho R_k; R is 1 ohm of the last */
static void open_loop(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x,
                      vw_lanes *restrict here, vw_work *restrict work)
{
    const int n_pairs = vw_pairs(&filter->model);
    vw_lanes drop_v;
    drop_of(&filter->model, motion, x, here, drop_v);
    VW_EACH_CELL(c)
    {
        work->h[c] = here[VW_OCV][c] - x->resistance[c] * (drop_v[c] + x->branch_a[n_pairs][c]) +
                     filter->model.hysteresis_v * x->hysteresis[c];
        work->H[1 + n_pairs][c] = -x->resistance[c];
    }
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c) work->H[1 + k][c] = -x->resistance[c] * here[VW_R1 + k][c];
}

void vw_output_tangent(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    vw_soc_place at;
    vw_lanes here[VW_COLUMNS_MAX], slope[VW_COLUMNS_MAX], drop_v;
    vw_segment fresh, *segment = vw_segment_of(x, VW_AT_MEAN, &fresh);
    const vw_real per_step = 1 / model->soc_step;
    vw_place_soc(model, x->soc, &at);
    vw_circuit(model, &x->climate.place, &at, segment);
    vw_values(model, segment, &at, here);
    vw_ocv_slope(model, &at, slope[VW_OCV]);
    for (int q = VW_R0; q < vw_columns(model); q++)
        VW_EACH_CELL(c) slope[q][c] = segment->rise[q][c] * per_step;
    open_loop(filter, motion, x, here, work);
    /* dh/dz = dOCV/dz - rho (dR0/dz i + de/dz asinh(i / i_ref) + sum dR_k/dz i_k),  dh/di_k = -rho R_k */
    drop_of(model, motion, x, slope, drop_v);
    VW_EACH_CELL(c)
    {
        work->ocv_slope_v[c] = slope[VW_OCV][c];
        work->bend_v2[c] = 0;
        work->H[0][c] = slope[VW_OCV][c] - x->resistance[c] * drop_v[c];
    }
}

#define N_POINTS (VW_AT_LEFT + 1) /* along the first column: at its centre, c s and -c s */

/* A point, and the tables there. */
typedef struct {
    vw_soc_place soc;
    const vw_segment *segment;
} vw_point;

static inline vw_real at(const vw_point *point, int column, int c)
{
    return vw_between(point->segment, &point->soc, column, c);
}

VW_INLINE void over_points(const int n_pairs, const int has_overpotential, const vw_filter *filter,
                           const vw_motion *motion, const vw_cells *restrict x, const vw_point *restrict points,
                           const vw_lanes per_sd, vw_work *restrict work)
{
    const vw_real half_per_c2 = (vw_real)0.5 / vw_square(filter->rule.spread);
    const vw_point *mean = &points[VW_AT_MEAN], *to_right = &points[VW_AT_RIGHT], *to_left = &points[VW_AT_LEFT];
    VW_EACH_CELL(c)
    {
        const vw_real rho = x->resistance[c], r0 = at(mean, VW_R0, c), ocv = at(mean, VW_OCV, c);
        vw_real drop = r0 * motion->current_a;
        vw_real right = (at(to_right, VW_R0, c) - r0) * motion->current_a;
        vw_real left = (at(to_left, VW_R0, c) - r0) * motion->current_a;
        VW_UNROLL for (int k = 0; k < n_pairs; k++)
        {
            const vw_real r = at(mean, VW_R1 + k, c), i_k = x->branch_a[k][c];
            const vw_real shift = x->cov[VW_COV(1 + k, 0)][c] * per_sd[c];
            drop += r * i_k;
            right += (at(to_right, VW_R1 + k, c) - r) * (i_k + shift);
            left += (at(to_left, VW_R1 + k, c) - r) * (i_k - shift);
            work->H[1 + k][c] = -rho * r;
        }
        if (has_overpotential) {
            const vw_real e = at(mean, VW_R1 + n_pairs, c);
            drop += e * motion->over;
            right += (at(to_right, VW_R1 + n_pairs, c) - e) * motion->over;
            left += (at(to_left, VW_R1 + n_pairs, c) - e) * motion->over;
        }
        const vw_real right_ocv = at(to_right, VW_OCV, c) - ocv, left_ocv = at(to_left, VW_OCV, c) - ocv;
        const vw_real right_h = right_ocv - rho * right, left_h = left_ocv - rho * left;
        const vw_real q = right_h + left_h, half = half_per_c2 * per_sd[c]; /* 1 / (2 c s) */
        work->H[1 + n_pairs][c] = -rho;
        work->ocv_slope_v[c] = (right_ocv - left_ocv) * half;
        work->H[0][c] = (right_h - left_h) * half;
        work->h[c] = ocv - rho * (drop + x->branch_a[n_pairs][c]) + filter->model.hysteresis_v * x->hysteresis[c] +
                     filter->rule.weight * q;
        work->bend_v2[c] = filter->rule.curvature * q * q;
    }
}

/* With numbers that the compiler knows all of a cell stays in registers, as in the update. */
VW_INLINE void over_points_of(const int n_pairs, const vw_filter *filter, const vw_motion *motion,
                              const vw_cells *restrict x, const vw_point *restrict points, const vw_lanes per_sd,
                              vw_work *restrict work)
{
    if (filter->model.has_overpotential) over_points(n_pairs, 1, filter, motion, x, points, per_sd, work);
    else over_points(n_pairs, 0, filter, motion, x, points, per_sd, work);
}

void vw_output_sigma(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    vw_point points[N_POINTS];
    vw_segment fresh[N_POINTS];
    vw_lanes per_sd, soc[N_POINTS];
    VW_EACH_CELL(c)
    {
        per_sd[c] = filter->rule.spread / vw_sqrt(x->cov[0][c]);
        const vw_real reach = x->cov[0][c] * per_sd[c];
        soc[VW_AT_MEAN][c] = x->soc[c];
        soc[VW_AT_RIGHT][c] = x->soc[c] + reach;
        soc[VW_AT_LEFT][c] = x->soc[c] - reach;
    }
    for (int k = 0; k < N_POINTS; k++) {
        vw_segment *segment = vw_segment_of(x, k, &fresh[k]);
        vw_place_soc(model, soc[k], &points[k].soc);
        vw_circuit(model, &x->climate.place, &points[k].soc, segment);
        points[k].segment = segment;
    }
    switch (VW_LANES > 1 ? vw_pairs(model) : -1) {
    case 0: over_points_of(0, filter, motion, x, points, per_sd, work); break;
    case 1: over_points_of(1, filter, motion, x, points, per_sd, work); break;
    case 2: over_points_of(2, filter, motion, x, points, per_sd, work); break;
    case 3: over_points_of(3, filter, motion, x, points, per_sd, work); break;
    default: over_points_of(VW_LANES > 1 ? VW_RC_MAX - 1 : vw_pairs(model), filter, motion, x, points, per_sd, work);
    }
}
