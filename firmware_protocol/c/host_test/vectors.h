/* Reading the files in tests/vectors: flat objects of text and numbers. */
#ifndef HOST_TEST_VECTORS_H
#define HOST_TEST_VECTORS_H

#include "vw_messages.h"

/* The value of "key" in the flat object that begins at `object`, as text without quotes; "" where it is not there. */
const char *value_of(const char *object, const char *key);
unsigned long number_of(const char *object, const char *key);

/* NULL after the last. */
const char *first_vector(const char *folder, const char *name);
const char *next_vector(const char *object);

/* Exits with the name of the vector where a claim does not hold. */
void expect(bool holds, const char *file, const char *object);

/* A frame against the fields that its vector names, there and back. */
void check_message(const vw_frame_t *frame, const char *file, const char *v);

/* Each returns how many vectors it read. */
unsigned check_whole_frames(const char *folder);
unsigned check_config_limits(const char *folder);
unsigned check_eeprom_images(const char *folder);
unsigned check_journal(const char *folder);
unsigned check_can_frames(const char *folder);

#endif
