#include "vw_stream.h"

#include "vw_time.h"

#define WINDOW_HEADER 4u
#define FRAME_OVERHEAD 11u /* header 6, CRC 2, two delimiters, one byte of COBS: a slow frame is shorter than 254 */
#define MAX_ROOM_MS 1000u

static const vw_span_t fast_windows[] = VW_STREAM_FAST_WINDOWS;
static const vw_span_t slow_ranges[] = VW_STREAM_SLOW_RANGES;

#define N_FAST (sizeof fast_windows / sizeof fast_windows[0])
#define N_SLOW (sizeof slow_ranges / sizeof slow_ranges[0])

VW_ASSERT(stream_spans, N_FAST <= VW_STREAM_MAX_SPANS);

void vw_stream_start(vw_stream_t *stream, uint16_t period_ms, uint32_t now_ms)
{
    stream->period_ms = period_ms;
    stream->fast_ms = now_ms;
    stream->turn_ms = now_ms;
    stream->range = 0u;
    stream->sent_of_range = 0u;
    stream->fast_in_a_row = 0u;
}

static bool vw_stream_is_turn_start(const vw_stream_t *stream)
{
    return stream->range == 0u && stream->sent_of_range == 0u;
}

/* Bytes of the struct that a slow frame may carry and still end before the next fast one is due. */
static uint32_t vw_stream_compute_room(const vw_stream_t *stream, uint32_t now_ms)
{
    uint32_t left_ms, bytes;
    if (stream->fast_in_a_row >= VW_STREAM_FAST_PER_SLOW) {
        return VW_STREAM_SLOW_LENGTH;
    }
    if (vw_is_due(now_ms, stream->fast_ms)) {
        return 0u;
    }
    left_ms = stream->fast_ms - now_ms;
    if (left_ms > MAX_ROOM_MS) {
        return VW_STREAM_SLOW_LENGTH;
    }
    bytes = left_ms * VW_BAUD_RATE / (VW_BITS_PER_BYTE * 1000u);
    if (bytes < WINDOW_HEADER + FRAME_OVERHEAD) {
        return 0u;
    }
    bytes -= WINDOW_HEADER + FRAME_OVERHEAD;
    return bytes < VW_STREAM_SLOW_LENGTH ? bytes : VW_STREAM_SLOW_LENGTH;
}

static uint16_t vw_stream_compute_slow_length(const vw_stream_t *stream, uint32_t now_ms)
{
    uint32_t bytes = vw_stream_compute_room(stream, now_ms);
    uint32_t left = (uint32_t)slow_ranges[stream->range].length - stream->sent_of_range;
    if (left <= bytes) {
        return (uint16_t)left;
    }
    return bytes >= VW_STREAM_SLOW_WORTHWHILE ? (uint16_t)(bytes - bytes % VW_STREAM_ALIGNMENT) : 0u;
}

static void vw_stream_take_slow_span(vw_stream_t *stream, uint32_t now_ms, uint16_t length, vw_span_t *span)
{
    const vw_span_t *range = &slow_ranges[stream->range];
    if (vw_stream_is_turn_start(stream)) {
        stream->turn_ms = now_ms + VW_STREAM_TURN_MS;
    }
    span->offset = (uint16_t)(range->offset + stream->sent_of_range);
    span->length = length;
    stream->sent_of_range = (uint16_t)(stream->sent_of_range + length);
    if (stream->sent_of_range == range->length) {
        stream->range = (uint8_t)((stream->range + 1u) % N_SLOW);
        stream->sent_of_range = 0u;
    }
    stream->fast_in_a_row = 0u;
}

uint8_t vw_stream_take(vw_stream_t *stream, uint32_t now_ms, vw_span_t spans[VW_STREAM_MAX_SPANS])
{
    uint8_t i;
    if (!vw_stream_is_turn_start(stream) || vw_is_due(now_ms, stream->turn_ms)) {
        uint16_t length = vw_stream_compute_slow_length(stream, now_ms);
        if (length != 0u) {
            vw_stream_take_slow_span(stream, now_ms, length, &spans[0]);
            return 1u;
        }
    }
    if (!vw_is_due(now_ms, stream->fast_ms)) {
        return 0u;
    }
    stream->fast_ms += stream->period_ms;
    if (vw_is_due(now_ms, stream->fast_ms)) {
        stream->fast_ms = now_ms;
    }
    if (stream->fast_in_a_row < VW_STREAM_FAST_PER_SLOW) {
        stream->fast_in_a_row++;
    }
    for (i = 0u; i < N_FAST; i++) {
        spans[i] = fast_windows[i];
    }
    return (uint8_t)N_FAST;
}
