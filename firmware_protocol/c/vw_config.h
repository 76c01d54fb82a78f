/* The configuration on the master's side: the check before a WRITE or LOAD takes effect, and its slots in the EEPROM. */
#ifndef VW_CONFIG_H
#define VW_CONFIG_H

#include <stdbool.h>
#include <stdint.h>

#include "generated/voltwall_protocol.h"

/* Offset of the first element that must be refused with OUT_OF_RANGE, VW_NO_OFFSET where the image is good. */
uint16_t vw_config_check(const uint8_t image[VW_CONFIG_SIZE]);

/* Whether two images differ only in fields that may be changed while the car drives or charges. */
bool vw_config_is_live(const uint8_t before[VW_CONFIG_SIZE], const uint8_t after[VW_CONFIG_SIZE]);

/* Set what lies between the fields to 0. */
void vw_config_clear_padding(uint8_t image[VW_CONFIG_SIZE]);

#define VW_SLOT_HEADER_SIZE 16u

/* The header of a slot with this image, whose padding is 0. */
void vw_slot_header(uint8_t header[VW_SLOT_HEADER_SIZE], const uint8_t image[VW_CONFIG_SIZE], uint32_t counter);

/* The counter of a valid slot, 0 where header and image make none. */
uint32_t vw_slot_counter(const uint8_t header[VW_SLOT_HEADER_SIZE], const uint8_t image[VW_CONFIG_SIZE]);

/* Turn the image of a valid slot of layout 1 into one of this layout: its `ts` was the telemetry period. Any other
 * stays. Before the check: the image in the slot may be of either. */
void vw_slot_to_present(const uint8_t header[VW_SLOT_HEADER_SIZE], uint8_t image[VW_CONFIG_SIZE]);

/* A slot as it stands in the EEPROM. Write it so that a power cut leaves the old or the new configuration, never a
 * mixture: zeros over the first page of the slot that is not the newest, then pages 1 to 7, then page 0. */
void vw_slot_encode(uint8_t slot[VW_EEPROM_SLOT_SIZE], const uint8_t image[VW_CONFIG_SIZE], uint32_t counter);

/* The image inside a valid slot, as it stands there, NULL where it is not valid. */
const uint8_t *vw_slot_image(const uint8_t slot[VW_EEPROM_SLOT_SIZE], uint32_t *counter);

/* Index of the newest valid slot, -1 without one. */
int vw_slot_newest(const uint8_t slot_0[VW_EEPROM_SLOT_SIZE], const uint8_t slot_1[VW_EEPROM_SLOT_SIZE]);

#endif
