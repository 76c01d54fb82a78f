/* Which cells to bleed: by rule, those further above the lowest than `balance_threshold`, until all are near it; or
 * those
 * that somebody chose by hand, for ten minutes at most. The slaves' switches are vw_slaves_configure()'s.
 */
#ifndef VW_BALANCE_H
#define VW_BALANCE_H

#include <stdbool.h>
#include <stdint.h>

#include "../generated/voltwall_protocol.h"

#define VW_BALANCE_BY_HAND_MS 600000u

typedef struct {
    uint16_t cells[VW_N_PACKS]; /* bit 0: first cell of the pack; as vw_slaves_configure() takes them */
    bool is_active; /* any of them */
    bool is_by_hand;
    uint32_t by_hand_until_ms;
} vw_balance_t;

void vw_balance_init(vw_balance_t *balance);

/* Choose by rule from voltages at rest, 0 where there is none [100 uV]. Whether any cell is bled. */
bool vw_balance_choose(vw_balance_t *balance, uint16_t threshold, const uint16_t v[VW_N_CELLS]);

/* Bleed these cells of a pack, and of the other packs what was chosen by hand before. */
void vw_balance_set_manual(vw_balance_t *balance, uint8_t pack, uint16_t cells, uint32_t now_ms);

/* End what was chosen by hand: after its time, and cell by cell at the lowest voltage allowed. Each pass. */
void vw_balance_end_manual(vw_balance_t *balance, uint16_t v_cell_min, const uint16_t v[VW_N_CELLS], uint32_t now_ms);

void vw_balance_stop(vw_balance_t *balance);

#endif
