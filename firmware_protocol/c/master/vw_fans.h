/* The fans: a duty over the hottest cell's temperature, or by command for a time. */
#ifndef VW_FANS_H
#define VW_FANS_H

#include <stdbool.h>

#include "../generated/voltwall_protocol.h"

#define VW_FANS_AUTOMATIC (-1)

typedef struct {
    bool is_overridden;
    bool has_end;
    uint8_t override; /* [1/255] */
    uint32_t until_ms;
} vw_fans_t;

void vw_fans_init(vw_fans_t *fans);

/* The argument of FAN_OVERRIDE: a duty, and above it for how many seconds (0: until taken back); or VW_FANS_AUTOMATIC. */
void vw_fans_command(vw_fans_t *fans, int32_t argument, uint32_t now_ms);

/* The duty in force [1/255]: lowest up to fan_ramp_start, highest from fan_ramp_stop on, linear between. */
uint8_t vw_fans_duty(vw_fans_t *fans, const vw_config_t *conf, int8_t t_max, uint32_t now_ms);

#endif
