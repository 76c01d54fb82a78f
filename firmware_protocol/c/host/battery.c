#include "battery.h"

#include <string.h>

#define REST_V 38950u /* 100 uV */
#define SPREAD_V 7u
#define N_SPREAD 13u
#define DRIVING_CURRENT 4200 /* 10 mA */
#define LINK_CHARGED 1000u
#define MAX_MEANS 255u

void battery_init(battery_t *battery, vw_link_t *link, bool is_driving, bool is_latched)
{
    vw_master_t *memory = link->answer.master;
    unsigned i;
    memset(battery, 0, sizeof *battery);
    memset((uint8_t *)memory + VW_CONFIG_SIZE, 0, VW_MASTER_SIZE - VW_CONFIG_SIZE);
    battery->memory = memory;
    battery->is_driving = is_driving;
    vw_estimator_init(&battery->estimator);
    vw_master_init(&battery->task, link, is_latched, 0u);
    battery->task.is_soc_estimated = true;
    memory->n_slaves = VW_N_PACKS;
    for (i = 0; i < VW_N_CELLS; i++) {
        memory->c[i] = (uint16_t)memory->conf.c_avg;
        memory->r_fs[i] = (uint16_t)memory->conf.r_fs_avg;
    }
    memory->c_min = memory->c_max = memory->c_avg = (uint16_t)memory->conf.c_avg;
}

/* A sample for each millisecond since the last pass; `ts` of them are one mean. This car averages no further. */
static uint8_t take_current(battery_t *battery, uint32_t now_ms, int32_t means[MAX_MEANS])
{
    vw_master_t *memory = battery->memory;
    int32_t sample = battery->task.relays.state == VW_RELAYS_VEHICLE ? DRIVING_CURRENT : 0;
    uint8_t n = 0u;
    for (; battery->sampled_ms != now_ms; battery->sampled_ms++) {
        battery->current_sum += sample;
        battery->n_samples++;
        if (battery->n_samples >= memory->conf.ts && n < MAX_MEANS) {
            means[n] = battery->current_sum / battery->n_samples;
            memory->i_fs = memory->i_fc = memory->i_fc_hp = means[n];
            battery->current_sum = 0;
            battery->n_samples = 0u;
            n++;
        }
    }
    return n;
}

static void take_cells(const battery_t *battery, uint32_t now_ms)
{
    vw_master_t *memory = battery->memory;
    uint32_t i;
    for (i = 0; i < VW_N_CELLS; i++) {
        uint16_t v = (uint16_t)(REST_V + SPREAD_V * (i * 5u % N_SPREAD) + (now_ms / 100u + i) % 3u);
        memory->v[i] = v;
        memory->t[i] = (int8_t)(24 + (int)(i / VW_CELLS_PER_PACK) % 3);
        memory->slave[i / VW_CELLS_PER_PACK].cvr[i % VW_CELLS_PER_PACK] = v;
        memory->slave[i / VW_CELLS_PER_PACK].status = 1u;
    }
}

/* Minima, maxima and means into the struct, and what is judged of them. */
static void summarise(vw_master_t *memory, vw_reading_t *reading)
{
    uint32_t i, sum = 0;
    int32_t t_sum = 0;
    memset(reading, 0, sizeof *reading);
    reading->v_min = UINT16_MAX;
    reading->t_min = INT8_MAX;
    reading->t_max = INT8_MIN;
    reading->lost_cell = reading->lost_temperature = reading->lost_slave = VW_NONE;
    for (i = VW_N_CELLS; i-- > 0u;) {
        uint16_t v = memory->v[i];
        int8_t t = memory->t[i];
        sum += v;
        t_sum += t;
        if (v <= reading->v_min) {
            reading->v_min = v;
            reading->v_min_id = (uint8_t)i;
        }
        if (v >= reading->v_max) {
            reading->v_max = v;
            reading->v_max_id = (uint8_t)i;
        }
        if (t <= reading->t_min) {
            reading->t_min = t;
            reading->t_min_id = (uint8_t)i;
        }
        if (t >= reading->t_max) {
            reading->t_max = t;
            reading->t_max_id = (uint8_t)i;
        }
    }
    reading->i_fc = memory->i_fc;
    memory->v_min = reading->v_min;
    memory->v_max = reading->v_max;
    memory->v_avg = (uint16_t)(sum / VW_N_CELLS);
    memory->v_tot = (uint16_t)(sum / 100u);
    memory->v_min_id = reading->v_min_id;
    memory->v_max_id = reading->v_max_id;
    memory->t_min = reading->t_min;
    memory->t_max = reading->t_max;
    memory->t_avg = (int8_t)(t_sum / (int32_t)VW_N_CELLS);
    memory->t_min_id = reading->t_min_id;
    memory->t_max_id = reading->t_max_id;
}

void battery_measure(battery_t *battery, uint32_t now_ms)
{
    int32_t means[MAX_MEANS];
    vw_inputs_t inputs = { .means = means, .is_ready = true, .is_shutdown_closed = true };
    inputs.is_drive_asked = battery->is_driving;
    inputs.link_permille = LINK_CHARGED;
    inputs.hardware = VW_STATUS_I2C1;
    inputs.n_means = take_current(battery, now_ms, means);
    take_cells(battery, now_ms);
    summarise(battery->memory, &inputs.reading);
    vw_master_step(&battery->task, &inputs, now_ms);
    while (vw_estimator_run(&battery->estimator, battery->memory, now_ms)) continue; /* a PC is quick */
}

enum vw_result battery_command(battery_t *battery, uint8_t command, int32_t argument)
{
    enum vw_result result = vw_master_command(&battery->task, command, argument);
    if (result == VW_RESULT_DONE && (command == VW_COMMAND_SET_SOC || command == VW_COMMAND_SOC_FROM_OCV)) {
        const vw_config_t *conf = &battery->memory->conf;
        vw_estimator_set_soc(&battery->estimator, vw_soc_counter_soc(&battery->task.counter, conf));
    }
    return result;
}
