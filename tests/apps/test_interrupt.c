/* Signals: the program handles the first one; the second ends the process at once. */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "app.h"
#include "io/loop.h"

static _Atomic bool stop;

static int first(void) { return app_interrupted(); }
static int first_of_controller(void) { return atomic_load(&stop); }

/* The child ignores the request. It reports when it is ready, and when it has received the first signal. */
static void ended_by(void (*catch_signals)(void), int (*seen)(void), int one, int other) {
    int said[2], status = 0;
    char word;
    assert_int_equal(pipe(said), 0);
    pid_t child = fork();
    if (!child) {
        catch_signals();
        if (write(said[1], "r", 1) != 1) _exit(1);
        while (!seen()) {
        }
        if (write(said[1], "s", 1) != 1) _exit(1);
        alarm(120);
        for (;;) {
        }
    }
    assert_int_equal(read(said[0], &word, 1), 1);
    kill(child, one);
    assert_int_equal(read(said[0], &word, 1), 1);
    kill(child, other);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), other);
    close(said[0]);
    close(said[1]);
}

static void catch_controller(void) { hrt_stop_on_signals(&stop); }

static void second_signal_ends_a_program(void **state) {
    (void)state;
    ended_by(app_catch_signals, first, SIGINT, SIGINT);
    ended_by(app_catch_signals, first, SIGINT, SIGTERM);
    ended_by(app_catch_signals, first, SIGTERM, SIGINT);
}

static void second_signal_ends_a_controller(void **state) {
    (void)state;
    ended_by(catch_controller, first_of_controller, SIGINT, SIGINT);
    ended_by(catch_controller, first_of_controller, SIGTERM, SIGTERM);
}

static void exit_status_contains_the_signal_number(void **state) {
    (void)state;
    app_catch_signals();
    assert_int_equal(app_interrupted_exit(), 0);
    raise(SIGTERM);
    assert_int_equal(app_interrupted(), SIGTERM);
    assert_int_equal(app_interrupted_exit(), 143);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(second_signal_ends_a_program),
                                       cmocka_unit_test(second_signal_ends_a_controller),
                                       cmocka_unit_test(exit_status_contains_the_signal_number)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
