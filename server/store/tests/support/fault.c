/* A disk that fails on command: preloaded, it stands between a program and the file system.
 *
 * What changes files below QUADMUSE_FAULT_DIR is counted as long as the file QUADMUSE_FAULT_ORDER exists. That file names
 * what happens: "eio N" fails the N-th change with EIO, after a moment, and is gone then, "eio 0" fails all of them, "kill N"
 * ends the process in place of it; "full N" fails with ENOSPC, from the N-th change on, whatever may need space. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static long changes;

#define MOMENT_US 20000

/* The next definition of a function, which ours stands before. */
#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

/* Counts a change, and says whether it is to fail; `grows` are those that may need space. */
static int fails(int grows) {
    const char *order = getenv("QUADMUSE_FAULT_ORDER");
    char text[32] = {0}, what[8] = {0};
    long at = 0;
    int fail = 0, code = EIO, saved = errno, file = order ? NEXT(open64)(order, O_RDONLY | O_CLOEXEC) : -1;
    pthread_mutex_lock(&lock);
    if (file < 0) {
        changes = 0;
    } else {
        ssize_t got = read(file, text, sizeof text - 1);
        close(file);
        changes++;
        int told = got > 0 && sscanf(text, "%7s %ld", what, &at) == 2;
        if (told && !strcmp(what, "full")) {
            fail = grows && changes >= at;
            code = ENOSPC;
        } else if (told && (at == 0 || at == changes)) {
            if (!strcmp(what, "kill")) _exit(137);
            if (at) NEXT(unlink)(order);
            fail = 1;
        }
    }
    pthread_mutex_unlock(&lock);
    /* Whoever waits for a write on another thread is to wait by then, and must be told. */
    if (fail && at && code == EIO) usleep(MOMENT_US);
    errno = fail ? code : saved;
    return fail;
}

static int is_below(const char *path) {
    const char *dir = getenv("QUADMUSE_FAULT_DIR");
    return dir && path && !strncmp(path, dir, strlen(dir));
}

static int is_ours(int fd) {
    char link[64], path[PATH_MAX];
    int saved = errno;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    errno = saved;
    if (length <= 0) return 0;
    path[length] = 0;
    return is_below(path);
}

#define ON_FD(type, name, grows, parameters, arguments)                                                                \
    type name parameters { return is_ours(fd) && fails(grows) ? -1 : NEXT(name) arguments; }
#define ON_PATH(name, grows, parameters, arguments)                                                                    \
    int name parameters { return is_below(path) && fails(grows) ? -1 : NEXT(name) arguments; }

ON_FD(ssize_t, write, 1, (int fd, const void *bytes, size_t count), (fd, bytes, count))
ON_FD(ssize_t, pwrite64, 1, (int fd, const void *bytes, size_t count, off64_t at), (fd, bytes, count, at))
ON_FD(int, ftruncate64, 1, (int fd, off64_t length), (fd, length))
ON_FD(int, fsync, 0, (int fd), (fd))
ON_FD(int, fdatasync, 0, (int fd), (fd))
ON_FD(int, syncfs, 0, (int fd), (fd))
ON_FD(int, sync_file_range, 0, (int fd, off64_t from, off64_t count, unsigned flags), (fd, from, count, flags))
ON_PATH(rename, 0, (const char *path, const char *to), (path, to))
ON_PATH(unlink, 0, (const char *path), (path))
ON_PATH(mkdir, 1, (const char *path, mode_t mode), (path, mode))
