/* Records every change of the files under one folder: LD_PRELOAD it, then call recorder_start.
 * With a number of a change it kills the process (SIGKILL) just before that change is made.
 *
 * A record is: kind (1 byte), length of path and of other path (u16), offset (u64), length of data (u32),
 * path, other path, data. Numbers are little-endian. Kinds: see disk_replay.py. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

#define MOST_FILES 1024

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static char root[PATH_MAX];
static size_t root_length;
static int record_file = -1;
static long changes, kill_at;
static char *names[MOST_FILES];

#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

/* path: where the changes are recorded. kill_before: number of the change, from 1, or 0 for none. */
void recorder_start(const char *folder, const char *path, long kill_before)
{
    snprintf(root, sizeof root, "%s/", folder);
    root_length = strlen(root);
    changes = 0;
    kill_at = kill_before;
    memset(names, 0, sizeof names);
    record_file = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
}

static int recorded(const char *path)
{
    if (record_file < 0 || !path)
        return 0;
    return strncmp(path, root, root_length) == 0 || strncmp(path, root, root_length - 1) == 0;
}

static const char *name_of(int file)
{
    return record_file >= 0 && file >= 0 && file < MOST_FILES ? names[file] : NULL;
}

static void before_change(void)
{
    if (++changes == kill_at)
        kill(getpid(), SIGKILL);
}

static void put(const void *bytes, size_t length)
{
    REAL(write);
    if (real(record_file, bytes, length) != (ssize_t)length)
        abort();
}

static void record(char kind, const char *path, const char *other, uint64_t offset, const void *data,
                   uint32_t length)
{
    uint16_t sizes[2] = {(uint16_t)strlen(path), (uint16_t)(other ? strlen(other) : 0)};
    size_t total = 1 + sizeof sizes + sizeof offset + sizeof length + sizes[0] + sizes[1] + length;
    char *whole = malloc(total), *at = whole;
    if (!whole)
        abort();
#define ADD(bytes, count) (memcpy(at, bytes, count), at += (count))
    ADD(&kind, 1);
    ADD(sizes, sizeof sizes);
    ADD(&offset, sizeof offset);
    ADD(&length, sizeof length);
    ADD(path, sizes[0]);
    if (other)
        ADD(other, sizes[1]);
    if (length)
        ADD(data, length);
    put(whole, total);
    free(whole);
}

static int opened(int file, const char *path, int flags, int existed)
{
    if (file < 0 || file >= MOST_FILES)
        return file;
    names[file] = strdup(path);
    if (flags & O_CREAT && !existed)
        record('c', path, NULL, 0, NULL, 0);
    else if (flags & O_TRUNC)
        record('t', path, NULL, 0, NULL, 0);
    return file;
}

#define OPEN(NAME)                                                                                              \
    int NAME(const char *path, int flags, ...)                                                                  \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        mode_t mode = 0;                                                                                        \
        if (flags & O_CREAT) {                                                                                  \
            va_list rest;                                                                                       \
            va_start(rest, flags);                                                                              \
            mode = va_arg(rest, mode_t);                                                                        \
            va_end(rest);                                                                                       \
        }                                                                                                       \
        if (!recorded(path))                                                                                    \
            return real(path, flags, mode);                                                                     \
        pthread_mutex_lock(&lock);                                                                              \
        int existed = access(path, F_OK) == 0;                                                                  \
        if ((flags & O_CREAT && !existed) || flags & O_TRUNC)                                                   \
            before_change();                                                                                    \
        int file = opened(real(path, flags, mode), path, flags, existed);                                       \
        pthread_mutex_unlock(&lock);                                                                            \
        return file;                                                                                            \
    }
OPEN(open)
OPEN(open64)

int close(int file)
{
    REAL(close);
    if (name_of(file)) {
        pthread_mutex_lock(&lock);
        free(names[file]);
        names[file] = NULL;
        pthread_mutex_unlock(&lock);
    }
    return real(file);
}

static void written(const char *name, uint64_t offset, const void *data, ssize_t length)
{
    if (length > 0)
        record('w', name, NULL, offset, data, (uint32_t)length);
}

ssize_t write(int file, const void *data, size_t length)
{
    REAL(write);
    const char *name = name_of(file);
    if (!name)
        return real(file, data, length);
    pthread_mutex_lock(&lock);
    before_change();
    off_t offset = lseek(file, 0, fcntl(file, F_GETFL) & O_APPEND ? SEEK_END : SEEK_CUR);
    ssize_t done = real(file, data, length);
    written(name, (uint64_t)offset, data, done);
    pthread_mutex_unlock(&lock);
    return done;
}

#define PWRITE(NAME, OFFSET)                                                                                    \
    ssize_t NAME(int file, const void *data, size_t length, OFFSET offset)                                      \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        const char *name = name_of(file);                                                                       \
        if (!name)                                                                                              \
            return real(file, data, length, offset);                                                            \
        pthread_mutex_lock(&lock);                                                                              \
        before_change();                                                                                        \
        ssize_t done = real(file, data, length, offset);                                                        \
        written(name, (uint64_t)offset, data, done);                                                            \
        pthread_mutex_unlock(&lock);                                                                            \
        return done;                                                                                            \
    }
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

#define TRUNCATE(NAME, OFFSET)                                                                                  \
    int NAME(int file, OFFSET length)                                                                           \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        const char *name = name_of(file);                                                                       \
        if (!name)                                                                                              \
            return real(file, length);                                                                          \
        pthread_mutex_lock(&lock);                                                                              \
        before_change();                                                                                        \
        int failed = real(file, length);                                                                        \
        if (!failed)                                                                                            \
            record('t', name, NULL, (uint64_t)length, NULL, 0);                                                 \
        pthread_mutex_unlock(&lock);                                                                            \
        return failed;                                                                                          \
    }
TRUNCATE(ftruncate, off_t)
TRUNCATE(ftruncate64, off64_t)

#define SYNC(NAME)                                                                                              \
    int NAME(int file)                                                                                          \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        const char *name = name_of(file);                                                                       \
        if (!name)                                                                                              \
            return real(file);                                                                                  \
        pthread_mutex_lock(&lock);                                                                              \
        before_change();                                                                                        \
        record('s', name, NULL, 0, NULL, 0);                                                                    \
        pthread_mutex_unlock(&lock);                                                                            \
        return 0; /* the replay decides what is on disk: the real disk need not wait */                         \
    }
SYNC(fsync)
SYNC(fdatasync)

#define TWO_PATHS(NAME, KIND)                                                                                   \
    int NAME(const char *path, const char *other)                                                               \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        if (!recorded(path) && !recorded(other))                                                                \
            return real(path, other);                                                                           \
        pthread_mutex_lock(&lock);                                                                              \
        before_change();                                                                                        \
        int failed = real(path, other);                                                                         \
        if (!failed)                                                                                            \
            record(KIND, path, other, 0, NULL, 0);                                                              \
        pthread_mutex_unlock(&lock);                                                                            \
        return failed;                                                                                          \
    }
TWO_PATHS(rename, 'r')
TWO_PATHS(link, 'l')

#define ONE_PATH(NAME, KIND, PARAMETERS, ARGUMENTS)                                                             \
    int NAME PARAMETERS                                                                                         \
    {                                                                                                           \
        REAL(NAME);                                                                                             \
        if (!recorded(path))                                                                                    \
            return real ARGUMENTS;                                                                              \
        pthread_mutex_lock(&lock);                                                                              \
        before_change();                                                                                        \
        int failed = real ARGUMENTS;                                                                            \
        if (!failed)                                                                                            \
            record(KIND, path, NULL, 0, NULL, 0);                                                               \
        pthread_mutex_unlock(&lock);                                                                            \
        return failed;                                                                                          \
    }
ONE_PATH(unlink, 'u', (const char *path), (path))
ONE_PATH(mkdir, 'm', (const char *path, mode_t mode), (path, mode))
