/* Output files that appear complete or not at all. Devices, pipes and stdout are written directly. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/magic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "app.h"

static bool complain(tm_error *error, const char *path, const char *what, const char *remedy) {
    if (error) {
        error->status = TM_ERR_FILE;
        error->entity = -1;
        snprintf(error->message, sizeof error->message, "%s: %s; %s", path, what, remedy);
    }
    return false;
}

static bool fail(tm_error *error, const char *path, const char *what) {
    char all[300];
    snprintf(all, sizeof all, "%s: %s", what, strerror(errno));
    return complain(error, path, all, "check the folder and its permissions");
}

/* --- outputs that are not files --- */

static bool in_proc(const char *path) {
    int fd = open(path, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    struct statfs system;
    bool proc = fd >= 0 && fstatfs(fd, &system) == 0 && system.f_type == PROC_SUPER_MAGIC;
    if (fd >= 0) close(fd);
    return proc;
}

/* Follows links by name, so that the link stays and its target is replaced. Returns false for a link of /proc
 * (/dev/stdout, /dev/fd/3), which names an open file, not a path. */
static bool follow_links(char target[PATH_MAX]) {
    for (int i = 0; i < 40; i++) {
        char link[PATH_MAX], next[2 * PATH_MAX];
        ssize_t length = readlink(target, link, sizeof link - 1);
        if (length < 0) return true;
        if (in_proc(target)) return false;
        link[length] = 0;
        char *slash = strrchr(target, '/');
        int folder = link[0] == '/' || !slash ? 0 : (int)(slash - target) + 1;
        if ((size_t)snprintf(next, sizeof next, "%.*s%s", folder, target, link) >= PATH_MAX) return true;
        strcpy(target, next);
    }
    return true;
}

/* Opens the output by its descriptor; by name only if that truncates no data of others. */
static bool hold(app_output *output, int fd) {
    struct stat info;
    output->fd = fd;
    output->begun = output->through = true;
    bool appended = fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && (fcntl(fd, F_GETFL) & O_APPEND);
    output->temporary[0] = 0;
    if (!appended) snprintf(output->temporary, sizeof output->temporary, "/proc/%ld/fd/%d", (long)getpid(), fd);
    return true;
}

/* `-`: only the output goes to stdout; the program's messages go to stderr. */
static bool begin_stdout(app_output *output, tm_error *error) {
    static bool taken;
    if (taken) return complain(error, output->path, "two outputs go to stdout", "write one of them to a file");
    fflush(stdout);
    int fd = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    if (fd < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) return fail(error, "-", "cannot write to stdout");
    taken = true;
    return hold(output, fd);
}

/* Returns the number in /dev/fd/3, -1 for another path. Reopening it would start at its beginning. */
static int open_already(const char *target) {
    static const char *const folder[] = {"/proc/self/fd/", "/dev/fd/"};
    for (int i = 0; i < 2; i++) {
        size_t length = strlen(folder[i]);
        char *end;
        long fd = strncmp(target, folder[i], length) ? -1 : strtol(target + length, &end, 10);
        if (fd >= 0 && fd < 1 << 20 && end != target + length && !*end) return (int)fd;
    }
    return -1;
}

/* Opens a device or FIFO. A FIFO waits here for its reader, as in a shell. */
static bool begin_through(app_output *output, tm_error *error) {
    int given = open_already(output->target);
    if (given == STDOUT_FILENO) return begin_stdout(output, error);
    int fd = given >= 0 ? fcntl(given, F_DUPFD_CLOEXEC, 3) : open(output->path, O_WRONLY | O_NOCTTY | O_CLOEXEC);
    return fd < 0 ? fail(error, output->path, "cannot write") : hold(output, fd);
}

/* --- files --- */

/* Removes "name.123~" of a killed run on a file system without unnamed files: its lock is free. */
static void remove_stale(const char *folder, const char *name) {
    size_t length = strlen(name);
    DIR *all = opendir(folder);
    for (struct dirent *one; all && (one = readdir(all));) {
        if (strncmp(one->d_name, name, length) || one->d_name[length] != '.') continue;
        const char *number = one->d_name + length + 1, *rest = number + strspn(number, "0123456789");
        if (rest == number || strcmp(rest, "~")) continue;
        int fd = openat(dirfd(all), one->d_name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
        struct stat info;
        if (fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && flock(fd, LOCK_EX | LOCK_NB) == 0)
            unlinkat(dirfd(all), one->d_name, 0);
        if (fd >= 0) close(fd);
    }
    if (all) closedir(all);
}

/* Splits off the folder of `output->target`; "" if it is too long. */
static void split(const app_output *output, char folder[PATH_MAX], const char **name) {
    const char *slash = strrchr(output->target, '/');
    *name = slash ? slash + 1 : output->target;
    snprintf(folder, PATH_MAX, "%.*s", slash ? (int)(slash - output->target) + 1 : 2, slash ? output->target : "./");
}

static bool begin_file(app_output *output, mode_t mode, tm_error *error) {
    char folder[PATH_MAX];
    const char *name;
    split(output, folder, &name);
    remove_stale(folder, name);
    output->fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
    output->named = output->fd < 0;
    if (output->named) output->fd = open(output->whole, O_CREAT | O_EXCL | O_RDWR | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (output->fd < 0) return fail(error, output->path, "cannot write");
    flock(output->fd, LOCK_EX | LOCK_NB);
    if (mode) fchmod(output->fd, mode);
    if (output->named)
        snprintf(output->temporary, sizeof output->temporary, "%s", output->whole);
    else
        snprintf(output->temporary, sizeof output->temporary, "/proc/%ld/fd/%d", (long)getpid(), output->fd);
    return output->begun = true;
}

bool app_output_begin(app_output *output, const char *path, tm_error *error) {
    struct stat info;
    static unsigned count;
    *output = (app_output){.fd = -1};
    snprintf(output->path, sizeof output->path, "%s", path);
    errno = ENAMETOOLONG;
    if (strlen(path) >= sizeof output->path) return fail(error, output->path, "cannot write");
    if (!strcmp(path, "-")) return begin_stdout(output, error);
    snprintf(output->target, sizeof output->target, "%s", path);
    bool place = follow_links(output->target), there = stat(path, &info) == 0;
    if (there && S_ISDIR(info.st_mode)) return complain(error, path, "is a folder", "give a file name in that folder");
    if (there && S_ISBLK(info.st_mode)) return complain(error, path, "is a disk", "name a file");
    if (there && (!place || !S_ISREG(info.st_mode))) return begin_through(output, error);
    errno = EACCES;
    if (there && access(path, W_OK)) return fail(error, path, "cannot write");
    if ((size_t)snprintf(output->whole, sizeof output->whole, "%s.%ld%04u~", output->target, (long)getpid(),
                         count++ % 10000) >= sizeof output->whole)
        return fail(error, path, "cannot write");
    return begin_file(output, there ? info.st_mode & 0777 : 0, error);
}

FILE *app_output_stream(const app_output *output) {
    int fd = fcntl(output->fd, F_DUPFD_CLOEXEC, 3);
    FILE *stream = fd < 0 ? NULL : fdopen(fd, "wb");
    if (fd >= 0 && !stream) close(fd);
    return stream;
}

static bool put_in_place(app_output *output) {
    char held[64];
    snprintf(held, sizeof held, "/proc/self/fd/%d", output->fd);
    if (!output->named) {
        if (linkat(AT_FDCWD, held, AT_FDCWD, output->whole, AT_SYMLINK_FOLLOW)) return false;
        output->named = true;
    }
    return rename(output->whole, output->target) == 0;
}

bool app_output_commit(app_output *output, tm_error *error) {
    if (!output->begun) return false;
    if (!output->through && !put_in_place(output)) {
        fail(error, output->path, "cannot rename the finished file");
        app_output_abandon(output);
        return false;
    }
    close(output->fd);
    output->begun = false;
    return true;
}

void app_output_abandon(app_output *output) {
    if (!output->begun) return;
    if (output->named) unlink(output->whole);
    close(output->fd);
    output->begun = false;
}

bool app_output_end(app_output *output, FILE *stream, tm_error *error) {
    bool whole = stream && !ferror(stream);
    if (stream && fclose(stream) != 0) whole = false;
    if (whole) return app_output_commit(output, error);
    app_output_abandon(output);
    complain(error, output->path, "cannot be written completely",
             "the disk may be full: free some space, or choose another place");
    if (error) error->status = TM_ERR_LIMIT; /* not an input error: exit 1 */
    return false;
}
