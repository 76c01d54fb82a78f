/* Faults on request, and the protection that answers them: limits with persistence, latched until cleared. */
#ifndef PROTECTION_H
#define PROTECTION_H

#include "../vw_link.h"

enum { WATCH_V_MIN, WATCH_V_MAX, WATCH_T_MIN, WATCH_T_MAX, WATCH_I, WATCH_SLAVE, N_WATCHES };

typedef struct {
    int v_cell, t_cell, slave; /* which is at fault, -1 none */
    uint16_t v;
    int8_t t;
    bool has_current;
    int32_t current;
} faults_t;

typedef struct {
    uint32_t since_ms[N_WATCHES];
    bool stands[N_WATCHES]; /* beyond its limit now */
    bool is_open; /* the latch */
} protection_t;

void faults_init(faults_t *faults);

/* "v CELL COUNTS", "t CELL DEGC", "i COUNTS", "slave PACK" or "clear"; false for anything else. */
bool faults_parse(faults_t *faults, const char *line);

/* Put the faults into what was measured. */
void faults_apply(const faults_t *faults, vw_master_t *master);

/* Judge what was measured; true when the circuit has just been opened. */
bool protection_judge(protection_t *protection, const vw_master_t *master, vw_link_t *link, uint32_t now_ms);

/* Close the latch; false while a limit is violated. */
bool protection_clear(protection_t *protection);

#endif
