#include "vw_fans.h"

#include <string.h>

#include "../vw_time.h"

#define MS_PER_S 1000u

void vw_fans_init(vw_fans_t *fans)
{
    (void)memset(fans, 0, sizeof *fans);
}

void vw_fans_command(vw_fans_t *fans, int32_t argument, uint32_t now_ms)
{
    uint32_t raw = (uint32_t)argument, seconds = raw >> 8;
    fans->is_overridden = argument != VW_FANS_AUTOMATIC;
    fans->override = (uint8_t)(raw & 0xFFu);
    fans->has_end = fans->is_overridden && seconds != 0u;
    fans->until_ms = now_ms + seconds * MS_PER_S;
}

/* Rounded to the nearest, a half upwards. */
static uint8_t vw_fans_compute_duty(const vw_config_t *conf, int8_t t_max)
{
    int32_t above = (int32_t)t_max - conf->fan_ramp_start;
    int32_t width = (int32_t)conf->fan_ramp_stop - conf->fan_ramp_start; /* above 0: vw_config_check */
    int32_t rise = (int32_t)conf->fan_ramp_max - conf->fan_ramp_min;     /* not below 0, neither */
    if (above <= 0) {
        return conf->fan_ramp_min;
    }
    if (above >= width) {
        return conf->fan_ramp_max;
    }
    return (uint8_t)(conf->fan_ramp_min + (2 * above * rise + width) / (2 * width));
}

uint8_t vw_fans_duty(vw_fans_t *fans, const vw_config_t *conf, int8_t t_max, uint32_t now_ms)
{
    if (fans->has_end && vw_is_due(now_ms, fans->until_ms)) {
        vw_fans_init(fans);
    }
    return fans->is_overridden ? fans->override : vw_fans_compute_duty(conf, t_max);
}
