/* A pseudo-terminal behind a link, which looks like a serial port to whoever opens it. */
#ifndef PTY_H
#define PTY_H

#include <stdbool.h>

typedef struct {
    int master;
    int slave; /* kept open, so that the port outlives its readers */
    const char *link;
} pty_t;

/* Replaces a link that is there already, never a file. False, with a message on stderr, where that fails. */
bool pty_open(pty_t *pty, const char *link);

/* Now and then: lets the next program that opens the port set its speed and parity. */
void pty_tend(const pty_t *pty);

void pty_close(const pty_t *pty);

#endif
