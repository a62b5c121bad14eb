/* A disk that takes nothing, for one process: LD_PRELOAD it. FAILING_DISK names a file that says how, and
 * FAILING_ROOT the folder below which it acts. "full": a write behind a file's end fails with ENOSPC; what a
 * file has already can be overwritten, and empty files and folders can be made, as on tmpfs and ext4.
 * "read-only": every change fails with EROFS. "hangs": every change and every sync waits until it says something
 * else. "dead": so does the start of any program. Else the disk is as it is. */

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

enum { WELL, FULL, READ_ONLY, HANGS, DEAD };

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
    if (strncmp(said, "dead", 4) == 0)
        return DEAD;
    return strncmp(said, "full", 4) == 0 ? FULL : strncmp(said, "read-only", 9) == 0 ? READ_ONLY : WELL;
}

static int below_root(const char *path)
{
    const char *root = getenv("FAILING_ROOT");
    size_t length = root ? strlen(root) : 0;
    return length && path && strncmp(path, root, length) == 0 && (path[length] == '/' || !path[length]);
}

/* The state of the disk of what is to change, once it does not hang. */
static int once_it_answers(int below)
{
    int how = WELL;
    while (below && ((how = state()) == HANGS || how == DEAD))
        usleep(50000);
    return how;
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
    return once_it_answers(below_root(path));
}

/* Whether a write of `length` bytes at `offset` fails; -1: at the file's own place. Sets errno. */
static int fails(int file, off_t offset, size_t length)
{
    struct stat found;
    int how = of_file(file);
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
    return once_it_answers(below_root(path)) == READ_ONLY ? (errno = EROFS, 1) : 0;
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

#define SYNC(NAME)                                                                                              \
    int NAME(int file)                                                                                          \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        of_file(file);                                                                                          \
        return real(file);                                                                                      \
    }
SYNC(fsync)
SYNC(fdatasync)

int execv(const char *path, char *const arguments[])
{
    REAL(execv);
    while (state() == DEAD)
        usleep(50000);
    return real(path, arguments);
}

int execve(const char *path, char *const arguments[], char *const environment[])
{
    REAL(execve);
    while (state() == DEAD)
        usleep(50000);
    return real(path, arguments, environment);
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
