/* A slow disk for one process: LD_PRELOAD it, and fsync and fdatasync take as many seconds
 * longer as the file that SLOW_DISK names says. No file, or no number in it: the disk is as it is. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static void wait_for_disk(void)
{
    const char *path = getenv("SLOW_DISK");
    FILE *file = path ? fopen(path, "re") : NULL;
    double seconds = 0.0;
    if (!file)
        return;
    if (fscanf(file, "%lf", &seconds) != 1)
        seconds = 0.0;
    fclose(file);
    if (seconds > 0.0 && seconds < 3600.0) {
        struct timespec left = {(time_t)seconds, (long)((seconds - (time_t)seconds) * 1e9)};
        while (nanosleep(&left, &left) != 0)
            ;
    }
}

int fsync(int descriptor)
{
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, "fsync");
    wait_for_disk();
    return real(descriptor);
}

int fdatasync(int descriptor)
{
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, "fdatasync");
    wait_for_disk();
    return real(descriptor);
}
