/* Ctrl-C ends a run, it does not kill it. */
#include <signal.h>
#include <stddef.h>

#include "run.h"

static volatile sig_atomic_t interrupted;

static void on_signal(int number) {
    (void)number;
    interrupted = 1;
}

bool run_interrupted(void) { return interrupted; }

void run_catch_signals(void) {
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
}
