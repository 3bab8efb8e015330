/* A disk on which the tables of a PostgreSQL server find no more space while the file named by FULL_DISK is there. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static int is_full(int descriptor) {
    const char *mark = getenv("FULL_DISK");
    char link[64], path[4096];
    if (mark == NULL || access(mark, F_OK) != 0)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = '\0';
    if (strstr(path, "/base/") == NULL)
        return 0;
    errno = ENOSPC;
    return 1;
}

ssize_t pwrite64(int descriptor, const void *content, size_t size, off64_t offset) {
    static ssize_t (*real)(int, const void *, size_t, off64_t);
    if (real == NULL)
        real = dlsym(RTLD_NEXT, "pwrite64");
    return is_full(descriptor) ? -1 : real(descriptor, content, size, offset);
}

ssize_t pwrite(int descriptor, const void *content, size_t size, off_t offset) {
    return pwrite64(descriptor, content, size, offset);
}

ssize_t pwritev64(int descriptor, const struct iovec *parts, int count, off64_t offset) {
    static ssize_t (*real)(int, const struct iovec *, int, off64_t);
    if (real == NULL)
        real = dlsym(RTLD_NEXT, "pwritev64");
    return is_full(descriptor) ? -1 : real(descriptor, parts, count, offset);
}

ssize_t pwritev(int descriptor, const struct iovec *parts, int count, off_t offset) {
    return pwritev64(descriptor, parts, count, offset);
}

int posix_fallocate64(int descriptor, off64_t offset, off64_t size) {
    static int (*real)(int, off64_t, off64_t);
    if (real == NULL)
        real = dlsym(RTLD_NEXT, "posix_fallocate64");
    return is_full(descriptor) ? ENOSPC : real(descriptor, offset, size);
}

int posix_fallocate(int descriptor, off_t offset, off_t size) {
    return posix_fallocate64(descriptor, offset, size);
}
