/* The estimator of the state of charge: filters and charge count over any number of cells that share one current.
 *
 *   vw_filter_init(&filter, cells);                              once
 *   vw_filter_start(&filter, cells, &sample, soc, soc_sigma);    with the first measurement
 *   vw_filter_step(&filter, cells, &sample, estimates);          after each of the others
 *
 * The caller owns all memory: `cells` is VW_BLOCKS(n_cells) blocks, `estimates` VW_ESTIMATES rows of n_cells numbers.
 * Nothing is allocated, nothing but math.h is called. Units are V, A, s, Ah, degC; current is positive on discharge.
 * A missing number is NaN.
 */
#ifndef VW_FILTER_H
#define VW_FILTER_H

#include "vw_cell_model.h"

/* Assumptions of the filters: names, order and meaning are those of `Tuning` in tuning.py. */
typedef struct {
    vw_real model_error_v;
    vw_real model_error_rel;
    vw_real correlation_s;
    vw_real bias_s;
    vw_real lasting_v;
    vw_real lasting_rel;
    vw_real empty_soc;
    vw_real empty_factor;
    vw_real soc_walk;
    vw_real branch_rel;
    vw_real start_soc_sigma;
    vw_real start_voltage_sigma;
    vw_real driven_c;
    vw_real start_branch_rel;
    vw_real start_branch_s;
    vw_real gate;
    vw_real gate_hold_s;
    vw_real gate_recovery;
    vw_real counter_soc_sigma;
    vw_real rest_c;
    vw_real rest_s;
    vw_real rest_v;
    vw_real rest_noise_v;
    vw_real rest_left_v;
    vw_real rest_tail_s;
    vw_real rest_settled;
    vw_real rest_slow;
    vw_real rest_unsettled;
    vw_real rest_uncertainty_soc;
    vw_real rough_soc;
    vw_real start_exact;
    vw_real start_rough;
    vw_real counter_gain;
    vw_real counter_offset_c;
    vw_real start_unknown;
    vw_real gain_sigma;
    vw_real hidden_factor;
    vw_real apart_soc_max;
    vw_real wander_s;
    vw_real weighing_s;
    vw_real check_s;
    vw_real check_rms_v;
    vw_real check_bias_v;
    vw_real drop_error_max;
} vw_tuning;

/* A symmetric sigma-point rule; see sigma_points.py. */
typedef struct {
    vw_real spread;    /* c, distance of the points in standard deviations */
    vw_real weight;    /* w, of every point but the centre */
    vw_real curvature; /* k, of the variance that curvature adds */
} vw_sigma_rule;

typedef enum {
    VW_COUNT,       /* charge count alone */
    VW_TANGENT,     /* extended Kalman filter */
    VW_SIGMA,       /* sigma-point filter: unscented or central-difference, by its rule */
    VW_SIGMA_FUSED, /* sigma-point filter fused with the charge count */
} vw_kind;

typedef struct {
    int32_t n_cells;
    int32_t kind; /* vw_kind */
    /* the engine's own: */
    vw_real current_a; /* last current that was measured [A] */
    vw_real since_s;   /* since the starts were last weighed [s] */
    vw_real rest_s;    /* of rest since the start; negative once it has been read or broken [s] */
    vw_real flow_a;    /* mean size of the current over wander_s [A] ... */
    vw_real beyond_a;  /* ... and of what of it was beyond the currents that the cell file has seen [A] */
    vw_sigma_rule rule;
    vw_tuning tuning;
    vw_cell_model model;
} vw_filter;

#define VW_STARTS 4 /* hypotheses: the SOC given, exact or rough; the one read at rest, settled or relaxing */

/* What the temperatures of a block of cells mean to it: computed when one of them changes, which is seldom. */
typedef struct {
    vw_lanes degc;               /* for which the rest holds [degC] */
    vw_temperature_place place;
    vw_lanes drop_error;         /* share by which resistances may be off */
    vw_lanes noise_ohm2;         /* growth of the model's variance with the square of the current [ohm^2] */
    vw_lanes lasting_v2;         /* variance of the lasting error at rest [V^2] */
    vw_lanes lasting_ohm2;       /* growth of it with the square of the slow current [ohm^2] */
    vw_lanes relaxing_v2;        /* of what a cell that was driven has left to relax [V^2] */
    vw_lanes empty_soc;          /* below it the model's error grows ... */
    vw_lanes empty_rise;         /* ... by so much per unit of SOC */
    vw_lanes lowest_soc;         /* that the cell file has seen under load */
    vw_lanes cold2;              /* square by which slow overpotentials grow in the cold */
    vw_lanes surface[VW_RC_MAX - 1]; /* d_k of the model [1/A] */
} vw_temperature_terms;

/* Places at which the tables are looked up at each step. */
enum {
    VW_AT_MEAN,   /* the filter's SOC */
    VW_AT_RIGHT,  /* its sigma points, one way ... */
    VW_AT_LEFT,   /* ... and the other */
    VW_AT_ANSWER, /* the SOC that is reported; OCV alone */
    VW_SEGMENTS
};
#define VW_KEEPS_SEGMENTS (VW_LANES > 1) /* from one step to the next; a microcontroller has no memory to spare */

/* State of a block of cells: one row for each quantity. */
typedef struct {
    vw_lanes soc;                  /* mean of the filter's state: SOC, 0..1 */
    vw_lanes branch_a[VW_RC_MAX];  /* and branch currents [A] */
    vw_lanes cov[VW_STATES_MAX * (VW_STATES_MAX + 1) / 2]; /* its covariance, lower triangle: see VW_COV */
    vw_lanes gain;                 /* share by which charge moves the SOC more than the capacity says */
    vw_lanes gain_v2;              /* its variance */
    vw_lanes gain_step;            /* what the last sample moved it by, NaN where it taught nothing */
    vw_lanes gain_slope[VW_STATES_MAX]; /* how the mean would move with it */
    vw_lanes hysteresis;           /* -1 after discharge .. 1 after charge */
    vw_lanes temperature_degc;     /* last temperature that was measured [degC] */
    vw_lanes capacity_ah;          /* of this cell [Ah] */
    vw_lanes resistance;           /* of this cell over that of its model */
    vw_lanes refused_s;            /* for how long innovations have been refused without a break [s] */
    vw_lanes count_soc;            /* SOC by counting charge */
    vw_lanes count_gain;           /* its sigma by the gain of the current sensor */
    vw_lanes count_offset;         /* its sigma by the offset of the current sensor */
    vw_lanes anchor_v2;            /* variance of the SOC where the count began */
    vw_lanes rest_mean_v;          /* mean voltage of a rest from the start on [V] */
    vw_lanes rest_moment;          /* integral of voltage times time, both less their means, over it [V s^2] */
    vw_lanes unsettled_v2;         /* by which that rest may be off: it still relaxes and no SOC was given [V^2] */
    vw_lanes drawn;                /* charge taken out since the start, over the capacity */
    vw_lanes start_soc[VW_STARTS]; /* SOC at the start by each hypothesis */
    vw_lanes start_v2[VW_STARTS];  /* its variance */
    vw_lanes start_weight[VW_STARTS]; /* its probability before any drive */
    vw_lanes best_soc;             /* SOC at the start by the filter when it was the surest, counted back */
    vw_lanes best_v2;              /* its variance then ... */
    vw_lanes best_drawn;           /* ... the charge drawn until then, over the capacity ... */
    vw_lanes best_offset;          /* ... and count_offset then */
    vw_lanes fused_soc;            /* what is reported, counted on between two weighings */
    vw_lanes fused_v2;             /* its variance */
    vw_lanes fused_gain;           /* the gain it is counted with: that of the filter, shrunk by its uncertainty */
    vw_lanes conflict;             /* mean square of filter minus fusion over its variance */
    vw_lanes apart;                /* mean of the filter's SOC minus the count's */
    vw_lanes apart_v2;             /* mean of the variance that the filter gave itself meanwhile */
    vw_lanes wander_v2;            /* variance that the filter shows against the count beyond that mean */
    vw_lanes check_mean_v;         /* mean of the scaled innovation over check_s [V] */
    vw_lanes check_square_v2;      /* mean of its square over check_s [V^2] */
    vw_lanes slow_mean_v;          /* mean of the scaled innovation over bias_s [V] */
    vw_lanes slow_square_v2;       /* mean of the square of that over check_s [V^2] */
    vw_temperature_terms terms;              /* follows from temperature_degc */
#if VW_KEEPS_SEGMENTS
    vw_segment segments[VW_SEGMENTS]; /* follow from terms and SOC */
#endif
} vw_cells;

/* Row of the covariance of states u and w <= u; state 0 is the SOC, state 1 + k the current of branch k. */
#define VW_COV(u, w) ((u) * ((u) + 1) / 2 + (w))

typedef struct {
    vw_real dt_s;                    /* since the sample before, >= 0 [s] */
    vw_real current_a;               /* held over that time [A]; NaN or impossible: the last one counts */
    const vw_real *voltage_v;        /* (n_cells) [V]; NaN or impossible: not measured */
    const vw_real *temperature_degc; /* (n_cells) [degC]; NaN or impossible: the last one counts */
} vw_sample;

/* Rows of what a step answers, n_cells numbers each. */
enum {
    VW_SOC,              /* state of charge, 0..1 */
    VW_SOC_SIGMA,        /* its standard deviation, model error included */
    VW_OCV_V,            /* open-circuit voltage at that SOC [V] */
    VW_VOLTAGE_V,        /* terminal voltage the model predicted [V] */
    VW_INNOVATION_V,     /* measured minus predicted [V] */
    VW_INNOVATION_SIGMA, /* standard deviation expected of it [V] */
    VW_MODEL_VALID,      /* 1 while the model passes its self-check */
    VW_ACCEPTED,         /* 1 where the voltage was used */
    VW_ESTIMATES
};

/* Prepare the memory, once: temperatures unknown, capacities and resistances those of the model. */
void vw_filter_init(vw_filter *filter, vw_cells *cells);

/* Set the state from one sample. `soc` and `soc_sigma` are n_cells numbers, NaN = unknown; NULL = all unknown. */
void vw_filter_start(vw_filter *filter, vw_cells *cells, const vw_sample *sample, const vw_real *soc,
                     const vw_real *soc_sigma);

/* The same spread over several calls with one sample, for a processor that cannot wait: n of the blocks from `first` on,
 * the blocks in their order. The call with the last block ends the start. */
void vw_filter_start_part(vw_filter *filter, vw_cells *cells, const vw_sample *sample, const vw_real *soc,
                          const vw_real *soc_sigma, int32_t first, int32_t n);

/* Move the state on by one sample and put what it says into `estimates`. */
void vw_filter_step(vw_filter *filter, vw_cells *cells, const vw_sample *sample, vw_real *estimates);

/* The same for n_steps samples in a row: arrays of n_steps, n_steps x n_cells and, of the first n_rows of what a step
 * answers, n_steps x n_rows x n_cells. */
void vw_filter_record(vw_filter *filter, vw_cells *cells, int64_t n_steps, const vw_real *dt_s,
                      const vw_real *current_a, const vw_real *voltage_v, const vw_real *temperature_degc,
                      int32_t n_rows, vw_real *estimates);

#endif
