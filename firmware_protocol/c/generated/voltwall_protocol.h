/* Generated from the memory map: do not edit. */
#ifndef VOLTWALL_PROTOCOL_H
#define VOLTWALL_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

#define VW_PROTOCOL_VERSION 1u
#define VW_MAP_HASH { 0x51u, 0x95u, 0x07u, 0xdau, 0x6du, 0x48u, 0x8du, 0x89u }
#define VW_MASTER_SIZE 2984u
#define VW_CONFIG_SIZE 420u
#define VW_N_PACKS 8u
#define VW_CELLS_PER_PACK 12u
#define VW_N_CELLS 96u
#define VW_N_CAN_MESSAGES 8u
#define VW_CAN_DATA_BYTES 8u
#define VW_CAN_ID_EXTENDED 0x80000000u
#define VW_BYTE_UNUSED 0xffffu
#define VW_NO_RESPONSE 0xffu
#define VW_RESPONSE_CHARGES 0x40u
#define VW_NO_OFFSET 0xffffu
#define VW_V_MISSING 0u
#define VW_T_MISSING (-128)
#define VW_CHIP_MISSING 0xffffu
#define VW_START_STREAM 0x78u
#define VW_STOP_STREAM 0x79u
#define VW_HEADER_SIZE 6u
#define VW_MAX_BODY 512u
#define VW_MAX_PAYLOAD 520u
#define VW_MAX_ENCODED 523u
#define VW_MAX_READ 507u
#define VW_EEPROM_READ_BASE 0x8000u
#define VW_EEPROM_SIZE 32768u
#define VW_EEPROM_PAGE_SIZE 64u
#define VW_EEPROM_SLOT_SIZE 512u
#define VW_EEPROM_LAYOUT_VERSION 2u
#define VW_EEPROM_FIRST_LAYOUT 1u
#define VW_EEPROM_JOURNAL_OFFSET 1024u
#define VW_EEPROM_JOURNAL_PAGES 496u
#define VW_STREAM_SLOW_LENGTH 200u
#define VW_STREAM_SLOW_WORTHWHILE 32u
#define VW_STREAM_ALIGNMENT 4u
#define VW_STREAM_TURN_MS 1000u
#define VW_STREAM_FAST_PER_SLOW 20u
#define VW_BAUD_RATE 115200u
#define VW_BITS_PER_BYTE 11u
#define VW_LINE_SILENCE_MS 100u
#define VW_REPEAT_WINDOW_MS 10000u
#define VW_STREAM_FAST_WINDOWS { { 420u, 20u }, { 1884u, 204u }, { 2280u, 116u }, { 2982u, 2u } }  /* offset, length */
#define VW_STREAM_SLOW_RANGES { { 0u, 420u }, { 440u, 1444u }, { 2088u, 192u }, { 2396u, 586u } }  /* offset, length */

enum vw_message {
    VW_MSG_DATA = 0x01u,
    VW_MSG_REPLY = 0x02u,
    VW_MSG_EVENT = 0x03u,
    VW_MSG_IDENT = 0x10u,
    VW_MSG_READ = 0x11u,
    VW_MSG_WRITE = 0x12u,
    VW_MSG_STORE = 0x13u,
    VW_MSG_LOAD = 0x14u,
    VW_MSG_COMMAND = 0x20u,
};

enum vw_result {
    VW_RESULT_DONE = 0x00u,
    VW_RESULT_UNKNOWN_REQUEST = 0x01u,
    VW_RESULT_BAD_LENGTH = 0x02u,
    VW_RESULT_OUT_OF_BOUNDS = 0x03u,
    VW_RESULT_OUT_OF_RANGE = 0x04u,
    VW_RESULT_NOT_NOW = 0x05u,
    VW_RESULT_EEPROM_FAILED = 0x06u,
    VW_RESULT_NOTHING_STORED = 0x07u,
};

enum vw_command {
    VW_COMMAND_CHARGE_START = 0x01u,
    VW_COMMAND_CHARGE_STOP = 0x02u,
    VW_COMMAND_BALANCE_START = 0x03u,
    VW_COMMAND_BALANCE_STOP = 0x04u,
    VW_COMMAND_FAN_OVERRIDE = 0x05u,
    VW_COMMAND_CLEAR_FAULTS = 0x06u,
    VW_COMMAND_SET_SOC = 0x07u,
    VW_COMMAND_CAN_TX_ENABLE = 0x08u,
    VW_COMMAND_CAN_SEND = 0x09u,
    VW_COMMAND_RESET = 0x0au,
    VW_COMMAND_BALANCE_CELLS = 0x0bu,
    VW_COMMAND_SOC_FROM_OCV = 0x0cu,
};

enum vw_event {
    VW_EVENT_BOOT = 0x01u,
    VW_EVENT_TRIP_V_MIN = 0x02u,
    VW_EVENT_TRIP_V_MAX = 0x03u,
    VW_EVENT_TRIP_T_MIN = 0x04u,
    VW_EVENT_TRIP_T_MAX = 0x05u,
    VW_EVENT_TRIP_I_DISC = 0x06u,
    VW_EVENT_TRIP_I_CHRG = 0x07u,
    VW_EVENT_TRIP_SLAVE_LOST = 0x08u,
    VW_EVENT_TRIP_SENSOR_LOST = 0x09u,
    VW_EVENT_FAULTS_CLEARED = 0x0au,
    VW_EVENT_CHARGER_STATE = 0x0bu,
    VW_EVENT_CONFIG_WRITTEN = 0x0cu,
    VW_EVENT_CONFIG_STORED = 0x0du,
    VW_EVENT_CAN_RX_TIMEOUT = 0x0eu,
    VW_EVENT_EEPROM_INVALID = 0x0fu,
    VW_EVENT_SOC_SET = 0x10u,
};

enum vw_status_flag {
    VW_STATUS_FIT = 0x1,
    VW_STATUS_USB = 0x2,
    VW_STATUS_I2C1 = 0x4,
    VW_STATUS_USART1 = 0x8,
    VW_STATUS_CAN1 = 0x10,
    VW_STATUS_CHARGER = 0x20,
    VW_STATUS_CHARGING = 0x40,
    VW_STATUS_BALANCING = 0x80,
    VW_STATUS_LOAD = 0x100,
};

enum vw_charger_flag {
    VW_CHARGER_HARDWARE = 0x1,
    VW_CHARGER_OVER_TEMPERATURE = 0x2,
    VW_CHARGER_INPUT_VOLTAGE = 0x4,
    VW_CHARGER_BATTERY = 0x8,
    VW_CHARGER_TIMEOUT = 0x10,
};

enum vw_charger_control {
    VW_CHARGER_CONTROL_CHARGE = 0,
    VW_CHARGER_CONTROL_STOP = 1,
};

enum vw_charger_state {
    VW_CHARGER_STATE_OFF = 0,
    VW_CHARGER_STATE_WAITING = 1,
    VW_CHARGER_STATE_CONSTANT_CURRENT = 2,
    VW_CHARGER_STATE_BALANCING = 3,
    VW_CHARGER_STATE_CONSTANT_VOLTAGE = 4,
    VW_CHARGER_STATE_DONE = 5,
    VW_CHARGER_STATE_FAULT = 6,
};

enum vw_slave_status {
    VW_SLAVE_STATUS_ABSENT = 0,
    VW_SLAVE_STATUS_ACTIVE = 1,
    VW_SLAVE_STATUS_FAULT = 255,
};

typedef struct {  /* 420 bytes */
    uint16_t ts;  /* 1 kHz samples per mean of the current; sets the rate of current, overcurrent protection and charge count [sample] */
    uint16_t v_cell_min;  /* lowest cell voltage; below it the master opens the contactors [0.0001 V] */
    uint16_t v_cell_max;  /* highest cell voltage; above it the master opens the contactors [0.0001 V] */
    uint16_t v_cell_chrg;  /* charge until the first cell reaches this voltage [0.0001 V] */
    int8_t t_cell_min;  /* lowest cell temperature [degC] */
    int8_t t_cell_max;  /* highest cell temperature; the rules allow 60 degC or the data sheet's limit [degC] */
    uint16_t i_offset;  /* ADC reading at no current, in tenths of a count [0.1 count] */
    uint16_t i_gain;  /* amperes per ADC count: i[10 mA] = (10 count - i_offset) i_gain / 5000 [2e-05 A/count] */
    int16_t i_disc_min;  /* highest regen current while driving (negative) [0.01 A] */
    int16_t i_disc_max;  /* highest discharge current while driving [0.01 A] */
    int16_t i_chrg_min;  /* lowest current while charging [0.01 A] */
    int16_t i_chrg_max;  /* highest current while charging, requested from the charger [0.01 A] */
    int16_t c_avg;  /* capacity of a new cell [0.01 Ah] */
    int16_t r_fs_avg;  /* fast resistance of a new cell [1e-05 ohm] */
    int16_t r_fc_avg;  /* slow resistance of a new cell [1e-05 ohm] */
    int16_t fc_avg;  /* samples in the current average */
    int8_t fan_ramp_start;  /* hottest cell at which the fans leave their lowest duty [degC] */
    int8_t fan_ramp_stop;  /* hottest cell at which the fans reach their highest duty [degC] */
    uint8_t fan_ramp_min;  /* lowest duty [0.00392156863 duty] */
    uint8_t fan_ramp_max;  /* highest duty [0.00392156863 duty] */
    uint16_t balance_threshold;  /* a cell this far above the lowest is balanced [0.0001 V] */
    uint16_t v_alpha;  /* weight of the new sample in the voltage filter [0.001] */
    uint8_t can_brp;  /* CAN prescaler: bit rate = 32 MHz / ((can_brp + 1) 8) */
    uint8_t can_tx_msg_en_startup;  /* messages sent from start-up on, one bit each [mask] */
    uint32_t can_tx_msg_id[8];  /* CAN id; bit 31 marks a 29-bit id */
    uint16_t can_tx_msg_timing[8];  /* time between two messages; 0 sends on demand only [ms] */
    uint8_t can_tx_msg_len[8];  /* data bytes in the message [byte] */
    uint16_t can_tx_msg_data[8][8];  /* offset in this struct of each byte sent; 65535 sends 0 */
    uint8_t can_rx_msg_en_startup;  /* messages received from start-up on, one bit each [mask] */
    uint16_t telemetry_period;  /* time between two telemetry frames [ms] */
    uint32_t can_rx_msg_id[8];  /* CAN id; bit 31 marks a 29-bit id */
    uint16_t can_rx_msg_timeout[8];  /* time without the message after which it counts as lost; 0 never [ms] */
    uint8_t can_rx_msg_len[8];  /* data bytes in the message [byte] */
    uint8_t can_rx_msg_response[8];  /* tx message activated by this one, plus 64 if it starts and stops charging; 255 none */
    uint16_t can_rx_msg_data[8][8];  /* offset in this struct of each byte received; 65535 ignores it */
} vw_config_t;

typedef struct {  /* 8 bytes */
    uint32_t flags;  /* bits from 0: fit, usb, i2c1, usart1, can1, charger, charging, balancing, load */
    uint8_t can_tx_msg_en;  /* tx messages being sent [mask] */
    uint8_t can_rx_msg_en;  /* rx messages enabled [mask] */
    uint8_t can_rx_msg_active;  /* rx messages received within their timeout [mask] */
    uint8_t charger_status;  /* the charger's last flags; 255 without a charger */
} vw_status_t;

typedef struct {  /* 12 bytes */
    uint16_t v_set;  /* voltage requested from the charger [0.1 V] */
    uint16_t i_set;  /* current requested from the charger [0.1 A] */
    uint16_t v_out;  /* output voltage reported by the charger [0.1 V] */
    uint16_t i_out;  /* output current reported by the charger [0.1 A] */
    uint8_t control;  /* 0 charge, 1 stop */
    uint8_t flags;  /* bits from 0: hardware, over-temperature, input voltage, battery, time-out */
    uint8_t state;  /* the master's charging state: 0 off, 1 waiting, 2 constant_current, 3 balancing, 4 constant_voltage, 5 done, 6 fault */
    uint8_t fan_duty;  /* active fan duty [0.00392156863 duty] */
} vw_charger_t;

typedef struct {  /* 180 bytes */
    uint8_t status;  /* 0 absent, 1 active, 255 fault */
    uint32_t time[18];  /* time of each step of the last reading [us] */
    uint8_t cfgr[6];  /* configuration register group, as read back */
    uint16_t cvr[12];  /* cell voltages as read from the chip; 65535 no measurement [0.0001 V] */
    uint16_t avr[3];  /* auxiliary voltages, GPIO 1 to 3 [0.0001 V] */
    uint16_t str[6];  /* status register groups A and B */
    uint16_t com[3];  /* packets with a wrong PEC15 since the boot (stays at 65535) and in the last second, failed self-tests as bits: 0 cells, 1 auxiliary, 2 status, 3 multiplexer, 4 reference */
    uint16_t temp[24];  /* voltages with the sensors switched in, two phases of 12 [0.0001 V] */
} vw_slave_t;

typedef struct {  /* 2984 bytes */
    vw_config_t conf;
    vw_status_t status;
    vw_charger_t charger;
    uint8_t n_slaves;  /* slaves that responded */
    vw_slave_t slave[8];
    int32_t i_fs;  /* current, positive on discharge, mean of the last ts samples [0.01 A] */
    int32_t i_fc;  /* current, mean of the newest fc_avg samples, in whole means of ts [0.01 A] */
    int32_t i_fc_hp;  /* averaged current in the master's high-precision path [0.01 A] */
    uint16_t v[96];  /* cell voltages, filtered; 0 no measurement [0.0001 V] */
    uint16_t ocv[96];  /* open-circuit voltages [0.0001 V] */
    uint16_t v_min;  /* lowest cell voltage [0.0001 V] */
    uint16_t v_max;  /* highest cell voltage [0.0001 V] */
    uint16_t v_avg;  /* mean cell voltage [0.0001 V] */
    uint8_t v_min_id;  /* cell index of v_min */
    uint8_t v_max_id;  /* cell index of v_max */
    uint16_t v_tot;  /* sum of the cells [0.01 V] */
    int8_t t[96];  /* cell temperatures; -128 no measurement [degC] */
    int8_t t_min;  /* coldest cell [degC] */
    int8_t t_max;  /* hottest cell [degC] */
    int8_t t_avg;  /* mean cell temperature [degC] */
    uint8_t t_min_id;  /* cell index of t_min */
    uint8_t t_max_id;  /* cell index of t_max */
    uint32_t dod;  /* charge drawn since full, in uAh [1e-06 Ah] */
    uint16_t c[96];  /* cell capacities [0.01 Ah] */
    uint16_t c_min;  /* lowest capacity [0.01 Ah] */
    uint16_t c_max;  /* highest capacity [0.01 Ah] */
    uint16_t c_avg;  /* mean capacity [0.01 Ah] */
    uint16_t c_min_id;  /* cell index of c_min */
    uint16_t c_max_id;  /* cell index of c_max */
    uint16_t r_fs[96];  /* fast resistances [1e-05 ohm] */
    uint16_t r_fc[96];  /* slow resistances [1e-05 ohm] */
    uint16_t soc;  /* state of charge, the master's own count [0.0001] */
} vw_master_t;

#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
#define VW_ASSERT(name, claim) _Static_assert(claim, #name)
#else
#define VW_ASSERT(name, claim) typedef char vw_assert_##name[(claim) ? 1 : -1]
#endif

VW_ASSERT(config_ts, offsetof(vw_config_t, ts) == 0u);
VW_ASSERT(config_v_cell_min, offsetof(vw_config_t, v_cell_min) == 2u);
VW_ASSERT(config_v_cell_max, offsetof(vw_config_t, v_cell_max) == 4u);
VW_ASSERT(config_v_cell_chrg, offsetof(vw_config_t, v_cell_chrg) == 6u);
VW_ASSERT(config_t_cell_min, offsetof(vw_config_t, t_cell_min) == 8u);
VW_ASSERT(config_t_cell_max, offsetof(vw_config_t, t_cell_max) == 9u);
VW_ASSERT(config_i_offset, offsetof(vw_config_t, i_offset) == 10u);
VW_ASSERT(config_i_gain, offsetof(vw_config_t, i_gain) == 12u);
VW_ASSERT(config_i_disc_min, offsetof(vw_config_t, i_disc_min) == 14u);
VW_ASSERT(config_i_disc_max, offsetof(vw_config_t, i_disc_max) == 16u);
VW_ASSERT(config_i_chrg_min, offsetof(vw_config_t, i_chrg_min) == 18u);
VW_ASSERT(config_i_chrg_max, offsetof(vw_config_t, i_chrg_max) == 20u);
VW_ASSERT(config_c_avg, offsetof(vw_config_t, c_avg) == 22u);
VW_ASSERT(config_r_fs_avg, offsetof(vw_config_t, r_fs_avg) == 24u);
VW_ASSERT(config_r_fc_avg, offsetof(vw_config_t, r_fc_avg) == 26u);
VW_ASSERT(config_fc_avg, offsetof(vw_config_t, fc_avg) == 28u);
VW_ASSERT(config_fan_ramp_start, offsetof(vw_config_t, fan_ramp_start) == 30u);
VW_ASSERT(config_fan_ramp_stop, offsetof(vw_config_t, fan_ramp_stop) == 31u);
VW_ASSERT(config_fan_ramp_min, offsetof(vw_config_t, fan_ramp_min) == 32u);
VW_ASSERT(config_fan_ramp_max, offsetof(vw_config_t, fan_ramp_max) == 33u);
VW_ASSERT(config_balance_threshold, offsetof(vw_config_t, balance_threshold) == 34u);
VW_ASSERT(config_v_alpha, offsetof(vw_config_t, v_alpha) == 36u);
VW_ASSERT(config_can_brp, offsetof(vw_config_t, can_brp) == 38u);
VW_ASSERT(config_can_tx_msg_en_startup, offsetof(vw_config_t, can_tx_msg_en_startup) == 39u);
VW_ASSERT(config_can_tx_msg_id, offsetof(vw_config_t, can_tx_msg_id) == 40u);
VW_ASSERT(config_can_tx_msg_timing, offsetof(vw_config_t, can_tx_msg_timing) == 72u);
VW_ASSERT(config_can_tx_msg_len, offsetof(vw_config_t, can_tx_msg_len) == 88u);
VW_ASSERT(config_can_tx_msg_data, offsetof(vw_config_t, can_tx_msg_data) == 96u);
VW_ASSERT(config_can_rx_msg_en_startup, offsetof(vw_config_t, can_rx_msg_en_startup) == 224u);
VW_ASSERT(config_telemetry_period, offsetof(vw_config_t, telemetry_period) == 226u);
VW_ASSERT(config_can_rx_msg_id, offsetof(vw_config_t, can_rx_msg_id) == 228u);
VW_ASSERT(config_can_rx_msg_timeout, offsetof(vw_config_t, can_rx_msg_timeout) == 260u);
VW_ASSERT(config_can_rx_msg_len, offsetof(vw_config_t, can_rx_msg_len) == 276u);
VW_ASSERT(config_can_rx_msg_response, offsetof(vw_config_t, can_rx_msg_response) == 284u);
VW_ASSERT(config_can_rx_msg_data, offsetof(vw_config_t, can_rx_msg_data) == 292u);
VW_ASSERT(config_size, sizeof(vw_config_t) == 420u);
VW_ASSERT(status_flags, offsetof(vw_status_t, flags) == 0u);
VW_ASSERT(status_can_tx_msg_en, offsetof(vw_status_t, can_tx_msg_en) == 4u);
VW_ASSERT(status_can_rx_msg_en, offsetof(vw_status_t, can_rx_msg_en) == 5u);
VW_ASSERT(status_can_rx_msg_active, offsetof(vw_status_t, can_rx_msg_active) == 6u);
VW_ASSERT(status_charger_status, offsetof(vw_status_t, charger_status) == 7u);
VW_ASSERT(status_size, sizeof(vw_status_t) == 8u);
VW_ASSERT(charger_v_set, offsetof(vw_charger_t, v_set) == 0u);
VW_ASSERT(charger_i_set, offsetof(vw_charger_t, i_set) == 2u);
VW_ASSERT(charger_v_out, offsetof(vw_charger_t, v_out) == 4u);
VW_ASSERT(charger_i_out, offsetof(vw_charger_t, i_out) == 6u);
VW_ASSERT(charger_control, offsetof(vw_charger_t, control) == 8u);
VW_ASSERT(charger_flags, offsetof(vw_charger_t, flags) == 9u);
VW_ASSERT(charger_state, offsetof(vw_charger_t, state) == 10u);
VW_ASSERT(charger_fan_duty, offsetof(vw_charger_t, fan_duty) == 11u);
VW_ASSERT(charger_size, sizeof(vw_charger_t) == 12u);
VW_ASSERT(slave_status, offsetof(vw_slave_t, status) == 0u);
VW_ASSERT(slave_time, offsetof(vw_slave_t, time) == 4u);
VW_ASSERT(slave_cfgr, offsetof(vw_slave_t, cfgr) == 76u);
VW_ASSERT(slave_cvr, offsetof(vw_slave_t, cvr) == 82u);
VW_ASSERT(slave_avr, offsetof(vw_slave_t, avr) == 106u);
VW_ASSERT(slave_str, offsetof(vw_slave_t, str) == 112u);
VW_ASSERT(slave_com, offsetof(vw_slave_t, com) == 124u);
VW_ASSERT(slave_temp, offsetof(vw_slave_t, temp) == 130u);
VW_ASSERT(slave_size, sizeof(vw_slave_t) == 180u);
VW_ASSERT(master_conf, offsetof(vw_master_t, conf) == 0u);
VW_ASSERT(master_status, offsetof(vw_master_t, status) == 420u);
VW_ASSERT(master_charger, offsetof(vw_master_t, charger) == 428u);
VW_ASSERT(master_slave, offsetof(vw_master_t, slave) == 444u);
VW_ASSERT(master_n_slaves, offsetof(vw_master_t, n_slaves) == 440u);
VW_ASSERT(master_i_fs, offsetof(vw_master_t, i_fs) == 1884u);
VW_ASSERT(master_i_fc, offsetof(vw_master_t, i_fc) == 1888u);
VW_ASSERT(master_i_fc_hp, offsetof(vw_master_t, i_fc_hp) == 1892u);
VW_ASSERT(master_v, offsetof(vw_master_t, v) == 1896u);
VW_ASSERT(master_ocv, offsetof(vw_master_t, ocv) == 2088u);
VW_ASSERT(master_v_min, offsetof(vw_master_t, v_min) == 2280u);
VW_ASSERT(master_v_max, offsetof(vw_master_t, v_max) == 2282u);
VW_ASSERT(master_v_avg, offsetof(vw_master_t, v_avg) == 2284u);
VW_ASSERT(master_v_min_id, offsetof(vw_master_t, v_min_id) == 2286u);
VW_ASSERT(master_v_max_id, offsetof(vw_master_t, v_max_id) == 2287u);
VW_ASSERT(master_v_tot, offsetof(vw_master_t, v_tot) == 2288u);
VW_ASSERT(master_t, offsetof(vw_master_t, t) == 2290u);
VW_ASSERT(master_t_min, offsetof(vw_master_t, t_min) == 2386u);
VW_ASSERT(master_t_max, offsetof(vw_master_t, t_max) == 2387u);
VW_ASSERT(master_t_avg, offsetof(vw_master_t, t_avg) == 2388u);
VW_ASSERT(master_t_min_id, offsetof(vw_master_t, t_min_id) == 2389u);
VW_ASSERT(master_t_max_id, offsetof(vw_master_t, t_max_id) == 2390u);
VW_ASSERT(master_dod, offsetof(vw_master_t, dod) == 2392u);
VW_ASSERT(master_c, offsetof(vw_master_t, c) == 2396u);
VW_ASSERT(master_c_min, offsetof(vw_master_t, c_min) == 2588u);
VW_ASSERT(master_c_max, offsetof(vw_master_t, c_max) == 2590u);
VW_ASSERT(master_c_avg, offsetof(vw_master_t, c_avg) == 2592u);
VW_ASSERT(master_c_min_id, offsetof(vw_master_t, c_min_id) == 2594u);
VW_ASSERT(master_c_max_id, offsetof(vw_master_t, c_max_id) == 2596u);
VW_ASSERT(master_r_fs, offsetof(vw_master_t, r_fs) == 2598u);
VW_ASSERT(master_r_fc, offsetof(vw_master_t, r_fc) == 2790u);
VW_ASSERT(master_soc, offsetof(vw_master_t, soc) == 2982u);
VW_ASSERT(master_size, sizeof(vw_master_t) == 2984u);

/* X(name, offset, type, count, minimum, maximum, live) for every configuration field, in raw counts;
 * live: 1 where it may be changed while the car drives or charges
 */
#define VW_CONFIG_FIELDS(X) \
    X(ts, 0u, uint16_t, 1u, 1, 200, 0) \
    X(v_cell_min, 2u, uint16_t, 1u, 15000, 40000, 0) \
    X(v_cell_max, 4u, uint16_t, 1u, 30000, 45000, 0) \
    X(v_cell_chrg, 6u, uint16_t, 1u, 30000, 45000, 0) \
    X(t_cell_min, 8u, int8_t, 1u, -40, 40, 0) \
    X(t_cell_max, 9u, int8_t, 1u, 0, 100, 0) \
    X(i_offset, 10u, uint16_t, 1u, 0, 40950, 0) \
    X(i_gain, 12u, uint16_t, 1u, 1, 65535, 0) \
    X(i_disc_min, 14u, int16_t, 1u, -32767, 0, 0) \
    X(i_disc_max, 16u, int16_t, 1u, 0, 32767, 0) \
    X(i_chrg_min, 18u, int16_t, 1u, -32767, 32767, 0) \
    X(i_chrg_max, 20u, int16_t, 1u, 0, 32767, 0) \
    X(c_avg, 22u, int16_t, 1u, 10, 32767, 0) \
    X(r_fs_avg, 24u, int16_t, 1u, 0, 32767, 0) \
    X(r_fc_avg, 26u, int16_t, 1u, 0, 32767, 0) \
    X(fc_avg, 28u, int16_t, 1u, 0, 1000, 0) \
    X(fan_ramp_start, 30u, int8_t, 1u, -40, 100, 1) \
    X(fan_ramp_stop, 31u, int8_t, 1u, -40, 100, 1) \
    X(fan_ramp_min, 32u, uint8_t, 1u, 0, 255, 1) \
    X(fan_ramp_max, 33u, uint8_t, 1u, 0, 255, 1) \
    X(balance_threshold, 34u, uint16_t, 1u, 10, 5000, 1) \
    X(v_alpha, 36u, uint16_t, 1u, 1, 1000, 0) \
    X(can_brp, 38u, uint8_t, 1u, 3, 255, 0) \
    X(can_tx_msg_en_startup, 39u, uint8_t, 1u, 0, 255, 0) \
    X(can_tx_msg_id, 40u, uint32_t, 8u, 0, 4294967295u, 0) \
    X(can_tx_msg_timing, 72u, uint16_t, 8u, 0, 60000, 0) \
    X(can_tx_msg_len, 88u, uint8_t, 8u, 0, 8, 0) \
    X(can_tx_msg_data, 96u, uint16_t, 64u, 0, 65535, 0) \
    X(can_rx_msg_en_startup, 224u, uint8_t, 1u, 0, 255, 0) \
    X(telemetry_period, 226u, uint16_t, 1u, 20, 10000, 1) \
    X(can_rx_msg_id, 228u, uint32_t, 8u, 0, 4294967295u, 0) \
    X(can_rx_msg_timeout, 260u, uint16_t, 8u, 0, 60000, 0) \
    X(can_rx_msg_len, 276u, uint8_t, 8u, 0, 8, 0) \
    X(can_rx_msg_response, 284u, uint8_t, 8u, 0, 255, 0) \
    X(can_rx_msg_data, 292u, uint16_t, 64u, 0, 65535, 0)

/* initializer of vw_config_t */
#define VW_CONFIG_DEFAULTS { \
    100, /* ts */ \
    25000, /* v_cell_min */ \
    42000, /* v_cell_max */ \
    41500, /* v_cell_chrg */ \
    -15, /* t_cell_min */ \
    45, /* t_cell_max */ \
    20490, /* i_offset */ \
    12120, /* i_gain */ \
    -10000, /* i_disc_min */ \
    20000, /* i_disc_max */ \
    0, /* i_chrg_min */ \
    1200, /* i_chrg_max */ \
    2500, /* c_avg */ \
    210, /* r_fs_avg */ \
    0, /* r_fc_avg */ \
    10, /* fc_avg */ \
    20, /* fan_ramp_start */ \
    50, /* fan_ramp_stop */ \
    32, /* fan_ramp_min */ \
    224, /* fan_ramp_max */ \
    250, /* balance_threshold */ \
    500, /* v_alpha */ \
    7, /* can_brp */ \
    2, /* can_tx_msg_en_startup */ \
    { 2550588916u, 256, 257, 0, 0, 0, 0, 0 }, /* can_tx_msg_id */ \
    { 1000, 100, 100, 0, 0, 0, 0, 0 }, /* can_tx_msg_timing */ \
    { 8, 8, 8, 0, 0, 0, 0, 0 }, /* can_tx_msg_len */ \
    { { 429, 428, 431, 430, 436, 65535, 65535, 65535 }, { 2982, 2983, 2288, 2289, 1884, 1885, 1886, 1887 }, { 2280, 2281, 2282, 2283, 2286, 2287, 2387, 420 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 } }, /* can_tx_msg_data */ \
    1, /* can_rx_msg_en_startup */ \
    100, /* telemetry_period */ \
    { 2566869221u, 0, 0, 0, 0, 0, 0, 0 }, /* can_rx_msg_id */ \
    { 5000, 0, 0, 0, 0, 0, 0, 0 }, /* can_rx_msg_timeout */ \
    { 8, 0, 0, 0, 0, 0, 0, 0 }, /* can_rx_msg_len */ \
    { 0, 255, 255, 255, 255, 255, 255, 255 }, /* can_rx_msg_response */ \
    { { 433, 432, 435, 434, 437, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 }, { 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535 } }, /* can_rx_msg_data */ \
}

/* X(name, code, lowest argument, highest argument) for every command */
#define VW_COMMANDS(X) \
    X(charge_start, VW_COMMAND_CHARGE_START, INT32_MIN, INT32_MAX) \
    X(charge_stop, VW_COMMAND_CHARGE_STOP, INT32_MIN, INT32_MAX) \
    X(balance_start, VW_COMMAND_BALANCE_START, INT32_MIN, INT32_MAX) \
    X(balance_stop, VW_COMMAND_BALANCE_STOP, INT32_MIN, INT32_MAX) \
    X(fan_override, VW_COMMAND_FAN_OVERRIDE, -1, 921855) \
    X(clear_faults, VW_COMMAND_CLEAR_FAULTS, INT32_MIN, INT32_MAX) \
    X(set_soc, VW_COMMAND_SET_SOC, 0, 10000) \
    X(can_tx_enable, VW_COMMAND_CAN_TX_ENABLE, 0, 255) \
    X(can_send, VW_COMMAND_CAN_SEND, 0, 7) \
    X(reset, VW_COMMAND_RESET, INT32_MIN, INT32_MAX) \
    X(balance_cells, VW_COMMAND_BALANCE_CELLS, 0, 32767) \
    X(soc_from_ocv, VW_COMMAND_SOC_FROM_OCV, INT32_MIN, INT32_MAX)

#endif
