/*
 * The wall clock of one process, moved while it runs; preloaded by test_wall_clock.py.
 *
 * What a process is told of that clock by the functions below, which are those that Python, ROS
 * and the middleware use, is moved by the seconds in the file named by WALL_CLOCK_OFFSET. Waits
 * until a time of that clock are moved back: the kernel knows only its own. Clocks that count from
 * the start of the machine are left alone.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* No machine has been up for so many s, and no wall clock shows less. */
#define LEAST_WALL_TIME 1000000000

static const volatile int64_t *offset;

__attribute__((constructor)) static void begin(void)
{
    void *file = mmap(NULL, sizeof *offset, PROT_READ, MAP_SHARED,
                      open(getenv("WALL_CLOCK_OFFSET"), O_RDONLY), 0);
    if (file == MAP_FAILED)
        abort();
    offset = file;
}

static int64_t moved(void)
{
    return offset ? *offset : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int status = syscall(SYS_clock_gettime, clock, now);
    if (status == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        now->tv_sec += moved();
    return status;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    int status = syscall(SYS_gettimeofday, now, zone);
    if (status == 0)
        now->tv_sec += moved();
    return status;
}

time_t time(time_t *result)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (result)
        *result = now.tv_sec;
    return now.tv_sec;
}

static struct timespec in_kernel(const struct timespec *end)
{
    struct timespec kernel = *end;
    if (kernel.tv_sec > LEAST_WALL_TIME)
        kernel.tv_sec -= moved();
    return kernel;
}

#define WAIT(name, type, ...) \
    static type real; \
    struct timespec kernel = in_kernel(end); \
    if (!real) /* of the library itself: the next one may be of an older version */ \
        real = (type)dlsym(dlopen("libc.so.6", RTLD_LAZY | RTLD_NOLOAD), name); \
    return real(__VA_ARGS__, &kernel)

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict end)
{
    typedef int (*wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    WAIT("pthread_cond_timedwait", wait, condition, mutex);
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict mutex, const struct timespec *restrict end)
{
    typedef int (*wait)(pthread_mutex_t *, const struct timespec *);
    WAIT("pthread_mutex_timedlock", wait, mutex);
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict end)
{
    typedef int (*wait)(sem_t *, const struct timespec *);
    WAIT("sem_timedwait", wait, semaphore);
}
