/* The first signal requests the end of a run; the second forces it. */
#include "../fixture.h"

#include "app.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

static void second_signal_ends_the_run_at_once(void **state) {
    (void)state;
    const int number[2] = {SIGINT, SIGTERM};
    for (int i = 0; i < 2; i++) {
        const pid_t child = fork();
        if (child == 0) {
            app_catch_signals();
            const bool before = app_interrupted() != 0;
            raise(number[i]);
            if (before || !app_interrupted()) _exit(1);
            raise(number[i]);
            _exit(2);
        }
        int status;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status));
        assert_int_equal(WTERMSIG(status), number[i]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(second_signal_ends_the_run_at_once)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
