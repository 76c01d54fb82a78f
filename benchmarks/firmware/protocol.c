/* Counts instructions of the protocol's library on an emulated STM32F4. */
#include "bare_metal.h"
#include "vw_config.h"
#include "vw_link.h"

static uint8_t content[VW_EEPROM_SIZE];

static bool eeprom_read(void *context, uint16_t address, uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(data, content + address, length);
    return true;
}

static bool eeprom_write(void *context, uint16_t address, const uint8_t *data, uint16_t length)
{
    (void)context;
    memcpy(content + address, data, length);
    return true;
}

static bool eeprom_is_busy(void *context)
{
    (void)context;
    return false;
}

static const vw_board_t board = {
    .eeprom_read = eeprom_read, .eeprom_write = eeprom_write, .eeprom_is_busy = eeprom_is_busy
};
static vw_master_t memory;
static vw_link_t line;
static vw_can_t can;
static uint8_t frame[VW_MAX_FRAME], body[VW_MAX_BODY];

static size_t request(uint8_t type, uint8_t sequence, size_t length)
{
    return vw_frame_encode(type, sequence, 0u, body, length, frame, sizeof frame);
}

int main(void)
{
    static const vw_ident_t ident = { .firmware = { 1u, 0u, 0u } };
    vw_can_frame_t message = { .id = 0x18FF50E5u, .is_extended = true, .length = 8u };
    size_t n;
    int i;
    memset(content, 0xFF, sizeof content);
    calibrate();
    print_number("size of vw_link_t", sizeof line);
    print_number("size of vw_can_t", sizeof can);
    MEASURE("vw_link_init", vw_link_init(&line, &board, &memory, &can, &ident));
    MEASURE("vw_config_check", (void)vw_config_check((const uint8_t *)&memory.conf));
    vw_link_received(&line, 0u, (const uint8_t *)"x", 1u);
    (void)vw_link_next(&line, 0u, frame); /* BOOT */
    (void)vw_link_next(&line, 0u, frame); /* EEPROM_INVALID */
    MEASURE("vw_link_next (fast frame, 370 bytes)", n = vw_link_next(&line, 0u, frame));
    MEASURE("vw_link_next (slow piece, 200 bytes)", n = vw_link_next(&line, 36u, frame));
    MEASURE("vw_link_next (nothing due)", n = vw_link_next(&line, 99u, frame));
    MEASURE("vw_link_run (nothing to do)", vw_link_run(&line, 99u));
    memcpy(body + 4, &memory.conf, VW_CONFIG_SIZE);
    body[0] = body[1] = 0u;
    body[2] = VW_CONFIG_SIZE & 0xFFu;
    body[3] = VW_CONFIG_SIZE >> 8;
    n = request(VW_MSG_WRITE, 1u, VW_CONFIG_SIZE + 4u);
    MEASURE("vw_link_received (WRITE of 420 bytes)", vw_link_received(&line, 100u, frame, n));
    (void)vw_link_next(&line, 100u, frame);
    (void)vw_link_next(&line, 100u, frame);
    body[2] = VW_MAX_READ & 0xFFu;
    body[3] = VW_MAX_READ >> 8;
    n = request(VW_MSG_READ, 2u, 4u);
    MEASURE("vw_link_received (READ)", vw_link_received(&line, 101u, frame, n));
    MEASURE("vw_link_next (reply of 507 bytes)", n = vw_link_next(&line, 101u, frame));
    n = request(VW_MSG_STORE, 3u, 0u);
    MEASURE("vw_link_received (STORE)", vw_link_received(&line, 102u, frame, n));
    for (i = 0; i < 9; i++) {
        vw_link_run(&line, 103u);
    }
    MEASURE("vw_link_run (a page verified)", vw_link_run(&line, 103u));
    while (vw_store_is_busy(&line.answer.store)) {
        vw_link_run(&line, 104u);
    }
    (void)vw_link_next(&line, 104u, frame);
    (void)vw_link_next(&line, 104u, frame);
    n = request(VW_MSG_LOAD, 4u, 0u);
    MEASURE("vw_link_received (LOAD)", vw_link_received(&line, 105u, frame, n));
    MEASURE("vw_can_received", vw_can_received(&can, 106u, &message));
    MEASURE("vw_can_next (a message)", (void)vw_can_next(&can, 106u, &message));
    memset(body, 0x55, sizeof body);
    MEASURE("vw_decoder_feed (one byte)", vw_link_received(&line, 107u, (const uint8_t *)"a", 1u));
    finish();
    return 0;
}
