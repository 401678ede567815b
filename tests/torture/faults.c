/* Loaded before the C library (LD_PRELOAD): counts the file operations that change something below one folder, of all
   threads and processes of a command, in Python, Rust and C alike, and does something to the N-th: a kill, a signal, an
   error. What is to be done stands in a file that torture_faults.py writes and all these processes map. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { NOTHING, KILL, SIGNAL, FAIL, FAIL_ONCE };
enum { CHANGE = 1, GROW = 2, NAME = 4 }; /* of an operation: writes content, takes space, changes a folder */

struct plan {
    int64_t count, at, action, number, tear;
    char folder[1024], log[1024];
};
static struct plan *plan;

/* Take up the plan that the environment names; a process that forked calls it again. */
void torture_begin(void) {
    const char *path = getenv("TORTURE_PLAN");
    int fd = path ? (int)syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CLOEXEC, 0) : -1;
    void *page = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof(struct plan), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (fd >= 0) syscall(SYS_close, fd);
    plan = page == MAP_FAILED ? NULL : page;
}

__attribute__((constructor)) static void begin(void) { torture_begin(); }

static int is_watched(const char *path) {
    size_t length = strlen(plan->folder);
    return strncmp(path, plan->folder, length) == 0 && (path[length] == '/' || path[length] == 0);
}

static void note(int64_t n, const char *operation, const char *path) {
    char line[PATH_MAX + 64];
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    int length = snprintf(line, sizeof line, "%ld %ld%09ld %s %s\n", (long)n, (long)now.tv_sec, now.tv_nsec, operation, path);
    int fd = (int)syscall(SYS_openat, AT_FDCWD, plan->log, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644);
    if (fd >= 0) {
        (void)!syscall(SYS_write, fd, line, (size_t)length);
        syscall(SYS_close, fd);
    }
}

/* Whether an error of this number comes of such an operation. */
static int fails(int kind, int fits) {
    switch (plan->number) {
    case ENOSPC: case EDQUOT: return (kind & GROW) && !fits;
    case EACCES: return kind & NAME;
    default: return 1;
    }
}

/* One operation on a path: 0 to go on, else the errno that it ends with. `*half` asks a write to do half of its work only,
   and to call again where that is to be its last. */
static int operation(const char *name, const char *path, int kind, int fits, int *half) {
    if (plan == NULL || !is_watched(path)) return 0;
    int64_t n = half && *half ? plan->at : __atomic_add_fetch(&plan->count, 1, __ATOMIC_SEQ_CST);
    if (!(half && *half)) note(n, name, path);
    int now = n == plan->at;
    if (now && half && !*half && plan->tear && (plan->action == KILL || (plan->action == FAIL && fails(kind, fits)))) {
        *half = 1;
        return 0;
    }
    if (now && plan->action == KILL) {
        syscall(SYS_kill, syscall(SYS_getpid), SIGKILL);
        for (;;) pause();
    }
    if (now && plan->action == SIGNAL) syscall(SYS_kill, syscall(SYS_getpid), plan->number);
    if ((plan->action == FAIL ? n >= plan->at : plan->action == FAIL_ONCE && now) && fails(kind, fits)) return (int)plan->number;
    return 0;
}

static void absolute(int folder, const char *path, char *out) { /* folder: a descriptor or AT_FDCWD; out: PATH_MAX */
    char at[64], base[PATH_MAX] = "";
    if (path[0] != '/') {
        if (folder == AT_FDCWD) snprintf(at, sizeof at, "/proc/self/cwd");
        else snprintf(at, sizeof at, "/proc/self/fd/%d", folder);
        ssize_t length = readlink(at, base, sizeof base - 1);
        base[length < 0 ? 0 : length] = 0;
    }
    if (snprintf(out, PATH_MAX, "%s%s%s", base, base[0] ? "/" : "", path) >= PATH_MAX) out[PATH_MAX - 1] = 0;
}

static int on_path(const char *name, int folder, const char *path, int kind) {
    char full[PATH_MAX];
    if (plan == NULL) return 0;
    absolute(folder, path, full);
    return operation(name, full, kind, 0, NULL);
}

static int on_file(const char *name, int fd, off_t offset, size_t count, int kind, int *half) {
    char at[64], path[PATH_MAX];
    if (plan == NULL) return 0;
    snprintf(at, sizeof at, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(at, path, sizeof path - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    struct stat found;
    if (path[0] != '/' || fstat(fd, &found)) return 0;
    if (offset < 0) offset = fcntl(fd, F_GETFL) & O_APPEND ? found.st_size : lseek(fd, 0, SEEK_CUR);
    return operation(name, path, kind, offset + (off_t)count <= found.st_blocks * 512, half);
}

#define NEXT(name) \
    static __typeof__(name) *next; \
    if (next == NULL) next = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)
#define REFUSED(error) \
    { int why = (error); if (why) { errno = why; return -1; } }

/* --------------------------------------------------------------------------------------------------- opening */
static int opens(int folder, const char *path, int flags) {
    if (plan == NULL || !(flags & (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC))) return 0;
    struct stat found;
    int is_new = (flags & O_CREAT) && fstatat(folder, path, &found, 0);
    return on_path("open", folder, path, CHANGE | NAME | (is_new ? GROW : 0));
}
#define MODE mode_t mode = 0; if (flags & (O_CREAT | __O_TMPFILE)) { va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); }
int open(const char *path, int flags, ...) { MODE NEXT(open); REFUSED(opens(AT_FDCWD, path, flags)); return next(path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE NEXT(open64); REFUSED(opens(AT_FDCWD, path, flags)); return next(path, flags, mode); }
int openat(int folder, const char *path, int flags, ...) { MODE NEXT(openat); REFUSED(opens(folder, path, flags)); return next(folder, path, flags, mode); }
int openat64(int folder, const char *path, int flags, ...) { MODE NEXT(openat64); REFUSED(opens(folder, path, flags)); return next(folder, path, flags, mode); }
static int fopens(const char *path, const char *mode) { return mode[0] == 'r' && !strchr(mode, '+') ? 0 : opens(AT_FDCWD, path, O_CREAT | O_WRONLY); }
#define FOPEN(name) FILE *name(const char *path, const char *mode) { NEXT(name); int why = fopens(path, mode); if (why) { errno = why; return NULL; } return next(path, mode); }
FOPEN(fopen)
FOPEN(fopen64)

/* --------------------------------------------------------------------------------------------------- content */
#define WRITE(name, type, offset, ...) \
    type name(__VA_ARGS__) { \
        NEXT(name); \
        int half = 0; \
        REFUSED(on_file(#name, fd, offset, count, CHANGE | GROW, &half)); \
        if (!half) return GO(count); \
        ssize_t done = GO(count / 2); \
        if (plan->action == KILL) operation(#name, plan->folder, CHANGE | GROW, 0, &half); \
        return done; \
    }
#define GO(n) next(fd, data, n)
WRITE(write, ssize_t, -1, int fd, const void *data, size_t count)
#undef GO
#define GO(n) next(fd, data, n, at)
WRITE(pwrite, ssize_t, at, int fd, const void *data, size_t count, off_t at)
WRITE(pwrite64, ssize_t, at, int fd, const void *data, size_t count, off64_t at)
#undef GO
#define GO(n) next(fd, from, at, n)
WRITE(sendfile, ssize_t, -1, int fd, int from, off_t *at, size_t count)
WRITE(sendfile64, ssize_t, -1, int fd, int from, off64_t *at, size_t count)
#undef GO
ssize_t writev(int fd, const struct iovec *parts, int n) {
    NEXT(writev);
    size_t count = 0;
    for (int i = 0; i < n; i++) count += parts[i].iov_len;
    REFUSED(on_file("writev", fd, -1, count, CHANGE | GROW, NULL));
    return next(fd, parts, n);
}
ssize_t copy_file_range(int from, off64_t *a, int fd, off64_t *b, size_t count, unsigned flags) {
    NEXT(copy_file_range);
    REFUSED(on_file("copy_file_range", fd, b ? *b : -1, count, CHANGE | GROW, NULL));
    return next(from, a, fd, b, count, flags);
}
int ftruncate(int fd, off_t size) { NEXT(ftruncate); REFUSED(on_file("ftruncate", fd, 0, 0, CHANGE, NULL)); return next(fd, size); }
int ftruncate64(int fd, off64_t size) { NEXT(ftruncate64); REFUSED(on_file("ftruncate64", fd, 0, 0, CHANGE, NULL)); return next(fd, size); }
int posix_fallocate(int fd, off_t at, off_t count) { NEXT(posix_fallocate); int why = on_file("posix_fallocate", fd, at, (size_t)count, CHANGE | GROW, NULL); return why ? why : next(fd, at, count); }
int posix_fallocate64(int fd, off64_t at, off64_t count) { NEXT(posix_fallocate64); int why = on_file("posix_fallocate64", fd, at, (size_t)count, CHANGE | GROW, NULL); return why ? why : next(fd, at, count); }
int fsync(int fd) { NEXT(fsync); REFUSED(on_file("fsync", fd, 0, 0, CHANGE, NULL)); return next(fd); }
int fdatasync(int fd) { NEXT(fdatasync); REFUSED(on_file("fdatasync", fd, 0, 0, CHANGE, NULL)); return next(fd); }

/* --------------------------------------------------------------------------------------------------- names */
int mkdir(const char *path, mode_t mode) { NEXT(mkdir); REFUSED(on_path("mkdir", AT_FDCWD, path, NAME | GROW)); return next(path, mode); }
int mkdirat(int folder, const char *path, mode_t mode) { NEXT(mkdirat); REFUSED(on_path("mkdir", folder, path, NAME | GROW)); return next(folder, path, mode); }
int rename(const char *old, const char *new) { NEXT(rename); REFUSED(on_path("rename", AT_FDCWD, new, NAME)); return next(old, new); }
int renameat(int a, const char *old, int b, const char *new) { NEXT(renameat); REFUSED(on_path("rename", b, new, NAME)); return next(a, old, b, new); }
int renameat2(int a, const char *old, int b, const char *new, unsigned flags) { NEXT(renameat2); REFUSED(on_path("rename", b, new, NAME)); return next(a, old, b, new, flags); }
int link(const char *old, const char *new) { NEXT(link); REFUSED(on_path("link", AT_FDCWD, new, NAME)); return next(old, new); }
int linkat(int a, const char *old, int b, const char *new, int flags) { NEXT(linkat); REFUSED(on_path("link", b, new, NAME)); return next(a, old, b, new, flags); }
int symlink(const char *old, const char *new) { NEXT(symlink); REFUSED(on_path("symlink", AT_FDCWD, new, NAME | GROW)); return next(old, new); }
int symlinkat(const char *old, int folder, const char *new) { NEXT(symlinkat); REFUSED(on_path("symlink", folder, new, NAME | GROW)); return next(old, folder, new); }
int unlink(const char *path) { NEXT(unlink); REFUSED(on_path("unlink", AT_FDCWD, path, NAME)); return next(path); }
int unlinkat(int folder, const char *path, int flags) { NEXT(unlinkat); REFUSED(on_path("unlink", folder, path, NAME)); return next(folder, path, flags); }
int utimensat(int folder, const char *path, const struct timespec times[2], int flags) { NEXT(utimensat); REFUSED(on_path("utime", folder, path, CHANGE | NAME)); return next(folder, path, times, flags); }
int rmdir(const char *path) { NEXT(rmdir); REFUSED(on_path("rmdir", AT_FDCWD, path, NAME)); return next(path); }
