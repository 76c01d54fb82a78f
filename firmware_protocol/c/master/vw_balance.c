#include "vw_balance.h"

#include <string.h>

#include "../vw_time.h"

/* A cell is bled until it is within four fifths of the threshold. */
#define KEEP_NUMERATOR 4u
#define KEEP_DENOMINATOR 5u

void vw_balance_init(vw_balance_t *balance)
{
    (void)memset(balance, 0, sizeof *balance);
}

void vw_balance_stop(vw_balance_t *balance)
{
    vw_balance_init(balance);
}

static bool vw_balance_has_bleeding_cell(const vw_balance_t *balance)
{
    size_t pack;
    for (pack = 0; pack < VW_N_PACKS; pack++) {
        if (balance->cells[pack] != 0u) {
            return true;
        }
    }
    return false;
}

static uint16_t vw_balance_find_lowest_voltage(const uint16_t v[VW_N_CELLS])
{
    uint16_t lowest = 0xFFFFu;
    size_t cell;
    for (cell = 0; cell < VW_N_CELLS; cell++) {
        if (v[cell] != VW_V_MISSING && v[cell] < lowest) {
            lowest = v[cell];
        }
    }
    return lowest;
}

bool vw_balance_choose(vw_balance_t *balance, uint16_t threshold, const uint16_t v[VW_N_CELLS])
{
    uint16_t lowest = vw_balance_find_lowest_voltage(v);
    size_t cell;
    for (cell = 0; cell < VW_N_CELLS; cell++) {
        uint16_t *cells = &balance->cells[cell / VW_CELLS_PER_PACK];
        uint16_t bit = (uint16_t)(1u << (cell % VW_CELLS_PER_PACK));
        uint32_t excess = v[cell] == VW_V_MISSING ? 0u : (uint32_t)v[cell] - lowest;
        bool keeps = (*cells & bit) != 0u && KEEP_DENOMINATOR * excess > KEEP_NUMERATOR * (uint32_t)threshold;
        if (v[cell] != VW_V_MISSING && (excess > threshold || keeps)) {
            *cells = (uint16_t)(*cells | bit);
        } else {
            *cells = (uint16_t)(*cells & ~(unsigned)bit);
        }
    }
    balance->is_active = vw_balance_has_bleeding_cell(balance);
    return balance->is_active;
}

void vw_balance_set_manual(vw_balance_t *balance, uint8_t pack, uint16_t cells, uint32_t now_ms)
{
    if (!balance->is_by_hand) {
        vw_balance_stop(balance);
    }
    if (pack < VW_N_PACKS) {
        balance->cells[pack] = (uint16_t)(cells & ((1u << VW_CELLS_PER_PACK) - 1u));
    }
    balance->is_active = vw_balance_has_bleeding_cell(balance);
    balance->is_by_hand = balance->is_active;
    balance->by_hand_until_ms = now_ms + VW_BALANCE_BY_HAND_MS;
}

void vw_balance_end_manual(vw_balance_t *balance, uint16_t v_cell_min, const uint16_t v[VW_N_CELLS], uint32_t now_ms)
{
    size_t cell;
    if (!balance->is_by_hand) {
        return;
    }
    for (cell = 0; cell < VW_N_CELLS; cell++) {
        if (v[cell] <= v_cell_min) {
            uint16_t *cells = &balance->cells[cell / VW_CELLS_PER_PACK];
            *cells = (uint16_t)(*cells & ~(1u << (cell % VW_CELLS_PER_PACK)));
        }
    }
    balance->is_active = vw_balance_has_bleeding_cell(balance);
    if (!balance->is_active || vw_is_due(now_ms, balance->by_hand_until_ms)) {
        vw_balance_stop(balance);
    }
}
