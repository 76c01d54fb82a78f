#include "protection.h"

#include <stdio.h>
#include <string.h>

/* FS rules EV 5.8.7: 500 ms and 1 s from the violation; what measuring takes of it is left out of the persistence. */
#define FAST_MS 300u
#define SLOW_MS 400u
#define ALLOWED_MS 380u /* to the OK signal, without the pass; the relays and who has to show it get the rest */

typedef struct {
    bool stands;
    uint8_t event;
    uint32_t persistence_ms;
    uint16_t cell;
    int32_t value, limit;
} violation_t;

void faults_init(faults_t *faults)
{
    memset(faults, 0, sizeof *faults);
    faults->v_cell = faults->t_cell = faults->slave = -1;
}

bool faults_parse(faults_t *faults, const char *line)
{
    int place, value;
    if (strncmp(line, "clear", 5u) == 0) {
        faults_init(faults);
    } else if (sscanf(line, "v %d %d", &place, &value) == 2 && place >= 0 && place < (int)VW_N_CELLS) {
        faults->v_cell = place;
        faults->v = (uint16_t)value;
    } else if (sscanf(line, "t %d %d", &place, &value) == 2 && place >= 0 && place < (int)VW_N_CELLS) {
        faults->t_cell = place;
        faults->t = (int8_t)value;
    } else if (sscanf(line, "i %d", &value) == 1) {
        faults->has_current = true;
        faults->current = value;
    } else if (sscanf(line, "slave %d", &place) == 1 && place >= 0 && place < (int)VW_N_PACKS) {
        faults->slave = place;
    } else {
        return false;
    }
    return true;
}

void faults_apply(const faults_t *faults, vw_master_t *master)
{
    unsigned i;
    if (faults->v_cell >= 0) {
        master->v[faults->v_cell] = faults->v;
    }
    for (i = 0; i < VW_N_CELLS; i++) {
        master->t[i] = (int8_t)((int)i == faults->t_cell ? faults->t : 24 + (int)(i / VW_CELLS_PER_PACK) % 3);
    }
    for (i = 0; i < VW_N_PACKS; i++) {
        master->slave[i].status = (int)i == faults->slave ? 255u : 1u;
    }
    for (i = 0; faults->slave >= 0 && i < VW_CELLS_PER_PACK; i++) {
        master->v[(unsigned)faults->slave * VW_CELLS_PER_PACK + i] = VW_V_MISSING;
    }
}

/* What the mean of the current leaves of the time allowed: a violation begins anywhere in the first of its buffers. */
static uint32_t current_ms(const vw_config_t *conf)
{
    uint32_t averaged = conf->ts;
    while (averaged < (uint32_t)conf->fc_avg) {
        averaged += conf->ts;
    }
    if (averaged + conf->ts >= ALLOWED_MS) {
        return 0u;
    }
    return averaged + conf->ts > ALLOWED_MS - FAST_MS ? ALLOWED_MS - averaged - conf->ts : FAST_MS;
}

static void find(const vw_master_t *master, violation_t found[N_WATCHES])
{
    const vw_config_t *conf = &master->conf;
    int32_t limit = master->i_fc > 0 ? conf->i_disc_max : conf->i_disc_min;
    unsigned i;
    memset(found, 0, N_WATCHES * sizeof *found);
    for (i = 0; i < VW_N_CELLS; i++) {
        uint16_t v = master->v[i], cell = (uint16_t)i;
        int8_t t = master->t[i];
        if (v != VW_V_MISSING && v < conf->v_cell_min) {
            found[WATCH_V_MIN] = (violation_t){ true, VW_EVENT_TRIP_V_MIN, FAST_MS, cell, v, conf->v_cell_min };
        }
        if (v > conf->v_cell_max) {
            found[WATCH_V_MAX] = (violation_t){ true, VW_EVENT_TRIP_V_MAX, FAST_MS, cell, v, conf->v_cell_max };
        }
        if (t < conf->t_cell_min) {
            found[WATCH_T_MIN] = (violation_t){ true, VW_EVENT_TRIP_T_MIN, SLOW_MS, cell, t, conf->t_cell_min };
        }
        if (t > conf->t_cell_max) {
            found[WATCH_T_MAX] = (violation_t){ true, VW_EVENT_TRIP_T_MAX, SLOW_MS, cell, t, conf->t_cell_max };
        }
        if (master->slave[i / VW_CELLS_PER_PACK].status != 1u) {
            uint16_t first = (uint16_t)(i / VW_CELLS_PER_PACK * VW_CELLS_PER_PACK);
            found[WATCH_SLAVE] = (violation_t){ true, VW_EVENT_TRIP_SLAVE_LOST, FAST_MS, first, 0, 0 };
        }
    }
    if (master->i_fc > conf->i_disc_max || master->i_fc < conf->i_disc_min) {
        found[WATCH_I] =
            (violation_t){ true, VW_EVENT_TRIP_I_DISC, current_ms(conf), VW_NO_OFFSET, master->i_fc, limit };
    }
}

bool protection_judge(protection_t *protection, const vw_master_t *master, vw_link_t *link, uint32_t now_ms)
{
    violation_t found[N_WATCHES];
    bool was_open = protection->is_open;
    unsigned i;
    find(master, found);
    for (i = 0; i < N_WATCHES; i++) {
        if (found[i].stands && !protection->stands[i]) {
            protection->since_ms[i] = now_ms;
        }
        protection->stands[i] = found[i].stands;
        if (found[i].stands && !protection->is_open && now_ms - protection->since_ms[i] >= found[i].persistence_ms) {
            protection->is_open = true;
            vw_link_event(link, found[i].event, found[i].cell, found[i].value, found[i].limit);
        }
    }
    return protection->is_open && !was_open;
}

bool protection_clear(protection_t *protection)
{
    unsigned i;
    for (i = 0; i < N_WATCHES; i++) {
        if (protection->stands[i]) {
            return false;
        }
    }
    protection->is_open = false;
    return true;
}
