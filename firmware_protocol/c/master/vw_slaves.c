#include "vw_slaves.h"

#include <string.h>

#define TRIES 3u
#define WATCHFUL_MS 60000u /* after a damaged packet */
#define OPEN_WIRE_COUNTS 4000 /* the data sheet's 400 mV */
#define REFERENCE_LOWEST 29850u /* the second reference of a sound chip, 2.985 to 3.015 V */
#define REFERENCE_HIGHEST 30150u
#define MULTIPLEXER_FLAG 0x0200u /* in the last status word */
#define CELL_GROUPS 4u
#define DATA_FROM 1u /* of the configuration: GPIO inputs read as they stand, SWTEN as its pin */
#define PHASE_MASK(phase) ((uint16_t)((phase) == 0u ? 0x0555u : 0x0AAAu))

/* The self-check runs at 14 kHz, so that a stage fits into a pass with the voltages. Times of the data sheet [us]. */
#define CHECK_MODE VW_LTC_FAST
#define TWELVE_CELLS_US 1288u
#define AUXILIARY_US 1288u
#define STATUS_US 865u
#define MULTIPLEXER_US 400u

/* What one read of everything but the cells gives: both auxiliary and both status groups. */
#define OTHER_WORDS (4u * VW_LTC_GROUP_WORDS)
#define SECOND_REFERENCE 5u
#define FIRST_STATUS 6u
#define STATUS_RESULTS 4u /* sum of cells, die, two supplies */
#define LAST_STATUS 11u

static const uint8_t default_config[VW_LTC_GROUP_SIZE] = VW_SLAVES_CONFIG;
static const uint8_t thesis_inputs[VW_LTC_CELLS] = VW_SLAVES_SENSOR_INPUTS;
static const uint16_t read_cells[CELL_GROUPS] = { VW_LTC_RDCVA, VW_LTC_RDCVB, VW_LTC_RDCVC, VW_LTC_RDCVD };
static const uint16_t read_other[CELL_GROUPS] = { VW_LTC_RDAUXA, VW_LTC_RDAUXB, VW_LTC_RDSTATA, VW_LTC_RDSTATB };

/* Time of each step of one reading [us]: conversion, four cell groups, auxiliary, status, the two phases of sensors. */
static const uint32_t step_times_us[18] = {
    VW_SLAVES_CELLS_US, 96u, 96u, 96u, 96u, AUXILIARY_US, 96u, 96u, STATUS_US, 96u, 96u,
    VW_SLAVES_SENSORS_US, 96u, 96u, 96u, 96u, VW_SLAVES_SENSORS_US, 384u,
};

static uint8_t vw_slaves_address_of_pack(size_t pack)
{
    return (uint8_t)(VW_SLAVES_FIRST_ADDRESS + pack);
}

static uint16_t vw_slaves_saturate_u16(uint32_t value)
{
    return (uint16_t)(value < 0xFFFFu ? value : 0xFFFFu);
}

static void vw_slaves_wait_us(const vw_slaves_t *slaves, uint32_t time_us)
{
    slaves->bus->wait_us(slaves->bus->context, time_us);
    if (time_us > VW_SLAVES_IDLE_US) {
        (void)vw_ltc_wake(slaves->bus);
        slaves->bus->wait_us(slaves->bus->context, VW_SLAVES_READY_US);
    }
}

/* Read a group and count it. A failed SPI is a packet that did not arrive. */
static bool vw_slaves_read_group(vw_slaves_t *slaves, size_t pack, uint16_t command, uint8_t group[VW_LTC_GROUP_SIZE])
{
    slaves->packets++;
    if (vw_ltc_read(slaves->bus, vw_slaves_address_of_pack(pack), command, group)) {
        return true;
    }
    slaves->packet_errors++;
    slaves->bad_packets[pack]++;
    slaves->slave[pack].com[0] = vw_slaves_saturate_u16(slaves->bad_packets[pack]);
    slaves->noisy_ms_left = WATCHFUL_MS;
    return false;
}

/* Read four groups; only what arrived intact is written. How many did. */
static uint8_t vw_slaves_read_groups(vw_slaves_t *slaves, size_t pack, const uint16_t commands[CELL_GROUPS],
                                     uint16_t *words)
{
    uint8_t intact = 0u;
    size_t i;
    for (i = 0; i < CELL_GROUPS; i++) {
        uint8_t group[VW_LTC_GROUP_SIZE];
        if (vw_slaves_read_group(slaves, pack, commands[i], group)) {
            vw_ltc_words_decode(group, words + i * VW_LTC_GROUP_WORDS);
            intact++;
        }
    }
    return intact;
}

/* The same for the cells: a slave without one good packet is silent. Whether all packets were good. */
static bool vw_slaves_read_cells(vw_slaves_t *slaves, size_t pack, uint16_t *words)
{
    uint8_t intact = vw_slaves_read_groups(slaves, pack, read_cells, words);
    slaves->is_silent[pack] = intact == 0u;
    return intact == CELL_GROUPS;
}

static bool vw_slaves_read_config(vw_slaves_t *slaves, size_t pack, uint8_t group[VW_LTC_GROUP_SIZE])
{
    return vw_slaves_read_group(slaves, pack, VW_LTC_RDCFG, group);
}

/* Start a conversion and wait until it is over; on a noisy pair ask whether it has begun, if not once more. */
static void vw_slaves_run_conversion(vw_slaves_t *slaves, uint16_t command, uint32_t time_us)
{
    unsigned i;
    for (i = 0; i < TRIES; i++) {
        (void)vw_ltc_command(slaves->bus, VW_LTC_BROADCAST, command);
        if (slaves->noisy_ms_left == 0u || vw_ltc_is_busy(slaves->bus)) {
            break;
        }
    }
    vw_slaves_wait_us(slaves, time_us);
}

static void vw_slaves_write_switches(const vw_slaves_t *slaves, uint8_t address, uint16_t cells)
{
    vw_ltc_config_t config;
    uint8_t group[VW_LTC_GROUP_SIZE];
    vw_ltc_config_decode(default_config, &config);
    config.discharge = cells;
    vw_ltc_config_encode(&config, group);
    (void)vw_ltc_write(slaves->bus, address, VW_LTC_WRCFG, group);
}

static void vw_slaves_write_bleeding(const vw_slaves_t *slaves)
{
    uint16_t any = 0u;
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        any = (uint16_t)(any | slaves->bleed[pack]);
    }
    if (any == 0u) {
        vw_slaves_write_switches(slaves, VW_LTC_BROADCAST, 0u);
        return;
    }
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        vw_slaves_write_switches(slaves, vw_slaves_address_of_pack(pack), slaves->bleed[pack]);
    }
}

/* Whether the chips that can be read back hold these switches, and there are such. */
static bool vw_slaves_compare_switches(vw_slaves_t *slaves, uint16_t cells)
{
    bool is_read = false, is_right = true;
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        uint8_t group[VW_LTC_GROUP_SIZE];
        if (vw_slaves_read_config(slaves, pack, group)) {
            vw_ltc_config_t config;
            vw_ltc_config_decode(group, &config);
            is_read = true;
            is_right = is_right && config.discharge == cells;
        }
    }
    return is_read && is_right;
}

static void vw_slaves_write_status(const vw_slaves_t *slaves)
{
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        bool is_good = !slaves->is_silent[pack] && slaves->failures[pack] == 0u;
        slaves->slave[pack].status = is_good ? VW_SLAVE_STATUS_ACTIVE : VW_SLAVE_STATUS_FAULT;
    }
}

void vw_slaves_init(vw_slaves_t *slaves, const vw_ltc_bus_t *bus, vw_slave_t slave[VW_N_PACKS])
{
    size_t pack, i;
    (void)memset(slaves, 0, sizeof *slaves);
    slaves->bus = bus;
    slaves->slave = slave;
    slaves->sensor_inputs = thesis_inputs;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        vw_slave_t *own = &slave[pack];
        own->status = VW_SLAVE_STATUS_ABSENT;
        (void)memcpy(own->time, step_times_us, sizeof own->time);
        for (i = 0; i < VW_LTC_CELLS; i++) {
            own->cvr[i] = own->temp[i] = own->temp[VW_LTC_CELLS + i] = VW_LTC_MISSING;
        }
    }
}

uint8_t vw_slaves_start(vw_slaves_t *slaves)
{
    uint8_t n_active = 0u;
    size_t pack;
    vw_slaves_begin(slaves, 0u);
    (void)vw_ltc_command(slaves->bus, VW_LTC_BROADCAST, VW_LTC_CLRCELL);
    vw_slaves_write_switches(slaves, VW_LTC_BROADCAST, 0u);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        vw_slave_t *own = &slaves->slave[pack];
        size_t size = VW_LTC_GROUP_SIZE - DATA_FROM;
        bool is_read = vw_slaves_read_config(slaves, pack, own->cfgr);
        bool is_set = is_read && memcmp(own->cfgr + DATA_FROM, default_config + DATA_FROM, size) == 0;
        own->status = is_set ? VW_SLAVE_STATUS_ACTIVE : VW_SLAVE_STATUS_FAULT;
        n_active = (uint8_t)(n_active + (is_set ? 1u : 0u));
    }
    return n_active;
}

void vw_slaves_begin(vw_slaves_t *slaves, uint32_t pass_ms)
{
    slaves->noisy_ms_left -= pass_ms < slaves->noisy_ms_left ? pass_ms : slaves->noisy_ms_left;
    (void)vw_ltc_wake(slaves->bus);
    vw_slaves_wait_us(slaves, VW_SLAVES_WAKE_US);
}

void vw_slaves_configure(vw_slaves_t *slaves, const uint16_t bleed[VW_N_PACKS])
{
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        slaves->bleed[pack] = bleed[pack] & VW_SLAVES_ALL_CELLS;
    }
    vw_slaves_write_bleeding(slaves);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        (void)vw_slaves_read_config(slaves, pack, slaves->slave[pack].cfgr);
    }
}

uint8_t vw_slaves_read_voltages(vw_slaves_t *slaves)
{
    uint8_t n_silent = 0u;
    size_t pack;
    slaves->is_whole = true;
    slaves->has_returned = false;
    vw_slaves_run_conversion(slaves, vw_ltc_adcv(VW_LTC_FILTERED, false), VW_SLAVES_CELLS_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        bool was_silent = slaves->is_silent[pack];
        slaves->is_whole = vw_slaves_read_cells(slaves, pack, slaves->slave[pack].cvr) && slaves->is_whole;
        if (slaves->is_silent[pack]) {
            n_silent++;
        } else if (was_silent) {
            slaves->has_returned = true;
        }
    }
    if (slaves->has_returned) {
        vw_slaves_write_bleeding(slaves);
    }
    vw_slaves_write_status(slaves);
    return n_silent;
}

void vw_slaves_read_temperatures(vw_slaves_t *slaves)
{
    uint16_t selected = PHASE_MASK(slaves->phase);
    size_t pack;
    unsigned i;
    for (i = 0; i < TRIES; i++) {
        vw_slaves_write_switches(slaves, VW_LTC_BROADCAST, selected);
        if (slaves->noisy_ms_left == 0u || vw_slaves_compare_switches(slaves, selected)) {
            break;
        }
    }
    vw_slaves_wait_us(slaves, VW_SLAVES_SWITCH_US);
    vw_slaves_run_conversion(slaves, vw_ltc_adcv(VW_LTC_FAST, true), VW_SLAVES_SENSORS_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        (void)vw_slaves_read_cells(slaves, pack, slaves->slave[pack].temp + slaves->phase * VW_LTC_CELLS);
    }
    vw_slaves_write_bleeding(slaves);
    vw_slaves_write_status(slaves);
    slaves->phase = (uint8_t)(1u - slaves->phase);
}

static bool vw_slaves_compare_words(const uint16_t *words, size_t n, uint16_t code)
{
    size_t i;
    for (i = 0; i < n; i++) {
        if (words[i] != code) {
            return false;
        }
    }
    return true;
}

static void vw_slaves_set_failure(vw_slaves_t *slaves, size_t pack, enum vw_slaves_failure failure)
{
    slaves->failures_so_far[pack] = (uint16_t)(slaves->failures_so_far[pack] | (unsigned)failure);
}

/* A packet that is damaged proves nothing. */
static void vw_slaves_test_converters(vw_slaves_t *slaves, uint8_t pattern)
{
    uint16_t code = vw_ltc_self_test_code(CHECK_MODE, pattern, true);
    size_t pack;
    vw_slaves_run_conversion(slaves, vw_ltc_cvst(CHECK_MODE, pattern), TWELVE_CELLS_US);
    vw_slaves_run_conversion(slaves, vw_ltc_axst(CHECK_MODE, pattern), AUXILIARY_US);
    vw_slaves_run_conversion(slaves, vw_ltc_statst(CHECK_MODE, pattern), STATUS_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        uint16_t words[VW_LTC_CELLS] = { 0u };
        if (vw_slaves_read_groups(slaves, pack, read_cells, words) == CELL_GROUPS && !vw_slaves_compare_words(words,
            VW_LTC_CELLS, code)) {
            vw_slaves_set_failure(slaves, pack, VW_SLAVES_CELLS_FAILED);
        }
    }
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        uint16_t words[OTHER_WORDS] = { 0u };
        if (vw_slaves_read_groups(slaves, pack, read_other, words) == CELL_GROUPS) {
            if (!vw_slaves_compare_words(words, FIRST_STATUS, code)) {
                vw_slaves_set_failure(slaves, pack, VW_SLAVES_AUXILIARY_FAILED);
            }
            if (!vw_slaves_compare_words(words + FIRST_STATUS, STATUS_RESULTS, code)) {
                vw_slaves_set_failure(slaves, pack, VW_SLAVES_STATUS_FAILED);
            }
        }
    }
}

/* References and supplies into the struct, and the multiplexer's own test. */
static void vw_slaves_test_references(vw_slaves_t *slaves)
{
    size_t pack;
    vw_slaves_run_conversion(slaves, vw_ltc_adax(CHECK_MODE), AUXILIARY_US);
    vw_slaves_run_conversion(slaves, vw_ltc_adstat(CHECK_MODE), STATUS_US);
    vw_slaves_run_conversion(slaves, VW_LTC_DIAGN, MULTIPLEXER_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        vw_slave_t *own = &slaves->slave[pack];
        uint16_t words[OTHER_WORDS] = { 0u };
        if (vw_slaves_read_groups(slaves, pack, read_other, words) != CELL_GROUPS) {
            continue;
        }
        (void)memcpy(own->avr, words, sizeof own->avr);
        (void)memcpy(own->str, words + FIRST_STATUS, sizeof own->str);
        if ((words[LAST_STATUS] & MULTIPLEXER_FLAG) != 0u) {
            vw_slaves_set_failure(slaves, pack, VW_SLAVES_MULTIPLEXER_FAILED);
        }
        if (words[SECOND_REFERENCE] < REFERENCE_LOWEST || words[SECOND_REFERENCE] > REFERENCE_HIGHEST) {
            vw_slaves_set_failure(slaves, pack, VW_SLAVES_REFERENCE_FAILED);
        }
    }
}

/* The cells on both sides of each open wire: pulled up minus pulled down is far below zero above it. */
static uint16_t vw_slaves_cells_at_open_wires(const uint16_t up[VW_LTC_CELLS], const uint16_t down[VW_LTC_CELLS])
{
    unsigned cells = 0u, cell;
    for (cell = 1u; cell < VW_LTC_CELLS; cell++) {
        if ((int32_t)up[cell] - (int32_t)down[cell] < -OPEN_WIRE_COUNTS) {
            cells |= 3u << (cell - 1u);
        }
    }
    if (down[VW_LTC_CELLS - 1u] == 0u && up[VW_LTC_CELLS - 1u] != 0u) {
        cells |= 1u << (VW_LTC_CELLS - 1u);
    }
    return (uint16_t)cells;
}

static void vw_slaves_find_open_wires(vw_slaves_t *slaves)
{
    uint16_t up[VW_N_PACKS][VW_LTC_CELLS];
    bool is_whole[VW_N_PACKS];
    size_t pack;
    vw_slaves_run_conversion(slaves, vw_ltc_adow(CHECK_MODE, true), TWELVE_CELLS_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        is_whole[pack] = vw_slaves_read_cells(slaves, pack, up[pack]);
    }
    vw_slaves_run_conversion(slaves, vw_ltc_adow(CHECK_MODE, false), TWELVE_CELLS_US);
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        uint16_t down[VW_LTC_CELLS];
        if (vw_slaves_read_cells(slaves, pack, down) && is_whole[pack]) {
            slaves->open_wires[pack] = vw_slaves_cells_at_open_wires(up[pack], down);
        }
    }
}

static void vw_slaves_finish_self_check(vw_slaves_t *slaves)
{
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        uint16_t *com = slaves->slave[pack].com;
        slaves->failures[pack] = slaves->failures_so_far[pack];
        slaves->failures_so_far[pack] = 0u;
        com[1] = vw_slaves_saturate_u16(slaves->bad_packets[pack] - slaves->bad_before[pack]);
        com[2] = slaves->failures[pack];
        slaves->bad_before[pack] = slaves->bad_packets[pack];
    }
    vw_slaves_write_status(slaves);
}

bool vw_slaves_self_check(vw_slaves_t *slaves)
{
    uint8_t stage = slaves->stage;
    slaves->stage = (uint8_t)((stage + 1u) % VW_SLAVES_CHECK_STAGES);
    if (stage < 2u) {
        vw_slaves_test_converters(slaves, (uint8_t)(stage + 1u));
    } else if (stage == 2u) {
        vw_slaves_test_references(slaves);
    } else {
        vw_slaves_find_open_wires(slaves);
        vw_slaves_finish_self_check(slaves);
    }
    return slaves->stage == 0u;
}
