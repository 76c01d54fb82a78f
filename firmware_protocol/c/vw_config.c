#include "vw_config.h"

#include <string.h>

#include "vw_bytes.h"
#include "vw_codec.h"

#define MAX_STANDARD_ID 0x7FFu
#define MAX_EXTENDED_ID 0x1FFFFFFFu
#define LAYOUT_AT 6u
#define CRC_AT 12u

static const uint8_t magic[4] = { 0x56u, 0x57u, 0x43u, 0x46u }; /* "VWCF" */

typedef struct {
    uint16_t offset;
    uint8_t size;
    bool is_signed;
    uint8_t count;
    int64_t minimum;
    int64_t maximum;
    bool is_live;
} rule_t;

#define RULE(name, offset, type, count, minimum, maximum, live) \
    { offset, (uint8_t)sizeof(type), (type)-1 < (type)1, count, minimum, maximum, (live) != 0 },
static const rule_t rules[] = { VW_CONFIG_FIELDS(RULE) };

typedef struct {
    uint16_t low;
    uint16_t high;
    bool is_strict;
} pair_t;

#define OFFSET(name) ((uint16_t)offsetof(vw_config_t, name))
static const pair_t pairs[] = {
    { OFFSET(v_cell_min), OFFSET(v_cell_max), true },
    { OFFSET(v_cell_chrg), OFFSET(v_cell_max), false },
    { OFFSET(t_cell_min), OFFSET(t_cell_max), true },
    { OFFSET(i_disc_min), OFFSET(i_disc_max), true },
    { OFFSET(i_chrg_min), OFFSET(i_chrg_max), false },
    { OFFSET(fan_ramp_start), OFFSET(fan_ramp_stop), true },
    { OFFSET(fan_ramp_min), OFFSET(fan_ramp_max), false },
};

static int64_t vw_config_read_element(const uint8_t *image, const rule_t *rule, size_t index)
{
    const uint8_t *at = image + rule->offset + index * rule->size;
    uint64_t raw = 0;
    unsigned i;
    for (i = 0; i < rule->size; i++) {
        raw |= (uint64_t)at[i] << (8u * i);
    }
    if (rule->is_signed && (at[rule->size - 1u] & 0x80u) != 0u) {
        return (int64_t)raw - ((int64_t)1 << (8u * rule->size));
    }
    return (int64_t)raw;
}

static const rule_t *vw_config_find_rule(uint16_t offset)
{
    size_t i = 0;
    while (rules[i].offset != offset) {
        i++;
    }
    return &rules[i];
}

static bool vw_config_is_valid(const rule_t *rule, int64_t value)
{
    if (value < rule->minimum || value > rule->maximum) {
        return false;
    }
    if (rule->offset == OFFSET(can_tx_msg_id) || rule->offset == OFFSET(can_rx_msg_id)) {
        uint32_t id = (uint32_t)value;
        return (id & VW_CAN_ID_EXTENDED) != 0u ? (id & ~VW_CAN_ID_EXTENDED) <= MAX_EXTENDED_ID : id <= MAX_STANDARD_ID;
    }
    if (rule->offset == OFFSET(can_tx_msg_data)) {
        return value == VW_BYTE_UNUSED || value < (int64_t)VW_MASTER_SIZE;
    }
    if (rule->offset == OFFSET(can_rx_msg_data)) {
        return value == VW_BYTE_UNUSED || (value >= (int64_t)VW_CONFIG_SIZE && value < (int64_t)VW_MASTER_SIZE);
    }
    if (rule->offset == OFFSET(can_rx_msg_response)) {
        return value == VW_NO_RESPONSE || (value & ~(int64_t)VW_RESPONSE_CHARGES) < (int64_t)VW_N_CAN_MESSAGES;
    }
    return true;
}

uint16_t vw_config_check(const uint8_t image[VW_CONFIG_SIZE])
{
    uint16_t first = VW_NO_OFFSET;
    size_t i, n;
    for (i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        for (n = 0; n < rules[i].count; n++) {
            uint16_t offset = (uint16_t)(rules[i].offset + n * rules[i].size);
            if (offset < first && !vw_config_is_valid(&rules[i], vw_config_read_element(image, &rules[i], n))) {
                first = offset;
            }
        }
    }
    for (i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        int64_t low = vw_config_read_element(image, vw_config_find_rule(pairs[i].low), 0u);
        int64_t high = vw_config_read_element(image, vw_config_find_rule(pairs[i].high), 0u);
        if ((low > high || (pairs[i].is_strict && low == high)) && pairs[i].low < first) {
            first = pairs[i].low;
        }
    }
    return first;
}

bool vw_config_is_live(const uint8_t before[VW_CONFIG_SIZE], const uint8_t after[VW_CONFIG_SIZE])
{
    size_t i;
    for (i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        const rule_t *rule = &rules[i];
        size_t size = (size_t)rule->size * rule->count;
        if (!rule->is_live && memcmp(before + rule->offset, after + rule->offset, size) != 0) {
            return false;
        }
    }
    return true;
}

void vw_config_clear_padding(uint8_t image[VW_CONFIG_SIZE])
{
    size_t at;
    for (at = OFFSET(can_rx_msg_en_startup) + 1u; at < OFFSET(telemetry_period); at++) {
        image[at] = 0u;
    }
}

static uint32_t vw_config_compute_slot_crc(const uint8_t *header, const uint8_t *image)
{
    uint32_t crc = vw_crc32_update(VW_CRC32_START, header, CRC_AT);
    return ~vw_crc32_update(crc, image, VW_CONFIG_SIZE);
}

void vw_slot_header(uint8_t header[VW_SLOT_HEADER_SIZE], const uint8_t image[VW_CONFIG_SIZE], uint32_t counter)
{
    (void)memcpy(header, magic, sizeof magic);
    vw_put_u16(header + 4, VW_CONFIG_SIZE);
    vw_put_u16(header + LAYOUT_AT, VW_EEPROM_LAYOUT_VERSION);
    vw_put_u32(header + 8, counter);
    vw_put_u32(header + CRC_AT, vw_config_compute_slot_crc(header, image));
}

static bool vw_config_is_layout_known(const uint8_t *header)
{
    uint16_t layout = vw_get_u16(header + LAYOUT_AT);
    return layout == VW_EEPROM_LAYOUT_VERSION || layout == VW_EEPROM_FIRST_LAYOUT;
}

uint32_t vw_slot_counter(const uint8_t header[VW_SLOT_HEADER_SIZE], const uint8_t image[VW_CONFIG_SIZE])
{
    bool is_valid = memcmp(header, magic, sizeof magic) == 0 && vw_get_u16(header + 4) == VW_CONFIG_SIZE
                    && vw_config_is_layout_known(header)
                    && vw_get_u32(header + CRC_AT) == vw_config_compute_slot_crc(header, image);
    return is_valid ? vw_get_u32(header + 8) : 0u;
}

void vw_slot_to_present(const uint8_t header[VW_SLOT_HEADER_SIZE], uint8_t image[VW_CONFIG_SIZE])
{
    static const vw_config_t defaults = VW_CONFIG_DEFAULTS;
    if (vw_get_u16(header + LAYOUT_AT) == VW_EEPROM_FIRST_LAYOUT) {
        vw_put_u16(image + OFFSET(telemetry_period), vw_get_u16(image + OFFSET(ts)));
        vw_put_u16(image + OFFSET(ts), defaults.ts);
    }
}

void vw_slot_encode(uint8_t slot[VW_EEPROM_SLOT_SIZE], const uint8_t image[VW_CONFIG_SIZE], uint32_t counter)
{
    (void)memset(slot, 0, VW_EEPROM_SLOT_SIZE);
    (void)memcpy(slot + VW_EEPROM_PAGE_SIZE, image, VW_CONFIG_SIZE);
    vw_config_clear_padding(slot + VW_EEPROM_PAGE_SIZE);
    vw_slot_header(slot, slot + VW_EEPROM_PAGE_SIZE, counter);
}

const uint8_t *vw_slot_image(const uint8_t slot[VW_EEPROM_SLOT_SIZE], uint32_t *counter)
{
    *counter = vw_slot_counter(slot, slot + VW_EEPROM_PAGE_SIZE);
    return *counter != 0u ? slot + VW_EEPROM_PAGE_SIZE : NULL;
}

int vw_slot_newest(const uint8_t slot_0[VW_EEPROM_SLOT_SIZE], const uint8_t slot_1[VW_EEPROM_SLOT_SIZE])
{
    uint32_t counter_0, counter_1;
    bool has_0 = vw_slot_image(slot_0, &counter_0) != NULL;
    bool has_1 = vw_slot_image(slot_1, &counter_1) != NULL;
    if (has_0 && (!has_1 || counter_0 >= counter_1)) {
        return 0;
    }
    return has_1 ? 1 : -1;
}
