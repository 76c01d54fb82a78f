/* The parts of a step, in the order in which they run, and what they hand to each other. Internal. */
#ifndef VW_PARTS_H
#define VW_PARTS_H

#include <string.h>

#include "vw_filter.h"

#define VW_SOC_MIN ((vw_real)-0.05) /* the filter's SOC is held here */
#define VW_SOC_MAX ((vw_real)1.05)
#define VW_SOC_VARIANCE_MAX ((vw_real)0.25) /* no cell's SOC is less known than this */
#define VW_LASTING_VARIANCE_MAX ((vw_real)0.04) /* no model errs by more, whatever the current [V^2] */
#define VW_VARIANCE_STEP ((vw_real)1e-12)   /* added at every step, in units of 1 and C^2: keeps P definite */
#define VW_TICK_S ((vw_real)1e-3) /* times that lie no farther apart are the same: sums of steps round */
#define VW_SLOPE_FLOOR_V ((vw_real)0.02)    /* least slope by which a voltage error is turned into one of SOC */
#define VW_COUNT_SIGMA_MAX ((vw_real)0.5)

/* What the length and the current of a step mean to every cell. */
typedef struct {
    vw_real dt_s, current_a;
    vw_real over;                /* asinh(i / i_ref), where i_ref is the same everywhere */
    vw_real moved_ah;            /* charge taken out; charging counts times the efficiency [Ah] */
    vw_real walk, keep;          /* growth of the SOC's variance, and the factor that keeps it below its maximum */
    vw_real decay[VW_RC_MAX];    /* exp(-dt / tau), where tau is the same everywhere */
    vw_real branch_v2;           /* variance of an RC current in steady state [A^2] */
    vw_real branch_floor_v2;     /* least growth of it [A^2] */
    vw_real hysteresis_keep, hysteresis_pull;
    vw_real noise_v2;            /* variance of the model's voltage without current [V^2] */
    vw_real correlation;         /* growth of it for the gain: errors that last average out less */
    int is_beyond;               /* a real share of the charge flowed at currents that the cell file has not seen */
    vw_real own_share;           /* of what a sample says of the gain: beyond them, all but what all cells share */
    vw_real shared_gain;         /* mean of what the last sample moved the gains by, where that does not count */
    vw_real weighed_s;           /* since the starts were last weighed; 0 where it is not time to weigh them [s] */
    vw_real rest_share, rest_lever; /* of this sample in a rest from the start on: in its mean [1], in its moment [s^2] */
    vw_real read_rest_s;         /* length of a rest that is to be read now; 0 = none [s] */
    int is_rest_on;              /* it is not over: its reading now is used once and not kept */
    int is_rest_cut;             /* it ended before it was whole: whoever gave no SOC wakes up in a drive */
    int is_whole_rest;           /* it lasts on: a shorter one counts against a given SOC only */
    vw_real check_share, bias_share, wander_share, conflict_share;
    vw_real settled_share;       /* of what a rest at the start had left to relax, since the starts were last weighed */
} vw_motion;

/* What is known of a block of cells within a step; what a part writes, the parts after it read. */
typedef struct {
    vw_lanes voltage_v;          /* NaN where not measured */
    vw_lanes h;                  /* predicted voltage [V] */
    vw_lanes H[VW_STATES_MAX];   /* its slopes */
    vw_lanes bend_v2;            /* k q^2, what curvature adds to its variance [V^2] */
    vw_lanes ocv_slope_v;        /* the OCV's share of H[0] [V] */
    vw_lanes innovation_v, innovation_sigma_v, used;
    vw_lanes soc, soc_v2;        /* what is reported */
    vw_soc_place at;             /* place of `soc` in the tables */
    vw_lanes slope_v2;           /* square of the slope by which a voltage's error is one of SOC [V^2] */
    vw_lanes valid;
} vw_work;

void vw_filter_hold_current(vw_filter *filter, vw_real current_a);
vw_motion vw_predict_make_motion(const vw_filter *filter, vw_real dt_s, vw_real current_a);
void vw_filter_read_sample(const vw_filter *filter, vw_cells *restrict x, const vw_sample *sample, int first,
                           vw_work *restrict work);
void vw_predict_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x);
/* R0 i + sum R_k i_k + e asinh(i / i_ref) of each cell [V]; vw_cell_model_read_values sets the resistances `here`. */
void vw_output_compute_drop(const vw_cell_model *model, const vw_motion *motion, const vw_cells *restrict x,
                            vw_lanes *restrict here, vw_lanes drop_v);
void vw_output_run_sigma(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                         vw_work *restrict work);
void vw_output_run_tangent(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                           vw_work *restrict work);
void vw_update_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x, vw_work *restrict work);
void vw_fusion_accumulate_rest(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                               const vw_work *restrict work);
void vw_fusion_update_from_rest(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                                const vw_work *restrict work);
void vw_fusion_compute_soc_variance(const vw_filter *filter, const vw_cells *restrict x, vw_work *restrict work);
void vw_fusion_fuse_block(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                          vw_work *restrict work);
void vw_fusion_check_model(const vw_filter *filter, const vw_motion *motion, vw_cells *restrict x,
                           vw_work *restrict work);

/* The segment of a block for a place at which the tables are looked up: that of the step before, or a new one. */
static inline vw_segment *vw_parts_find_segment(vw_cells *x, int place, vw_segment *fresh)
{
#if VW_KEEPS_SEGMENTS
    (void)fresh;
    return &x->segments[place];
#else
    (void)x, (void)place;
    VW_EACH_CELL(c) fresh->column[c] = VW_NOWHERE;
    return fresh;
#endif
}

static inline vw_real vw_square(vw_real x) { return x * x; }

/* z_s = z - rho sum d_k i_k, the SOC at the surface */
static inline vw_real vw_parts_compute_surface_soc(const vw_cells *x, int n_pairs, int c)
{
    vw_real below = 0;
    VW_UNROLL for (int k = 0; k < n_pairs; k++) below += x->terms.surface[k][c] * x->branch_a[k][c];
    return x->soc[c] - x->resistance[c] * below;
}

/* asinh(x) = sign(x) ln(|x| + root) with root = sqrt(x^2 + 1), without a call, so that vector instructions take several
 * cells at a time; to 1e-10. */
static inline vw_real vw_parts_compute_asinh_with(vw_real x, vw_real root)
{
#if VW_LANES == 1
    (void)root;
    return vw_asinh(x);
#else
    /* y = 2^n m, m in 0.7 .. 1.4;  ln m = 2 atanh(s),  s = (m - 1) / (m + 1) */
    const double a = fabs(x), y = a + root;
    uint64_t bits, kept;
    double m, n;
    memcpy(&bits, &y, 8);
    const uint64_t moved = bits - 0x3fe6a09e667f3bcdu; /* of sqrt(1/2): its exponent is n - 1 ... */
    kept = (bits & 0x000fffffffffffffu) | 0x3ff0000000000000u;
    memcpy(&m, &kept, 8);
    /* n as a number: its bits as the last ones of 2^52 */
    kept = (moved >> 52) | 0x4330000000000000u;
    memcpy(&n, &kept, 8);
    n -= 4503599627370496.0;
    m = m > 1.4142135623730951 ? 0.5 * m : m;
    const double s = (m - 1) / (m + 1), s2 = s * s;
    double p = 1.0 / 11;
    p = p * s2 + 1.0 / 9;
    p = p * s2 + 1.0 / 7;
    p = p * s2 + 1.0 / 5;
    p = p * s2 + 1.0 / 3;
    p = p * s2 + 1;
    const double ln = n * 0.6931471805599453 + 2 * s * p;
    return copysign(ln, x);
#endif
}

static inline vw_real vw_parts_compute_asinh(vw_real x)
{
    return vw_parts_compute_asinh_with(x, vw_sqrt(1 + vw_square(x)));
}

/* r = r_0 + (share of the drop that a lasting current causes at this temperature)^2, with uncertainty [V^2] */
static inline vw_real vw_parts_compute_noise_v2(const vw_motion *motion, const vw_cells *x, int c)
{
    return motion->noise_v2 + x->terms.noise_ohm2[c] * vw_square(motion->current_a);
}

/* Growth of the model's error where the cell is nearly empty, which in the cold it looks early. */
static inline vw_real vw_parts_compute_empty_growth(const vw_cells *x, int c)
{
    return 1 + vw_max(x->terms.empty_soc[c] - x->soc[c], 0) * x->terms.empty_rise[c];
}

/* Variance that the lasting error comes to: at rest, by hysteresis, and as a share of what the slow current drops. */
static inline vw_real vw_parts_compute_lasting_v2(const vw_motion *motion, const vw_cells *x, int slow_pair, int c)
{
    const vw_real slow_a = slow_pair < 0 ? motion->current_a : x->branch_a[slow_pair][c];
    const vw_real grown_a2 = vw_square(slow_a * vw_parts_compute_empty_growth(x, c));
    return vw_min(x->terms.lasting_v2[c] + x->terms.lasting_ohm2[c] * grown_a2, VW_LASTING_VARIANCE_MAX);
}

static inline vw_real vw_parts_compute_count_v2(const vw_cells *restrict x, int c)
{
    return vw_square(x->count_gain[c]) + vw_square(x->count_offset[c]) + x->anchor_v2[c];
}

#endif
