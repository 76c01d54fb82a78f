/* The eight messages each way that the configuration describes: SPEC.md section 7. Knows the tables, no controller. */
#ifndef VW_CAN_H
#define VW_CAN_H

#include "vw_board.h"

typedef struct {
    uint32_t id;
    bool is_extended;
    uint8_t length;
    uint8_t data[VW_CAN_DATA_BYTES];
} vw_can_frame_t;

enum vw_charge { VW_CHARGE_UNCHANGED, VW_CHARGE_BEGIN, VW_CHARGE_END };

typedef struct {
    const vw_board_t *board;
    vw_master_t *master;
    uint32_t due_ms[VW_N_CAN_MESSAGES];
    uint32_t seen_ms[VW_N_CAN_MESSAGES];
    uint8_t tx_enabled; /* masks, one bit a message */
    uint8_t rx_enabled;
    uint8_t rx_active;
    uint8_t scheduled;  /* tx messages whose due_ms counts */
    uint8_t on_demand;
    uint8_t startup_tx; /* the masks of the configuration taken over last */
    uint8_t startup_rx;
    enum vw_charge charge; /* not taken yet */
} vw_can_t;

/* Take over the tables and the start-up masks of the configuration in force, at boot. */
void vw_can_init(vw_can_t *can, const vw_board_t *board, vw_master_t *master);

/* Take over changed tables: messages enabled or alive stay so, except where the start-up masks changed. */
void vw_can_reload(vw_can_t *can);

/* The next message to send now; false when none is due. Called until then whenever a mailbox is free. */
bool vw_can_next(vw_can_t *can, uint32_t now_ms, vw_can_frame_t *frame);

/* Store what was received where the table says. */
void vw_can_received(vw_can_t *can, uint32_t now_ms, const vw_can_frame_t *frame);

/* The next message that has been silent for too long: its index, VW_N_CAN_MESSAGES for none. It is marked, its answer
 * stopped.
 */
uint8_t vw_can_expire(vw_can_t *can, uint32_t now_ms);

/* Once each: a message to charge by was received, or went silent. Asked after vw_can_expire; the caller refuses what its
 * command CHARGE_START would.
 */
enum vw_charge vw_can_take_charge(vw_can_t *can);

/* Send exactly these from now on, or one of them once. */
void vw_can_enable(vw_can_t *can, uint8_t mask);
void vw_can_send_once(vw_can_t *can, uint8_t index);

#endif
