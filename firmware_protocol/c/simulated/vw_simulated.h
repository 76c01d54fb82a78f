/* The master on the simulator's board, as a shared library: as many of them in a process as it has memory for.
 *
 * Python gives a master its memory, and what is left of a board: the pair of the slaves, the EEPROM, the samples of the
 * current. It has no clock either: time is the `now_ms` of a call, since the boot. simulator/master.py calls this.
 */
#ifndef VW_SIMULATED_H
#define VW_SIMULATED_H

#include "../master/vw_measuring.h"

#define VW_SIMULATED_SAMPLES 4000u
#define VW_SIMULATED_FRAMES 64u
#define VW_SIMULATED_GROUPS 4u
#define VW_SIMULATED_WORDS 4u /* of a packet: three of data, and the check word as it goes over the pair */

/* What all slaves are asked for one after the other, and answer at once. */
enum vw_simulated_row { VW_ROW_CELLS, VW_ROW_AUXILIARY, VW_ROW_CONFIG, VW_ROW_NONE };

typedef struct {
    /* One packet on the pair, at a time since the pass began; one without a byte wakes the chips. */
    void (*transfer)(uint32_t at_us, const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length);

    /* A row of reads begins: put what arrives into `packets`. False: nothing disturbs it, the check words are not made. */
    bool (*read_row)(uint32_t at_us, uint8_t row);

    void (*eeprom_read)(uint16_t address, uint8_t *data, uint16_t length);
    void (*eeprom_write)(uint32_t now_ms, uint16_t address, const uint8_t *data, uint16_t length);
    bool (*eeprom_is_busy)(uint32_t now_ms);
} vw_simulated_board_t;

/* What both sides see. */
typedef struct {
    vw_master_t memory;
    uint16_t packets[VW_N_PACKS][VW_SIMULATED_GROUPS][VW_SIMULATED_WORDS];
    uint16_t samples[VW_SIMULATED_SAMPLES]; /* of the current, of the next pass */

    /* Asked of the next pass */
    uint32_t hardware; /* as in vw_inputs_t */
    uint16_t link_permille;
    bool is_drive_asked;
    bool is_shutdown_closed;

    /* After every call */
    bool is_open; /* the latch */
    bool is_charging;
    bool has_precharge_failed;
    bool is_streaming;
    bool is_restarting;
    bool has_line_due; /* there may be a frame for the line at `line_due_ms`; else only once something has happened */
    uint8_t relays;
    uint8_t charging;
    uint8_t n_can; /* frames of CAN that the last pass sends */
    uint32_t relays_since_ms;
    uint32_t line_due_ms;
    vw_can_frame_t can[VW_SIMULATED_FRAMES];
    uint8_t frame[VW_MAX_FRAME]; /* for the line */
} vw_simulated_io_t;

typedef struct {
    vw_simulated_io_t io; /* first: where the struct is, it is */
    vw_simulated_board_t of_python;
    vw_board_t board;
    vw_link_t link;
    vw_can_t can;
    vw_master_task_t task;
    vw_ltc_bus_t bus;
    vw_slaves_t slaves;
    vw_measuring_t measuring;
    uint8_t sensor_inputs[VW_LTC_CELLS];
    uint32_t now_ms;
    uint32_t can_ms; /* up to which the tables of CAN have been served */
    uint32_t bus_us; /* since the pass began */
    uint8_t row;
} vw_simulated_t;

/* SHA-256 of the sources that the library was built from, in hexadecimal. */
const char *vw_library_sources(void);
size_t vw_simulated_size(void);
size_t vw_simulated_io_size(void);

/* Boot, with `io.is_open` as the latch stands. */
void vw_simulated_boot(vw_simulated_t *simulated, const vw_simulated_board_t *of_python,
                       const uint8_t sensor_inputs[VW_LTC_CELLS], uint8_t cause, uint32_t boots);

/* A pass, with so many samples of the current. What the firmware does each millisecond, it has done until then. */
void vw_simulated_pass(vw_simulated_t *simulated, uint32_t now_ms, uint32_t pass_ms, uint16_t n_samples);

/* A command with a checked argument, not by the line: enum vw_result. */
uint8_t vw_simulated_command(vw_simulated_t *simulated, uint32_t now_ms, uint8_t command, int32_t argument);

/* Begin to store the configuration in force, not by the line: enum vw_result. */
uint8_t vw_simulated_store(vw_simulated_t *simulated, uint32_t now_ms);

void vw_simulated_received(vw_simulated_t *simulated, uint32_t now_ms, const uint8_t *data, size_t length);
void vw_simulated_can_received(vw_simulated_t *simulated, uint32_t now_ms, const vw_can_frame_t *frame);

/* The next frame for the free line, in `io.frame`; 0 when there is none. */
size_t vw_simulated_next(vw_simulated_t *simulated, uint32_t now_ms);

#endif
