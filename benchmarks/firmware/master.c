/* Counts instructions of the master's step on an emulated STM32F4: everything but measuring and the estimator. */
#include "bare_metal.h"
#include "master/vw_master.h"

static bool eeprom_read(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    (void)address;
    memset(data, 0xFF, length);
    return true;
}

static bool eeprom_write(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    (void)context;
    (void)address;
    (void)data;
    (void)length;
    return true;
}

static bool eeprom_is_busy(void *context)
{
    (void)context;
    return false;
}

static const vw_board_t board = {
    .eeprom_read = eeprom_read, .eeprom_write = eeprom_write, .eeprom_is_busy = eeprom_is_busy
};
static vw_master_t memory;
static vw_link_t line;
static vw_can_t can;
static vw_master_task_t task;
static vw_event_t trips[VW_N_TRIPS];

int main(void)
{
    static const vw_ident_t ident = { .firmware = { 1u, 0u, 0u } };
    static const int32_t means[] = { 30 };
    vw_can_frame_t status = { .id = 0x18FF50E5u, .is_extended = true, .length = 8u, .data = { 0x0Eu, 0xD8u, 0u, 60u } };
    vw_inputs_t inputs = { .means = means, .n_means = 1u, .is_ready = true, .is_shutdown_closed = true };
    vw_reading_t bad;
    uint32_t i;
    calibrate();
    print_number("size of vw_master_task_t", sizeof task);
    vw_link_init(&line, &board, &memory, &can, &ident);
    MEASURE("vw_master_init", vw_master_init(&task, &line, false, 0u));
    for (i = 0u; i < VW_N_CELLS; i++) {
        memory.v[i] = (uint16_t)(39000u + i * 37u % 96u);
    }
    memory.v_avg = 39040u;
    inputs.reading.v_min = 39000u;
    inputs.reading.v_max = 39095u;
    inputs.reading.t_min = 20;
    inputs.reading.t_max = 33;
    inputs.reading.lost_cell = inputs.reading.lost_temperature = inputs.reading.lost_slave = VW_NONE;
    bad = inputs.reading;
    bad.v_max = 43000u;
    bad.i_fc = 30000;
    bad.lost_cell = 3u;
    vw_master_step(&task, &inputs, 20u);
    MEASURE("vw_master_step (a pass)", vw_master_step(&task, &inputs, 40u));
    MEASURE("vw_protection_check (nothing)",
            (void)vw_protection_check(&task.protection, &memory.conf, &inputs.reading, 41u, trips));
    MEASURE("vw_protection_check (three limits)",
            (void)vw_protection_check(&task.protection, &memory.conf, &bad, 42u, trips));
    (void)vw_protection_check(&task.protection, &memory.conf, &inputs.reading, 43u, trips);
    (void)vw_master_command(&task, VW_COMMAND_CHARGE_START, 0);
    vw_can_received(&can, 50u, &status);
    vw_master_step(&task, &inputs, 60u);
    for (i = 0u; i < VW_N_CELLS; i++) {
        memory.v[i] = (uint16_t)(memory.v[i] + 100u - i); /* the worst order for the median */
    }
    MEASURE("vw_master_step (the current is trimmed)", vw_master_step(&task, &inputs, 80u));
    MEASURE("vw_master_step (charging, between two of those)", vw_master_step(&task, &inputs, 100u));
    MEASURE("vw_master_command (CLEAR_FAULTS)", (void)vw_master_command(&task, VW_COMMAND_CLEAR_FAULTS, 0));
    finish();
    return 0;
}
