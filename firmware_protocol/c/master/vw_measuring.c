#include "vw_measuring.h"

#include <string.h>

#include "../vw_time.h"

#define COUNTS_10MA 5000 /* i[10 mA] = (10 count - i_offset) i_gain / 5000 */
#define SAMPLE_S 0.001
#define US_PER_MS 1000u
#define MOST_PASS_MS 10000u /* what counts of a longer one */
#define HIGHEST_U16 65535.0
#define COLDEST_OF_NONE 127
#define HOTTEST_OF_NONE (-128)

/* To the nearest whole number, halves to the even one. */
static int32_t vw_measuring_round_value(double value)
{
    int32_t whole = (int32_t)value;
    double rest = value - (double)whole;
    bool is_odd = (whole % 2) != 0;
    if (rest > 0.5 || (rest >= 0.5 && is_odd)) {
        whole++;
    } else if (rest < -0.5 || (rest <= -0.5 && is_odd)) {
        whole--;
    } else {
        /* it is the nearest */
    }
    return whole;
}

static uint16_t vw_measuring_round_u16(double value)
{
    double below = value < HIGHEST_U16 ? value : HIGHEST_U16;
    return (uint16_t)vw_measuring_round_value(below > 0.0 ? below : 0.0);
}

static bool vw_measuring_has_cell(const uint16_t cells[VW_N_PACKS], size_t cell)
{
    return ((uint32_t)cells[cell / VW_CELLS_PER_PACK] & (1u << (cell % VW_CELLS_PER_PACK))) != 0u;
}

/* --- the current */

static int32_t vw_measuring_convert_current(const vw_config_t *conf, double count)
{
    return vw_measuring_round_value((10.0 * count - (double)conf->i_offset) * (double)conf->i_gain / (double)COUNTS_10MA);
}

static void vw_measuring_store_mean(vw_measuring_t *measuring, double mean)
{
    measuring->means[measuring->next] = mean;
    measuring->next = (uint16_t)((measuring->next + 1u) % VW_MEASURING_KEPT);
    measuring->n_kept = (uint16_t)(measuring->n_kept + (measuring->n_kept < VW_MEASURING_KEPT ? 1u : 0u));
}

/* The mean of the newest means that hold `fc_avg` samples, at least of one. */
static double vw_measuring_average_means(const vw_measuring_t *measuring, const vw_config_t *conf)
{
    uint32_t n = ((uint32_t)(uint16_t)conf->fc_avg + conf->ts - 1u) / conf->ts, i;
    double sum = 0.0;
    n = n > 0u ? n : 1u;
    n = n < measuring->n_kept ? n : measuring->n_kept;
    for (i = n; i > 0u; i--) {
        sum += measuring->means[(measuring->next + VW_MEASURING_KEPT - i) % VW_MEASURING_KEPT];
    }
    return sum / (double)n;
}

uint16_t vw_measuring_add_samples(vw_measuring_t *measuring, const uint16_t *samples, uint16_t n)
{
    const vw_config_t *conf = &measuring->memory->conf;
    uint16_t i;
    for (i = 0u; i < n && measuring->n_new < VW_MEASURING_NEW; i++) {
        measuring->sum += samples[i];
        measuring->n_samples++;
        measuring->latest = samples[i];
        measuring->has_samples = true;
        if (measuring->n_samples >= conf->ts) {
            double mean = (double)measuring->sum / (double)measuring->n_samples;
            vw_measuring_store_mean(measuring, mean);
            measuring->new_means[measuring->n_new] = vw_measuring_convert_current(conf, mean);
            measuring->n_new++;
            measuring->sum = 0u;
            measuring->n_samples = 0u;
        }
    }
    return i;
}

static void vw_measuring_measure_current(vw_measuring_t *measuring, vw_inputs_t *inputs)
{
    vw_master_t *memory = measuring->memory;
    uint16_t latest = measuring->latest;
    if (measuring->n_new > 0u) {
        double share = (double)((uint32_t)measuring->n_new * memory->conf.ts) * SAMPLE_S;
        memory->i_fs = measuring->new_means[measuring->n_new - 1u];
        measuring->i_fc = vw_measuring_convert_current(&memory->conf, vw_measuring_average_means(measuring,
                                                       &memory->conf));
        memory->i_fc = measuring->i_fc;
        measuring->i_fc_hp += ((double)measuring->i_fc - measuring->i_fc_hp) * (share < 1.0 ? share : 1.0);
        memory->i_fc_hp = vw_measuring_round_value(measuring->i_fc_hp);
    }
    inputs->means = measuring->new_means;
    inputs->n_means = measuring->n_new;
    inputs->reading.i_fc = measuring->i_fc;
    inputs->reading.is_current_lost = !measuring->has_samples || latest == 0u || latest >= VW_MEASURING_TOP
                                      || (latest >= VW_MEASURING_OPEN - VW_MEASURING_OPEN_WIDTH
                                          && latest <= VW_MEASURING_OPEN + VW_MEASURING_OPEN_WIDTH);
    measuring->n_new = 0u;
    measuring->has_samples = false;
}

/* --- temperatures */

static void vw_measuring_read_temperatures(vw_measuring_t *measuring)
{
    vw_slaves_t *slaves = measuring->slaves;
    vw_master_t *memory = measuring->memory;
    int32_t sum = 0;
    uint32_t n = 0u;
    uint8_t cell;
    vw_slaves_read_temperatures(slaves);
    measuring->lost_temperature = VW_NONE;
    measuring->t_min = COLDEST_OF_NONE;
    measuring->t_max = HOTTEST_OF_NONE;
    measuring->t_min_id = measuring->t_max_id = 0u;
    for (cell = 0u; cell < VW_N_CELLS; cell++) {
        uint8_t pack = (uint8_t)(cell / VW_CELLS_PER_PACK);
        int8_t degc = vw_slaves_cell_degc(slaves, pack, (uint8_t)(cell % VW_CELLS_PER_PACK));
        memory->t[cell] = degc;
        if (degc == VW_T_MISSING) {
            if (measuring->lost_temperature == VW_NONE && !slaves->is_silent[pack]) {
                measuring->lost_temperature = cell;
            }
            continue;
        }
        if (degc < measuring->t_min || n == 0u) {
            measuring->t_min = degc;
            measuring->t_min_id = cell;
        }
        if (degc > measuring->t_max || n == 0u) {
            measuring->t_max = degc;
            measuring->t_max_id = cell;
        }
        sum += degc;
        n++;
    }
    memory->t_min = n > 0u ? measuring->t_min : (int8_t)VW_T_MISSING;
    memory->t_max = n > 0u ? measuring->t_max : (int8_t)VW_T_MISSING;
    memory->t_avg = n > 0u ? (int8_t)vw_measuring_round_value((double)sum / (double)n) : (int8_t)VW_T_MISSING;
    memory->t_min_id = measuring->t_min_id;
    memory->t_max_id = measuring->t_max_id;
}

/* --- the self-check */

/* What this firmware takes from its configuration: capacities, resistances, and the OCV that they imply. */
static void vw_measuring_fill_slow_fields(vw_measuring_t *measuring)
{
    vw_master_t *memory = measuring->memory;
    const vw_config_t *conf = &memory->conf;
    double sag = (double)conf->r_fs_avg * measuring->i_fc_hp * 1e-3; /* 10 uohm times 10 mA is 0.1 uV [100 uV] */
    size_t cell;
    for (cell = 0u; cell < VW_N_CELLS; cell++) {
        memory->c[cell] = (uint16_t)conf->c_avg;
        memory->r_fs[cell] = (uint16_t)conf->r_fs_avg;
        memory->r_fc[cell] = (uint16_t)conf->r_fc_avg;
        if (!measuring->is_ocv_estimated) {
            double ocv = measuring->v[cell] + sag;
            memory->ocv[cell] = vw_measuring_has_cell(measuring->known,
                                                      cell) ? vw_measuring_round_u16(ocv) : (uint16_t)VW_V_MISSING;
        }
    }
    memory->c_min = memory->c_max = memory->c_avg = (uint16_t)conf->c_avg;
    memory->c_min_id = memory->c_max_id = 0u;
}

/* The stages that are due, as far as the pass has time for them. */
static void vw_measuring_run_self_check(vw_measuring_t *measuring, uint32_t left_us, uint32_t now_ms)
{
    uint32_t us = left_us;
    while (vw_is_due(now_ms, measuring->check_ms) && us >= VW_SLAVES_CHECK_STAGE_US) {
        us -= VW_SLAVES_CHECK_STAGE_US;
        measuring->check_ms += VW_MEASURING_CHECK_MS;
        if (vw_slaves_self_check(measuring->slaves)) {
            vw_measuring_fill_slow_fields(measuring);
        }
    }
}

/* --- voltages */

/* Which cells have a voltage now, and what the struct says of the slaves. A cell that has one again begins anew. */
static void vw_measuring_find_valid_cells(vw_measuring_t *measuring)
{
    vw_slaves_t *slaves = measuring->slaves;
    uint8_t pack, cell, n_slaves = 0u;
    measuring->lost_cell = measuring->lost_slave = VW_NONE;
    for (pack = 0u; pack < VW_N_PACKS; pack++) {
        vw_slave_t *slave = &slaves->slave[pack];
        bool is_silent = measuring->is_silent[pack];
        uint16_t known = is_silent ? 0u : vw_slaves_measured_cells(slaves, pack);
        bool is_good = !is_silent && slaves->failures[pack] == 0u;
        slave->status = is_good ? VW_SLAVE_STATUS_ACTIVE : VW_SLAVE_STATUS_FAULT;
        n_slaves = (uint8_t)(n_slaves + (is_silent ? 0u : 1u));
        if (is_silent && measuring->lost_slave == VW_NONE) {
            measuring->lost_slave = pack;
        }
        for (cell = 0u; cell < VW_CELLS_PER_PACK; cell++) {
            uint8_t of_all = (uint8_t)(pack * VW_CELLS_PER_PACK + cell);
            bool is_known = ((uint32_t)known & (1u << cell)) != 0u;
            if (is_known && !vw_measuring_has_cell(measuring->known, of_all)) {
                measuring->v[of_all] = (double)slave->cvr[cell];
            }
            if (!is_known && !is_silent && measuring->lost_cell == VW_NONE) {
                measuring->lost_cell = of_all;
            }
        }
        measuring->known[pack] = known;
    }
    measuring->memory->n_slaves = n_slaves;
}

static void vw_measuring_filter_voltages(vw_measuring_t *measuring, vw_reading_t *reading)
{
    vw_master_t *memory = measuring->memory;
    double alpha = (double)memory->conf.v_alpha * 1e-3;
    uint32_t total = 0u, n = 0u;
    uint8_t cell;
    reading->v_min = UINT16_MAX;
    reading->v_max = 0u;
    reading->v_min_id = reading->v_max_id = 0u;
    for (cell = 0u; cell < VW_N_CELLS; cell++) {
        const vw_slave_t *slave = &measuring->slaves->slave[cell / VW_CELLS_PER_PACK];
        double *v = &measuring->v[cell];
        if (!vw_measuring_has_cell(measuring->known, cell)) {
            memory->v[cell] = VW_V_MISSING;
            continue;
        }
        *v += alpha * ((double)slave->cvr[cell % VW_CELLS_PER_PACK] - *v);
        memory->v[cell] = vw_measuring_round_u16(*v);
        total += memory->v[cell];
        n++;
        if (memory->v[cell] < reading->v_min) {
            reading->v_min = memory->v[cell];
            reading->v_min_id = cell;
        }
        if (memory->v[cell] > reading->v_max) {
            reading->v_max = memory->v[cell];
            reading->v_max_id = cell;
        }
    }
    memory->v_min = n > 0u ? reading->v_min : (uint16_t)VW_V_MISSING;
    memory->v_max = reading->v_max;
    memory->v_avg = n > 0u ? vw_measuring_round_u16((double)total / (double)n) : (uint16_t)VW_V_MISSING;
    memory->v_min_id = reading->v_min_id;
    memory->v_max_id = reading->v_max_id;
    memory->v_tot = vw_measuring_round_u16((double)total / 100.0);
}

/* --- a pass */

void vw_measuring_init(vw_measuring_t *measuring, vw_slaves_t *slaves, vw_master_t *memory, uint32_t now_ms)
{
    (void)memset(measuring, 0, sizeof *measuring);
    measuring->slaves = slaves;
    measuring->memory = memory;
    measuring->lost_cell = measuring->lost_slave = measuring->lost_temperature = VW_NONE;
    measuring->t_min = COLDEST_OF_NONE;
    measuring->t_max = HOTTEST_OF_NONE;
    measuring->start_ms = measuring->temperatures_ms = measuring->check_ms = measuring->bleed_ms = now_ms;
    (void)memset(memory->t, VW_T_MISSING, sizeof memory->t);
    memory->t_min = memory->t_max = memory->t_avg = VW_T_MISSING;
}

void vw_measuring_run(vw_measuring_t *measuring, vw_inputs_t *inputs, uint32_t pass_ms, uint32_t now_ms)
{
    vw_slaves_t *slaves = measuring->slaves;
    vw_reading_t *reading = &inputs->reading;
    uint32_t pass_us = (pass_ms < MOST_PASS_MS ? pass_ms : MOST_PASS_MS) * US_PER_MS;
    vw_slaves_begin(slaves, pass_ms);
    (void)vw_slaves_read_voltages(slaves);
    (void)memcpy(measuring->is_silent, slaves->is_silent, sizeof measuring->is_silent);
    if (!slaves->has_returned) {
        uint32_t taken_us = VW_MEASURING_VOLTAGES_US;
        if (vw_is_due(now_ms, measuring->temperatures_ms)) {
            measuring->temperatures_ms = now_ms + VW_MEASURING_TEMPERATURES_MS;
            vw_measuring_read_temperatures(measuring);
            taken_us += VW_MEASURING_PHASE_US;
        }
        vw_measuring_run_self_check(measuring, pass_us > taken_us ? pass_us - taken_us : 0u, now_ms);
    }
    vw_measuring_measure_current(measuring, inputs);
    vw_measuring_find_valid_cells(measuring);
    vw_measuring_filter_voltages(measuring, reading);
    measuring->is_ready = measuring->is_ready || now_ms - measuring->start_ms >= VW_MEASURING_READY_MS;
    reading->t_min = measuring->t_min;
    reading->t_max = measuring->t_max;
    reading->t_min_id = measuring->t_min_id;
    reading->t_max_id = measuring->t_max_id;
    reading->lost_cell = measuring->lost_cell;
    reading->lost_slave = measuring->lost_slave;
    reading->lost_temperature = measuring->lost_temperature;
    inputs->is_ready = measuring->is_ready;
}

bool vw_measuring_write_bleeding(vw_measuring_t *measuring, const uint16_t cells[VW_N_PACKS], bool is_now,
                                 uint32_t now_ms)
{
    bool is_due = is_now || vw_is_due(now_ms, measuring->bleed_ms);
    if (is_due) {
        measuring->bleed_ms = now_ms + VW_MEASURING_BLEED_MS;
        vw_slaves_configure(measuring->slaves, cells);
    }
    return is_due;
}
