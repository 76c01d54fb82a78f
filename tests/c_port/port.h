/* What tests/c_virtual_master.py calls. */
#ifndef PORT_H
#define PORT_H

#include "master/vw_measuring.h"

typedef struct port port_t;
typedef void (*eeprom_read_t)(uint16_t address, uint8_t *data, uint16_t length);
typedef void (*eeprom_write_t)(uint16_t address, const uint8_t *data, uint16_t length);
typedef bool (*transfer_t)(const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length);
typedef void (*wait_t)(uint32_t time_us);

typedef struct {
    bool is_ready, is_drive_asked, is_shutdown_closed;
    uint16_t link_permille;
    uint32_t hardware;
} port_inputs_t;

typedef struct {
    uint8_t relays, charging;
    bool has_precharge_failed, is_charging, is_open, is_streaming, is_restarting, has_new_cells;
    uint32_t relays_since_ms;
    uint16_t cells[VW_N_PACKS];
} port_state_t;

port_t *port_new(vw_master_t *memory, eeprom_read_t read, eeprom_write_t write, uint8_t cause, uint32_t boots, bool is_open);
void port_free(port_t *port);
void port_step(port_t *port, uint32_t now_ms, const vw_reading_t *reading, const int32_t *means, uint8_t n_means,
               const port_inputs_t *with);
/* Instead of port_step: the slaves and the current measured in C too. */
void port_start_slaves(port_t *port, uint32_t now_ms, const uint8_t sensor_inputs[VW_LTC_CELLS], transfer_t of_board,
                       wait_t waiting);
void port_pass(port_t *port, uint32_t now_ms, uint32_t pass_ms, const uint16_t *samples, uint16_t n, const port_inputs_t *with);
void port_state(port_t *port, port_state_t *state);
uint8_t port_command(port_t *port, uint8_t command, int32_t argument);
void port_received(port_t *port, uint32_t now_ms, const uint8_t *data, size_t length);
size_t port_next(port_t *port, uint32_t now_ms, uint8_t out[VW_MAX_FRAME]);
bool port_can_next(port_t *port, uint32_t now_ms, vw_can_frame_t *frame);
void port_can_received(port_t *port, uint32_t now_ms, const vw_can_frame_t *frame);

#endif
