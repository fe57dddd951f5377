// The child process in which third-party libraries read files: each limit holds, and the child's end is reported
// whatever its cause.
#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

extern "C" {
#include <cmocka.h>
}

#include "image/box.h"

namespace {

enum { MEGABYTE = 1000 * 1000 };
const box_limits LIMITS = {"the library", 7, 300.0 * MEGABYTE, true};

struct outcome {
    image_end end;
    char why[IMAGE_WHY];
};

// Runs a child that returns no result.
outcome of(const std::function<image_end(char *)> &work, const box_limits &limits = LIMITS) {
    outcome o = {};
    o.end = image_box(
        limits, o.why, work, [](box_pipe &) {}, [](box_pipe &) { return true; });
    return o;
}

void assert_told(const outcome &o, const char *words) {
    if (o.end != IMAGE_BAD_INPUT || !strstr(o.why, words)) fail_msg("end %d: %s", o.end, o.why);
}

void its_results_come_back(void **) {
    char why[IMAGE_WHY];
    double got = 0;
    const image_end end = image_box(
        LIMITS, why, [](char *) { return IMAGE_DONE; },
        [](box_pipe &out) {
            const double value = 42;
            out.put(&value, sizeof value);
        },
        [&](box_pipe &in) { return in.take(&got, sizeof got); });
    assert_int_equal(end, IMAGE_DONE);
    assert_true(got == 42);
}

void its_limits_are_set(void **) {
    static const int which[] = {RLIMIT_CPU, RLIMIT_NOFILE, RLIMIT_FSIZE, RLIMIT_CORE};
    static const double most[] = {LIMITS.processor_s, 64, 0, 0};
    char why[IMAGE_WHY];
    rlim_t got[4];
    const image_end end = image_box(
        LIMITS, why, [](char *) { return IMAGE_DONE; },
        [](box_pipe &out) {
            for (const int limit : which) {
                rlimit value;
                getrlimit(__rlimit_resource_t(limit), &value);
                out.put(&value.rlim_cur, sizeof value.rlim_cur);
            }
        },
        [&](box_pipe &in) { return in.take(got, sizeof got); });
    assert_int_equal(end, IMAGE_DONE);
    for (int i = 0; i < 4; i++) assert_true(double(got[i]) == most[i]);
}

void what_it_exceeds_is_told(void **) {
    // A second of processor time, or 2.4 s on the clock of a busy machine.
    const box_limits short_time = {"the library", 1, 0, true};
    const auto spin = [](char *) {
        for (volatile int i = 0;; i = i + 1) {
        }
        return IMAGE_DONE;
    };
    assert_told(of(spin, short_time), "did not finish within");
    const auto sleep_on = [](char *) {
        for (;;) pause();
        return IMAGE_DONE;
    };
    assert_told(of(sleep_on, short_time), "did not finish within 2 s,");
    const auto write_file = [](char *) {
        FILE *file = tmpfile();
        if (file) fputs("a", file), fflush(file);
        return IMAGE_DONE;
    };
    assert_told(of(write_file), "tried to write a file");
    if (getenv("TM_SANITIZER")) return; // which reserve terabytes
    const auto fill = [](char *) {
        for (int i = 0; i < 10; i++) {
            char *memory = static_cast<char *>(malloc(100 * MEGABYTE));
            if (!memory) return IMAGE_NO_MEMORY;
            memset(memory, 1, 100 * MEGABYTE);
        }
        return IMAGE_DONE;
    };
    assert_told(of(fill), "needs more than 300 MB of memory");
}

void how_it_ends_is_told(void **) {
    const auto crash = [](char *) {
        signal(SIGSEGV, SIG_DFL);
        raise(SIGSEGV);
        return IMAGE_DONE;
    };
    assert_told(of(crash), "cannot read it (signal 11");
    const auto leave = [](char *) -> image_end { _exit(0); };
    assert_told(of(leave), "ended without a message");
    const auto refuse = [](char *why) {
        strcpy(why, "a sentence");
        return IMAGE_BAD_INPUT;
    };
    assert_told(of(refuse), "a sentence");
    char why[IMAGE_WHY];
    const image_end end = image_box(
        LIMITS, why, [](char *) { return IMAGE_DONE; }, [](box_pipe &out) { out.put("half", 4); },
        [](box_pipe &in) {
            char whole[8];
            return in.take(whole, sizeof whole);
        });
    assert_int_equal(end, IMAGE_BAD_INPUT);
}

volatile sig_atomic_t heard;

void a_signal_ends_it(void **) {
    struct sigaction action = {}, before;
    action.sa_handler = [](int) { heard = 1; };
    sigaction(SIGTERM, &action, &before);
    const outcome o = of([](char *) {
        kill(getppid(), SIGTERM);
        for (;;) pause();
        return IMAGE_DONE;
    });
    sigaction(SIGTERM, &before, nullptr);
    assert_int_equal(o.end, IMAGE_STOPPED);
    assert_true(heard);
}

} // namespace

int main() {
    const CMUnitTest tests[] = {cmocka_unit_test(its_results_come_back), cmocka_unit_test(its_limits_are_set),
                                cmocka_unit_test(what_it_exceeds_is_told), cmocka_unit_test(how_it_ends_is_told),
                                cmocka_unit_test(a_signal_ends_it)};
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
