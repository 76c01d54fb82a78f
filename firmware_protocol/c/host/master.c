/* A master on a PC: the library of this folder over a pseudo-terminal, with its EEPROM in a file.
 *
 *     master --serial LINK [--eeprom FILE]     then: voltwall serve --serial LINK
 *
 * For firmware authors to compare theirs with, and for the tests. Leaves with 9 when the power was cut.
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "battery.h"
#include "eeprom_file.h"
#include "pty.h"

#define MEASURE_MS 20u
#define STEP_US 1000u /* a PC that is busy elsewhere does not make a pass longer: what was missed is made up in steps */
#define POWER_LOST 9
#define COMMANDED 3u

typedef struct {
    eeprom_file_t eeprom; /* first: the EEPROM's functions get this as their context */
    battery_t battery;
    bool is_restarting;
} pc_t;

static pc_t pc;
static vw_master_t memory;
static vw_link_t line;
static vw_can_t can;
static volatile sig_atomic_t is_stopping;

static const char usage[] =
    "usage: master --serial LINK | --fd N   a pseudo-terminal behind LINK, or an open socket\n"
    "  [--eeprom FILE]     where the EEPROM's content is kept; else it is lost at the end\n"
    "  [--page-ms MS]      time of a page write, 5 without it\n"
    "  [--cut-after N]     the power fails when N bytes have been written to the EEPROM: exit status 9\n"
    "  [--cut-byte B]      what the byte under way is left as, 0..255\n"
    "  [--worn]            the EEPROM keeps what it holds\n"
    "  [--no-eeprom]       the EEPROM does not answer\n"
    "  [--driving]         the driver asks for the relays to close: configuration and charging are refused\n"
    "  [--other-map]       another memory map's hash in IDENT\n";

static void on_signal(int signal_number)
{
    (void)signal_number;
    is_stopping = 1;
}

static bool may_configure(void *context)
{
    return vw_master_may_configure(&((pc_t *)context)->battery.task);
}

static void restart(void *context)
{
    ((pc_t *)context)->is_restarting = true;
}

#define COMMAND(name, code, low, high) \
    static enum vw_result do_##name(void *context, int32_t argument) \
    { \
        return battery_command(&((pc_t *)context)->battery, code, argument); \
    }
VW_COMMANDS(COMMAND)

#define MEMBER(name, code, low, high) .name = do_##name,
static const vw_board_t board = {
    .context = &pc,
    .may_configure = may_configure,
    .eeprom_read = eeprom_file_read,
    .eeprom_write = eeprom_file_write,
    .eeprom_is_busy = eeprom_file_is_busy,
    .restart = restart,
    .commands = { VW_COMMANDS(MEMBER) },
};

static uint64_t clock_us(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

typedef struct {
    const char *link;
    int fd;
    bool is_driving;
    bool has_other_map;
} options_t;

static void boot(const options_t *options, uint8_t cause)
{
    static uint32_t boots;
    vw_ident_t ident = { .firmware = { 1u, 0u, 0u } };
    ident.reset_cause = cause;
    ident.boots = ++boots;
    vw_link_init(&line, &board, &memory, &can, &ident);
    if (options->has_other_map) {
        line.answer.ident.map_hash[0] ^= 0xFFu;
    }
    battery_init(&pc.battery, &line, options->is_driving, pc.battery.task.protection.is_open);
    vw_can_init(&can, &board, &memory);
    battery_measure(&pc.battery, 0u);
    pc.is_restarting = false;
}

/* Read what has come; false when the other end is gone for good. */
static bool receive(int fd, uint32_t now_ms)
{
    uint8_t data[512];
    ssize_t n = read(fd, data, sizeof data);
    if (n > 0) {
        vw_link_received(&line, now_ms, data, (size_t)n);
    }
    return n > 0 || (n < 0 && (errno == EAGAIN || errno == EINTR));
}

/* What nobody takes in time is lost, as on a real line. */
static size_t transmit(int fd, uint32_t now_ms)
{
    static uint8_t frame[VW_MAX_FRAME];
    size_t n = vw_link_next(&line, now_ms, frame);
    if (n != 0u && write(fd, frame, n) < 0 && errno != EAGAIN) {
        return 0u;
    }
    return n;
}

static int run(const options_t *options, const pty_t *pty, int fd)
{
    uint64_t start_us = clock_us(), now_us = 0u, busy_until_us = 0u;
    uint32_t measured_ms = 0u;
    struct pollfd waiting = { .fd = fd, .events = POLLIN };
    boot(options, 0u);
    while (!is_stopping) {
        uint64_t passed_us = clock_us() - start_us;
        bool is_late = passed_us > now_us + STEP_US;
        uint32_t now_ms;
        now_us = is_late ? now_us + STEP_US : passed_us;
        now_ms = (uint32_t)(now_us / 1000u);
        pc.eeprom.now_ms = now_ms;
        if (poll(&waiting, 1u, is_late || vw_store_is_busy(&line.answer.store) ? 0 : 1) > 0 && !receive(fd, now_ms)) {
            break;
        }
        vw_link_run(&line, now_ms);
        if (pc.eeprom.is_power_lost) {
            return POWER_LOST;
        }
        if (now_ms - measured_ms >= MEASURE_MS) {
            measured_ms = now_ms;
            battery_measure(&pc.battery, now_ms);
        }
        if (now_us >= busy_until_us) {
            size_t n = transmit(fd, now_ms);
            busy_until_us = now_us + n * VW_BITS_PER_BYTE * 1000000u / VW_BAUD_RATE;
        }
        if (pc.is_restarting) {
            start_us = clock_us();
            now_us = busy_until_us = 0u;
            measured_ms = 0u;
            boot(options, COMMANDED);
        }
        if (pty != NULL) {
            vw_can_frame_t frame;
            pty_tend(pty);
            while (vw_can_next(&can, now_ms, &frame)) { /* no bus on a PC */
            }
        }
    }
    return 0;
}

static bool parse(int argc, char **argv, options_t *options, const char **eeprom_path)
{
    int i;
    for (i = 1; i < argc; i++) {
        const char *name = argv[i];
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (strcmp(name, "--driving") == 0) {
            options->is_driving = true;
            continue;
        }
        if (strcmp(name, "--other-map") == 0) {
            options->has_other_map = true;
            continue;
        }
        if (strcmp(name, "--worn") == 0) {
            pc.eeprom.is_worn = true;
            continue;
        }
        if (strcmp(name, "--no-eeprom") == 0) {
            pc.eeprom.is_unplugged = true;
            continue;
        }
        if (value == NULL) {
            return false;
        }
        i++;
        if (strcmp(name, "--serial") == 0) {
            options->link = value;
        } else if (strcmp(name, "--fd") == 0) {
            options->fd = atoi(value);
        } else if (strcmp(name, "--eeprom") == 0) {
            *eeprom_path = value;
        } else if (strcmp(name, "--page-ms") == 0) {
            pc.eeprom.page_ms = (uint32_t)strtoul(value, NULL, 10);
        } else if (strcmp(name, "--cut-after") == 0) {
            pc.eeprom.cut_after = (int32_t)strtol(value, NULL, 10);
        } else if (strcmp(name, "--cut-byte") == 0) {
            pc.eeprom.cut_byte = (uint8_t)strtoul(value, NULL, 10);
        } else {
            return false;
        }
    }
    return (options->link == NULL) != (options->fd < 0);
}

int main(int argc, char **argv)
{
    options_t options = { .fd = -1 };
    const char *eeprom_path = NULL;
    pty_t pty;
    int result, fd;
    pc.eeprom.page_ms = 5u;
    pc.eeprom.cut_after = -1;
    if (!parse(argc, argv, &options, &eeprom_path)) {
        fputs(usage, stderr);
        return 2;
    }
    if (!eeprom_file_open(&pc.eeprom, eeprom_path)) {
        perror(eeprom_path);
        return 1;
    }
    if (options.link != NULL && !pty_open(&pty, options.link)) {
        return 1;
    }
    fd = options.link != NULL ? pty.master : options.fd;
    (void)signal(SIGTERM, on_signal);
    (void)signal(SIGINT, on_signal);
    (void)signal(SIGPIPE, SIG_IGN);
    puts("ready");
    (void)fflush(stdout);
    result = run(&options, options.link != NULL ? &pty : NULL, fd);
    if (options.link != NULL) {
        pty_close(&pty);
    }
    return result;
}
