#include "vw_slaves.h"

/* The sensor's voltage at -40 to 120 degC in steps of 5 K [100 uV]: the 33 points that Energus publishes. */
#define FIRST_DEGC (-40)
#define STEP_DEGC 5
#define N_POINTS 33u
#define MARGIN_COUNTS 50u /* half of the table's last digit */
static const uint16_t points[N_POINTS] = {
    24400u, 24200u, 24000u, 23800u, 23500u, 23200u, 22700u, 22300u, 21700u, 21100u, 20500u,
    19900u, 19200u, 18600u, 18000u, 17400u, 16800u, 16300u, 15900u, 15500u, 15100u, 14800u,
    14500u, 14300u, 14000u, 13800u, 13700u, 13500u, 13400u, 13300u, 13200u, 13100u, 13000u,
};

uint16_t vw_slaves_measured_cells(const vw_slaves_t *slaves, uint8_t pack)
{
    unsigned sound = 0u, cell;
    if (pack >= VW_N_PACKS || slaves->failures[pack] != 0u) {
        return 0u;
    }
    for (cell = 0; cell < VW_LTC_CELLS; cell++) {
        if (slaves->slave[pack].cvr[cell] != VW_LTC_MISSING) {
            sound |= 1u << cell;
        }
    }
    return (uint16_t)(sound & ~(unsigned)slaves->open_wires[pack]);
}

uint16_t vw_slaves_valid_cells(const vw_slaves_t *slaves, uint8_t pack)
{
    bool is_silent = pack >= VW_N_PACKS || slaves->is_silent[pack];
    return is_silent ? 0u : vw_slaves_measured_cells(slaves, pack);
}

int8_t vw_slaves_cell_degc(const vw_slaves_t *slaves, uint8_t pack, uint8_t cell)
{
    uint8_t input;
    if (pack >= VW_N_PACKS || cell >= VW_LTC_CELLS || slaves->is_silent[pack]) {
        return VW_T_MISSING;
    }
    input = slaves->sensor_inputs[cell];
    if (((slaves->open_wires[pack] >> input) & 1u) != 0u) {
        return VW_T_MISSING; /* it floats between the sensor and the next cell */
    }
    return vw_slaves_sensor_degc(slaves->slave[pack].temp[input + VW_LTC_CELLS * (input % 2u)]);
}

int8_t vw_slaves_sensor_degc(uint16_t count)
{
    size_t i = 1u;
    int32_t above, width, degc, fives;
    if (count > points[0] + MARGIN_COUNTS || count < points[N_POINTS - 1u] - MARGIN_COUNTS) {
        return VW_T_MISSING;
    }
    if (count >= points[0]) {
        return FIRST_DEGC;
    }
    if (count <= points[N_POINTS - 1u]) {
        return (int8_t)(FIRST_DEGC + STEP_DEGC * (int)(N_POINTS - 1u));
    }
    while (count < points[i]) {
        i++;
    }
    above = (int32_t)points[i - 1u] - (int32_t)count;
    width = (int32_t)points[i - 1u] - (int32_t)points[i];
    degc = FIRST_DEGC + STEP_DEGC * ((int32_t)i - 1);
    fives = 2 * STEP_DEGC * above; /* twice the degrees above it, times the width */
    degc += fives / (2 * width);
    if (fives % (2 * width) > width || (fives % (2 * width) == width && degc % 2 != 0)) {
        degc++; /* to the nearest, halves to the even one */
    }
    return (int8_t)degc;
}
