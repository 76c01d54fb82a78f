/* The AT24C256 as a file, for a master on a PC: pages, write time, and the power cut that tears a page. */
#ifndef EEPROM_FILE_H
#define EEPROM_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "../generated/voltwall_protocol.h"

typedef struct {
    int file; /* -1: in memory only */
    uint8_t content[VW_EEPROM_SIZE];
    uint32_t page_ms;
    uint32_t busy_until_ms;
    uint32_t now_ms;
    bool is_worn;       /* takes no write any more */
    bool is_unplugged;  /* answers nothing */
    int32_t cut_after;  /* the power goes when so many more bytes have been written; -1 never */
    uint8_t cut_byte;   /* what the byte under way is left as */
    bool is_power_lost;
} eeprom_file_t;

/* Open the file, or create an erased one; NULL keeps the content in memory. The settings stay. False where it fails. */
bool eeprom_file_open(eeprom_file_t *eeprom, const char *path);

/* As vw_board_t wants them; the context is the eeprom_file_t. */
bool eeprom_file_read(void *context, uint16_t address, uint8_t *data, uint16_t length);
bool eeprom_file_write(void *context, uint16_t address, const uint8_t *data, uint16_t length);
bool eeprom_file_is_busy(void *context);

#endif
