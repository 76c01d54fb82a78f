/* Which parts of the struct the stream sends, and when: SPEC.md section 8. Knows time and lengths, no bytes. */
#ifndef VW_STREAM_H
#define VW_STREAM_H

#include <stdbool.h>
#include <stdint.h>

#include "generated/voltwall_protocol.h"

#define VW_STREAM_MAX_SPANS 4u

typedef struct {
    uint16_t offset;
    uint16_t length;
} vw_span_t;

typedef struct {
    uint16_t period_ms; /* may be changed while the stream runs */
    uint32_t fast_ms; /* when the next fast frame is due */
    uint32_t turn_ms; /* when the next slow turn may start */
    uint8_t range;
    uint16_t sent_of_range;
    uint8_t fast_in_a_row;
} vw_stream_t;

void vw_stream_start(vw_stream_t *stream, uint16_t period_ms, uint32_t now_ms);

/* Called when the line is free: the windows of the frame to be sent now, and how many; 0 while nothing is due. */
uint8_t vw_stream_take(vw_stream_t *stream, uint32_t now_ms, vw_span_t spans[VW_STREAM_MAX_SPANS]);

#endif
