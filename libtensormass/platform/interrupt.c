/* Ctrl-C and SIGTERM: the first asks a run to end, the second ends the program at once. */
#include <signal.h>
#include <stddef.h>
#include <stdio.h>

#include "app.h"

static volatile sig_atomic_t caught;

static void on_signal(int number) {
    caught = number;
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
}

int app_interrupted(void) { return caught; }

int app_interrupted_exit(void) { return caught ? 128 + caught : APP_DONE; }

int app_ended(const char *program, int rc) {
    if (rc != APP_FAILED && rc != APP_BAD_INPUT) return rc;
    if (!caught) return rc;
    fprintf(stderr, "%s: interrupted; nothing was written\n", program);
    return app_interrupted_exit();
}

void app_catch_signals(void) {
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
}
