/* LTC6804-2 battery monitors on one isoSPI, behind an LTC6820: commands with PEC15, register groups, one packet at a
 * time. Source: the LTC6804 data sheet. No SPI registers in here: the board gives bytes and time.
 */
#ifndef VW_LTC6804_H
#define VW_LTC6804_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define VW_LTC_CELLS 12u
#define VW_LTC_GROUP_SIZE 6u
#define VW_LTC_GROUP_WORDS 3u
#define VW_LTC_MISSING 0xFFFFu /* no measurement: after power-up or a CLR command [100 uV] */
#define VW_LTC_BROADCAST 0xFFu /* instead of an address: to all chips, which answer nothing */

/* Commands that are complete; conversions take a mode and a channel, see below. */
#define VW_LTC_COMMANDS(X) \
    X(WRCFG, 0x001u) X(RDCFG, 0x002u) \
    X(RDCVA, 0x004u) X(RDCVB, 0x006u) X(RDCVC, 0x008u) X(RDCVD, 0x00Au) \
    X(RDAUXA, 0x00Cu) X(RDAUXB, 0x00Eu) X(RDSTATA, 0x010u) X(RDSTATB, 0x012u) \
    X(CLRCELL, 0x711u) X(CLRAUX, 0x712u) X(CLRSTAT, 0x713u) X(PLADC, 0x714u) X(DIAGN, 0x715u)

#define VW_LTC_COMMAND_MEMBER(name, code) VW_LTC_##name = code,
enum vw_ltc_command { VW_LTC_COMMANDS(VW_LTC_COMMAND_MEMBER) };

/* Speed of a conversion; in brackets with the configuration's adc_option. */
enum vw_ltc_mode {
    VW_LTC_FAST = 1, /* 27 kHz (14 kHz) */
    VW_LTC_NORMAL = 2, /* 7 kHz (3 kHz) */
    VW_LTC_FILTERED = 3 /* 26 Hz (2 kHz) */
};

/* All channels of a kind. `discharge` leaves the discharge switches closed while cells are converted. */
uint16_t vw_ltc_adcv(enum vw_ltc_mode mode, bool discharge);
uint16_t vw_ltc_adow(enum vw_ltc_mode mode, bool pull_up);
uint16_t vw_ltc_adax(enum vw_ltc_mode mode);
uint16_t vw_ltc_adstat(enum vw_ltc_mode mode);

/* Self-tests of the three converters, pattern 1 or 2. */
uint16_t vw_ltc_cvst(enum vw_ltc_mode mode, uint8_t pattern);
uint16_t vw_ltc_axst(enum vw_ltc_mode mode, uint8_t pattern);
uint16_t vw_ltc_statst(enum vw_ltc_mode mode, uint8_t pattern);

/* What every register of a sound chip holds after a self-test. */
uint16_t vw_ltc_self_test_code(enum vw_ltc_mode mode, uint8_t pattern, bool adc_option);

/* The 16-bit word that follows `data`, most significant byte first: the 15-bit PEC and a 0. */
uint16_t vw_ltc_pec15(const uint8_t *data, size_t length);

/* The configuration register group, CFGR0 to CFGR5. */
typedef struct {
    uint8_t gpio_pull_down_off; /* bit 0: GPIO1, to bit 4: GPIO5 */
    bool reference_on; /* stays up between conversions: each is 4.4 ms shorter */
    bool timer_pin; /* SWTEN, read only */
    bool adc_option; /* the slower rate of each mode */
    uint16_t under_voltage_code; /* 12 bits; (code + 1) x 1.6 mV */
    uint16_t over_voltage_code; /* 12 bits; code x 1.6 mV */
    uint16_t discharge; /* bit 0: cell 1, to bit 11: cell 12 */
    uint8_t discharge_timer; /* 0 none, then 0.5, 1, 2, 3, 4, 5, 10, 15, 20, 30, 40, 60, 75, 90, 120 min */
} vw_ltc_config_t;

void vw_ltc_config_encode(const vw_ltc_config_t *config, uint8_t group[VW_LTC_GROUP_SIZE]);
void vw_ltc_config_decode(const uint8_t group[VW_LTC_GROUP_SIZE], vw_ltc_config_t *config);

/* Three 16-bit registers, low byte first: cells, auxiliary or status [100 uV]. */
void vw_ltc_words_decode(const uint8_t group[VW_LTC_GROUP_SIZE], uint16_t words[VW_LTC_GROUP_WORDS]);

/* What the firmware gives the driver; both are called with `context`. */
typedef struct {
    void *context;

    /* Chip select low, send `tx_length` bytes, then clock `rx_length` bytes in, chip select high. Without a byte at all:
     * chip select low and high again, which wakes the chips. False: the SPI failed.
     */
    bool (*transfer)(void *context, const uint8_t *tx, size_t tx_length, uint8_t *rx, size_t rx_length);

    /* Return when at least this time has passed; another task may run meanwhile. */
    void (*wait_us)(void *context, uint32_t time_us);
} vw_ltc_bus_t;

/* One packet each. The address is 0 to 15, or VW_LTC_BROADCAST where nothing is read. False: the SPI failed, or what
 * arrived has a wrong PEC (`group` is then not written).
 */
bool vw_ltc_wake(const vw_ltc_bus_t *bus);
bool vw_ltc_command(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command);
bool vw_ltc_write(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command, const uint8_t group[VW_LTC_GROUP_SIZE]);
bool vw_ltc_read(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command, uint8_t group[VW_LTC_GROUP_SIZE]);

/* PLADC: whether any chip converts still. */
bool vw_ltc_is_busy(const vw_ltc_bus_t *bus);

#endif
