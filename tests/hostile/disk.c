/* Preloaded into a command: counts its file operations below a folder, writes them down, and lets some of them fail.

   What to do is in a file that all processes of the command map; its name is in DISK_PLAN. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { DATA = 1, NAME = 2, ROOM = 4 }; /* of a file's content, of a name, and what needs room on the disk */

static struct plan {
    long long count, from, to; /* operations of these kinds so far; the first and the last that fail */
    int kinds, error;
    int logging;
    char folder[4096], log[4096]; /* where it counts; where each operation is written down */
} *plan;

__attribute__((constructor)) static void begin(void)
{
    const char *name = getenv("DISK_PLAN");
    int file = name ? (int)syscall(SYS_openat, AT_FDCWD, name, O_RDWR | O_CLOEXEC) : -1;
    if (file < 0)
        return;
    void *found = mmap(NULL, sizeof *plan, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    syscall(SYS_close, file);
    plan = found == MAP_FAILED ? NULL : found;
}

static void describe(char *path, size_t size, int folder, const char *name)
{
    char link[64];
    long n = 0;
    if (!name || name[0] != '/') {
        snprintf(link, sizeof link, folder == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", folder);
        n = syscall(SYS_readlink, link, path, size - 1);
        if (n < 0)
            n = 0;
    }
    path[n] = 0;
    if (name)
        snprintf(path + n, size - (size_t)n, "%s%s", n ? "/" : "", name);
}

/* Whether this operation fails, with errno set. */
static int fails(const char *what, int kinds, int folder, const char *name)
{
    char path[4096], line[4400];
    int before = errno;
    if (!plan || !plan->folder[0])
        return 0;
    describe(path, sizeof path, folder, name);
    size_t n = strlen(plan->folder);
    if (strncmp(path, plan->folder, n) || (path[n] && path[n] != '/')) {
        errno = before;
        return 0;
    }
    if (plan->logging) {
        int size = snprintf(line, sizeof line, "%d %s %s\n", kinds, what, path);
        int file = (int)syscall(SYS_openat, AT_FDCWD, plan->log, O_WRONLY | O_APPEND | O_CREAT, 0600);
        syscall(SYS_write, file, line, size);
        syscall(SYS_close, file);
    }
    errno = before;
    if (!(kinds & plan->kinds))
        return 0;
    long long number = __atomic_add_fetch(&plan->count, 1, __ATOMIC_RELAXED);
    if (number < plan->from || number > plan->to)
        return 0;
    errno = plan->error;
    return 1;
}

#define NEXT(function) ((__typeof__(&function))dlsym(RTLD_NEXT, #function))
#define WRAP(type, function, kinds, folder, name, parameters, arguments) \
    type function parameters \
    { \
        return fails(#function, kinds, folder, name) ? (type)-1 : NEXT(function) arguments; \
    }
#define MODE(flags) \
    va_list rest; \
    va_start(rest, flags); \
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
    va_end(rest)
#define OPEN(function) \
    int function(const char *name, int flags, ...) \
    { \
        MODE(flags); \
        int kinds = NAME | (flags & O_CREAT ? ROOM : 0); \
        return fails("open", kinds, AT_FDCWD, name) ? -1 : NEXT(function)(name, flags, mode); \
    }
#define OPENAT(function) \
    int function(int folder, const char *name, int flags, ...) \
    { \
        MODE(flags); \
        int kinds = NAME | (flags & O_CREAT ? ROOM : 0); \
        return fails("open", kinds, folder, name) ? -1 : NEXT(function)(folder, name, flags, mode); \
    }
#define FOPEN(function) \
    FILE *function(const char *name, const char *how) \
    { \
        return fails("open", NAME | (how[0] == 'r' ? 0 : ROOM), AT_FDCWD, name) ? NULL : NEXT(function)(name, how); \
    }
#define READDIR(type, function) \
    struct type *function(DIR *folder) \
    { \
        return fails("readdir", DATA, dirfd(folder), NULL) ? NULL : NEXT(function)(folder); \
    }

OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)
FOPEN(fopen)
FOPEN(fopen64)
READDIR(dirent, readdir)
READDIR(dirent64, readdir64)
DIR *opendir(const char *name)
{
    return fails("opendir", NAME, AT_FDCWD, name) ? NULL : NEXT(opendir)(name);
}
WRAP(ssize_t, read, DATA, file, NULL, (int file, void *to, size_t n), (file, to, n))
WRAP(ssize_t, pread64, DATA, file, NULL, (int file, void *to, size_t n, off64_t at), (file, to, n, at))
WRAP(ssize_t, write, DATA | ROOM, file, NULL, (int file, const void *from, size_t n), (file, from, n))
WRAP(ssize_t, pwrite64, DATA | ROOM, file, NULL, (int file, const void *from, size_t n, off64_t at), (file, from, n, at))
WRAP(ssize_t, sendfile64, DATA | ROOM, to, NULL, (int to, int from, off64_t *at, size_t n), (to, from, at, n))
WRAP(int, ftruncate64, DATA | ROOM, file, NULL, (int file, off64_t size), (file, size))
WRAP(int, fsync, DATA | ROOM, file, NULL, (int file), (file))
int close(int file) /* closes it also where it fails, as Linux does */
{
    int written = (fcntl(file, F_GETFL) & O_ACCMODE) != O_RDONLY, failed = fails("close", written ? DATA | ROOM : 0, file, NULL);
    int error = errno, done = NEXT(close)(file);
    errno = failed ? error : errno;
    return failed ? -1 : done;
}
WRAP(int, flock, DATA, file, NULL, (int file, int how), (file, how))
WRAP(int, stat, NAME, AT_FDCWD, name, (const char *name, struct stat *to), (name, to))
WRAP(int, stat64, NAME, AT_FDCWD, name, (const char *name, struct stat64 *to), (name, to))
WRAP(int, lstat64, NAME, AT_FDCWD, name, (const char *name, struct stat64 *to), (name, to))
WRAP(int, fstat64, DATA, file, NULL, (int file, struct stat64 *to), (file, to))
WRAP(int, fstatat64, NAME, folder, name, (int folder, const char *name, struct stat64 *to, int how), (folder, name, to, how))
WRAP(int, mkdir, NAME | ROOM, AT_FDCWD, name, (const char *name, mode_t mode), (name, mode))
WRAP(int, rmdir, NAME, AT_FDCWD, name, (const char *name), (name))
WRAP(int, unlink, NAME, AT_FDCWD, name, (const char *name), (name))
WRAP(int, unlinkat, NAME, folder, name, (int folder, const char *name, int how), (folder, name, how))
WRAP(int, rename, NAME, AT_FDCWD, to, (const char *from, const char *to), (from, to))
WRAP(int, chmod, NAME, AT_FDCWD, name, (const char *name, mode_t mode), (name, mode))
WRAP(int, symlink, NAME | ROOM, AT_FDCWD, name, (const char *to, const char *name), (to, name))
WRAP(ssize_t, readlink, NAME, AT_FDCWD, name, (const char *name, char *to, size_t n), (name, to, n))
