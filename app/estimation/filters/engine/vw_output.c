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

void vw_output_tangent(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x, vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    vw_soc_place at;
    vw_lanes here[VW_COLUMNS_MAX], slope[VW_COLUMNS_MAX], drop_v;
    vw_place_soc(model, x->soc, &at);
    vw_circuit(model, &x->climate.place, &at, here);
    vw_circuit_slope(model, &x->climate.place, &at, slope);
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

/* Output at one point along the first column, counted from the centre; `side` is 1 to the right, -1 to the left. */
static void beside(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x,
                   vw_lanes *restrict here, const vw_lanes reach, const vw_lanes per_sd, vw_real side, vw_lanes ocv,
                   vw_lanes h)
{
    const vw_cell_model *model = &filter->model;
    const int n_pairs = vw_pairs(model);
    vw_soc_place at;
    vw_lanes soc, there[VW_COLUMNS_MAX], drop;
    VW_EACH_CELL(c) soc[c] = x->soc[c] + side * reach[c];
    vw_place_soc(model, soc, &at);
    vw_circuit(model, &x->climate.place, &at, there);
    VW_EACH_CELL(c) drop[c] = (there[VW_R0][c] - here[VW_R0][c]) * motion->current_a;
    for (int k = 0; k < n_pairs; k++)
        VW_EACH_CELL(c)
        {
            const vw_real shift = side * x->cov[VW_COV(1 + k, 0)][c] * per_sd[c];
            drop[c] += (there[VW_R1 + k][c] - here[VW_R1 + k][c]) * (x->branch_a[k][c] + shift);
        }
    if (model->has_overpotential)
        VW_EACH_CELL(c) drop[c] += (there[VW_R1 + n_pairs][c] - here[VW_R1 + n_pairs][c]) * motion->over;
    VW_EACH_CELL(c)
    {
        ocv[c] = there[VW_OCV][c] - here[VW_OCV][c];
        h[c] = ocv[c] - x->resistance[c] * drop[c];
    }
}

void vw_output_sigma(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x, vw_work *restrict work)
{
    const vw_cell_model *model = &filter->model;
    vw_soc_place at;
    vw_lanes here[VW_COLUMNS_MAX], per_sd, reach, right_ocv, right, left_ocv, left;
    vw_place_soc(model, x->soc, &at);
    vw_circuit(model, &x->climate.place, &at, here);
    open_loop(filter, motion, x, here, work);
    VW_EACH_CELL(c)
    {
        per_sd[c] = filter->rule.spread / vw_sqrt(x->cov[0][c]); /* c / s */
        reach[c] = x->cov[0][c] * per_sd[c];                     /* c s */
    }
    beside(filter, motion, x, here, reach, per_sd, 1, right_ocv, right);
    beside(filter, motion, x, here, reach, per_sd, -1, left_ocv, left);
    const vw_real half_per_c2 = (vw_real)0.5 / vw_square(filter->rule.spread);
    VW_EACH_CELL(c)
    {
        const vw_real q = right[c] + left[c], half = half_per_c2 * per_sd[c]; /* 1 / (2 c s) */
        work->ocv_slope_v[c] = (right_ocv[c] - left_ocv[c]) * half;
        work->H[0][c] = (right[c] - left[c]) * half;
        work->h[c] += filter->rule.weight * q;
        work->bend_v2[c] = filter->rule.curvature * q * q;
    }
}
