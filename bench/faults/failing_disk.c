/* A disk that takes nothing, for one process: LD_PRELOAD it. FAILING_DISK names a file that says how, and
 * FAILING_ROOT the folder below which it acts. "full": a write behind a file's end fails with ENOSPC; what a
 * file has already can be overwritten, and empty files and folders can be made, as on tmpfs and ext4.
 * "read-only": every change fails with EROFS. "hangs": a write or a sync waits until it says something else. Else
 * the disk is as it is. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define REAL(NAME)                                                                                              \
    static __typeof__(NAME) *real;                                                                              \
    if (!real)                                                                                                  \
        real = (__typeof__(NAME) *)dlsym(RTLD_NEXT, #NAME)

enum { WELL, FULL, READ_ONLY, HANGS };

static int state(void)
{
    int (*real_open)(const char *, int, ...) = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open");
    const char *path = getenv("FAILING_DISK");
    char said[16] = "";
    int file = path ? real_open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0)
        return WELL;
    if (read(file, said, sizeof said - 1) < 0)
        said[0] = '\0';
    close(file);
    if (strncmp(said, "hangs", 5) == 0)
        return HANGS;
    return strncmp(said, "full", 4) == 0 ? FULL : strncmp(said, "read-only", 9) == 0 ? READ_ONLY : WELL;
}

static int below_root(const char *path)
{
    const char *root = getenv("FAILING_ROOT");
    size_t length = root ? strlen(root) : 0;
    return length && path && strncmp(path, root, length) == 0 && (path[length] == '/' || !path[length]);
}

static int of_file(int file)
{
    char link[64], path[4096];
    ssize_t length;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    length = readlink(link, path, sizeof path - 1);
    if (length <= 0)
        return WELL;
    path[length] = '\0';
    return below_root(path) ? state() : WELL;
}

/* Whether a write of `length` bytes at `offset` fails; -1: at the file's own place. Sets errno. */
static int fails(int file, off_t offset, size_t length)
{
    struct stat found;
    int how;
    while ((how = of_file(file)) == HANGS)
        usleep(50000);
    if (how == READ_ONLY)
        return errno = EROFS, 1;
    if (how != FULL || fstat(file, &found) != 0 || !S_ISREG(found.st_mode))
        return 0;
    if (offset < 0)
        offset = fcntl(file, F_GETFL) & O_APPEND ? found.st_size : lseek(file, 0, SEEK_CUR);
    return offset + (off_t)length > found.st_size ? (errno = ENOSPC, 1) : 0;
}

static int name_fails(const char *path)
{
    return below_root(path) && state() == READ_ONLY ? (errno = EROFS, 1) : 0;
}

#define OPEN(NAME)                                                                                              \
    int NAME(const char *path, int flags, ...)                                                                  \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        mode_t mode = 0;                                                                                        \
        int changes = (flags & O_ACCMODE) != O_RDONLY || flags & (O_CREAT | O_TRUNC);                           \
        if (flags & O_CREAT) {                                                                                  \
            va_list rest;                                                                                       \
            va_start(rest, flags);                                                                              \
            mode = va_arg(rest, mode_t);                                                                        \
            va_end(rest);                                                                                       \
        }                                                                                                       \
        if (changes && name_fails(path))                            \
            return -1;                                                                                          \
        return real(path, flags, mode);                                                                         \
    }
OPEN(open)
OPEN(open64)

ssize_t write(int file, const void *data, size_t length)
{
    REAL(write);
    return fails(file, -1, length) ? -1 : real(file, data, length);
}

#define PWRITE(NAME, OFFSET)                                                                                    \
    ssize_t NAME(int file, const void *data, size_t length, OFFSET offset)                                      \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        return fails(file, (off_t)offset, length) ? -1 : real(file, data, length, offset);                      \
    }
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

#define TRUNCATE(NAME, OFFSET)                                                                                  \
    int NAME(int file, OFFSET length)                                                                           \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        return fails(file, 0, (size_t)length) ? -1 : real(file, length);                                        \
    }
TRUNCATE(ftruncate, off_t)
TRUNCATE(ftruncate64, off64_t)

int fdatasync(int file)
{
    REAL(fdatasync);
    while (of_file(file) == HANGS)
        usleep(50000);
    return real(file);
}

int rename(const char *path, const char *other)
{
    REAL(rename);
    return name_fails(path) ? -1 : real(path, other);
}

int link(const char *path, const char *other)
{
    REAL(link);
    return name_fails(other) ? -1 : real(path, other);
}

int unlink(const char *path)
{
    REAL(unlink);
    return name_fails(path) ? -1 : real(path);
}

int mkdir(const char *path, mode_t mode)
{
    REAL(mkdir);
    return name_fails(path) ? -1 : real(path, mode);
}
