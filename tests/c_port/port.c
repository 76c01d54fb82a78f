/* A master made of the C library, as plain functions for ctypes: its struct, EEPROM and time belong to the caller. */
#include "port.h"

#include <stdlib.h>
#include <string.h>

struct port {
    vw_master_task_t task; /* first: the library's functions get this as their context */
    vw_link_t link;
    vw_can_t can;
    vw_board_t board;
    eeprom_read_t read;
    eeprom_write_t write;
    bool is_restarting;
    vw_ltc_bus_t bus;
    vw_slaves_t slaves;
    vw_measuring_t measuring;
    uint8_t sensor_inputs[VW_LTC_CELLS];
    transfer_t transfer;
    wait_t wait;
};

static bool eeprom_read(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    ((port_t *)context)->read(address, data, length);
    return true;
}

static bool eeprom_write(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    ((port_t *)context)->write(address, data, length);
    return true;
}

static bool eeprom_is_busy(void *context)
{
    (void)context;
    return false;
}

static bool may_configure(void *context)
{
    return vw_master_may_configure(context);
}

static void config_changed(void *context)
{
    ((port_t *)context)->task.has_new_cells = true;
}

static void restart(void *context)
{
    ((port_t *)context)->is_restarting = true;
}

#define COMMAND(name, code, low, high) \
    static enum vw_result do_##name(void *context, int32_t argument) \
    { \
        return vw_master_command(context, code, argument); \
    }
VW_COMMANDS(COMMAND)

#define MEMBER(name, code, low, high) .name = do_##name,
static const vw_board_t functions = {
    .may_configure = may_configure, .config_changed = config_changed, .eeprom_read = eeprom_read,
    .eeprom_write = eeprom_write, .eeprom_is_busy = eeprom_is_busy, .restart = restart,
    .commands = { VW_COMMANDS(MEMBER) },
};

port_t *port_new(vw_master_t *memory, eeprom_read_t read, eeprom_write_t write, uint8_t cause, uint32_t boots, bool is_open)
{
    port_t *port = calloc(1u, sizeof *port);
    vw_ident_t ident = { .firmware = { 1u, 0u, 0u } };
    ident.reset_cause = cause;
    ident.boots = boots;
    port->board = functions;
    port->board.context = port;
    port->read = read;
    port->write = write;
    vw_link_init(&port->link, &port->board, memory, &port->can, &ident);
    vw_master_init(&port->task, &port->link, is_open, 0u);
    return port;
}

void port_free(port_t *port)
{
    free(port);
}

void port_step(port_t *port, uint32_t now_ms, const vw_reading_t *reading, const int32_t *means, uint8_t n_means,
               const port_inputs_t *with)
{
    vw_inputs_t inputs = { .reading = *reading, .means = means, .n_means = n_means };
    inputs.is_ready = with->is_ready;
    inputs.is_drive_asked = with->is_drive_asked;
    inputs.is_shutdown_closed = with->is_shutdown_closed;
    inputs.link_permille = with->link_permille;
    inputs.hardware = with->hardware;
    vw_link_run(&port->link, now_ms);
    vw_master_step(&port->task, &inputs, now_ms);
}

static bool transfer(void *context, const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length)
{
    return ((port_t *)context)->transfer(tx, tx_length, rx, rx_length);
}

static void wait_us(void *context, uint32_t time_us)
{
    ((port_t *)context)->wait(time_us);
}

void port_start_slaves(port_t *port, uint32_t now_ms, const uint8_t sensor_inputs[VW_LTC_CELLS], transfer_t of_board,
                       wait_t waiting)
{
    port->transfer = of_board;
    port->wait = waiting;
    port->bus.context = port;
    port->bus.transfer = transfer;
    port->bus.wait_us = wait_us;
    (void)memcpy(port->sensor_inputs, sensor_inputs, sizeof port->sensor_inputs);
    vw_slaves_init(&port->slaves, &port->bus, port->task.memory->slave);
    port->slaves.sensor_inputs = port->sensor_inputs;
    (void)vw_slaves_start(&port->slaves);
    vw_measuring_init(&port->measuring, &port->slaves, port->task.memory, now_ms);
}

void port_pass(port_t *port, uint32_t now_ms, uint32_t pass_ms, const uint16_t *samples, uint16_t n, const port_inputs_t *with)
{
    vw_inputs_t inputs = { .is_drive_asked = with->is_drive_asked, .is_shutdown_closed = with->is_shutdown_closed };
    inputs.link_permille = with->link_permille;
    inputs.hardware = with->hardware;
    (void)vw_measuring_samples(&port->measuring, samples, n);
    vw_measuring_run(&port->measuring, &inputs, pass_ms, now_ms);
    vw_link_run(&port->link, now_ms);
    vw_master_step(&port->task, &inputs, now_ms);
    (void)vw_measuring_bleed(&port->measuring, port->task.balance.cells, port->task.has_new_cells, now_ms);
    port->task.has_new_cells = false;
}

void port_state(port_t *port, port_state_t *state)
{
    const vw_master_task_t *task = &port->task;
    state->relays = (uint8_t)task->relays.state;
    state->charging = (uint8_t)task->charging.state;
    state->has_precharge_failed = task->relays.has_failed;
    state->is_charging = task->charging.is_active;
    state->is_open = task->protection.is_open;
    state->is_streaming = port->link.is_streaming;
    state->is_restarting = port->is_restarting;
    state->has_new_cells = port->task.has_new_cells;
    state->relays_since_ms = task->relays.since_ms;
    (void)memcpy(state->cells, task->balance.cells, sizeof state->cells);
    port->task.has_new_cells = false;
}

uint8_t port_command(port_t *port, uint8_t command, int32_t argument)
{
    return (uint8_t)vw_master_command(&port->task, command, argument);
}

void port_received(port_t *port, uint32_t now_ms, const uint8_t *data, size_t length)
{
    vw_link_received(&port->link, now_ms, data, length);
}

size_t port_next(port_t *port, uint32_t now_ms, uint8_t out[VW_MAX_FRAME])
{
    vw_link_run(&port->link, now_ms);
    return vw_link_next(&port->link, now_ms, out);
}

bool port_can_next(port_t *port, uint32_t now_ms, vw_can_frame_t *frame)
{
    return vw_can_next(&port->can, now_ms, frame);
}

void port_can_received(port_t *port, uint32_t now_ms, const vw_can_frame_t *frame)
{
    vw_can_received(&port->can, now_ms, frame);
}
