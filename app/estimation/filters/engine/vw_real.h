/* The number type of the estimator and how many cells are computed at a time.
 *
 * Python: double, 32 cells at a time, which a compiler turns into vector instructions.
 * Microcontroller: -DVW_SINGLE -DVW_LANES=1, single precision, one cell after the other.
 */
#ifndef VW_REAL_H
#define VW_REAL_H

#include <math.h>
#include <stdint.h>

#ifdef VW_SINGLE
typedef float vw_real;
#define VW_MATH(name) name##f
#else
typedef double vw_real;
#define VW_MATH(name) name
#endif

#define vw_exp VW_MATH(exp)
#define vw_sqrt VW_MATH(sqrt)
#define vw_asinh VW_MATH(asinh)
#define vw_abs VW_MATH(fabs)

#ifndef VW_LANES
#define VW_LANES 32 /* cells of a block */
#endif

#ifndef VW_RC_MAX
#define VW_RC_MAX 5 /* branches a cell model may have: RC pairs and the lasting error */
#endif

#define VW_STATES_MAX (1 + VW_RC_MAX) /* SOC and the current of each branch */
#define VW_BLOCKS(n_cells) (((n_cells) + VW_LANES - 1) / VW_LANES)

typedef vw_real vw_lanes[VW_LANES]; /* one number for each cell of a block */

/* Over the cells of a block, which know nothing of each other: the compiler may take several at a time. */
#if defined(__clang__)
#define VW_EACH_CELL(c) _Pragma("clang loop vectorize(assume_safety)") for (int c = 0; c < VW_LANES; c++)
#elif defined(__GNUC__)
#define VW_EACH_CELL(c) _Pragma("GCC ivdep") for (int c = 0; c < VW_LANES; c++)
#else
#define VW_EACH_CELL(c) for (int c = 0; c < VW_LANES; c++)
#endif

/* Over the states of a cell, where the compiler knows how many: without it the loop over cells takes one at a time. */
#if VW_LANES == 1
#define VW_UNROLL
#elif defined(__clang__)
#define VW_UNROLL _Pragma("clang loop unroll(full)")
#elif defined(__GNUC__)
#define VW_UNROLL _Pragma("GCC unroll 8")
#else
#define VW_UNROLL
#endif

/* A function with a number that each of its callers knows: on a PC it is compiled for each. */
#if VW_LANES > 1 && defined(__GNUC__)
#define VW_INLINE static inline __attribute__((always_inline))
#else
#define VW_INLINE static inline
#endif

/* a where a condition holds, else b. Both are evaluated, so a loop over cells stays without branches. */
static inline vw_real vw_pick(int condition, vw_real a, vw_real b) { return condition ? a : b; }

static inline vw_real vw_min(vw_real a, vw_real b) { return a < b ? a : b; }
static inline vw_real vw_max(vw_real a, vw_real b) { return a > b ? a : b; }
static inline vw_real vw_clip(vw_real x, vw_real low, vw_real high) { return vw_min(vw_max(x, low), high); }
static inline int vw_is_missing(vw_real x) { return x != x; }

#endif
