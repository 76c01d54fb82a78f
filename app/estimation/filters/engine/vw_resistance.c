/* Regression through the origin of measured on modelled drops, with fading memory.
 *
 *   y = v_ocv - v,   x = (v_ocv - v_model) / f_used;   y = f x + error, both without what is slower than DRIFT_S
 *   m' = m + (1 - exp(-dt / DRIFT_S)) (y - m)                             of y and x, the slow part of each
 *   s' = exp(-dt / MEMORY_S) s + dt (x x, x y, y y)                       of what is left of them
 *   e  = 2 LASTING_S (s_yy - s_xy^2 / s_xx) / seconds
 *   f  = (s_xy / e + w f_0) / (s_xx / e + w),   sigma = (s_xx / e + w)^-1/2,   w = 1 / sigma_0^2
 *
 * All resistances of a cell are taken to grow alike. What is slow is SOC, heat and overpotential and shows nothing. */
#include "vw_resistance.h"

#define DRIFT_S 40
#define MEMORY_S 300 /* four or five laps; heat changes resistances, and the model follows heat only in part */
#define LASTING_S 6  /* of an error from which the drift has been taken: closer samples repeat each other */
#define RESTART_S 2  /* after a hole this long the drift starts again */
#define FACTOR_MIN ((vw_real)0.2) /* beyond them, it is no resistance */
#define FACTOR_MAX 10
#define QUIET_V ((vw_real)2e-3)   /* where no cell's drop moves more, nothing is learned and nothing is forgotten */
#define DROP_MAX_V ((vw_real)1.5) /* a larger difference of voltages is a measurement that failed */
#define ERROR_MIN_V2 ((vw_real)1e-6)

/* Split the drops of a sample into what is slow and the rest; returns the largest of the rest that the model predicts. */
static vw_real vw_resistance_split_drift(int n, vw_real *restrict rows, vw_real dt_s, vw_real share,
                                         const vw_real *restrict estimates, const vw_real *restrict factor,
                                         const vw_real *restrict voltage_v)
{
    const vw_real *ocv_v = estimates + VW_OCV_V * n, *model_v = estimates + VW_VOLTAGE_V * n;
    vw_real *slow_y = rows + VW_SLOW_MEASURED * n, *slow_x = rows + VW_SLOW_MODELLED * n, *has = rows + VW_HAS_SLOW * n;
    vw_real *fast_y = rows + VW_FAST_MEASURED * n, *fast_x = rows + VW_FAST_MODELLED * n, *known = rows + VW_KNOWN * n;
    vw_real most = 0;
    for (int c = 0; c < n; c++) {
        const vw_real y = ocv_v[c] - voltage_v[c], x = (ocv_v[c] - model_v[c]) / factor[c];
        const int is_known = (vw_abs(y) < DROP_MAX_V) & (vw_abs(x) < DROP_MAX_V);
        const int had_slow = (has[c] > 0) & (dt_s <= RESTART_S), is_fresh = is_known & !had_slow;
        const vw_real from_y = is_fresh ? y : slow_y[c], from_x = is_fresh ? x : slow_x[c];
        const vw_real left_y = is_known ? y - from_y : 0, left_x = is_known ? x - from_x : 0;
        has[c] = vw_pick(had_slow | is_known, 1, 0);
        known[c] = vw_pick(is_known, 1, 0);
        fast_y[c] = left_y;
        fast_x[c] = left_x;
        slow_y[c] = from_y + share * left_y;
        slow_x[c] = from_x + share * left_x;
        most = vw_max(most, vw_abs(left_x));
    }
    return most;
}

static void vw_resistance_add_sums(int n, vw_real *restrict rows, vw_real dt_s, vw_real fade)
{
    const vw_real *y = rows + VW_FAST_MEASURED * n, *x = rows + VW_FAST_MODELLED * n, *known = rows + VW_KNOWN * n;
    vw_real *xx = rows + VW_SUM_XX * n, *xy = rows + VW_SUM_XY * n, *yy = rows + VW_SUM_YY * n;
    vw_real *weight_s = rows + VW_WEIGHT_S * n;
    for (int c = 0; c < n; c++) {
        xx[c] = fade * xx[c] + dt_s * (x[c] * x[c]);
        xy[c] = fade * xy[c] + dt_s * (x[c] * y[c]);
        yy[c] = fade * yy[c] + dt_s * (y[c] * y[c]);
        weight_s[c] = fade * weight_s[c] + dt_s * known[c];
    }
}

void vw_resistance_record(int32_t n_cells, vw_real *rows, int64_t n_steps, const vw_real *dt_s,
                          const vw_real *estimates, const vw_real *factor, const vw_real *voltage_v)
{
    vw_real share = 0, fade = 1;
    for (int64_t k = 0; k < n_steps; k++) {
        const vw_real dt = dt_s[k];
        if (k == 0 || dt != dt_s[k - 1]) {
            share = 1 - vw_exp(-dt / DRIFT_S);
            fade = vw_exp(-dt / MEMORY_S);
        }
        const vw_real most = vw_resistance_split_drift(n_cells, rows, dt, share, estimates + k * VW_ESTIMATES * n_cells,
                                                       factor, voltage_v + k * n_cells);
        if (most >= QUIET_V) vw_resistance_add_sums(n_cells, rows, dt, fade);
    }
}

void vw_resistance_judge(int32_t n_cells, vw_real *rows)
{
    const int n = n_cells;
    for (int c = 0; c < n; c++) {
        const vw_real xx = rows[VW_SUM_XX * n + c], xy = rows[VW_SUM_XY * n + c], yy = rows[VW_SUM_YY * n + c];
        const vw_real weight_s = rows[VW_WEIGHT_S * n + c], prior_weight = rows[VW_PRIOR_WEIGHT * n + c];
        const vw_real left_v2s = xx > 0 ? yy - xy * xy / xx : yy;
        const vw_real error_v2s = 2 * LASTING_S * vw_max(weight_s > 0 ? left_v2s / weight_s : 0, ERROR_MIN_V2);
        const vw_real precision = xx / error_v2s + prior_weight;
        const vw_real factor = (xy / error_v2s + prior_weight * rows[VW_PRIOR * n + c]) / precision;
        rows[VW_FACTOR * n + c] = vw_clip(factor, FACTOR_MIN, FACTOR_MAX);
        rows[VW_FACTOR_SIGMA * n + c] = 1 / vw_sqrt(precision);
    }
}

/* 1 + g / (1 + (s / g)^6), g = factor - 1: see shared_factor in resistance_scale.py. */
static vw_real vw_resistance_shrink_factor(const vw_learning *learning, vw_real factor)
{
    const vw_real growth = factor - 1, error = growth < 0 ? learning->less_shape_error : learning->shape_error;
    const vw_real growth2 = growth * growth, error2 = error * error;
    const vw_real growth6 = growth2 * growth2 * growth2, error6 = error2 * error2 * error2;
    return 1 + growth * growth6 / (growth6 + error6);
}

static int vw_resistance_is_learned(const vw_learning *learning, const vw_real *rows, int n, int c)
{
    return rows[VW_FACTOR_SIGMA * n + c] <= learning->sigma_max;
}

/* Median of the factors that were learned, NaN without any: by ranks, once a second, since nothing is allocated. */
static vw_real vw_resistance_find_median(const vw_learning *learning, const vw_real *rows, int n)
{
    const vw_real *factor = rows + VW_FACTOR * n;
    int n_learned = 0;
    vw_real low = NAN, high = NAN;
    for (int c = 0; c < n; c++) n_learned += vw_resistance_is_learned(learning, rows, n, c);
    for (int c = 0; c < n; c++) {
        if (!vw_resistance_is_learned(learning, rows, n, c)) continue;
        int n_less = 0, n_not_more = 0;
        for (int other = 0; other < n; other++) {
            if (!vw_resistance_is_learned(learning, rows, n, other)) continue;
            n_less += factor[other] < factor[c];
            n_not_more += factor[other] <= factor[c];
        }
        if (n_less <= (n_learned - 1) / 2 && (n_learned - 1) / 2 < n_not_more) low = factor[c];
        if (n_less <= n_learned / 2 && n_learned / 2 < n_not_more) high = factor[c];
    }
    return (low + high) / 2;
}

/* factor = shared(median) f / median: see filter_factor in resistance_scale.py. */
static void vw_resistance_use_factors(const vw_learning *learning, const vw_real *rows, int n, vw_cells *cells,
                                      vw_real *factor)
{
    const vw_real median = vw_resistance_find_median(learning, rows, n), typical = vw_is_missing(median) ? 1
        : vw_resistance_shrink_factor(learning, median);
    for (int c = 0; c < n; c++) {
        const vw_real ratio = vw_resistance_is_learned(learning, rows, n, c) ? rows[VW_FACTOR * n + c] / median : 1;
        cells[c / VW_LANES].resistance[c % VW_LANES] = factor[c] = typical * ratio;
    }
}

void vw_resistance_learn(vw_filter *filter, vw_cells *cells, vw_real *rows, vw_learning *learning, int64_t n_steps,
                         const vw_real *dt_s, const vw_real *lasted_s, const vw_real *current_a,
                         const vw_real *voltage_v, const vw_real *learnt_v, const vw_real *temperature_degc,
                         vw_real *factor, vw_real *estimates)
{
    const int n = filter->n_cells;
    for (int64_t k = 0; k < n_steps; k++) {
        vw_real *row = estimates + k * VW_ESTIMATES * n;
        vw_filter_record(filter, cells, 1, dt_s + k, current_a + k, voltage_v + k * n, temperature_degc + k * n,
                         VW_ESTIMATES, row);
        /* at rest the filter settles, and a voltage that it moves by is no drop */
        const int flows = filter->flow_a > filter->tuning.rest_c * filter->model.capacity_ah;
        if (flows) vw_resistance_record(n, rows, 1, lasted_s + k, row, factor, learnt_v + k * n);
        learning->since_s += lasted_s[k];
        if (learning->since_s < learning->every_s) continue;
        learning->since_s = 0;
        vw_resistance_judge(n, rows);
        vw_resistance_use_factors(learning, rows, n, cells, factor);
    }
}
