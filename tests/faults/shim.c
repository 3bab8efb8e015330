/* A file layer that fails on demand, for LD_PRELOAD.
 *
 * Every operation that changes files under one folder is counted. At a chosen one it fails, tears, drops what it was
 * asked to do, or ends the process; and all of them can be recorded, so that a test can rebuild what a power failure
 * would have left at any of them. Controlled through the functions faults_*, over ctypes.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum fault { NONE, FAIL, FAIL_FROM_HERE, TEAR, DROP, KILL, TEAR_AND_KILL };

#define FILES 4096

static char folder[PATH_MAX];
static char *paths[FILES]; /* of open descriptors under the folder */
static long count, at = -1;
static enum fault kind;
static int error_number = EIO;
static long hits;
static int trace = -1;
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;

#define REAL(name) static __typeof__(&name) real; if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static ssize_t real_write(int fd, const void *data, size_t size) {
    REAL(write);
    return real(fd, data, size);
}

static ssize_t real_pwrite(int fd, const void *data, size_t size, off_t where) {
    REAL(pwrite64);
    return real(fd, data, size, where);
}

/* Whether a path belongs to the folder; `full` takes it as an absolute one. */
static int ours(const char *path, char *full) {
    if (!folder[0] || !path) return 0;
    if (path[0] == '/') {
        snprintf(full, PATH_MAX, "%s", path);
    } else {
        char here[PATH_MAX];
        if (!getcwd(here, sizeof here)) return 0;
        if (snprintf(full, PATH_MAX, "%s/%s", here, path) >= PATH_MAX) return 0;
    }
    size_t length = strlen(folder);
    return strncmp(full, folder, length) == 0 && (full[length] == '/' || full[length] == 0);
}

static void put(const void *data, size_t size) {
    if (size && real_write(trace, data, size) != (ssize_t)size) abort();
}

/* One record: kind, offset, lengths of path, second path and data, and these. */
static void note(char what, int64_t offset, const char *path, const char *other, const void *data, size_t size) {
    if (trace < 0) return;
    uint32_t lengths[3] = {(uint32_t)strlen(path), other ? (uint32_t)strlen(other) : 0, (uint32_t)size};
    put(&what, 1);
    put(&offset, 8);
    put(lengths, sizeof lengths);
    put(path, lengths[0]);
    put(other, lengths[1]);
    put(data, size);
}

/* SQLite maps this file into memory: were it shorter than it was told, the process would die of the mapping. */
static int is_mapped(const char *path) {
    size_t length = strlen(path);
    return length > 4 && strcmp(path + length - 4, "-shm") == 0;
}

/* Count an operation; the fault that it is to suffer. Called with the mutex held. */
static enum fault strike(const char *path) {
    long now = count++;
    if (at < 0 || kind == NONE) return NONE;
    if (now == at || (kind == FAIL_FROM_HERE && now > at)) {
        hits++;
        if (kind == DROP && is_mapped(path)) return NONE;
        if (kind == KILL) _exit(137);
        return kind;
    }
    return NONE;
}

void faults_watch(const char *path) {
    pthread_mutex_lock(&mutex);
    snprintf(folder, sizeof folder, "%s", path);
    pthread_mutex_unlock(&mutex);
}

void faults_arm(long position, int fault, int number) {
    pthread_mutex_lock(&mutex);
    count = hits = 0;
    at = position;
    kind = (enum fault)fault;
    error_number = number;
    pthread_mutex_unlock(&mutex);
}

void faults_disarm(void) {
    pthread_mutex_lock(&mutex);
    at = -1;
    pthread_mutex_unlock(&mutex);
}

long faults_count(void) { return count; }
long faults_hits(void) { return hits; }

void faults_record(const char *path) {
    REAL(open64);
    pthread_mutex_lock(&mutex);
    if (trace >= 0) close(trace);
    trace = path[0] ? real(path, O_WRONLY | O_CREAT | O_TRUNC, 0644) : -1;
    pthread_mutex_unlock(&mutex);
}

void faults_mark(long number) {
    pthread_mutex_lock(&mutex);
    note('M', number, "", NULL, NULL, 0);
    pthread_mutex_unlock(&mutex);
}

static int opened(const char *path, int flags, int fd, const char *full, int created) {
    (void)path;
    if (fd >= 0 && fd < FILES) {
        free(paths[fd]);
        paths[fd] = strdup(full);
        if (created) note('C', 0, full, NULL, NULL, 0);
        else if (flags & O_TRUNC) note('T', 0, full, NULL, NULL, 0);
    }
    return fd;
}

static int open_at(int directory, const char *path, int flags, mode_t mode) {
    REAL(openat64);
    char full[PATH_MAX];
    if (directory != AT_FDCWD || !ours(path, full)) return real(directory, path, flags, mode);
    pthread_mutex_lock(&mutex);
    int created = (flags & O_CREAT) && access(full, F_OK) != 0;
    int fd = -1;
    if (created || (flags & O_TRUNC)) {
        enum fault fault = strike(full);
        if (fault == TEAR_AND_KILL) _exit(137);
        if (fault != NONE && fault != DROP) {
            pthread_mutex_unlock(&mutex);
            errno = error_number;
            return -1;
        }
    }
    fd = opened(path, flags, real(directory, path, flags, mode), full, created);
    pthread_mutex_unlock(&mutex);
    return fd;
}

#define MODE mode_t mode = 0; if (flags & (O_CREAT | O_TMPFILE)) { va_list l; va_start(l, flags); mode = va_arg(l, mode_t); va_end(l); }
int open(const char *path, int flags, ...) { MODE return open_at(AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE return open_at(AT_FDCWD, path, flags, mode); }
int openat(int directory, const char *path, int flags, ...) { MODE return open_at(directory, path, flags, mode); }
int openat64(int directory, const char *path, int flags, ...) { MODE return open_at(directory, path, flags, mode); }

int close(int fd) {
    REAL(close);
    if (fd >= 0 && fd < FILES && paths[fd]) {
        free(paths[fd]);
        paths[fd] = NULL;
    }
    return real(fd);
}

static ssize_t write_at(int fd, const void *data, size_t size, off_t where, int positioned) {
    if (fd < 0 || fd >= FILES || !paths[fd])
        return positioned ? real_pwrite(fd, data, size, where) : real_write(fd, data, size);
    pthread_mutex_lock(&mutex);
    enum fault fault = strike(paths[fd]);
    ssize_t done = -1;
    off_t offset = positioned ? where : lseek(fd, 0, SEEK_CUR);
    size_t part = fault == TEAR || fault == TEAR_AND_KILL ? size / 2 : size;
    if (fault == DROP) {
        if (!positioned) lseek(fd, (off_t)size, SEEK_CUR);
        done = (ssize_t)size;
    } else if (fault != FAIL && fault != FAIL_FROM_HERE) {
        done = part ? (positioned ? real_pwrite(fd, data, part, where) : real_write(fd, data, part)) : 0;
        if (done > 0) note('W', offset, paths[fd], NULL, data, (size_t)done);
        if (fault == TEAR_AND_KILL) _exit(137);
        if (fault == TEAR) done = -1;
    }
    pthread_mutex_unlock(&mutex);
    if (done < 0 && fault != NONE) errno = error_number;
    return done;
}

ssize_t write(int fd, const void *data, size_t size) { return write_at(fd, data, size, 0, 0); }
ssize_t pwrite(int fd, const void *data, size_t size, off_t where) { return write_at(fd, data, size, where, 1); }
ssize_t pwrite64(int fd, const void *data, size_t size, off64_t where) { return write_at(fd, data, size, where, 1); }

ssize_t writev(int fd, const struct iovec *parts, int number) {
    if (fd < 0 || fd >= FILES || !paths[fd]) {
        REAL(writev);
        return real(fd, parts, number);
    }
    ssize_t total = 0;
    for (int i = 0; i < number; i++) {
        ssize_t done = write_at(fd, parts[i].iov_base, parts[i].iov_len, 0, 0);
        if (done < 0) return total ? total : -1;
        total += done;
    }
    return total;
}

/* An operation that is done whole or not at all. */
#define WHOLE(what, offset, path, other, call)                       \
    pthread_mutex_lock(&mutex);                                      \
    enum fault fault = strike(path);                                 \
    int done = -1;                                                   \
    if (fault == TEAR_AND_KILL) _exit(137);                          \
    if (fault == DROP) done = 0;                                     \
    else if (fault == NONE && (done = call) == 0) note(what, offset, path, other, NULL, 0); \
    int failed = errno;                                              \
    pthread_mutex_unlock(&mutex);                                    \
    errno = fault == NONE ? failed : error_number;                   \
    return done

int fsync(int fd) {
    REAL(fsync);
    if (fd < 0 || fd >= FILES || !paths[fd]) return real(fd);
    WHOLE('S', 0, paths[fd], NULL, real(fd));
}

int fdatasync(int fd) {
    REAL(fdatasync);
    if (fd < 0 || fd >= FILES || !paths[fd]) return real(fd);
    WHOLE('S', 0, paths[fd], NULL, real(fd));
}

static int truncate_to(int fd, off_t size) {
    REAL(ftruncate64);
    if (fd < 0 || fd >= FILES || !paths[fd]) return real(fd, size);
    WHOLE('T', size, paths[fd], NULL, real(fd, size));
}

int ftruncate(int fd, off_t size) { return truncate_to(fd, size); }
int ftruncate64(int fd, off64_t size) { return truncate_to(fd, size); }

int rename(const char *from, const char *to) {
    REAL(rename);
    char old[PATH_MAX], fresh[PATH_MAX];
    if (!ours(from, old) || !ours(to, fresh)) return real(from, to);
    WHOLE('R', 0, old, fresh, real(from, to));
}

int unlink(const char *path) {
    REAL(unlink);
    char full[PATH_MAX];
    if (!ours(path, full)) return real(path);
    WHOLE('U', 0, full, NULL, real(path));
}

int rmdir(const char *path) {
    REAL(rmdir);
    char full[PATH_MAX];
    if (!ours(path, full)) return real(path);
    WHOLE('U', 0, full, NULL, real(path));
}

int mkdir(const char *path, mode_t mode) {
    REAL(mkdir);
    char full[PATH_MAX];
    if (!ours(path, full)) return real(path, mode);
    WHOLE('D', 0, full, NULL, real(path, mode));
}
