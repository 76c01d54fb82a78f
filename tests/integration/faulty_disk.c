/* Preloaded into a process: makes one call on the files of a folder fail, or writes down what reaches them.
 *
 * FAULT_FOLDER names the folder; what lies elsewhere passes. fault_arm(n, ops, error) lets the n-th of the chosen calls
 * from now on fail once: with errno `error`, or where that is 0 a write of half of its bytes. fault_calls() counts, and
 * fault_fired() names the call that failed last.
 * WRITE_LOG names a file that gets a record of every change: op u8 (1 write, 2 truncate, 3 sync, 4 unlink, 5 note,
 * 6 rename, 7 create), offset u64, length u32, length of the path u16, path, bytes (of a rename the new path).
 * FAULT_SWITCH names a file: while it begins with "h" every change waits until it does not, with "f" it is refused as by
 * a full disk. The file of the EEPROM is the car's: it never stalls.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

enum { WRITE = 1, SYNC = 2, OPEN = 4, RENAME = 8, TRUNCATE = 16, UNLINK = 32 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static FILE *out;
static long countdown;
static unsigned chosen;
static int failure;
static long calls;
static char fired[4200];

void fault_arm(long n, unsigned ops, int error)
{
    pthread_mutex_lock(&lock);
    countdown = n;
    chosen = ops;
    failure = error;
    calls = 0;
    if (n) fired[0] = 0;
    pthread_mutex_unlock(&lock);
}

long fault_calls(void) { return calls; }
const char *fault_fired(void) { return fired; }

static const char *inside(const char *path, char *full)
{
    const char *folder = getenv("FAULT_FOLDER");
    if (!folder || !path) return NULL;
    if (path[0] != '/') {
        char here[2048];
        if (!getcwd(here, sizeof here)) return NULL;
        snprintf(full, 4096, "%s/%s", here, path);
        path = full;
    }
    return strncmp(path, folder, strlen(folder)) ? NULL : path;
}

static const char *path_of(int fd, char *full)
{
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, full, 4095);
    if (n < 0) return NULL;
    full[n] = 0;
    return inside(full, full);
}

/* Waits while the disk hangs; whether it is full. The lock is not held: what lies elsewhere passes meanwhile. */
static int stalls(const char *path)
{
    const char *name = getenv("FAULT_SWITCH");
    static int (*real_open)(int, const char *, int, ...);
    if (!path || !name || strstr(path, "eeprom")) return 0;
    if (!real_open) real_open = dlsym(RTLD_NEXT, "openat64");
    for (;;) {
        char state = 0;
        int fd = real_open(AT_FDCWD, name, O_RDONLY | O_CLOEXEC);
        if (fd >= 0) {
            if (read(fd, &state, 1) != 1) state = 0;
            close(fd);
        }
        if (state != 'h') return state == 'f';
        usleep(5000);
    }
}

/* Whether this call is the one. The lock is held. */
static int fails(unsigned op, const char *name, const char *path)
{
    if (!path || !(chosen & op)) return 0;
    calls++;
    if (countdown == 0 || --countdown != 0) return 0;
    snprintf(fired, sizeof fired, "%s %s", name, path);
    return 1;
}

static void note(uint8_t op, const char *path, uint64_t offset, uint32_t length, const void *data)
{
    if (!getenv("WRITE_LOG") || !path) return;
    if (!out) out = fopen(getenv("WRITE_LOG"), "ab");
    uint16_t n = (uint16_t)strlen(path);
    fwrite(&op, 1, 1, out);
    fwrite(&offset, 8, 1, out);
    fwrite(&length, 4, 1, out);
    fwrite(&n, 2, 1, out);
    fwrite(path, 1, n, out);
    if (data) fwrite(data, 1, length, out);
    fflush(out);
}

/* Called by whoever was told that so much is safe. */
void acknowledged(uint32_t number)
{
    pthread_mutex_lock(&lock);
    note(5, "", number, 0, NULL);
    pthread_mutex_unlock(&lock);
}


static ssize_t put(int fd, const void *data, size_t length, off64_t offset, int at)
{
    static ssize_t (*real_pwrite)(int, const void *, size_t, off64_t);
    static ssize_t (*real_write)(int, const void *, size_t);
    char full[4096];
    if (!real_pwrite) real_pwrite = dlsym(RTLD_NEXT, "pwrite64");
    if (!real_write) real_write = dlsym(RTLD_NEXT, "write");
    int kept = errno;
    const char *path = path_of(fd, full);
    errno = kept;
    if (!path) return at ? real_pwrite(fd, data, length, offset) : real_write(fd, data, length);
    if (stalls(path)) {
        errno = ENOSPC;
        return -1;
    }
    errno = kept;
    pthread_mutex_lock(&lock);
    if (fails(WRITE, "write", path)) {
        if (failure) {
            pthread_mutex_unlock(&lock);
            errno = failure;
            return -1;
        }
        length /= 2;
    }
    if (!at) {
        int flags = fcntl(fd, F_GETFL);
        offset = lseek64(fd, 0, flags & O_APPEND ? SEEK_END : SEEK_CUR);
    }
    ssize_t done = at ? real_pwrite(fd, data, length, offset) : real_write(fd, data, length);
    if (done > 0) note(1, path, (uint64_t)offset, (uint32_t)done, data);
    pthread_mutex_unlock(&lock);
    return done;
}

ssize_t write(int fd, const void *data, size_t length) { return put(fd, data, length, 0, 0); }
ssize_t pwrite(int fd, const void *data, size_t length, off_t offset) { return put(fd, data, length, offset, 1); }
ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset) { return put(fd, data, length, offset, 1); }

static int cut(int fd, off64_t length)
{
    static int (*real)(int, off64_t);
    char full[4096];
    if (!real) real = dlsym(RTLD_NEXT, "ftruncate64");
    const char *path = path_of(fd, full);
    stalls(path);
    pthread_mutex_lock(&lock);
    if (fails(TRUNCATE, "ftruncate", path)) {
        pthread_mutex_unlock(&lock);
        errno = failure ? failure : EIO;
        return -1;
    }
    int result = real(fd, length);
    if (!result) note(2, path, (uint64_t)length, 0, NULL);
    pthread_mutex_unlock(&lock);
    return result;
}

int ftruncate(int fd, off_t length) { return cut(fd, length); }
int ftruncate64(int fd, off64_t length) { return cut(fd, length); }

static int synced(int fd, const char *name)
{
    int (*real)(int) = dlsym(RTLD_NEXT, name);
    char full[4096];
    const char *path = path_of(fd, full);
    stalls(path);
    pthread_mutex_lock(&lock);
    int is_failing = fails(SYNC, name, path);
    pthread_mutex_unlock(&lock);
    if (is_failing) {
        errno = failure ? failure : EIO;
        return -1;
    }
    int result = real(fd);
    pthread_mutex_lock(&lock);
    if (!result) note(3, path, 0, 0, NULL);
    pthread_mutex_unlock(&lock);
    return result;
}

int fsync(int fd) { return synced(fd, "fsync"); }
int fdatasync(int fd) { return synced(fd, "fdatasync"); }

static int opened(int at, const char *name, int flags, mode_t mode)
{
    static int (*real)(int, const char *, int, ...);
    char full[4096];
    if (!real) real = dlsym(RTLD_NEXT, "openat64");
    const char *path = at == AT_FDCWD || name[0] == '/' ? inside(name, full) : NULL;
    if (flags & (O_CREAT | O_TRUNC) && stalls(path)) {
        errno = ENOSPC;
        return -1;
    }
    pthread_mutex_lock(&lock);
    if (fails(OPEN, "open", path)) {
        pthread_mutex_unlock(&lock);
        errno = failure ? failure : EMFILE;
        return -1;
    }
    int was_there = path && (flags & O_CREAT) && !faccessat(AT_FDCWD, path, F_OK, 0);
    int fd = real(at, name, flags, mode);
    if (fd >= 0 && path) {
        if ((flags & O_CREAT) && !was_there) note(7, path, 0, 0, NULL);
        if (was_there && (flags & O_TRUNC)) note(2, path, 0, 0, NULL);
    }
    pthread_mutex_unlock(&lock);
    return fd;
}

#define MODE(last) \
    mode_t mode = 0; \
    if (flags & (O_CREAT | __O_TMPFILE)) { \
        va_list rest; \
        va_start(rest, last); \
        mode = va_arg(rest, mode_t); \
        va_end(rest); \
    }

int open(const char *name, int flags, ...) { MODE(flags) return opened(AT_FDCWD, name, flags, mode); }
int open64(const char *name, int flags, ...) { MODE(flags) return opened(AT_FDCWD, name, flags, mode); }
int openat(int at, const char *name, int flags, ...) { MODE(flags) return opened(at, name, flags, mode); }
int openat64(int at, const char *name, int flags, ...) { MODE(flags) return opened(at, name, flags, mode); }

int rename(const char *from, const char *to)
{
    static int (*real)(const char *, const char *);
    char full[4096], full_to[4096];
    if (!real) real = dlsym(RTLD_NEXT, "rename");
    const char *path = inside(from, full), *target = inside(to, full_to);
    stalls(path);
    pthread_mutex_lock(&lock);
    if (fails(RENAME, "rename", path)) {
        pthread_mutex_unlock(&lock);
        errno = failure ? failure : EIO;
        return -1;
    }
    int result = real(from, to);
    if (!result && target) note(6, path, 0, (uint32_t)strlen(target), target);
    pthread_mutex_unlock(&lock);
    return result;
}

int unlink(const char *name)
{
    static int (*real)(const char *);
    char full[4096];
    if (!real) real = dlsym(RTLD_NEXT, "unlink");
    const char *path = inside(name, full);
    pthread_mutex_lock(&lock);
    if (fails(UNLINK, "unlink", path)) {
        pthread_mutex_unlock(&lock);
        errno = failure ? failure : EIO;
        return -1;
    }
    int result = real(name);
    if (!result) note(4, path, 0, 0, NULL);
    pthread_mutex_unlock(&lock);
    return result;
}
