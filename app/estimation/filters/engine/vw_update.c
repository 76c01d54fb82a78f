/* The update: condition the state on one sample of voltages.
 *
 *   P_xy = P H,   P_yy = H P H + k q^2,   S = P_yy + R
 *   x' = x + P_xy nu / S,   P' = P - P_xy P_xy' / S
 *
 * P' cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is never below the model's own variance.
 */
#include "vw_parts.h"

/* P_xy = P H, and P_yy into `Pyy`. */
static void project(const vw_cells *restrict x, const vw_work *restrict work, int n_states, vw_lanes *Pxy, vw_lanes Pyy)
{
    VW_EACH_CELL(c) Pyy[c] = work->bend_v2[c];
    for (int u = 0; u < n_states; u++) {
        VW_EACH_CELL(c) Pxy[u][c] = 0;
        for (int w = 0; w < n_states; w++) {
            const vw_real *P = x->cov[w <= u ? VW_COV(u, w) : VW_COV(w, u)];
            VW_EACH_CELL(c) Pxy[u][c] += P[c] * work->H[w][c];
        }
        VW_EACH_CELL(c) Pyy[c] += Pxy[u][c] * work->H[u][c];
    }
}

/* The gain g of the charge, beside the filter, which goes on as if there were none (Friedland 1969): with one the mean
 * would be x + V g and its innovation nu - H V g.
 *
 *   g' = g + M H V (nu - H V g) / (S_g + (H V)^2 M),   M' = M S_g / (S_g + (H V)^2 M),   V' = V - P_xy H V / S
 *   S_g = S + correlation (H_z^2 wander + slow)
 *
 * A filter that wanders against the count, or whose innovations do not average out, says the less of charge. Outside the temperatures that were measured nothing is learned of it. */
static void learn_gain(vw_real drop_error_max, vw_real correlation, vw_cells *restrict x, const vw_work *restrict work, int n_states,
                       vw_lanes *Pxy, const vw_lanes per_sigma)
{
    vw_lanes HV;
    VW_EACH_CELL(c) HV[c] = 0;
    for (int u = 0; u < n_states; u++)
        VW_EACH_CELL(c) HV[c] += work->H[u][c] * x->gain_slope[u][c];
    VW_EACH_CELL(c)
    {
        const vw_real shown_v2 = correlation * (vw_square(work->H[0][c]) * x->wander_v2[c] + x->slow_square_v2[c]);
        const vw_real per_v2 = vw_square(per_sigma[c]) / (1 + shown_v2 * vw_square(per_sigma[c]));
        const vw_real off_v = work->innovation_v[c] - HV[c] * x->gain[c];
        const int learns = (work->used[c] > 0) & (x->climate.drop_error[c] < drop_error_max);
        const vw_real kept = 1 / (1 + vw_square(HV[c]) * x->gain_v2[c] * per_v2);
        x->gain[c] += vw_pick(learns, kept * x->gain_v2[c] * HV[c] * per_v2 * off_v, 0);
        x->gain_v2[c] *= vw_pick(learns, kept, 1);
    }
    for (int u = 0; u < n_states; u++)
        VW_EACH_CELL(c) x->gain_slope[u][c] -= Pxy[u][c] * vw_square(per_sigma[c]) * HV[c];
}

void vw_update(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work)
{
    const vw_tuning *t = &filter->tuning;
    const int n_states = 1 + filter->model.n_rc;
    const vw_real gate_v2 = vw_square(t->gate), widening = vw_square(t->gate_recovery) * motion->dt_s;
    vw_lanes Pxy[VW_STATES_MAX], Pyy, per_sigma, pull;
    project(x, work, n_states, Pxy, Pyy);
    VW_EACH_CELL(c)
    {
        /* the model's error grows near empty and where nothing was measured */
        const vw_real noise_v2 = vw_noise_v2(motion, x, c) * vw_square(vw_empty_growth(x, c));
        const vw_real expected_v2 = Pyy[c] + noise_v2;
        const vw_real nu = work->voltage_v[c] - work->h[c];
        /* gate: nu^2 <= gate^2 S, or outside it for longer than gate_hold_s; then the SOC's variance grows */
        const int is_missing = vw_is_missing(nu), is_inside = nu * nu <= gate_v2 * expected_v2;
        const vw_real held_s = x->refused_s[c] + vw_pick(is_missing, 0, motion->dt_s);
        const vw_real refused_s = vw_pick(is_inside, 0, held_s);
        const int is_believed = !is_inside & !is_missing & (refused_s > t->gate_hold_s);
        const int is_used = is_inside | is_believed;
        const vw_real wide_v2 = vw_max(vw_min(x->cov[0][c] + widening, VW_SOC_VARIANCE_MAX), x->cov[0][c]);
        x->cov[0][c] = vw_pick(is_believed, wide_v2, x->cov[0][c]);
        x->refused_s[c] = refused_s;
        const vw_real root = 1 / vw_sqrt(Pyy[c] + noise_v2 * motion->correlation);
        per_sigma[c] = vw_pick(is_used, root, 0);
        pull[c] = vw_pick(is_used, nu * root, 0);
        work->innovation_v[c] = nu;
        work->innovation_sigma_v[c] = vw_sqrt(expected_v2);
        work->used[c] = vw_pick(is_used, 1, 0);
    }
    learn_gain(t->drop_error_max, motion->correlation, x, work, n_states, Pxy, per_sigma);
    /* with y = P_xy / sqrt(S):  x' = x + y nu / sqrt(S),  P' = P - y y' */
    for (int u = 0; u < n_states; u++) {
        vw_real *state = u == 0 ? x->soc : x->branch_a[u - 1];
        VW_EACH_CELL(c)
        {
            Pxy[u][c] *= per_sigma[c];
            state[c] += Pxy[u][c] * pull[c];
        }
        for (int w = 0; w <= u; w++)
            VW_EACH_CELL(c) x->cov[VW_COV(u, w)][c] -= Pxy[u][c] * Pxy[w][c];
    }
    VW_EACH_CELL(c) x->soc[c] = vw_clip(x->soc[c], VW_SOC_MIN, VW_SOC_MAX);
}
