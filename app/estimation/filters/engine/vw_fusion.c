/* What is reported: sigma, fusion with the charge count, self-check. */
#include "vw_parts.h"

/* v_f = P_zz + (bias^2 + mean square of the lasting innovation) / slope^2: a model that errs is trusted less. */
void vw_soc_variance(const vw_filter *filter, const vw_cells *restrict x, vw_work *restrict work)
{
    const vw_real bias_v2 = vw_square(filter->tuning.bias_v), floor_v2 = vw_square(VW_SLOPE_FLOOR_V);
    VW_EACH_CELL(c)
    {
        const vw_real slope_v2 = vw_max(vw_square(work->ocv_slope_v[c]), floor_v2);
        work->soc[c] = x->soc[c];
        work->soc_v2[c] = vw_min((x->slow_square_v2[c] + bias_v2) / slope_v2 + x->cov[0][c], VW_SOC_VARIANCE_MAX);
    }
}

/* Fuse the filter, which starts from voltage alone, with the charge count: two independent estimates of the SOC.
 *
 * While they agree the surer one counts: by the squares of their variances, steeper than the precision-weighted mean,
 * since the errors of a model last and do not average out against those of a count. When they contradict each other
 * the start was wrong, and the filter rules; a count that stays contradicted is anchored anew. Within minutes a count
 * cannot wander, whatever its start: how far the filter wanders against it is an error it does not know of.
 *
 *   v_f = v_filter + S,  S' = S + a (1 - a) (f (d - m)^2 - S),  m' = m + a (d - m),  a = 1 - exp(-dt / wander_s)
 *   v_c = v_anchor + gain^2 + offset^2
 *   v_t = min(v_f + v_c, doubt_soc^2)
 *   w   = P(start was right | both)                   from t(d; 0, v_t) against "anywhere in 0..1"
 *   z   = z_f - w g d,  g = v_f^2 / (v_f^2 + v_c^2),  d = z_f - z_c
 *   v   = v_f + w g (v_c - v_f + (1 - w) g d^2)       no less than either's where their errors are the same
 *
 * t is Student's density with 31 degrees of freedom: (1 + d^2 / 32 v_t)^-16, tails a little heavier than normal and
 * no exponential to compute.
 */
void vw_fuse(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    const vw_real a = motion->wander_share, root_2pi = (vw_real)2.5066282746310002;
    const vw_real odds = t->start_unknown / (1 - t->start_unknown) * root_2pi;
    const vw_real total_max = vw_square(t->doubt_soc);
    VW_EACH_CELL(c)
    {
        const vw_real d = x->soc[c] - x->count_soc[c], count_v2 = vw_count_v2(x, c);
        const vw_real beyond = d - x->apart[c];
        const vw_real wander_v2 = x->wander_v2[c] + a * (1 - a) * (t->wander_factor * beyond * beyond - x->wander_v2[c]);
        const vw_real apart = x->apart[c] + a * beyond;
        const vw_real filter_v2 = vw_min(work->soc_v2[c] + wander_v2, VW_SOC_VARIANCE_MAX);
        const vw_real total_v2 = vw_min(filter_v2 + count_v2, total_max);
        const vw_real tail2 = vw_square(1 + d * d / total_v2 * (vw_real)(1.0 / 32.0)), tail4 = tail2 * tail2;
        const vw_real tail16 = vw_square(vw_square(tail4));
        /* w = 1 / against,  g = v_f^2 / squares, with one division for two */
        const vw_real against = 1 + odds * vw_sqrt(total_v2) * tail16;
        const vw_real squares = vw_square(count_v2) + vw_square(filter_v2);
        const vw_real inverse = 1 / (against * squares);
        const vw_real w = squares * inverse, g = vw_square(filter_v2) * against * inverse;
        work->soc[c] = x->soc[c] - w * g * d;
        work->soc_v2[c] = filter_v2 + w * g * (count_v2 - filter_v2 + (1 - w) * g * d * d);
        /* contradicted for too long: count on from where the filter is */
        const vw_real doubt_s = vw_pick(w < (vw_real)0.5, x->doubt_s[c] + motion->dt_s, 0);
        const int is_anew = doubt_s > t->anchor_s;
        x->count_soc[c] = vw_pick(is_anew, x->soc[c], x->count_soc[c]);
        x->count_gain[c] = vw_pick(is_anew, 0, x->count_gain[c]);
        x->count_offset[c] = vw_pick(is_anew, 0, x->count_offset[c]);
        x->anchor_v2[c] = vw_pick(is_anew, t->anchor_factor * filter_v2, x->anchor_v2[c]);
        x->apart[c] = vw_pick(is_anew, 0, apart);
        x->doubt_s[c] = vw_pick(is_anew, 0, doubt_s);
        x->wander_v2[c] = wander_v2;
    }
}

/* Does the model describe this cell? Slow averages of the innovation and of its square answer per cell.
 *
 *   m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest
 *
 * over check_s for y and y^2, over bias_s for y, and over check_s again for the square of that: an innovation that
 * does not average out is an error that the filter takes for charge.
 */
void vw_self_check(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    const vw_real scale = t->model_error_v / vw_sqrt(motion->noise_v2);
    VW_EACH_CELL(c)
    {
        const int counts = work->used[c] > 0;
        const vw_real y = vw_pick(counts, work->innovation_v[c] * scale, 0);
        const vw_real share = vw_pick(counts, motion->check_share, 0);
        const vw_real bias_share = vw_pick(counts, motion->bias_share, 0);
        const vw_real slow = x->slow_mean_v[c];
        x->check_mean_v[c] += share * (y - x->check_mean_v[c]);
        x->check_square_v2[c] += share * (y * y - x->check_square_v2[c]);
        x->slow_square_v2[c] += share * (slow * slow - x->slow_square_v2[c]);
        x->slow_mean_v[c] += bias_share * (y - slow);
        const int is_small = x->check_square_v2[c] < vw_square(t->check_rms_v);
        const int is_centred = vw_abs(x->check_mean_v[c]) < t->check_bias_v;
        work->valid[c] = vw_pick(is_small & is_centred, 1, 0);
    }
}
