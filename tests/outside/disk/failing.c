/* A disk that fails: loaded before the C library (LD_PRELOAD), it counts the calls that change or open files below a folder
 * and makes one of them fail, or all from it on.
 *
 *   FAILING_BELOW  the folder, absolute and without links in it
 *   FAILING_CALL   which call, from 1
 *   FAILING_MODE   once: that call; from: that and all after it; short: counted are writes alone, that one writes half of
 *                  its bytes and the call after it fails; torn: the same, and the two calls after it fail; look: none fails
 *   FAILING_ERRNO  what it fails with, as a number
 *   FAILING_LOG    a file elsewhere that gets a line `call path` for each call that failed; look: for each call
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { PATH_BYTES = 4096 };

enum verdict { PASS, FAIL, HALF };

static atomic_long calls;
/* set by half a write: so many calls after it fail */
static atomic_int due;

#define REAL(name) static __typeof__(&name) real; if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

/* Whether an absolute path is the folder or below it. */
static int is_below(const char *path) {
    const char *below = getenv("FAILING_BELOW");
    size_t length = below ? strlen(below) : 0;
    return length && !strncmp(path, below, length) && (path[length] == '/' || path[length] == 0);
}

static int path_of_fd(int fd, char *path) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, PATH_BYTES - 1);
    path[length > 0 ? length : 0] = 0;
    return length > 0;
}

/* A path as a call names it, made absolute. */
static void absolute(int folder, const char *name, char *path) {
    char base[PATH_BYTES];
    if (name[0] == '/') {
        snprintf(path, PATH_BYTES, "%s", name);
        return;
    }
    int known = folder == AT_FDCWD ? getcwd(base, sizeof base) != NULL : path_of_fd(folder, base);
    if (!strncmp(name, "./", 2)) name += 2;
    if ((size_t)snprintf(path, PATH_BYTES, "%s/%s", known ? base : "", name) >= PATH_BYTES) path[0] = 0;
}

static void tell(const char *call, const char *path) {
    char line[PATH_BYTES + 64];
    const char *log = getenv("FAILING_LOG");
    int length = snprintf(line, sizeof line, "%s %s\n", call, path);
    /* past the functions below */
    long fd = log ? syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND, 0666) : -1;
    if (fd >= 0) {
        syscall(SYS_write, fd, line, length);
        syscall(SYS_close, fd);
    }
}

/* What becomes of a call on an absolute path; if it fails, errno says how. */
static enum verdict judge(const char *call, const char *path) {
    if (!is_below(path)) return PASS;
    const char *mode = getenv("FAILING_MODE"), *nth = getenv("FAILING_CALL"), *error = getenv("FAILING_ERRNO");
    if (mode && !strcmp(mode, "look")) tell(call, path);
    if (!mode || !nth || !error) return PASS;
    int left = atomic_load(&due), fails = left > 0, torn = !strcmp(mode, "torn");
    if (fails) atomic_store(&due, left - 1);
    if (torn || !strcmp(mode, "short")) {
        if (!fails && !strcmp(call, "write") && atomic_fetch_add(&calls, 1) + 1 == atol(nth)) {
            atomic_store(&due, torn ? 2 : 1);
            tell("half a write", path);
            return HALF;
        }
    } else {
        long number = atomic_fetch_add(&calls, 1) + 1;
        fails = number == atol(nth) || (number > atol(nth) && !strcmp(mode, "from"));
    }
    if (!fails) return PASS;
    tell(call, path);
    errno = atoi(error);
    return FAIL;
}

static enum verdict judge_at(const char *call, int folder, const char *name) {
    char path[PATH_BYTES];
    absolute(folder, name, path);
    return judge(call, path);
}

static enum verdict judge_fd(const char *call, int fd) {
    char path[PATH_BYTES];
    return fd > STDERR_FILENO && path_of_fd(fd, path) ? judge(call, path) : PASS;
}

#define OPENS(name) \
    int name(const char *path, int flags, ...) { \
        REAL(name); \
        va_list more; \
        va_start(more, flags); \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0; \
        va_end(more); \
        return judge_at("open", AT_FDCWD, path) == FAIL ? -1 : real(path, flags, mode); \
    }
OPENS(open)
OPENS(open64)

#define OPENS_AT(name) \
    int name(int folder, const char *path, int flags, ...) { \
        REAL(name); \
        va_list more; \
        va_start(more, flags); \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0; \
        va_end(more); \
        return judge_at("open", folder, path) == FAIL ? -1 : real(folder, path, flags, mode); \
    }
OPENS_AT(openat)
OPENS_AT(openat64)

int creat(const char *path, mode_t mode) {
    REAL(creat);
    return judge_at("open", AT_FDCWD, path) == FAIL ? -1 : real(path, mode);
}

ssize_t write(int fd, const void *bytes, size_t count) {
    REAL(write);
    switch (judge_fd("write", fd)) {
    case FAIL: return -1;
    case HALF: return real(fd, bytes, count / 2);
    default: return real(fd, bytes, count);
    }
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    REAL(writev);
    switch (judge_fd("write", fd)) {
    case FAIL: return -1;
    case HALF: return count ? syscall(SYS_write, fd, parts[0].iov_base, parts[0].iov_len / 2) : 0;
    default: return real(fd, parts, count);
    }
}

#define WRITES_AT(name, offset_type) \
    ssize_t name(int fd, const void *bytes, size_t count, offset_type offset) { \
        REAL(name); \
        switch (judge_fd("write", fd)) { \
        case FAIL: return -1; \
        case HALF: return real(fd, bytes, count / 2, offset); \
        default: return real(fd, bytes, count, offset); \
        } \
    }
WRITES_AT(pwrite, off_t)
WRITES_AT(pwrite64, off64_t)

#define ON_FD(name, arguments, ...) \
    int name arguments { \
        REAL(name); \
        return judge_fd(#name, fd) == FAIL ? -1 : real(__VA_ARGS__); \
    }
ON_FD(fsync, (int fd), fd)
ON_FD(fdatasync, (int fd), fd)
ON_FD(ftruncate, (int fd, off_t length), fd, length)
ON_FD(ftruncate64, (int fd, off64_t length), fd, length)
ON_FD(flock, (int fd, int operation), fd, operation)

#define ON_PATH(name, folder, path, arguments, ...) \
    int name arguments { \
        REAL(name); \
        return judge_at(#name, folder, path) == FAIL ? -1 : real(__VA_ARGS__); \
    }
ON_PATH(mkdir, AT_FDCWD, path, (const char *path, mode_t mode), path, mode)
ON_PATH(unlink, AT_FDCWD, path, (const char *path), path)
ON_PATH(unlinkat, folder, path, (int folder, const char *path, int flags), folder, path, flags)
ON_PATH(rmdir, AT_FDCWD, path, (const char *path), path)
/* named by where it goes */
ON_PATH(rename, AT_FDCWD, to, (const char *from, const char *to), from, to)
ON_PATH(renameat, there, to, (int here, const char *from, int there, const char *to), here, from, there, to)
ON_PATH(renameat2, there, to, (int here, const char *from, int there, const char *to, unsigned flags),
        here, from, there, to, flags)
