/* The update: condition the state on one sample of voltages.
 *
 *   P_xy = P H,   P_yy = H P H + k q^2,   S = P_yy + R
 *   x' = x + K nu,   P' = P - K P_xy',   K = P_xy / S
 *
 * P' cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is never below the model's own variance.
 *
 * The gain g of the charge is learned next to the filter, which goes on as if there were none (Friedland): with one
 * the mean would be x + V g and its innovation nu - H V g.
 *
 *   g' = g + M H V (nu - H V g) / (S_g + (H V)^2 M),   M' = M S_g / (S_g + (H V)^2 M),   V' = V - K H V
 *   S_g = cold^2 (S + correlation (H_z^2 wander + slow))
 *
 * A filter that wanders against the count, or whose innovations do not average out, says the less of charge, and so does
 * a cold cell, whose slow overpotential looks like charge. Beyond the temperatures that the cell file has seen nothing is
 * learned. Beyond its currents the model errs as charge would, and alike for all cells: what they differ by counts, their
 * mean does not. Each of n cells moves by what its sample says less the mean of the sample before, M by a share 1 - 1/n.
 *
 * Source: EKF-CDKF-2022 for x, P and K; Friedland, IEEE Trans. Automatic Control 14 (1969) 359, for g, V and M.
 */
#include "vw_parts.h"

VW_INLINE void vw_update_states(const int n_states, const vw_filter *filter, const vw_motion *motion,
                                vw_cells *restrict x, vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    const vw_real gate_v2 = vw_square(t->gate), widening = vw_square(t->gate_recovery) * motion->dt_s;
    VW_EACH_CELL(c)
    {
        vw_real Pxy[VW_STATES_MAX], Pyy = work->bend_v2[c], HV = 0;
        VW_UNROLL for (int u = 0; u < n_states; u++)
        {
            Pxy[u] = 0;
            VW_UNROLL for (int w = 0; w < n_states; w++)
                Pxy[u] += x->cov[w <= u ? VW_COV(u, w) : VW_COV(w, u)][c] * work->H[w][c];
            Pyy += Pxy[u] * work->H[u][c];
            HV += work->H[u][c] * x->gain_slope[u][c];
        }
        /* the model's error grows near empty and where nothing was measured */
        const vw_real noise_v2 = vw_parts_compute_noise_v2(motion, x, c) * vw_square(vw_parts_compute_empty_growth(x, c));
        const vw_real expected_v2 = Pyy + noise_v2, S = Pyy + noise_v2 * motion->correlation;
        const vw_real nu = work->voltage_v[c] - work->h[c];
        /* gate: nu^2 <= gate^2 S, or outside it for longer than gate_hold_s; then the SOC's variance grows */
        const int is_missing = vw_is_missing(nu), is_inside = nu * nu <= gate_v2 * expected_v2;
        const vw_real held_s = x->refused_s[c] + vw_pick(is_missing, 0, motion->dt_s);
        const vw_real refused_s = vw_pick(is_inside, 0, held_s);
        const int is_accepted = !is_inside & !is_missing & (refused_s > t->gate_hold_s);
        const int is_used = is_inside | is_accepted;
        const vw_real wide_v2 = vw_max(vw_min(x->cov[0][c] + widening, VW_SOC_VARIANCE_MAX), x->cov[0][c]);
        x->cov[0][c] = vw_pick(is_accepted, wide_v2, x->cov[0][c]);
        x->refused_s[c] = refused_s;
        work->innovation_v[c] = nu;
        work->innovation_sigma_v[c] = vw_sqrt(expected_v2);
        work->used[c] = vw_pick(is_used, 1, 0);
        /* g */
        const int learns = is_used & (motion->own_share > 0) & (x->terms.drop_error[c] < t->drop_error_max);
        const vw_real lasting_v2 = vw_square(work->H[0][c]) * x->wander_v2[c] + x->slow_square_v2[c];
        const vw_real S_g = x->terms.cold2[c] * (S + motion->correlation * lasting_v2);
        const vw_real M = x->gain_v2[c], gain_v2 = S_g + vw_square(HV) * M;
        const vw_real per_both = 1 / (gain_v2 * S), per_v2 = S * per_both; /* a division takes longer than all else */
        const vw_real moved = M * HV * (nu - HV * x->gain[c]) * per_v2;
        x->gain[c] += vw_pick(learns, moved - motion->shared_gain, 0);
        x->gain_step[c] = vw_pick(learns, moved, NAN);
        x->gain_v2[c] = vw_pick(learns, M + motion->own_share * (M * S_g * per_v2 - M), M);
        /* x and P; a voltage that is not used moves nothing */
        const vw_real per_S = vw_pick(is_used, gain_v2 * per_both, 0), pull = vw_pick(is_used, nu, 0) * per_S;
        x->soc[c] = vw_clip(x->soc[c] + Pxy[0] * pull, VW_SOC_MIN, VW_SOC_MAX);
        VW_UNROLL for (int u = 1; u < n_states; u++) x->branch_a[u - 1][c] += Pxy[u] * pull;
        VW_UNROLL for (int u = 0; u < n_states; u++)
        {
            const vw_real K = Pxy[u] * per_S;
            x->gain_slope[u][c] -= K * HV;
            VW_UNROLL for (int w = 0; w <= u; w++) x->cov[VW_COV(u, w)][c] -= K * Pxy[w];
        }
    }
}

void vw_update_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const int n_states = 1 + filter->model.n_rc;
    /* with a number that the compiler knows a cell's covariance stays in registers */
    switch (VW_LANES > 1 ? n_states : 0) {
    case 2: vw_update_states(2, filter, motion, x, work); break;
    case 3: vw_update_states(3, filter, motion, x, work); break;
    case 4: vw_update_states(4, filter, motion, x, work); break;
    case 5: vw_update_states(5, filter, motion, x, work); break;
    default: vw_update_states(VW_LANES > 1 ? VW_STATES_MAX : n_states, filter, motion, x, work);
    }
}
