/* Faults on request, in what was measured. */
#ifndef FAULTS_H
#define FAULTS_H

#include <stdbool.h>

#include "../generated/voltwall_protocol.h"

typedef struct {
    int v_cell, t_cell, slave; /* which is at fault, -1 none */
    uint16_t v;
    int8_t t;
    bool has_current;
    int32_t current;
} faults_t;

void faults_init(faults_t *faults);

/* "v CELL COUNTS", "t CELL DEGC", "i COUNTS", "slave PACK" or "clear"; false for anything else. */
bool faults_parse(faults_t *faults, const char *line);

/* Put the faults into the measured voltages and temperatures; the current's is its samples'. */
void faults_apply(const faults_t *faults, vw_master_t *master);

#endif
