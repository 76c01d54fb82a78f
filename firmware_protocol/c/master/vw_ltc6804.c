#include "vw_ltc6804.h"

#include <string.h>

#define PEC_SEED 0x0010u
#define PEC_MASK 0x7FFFu
#define PEC_SIZE 2u
#define COMMAND_SIZE 4u
#define PACKET_SIZE (COMMAND_SIZE + VW_LTC_GROUP_SIZE + PEC_SIZE)

/* Conversions: what is added to the mode, bits 7 and 8 */
#define ADCV 0x260u
#define ADOW 0x228u
#define ADAX 0x460u
#define ADSTAT 0x468u
#define CVST 0x207u
#define AXST 0x407u
#define STATST 0x40Fu
#define DISCHARGE_PERMITTED 0x010u
#define PULL_UP 0x040u
#define MODE_SHIFT 7u
#define PATTERN_SHIFT 5u

/* Bits of CFGR0 */
#define ADC_OPTION 0x01u
#define TIMER_PIN 0x02u
#define REFERENCE_ON 0x04u
#define GPIO_SHIFT 3u

static uint16_t vw_ltc6804_encode_conversion(uint16_t kind, enum vw_ltc_mode mode)
{
    return (uint16_t)(kind | ((unsigned)mode << MODE_SHIFT));
}

uint16_t vw_ltc_adcv(enum vw_ltc_mode mode, bool discharge)
{
    return vw_ltc6804_encode_conversion(discharge ? ADCV | DISCHARGE_PERMITTED : ADCV, mode);
}

uint16_t vw_ltc_adow(enum vw_ltc_mode mode, bool pull_up)
{
    return vw_ltc6804_encode_conversion(pull_up ? ADOW | PULL_UP : ADOW, mode);
}

uint16_t vw_ltc_adax(enum vw_ltc_mode mode)
{
    return vw_ltc6804_encode_conversion(ADAX, mode);
}

uint16_t vw_ltc_adstat(enum vw_ltc_mode mode)
{
    return vw_ltc6804_encode_conversion(ADSTAT, mode);
}

static uint16_t vw_ltc6804_encode_self_test(uint16_t kind, enum vw_ltc_mode mode, uint8_t pattern)
{
    return (uint16_t)(vw_ltc6804_encode_conversion(kind, mode) | ((unsigned)pattern << PATTERN_SHIFT));
}

uint16_t vw_ltc_cvst(enum vw_ltc_mode mode, uint8_t pattern)
{
    return vw_ltc6804_encode_self_test(CVST, mode, pattern);
}

uint16_t vw_ltc_axst(enum vw_ltc_mode mode, uint8_t pattern)
{
    return vw_ltc6804_encode_self_test(AXST, mode, pattern);
}

uint16_t vw_ltc_statst(enum vw_ltc_mode mode, uint8_t pattern)
{
    return vw_ltc6804_encode_self_test(STATST, mode, pattern);
}

uint16_t vw_ltc_self_test_code(enum vw_ltc_mode mode, uint8_t pattern, bool adc_option)
{
    bool is_first = pattern == 1u;
    if (mode != VW_LTC_FAST) {
        return is_first ? 0x9555u : 0x6AAAu;
    }
    if (adc_option) {
        return is_first ? 0x9553u : 0x6AACu;
    }
    return is_first ? 0x9565u : 0x6A9Au;
}

/* What each of four bits leaves behind, polynomial 0x4599: fifteen bits divided four at a time. */
static const uint16_t pec_table[16] = {
    0x0000u, 0x4599u, 0x4EABu, 0x0B32u, 0x58CFu, 0x1D56u, 0x1664u, 0x53FDu,
    0x7407u, 0x319Eu, 0x3AACu, 0x7F35u, 0x2CC8u, 0x6951u, 0x6263u, 0x27FAu
};

static uint32_t vw_ltc6804_update_pec(uint32_t remainder, unsigned four_bits)
{
    return ((remainder << 4) ^ pec_table[((remainder >> 11) ^ four_bits) & 0x0Fu]) & PEC_MASK;
}

uint16_t vw_ltc_pec15(const uint8_t *data, size_t length)
{
    uint32_t remainder = PEC_SEED;
    size_t i;
    for (i = 0; i < length; i++) {
        remainder = vw_ltc6804_update_pec(remainder, (unsigned)data[i] >> 4);
        remainder = vw_ltc6804_update_pec(remainder, data[i] & 0x0Fu);
    }
    return (uint16_t)(remainder << 1);
}

static void vw_ltc6804_append_pec(uint8_t *data, size_t length)
{
    uint16_t pec = vw_ltc_pec15(data, length);
    data[length] = (uint8_t)(pec >> 8);
    data[length + 1u] = (uint8_t)(pec & 0xFFu);
}

void vw_ltc_config_encode(const vw_ltc_config_t *config, uint8_t group[VW_LTC_GROUP_SIZE])
{
    unsigned flags = ((unsigned)config->gpio_pull_down_off & 0x1Fu) << GPIO_SHIFT;
    flags |= config->reference_on ? REFERENCE_ON : 0u;
    flags |= config->timer_pin ? TIMER_PIN : 0u;
    flags |= config->adc_option ? ADC_OPTION : 0u;
    group[0] = (uint8_t)flags;
    group[1] = (uint8_t)(config->under_voltage_code & 0xFFu);
    group[2] = (uint8_t)(((config->over_voltage_code & 0x0Fu) << 4) | ((config->under_voltage_code >> 8) & 0x0Fu));
    group[3] = (uint8_t)((config->over_voltage_code >> 4) & 0xFFu);
    group[4] = (uint8_t)(config->discharge & 0xFFu);
    group[5] = (uint8_t)(((config->discharge_timer & 0x0Fu) << 4) | ((config->discharge >> 8) & 0x0Fu));
}

void vw_ltc_config_decode(const uint8_t group[VW_LTC_GROUP_SIZE], vw_ltc_config_t *config)
{
    config->gpio_pull_down_off = (uint8_t)(group[0] >> GPIO_SHIFT);
    config->reference_on = (group[0] & REFERENCE_ON) != 0u;
    config->timer_pin = (group[0] & TIMER_PIN) != 0u;
    config->adc_option = (group[0] & ADC_OPTION) != 0u;
    config->under_voltage_code = (uint16_t)(((group[2] & 0x0Fu) << 8) | group[1]);
    config->over_voltage_code = (uint16_t)((group[3] << 4) | (group[2] >> 4));
    config->discharge = (uint16_t)(((group[5] & 0x0Fu) << 8) | group[4]);
    config->discharge_timer = (uint8_t)(group[5] >> 4);
}

void vw_ltc_words_decode(const uint8_t group[VW_LTC_GROUP_SIZE], uint16_t words[VW_LTC_GROUP_WORDS])
{
    size_t i;
    for (i = 0; i < VW_LTC_GROUP_WORDS; i++) {
        words[i] = (uint16_t)(group[2u * i] | ((unsigned)group[2u * i + 1u] << 8));
    }
}

static void vw_ltc6804_encode_command(uint8_t packet[COMMAND_SIZE], uint8_t address, uint16_t command)
{
    unsigned first = (command >> 8) & 0x07u;
    if (address != VW_LTC_BROADCAST) {
        first |= 0x80u | ((address & 0x0Fu) << 3);
    }
    packet[0] = (uint8_t)first;
    packet[1] = (uint8_t)(command & 0xFFu);
    vw_ltc6804_append_pec(packet, 2u);
}

bool vw_ltc_wake(const vw_ltc_bus_t *bus)
{
    return bus->transfer(bus->context, NULL, 0u, NULL, 0u);
}

bool vw_ltc_command(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command)
{
    uint8_t packet[COMMAND_SIZE];
    vw_ltc6804_encode_command(packet, address, command);
    return bus->transfer(bus->context, packet, sizeof packet, NULL, 0u);
}

bool vw_ltc_write(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command, const uint8_t group[VW_LTC_GROUP_SIZE])
{
    uint8_t packet[PACKET_SIZE];
    vw_ltc6804_encode_command(packet, address, command);
    (void)memcpy(packet + COMMAND_SIZE, group, VW_LTC_GROUP_SIZE);
    vw_ltc6804_append_pec(packet + COMMAND_SIZE, VW_LTC_GROUP_SIZE);
    return bus->transfer(bus->context, packet, sizeof packet, NULL, 0u);
}

bool vw_ltc_read(const vw_ltc_bus_t *bus, uint8_t address, uint16_t command, uint8_t group[VW_LTC_GROUP_SIZE])
{
    uint8_t packet[COMMAND_SIZE];
    uint8_t answer[VW_LTC_GROUP_SIZE + PEC_SIZE];
    uint16_t pec;
    vw_ltc6804_encode_command(packet, address, command);
    if (!bus->transfer(bus->context, packet, sizeof packet, answer, sizeof answer)) {
        return false;
    }
    pec = vw_ltc_pec15(answer, VW_LTC_GROUP_SIZE);
    if (answer[VW_LTC_GROUP_SIZE] != (uint8_t)(pec >> 8) || answer[VW_LTC_GROUP_SIZE + 1u] != (uint8_t)(pec & 0xFFu)) {
        return false;
    }
    (void)memcpy(group, answer, VW_LTC_GROUP_SIZE);
    return true;
}

bool vw_ltc_is_busy(const vw_ltc_bus_t *bus)
{
    uint8_t packet[COMMAND_SIZE];
    uint8_t answer = 0xFFu;
    vw_ltc6804_encode_command(packet, VW_LTC_BROADCAST, VW_LTC_PLADC);
    return bus->transfer(bus->context, packet, sizeof packet, &answer, 1u) && answer == 0u;
}
