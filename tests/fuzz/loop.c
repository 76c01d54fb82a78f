/* Fuzzing by coverage with gcc alone: vw_fuzz TARGET SECONDS FOUND FOLDER..., libFuzzer's entry point for each target.
 *
 * gcc calls __sanitizer_cov_trace_pc at every block of the library; what reaches a new pair of blocks, or one of them
 * more often by a power of two, is kept and changed further. A sanitizer ends the process; what it was given last is
 * then in FOUND/TARGET-find. With 0 seconds every file of the folders is tried once.
 */
#define _POSIX_C_SOURCE 200809L
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <fcntl.h>
#include <time.h>
#include <unistd.h>

#include "targets.h"

#define MAP 8192u
#define MOST 2048u
#define KEPT 4096u
#define INPUT_S 60u /* an input takes microseconds */

void __sanitizer_cov_trace_pc(void);

static uint8_t hits[MAP], seen[MAP];
static uintptr_t before;
static struct {
    uint8_t *data;
    size_t length;
} kept[KEPT];
static size_t n_kept;
static struct {
    uint32_t length;
    uint8_t data[MOST];
} * tried; /* in a file, which stays when the process is ended */
static uint64_t chance = 88172645463325252u;

void __sanitizer_cov_trace_pc(void)
{
    uintptr_t here = (uintptr_t)__builtin_return_address(0);
    uint32_t place = (uint32_t)((here ^ (before >> 1) ^ (here >> 16)) % MAP);
    before = here;
    if (hits[place] != 255u) {
        hits[place]++;
    }
}

static uint32_t any(uint32_t below)
{
    chance ^= chance << 13;
    chance ^= chance >> 7;
    chance ^= chance << 17;
    return below == 0u ? 0u : (uint32_t)(chance >> 33) % below;
}

static uint8_t bucket(uint8_t n)
{
    uint8_t bit = 0;
    while (n != 0u) {
        bit++;
        n >>= 1;
    }
    return bit == 0u ? 0u : (uint8_t)(1u << (bit - 1u));
}

/* Whether an input reached something new. */
static int is_new(vw_fuzz_target_t target, const uint8_t *data, size_t length)
{
    int found = 0;
    uint8_t *exact = malloc(length == 0u ? 1u : length); /* so that one byte beyond is seen */
    size_t i;
    if (exact == NULL) {
        abort();
    }
    if (length != 0u) {
        memcpy(exact, data, length);
        memcpy(tried->data, data, length);
    }
    tried->length = (uint32_t)length;
    memset(hits, 0, sizeof hits);
    before = 0u;
    alarm(INPUT_S); /* SIGALRM ends the process as a sanitizer does */
    target(exact, length);
    alarm(0);
    free(exact);
    for (i = 0; i < MAP; i++) {
        uint8_t now = bucket(hits[i]);
        if ((now & (uint8_t)~seen[i]) != 0u) {
            seen[i] |= now;
            found = 1;
        }
    }
    return found;
}

static void keep(const uint8_t *data, size_t length)
{
    size_t slot = n_kept < KEPT ? n_kept++ : any(KEPT);
    free(kept[slot].data);
    kept[slot].data = malloc(length + 1u);
    if (kept[slot].data == NULL) {
        abort();
    }
    memcpy(kept[slot].data, data, length);
    kept[slot].length = length;
}

static size_t changed(uint8_t *data, size_t length)
{
    static const uint8_t odd[] = { 0x00, 0x01, 0x7F, 0x80, 0xFF, 'x', 'y', 0x10, 0x20, 0x40 };
    uint32_t rounds = 1u + any(6u);
    while (rounds-- != 0u) {
        uint32_t at = any((uint32_t)length), n = 1u + any(16u);
        switch (any(8u)) {
        case 0: if (length != 0u) data[at] ^= (uint8_t)(1u << any(8u)); break;
        case 1: if (length != 0u) data[at] = (uint8_t)any(256u); break;
        case 2: if (length != 0u) data[at] = odd[any(sizeof odd)]; break;
        case 3: if (length != 0u) data[at] = (uint8_t)(data[at] + any(9u) - 4u); break;
        case 4: /* cut */
            n = n > length - at ? (uint32_t)(length - at) : n;
            memmove(data + at, data + at + n, length - at - n);
            length -= n;
            break;
        case 5: /* insert */
            if (length + n <= MOST) {
                memmove(data + at + n, data + at, length - at);
                memset(data + at, any(2u) != 0u ? (int)any(256u) : 0, n);
                length += n;
            }
            break;
        case 6: /* a piece of another one */
            if (n_kept != 0u) {
                size_t other = any((uint32_t)n_kept), from = any((uint32_t)kept[other].length);
                size_t count = kept[other].length - from;
                count = count > MOST - at ? MOST - at : count;
                memmove(data + at, kept[other].data + from, count);
                length = at + count > length ? at + count : length;
            }
            break;
        default:
            if (length >= 2u) { /* a number of two bytes */
                at = any((uint32_t)length - 1u);
                data[at] = odd[any(sizeof odd)];
                data[at + 1u] = odd[any(sizeof odd)];
            }
            break;
        }
    }
    return length;
}

static void put(const char *folder, const char *name, const char *what, const uint8_t *data, size_t length)
{
    char path[4096];
    FILE *file;
    (void)snprintf(path, sizeof path, "%s/%s-%s", folder, name, what);
    file = fopen(path, "wb");
    if (file != NULL) {
        (void)fwrite(data, 1, length, file);
        (void)fclose(file);
    }
}

static void watch(const char *folder, const char *name, char path[4096])
{
    int file;
    (void)snprintf(path, 4096u, "%s/%s-find", folder, name);
    file = open(path, O_RDWR | O_CREAT | O_TRUNC, 0644);
    if (file < 0 || ftruncate(file, (off_t)sizeof *tried) != 0) {
        perror(path);
        exit(2);
    }
    tried = mmap(NULL, sizeof *tried, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (tried == MAP_FAILED) {
        perror(path);
        exit(2);
    }
    (void)close(file);
}

static size_t read_folder(vw_fuzz_target_t target, const char *folder)
{
    static uint8_t data[MOST];
    size_t n = 0;
    struct dirent *entry;
    DIR *found = opendir(folder);
    while (found != NULL && (entry = readdir(found)) != NULL) {
        char path[4096];
        FILE *file;
        (void)snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        if (entry->d_name[0] != '.' && (file = fopen(path, "rb")) != NULL) {
            size_t length = fread(data, 1, sizeof data, file);
            (void)fclose(file);
            if (is_new(target, data, length)) {
                keep(data, length);
            }
            n++;
        }
    }
    if (found != NULL) {
        (void)closedir(found);
    }
    return n;
}

static double now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int argc, char **argv)
{
    static uint8_t data[MOST];
    vw_fuzz_target_t target = argc < 4 ? NULL : vw_fuzz_target(argv[1]);
    unsigned long runs = 0;
    double until_s;
    char path[4096];
    int i;
    if (target == NULL) {
        (void)fprintf(stderr, "vw_fuzz TARGET SECONDS FOUND FOLDER...\n");
        return 2;
    }
    watch(argv[3], argv[1], path);
    until_s = now_s() + strtod(argv[2], NULL);
    for (i = 4; i < argc; i++) {
        runs += read_folder(target, argv[i]);
    }
    if (n_kept == 0u) {
        keep((const uint8_t *)"x", 1u);
    }
    while (now_s() < until_s) {
        for (i = 0; i < 256; i++) {
            size_t from = any((uint32_t)n_kept), length = kept[from].length;
            memcpy(data, kept[from].data, length);
            length = changed(data, length);
            if (is_new(target, data, length)) {
                char what[32];
                (void)snprintf(what, sizeof what, "%lu", runs);
                keep(data, length);
                if (getenv("VOLTWALL_FUZZ") != NULL) {
                    put(argv[3], argv[1], what, data, length);
                }
            }
            runs++;
        }
    }
    (void)unlink(path);
    printf("Done %lu runs, %lu inputs kept\n", runs, (unsigned long)n_kept);
    return 0;
}
