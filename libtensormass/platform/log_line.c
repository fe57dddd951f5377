/* Writes log lines that never block. */
#include "log_line.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LINE = 1024 };

static pthread_once_t once = PTHREAD_ONCE_INIT;
static int end_fd = STDERR_FILENO;
static enum { FILE_END, WAITING_END, SOCKET_END } kind;
static _Atomic int left_out;

/* Opens a pipe or terminal once more, so that only this descriptor is non-blocking: O_NONBLOCK on stderr itself would
 * affect all processes that share it. */
static void look(void) {
    struct stat about;
    if (fstat(STDERR_FILENO, &about) != 0) return;
    if (S_ISSOCK(about.st_mode)) kind = SOCKET_END;
    if (!S_ISFIFO(about.st_mode) && !(S_ISCHR(about.st_mode) && isatty(STDERR_FILENO))) return;
    kind = WAITING_END;
    const int fd = open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (fd >= 0) end_fd = fd;
}

static bool write_line(const char *line, size_t size) {
    struct pollfd ready = {.fd = end_fd, .events = POLLOUT};
    if (kind == SOCKET_END) return send(end_fd, line, size, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0;
    if (kind == WAITING_END && (poll(&ready, 1, 0) <= 0 || !(ready.revents & POLLOUT))) return false;
    return write(end_fd, line, size) >= 0;
}

void app_say(const char *format, ...) {
    va_list list;
    va_start(list, format);
    app_say_list(format, list);
    va_end(list);
}

void app_say_list(const char *format, va_list list) {
    char line[LINE];
    pthread_once(&once, look);
    int size = vsnprintf(line, sizeof line - 1, format, list);
    if (size < 0) return;
    if (size > (int)sizeof line - 2) size = (int)sizeof line - 2;
    if (!size || line[size - 1] != '\n') line[size++] = '\n';
    const int missing = atomic_exchange(&left_out, 0);
    char note[64];
    const int note_size =
        missing ? snprintf(note, sizeof note, "(%d messages were dropped: the output was not read in time)\n", missing)
                : 0;
    if ((note_size && !write_line(note, (size_t)note_size)) || !write_line(line, (size_t)size))
        atomic_fetch_add(&left_out, missing + 1);
}
