/* What the master does with a request: check, carry out once, reply. SPEC.md sections 5, 6 and 8; called by vw_link. */
#ifndef VW_ANSWER_H
#define VW_ANSWER_H

#include "vw_link.h"

/* A frame from the host: carry it out, or repeat the reply to one that was carried out already. */
void vw_answer_request(vw_link_t *link, const vw_frame_t *frame);

/* The STORE under way is over. */
void vw_answer_store(vw_link_t *link, enum vw_result result);

#endif
