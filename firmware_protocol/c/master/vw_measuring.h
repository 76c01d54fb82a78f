/* A pass of measuring: slaves and current converter into the struct, with filter, minima, maxima, means and totals, and
 * what protection judges. A reference to compare yours with, not a certified part.
 *
 * After vw_slaves_init and vw_slaves_start: vw_measuring_init. In each pass: vw_measuring_add_samples with what the
 * current's
 * converter has given since the last one, then vw_measuring_run, vw_master_step, vw_measuring_write_bleeding.
 * Voltages are read in
 * every pass, one phase of temperatures every 200 ms, a stage of the self-check every 250 ms where the pass has time.
 */
#ifndef VW_MEASURING_H
#define VW_MEASURING_H

#include "vw_master.h"
#include "vw_slaves.h"

#define VW_MEASURING_READY_MS 500u /* both phases of temperatures read, the voltages' filter settled */
#define VW_MEASURING_TEMPERATURES_MS 200u /* from one phase to the next */
#define VW_MEASURING_CHECK_MS 250u /* from one stage of the self-check to the next */
#define VW_MEASURING_BLEED_MS 1000u

/* Time on the bus of 1 MHz, eight slaves. The longest stage of the self-check is VW_SLAVES_CHECK_STAGE_US. */
#define VW_MEASURING_VOLTAGES_US 8500u
#define VW_MEASURING_PHASE_US 5000u

/* The current's converter: 12 bits. An open input stands still here, 308 A; a current does not for as long as a trip.
 * */
#define VW_MEASURING_TOP 4095u
#define VW_MEASURING_OPEN 3320u
#define VW_MEASURING_OPEN_WIDTH 4u

#define VW_MEASURING_NEW 255u   /* means that one pass may complete */
#define VW_MEASURING_KEPT 1000u /* the longest average that a configuration allows, of means of one sample */

typedef struct {
    vw_slaves_t *slaves;
    vw_master_t *memory;
    bool is_ocv_estimated; /* `ocv` is written by somebody else: the estimator */

    double v[VW_N_CELLS]; /* filtered, where the cell is known [100 uV] */
    uint16_t known[VW_N_PACKS];
    bool is_silent[VW_N_PACKS]; /* in this pass's reading of the voltages */
    uint8_t lost_cell;
    uint8_t lost_slave;
    uint8_t lost_temperature;
    int8_t t_min; /* of the cells that have one; above, and below, every limit where none has */
    int8_t t_max;
    uint8_t t_min_id;
    uint8_t t_max_id;

    uint32_t sum; /* of the samples since the last mean */
    uint16_t n_samples;
    uint16_t latest;
    bool has_samples; /* since the last pass */
    double means[VW_MEASURING_KEPT]; /* a ring; in counts */
    uint16_t next;
    uint16_t n_kept;
    int32_t new_means[VW_MEASURING_NEW]; /* [10 mA] */
    uint8_t n_new;
    int32_t i_fc;   /* [10 mA] */
    double i_fc_hp; /* [10 mA] */

    uint32_t start_ms;
    uint32_t temperatures_ms; /* when they are due */
    uint32_t check_ms;
    uint32_t bleed_ms;
    bool is_ready;
} vw_measuring_t;

/* `memory` is the struct that the slaves are read into. */
void vw_measuring_init(vw_measuring_t *measuring, vw_slaves_t *slaves, vw_master_t *memory, uint32_t now_ms);

/* Samples of the current [counts], 1 kHz. How many it took: those beyond 255 means belong to the next pass. */
uint16_t vw_measuring_add_samples(vw_measuring_t *measuring, const uint16_t *samples, uint16_t n);

/* Measure what is due in a pass of this length; fills `reading`, `means`, `n_means` and `is_ready` of the inputs. The
 * means stand until the next call of vw_measuring_add_samples. A pass without a sample has lost its current sensor.
 */
void vw_measuring_run(vw_measuring_t *measuring, vw_inputs_t *inputs, uint32_t pass_ms, uint32_t now_ms);

/* Write the switches of the cells to bleed once a second, or now. True where it did. */
bool vw_measuring_write_bleeding(vw_measuring_t *measuring, const uint16_t cells[VW_N_PACKS], bool is_now,
                                 uint32_t now_ms);

#endif
