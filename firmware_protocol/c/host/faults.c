#include "faults.h"

#include <stdio.h>
#include <string.h>

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
