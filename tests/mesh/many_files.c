/* Runs tm-mesh on many files in one process: each line of stdin is one command (words separated by tabs), run in a
 * child forked from a parent that has the module 'image' open.
 *
 * Prints a line each: exit code, or minus the signal; seconds; the first line that the command prints on stderr. A
 * command that does not end within argv[1] seconds is killed and reported as -9. */
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "app.h"
#include "common/bandwidth.h"
#include "mesh/command.h"
#include "mesh/image.h"

enum { WORDS = 40, SAID = 400 };

static int run(char *line) {
    char *word[WORDS + 1] = {NULL}, *rest = line;
    int count = 0;
    for (char *one; count < WORDS && (one = strsep(&rest, "\t"));) word[count++] = one;
    return strcmp(word[0], "image") == 0 ? command_image(count, word) : command_fill(count, word);
}

/* Reads all output, so that the writer never blocks, and keeps its first line. Returns false at a time-out. */
static bool hear(int from, double until, char said[SAID]) {
    char block[4096];
    size_t at = 0;
    for (ssize_t got;;) {
        struct pollfd ready = {from, POLLIN, 0};
        const double left = until - app_seconds();
        if (left <= 0 || poll(&ready, 1, (int)(1e3 * left) + 1) <= 0) return false;
        if ((got = read(from, block, sizeof block)) <= 0) break;
        for (ssize_t i = 0; i < got && at + 1 < SAID; i++) said[at++] = block[i];
    }
    said[at] = 0;
    said[strcspn(said, "\n")] = 0;
    return true;
}

static void try(char *line, double most_s) {
    int pipes[2], status = 0;
    char said[SAID] = "";
    const double from = app_seconds();
    if (pipe(pipes)) exit(APP_FAILED);
    const pid_t child = fork();
    if (child == 0) {
        const int nowhere = open("/dev/null", O_RDWR);
        setpgid(0, 0);
        dup2(nowhere, STDIN_FILENO);
        dup2(nowhere, STDOUT_FILENO);
        dup2(pipes[1], STDERR_FILENO);
        close(pipes[0]);
        close(pipes[1]);
        _exit(run(line));
    }
    close(pipes[1]);
    if (!hear(pipes[0], from + most_s, said)) kill(-child, SIGKILL);
    close(pipes[0]);
    waitpid(child, &status, 0);
    printf("%d\t%.3f\t%s\n", WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), app_seconds() - from, said);
    fflush(stdout);
}

int main(int argc, char **argv) {
    tm_error error = {0};
    char line[4096];
    if (argc != 2 || !image_open_module(&error)) {
        fprintf(stderr, "usage: many_files SECONDS < commands%s%s\n", error.message[0] ? ": " : "", error.message);
        return APP_BAD_INPUT;
    }
    while (fgets(line, sizeof line, stdin)) {
        line[strcspn(line, "\n")] = 0;
        try(line, atof(argv[1]));
    }
    return APP_DONE;
}
