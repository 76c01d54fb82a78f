/* Reading the files in tests/vectors: flat objects of text and numbers. */
#ifndef HOST_TEST_VECTORS_H
#define HOST_TEST_VECTORS_H

#include "vw_messages.h"

/* The value of "key" in the flat object that begins at `object`, as text without quotes; "" where it is not there. */
const char *vw_vectors_find_value(const char *object, const char *key);
unsigned long vw_vectors_find_number(const char *object, const char *key);

/* NULL after the last. */
const char *vw_vectors_read_first(const char *folder, const char *name);
const char *vw_vectors_read_next(const char *object);

/* Exits with the name of the vector where a claim does not hold. */
void vw_vectors_expect(bool holds, const char *file, const char *object);

/* A frame against the fields that its vector names, there and back. */
void vw_vectors_check_message(const vw_frame_t *frame, const char *file, const char *v);

/* Each returns how many vectors it read. */
unsigned vw_images_check_whole_frames(const char *folder);
unsigned vw_images_check_config_limits(const char *folder);
unsigned vw_images_check_eeprom(const char *folder);
unsigned vw_images_check_journal(const char *folder);
unsigned vw_images_check_can_frames(const char *folder);

#endif
