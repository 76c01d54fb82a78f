#include "vw_simulated.h"

#include <string.h>

#include "../vw_time.h"

#ifndef VW_SOURCES
#define VW_SOURCES "unknown"
#endif

#define LONGEST_GAP_MS 60000u
#define BYTE_US 8u /* on the pair, at 1 MHz */
#define COMMAND_BYTES 4u
#define PACKET_BYTES (VW_LTC_GROUP_SIZE + 2u)

const char *vw_library_sources(void)
{
    return VW_SOURCES;
}

size_t vw_simulated_size(void)
{
    return sizeof(vw_simulated_t);
}

size_t vw_simulated_io_size(void)
{
    return sizeof(vw_simulated_io_t);
}

/* --- the slaves' pair */

static const uint16_t rows[VW_ROW_NONE][VW_SIMULATED_GROUPS] = {
    { VW_LTC_RDCVA, VW_LTC_RDCVB, VW_LTC_RDCVC, VW_LTC_RDCVD },
    { VW_LTC_RDAUXA, VW_LTC_RDAUXB, VW_LTC_RDSTATA, VW_LTC_RDSTATB },
    { VW_LTC_RDCFG, 0u, 0u, 0u },
};

/* The row that a command to read belongs to, and its place in it. */
static uint8_t vw_simulated_find_row(uint16_t command, uint8_t *group)
{
    uint8_t row;
    for (row = 0u; row < (uint8_t)VW_ROW_NONE; row++) {
        for (*group = 0u; *group < VW_SIMULATED_GROUPS; (*group)++) {
            if (rows[row][*group] == command) {
                return row;
            }
        }
    }
    return (uint8_t)VW_ROW_NONE;
}

static void vw_simulated_put_check_words(vw_simulated_io_t *io)
{
    size_t pack, group;
    for (pack = 0u; pack < VW_N_PACKS; pack++) {
        for (group = 0u; group < VW_SIMULATED_GROUPS; group++) {
            uint8_t *packet = (uint8_t *)io->packets[pack][group];
            uint16_t pec = vw_ltc_pec15(packet, VW_LTC_GROUP_SIZE);
            packet[VW_LTC_GROUP_SIZE] = (uint8_t)(pec >> 8);
            packet[VW_LTC_GROUP_SIZE + 1u] = (uint8_t)(pec & 0xFFu);
        }
    }
}

static bool vw_simulated_transfer(void *context, const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length)
{
    vw_simulated_t *simulated = context;
    uint8_t row = (uint8_t)VW_ROW_NONE, group = 0u;
    size_t pack = 0u;
    simulated->bus_us += (uint32_t)(BYTE_US * tx_length);
    if (tx_length == COMMAND_BYTES && rx_length == PACKET_BYTES) {
        row = vw_simulated_find_row((uint16_t)(((tx[0] & 0x07u) << 8) | tx[1]), &group);
        pack = ((tx[0] >> 3) & 0x0Fu) - VW_SLAVES_FIRST_ADDRESS;
    }
    if (row == (uint8_t)VW_ROW_NONE) {
        simulated->of_python.transfer(simulated->bus_us, tx, tx_length, rx, rx_length);
    } else {
        if ((row != simulated->row || (pack == 0u && group == 0u)) &&
            !simulated->of_python.read_row(simulated->bus_us, row)) {
            vw_simulated_put_check_words(&simulated->io);
        }
        (void)memcpy(rx, simulated->io.packets[pack][group], rx_length);
    }
    simulated->row = row;
    simulated->bus_us += (uint32_t)(BYTE_US * rx_length);
    return true;
}

static void vw_simulated_wait_us(void *context, uint32_t time_us)
{
    ((vw_simulated_t *)context)->bus_us += time_us;
}

/* --- the board */

static bool vw_simulated_read_eeprom(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    ((vw_simulated_t *)context)->of_python.eeprom_read(address, data, length);
    return true;
}

static bool vw_simulated_write_eeprom(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    const vw_simulated_t *simulated = context;
    simulated->of_python.eeprom_write(simulated->now_ms, address, data, length);
    return true;
}

static bool vw_simulated_is_eeprom_busy(void *context)
{
    const vw_simulated_t *simulated = context;
    return simulated->of_python.eeprom_is_busy(simulated->now_ms);
}

static bool vw_simulated_may_configure(void *context)
{
    return vw_master_may_configure(&((vw_simulated_t *)context)->task);
}

static void vw_simulated_mark_new_cells(void *context)
{
    ((vw_simulated_t *)context)->task.has_new_cells = true;
}

static void vw_simulated_restart(void *context)
{
    ((vw_simulated_t *)context)->io.is_restarting = true;
}

#define COMMAND(name, code, low, high) \
    static enum vw_result vw_simulated_do_##name(void *context, int32_t argument) \
    { \
        return vw_master_command(&((vw_simulated_t *)context)->task, code, argument); \
    }
VW_COMMANDS(COMMAND)

#define MEMBER(name, code, low, high) .name = vw_simulated_do_##name,
static const vw_board_t functions = {
    .may_configure = vw_simulated_may_configure,
    .config_changed = vw_simulated_mark_new_cells,
    .eeprom_read = vw_simulated_read_eeprom,
    .eeprom_write = vw_simulated_write_eeprom,
    .eeprom_is_busy = vw_simulated_is_eeprom_busy,
    .restart = vw_simulated_restart,
    .commands = { VW_COMMANDS(MEMBER) },
};

/* --- time and state */

/* What the firmware does each millisecond; a longer gap, or a step back, is jumped over. */
static void vw_simulated_advance_time(vw_simulated_t *simulated, uint32_t now_ms)
{
    if (now_ms - simulated->now_ms > LONGEST_GAP_MS) {
        simulated->now_ms = now_ms;
    }
    do {
        simulated->now_ms += simulated->now_ms == now_ms ? 0u : 1u;
        vw_link_run(&simulated->link, simulated->now_ms);
    } while (simulated->now_ms != now_ms);
}

/* When there may be a frame for the line, after it has been asked for one now. */
static void vw_simulated_find_line_due(vw_simulated_t *simulated)
{
    const vw_answer_t *answer = &simulated->link.answer;
    const vw_stream_t *stream = &answer->stream;
    vw_simulated_io_t *io = &simulated->io;
    bool is_now = answer->outbox.has_reply || answer->outbox.n_events != 0u || answer->restart_asked;
    bool is_turning = stream->range != 0u || stream->sent_of_range != 0u;
    io->has_line_due = is_now || simulated->link.is_streaming;
    io->line_due_ms = is_now ? simulated->now_ms : stream->fast_ms;
    if (!is_now && !is_turning && !vw_is_due(simulated->now_ms, stream->turn_ms) && vw_is_due(stream->fast_ms,
        stream->turn_ms)) {
        io->line_due_ms = stream->turn_ms;
    }
}

static void vw_simulated_publish_state(vw_simulated_t *simulated)
{
    const vw_master_task_t *task = &simulated->task;
    vw_simulated_io_t *io = &simulated->io;
    io->relays = (uint8_t)task->relays.state;
    io->relays_since_ms = task->relays.since_ms;
    io->has_precharge_failed = task->relays.has_failed;
    io->charging = (uint8_t)task->charging.state;
    io->is_charging = task->charging.is_active;
    io->is_open = task->protection.is_open;
    io->is_streaming = simulated->link.is_streaming;
    vw_simulated_find_line_due(simulated);
}

void vw_simulated_boot(vw_simulated_t *simulated, const vw_simulated_board_t *of_python,
                       const uint8_t sensor_inputs[VW_LTC_CELLS], uint8_t cause, uint32_t boots)
{
    vw_ident_t ident = { .firmware = { 1u, 0u, 0u } };
    bool is_open = simulated->io.is_open;
    (void)memset(simulated, 0, sizeof *simulated);
    ident.reset_cause = cause;
    ident.boots = boots;
    simulated->of_python = *of_python;
    simulated->board = functions;
    simulated->board.context = simulated;
    vw_link_init(&simulated->link, &simulated->board, &simulated->io.memory, &simulated->can, &ident);
    vw_master_init(&simulated->task, &simulated->link, is_open, 0u);
    simulated->bus.context = simulated;
    simulated->bus.transfer = vw_simulated_transfer;
    simulated->bus.wait_us = vw_simulated_wait_us;
    simulated->row = (uint8_t)VW_ROW_NONE;
    (void)memcpy(simulated->sensor_inputs, sensor_inputs, sizeof simulated->sensor_inputs);
    vw_slaves_init(&simulated->slaves, &simulated->bus, simulated->io.memory.slave);
    simulated->slaves.sensor_inputs = simulated->sensor_inputs;
    (void)vw_slaves_start(&simulated->slaves);
    vw_measuring_init(&simulated->measuring, &simulated->slaves, &simulated->io.memory, 0u);
    vw_simulated_publish_state(simulated);
}

/* Serve the tables of CAN as in each millisecond of the pass: a period shorter than it keeps its rate. */
static void vw_simulated_send_can(vw_simulated_t *simulated, uint32_t pass_ms)
{
    vw_simulated_io_t *io = &simulated->io;
    if (simulated->now_ms - simulated->can_ms > pass_ms) {
        simulated->can_ms = simulated->now_ms - pass_ms;
    }
    io->n_can = 0u;
    while (io->n_can < VW_SIMULATED_FRAMES) {
        if (vw_can_next(&simulated->can, simulated->can_ms, &io->can[io->n_can])) {
            io->n_can++;
        } else if (simulated->can_ms != simulated->now_ms) {
            simulated->can_ms++;
        } else {
            break;
        }
    }
}

void vw_simulated_pass(vw_simulated_t *simulated, uint32_t now_ms, uint32_t pass_ms, uint16_t n_samples)
{
    const vw_simulated_io_t *io = &simulated->io;
    vw_inputs_t inputs = { .is_drive_asked = io->is_drive_asked, .is_shutdown_closed = io->is_shutdown_closed };
    inputs.link_permille = io->link_permille;
    inputs.hardware = io->hardware;
    simulated->bus_us = 0u;
    vw_simulated_advance_time(simulated, now_ms);
    (void)vw_measuring_add_samples(&simulated->measuring, io->samples, n_samples);
    vw_measuring_run(&simulated->measuring, &inputs, pass_ms, now_ms);
    vw_master_step(&simulated->task, &inputs, now_ms);
    (void)vw_measuring_write_bleeding(&simulated->measuring, simulated->task.balance.cells,
     simulated->task.has_new_cells, now_ms);
    simulated->task.has_new_cells = false;
    vw_simulated_send_can(simulated, pass_ms);
    vw_simulated_publish_state(simulated);
}

uint8_t vw_simulated_command(vw_simulated_t *simulated, uint32_t now_ms, uint8_t command, int32_t argument)
{
    enum vw_result result;
    vw_simulated_advance_time(simulated, now_ms);
    result = vw_master_command(&simulated->task, command, argument);
    vw_simulated_publish_state(simulated);
    return (uint8_t)result;
}

uint8_t vw_simulated_store(vw_simulated_t *simulated, uint32_t now_ms)
{
    enum vw_result result;
    vw_simulated_advance_time(simulated, now_ms);
    result = vw_store_begin(&simulated->link.answer.store, (const uint8_t *)&simulated->io.memory.conf, now_ms);
    if (result == VW_RESULT_DONE) {
        simulated->link.answer.store_sequence = 0u;
    }
    return (uint8_t)result;
}

void vw_simulated_received(vw_simulated_t *simulated, uint32_t now_ms, const uint8_t *data, size_t length)
{
    vw_simulated_advance_time(simulated, now_ms);
    vw_link_received(&simulated->link, now_ms, data, length);
    vw_simulated_publish_state(simulated);
}

void vw_simulated_can_received(vw_simulated_t *simulated, uint32_t now_ms, const vw_can_frame_t *frame)
{
    vw_simulated_advance_time(simulated, now_ms);
    vw_can_received(&simulated->can, now_ms, frame);
}

size_t vw_simulated_next(vw_simulated_t *simulated, uint32_t now_ms)
{
    size_t length;
    vw_simulated_advance_time(simulated, now_ms);
    length = vw_link_next(&simulated->link, now_ms, simulated->io.frame);
    vw_simulated_publish_state(simulated);
    return length;
}
