/* The prediction: what happens to a state between two samples. Everything that moves is linear.
 *
 *   x' = A x + B i,   P' = A P A' + Q,   A = diag(1, a_1 ..),  a_k = exp(-dt / tau_k)
 *
 * Source: STATE-SPACE (exact for a current that is constant within a step), EKF-CDKF-2022 (currents as states).
 */
#include "vw_parts.h"

#define BEYOND_SHARE ((vw_real)0.1) /* of the charge, at currents beyond those of the cell file */

static vw_real vw_predict_compute_share(vw_real dt_s, vw_real time_s) { return 1 - vw_exp(-dt_s / time_s); }

vw_motion vw_predict_make_motion(const vw_filter *filter, vw_real dt_s, vw_real current_a)
{
    const vw_tuning *t = &filter->tuning;
    const vw_cell_model *model = &filter->model;
    vw_motion to;
    to.dt_s = dt_s;
    to.current_a = current_a;
    to.over = model->has_overpotential && !model->has_surface ? vw_asinh(current_a / model->overpotential_a) : 0;
    to.moved_ah = (current_a < 0 ? model->efficiency : 1) * current_a * dt_s / VW_SECONDS_PER_HOUR;
    to.walk = vw_min(vw_square(t->soc_walk) * dt_s, VW_SOC_VARIANCE_MAX) + VW_VARIANCE_STEP;
    to.keep = vw_sqrt(vw_max(1 - to.walk / VW_SOC_VARIANCE_MAX, 0));
    if (!model->has_tau_table)
        for (int k = 0; k < model->n_rc; k++) to.decay[k] = vw_exp(-dt_s / model->tau_s[k]);
    to.branch_v2 = vw_square(t->branch_rel * current_a);
    to.branch_floor_v2 = VW_VARIANCE_STEP * vw_square(model->capacity_ah);
    /* h' = f h - sign(m) (1 - f),  f = exp(-rate |m|),  m the share of the capacity moved */
    const vw_real moved = to.moved_ah / model->capacity_ah;
    to.hysteresis_keep = model->hysteresis_v > 0 ? vw_exp(-model->hysteresis_rate * vw_abs(moved)) : 1;
    to.hysteresis_pull = moved < 0 ? to.hysteresis_keep - 1 : 1 - to.hysteresis_keep;
    to.noise_v2 = vw_square(t->model_error_v);
    to.correlation = 1 + 2 * t->correlation_s / vw_max(dt_s, (vw_real)1e-3);
    to.is_beyond = filter->beyond_a > BEYOND_SHARE * filter->flow_a;
    to.own_share = to.is_beyond ? 1 - 1 / (vw_real)filter->n_cells : 1;
    to.shared_gain = 0;
    to.check_share = vw_predict_compute_share(dt_s, t->check_s);
    to.bias_share = vw_predict_compute_share(dt_s, t->bias_s);
    const vw_real rest_s = filter->rest_s + dt_s, since_s = filter->since_s + dt_s;
    const int has_rested = filter->rest_s >= 0 && dt_s > 0;
    const int rests = has_rested && vw_abs(current_a) < t->rest_c * model->capacity_ah;
    to.weighed_s = since_s < t->weighing_s - VW_TICK_S ? 0 : since_s;
    to.rest_share = rests ? dt_s / rest_s : 0;
    to.rest_lever = rests ? filter->rest_s * dt_s / 2 : 0;
    to.is_whole_rest = rests && rest_s >= t->rest_s - VW_TICK_S;
    const int is_broken = has_rested && !rests && filter->rest_s >= 2 * t->weighing_s - VW_TICK_S;
    to.is_rest_cut = has_rested && !rests;
    to.is_rest_on = rests && !to.is_whole_rest && to.weighed_s > 0;
    to.read_rest_s = to.is_whole_rest || to.is_rest_on ? rest_s : is_broken ? filter->rest_s : 0;
    to.wander_share = vw_predict_compute_share(to.weighed_s, t->wander_s);
    to.conflict_share = vw_predict_compute_share(to.weighed_s, t->check_s);
    /* as the lasting error, the last branch, decays */
    to.settled_share = vw_predict_compute_share(2 * to.weighed_s, model->tau_s[model->n_rc - 1]);
    return to;
}

/* a_k = exp(-dt / tau_k) of each cell. */
static void vw_predict_compute_decays(const vw_filter *filter, const vw_motion *motion, const vw_cells *restrict x,
                                      vw_lanes *decay)
{
    const vw_cell_model *model = &filter->model;
    if (!model->has_tau_table) {
        for (int k = 0; k < model->n_rc; k++)
            VW_EACH_CELL(c) decay[k][c] = motion->decay[k];
        return;
    }
    vw_soc_place at;
    vw_cell_model_place_soc(model, x->soc, &at);
    vw_cell_model_read_time_constants(model, &x->terms.place, &at, decay);
    for (int k = 0; k < model->n_rc; k++)
        VW_EACH_CELL(c) decay[k][c] = vw_exp(-motion->dt_s / decay[k][c]);
}

void vw_predict_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x)
{
    const vw_tuning *t = &filter->tuning;
    const int n_rc = filter->model.n_rc;
    const vw_real i = motion->current_a;
    vw_lanes decay[VW_RC_MAX];
    vw_predict_compute_decays(filter, motion, x, decay);
    vw_lanes lasting_v2;
    VW_EACH_CELL(c) lasting_v2[c] = vw_parts_compute_lasting_v2(motion, x, filter->model.slow_pair, c);
    /* z' = z - m,  P_zz' = keep^2 P_zz + walk,  m = eta i dt / capacity; the count and its sigmas likewise.
     * With a gain g it would be z - m (1 + g): V_z' = V_z - m. */
    const vw_real offset = t->counter_offset_c / VW_SECONDS_PER_HOUR * motion->dt_s;
    VW_EACH_CELL(c)
    {
        const vw_real moved = motion->moved_ah / x->capacity_ah[c];
        x->soc[c] -= moved;
        x->gain_slope[0][c] -= moved;
        x->fused_soc[c] -= moved * (1 + x->fused_gain[c]);
        x->drawn[c] += moved;
        x->count_soc[c] -= moved;
        x->count_gain[c] += t->counter_gain * moved;
        x->count_offset[c] += offset;
        x->hysteresis[c] = x->hysteresis[c] * motion->hysteresis_keep - motion->hysteresis_pull;
        x->cov[0][c] = x->cov[0][c] * vw_square(motion->keep) + motion->walk;
    }
    /* i_k' = a_k i_k + (1 - a_k) i,  P' = A P A + Q,  A = diag(keep, a_1 ..); nothing drives the lasting error */
    for (int k = 0; k < n_rc; k++) {
        const int u = 1 + k, is_lasting = k == n_rc - 1;
        const vw_real drive_a = is_lasting ? 0 : i;
        VW_EACH_CELL(c)
        {
            const vw_real a = decay[k][c];
            x->branch_a[k][c] = a * x->branch_a[k][c] + (1 - a) * drive_a;
            x->gain_slope[u][c] *= a;
            x->cov[VW_COV(u, 0)][c] *= motion->keep * a;
        }
        for (int q = 0; q < k; q++)
            VW_EACH_CELL(c) x->cov[VW_COV(u, 1 + q)][c] *= decay[k][c] * decay[q][c];
        VW_EACH_CELL(c)
        {
            const vw_real a2 = vw_square(decay[k][c]);
            vw_real *P = &x->cov[VW_COV(u, u)][c];
            const vw_real steady_v2 = is_lasting ? lasting_v2[c] : motion->branch_v2;
            *P = a2 * *P + (1 - a2) * steady_v2 + (is_lasting ? VW_VARIANCE_STEP : motion->branch_floor_v2);
        }
    }
}
