/* Bytes as text, and what a decoder finds as text: what both halves of host_test speak. */
#ifndef HOST_TEST_TEXT_H
#define HOST_TEST_TEXT_H

#include "vw_codec.h"

#define MAX_TEXT 131072u

typedef struct {
    char text[4u * MAX_TEXT];
    size_t length;
} items_t;

extern items_t items;                /* what the decoder found, or bytes made into text */
extern uint8_t bytes[MAX_TEXT / 2u]; /* of the line or vector at hand */

/* Up to the first character that is no pair of hex digits; returns how many bytes. */
size_t vw_text_read_hex(const char *hex, uint8_t *out);

void vw_text_clear_items(void);
void vw_text_add_hex(const uint8_t *data, size_t length);

/* Put the items of a decoder that is fed in pieces of `size` bytes into `items`; returns the bytes it dropped. */
uint32_t vw_text_run_decoder(vw_side_t side, bool idle, size_t size, const uint8_t *wire, size_t length);

/* Check against the shared vectors; returns the exit status, and exits on the first difference. */
int vw_vectors_run(const char *folder);

/* Answer each line of stdin; returns the exit status. */
int vw_driver_run(void);

#endif
