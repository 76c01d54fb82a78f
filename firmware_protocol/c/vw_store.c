#include "vw_store.h"

#include <string.h>

#include "vw_bytes.h"
#include "vw_codec.h"
#include "vw_config.h"
#include "vw_time.h"

#define N_IMAGE_PAGES ((VW_CONFIG_SIZE + VW_EEPROM_PAGE_SIZE - 1u) / VW_EEPROM_PAGE_SIZE)
#define PAGE_TIMEOUT_MS 50u /* ten times what the data sheet allows for a page */
#define JOURNAL_SIZE 20u
#define JOURNAL_CRC_AT 16u
#define FIRST_JOURNAL_CRC_AT 12u

/* Steps of a store, in this order. */
#define STEP_IDLE 0u
#define STEP_INVALIDATE 1u
#define STEP_IMAGE 2u /* N_IMAGE_PAGES of them */
#define STEP_HEADER (STEP_IMAGE + N_IMAGE_PAGES)
#define STEP_VERIFY (STEP_HEADER + 1u) /* one for the header, N_IMAGE_PAGES for the image */
#define STEP_END (STEP_VERIFY + 1u + N_IMAGE_PAGES)

void vw_store_init(vw_store_t *store, const vw_board_t *board)
{
    (void)memset(store, 0, sizeof *store);
    store->board = board;
}

bool vw_store_is_busy(const vw_store_t *store)
{
    return store->step != STEP_IDLE;
}

/* -- reading ------------------------------------------------------------------------------------------------------- */

/* Gets the slot's counter, 0 where it is not valid; its image goes into `image`. False: the bus failed. */
static bool vw_store_read_slot(const vw_board_t *board, uint16_t slot, uint8_t image[VW_CONFIG_SIZE], uint32_t *counter)
{
    uint8_t header[VW_SLOT_HEADER_SIZE];
    uint16_t address = (uint16_t)(slot * VW_EEPROM_SLOT_SIZE);
    if (!board->eeprom_read(board->context, address, header, (uint16_t)sizeof header)
        || !board->eeprom_read(board->context, (uint16_t)(address + VW_EEPROM_PAGE_SIZE), image, VW_CONFIG_SIZE)) {
        return false;
    }
    *counter = vw_slot_counter(header, image);
    if (*counter != 0u) {
        vw_slot_to_present(header, image);
    }
    return true;
}

static bool vw_store_is_chip_busy(const vw_board_t *board)
{
    return board->eeprom_is_busy(board->context);
}

enum vw_result vw_store_read(vw_store_t *store, bool must_pass)
{
    uint32_t counters[2] = { 0u, 0u };
    uint16_t tries, slot;
    if (vw_store_is_busy(store) || vw_store_is_chip_busy(store->board)) {
        return VW_RESULT_NOT_NOW;
    }
    for (slot = 0u; slot < 2u; slot++) {
        if (!vw_store_read_slot(store->board, slot, store->image, &counters[slot])) {
            return VW_RESULT_EEPROM_FAILED;
        }
    }
    for (tries = 0u; tries < 2u; tries++) {
        slot = counters[1] > counters[0] ? 1u : 0u;
        if (counters[slot] == 0u) {
            break;
        }
        if (!vw_store_read_slot(store->board, slot, store->image, &counters[slot]) || counters[slot] == 0u) {
            return VW_RESULT_EEPROM_FAILED;
        }
        if (!must_pass || vw_config_check(store->image) == VW_NO_OFFSET) {
            return VW_RESULT_DONE;
        }
        counters[slot] = 0u;
    }
    return VW_RESULT_NOTHING_STORED;
}

/* -- storing ------------------------------------------------------------------------------------------------------- */

enum vw_result vw_store_begin(vw_store_t *store, const uint8_t image[VW_CONFIG_SIZE], uint32_t now_ms)
{
    uint32_t counters[2] = { 0u, 0u };
    uint16_t slot;
    if (vw_store_is_busy(store) || vw_store_is_chip_busy(store->board)) {
        return VW_RESULT_NOT_NOW;
    }
    for (slot = 0u; slot < 2u; slot++) {
        if (!vw_store_read_slot(store->board, slot, store->image, &counters[slot])) {
            return VW_RESULT_EEPROM_FAILED;
        }
    }
    slot = counters[0] != 0u && counters[0] >= counters[1] ? 1u : 0u;
    if (counters[1u - slot] == UINT32_MAX) {
        return VW_RESULT_EEPROM_FAILED;
    }
    store->slot_address = (uint16_t)(slot * VW_EEPROM_SLOT_SIZE);
    store->counter = counters[1u - slot] + 1u;
    (void)memcpy(store->image, image, VW_CONFIG_SIZE);
    vw_config_clear_padding(store->image);
    store->step = STEP_INVALIDATE;
    store->started_ms = now_ms;
    return VW_RESULT_DONE;
}

/* Page 0 of the slot is its header, the others its image; what is left of a page is 0. */
static void vw_store_fill_page(const vw_store_t *store, uint8_t page, uint8_t out[VW_EEPROM_PAGE_SIZE])
{
    (void)memset(out, 0, VW_EEPROM_PAGE_SIZE);
    if (page == 0u) {
        vw_slot_header(out, store->image, store->counter);
    } else {
        size_t at = (page - 1u) * VW_EEPROM_PAGE_SIZE;
        size_t left = VW_CONFIG_SIZE - at;
        (void)memcpy(out, store->image + at, left < VW_EEPROM_PAGE_SIZE ? left : VW_EEPROM_PAGE_SIZE);
    }
}

static uint16_t vw_store_page_address(const vw_store_t *store, uint8_t page)
{
    return (uint16_t)(store->slot_address + page * VW_EEPROM_PAGE_SIZE);
}

static bool vw_store_compare_page(const vw_store_t *store, uint8_t page, bool *same)
{
    uint8_t wanted[VW_EEPROM_PAGE_SIZE], held[VW_EEPROM_PAGE_SIZE];
    const vw_board_t *board = store->board;
    vw_store_fill_page(store, page, wanted);
    if (!board->eeprom_read(board->context, vw_store_page_address(store, page), held, (uint16_t)sizeof held)) {
        return false;
    }
    *same = memcmp(wanted, held, sizeof held) == 0;
    return true;
}

static bool vw_store_write_page(const vw_store_t *store, uint8_t page, bool zeros)
{
    uint8_t data[VW_EEPROM_PAGE_SIZE];
    const vw_board_t *board = store->board;
    vw_store_fill_page(store, page, data);
    if (zeros) {
        (void)memset(data, 0, sizeof data);
    }
    return board->eeprom_write(board->context, vw_store_page_address(store, page), data, (uint16_t)sizeof data);
}

/* Carry out one step; false where the bus fails or the chip does not hold what it should. */
static bool vw_store_run_step(const vw_store_t *store)
{
    bool same = false;
    if (store->step == STEP_INVALIDATE) {
        return vw_store_write_page(store, 0u, true);
    }
    if (store->step < STEP_HEADER) {
        uint8_t page = (uint8_t)(store->step - STEP_IMAGE + 1u);
        return vw_store_compare_page(store, page, &same) && (same || vw_store_write_page(store, page, false));
    }
    if (store->step == STEP_HEADER) {
        return vw_store_write_page(store, 0u, false);
    }
    return vw_store_compare_page(store, (uint8_t)(store->step - STEP_VERIFY), &same) && same;
}

vw_store_state_t vw_store_run(vw_store_t *store, uint32_t now_ms)
{
    if (!vw_store_is_busy(store)) {
        return VW_STORE_IDLE;
    }
    if (vw_store_is_chip_busy(store->board)) {
        if (!vw_is_due(now_ms, store->started_ms + PAGE_TIMEOUT_MS)) {
            return VW_STORE_BUSY;
        }
        store->step = STEP_IDLE;
        return VW_STORE_FAILED;
    }
    if (!vw_store_run_step(store)) {
        store->step = STEP_IDLE;
        return VW_STORE_FAILED;
    }
    store->started_ms = now_ms;
    store->step++;
    if (store->step < STEP_END) {
        return VW_STORE_BUSY;
    }
    store->step = STEP_IDLE;
    return VW_STORE_DONE;
}

/* -- journal ------------------------------------------------------------------------------------------------------- */

static bool vw_store_is_entry_valid(const uint8_t *entry, size_t length)
{
    return vw_get_u32(entry + length) == ~vw_crc32_update(VW_CRC32_START, entry, length);
}

/* Of layout 1 the last two bytes of the entry's 12 are 0, and its charge counts 1 mA s: 18/5 of them are 1 uAh. */
static bool vw_store_read_entry(const uint8_t entry[JOURNAL_SIZE], vw_journal_t *found)
{
    uint16_t layout = vw_get_u16(entry + 10);
    found->counter = vw_get_u32(entry);
    found->dod = vw_get_u32(entry + 4);
    found->soc = vw_get_u16(entry + 8);
    if (layout == VW_EEPROM_LAYOUT_VERSION) {
        return vw_store_is_entry_valid(entry, JOURNAL_CRC_AT);
    }
    found->dod = (uint32_t)(((uint64_t)found->dod * 5u + 9u) / 18u);
    return layout == 0u && vw_store_is_entry_valid(entry, FIRST_JOURNAL_CRC_AT);
}

void vw_journal_read(const vw_board_t *board, vw_journal_t *newest)
{
    uint8_t entry[JOURNAL_SIZE];
    vw_journal_t found;
    uint16_t page;
    (void)memset(newest, 0, sizeof *newest);
    for (page = 0u; page < VW_EEPROM_JOURNAL_PAGES; page++) {
        uint16_t address = (uint16_t)(VW_EEPROM_JOURNAL_OFFSET + page * VW_EEPROM_PAGE_SIZE);
        if (board->eeprom_read(board->context, address, entry, (uint16_t)sizeof entry)
            && vw_get_u32(entry) > newest->counter && vw_store_read_entry(entry, &found)) {
            *newest = found;
        }
    }
}

bool vw_journal_write(const vw_board_t *board, vw_journal_t *newest, uint32_t dod, uint16_t soc)
{
    uint8_t entry[JOURNAL_SIZE];
    uint32_t page = newest->counter % VW_EEPROM_JOURNAL_PAGES;
    uint16_t address = (uint16_t)(VW_EEPROM_JOURNAL_OFFSET + page * VW_EEPROM_PAGE_SIZE);
    (void)memset(entry, 0, sizeof entry);
    newest->counter++;
    newest->dod = dod;
    newest->soc = soc;
    vw_put_u32(entry, newest->counter);
    vw_put_u32(entry + 4, dod);
    vw_put_u16(entry + 8, soc);
    vw_put_u16(entry + 10, VW_EEPROM_LAYOUT_VERSION);
    vw_put_u32(entry + JOURNAL_CRC_AT, ~vw_crc32_update(VW_CRC32_START, entry, JOURNAL_CRC_AT));
    return board->eeprom_write(board->context, address, entry, (uint16_t)sizeof entry);
}
