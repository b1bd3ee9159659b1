/* A disk with faults, for one process: preloaded, it makes writes and syncs of the files in a folder fail. Changes of a
 * file's length and renames count as writes.
 *
 * PLUMBLINE_FAULTY_FOLDER is the folder, PLUMBLINE_FAULTS a file of nine numbers (32 bits each) that is mapped into
 * memory, so that a test can change them while the process runs: how many of a thousand writes fail with EIO, fail with
 * ENOSPC and are short, how many syncs fail with EIO, the microseconds that each takes, a counter of calls, the number
 * of faults so far, and how many writes pass before so many fail with ENOSPC. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/uio.h>
#include <unistd.h>

enum { WRITE_EIO, WRITE_ENOSPC, WRITE_SHORT, SYNC_EIO, DELAY_US, CALLS, FAULTS, SKIPPED, REFUSED, NUMBERS };
enum { DESCRIPTORS = 1 << 16 };

static _Atomic uint32_t *numbers;
static const char *folder;
static _Atomic char is_faulty[DESCRIPTORS];

__attribute__((constructor)) static void begin(void) {
    const char *file = getenv("PLUMBLINE_FAULTS");
    folder = getenv("PLUMBLINE_FAULTY_FOLDER");
    int fd = file ? open(file, O_RDWR | O_CLOEXEC) : -1;
    if (fd < 0) return;
    void *mapped = mmap(NULL, NUMBERS * sizeof(uint32_t), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (mapped != MAP_FAILED) numbers = mapped;
    close(fd);
}

/* Whether this call is one of so many of a thousand, by a hash of its number. */
static int is_hit(int kind) {
    uint32_t hash = atomic_fetch_add(&numbers[CALLS], 1) * 2654435761u;
    hash = (hash ^ (hash >> 15)) * 2246822519u;
    if ((hash ^ (hash >> 13)) % 1000 >= numbers[kind]) return 0;
    atomic_fetch_add(&numbers[FAULTS], 1);
    return 1;
}

static int is_watched(int fd) {
    if (!numbers || fd < 0 || fd >= DESCRIPTORS || !is_faulty[fd]) return 0;
    if (numbers[DELAY_US]) usleep(numbers[DELAY_US]);
    return 1;
}

/* Takes one from a number, unless it is 0. */
static int take(int kind) {
    uint32_t left = atomic_load(&numbers[kind]);
    while (left && !atomic_compare_exchange_weak(&numbers[kind], &left, left - 1)) {}
    return left > 0;
}

/* Whether this write is one of those that are refused by their place in the order. */
static int is_refused(void) {
    if (!atomic_load(&numbers[REFUSED]) || take(SKIPPED) || !take(REFUSED)) return 0;
    atomic_fetch_add(&numbers[FAULTS], 1);
    return 1;
}

/* Returns how much is to be written, or -1 with errno. */
static ssize_t allowed(int fd, size_t length) {
    if (!is_watched(fd)) return (ssize_t)length;
    if (is_hit(WRITE_EIO)) return errno = EIO, -1;
    if (is_hit(WRITE_ENOSPC) || is_refused()) return errno = ENOSPC, -1;
    if (length > 1 && is_hit(WRITE_SHORT)) return (ssize_t)(length / 2);
    return (ssize_t)length;
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

ssize_t write(int fd, const void *bytes, size_t length) {
    REAL(ssize_t, "write", int, const void *, size_t);
    ssize_t some = allowed(fd, length);
    return some < 0 ? some : real(fd, bytes, (size_t)some);
}

ssize_t pwrite(int fd, const void *bytes, size_t length, off_t at) {
    REAL(ssize_t, "pwrite", int, const void *, size_t, off_t);
    ssize_t some = allowed(fd, length);
    return some < 0 ? some : real(fd, bytes, (size_t)some, at);
}

ssize_t pwrite64(int fd, const void *bytes, size_t length, off64_t at) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t);
    ssize_t some = allowed(fd, length);
    return some < 0 ? some : real(fd, bytes, (size_t)some, at);
}

/* A short write would end within a piece, so this one fails as a whole. */
ssize_t writev(int fd, const struct iovec *pieces, int count) {
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    return allowed(fd, 1) < 0 ? -1 : real(fd, pieces, count);
}

/* Files that grow or shrink, and those that take the place of others, count as written. */
int ftruncate(int fd, off_t length) {
    REAL(int, "ftruncate", int, off_t);
    return allowed(fd, 1) < 0 ? -1 : real(fd, length);
}

int ftruncate64(int fd, off64_t length) {
    REAL(int, "ftruncate64", int, off64_t);
    return allowed(fd, 1) < 0 ? -1 : real(fd, length);
}

static int is_in_folder(const char *path) {
    return numbers && folder && !strncmp(path, folder, strlen(folder));
}

int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    if (!is_in_folder(to)) return real(from, to);
    if (is_hit(WRITE_EIO)) return errno = EIO, -1;
    if (is_hit(WRITE_ENOSPC) || is_refused()) return errno = ENOSPC, -1;
    return real(from, to);
}

int fsync(int fd) {
    REAL(int, "fsync", int);
    return is_watched(fd) && is_hit(SYNC_EIO) ? (errno = EIO, -1) : real(fd);
}

int fdatasync(int fd) {
    REAL(int, "fdatasync", int);
    return is_watched(fd) && is_hit(SYNC_EIO) ? (errno = EIO, -1) : real(fd);
}

static int opened(int fd, const char *path) {
    if (fd >= 0 && fd < DESCRIPTORS) is_faulty[fd] = (char)is_in_folder(path);
    return fd;
}

int open(const char *path, int flags, ...) {
    REAL(int, "open", const char *, int, ...);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return opened(real(path, flags, mode), path);
}

int open64(const char *path, int flags, ...) {
    REAL(int, "open64", const char *, int, ...);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return opened(real(path, flags, mode), path);
}

int close(int fd) {
    REAL(int, "close", int);
    if (fd >= 0 && fd < DESCRIPTORS) is_faulty[fd] = 0;
    return real(fd);
}
