/* What the firmware gives the library: its clock-free functions, each called with the `context` the firmware chose.
 *
 * All vw_ functions that take a vw_board_t are called from one context (the main loop, or one task). None of them
 * waits; only eeprom_read takes the time of its bus transfer.
 */
#ifndef VW_BOARD_H
#define VW_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "generated/voltwall_protocol.h"

/* One function for each named command, by its name in SPEC.md section 6; NULL refuses it as unknown. The argument has
 * been checked against its range. Return VW_RESULT_DONE, or VW_RESULT_NOT_NOW where the car's state forbids it.
 */
#define VW_COMMAND_MEMBER(name, code, low, high) enum vw_result (*name)(void *context, int32_t argument);
typedef struct {
    VW_COMMANDS(VW_COMMAND_MEMBER)
} vw_commands_t;

typedef struct {
    void *context;

    /* Keep whoever else writes the struct out for a few microseconds: at most 510 bytes are copied in between. NULL
     * where nobody else does.
     */
    void (*lock)(void *context);
    void (*unlock)(void *context);

    /* Whether a STORE, a LOAD, or a WRITE of what is not live may be done now; NULL allows it always. */
    bool (*may_configure)(void *context);

    /* The configuration in force, `conf` of the struct, is another one now. May be NULL. */
    void (*config_changed)(void *context);

    /* The EEPROM; an address is 0..32767, a write stays within one page of 64 bytes. `eeprom_write` only starts the
     * page, `eeprom_is_busy` says whether the chip is still at it. False: the bus failed.
     */
    bool (*eeprom_read)(void *context, uint16_t address, uint8_t *data, uint16_t length);
    bool (*eeprom_write)(void *context, uint16_t address, const uint8_t *data, uint16_t length);
    bool (*eeprom_is_busy)(void *context);

    /* The reply to a RESET has left: reset. NULL where `commands.reset` is. */
    void (*restart)(void *context);

    vw_commands_t commands;
} vw_board_t;

static inline void vw_lock(const vw_board_t *board)
{
    if (board->lock != NULL) {
        board->lock(board->context);
    }
}

static inline void vw_unlock(const vw_board_t *board)
{
    if (board->unlock != NULL) {
        board->unlock(board->context);
    }
}

#endif
