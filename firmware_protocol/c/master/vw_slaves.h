/* The slaves: set up, wake, convert, wait, read, check. One chip of 12 cells in each, addresses 1 to 8.
 *
 * Registers go into the master's struct as the chips gave them. A packet with a wrong PEC leaves the old registers
 * and is
 * counted; which are valid now, says vw_slaves_valid_cells() and vw_slaves_cell_degc(), and only that: missing is
 * never 0.
 * All functions wait on the bus (`wait_us`) and are called from one task.
 */
#ifndef VW_SLAVES_H
#define VW_SLAVES_H

#include <stdbool.h>
#include <stdint.h>

#include "../generated/voltwall_protocol.h"
#include "vw_ltc6804.h"

#define VW_SLAVES_FIRST_ADDRESS 1u
#define VW_SLAVES_ALL_CELLS 0x0FFFu

/* The thesis's configuration: GPIO pull-downs on, reference on, ADCOPT, 2.7024 V, 4.2048 V, discharge timer 0.5 min. */
#define VW_SLAVES_CONFIG { 0x05u, 0x98u, 0x46u, 0xA4u, 0x00u, 0x10u }

/* Its waits [us]. ADCOPT gives 2 kHz for the cells (12 in 4430 us) and 14 kHz for the sensors (1288 us). */
#define VW_SLAVES_WAKE_US 500u /* a chip needs up to 300 us out of its sleep */
#define VW_SLAVES_CELLS_US 4500u
#define VW_SLAVES_SENSORS_US 1400u
#define VW_SLAVES_SWITCH_US 100u /* sensors switched in: ten time constants of their filter of 16 kHz */
#define VW_SLAVES_IDLE_US 2000u /* after so long without traffic: a wake-up pulse */
#define VW_SLAVES_READY_US 10u /* which the port needs out of its idle state */

/* The order of its temperatures: the inputs of sensors 1 to 12. */
#define VW_SLAVES_SENSOR_INPUTS { 0u, 2u, 4u, 6u, 8u, 10u, 1u, 3u, 5u, 7u, 9u, 11u }

#define VW_SLAVES_CHECK_STAGES 4u /* of the self-check: a pattern each, references and multiplexer, open wires */
#define VW_SLAVES_CHECK_STAGE_US 10000u /* the longest of them, eight slaves at 1 MHz */

/* `slave[n].com[2]` */
enum vw_slaves_failure {
    VW_SLAVES_CELLS_FAILED = 1,
    VW_SLAVES_AUXILIARY_FAILED = 2,
    VW_SLAVES_STATUS_FAILED = 4,
    VW_SLAVES_MULTIPLEXER_FAILED = 8,
    VW_SLAVES_REFERENCE_FAILED = 16
};

/* To be read, not written, from outside. Bits of cells: bit 0 is the first cell of the slave. */
typedef struct {
    const vw_ltc_bus_t *bus;
    vw_slave_t *slave; /* VW_N_PACKS of them, in the master's struct */
    const uint8_t *sensor_inputs; /* VW_LTC_CELLS: the input of each cell's sensor, from 0 */
    uint16_t bleed[VW_N_PACKS]; /* cells that are bled between the conversions */
    uint16_t open_wires[VW_N_PACKS]; /* cells next to an open wire */
    uint16_t failures[VW_N_PACKS]; /* of the last whole self-check, enum vw_slaves_failure */
    bool is_silent[VW_N_PACKS]; /* not one good packet in the last reading of its cells */
    bool is_whole; /* every packet of the last reading of voltages was good */
    bool has_returned; /* a silent slave answered again: it has been configured anew, its reference is not up yet */
    uint32_t packets; /* read since the start */
    uint32_t packet_errors; /* of them with a wrong PEC */

    uint16_t failures_so_far[VW_N_PACKS];
    uint32_t bad_packets[VW_N_PACKS];
    uint32_t bad_before[VW_N_PACKS]; /* at the last self-check */
    uint32_t noisy_ms_left; /* packets were damaged lately: commands may have been, too */
    uint8_t phase;
    uint8_t stage;
} vw_slaves_t;

/* Nothing on the bus yet. `slave` is the master's struct's; the registers start as missing, the slaves as absent. */
void vw_slaves_init(vw_slaves_t *slaves, const vw_ltc_bus_t *bus, vw_slave_t slave[VW_N_PACKS]);

/* Wake the chips, forget their cells, write the configuration, read it back. Status 1 (active) where it came back as
 * written, 255 (fault) elsewhere. The number that are active.
 */
uint8_t vw_slaves_start(vw_slaves_t *slaves);

/* A pass begins, `pass_ms` after the last: wake the chips. */
void vw_slaves_begin(vw_slaves_t *slaves, uint32_t pass_ms);

/* Bleed these cells from now on, and read back the configuration. To be repeated at least every 30 s. */
void vw_slaves_configure(vw_slaves_t *slaves, const uint16_t bleed[VW_N_PACKS]);

/* All cells into `cvr`. How many slaves are silent. */
uint8_t vw_slaves_read_voltages(vw_slaves_t *slaves);

/* One phase of sensors, six in each slave, into `temp`; the other phase the next time. */
void vw_slaves_read_temperatures(vw_slaves_t *slaves);

/* The next of four stages. True after the last: `com`, `avr`, `str`, open wires and failures are new. */
bool vw_slaves_self_check(vw_slaves_t *slaves);

/* The cells of a slave whose voltage in `cvr` are valid: it answers, its self-test passes, no wire next to the cell
 * is open, the chip has measured.
 */
uint16_t vw_slaves_valid_cells(const vw_slaves_t *slaves, uint8_t pack);

/* The same for a slave that answered when its voltages were read, whatever came of later readings. */
uint16_t vw_slaves_measured_cells(const vw_slaves_t *slaves, uint8_t pack);

/* The temperature of a cell [degC], VW_T_MISSING where there is none: no working sensor gives that voltage, or a wire
 * next to the sensor's input is open.
 */
int8_t vw_slaves_cell_degc(const vw_slaves_t *slaves, uint8_t pack, uint8_t cell);

/* The temperature that a sensor's voltage means [100 uV to degC], likewise. */
int8_t vw_slaves_sensor_degc(uint16_t count);

#endif
