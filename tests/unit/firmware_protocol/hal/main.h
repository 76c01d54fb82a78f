/* The declarations of ST's HAL that the STM32F4 port uses, so that it compiles here. */
#ifndef MAIN_H
#define MAIN_H
#include <stdint.h>

typedef enum { HAL_OK, HAL_ERROR, HAL_BUSY, HAL_TIMEOUT } HAL_StatusTypeDef;
typedef enum { HAL_UART_STATE_READY = 0x20 } HAL_UART_StateTypeDef;
typedef struct {
    volatile uint32_t NDTR;
} DMA_Stream_TypeDef;
typedef struct {
    DMA_Stream_TypeDef *Instance;
} DMA_HandleTypeDef;
typedef struct {
    DMA_HandleTypeDef *hdmarx;
    volatile HAL_UART_StateTypeDef gState;
    volatile HAL_UART_StateTypeDef RxState;
} UART_HandleTypeDef;
typedef struct {
    int unused;
} I2C_HandleTypeDef;
typedef struct {
    uint32_t Prescaler;
} CAN_InitTypeDef;
typedef struct {
    CAN_InitTypeDef Init;
} CAN_HandleTypeDef;
typedef struct {
    uint32_t FilterIdHigh, FilterIdLow, FilterMaskIdHigh, FilterMaskIdLow, FilterFIFOAssignment, FilterBank;
    uint32_t FilterMode, FilterScale, FilterActivation, SlaveStartFilterBank;
} CAN_FilterTypeDef;
typedef struct {
    uint32_t StdId, ExtId, IDE, RTR, DLC;
    int TransmitGlobalTime;
} CAN_TxHeaderTypeDef;
typedef struct {
    uint32_t StdId, ExtId, IDE, RTR, DLC, Timestamp, FilterMatchIndex;
} CAN_RxHeaderTypeDef;

#define I2C_MEMADD_SIZE_16BIT 0x00000010U
#define CAN_ID_STD 0x00000000U
#define CAN_ID_EXT 0x00000004U
#define CAN_RTR_DATA 0x00000000U
#define CAN_RX_FIFO0 0x00000000U
#define CAN_FILTER_FIFO0 0x00000000U
#define CAN_FILTERMODE_IDLIST 0x00000001U
#define CAN_FILTERSCALE_32BIT 0x00000001U
#define CAN_FILTER_ENABLE 0x00000001U
#define CAN_FILTER_DISABLE 0x00000000U
#define RCC_FLAG_BORRST 0x79U
#define RCC_FLAG_PORRST 0x7BU
#define RCC_FLAG_SFTRST 0x7CU
#define RCC_FLAG_IWDGRST 0x7DU
#define RCC_FLAG_WWDGRST 0x7EU
#define __HAL_RCC_GET_FLAG(flag) rcc_flag(flag)
#define __HAL_RCC_CLEAR_RESET_FLAGS() rcc_clear()
#define __HAL_DMA_GET_COUNTER(handle) ((handle)->Instance->NDTR)

int rcc_flag(uint32_t flag);
void rcc_clear(void);
uint32_t __get_PRIMASK(void);
void __set_PRIMASK(uint32_t mask);
void __disable_irq(void);
void NVIC_SystemReset(void);
uint32_t HAL_GetTick(void);
HAL_StatusTypeDef HAL_UART_Receive_DMA(UART_HandleTypeDef *huart, uint8_t *data, uint16_t size);
HAL_StatusTypeDef HAL_UART_Transmit_DMA(UART_HandleTypeDef *huart, const uint8_t *data, uint16_t size);
HAL_StatusTypeDef HAL_I2C_Mem_Read(I2C_HandleTypeDef *hi2c, uint16_t device, uint16_t address, uint16_t address_size,
                                   uint8_t *data, uint16_t size, uint32_t timeout);
HAL_StatusTypeDef HAL_I2C_Mem_Write(I2C_HandleTypeDef *hi2c, uint16_t device, uint16_t address, uint16_t address_size,
                                    uint8_t *data, uint16_t size, uint32_t timeout);
HAL_StatusTypeDef HAL_I2C_IsDeviceReady(I2C_HandleTypeDef *hi2c, uint16_t device, uint32_t trials, uint32_t timeout);
HAL_StatusTypeDef HAL_CAN_Init(CAN_HandleTypeDef *hcan);
HAL_StatusTypeDef HAL_CAN_Start(CAN_HandleTypeDef *hcan);
HAL_StatusTypeDef HAL_CAN_Stop(CAN_HandleTypeDef *hcan);
HAL_StatusTypeDef HAL_CAN_ConfigFilter(CAN_HandleTypeDef *hcan, const CAN_FilterTypeDef *filter);
uint32_t HAL_CAN_GetRxFifoFillLevel(const CAN_HandleTypeDef *hcan, uint32_t fifo);
HAL_StatusTypeDef HAL_CAN_GetRxMessage(CAN_HandleTypeDef *hcan, uint32_t fifo, CAN_RxHeaderTypeDef *header,
                                       uint8_t data[]);
uint32_t HAL_CAN_GetTxMailboxesFreeLevel(const CAN_HandleTypeDef *hcan);
HAL_StatusTypeDef HAL_CAN_AddTxMessage(CAN_HandleTypeDef *hcan, const CAN_TxHeaderTypeDef *header,
                                       const uint8_t data[], uint32_t *mailbox);
#endif
