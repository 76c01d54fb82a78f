/* How much more a cell resists than its model says, from the drops of driving; equations in
 * vw_resistance.c.
 *
 * The caller owns the memory: `rows` is VW_RESISTANCE_ROWS rows of n_cells numbers, all 0 at first but the prior's two.
 */
#ifndef VW_RESISTANCE_H
#define VW_RESISTANCE_H

#include "vw_filter.h"

enum {
    VW_SLOW_MEASURED,      /* slow part of the measured drop [V] */
    VW_SLOW_MODELLED,      /* and of the one the model predicts [V] */
    VW_HAS_SLOW,           /* 1 once there are any */
    VW_FAST_MEASURED,      /* what is left of the last sample's drops [V] */
    VW_FAST_MODELLED,
    VW_KNOWN,              /* 1 where the last sample was measured */
    VW_SUM_XX,             /* fading sums of modelled and measured drops: x x, x y, y y, times seconds [V^2 s] */
    VW_SUM_XY,
    VW_SUM_YY,
    VW_WEIGHT_S,           /* and of the seconds themselves [s] */
    VW_PRIOR,              /* factor expected beforehand ... */
    VW_PRIOR_WEIGHT,       /* ... and one over its variance */
    VW_FACTOR,             /* resistance over that of the model, as of the last judgement ... */
    VW_FACTOR_SIGMA,       /* ... and its standard deviation */
    VW_RESISTANCE_ROWS
};

/* Take n_steps samples: estimates by vw_filter_record, the resistances (n_cells) used for them over those of the
 * model, and the voltages that were measured (n_steps x n_cells), NaN = missing. */
void vw_resistance_record(int32_t n_cells, vw_real *rows, int64_t n_steps, const vw_real *dt_s,
                          const vw_real *estimates, const vw_real *factor, const vw_real *voltage_v);

/* Put factors and their sigmas into their rows. */
void vw_resistance_judge(int32_t n_cells, vw_real *rows);

/* How what is learned along a recording is used; see learning.py. */
typedef struct {
    vw_real every_s;          /* between two uses [s] */
    vw_real since_s;          /* since the last one [s] */
    vw_real sigma_max;        /* of a factor that is used */
    vw_real shape_error;      /* uncertainty of a factor above 1 ... */
    vw_real less_shape_error; /* ... and below */
} vw_learning;

/* vw_filter_record, with resistances learned and used on the way. `lasted_s` is the time since the sample before, gaps
 * included; `learnt_v` the voltages that are learned from; `factor` (n_cells) what is in use. */
void vw_resistance_learn(vw_filter *filter, vw_cells *cells, vw_real *rows, vw_learning *learning, int64_t n_steps,
                         const vw_real *dt_s, const vw_real *lasted_s, const vw_real *current_a,
                         const vw_real *voltage_v, const vw_real *learnt_v, const vw_real *temperature_degc,
                         vw_real *factor, vw_real *estimates);

#endif
