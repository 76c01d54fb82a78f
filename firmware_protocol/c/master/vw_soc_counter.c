#include "vw_soc_counter.h"

#include <string.h>

#define PER_UAH 360 /* 10 mA for 1 ms */
#define FULL_SOC 10000u
#define N_POINTS 21u
#define SOC_STEP (FULL_SOC / (N_POINTS - 1u)) /* between two points of the table */

/* The voltage at rest [100 uV] at 0, 5, ... 100 %. */
static const uint16_t rest_v[N_POINTS] = {
    26600u, 33080u, 34060u, 34620u, 35040u, 35530u, 36000u, 36270u, 36520u, 36920u, 37420u,
    37900u, 38410u, 38840u, 39260u, 39750u, 40250u, 40580u, 40860u, 41360u, 41940u
};

/* Linear between the points, rounded down [0.01 %]. */
static uint16_t vw_soc_counter_interpolate_ocv(uint16_t v)
{
    uint32_t k = 0u;
    while (k < N_POINTS - 1u && v >= rest_v[k + 1u]) {
        k++;
    }
    if (k == N_POINTS - 1u || v <= rest_v[0]) {
        return (uint16_t)(k * SOC_STEP);
    }
    return (uint16_t)(k * SOC_STEP + ((uint32_t)v - rest_v[k]) * SOC_STEP / ((uint32_t)rest_v[k + 1u] - rest_v[k]));
}

/* What 0.01 % of the capacity are [uAh]: c_avg, which is above 0 and has 10 mAh a count, is that number. */
static uint32_t vw_soc_counter_charge_per_step(const vw_config_t *conf)
{
    return (uint16_t)conf->c_avg;
}

void vw_soc_counter_init(vw_soc_counter_t *counter)
{
    (void)memset(counter, 0, sizeof *counter);
}

void vw_soc_counter_from_journal(vw_soc_counter_t *counter, uint32_t dod)
{
    counter->dod = dod;
    counter->rest = 0u;
    counter->is_started = true;
}

void vw_soc_counter_set(vw_soc_counter_t *counter, const vw_config_t *conf, uint16_t soc)
{
    vw_soc_counter_from_journal(counter, vw_soc_counter_charge_per_step(conf) * (FULL_SOC - soc));
}

bool vw_soc_counter_from_rest(vw_soc_counter_t *counter, const vw_config_t *conf, uint16_t v_avg, int32_t i_fc)
{
    bool is_at_rest = v_avg != VW_V_MISSING && i_fc < VW_REST_CURRENT && i_fc > -VW_REST_CURRENT;
    if (is_at_rest) {
        vw_soc_counter_set(counter, conf, vw_soc_counter_interpolate_ocv(v_avg));
    }
    return is_at_rest;
}

void vw_soc_counter_count(vw_soc_counter_t *counter, const vw_config_t *conf, int32_t mean, uint16_t n_samples)
{
    int32_t moved = (int32_t)counter->rest + mean * (int32_t)n_samples;
    int32_t whole = moved / PER_UAH, rest = moved % PER_UAH;
    uint32_t full = vw_soc_counter_charge_per_step(conf) * FULL_SOC;
    if (rest < 0) {
        rest += PER_UAH;
        whole--;
    }
    if (whole < 0 && (uint32_t)-whole > counter->dod) {
        counter->dod = 0u;
        rest = 0;
    } else {
        counter->dod += (uint32_t)whole;
    }
    if (counter->dod >= full) {
        counter->dod = full;
        rest = 0;
    }
    counter->rest = (uint16_t)rest;
}

uint16_t vw_soc_counter_soc(const vw_soc_counter_t *counter, const vw_config_t *conf)
{
    uint32_t drawn = counter->dod / vw_soc_counter_charge_per_step(conf);
    return counter->is_started && drawn < FULL_SOC ? (uint16_t)(FULL_SOC - drawn) : 0u;
}
