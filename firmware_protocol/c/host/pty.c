#define _XOPEN_SOURCE 700
#include "pty.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

static void make_raw(int terminal)
{
    struct termios settings;
    if (tcgetattr(terminal, &settings) == 0) {
        settings.c_iflag &= (tcflag_t) ~(BRKINT | ICRNL | INLCR | IGNCR | INPCK | ISTRIP | IXON);
        settings.c_oflag &= (tcflag_t)~OPOST;
        settings.c_lflag &= (tcflag_t) ~(ECHO | ICANON | IEXTEN | ISIG);
        settings.c_cc[VMIN] = 1;
        settings.c_cc[VTIME] = 0;
        (void)tcsetattr(terminal, TCSANOW, &settings);
    }
}

bool pty_open(pty_t *pty, const char *link)
{
    const char *name;
    struct stat there;
    pty->link = link;
    pty->slave = -1;
    pty->master = posix_openpt(O_RDWR | O_NOCTTY);
    if (pty->master < 0 || grantpt(pty->master) != 0 || unlockpt(pty->master) != 0) {
        perror("pseudo-terminal");
        return false;
    }
    name = ptsname(pty->master);
    pty->slave = name == NULL ? -1 : open(name, O_RDWR | O_NOCTTY);
    if (pty->slave < 0 || fcntl(pty->master, F_SETFL, O_NONBLOCK) != 0) {
        perror("pseudo-terminal");
        return false;
    }
    make_raw(pty->slave);
    if (lstat(link, &there) == 0 && (!S_ISLNK(there.st_mode) || unlink(link) != 0)) {
        fprintf(stderr, "%s: in the way, and no link\n", link);
        return false;
    }
    if (symlink(name, link) != 0) {
        perror(link);
        return false;
    }
    return true;
}

void pty_tend(const pty_t *pty)
{
    /* A pseudo-terminal keeps no parity: setting it succeeds only together with something that does change. */
    struct termios settings;
    if (tcgetattr(pty->slave, &settings) == 0 && cfgetospeed(&settings) != B50) {
        (void)cfsetispeed(&settings, B50);
        (void)cfsetospeed(&settings, B50);
        (void)tcsetattr(pty->slave, TCSANOW, &settings);
    }
}

void pty_close(const pty_t *pty)
{
    char target[256];
    const char *name = ptsname(pty->master);
    ssize_t n = readlink(pty->link, target, sizeof target - 1u);
    if (n > 0 && name != NULL) {
        target[n] = '\0';
        if (strcmp(target, name) == 0) {
            (void)unlink(pty->link);
        }
    }
    (void)close(pty->slave);
    (void)close(pty->master);
}
