/* The configuration in the EEPROM: two slots of which the newest valid one counts, and the journal of the charge.
 *
 * A store runs page by page while the firmware goes on; a power cut at any byte of it leaves the old configuration or
 * the new one. SPEC.md section 9.
 */
#ifndef VW_STORE_H
#define VW_STORE_H

#include "vw_board.h"

typedef enum {
    VW_STORE_IDLE,
    VW_STORE_BUSY,
    VW_STORE_DONE,  /* read back and equal; reported once */
    VW_STORE_FAILED /* reported once */
} vw_store_state_t;

typedef struct {
    const vw_board_t *board;
    uint8_t image[VW_CONFIG_SIZE]; /* what is being stored, or was read */
    uint32_t counter;
    uint32_t started_ms; /* the page under way */
    uint16_t slot_address;
    uint8_t step;
    uint8_t pages_left;
} vw_store_t;

void vw_store_init(vw_store_t *store, const vw_board_t *board);

/* Read the newest valid slot into `store->image`; with `must_pass` the newest whose image passes the check, as at the
 * start. DONE, NOTHING_STORED, EEPROM_FAILED where the bus fails, NOT_NOW while a store is under way.
 */
enum vw_result vw_store_read(vw_store_t *store, bool must_pass);

/* Begin to store a configuration. DONE: it is under way. NOT_NOW while one is; EEPROM_FAILED where the bus fails. */
enum vw_result vw_store_begin(vw_store_t *store, const uint8_t image[VW_CONFIG_SIZE], uint32_t now_ms);

/* Go on: at most one page is read and one write started. */
vw_store_state_t vw_store_run(vw_store_t *store, uint32_t now_ms);

bool vw_store_is_busy(const vw_store_t *store);

typedef struct {
    uint32_t counter; /* 0: none yet */
    uint32_t dod; /* 1 uAh */
    uint16_t soc;
} vw_journal_t;

/* The newest valid entry, counter 0 without one. Reads all 496 entries: at the start. */
void vw_journal_read(const vw_board_t *board, vw_journal_t *newest);

/* Start to write the next entry; `newest` becomes it. Not while the chip is busy. False: the bus failed. */
bool vw_journal_write(const vw_board_t *board, vw_journal_t *newest, uint32_t dod, uint16_t soc);

#endif
