#include "vw_stm32f4.h"

#include "main.h" /* CubeMX's: the HAL and the handles below */

#define UART huart1
#define I2C hi2c1
#define CAN hcan1
#define EEPROM_ADDRESS 0xA0u
#define I2C_TIMEOUT_MS 25u /* a READ of 507 bytes takes 12 ms at 400 kHz */
#define RING_SIZE 1024u    /* 90 ms of line */
#define MAX_EXTENDED_ID 0x1FFFFFFFu

extern UART_HandleTypeDef UART;
extern I2C_HandleTypeDef I2C;
extern CAN_HandleTypeDef CAN;

vw_master_t vw_memory;
vw_link_t vw_line;
vw_can_t vw_can;

static vw_board_t board;
static uint8_t ring[RING_SIZE];
static uint32_t ring_read;
static uint8_t frame[VW_MAX_FRAME]; /* belongs to the DMA until the UART is ready again */
static uint32_t saved_primask;
static void (*your_config_changed)(void *context);
static uint8_t active_prescaler;

static void vw_stm32f4_lock(void *context)
{
    (void)context;
    saved_primask = __get_PRIMASK();
    __disable_irq();
}

static void vw_stm32f4_unlock(void *context)
{
    (void)context;
    __set_PRIMASK(saved_primask);
}

static void vw_stm32f4_restart(void *context)
{
    (void)context;
    NVIC_SystemReset();
}

/* -- EEPROM -------------------------------------------------------------------------------------------------------- */

static bool vw_stm32f4_read_eeprom(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    return HAL_I2C_Mem_Read(&I2C, EEPROM_ADDRESS, address, I2C_MEMADD_SIZE_16BIT, data, length, I2C_TIMEOUT_MS) == HAL_OK;
}

static bool vw_stm32f4_write_eeprom(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    uint8_t page[VW_EEPROM_PAGE_SIZE]; /* the HAL takes no const */
    uint16_t i;
    (void)context;
    for (i = 0u; i < length && i < VW_EEPROM_PAGE_SIZE; i++) {
        page[i] = data[i];
    }
    return HAL_I2C_Mem_Write(&I2C, EEPROM_ADDRESS, address, I2C_MEMADD_SIZE_16BIT, page, length, I2C_TIMEOUT_MS) == HAL_OK;
}

/* While it writes a page the chip does not acknowledge its address. */
static bool vw_stm32f4_is_eeprom_busy(void *context)
{
    (void)context;
    return HAL_I2C_IsDeviceReady(&I2C, EEPROM_ADDRESS, 1u, 2u) != HAL_OK;
}

/* -- CAN ----------------------------------------------------------------------------------------------------------- */

/* What a filter compares: bits 31..3 the id, bit 2 its kind. */
static uint32_t vw_stm32f4_make_filter_word(uint32_t id)
{
    return (id & VW_CAN_ID_EXTENDED) != 0u ? ((id & MAX_EXTENDED_ID) << 3) | CAN_ID_EXT : id << 21;
}

/* Two ids a bank; a message that is not listened for repeats one that is. */
static void vw_stm32f4_set_filters(void)
{
    const vw_config_t *conf = &vw_memory.conf;
    uint32_t bank;
    for (bank = 0u; bank < VW_N_CAN_MESSAGES / 2u; bank++) {
        CAN_FilterTypeDef filter = { 0 };
        uint32_t first = 2u * bank, second = first + 1u;
        bool has_first = (vw_can.rx_enabled & (1u << first)) != 0u;
        bool has_second = (vw_can.rx_enabled & (1u << second)) != 0u;
        uint32_t word_1 = vw_stm32f4_make_filter_word(conf->can_rx_msg_id[has_first ? first : second]);
        uint32_t word_2 = vw_stm32f4_make_filter_word(conf->can_rx_msg_id[has_second ? second : first]);
        filter.FilterIdHigh = word_1 >> 16;
        filter.FilterIdLow = word_1 & 0xFFFFu;
        filter.FilterMaskIdHigh = word_2 >> 16;
        filter.FilterMaskIdLow = word_2 & 0xFFFFu;
        filter.FilterFIFOAssignment = CAN_FILTER_FIFO0;
        filter.FilterBank = bank;
        filter.FilterMode = CAN_FILTERMODE_IDLIST;
        filter.FilterScale = CAN_FILTERSCALE_32BIT;
        filter.FilterActivation = has_first || has_second ? CAN_FILTER_ENABLE : CAN_FILTER_DISABLE;
        filter.SlaveStartFilterBank = 14u;
        (void)HAL_CAN_ConfigFilter(&CAN, &filter);
    }
}

static void vw_stm32f4_configure_can(void)
{
    if (vw_memory.conf.can_brp != active_prescaler) {
        active_prescaler = vw_memory.conf.can_brp;
        (void)HAL_CAN_Stop(&CAN);
        CAN.Init.Prescaler = (uint32_t)active_prescaler + 1u;
        (void)HAL_CAN_Init(&CAN);
    }
    vw_stm32f4_set_filters();
    (void)HAL_CAN_Start(&CAN);
}

static void vw_stm32f4_apply_config(void *context)
{
    vw_stm32f4_configure_can();
    if (your_config_changed != NULL) {
        your_config_changed(context);
    }
}

static void vw_stm32f4_run_can(uint32_t now_ms)
{
    vw_can_frame_t message;
    while (HAL_CAN_GetRxFifoFillLevel(&CAN, CAN_RX_FIFO0) != 0u) {
        CAN_RxHeaderTypeDef header;
        if (HAL_CAN_GetRxMessage(&CAN, CAN_RX_FIFO0, &header, message.data) != HAL_OK) {
            break;
        }
        message.is_extended = header.IDE == CAN_ID_EXT;
        message.id = message.is_extended ? header.ExtId : header.StdId;
        message.length = (uint8_t)header.DLC;
        if (header.RTR == CAN_RTR_DATA) {
            vw_can_received(&vw_can, now_ms, &message);
        }
    }
    while (HAL_CAN_GetTxMailboxesFreeLevel(&CAN) != 0u && vw_can_next(&vw_can, now_ms, &message)) {
        CAN_TxHeaderTypeDef header = { 0 };
        uint32_t mailbox;
        header.StdId = message.is_extended ? 0u : message.id;
        header.ExtId = message.is_extended ? message.id : 0u;
        header.IDE = message.is_extended ? CAN_ID_EXT : CAN_ID_STD;
        header.RTR = CAN_RTR_DATA;
        header.DLC = message.length;
        (void)HAL_CAN_AddTxMessage(&CAN, &header, message.data, &mailbox);
    }
}

/* -- RS232 --------------------------------------------------------------------------------------------------------- */

/* The DMA writes round the ring; a parity error ends it in the HAL, so it is started again. */
static void vw_stm32f4_run_receiver(uint32_t now_ms)
{
    uint32_t written;
    if (UART.RxState == HAL_UART_STATE_READY) {
        ring_read = 0u;
        (void)HAL_UART_Receive_DMA(&UART, ring, RING_SIZE);
    }
    written = RING_SIZE - __HAL_DMA_GET_COUNTER(UART.hdmarx);
    if (written < ring_read) {
        vw_link_received(&vw_line, now_ms, ring + ring_read, RING_SIZE - ring_read);
        ring_read = 0u;
    }
    if (written > ring_read && written <= RING_SIZE) {
        vw_link_received(&vw_line, now_ms, ring + ring_read, written - ring_read);
        ring_read = written == RING_SIZE ? 0u : written;
    }
}

static void vw_stm32f4_run_transmitter(uint32_t now_ms)
{
    size_t length;
    if (UART.gState != HAL_UART_STATE_READY) {
        return;
    }
    length = vw_link_next(&vw_line, now_ms, frame);
    if (length != 0u) {
        (void)HAL_UART_Transmit_DMA(&UART, frame, (uint16_t)length);
    }
}

static uint8_t vw_stm32f4_read_reset_cause(void)
{
    uint8_t cause = 0u;
    if (__HAL_RCC_GET_FLAG(RCC_FLAG_IWDGRST) || __HAL_RCC_GET_FLAG(RCC_FLAG_WWDGRST)) {
        cause = 1u;
    } else if (__HAL_RCC_GET_FLAG(RCC_FLAG_SFTRST)) {
        cause = 3u;
    } else if (!__HAL_RCC_GET_FLAG(RCC_FLAG_PORRST) && __HAL_RCC_GET_FLAG(RCC_FLAG_BORRST)) {
        cause = 2u;
    } else {
        /* power on, or the reset pin */
    }
    __HAL_RCC_CLEAR_RESET_FLAGS();
    return cause;
}

void vw_stm32f4_init(const vw_board_t *yours, const uint8_t firmware[3])
{
    vw_ident_t ident = { 0 };
    board = *yours;
    your_config_changed = yours->config_changed;
    board.lock = vw_stm32f4_lock;
    board.unlock = vw_stm32f4_unlock;
    board.config_changed = vw_stm32f4_apply_config;
    board.eeprom_read = vw_stm32f4_read_eeprom;
    board.eeprom_write = vw_stm32f4_write_eeprom;
    board.eeprom_is_busy = vw_stm32f4_is_eeprom_busy;
    board.restart = vw_stm32f4_restart;
    ident.firmware[0] = firmware[0];
    ident.firmware[1] = firmware[1];
    ident.firmware[2] = firmware[2];
    ident.reset_cause = vw_stm32f4_read_reset_cause();
    vw_link_init(&vw_line, &board, &vw_memory, &vw_can, &ident);
    active_prescaler = (uint8_t)~vw_memory.conf.can_brp;
    vw_stm32f4_configure_can();
}

void vw_stm32f4_run(void)
{
    uint32_t now_ms = HAL_GetTick();
    vw_stm32f4_run_receiver(now_ms);
    vw_link_run(&vw_line, now_ms);
    vw_stm32f4_run_transmitter(now_ms);
    vw_stm32f4_run_can(now_ms);
}
