/* Counts instructions of the slaves' driver and of measuring with it on an emulated STM32F4: chips that answer at once, so what is counted is the
 * processor's own work, without the bus.
 */
#include "bare_metal.h"
#include "master/vw_balance.h"
#include "master/vw_measuring.h"

static bool transfer(void *context, const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length)
{
    static const uint8_t answer[8] = { 0x88, 0x90, 0x88, 0x90, 0x88, 0x90, 0xE5, 0xB2 }; /* three cells at 3.7 V */
    (void)context;
    (void)tx;
    (void)tx_length;
    memcpy(rx, answer, rx_length);
    return true;
}

static void wait_us(void *context, uint32_t time_us)
{
    (void)context;
    (void)time_us;
}

static const vw_ltc_bus_t bus = { .transfer = transfer, .wait_us = wait_us };
static vw_master_t memory;
static vw_slaves_t slaves;
static vw_balance_t balance;
static vw_measuring_t measuring;
static vw_inputs_t inputs;

int main(void)
{
    static const uint16_t bleed[VW_N_PACKS] = { 1u };
    uint16_t v[VW_N_CELLS], samples[20];
    size_t i;
    for (i = 0; i < VW_N_CELLS; i++) {
        v[i] = (uint16_t)(36000u + 10u * i);
    }
    calibrate();
    print_number("size of vw_slaves_t", sizeof slaves);
    vw_slaves_init(&slaves, &bus, memory.slave);
    MEASURE("vw_slaves_start", (void)vw_slaves_start(&slaves));
    MEASURE("vw_slaves_begin", vw_slaves_begin(&slaves, 20u));
    MEASURE("vw_slaves_read_voltages (8 slaves)", (void)vw_slaves_read_voltages(&slaves));
    MEASURE("vw_slaves_read_temperatures (8 slaves)", vw_slaves_read_temperatures(&slaves));
    MEASURE("vw_slaves_self_check (a pattern)", (void)vw_slaves_self_check(&slaves));
    MEASURE("vw_slaves_configure", vw_slaves_configure(&slaves, bleed));
    MEASURE("vw_slaves_cell_degc", (void)vw_slaves_cell_degc(&slaves, 0u, 0u));
    vw_balance_init(&balance);
    MEASURE("vw_balance_choose (96 cells)", (void)vw_balance_choose(&balance, 250u, v));
    memory.conf.ts = 10u;
    memory.conf.fc_avg = 10;
    memory.conf.v_alpha = 500u;
    memory.conf.i_offset = 20490u;
    memory.conf.i_gain = 12120u;
    for (i = 0; i < 20u; i++) {
        samples[i] = (uint16_t)(2049u + 13u * i);
    }
    print_number("size of vw_measuring_t", sizeof measuring);
    vw_measuring_init(&measuring, &slaves, &memory, 0u);
    MEASURE("vw_measuring_add_samples (20)", (void)vw_measuring_add_samples(&measuring, samples, 20u));
    MEASURE("vw_measuring_run (voltages, temperatures)", vw_measuring_run(&measuring, &inputs, 20u, 0u));
    MEASURE("vw_measuring_run (voltages, a stage of the check)", vw_measuring_run(&measuring, &inputs, 20u, 20u));
    MEASURE("vw_measuring_run (voltages)", vw_measuring_run(&measuring, &inputs, 20u, 40u));
    finish();
    return 0;
}
