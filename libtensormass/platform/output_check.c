/* Reports outputs that cannot be written, before and after a run. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app.h"

int app_output_check(const char *path) {
    tm_error error = {0};
    struct stat info;
    app_output output;
    /* A pipe is not opened twice: its reader would take the first close for the end. */
    if (!path || !strcmp(path, "-") || (stat(path, &info) == 0 && (S_ISFIFO(info.st_mode) || S_ISCHR(info.st_mode))))
        return APP_DONE;
    if (!app_output_begin(&output, path, &error)) return app_report(NULL, 0, &error);
    app_output_abandon(&output);
    return APP_DONE;
}

int app_output_ending(const char *option, const char *path, const char *endings) {
    struct stat info;
    if (!strcmp(path, "-") || (stat(path, &info) == 0 && !S_ISREG(info.st_mode))) return APP_DONE;
    const char *slash = strrchr(path, '/'), *dot = strrchr(slash ? slash : path, '.');
    size_t length = dot ? strlen(dot) : 0;
    for (const char *at = endings; length && *at; at += strcspn(at, " "), at += strspn(at, " "))
        if (strcspn(at, " ") == length && !strncasecmp(at, dot, length)) return APP_DONE;
    char all[100];
    size_t used = 0;
    for (const char *at = endings; *at && used + 8 < sizeof all; at++)
        used += (size_t)snprintf(all + used, sizeof all - used, *at == ' ' ? " nor " : "%c", *at);
    bool many = strchr(endings, ' ');
    return app_bad_input(option, 0, "%s: is %s %s; give the file %s", path, many ? "neither" : "not", all,
                         many ? "one of these endings" : "this ending");
}

/* --- stdout --- */

static void check_stdout(int status, void *unused) {
    (void)unused;
    errno = 0;
    bool lost = ferror(stdout) != 0, unwritten = fflush(stdout) != 0;
    if (!lost && !unwritten) return;
    fprintf(stderr, "stdout: cannot be written: %s; the printed output is incomplete\n",
            errno ? strerror(errno) : "write error");
    _exit(status ? status : APP_FAILED);
}

void app_check_stdout(void) { on_exit(check_stdout, NULL); }
