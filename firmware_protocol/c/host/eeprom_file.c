#define _POSIX_C_SOURCE 200809L
#include "eeprom_file.h"

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "../vw_time.h"

#define ERASED 0xFF

bool eeprom_file_open(eeprom_file_t *eeprom, const char *path)
{
    ssize_t length;
    memset(eeprom->content, ERASED, sizeof eeprom->content);
    eeprom->file = -1;
    if (path == NULL) {
        return true;
    }
    eeprom->file = open(path, O_RDWR | O_CREAT, 0644);
    if (eeprom->file < 0) {
        return false;
    }
    length = pread(eeprom->file, eeprom->content, sizeof eeprom->content, 0);
    return length >= 0 && pwrite(eeprom->file, eeprom->content, sizeof eeprom->content, 0)
                              == (ssize_t)sizeof eeprom->content;
}

bool eeprom_file_read(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    const eeprom_file_t *eeprom = context;
    if (eeprom->is_unplugged || (uint32_t)address + length > VW_EEPROM_SIZE) {
        return false;
    }
    memcpy(data, eeprom->content + address, length);
    return true;
}

/* A page write may stop after any byte, and the byte under way then holds anything. */
static uint16_t survived(eeprom_file_t *eeprom, uint16_t length)
{
    if (eeprom->cut_after < 0) {
        return length;
    }
    if (eeprom->cut_after >= length) {
        eeprom->cut_after -= length;
        return length;
    }
    eeprom->is_power_lost = true;
    return (uint16_t)eeprom->cut_after;
}

bool eeprom_file_write(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    eeprom_file_t *eeprom = context;
    uint16_t n;
    if (eeprom->is_unplugged || address % VW_EEPROM_PAGE_SIZE + length > VW_EEPROM_PAGE_SIZE
        || eeprom_file_is_busy(eeprom)) {
        return false;
    }
    eeprom->busy_until_ms = eeprom->now_ms + eeprom->page_ms;
    if (eeprom->is_worn || eeprom->is_power_lost) {
        return true;
    }
    n = survived(eeprom, length);
    memcpy(eeprom->content + address, data, n);
    if (n < length) {
        eeprom->content[address + n] = eeprom->cut_byte;
        n++;
    }
    return eeprom->file < 0 || pwrite(eeprom->file, eeprom->content + address, n, address) == n;
}

bool eeprom_file_is_busy(void *context)
{
    const eeprom_file_t *eeprom = context;
    return eeprom->page_ms != 0u && !vw_is_due(eeprom->now_ms, eeprom->busy_until_ms);
}
