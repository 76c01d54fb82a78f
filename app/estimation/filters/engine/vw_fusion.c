/* What is reported: sigma, fusion with the charge count, self-check. */
#include "vw_parts.h"

#define LEAST_VARIANCE ((vw_real)1e-8) /* of a SOC at the start */
#define GIVEN 2 /* hypotheses of a SOC that was given: exact, roughly right */
#define CONTRADICTION 3 /* d^2 / 2 v, 2.4 sigma, from which a start is less likely than any other SOC */
#define ROUGH 1 /* the second of them */
#define READINGS 2 /* of a voltage at rest: settled, or driven before and relaxing */

/* v_f = P_zz + (mean square of the lasting innovation) / slope^2 + max(lowest - z, 0)^2: a model that errs is
 * trusted less, and below the lowest SOC that the cell file has seen at this temperature it only shows that it is below.
 * The slope is that of the sigma points or, if it is less, of a voltage that is read: in a plateau's step neither may be
 * local. */
void vw_fusion_compute_soc_variance(const vw_filter *filter, const vw_cells *restrict x, vw_work *restrict work)
{
    const vw_real floor_v2 = vw_square(VW_SLOPE_FLOOR_V);
    vw_lanes reading_slope_v;
    vw_cell_model_place_soc(&filter->model, x->soc, &work->at);
    vw_cell_model_read_reading_slope(&filter->model, &work->at, reading_slope_v);
    VW_EACH_CELL(c)
    {
        const vw_real slope_v = vw_min(work->ocv_slope_v[c], reading_slope_v[c]);
        const vw_real slope_v2 = vw_max(vw_square(slope_v), floor_v2);
        work->soc[c] = x->soc[c];
        const vw_real below = vw_max(x->terms.lowest_soc[c] - x->soc[c], 0);
        const vw_real own_v2 = x->slow_square_v2[c] / slope_v2 + x->cov[0][c] + vw_square(below);
        work->soc_v2[c] = vw_min(own_v2, VW_SOC_VARIANCE_MAX);
        work->slope_v2[c] = slope_v2;
    }
}

/* Normal density of d with variance v2. */
static vw_real vw_fusion_compute_normal(vw_real d, vw_real v2)
{
    return vw_exp(-d * d / v2 / 2) / vw_sqrt(v2 * (vw_real)6.283185307179586);
}

/* Student's density with 31 degrees of freedom: tails a little heavier than normal, and no exponential to compute. */
static vw_real vw_fusion_compute_student(vw_real d, vw_real v2)
{
    const vw_real tail2 = vw_square(1 + d * d / v2 * (vw_real)(1.0 / 32.0)), tail4 = tail2 * tail2;
    return 1 / (vw_square(vw_square(tail4)) * vw_sqrt(v2) * (vw_real)2.5066282746310002);
}

/* Mean voltage of a rest from the start on, and how it leans: the moments of a regression over time. What a small
 * current drops is no relaxation. */
void vw_fusion_accumulate_rest(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                               const vw_work *restrict work)
{
    const vw_real drop_v = filter->model.drop_per_a_v * motion->current_a;
    VW_EACH_CELL(c)
    {
        const vw_real now_v = work->voltage_v[c] + x->resistance[c] * drop_v;
        const vw_real off_v = vw_pick(vw_is_missing(now_v), 0, now_v - x->rest_mean_v[c]);
        x->rest_mean_v[c] += motion->rest_share * off_v;
        x->rest_moment[c] += motion->rest_lever * off_v;
    }
}

/* A voltage at rest, as a SOC at the start. */
typedef struct {
    vw_real soc, v2, weight;
} vw_reading;

/* The voltage of a rest read as of a settled cell, and as of one that was driven before and relaxes:
 *
 *   a = tail b,   n^2 = 12 (tail noise)^2 dt / T^3     left to relax, if it goes on as its slope b = 12 moment / T^3 says
 *   p^2 = rest_left_v^2 or (rho ohm driven_c)^2        what there may be: settled, or after so much current
 *   weight = P N(a; 0, p^2 + n^2)
 *   f = p^2 / (p^2 + n^2),   v = mean + b T / 2 + f a / 2     how much of it is no noise: 0..f a is left
 *   s^2 = rest_v^2 + ocv^2 + f n^2 + (f a / 2)^2 [+ (rest_slow p)^2, relaxing too slowly to be seen]
 *
 * ocv by hysteresis and temperature; who gave no SOC rather wakes up in a drive: rest_v and rest_left_v count twice. */
static void vw_fusion_read_rest_voltage(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x,
                                        int c, int is_given, vw_reading *readings)
{
    const vw_tuning *t = &filter->tuning;
    const vw_real T = motion->read_rest_s, per_moment = 12 / (T * T * T);
    const vw_real n2 = vw_square(t->rest_tail_s * t->rest_noise_v) * per_moment * motion->dt_s;
    const vw_real slope = per_moment * x->rest_moment[c], left_v = t->rest_tail_s * slope;
    const vw_real unsure = is_given ? 1 : 2, settled_v2 = vw_square(unsure * t->rest_left_v);
    const vw_real driven_v2 = vw_max(vw_square(x->resistance[c]) * x->terms.relaxing_v2[c], settled_v2);
    const vw_real likely[READINGS] = {settled_v2 + n2, driven_v2 + n2};
    const vw_real odds = t->rest_settled / (1 - t->rest_settled) * vw_sqrt(likely[1] / likely[0]) *
                         vw_exp(vw_square(left_v) / 2 * (1 / likely[1] - 1 / likely[0]));
    for (int j = 0; j < READINGS; j++) {
        const vw_real left_v2 = j == 0 ? settled_v2 : driven_v2, slow_v2 = j == 0 ? 0 : vw_square(t->rest_slow) * driven_v2;
        const vw_real f = left_v2 / (left_v2 + n2), half_v = f * left_v / 2;
        const vw_real rest_v = x->rest_mean_v[c] + slope * T / 2 + half_v;
        const vw_real ocv_v2 = x->terms.lasting_v2[c] - vw_square(t->lasting_v);
        const vw_real error_v2 = vw_square(unsure * t->rest_v) + ocv_v2 + f * n2 + vw_square(half_v) + slow_v2;
        const vw_real read = vw_cell_model_find_soc(&filter->model, &x->terms.place, c, rest_v);
        const vw_real sigma = vw_cell_model_compute_soc_sigma(&filter->model, &x->terms.place, c, read, vw_sqrt(error_v2));
        readings[j] = (vw_reading){read + x->drawn[c], vw_square(sigma), (j == 0 ? odds : 1) / (1 + odds)};
    }
}

/* By how much a voltage may be off that is seen to relax; a, n and the p of a cell that was driven as above.
 *
 *   u^2 = min(rest_unsettled^2 max(a^2 - (3 n)^2, 0), (2 p)^2)
 */
static vw_real vw_fusion_compute_unsettled_v2(const vw_tuning *t, const vw_motion *motion, const vw_cells *restrict x,
                                              int c)
{
    const vw_real T = motion->read_rest_s, per_moment = 12 / (T * T * T);
    const vw_real n2 = vw_square(t->rest_tail_s * t->rest_noise_v) * per_moment * motion->dt_s;
    const vw_real seen_v2 = vw_max(vw_square(t->rest_tail_s * per_moment * x->rest_moment[c]) - 9 * n2, 0);
    return vw_min(vw_square(t->rest_unsettled) * seen_v2, 4 * vw_square(x->resistance[c]) * x->terms.relaxing_v2[c]);
}

/* A hypothesis made of others: their moments. */
static void vw_fusion_add_hypothesis(vw_real *sum, vw_real weight, vw_real soc, vw_real v2)
{
    sum[0] += weight;
    sum[1] += weight * soc;
    sum[2] += weight * (v2 + vw_square(soc));
}

/* The voltage of a rest from the start on is evidence: about the SOC that was given, and a hypothesis of its own, settled
 * or relaxing. What is given is held against both readings.
 *
 * To use a SOC that is wrong costs what it is off, to refuse one that is right what the reading errs: the exact one
 * loses a share rest_uncertainty_soc^2 / (s_z^2 + rest_uncertainty_soc^2), s_z what s means in SOC.
 *
 * A rest that ends early counts against a SOC that was given only. One that goes on counts for the moment, and again
 * as a whole. */
void vw_fusion_update_from_rest(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                const vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    VW_EACH_CELL(c)
    {
        const int is_given = x->start_weight[0][c] > 0;
        if (vw_is_missing(work->voltage_v[c])) continue;
        if (!is_given) x->unsettled_v2[c] = vw_fusion_compute_unsettled_v2(t, motion, x, c);
        if (!is_given && !motion->is_whole_rest) continue;
        vw_reading readings[READINGS];
        vw_fusion_read_rest_voltage(filter, motion, x, c, is_given, readings);
        vw_real sums[VW_STARTS][3] = {{0}}, total = 0;
        for (int j = 0; j < READINGS; j++) {
            const vw_reading *read = &readings[j];
            vw_real kept = read->v2 / (read->v2 + vw_square(t->rest_uncertainty_soc));
            for (int k = 0; is_given && k < GIVEN; k++) {
                const vw_real soc = x->start_soc[k][c], v2 = x->start_v2[k][c], d = read->soc - soc, both_v2 = v2 + read->v2;
                const vw_real weight = x->start_weight[k][c] * read->weight * vw_fusion_compute_normal(d, both_v2) * kept;
                vw_fusion_add_hypothesis(sums[k], weight, soc + v2 / both_v2 * d, v2 * read->v2 / both_v2);
                kept = 1;
            }
            sums[GIVEN + j][0] = read->weight * (is_given ? 1 - t->start_exact - t->start_rough : 1);
            x->start_soc[GIVEN + j][c] = read->soc; /* also where its weight is too small for a number */
            x->start_v2[GIVEN + j][c] = read->v2;
        }
        for (int k = 0; k < VW_STARTS; k++) total += sums[k][0];
        for (int k = 0; k < VW_STARTS; k++) {
            x->start_weight[k][c] = sums[k][0] / total;
            if (k >= GIVEN || sums[k][0] <= 0) continue;
            x->start_soc[k][c] = sums[k][1] / sums[k][0];
            x->start_v2[k][c] = vw_max(sums[k][2] / sums[k][0] - vw_square(x->start_soc[k][c]), LEAST_VARIANCE);
        }
    }
}

/* Posterior of the capacity error: the gain that filter and counts go with, and its variance.
 *
 *   p = P(gain is not 0 | filter),  odds against = sigma_0 / s exp(-g^2 / 2 s^2),  s^2 = hidden_factor M
 *
 * `gain_v2` becomes the variance of p g.
 */
static void vw_fusion_update_gain_posterior(const vw_tuning *t, vw_cells *restrict x, vw_lanes gain_v2)
{
    vw_lanes s2, likely;
    VW_EACH_CELL(c) s2[c] = vw_max(t->hidden_factor * x->gain_v2[c], (vw_real)1e-12);
    VW_EACH_CELL(c) likely[c] = vw_exp(-vw_square(x->gain[c]) / s2[c] / 2);
    VW_EACH_CELL(c)
    {
        const vw_real p = 1 / (1 + t->gain_sigma / vw_sqrt(s2[c]) * likely[c]);
        x->fused_gain[c] = p * x->gain[c];
        gain_v2[c] = p * x->gain_v2[c] + p * (1 - p) * vw_square(x->gain[c]);
    }
}

/* The filter's error that it does not know of: within minutes a count cannot wander, whatever its start. */
static void vw_fusion_update_drift(const vw_tuning *t, const vw_motion *motion, vw_cells *restrict x)
{
    const vw_real a = motion->wander_share;
    VW_EACH_CELL(c)
    {
        const vw_real beyond = x->soc[c] - x->count_soc[c] - x->apart[c];
        x->wander_v2[c] += a * (1 - a) * (t->hidden_factor * beyond * beyond - x->wander_v2[c]);
        x->apart[c] += a * beyond;
        x->apart_v2[c] += a * (x->cov[0][c] - x->apart_v2[c]);
    }
}

/* Weigh the starts, and fuse the filter, which knows voltages only, with the count from each of them. */
static void vw_fusion_weigh_hypotheses(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                       const vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    vw_lanes gain_v2, lasting_v2;
    vw_fusion_update_gain_posterior(t, x, gain_v2);
    vw_fusion_update_drift(t, motion, x);
    VW_EACH_CELL(c) lasting_v2[c] = vw_parts_compute_lasting_v2(motion, x, filter->model.slow_pair, c);
    VW_EACH_CELL(c) x->unsettled_v2[c] -= motion->settled_share * x->unsettled_v2[c];
    VW_EACH_CELL(c)
    {
        const vw_real slope = x->gain_slope[0][c], z = x->soc[c] + slope * x->fused_gain[c];
        const vw_real alone_v2 = work->soc_v2[c] + vw_square(slope) * gain_v2[c];
        const vw_real filter_v2 = vw_min(alone_v2 + x->wander_v2[c], VW_SOC_VARIANCE_MAX);
        const vw_real lasts_v2 = lasting_v2[c] / work->slope_v2[c];
        const vw_real plateau_v2 = vw_square(lasts_v2) / (lasts_v2 + vw_square(t->rough_soc));
        const vw_real known_v2 = t->hidden_factor * vw_max(x->apart_v2[c] - x->cov[0][c], 0);
        const vw_real strays_v2 = vw_max(x->wander_v2[c] - known_v2, 0);
        const vw_real errs_v2 = vw_min(alone_v2 + strays_v2 + plateau_v2, VW_SOC_VARIANCE_MAX);
        const vw_real drift_v2 =
            gain_v2[c] * vw_square(x->drawn[c]) + vw_square(x->count_gain[c]) + vw_square(x->count_offset[c]);
        /* the filter when it was the surest, counted on: used below the lowest SOC that the cell file has seen */
        const vw_real counted = x->drawn[c] * (1 + x->fused_gain[c]), since = x->drawn[c] - x->best_drawn[c];
        const vw_real since_v2 = (gain_v2[c] + vw_square(t->counter_gain)) * vw_square(since) +
                                 vw_square(x->count_offset[c] - x->best_offset[c]);
        const vw_real aged_v2 = x->best_v2[c] + strays_v2 + since_v2; /* what strays now strayed then */
        const vw_real now_v2 = vw_min(alone_v2 + plateau_v2, VW_SOC_VARIANCE_MAX);
        const int is_best = errs_v2 <= aged_v2;
        x->best_soc[c] = vw_pick(is_best, z + counted, x->best_soc[c]);
        x->best_drawn[c] = vw_pick(is_best, x->drawn[c], x->best_drawn[c]);
        x->best_offset[c] = vw_pick(is_best, x->count_offset[c], x->best_offset[c]);
        x->best_v2[c] = vw_pick(is_best, now_v2, x->best_v2[c]);
        const vw_real kept_v2 = vw_min(errs_v2, aged_v2), off = z - (x->best_soc[c] - counted);
        const vw_real best_v2 = kept_v2 * (1 + vw_square(off * off / (9 * (errs_v2 + kept_v2))));
        const int is_below = x->soc[c] < x->terms.lowest_soc[c];
        const vw_real surer4 = vw_square(vw_square(errs_v2 / best_v2)), kept = vw_pick(is_below, surer4 / (1 + surer4), 0);
        /* beginning with the case that no start is right; moments count from the filter's SOC */
        vw_real sum = t->start_unknown, moved = -sum * kept * off, square = sum * vw_square(kept * off);
        vw_real v2 = sum * (filter_v2 + kept * (vw_min(best_v2, filter_v2) - filter_v2));
        VW_UNROLL for (int k = 0; k < VW_STARTS; k++)
        {
            const vw_real count_v2 = x->start_v2[k][c] + drift_v2;
            const vw_real d = z - (x->start_soc[k][c] - counted);
            const vw_real total_v2 = vw_min(errs_v2 + count_v2, vw_square(t->apart_soc_max));
            const vw_real contradicted = vw_max(d * d / total_v2 / 2 - CONTRADICTION, 0);
            const vw_real w = x->start_weight[k][c] * vw_fusion_compute_student(d, total_v2);
            x->start_weight[k][c] /= 1 + motion->wander_share * contradicted;
            const int is_less_sure = is_below & (k == ROUGH) & (best_v2 < count_v2);
            const vw_real sure_v2 = vw_pick(is_less_sure, best_v2, count_v2), apart = vw_pick(is_less_sure, off, d);
            const vw_real of_count = vw_square(errs_v2) / (vw_square(errs_v2) + vw_square(count_v2));
            const vw_real share = vw_pick(is_less_sure, kept, of_count);
            sum += w;
            moved -= w * share * apart;
            square += w * vw_square(share * apart);
            v2 += w * (filter_v2 + share * (sure_v2 - filter_v2));
        }
        moved /= sum;
        const vw_real fused_v2 = v2 / sum + vw_max(square / sum - vw_square(moved), 0);
        x->fused_soc[c] = z + moved;
        /* what has not settled is off in both, so neither is the surer one for it */
        x->fused_v2[c] = fused_v2 + x->unsettled_v2[c] / work->slope_v2[c];
        x->conflict[c] += motion->conflict_share * (vw_square(moved) / (filter_v2 + fused_v2) - x->conflict[c]);
    }
}

/* Fuse the filter, which starts from voltage alone, with charge counted from every start that there may have been.
 *
 * Starts are hypotheses: the SOC that was given is exact, or it is roughly right, or the voltage at rest was; or none
 * of them. While a count and the filter agree the surer one counts: by the squares of their variances, steeper than the
 * precision-weighted mean, since the errors of a model last and do not average out against those of a count. What
 * contradicts the filter loses its weight.
 *
 *   v_f = v_filter + S,  S' = S + a (1 - a) (f (d - m)^2 - S),  m' = m + a (d - m),  a = 1 - exp(-dt / wander_s)
 *   z_f = z_filter + p g V_z,  v_filter likewise with var(p g) V_z^2
 *   z_k = s_k - q (1 + p g),   v_k = v_s + var(p g) q^2 + gain^2 + offset^2      q charge drawn since the start
 *   d_k = z_f - z_k,           w_k = P(k at the start) t(d_k; 0, min(u_f + v_k, apart_soc_max^2)),   w_0 = start_unknown
 *   z   = sum w_k (z_f - h_k d_k) / sum w_k,    h_k = u_f^2 / (u_f^2 + v_k^2)
 *   u_f = v_f - min(f e, S) + l^2 / (l + rough_soc^2),   l = lasting error / slope^2, large in a plateau
 *   e   = max(P_m - P_zz, 0),  P_m' = P_m + a (P_zz - P_m)      what the filter moved within its own covariance
 *   where no start is right, and for a rough one that is less sure: z_b = z_f when u_f was least, counted on, with
 *   v_b = (u_f then + S now + var(p g) q^2 + gain^2 + offset^2 since) (1 + (d_b^2 / 9 (u_f + v_b))^2), in place of z_k
 *   and v_k, and h_b = u_f^4 / (u_f^4 + v_b^4); 0 but below the lowest SOC that the cell file has seen
 *   P'  = P / (1 + a max(d_k^2 / 2 v - 3, 0))                   v as in w_k: what was contradicted stays so
 *   v   = sum w_k (v_f + h_k (v_k - v_f) + (z_f - h_k d_k - z)^2) / sum w_k
 *
 * Where no SOC was given and the voltage of a rest at the start still relaxes, filter and count read the same voltage,
 * and are off by the same u, which decays as the lasting error: v grows by u^2 / slope^2. Under current both learn
 * otherwise: a rest that is not whole leaves no u.
 *
 * Where filter and fusion disagree for long by more than both may err, sigma grows by as much.
 */
void vw_fusion_fuse_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                          vw_work *restrict work)
{
    if (motion->weighed_s > 0) vw_fusion_weigh_hypotheses(filter, motion, x, work);
    VW_EACH_CELL(c)
    {
        work->soc[c] = x->fused_soc[c];
        work->soc_v2[c] = vw_min(x->fused_v2[c] * vw_max(1, x->conflict[c]), VW_SOC_VARIANCE_MAX);
    }
}

/* Does the model describe this cell? Slow averages of the innovation and of its square answer per cell.
 *
 *   m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest
 *
 * over check_s for y and y^2, over bias_s for y, and over check_s again for the square of that: an innovation that
 * does not average out is an error that the filter takes for charge.
 */
void vw_fusion_check_model(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                           vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    VW_EACH_CELL(c)
    {
        const int counts = work->used[c] > 0;
        const vw_real scale = t->model_error_v / vw_sqrt(vw_parts_compute_noise_v2(motion, x, c));
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
        const int is_near = (x->terms.drop_error[c] < t->drop_error_max) & (work->soc[c] >= x->terms.lowest_soc[c]);
        const int is_known = is_near & (vw_abs(motion->current_a) <= filter->model.seen_a);
        work->valid[c] = vw_pick(is_small & is_centred & is_known & (x->conflict[c] < vw_square(t->gate)), 1, 0);
    }
}
