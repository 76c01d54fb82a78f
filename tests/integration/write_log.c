/* Preloaded into a recorder: writes down every write, truncation and fsync of a session's files, in order.
 * Record: op u8 (1 write, 2 truncate, 3 sync, 4 unlink), file u8 (0 database, 1 log), offset u64, length u32, bytes. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static FILE *out;

static int file_of(int fd) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n < 0) return -1;
    path[n] = 0;
    size_t length = strlen(path);
    if (length > 7 && !strcmp(path + length - 7, ".sqlite")) return 0;
    if (length > 11 && !strcmp(path + length - 11, ".sqlite-wal")) return 1;
    return -1;
}

static void note(uint8_t op, int file, uint64_t offset, uint32_t length, const void *data) {
    uint8_t which = (uint8_t)file;
    if (!out) out = fopen(getenv("WRITE_LOG"), "ab");
    fwrite(&op, 1, 1, out);
    fwrite(&which, 1, 1, out);
    fwrite(&offset, 8, 1, out);
    fwrite(&length, 4, 1, out);
    if (data) fwrite(data, 1, length, out);
    fflush(out);
}

ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset) {
    static ssize_t (*real)(int, const void *, size_t, off64_t);
    if (!real) real = dlsym(RTLD_NEXT, "pwrite64");
    pthread_mutex_lock(&lock);
    ssize_t done = real(fd, data, length, offset);
    int file = file_of(fd);
    if (done > 0 && file >= 0) note(1, file, (uint64_t)offset, (uint32_t)done, data);
    pthread_mutex_unlock(&lock);
    return done;
}

int ftruncate64(int fd, off64_t length) {
    static int (*real)(int, off64_t);
    if (!real) real = dlsym(RTLD_NEXT, "ftruncate64");
    pthread_mutex_lock(&lock);
    int result = real(fd, length);
    int file = file_of(fd);
    if (!result && file >= 0) note(2, file, (uint64_t)length, 0, NULL);
    pthread_mutex_unlock(&lock);
    return result;
}

static int synced(int fd, const char *name) {
    int (*real)(int) = dlsym(RTLD_NEXT, name);
    int result = real(fd);
    pthread_mutex_lock(&lock);
    int file = file_of(fd);
    if (!result && file >= 0) note(3, file, 0, 0, NULL);
    pthread_mutex_unlock(&lock);
    return result;
}

int fsync(int fd) { return synced(fd, "fsync"); }
int fdatasync(int fd) { return synced(fd, "fdatasync"); }

/* Called by the recorder's owner: so many frames have been acknowledged. */
void acknowledged(uint32_t frames) {
    pthread_mutex_lock(&lock);
    note(5, 0, frames, 0, NULL);
    pthread_mutex_unlock(&lock);
}
