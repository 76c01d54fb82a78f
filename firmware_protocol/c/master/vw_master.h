/* The master: one step for each measurement puts protection, charging, balancing, relays, fans and the charge count
 * together with the library of this folder's parent. A reference to compare yours with, not a certified part.
 *
 * After vw_link_init: vw_master_init. After each measurement of the cells, every 20 ms: vw_master_step, then set what
 * it
 * decided: the OK signal (`protection.is_open`), the relays (`relays.state`), the fans (`charger.fan_duty` of the
 * struct)
 * and the slaves' switches (`balance.cells`). The commands of vw_board_t call vw_master_command.
 */
#ifndef VW_MASTER_H
#define VW_MASTER_H

#include "../vw_link.h"
#include "vw_balance.h"
#include "vw_charging.h"
#include "vw_fans.h"
#include "vw_protection.h"
#include "vw_relays.h"
#include "vw_soc_counter.h"

#define VW_NO_CHARGER 0xFFu /* in `status.charger_status` */

/* What is measured and asked in a pass; the rest of the measurement stands in the struct. */
typedef struct {
    vw_reading_t reading; /* its `is_charging` is filled in */
    const int32_t *means; /* of the current, that this pass has completed: `conf.ts` samples each [10 mA] */
    uint8_t n_means;
    bool is_ready; /* the measurement has settled: protection judges */
    bool is_drive_asked;
    bool is_shutdown_closed; /* the rest of the circuit: buttons, insulation monitor, interlocks */
    uint16_t link_permille; /* the vehicle's voltage over the accumulator's */
    uint32_t hardware; /* which of VW_STATUS_USB, VW_STATUS_I2C1, VW_STATUS_CAN1 work */
} vw_inputs_t;

typedef struct {
    vw_link_t *link;
    vw_master_t *memory;
    vw_can_t *can;
    vw_protection_t protection;
    vw_balance_t balance;
    vw_charging_t charging;
    vw_relays_t relays;
    vw_fans_t fans;
    vw_soc_counter_t counter;
    vw_journal_t journal;
    uint32_t journal_ms; /* when the count is looked at next */
    uint32_t now_ms;
    int32_t i_fc;
    bool is_soc_estimated; /* `soc` is written by somebody else: the estimator */
    bool is_ready;
    bool is_drive_asked;
    bool is_balance_asked;
    bool has_new_cells; /* write the slaves' switches now; cleared by who does it */
} vw_master_task_t;

/* `is_open`: how the latch stands. The count goes on from the journal, except after power on (`link`'s reset cause). */
void vw_master_init(vw_master_task_t *task, vw_link_t *link, bool is_open, uint32_t now_ms);

void vw_master_step(vw_master_task_t *task, const vw_inputs_t *inputs, uint32_t now_ms);

/* Relays are open and nothing is charged: any field may change. For vw_board_t. */
bool vw_master_may_configure(const vw_master_task_t *task);

/* A command with a checked argument: VW_RESULT_DONE or VW_RESULT_NOT_NOW. */
enum vw_result vw_master_command(vw_master_task_t *task, uint8_t command, int32_t argument);

/* Within the master: tell of the charging's state where it is another one now. */
void vw_master_send_charging_event(vw_master_task_t *task, bool has_changed);

#endif
