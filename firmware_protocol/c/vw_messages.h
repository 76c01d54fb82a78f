/* Bodies of messages and requests, to be put into frames by vw_frame_encode; both directions. */
#ifndef VW_MESSAGES_H
#define VW_MESSAGES_H

#include "vw_codec.h"

#define VW_REPLY_HEADER_SIZE 5u

/* -- bodies, master to host ------------------------------------------------------------------------------------- */

/* Append one window of the struct to a DATA body of `length` bytes; returns its new length, 0 where it does not fit. */
size_t vw_data_append(uint8_t body[VW_MAX_BODY], size_t length, const uint8_t *master, uint16_t offset,
                      uint16_t count);

size_t vw_reply_body(uint8_t body[VW_MAX_BODY], const vw_frame_t *request, uint8_t result, uint16_t offset,
                     const uint8_t *data, size_t length);

typedef struct {
    uint8_t code;
    uint8_t argument;
    uint16_t cell;
    int32_t value;
    int32_t limit;
} vw_event_t;

size_t vw_event_body(uint8_t body[VW_MAX_BODY], const vw_event_t *event);

typedef struct {
    uint16_t protocol;
    uint8_t firmware[3];
    uint8_t map_hash[8];
    uint8_t reset_cause;
    uint32_t boots;
} vw_ident_t;

#define VW_IDENT_SIZE 18u
size_t vw_ident_data(uint8_t data[VW_IDENT_SIZE], const vw_ident_t *ident);

/* -- requests, host to master ----------------------------------------------------------------------------------- */

typedef struct {
    uint8_t type;
    uint16_t offset; /* READ, WRITE */
    uint16_t length; /* READ, WRITE */
    const uint8_t *data; /* WRITE; points into the frame's body */
    uint8_t command; /* COMMAND */
    int32_t argument; /* COMMAND */
} vw_request_t;

/* VW_RESULT_DONE, or the refusal to send back. `offset` gets the offset at fault. Ranges of values are not checked. */
enum vw_result vw_request_parse(const vw_frame_t *frame, vw_request_t *request, uint16_t *offset);

/* Returns the body's length, 0 also for requests without a body. */
size_t vw_request_body(uint8_t body[VW_MAX_BODY], const vw_request_t *request);

/* -- messages, on the host's side --------------------------------------------------------------------------------- */

typedef struct {
    uint16_t offset;
    uint16_t length;
    const uint8_t *data;
} vw_window_t;

/* Whether every window of a DATA frame is whole and inside the struct; where one is not, none counts. */
bool vw_data_is_valid(const vw_frame_t *frame);

/* The next window of a valid DATA frame, from `*position` = 0 on; false at the end. */
bool vw_data_next(const vw_frame_t *frame, size_t *position, vw_window_t *window);

typedef struct {
    uint8_t request_type;
    uint8_t request_sequence;
    uint8_t result;
    uint16_t offset;
    const uint8_t *data;
    uint16_t length;
} vw_reply_t;

bool vw_reply_parse(const vw_frame_t *frame, vw_reply_t *reply);
bool vw_event_parse(const vw_frame_t *frame, vw_event_t *event);
bool vw_ident_parse(const uint8_t *data, size_t length, vw_ident_t *ident);

#endif
