/* The library on an STM32F4 with ST's HAL: UART by DMA, AT24C256 on I2C, bxCAN. Call vw_stm32f4_init after CubeMX's MX_
 * functions and vw_stm32f4_run from the main loop, at least once a millisecond.
 */
#ifndef VW_STM32F4_H
#define VW_STM32F4_H

#include "../vw_link.h"

extern vw_master_t vw_memory; /* the struct: measurements go in here */
extern vw_link_t vw_line;     /* for vw_link_event */
extern vw_can_t vw_can;       /* for the commands CAN_TX_ENABLE and CAN_SEND */

/* `commands`, and from the rest `may_configure` and `vw_stm32f4_apply_config`, are yours. */
void vw_stm32f4_init(const vw_board_t *yours, const uint8_t firmware[3]);
void vw_stm32f4_run(void);

#endif
