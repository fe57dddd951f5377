#include "box.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>

namespace {

const double CLOCK_FACTOR = 2.4; // of the processor time, for a busy machine
enum { OPEN_FILES = 64 };

double clock_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

void limit(int what, double most) {
    rlimit value;
    if (getrlimit(__rlimit_resource_t(what), &value) != 0) return;
    const double hard = value.rlim_max == RLIM_INFINITY ? HUGE_VAL : double(value.rlim_max);
    value.rlim_cur = rlim_t(std::fmin(std::ceil(most), hard));
    setrlimit(__rlimit_resource_t(what), &value);
}

// Returns the address space that this process uses, bytes.
double address_space() {
    double pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file && fscanf(file, "%lf", &pages) != 1) pages = 0;
    if (file) fclose(file);
    return pages * double(sysconf(_SC_PAGESIZE));
}

// Returns whether memory can be limited. Sanitizers reserve terabytes of address space.
bool limits_memory() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return false;
#else
    return getenv("TM_SANITIZER") == nullptr;
#endif
}

void confine(const box_limits &limits) {
    for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGXCPU, SIGXFSZ, SIGSEGV, SIGABRT}) signal(number, SIG_DFL);
    signal(SIGPIPE, SIG_IGN);
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_NOFILE, OPEN_FILES);
    if (limits.processor_s > 0) limit(RLIMIT_CPU, limits.processor_s);
    if (limits.memory_bytes > 0 && limits_memory()) limit(RLIMIT_AS, address_space() + limits.memory_bytes);
    if (!limits.quiet) return;
    limit(RLIMIT_FSIZE, 0);
    const int nowhere = open("/dev/null", O_RDWR);
    for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) dup2(nowhere, fd);
}

// Outcome that the child sends before its results.
struct verdict {
    image_end end;
    char why[IMAGE_WHY];
};

[[noreturn]] void run_child(const box_limits &limits, int to, pid_t parent,
                            const std::function<image_end(char *)> &work, const std::function<void(box_pipe &)> &give) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(1);
    confine(limits);
    verdict said = {};
    said.end = work(said.why);
    box_pipe out(to, HUGE_VAL, nullptr);
    out.put(&said, sizeof said);
    if (said.end == IMAGE_DONE) give(out);
    _exit(0);
}

// Explains why a child ended by a signal.
image_end tell_signal(const box_limits &limits, int number, char why[IMAGE_WHY]) {
    if (number == SIGXCPU)
        snprintf(
            why, IMAGE_WHY,
            "%s did not finish within %.0f s of processor time, so the file is damaged or too large; save it again",
            limits.library, limits.processor_s);
    else if (number == SIGXFSZ)
        snprintf(why, IMAGE_WHY, "%s tried to write a file, so the image is damaged; save it again", limits.library);
    else
        snprintf(why, IMAGE_WHY,
                 "%s cannot read it (signal %d, %s), so the file is truncated or damaged; copy it again",
                 limits.library, number, strsignal(number));
    return IMAGE_BAD_INPUT;
}

image_end tell_memory(const box_limits &limits, char why[IMAGE_WHY]) {
    snprintf(
        why, IMAGE_WHY,
        "%s needs more than %.0f MB of memory for it, so the file is damaged or too large; save it again, or smaller",
        limits.library, 1e-6 * limits.memory_bytes);
    return IMAGE_BAD_INPUT;
}

// Reads outcome and results. Returns IMAGE_FAILED without a message if the child ended before it sent them.
image_end hear(const box_limits &limits, int from, const sigset_t *open, char why[IMAGE_WHY],
               const std::function<bool(box_pipe &)> &take) {
    const double wait_s = limits.processor_s > 0 ? CLOCK_FACTOR * limits.processor_s : HUGE_VAL;
    box_pipe in(from, clock_s() + wait_s, open);
    verdict said = {};
    const bool whole = in.take(&said, sizeof said) && (said.end != IMAGE_DONE || take(in));
    if (in.stopped) return IMAGE_STOPPED;
    if (in.late) {
        snprintf(
            why, IMAGE_WHY,
            "%s did not finish within %.0f s, so the file is damaged or too large, or the machine is busy; try again, or save the file again",
            limits.library, wait_s);
        return IMAGE_BAD_INPUT;
    }
    if (!whole) return IMAGE_FAILED;
    said.why[IMAGE_WHY - 1] = 0;
    if (said.end == IMAGE_NO_MEMORY && limits.memory_bytes > 0) return tell_memory(limits, why);
    memcpy(why, said.why, IMAGE_WHY);
    return said.end;
}

} // namespace

// Waits until the pipe has bytes. Signals that the caller handles are unblocked only here, so that none is missed.
bool box_pipe::wait() {
    pollfd ready = {fd, POLLIN, 0};
    const double left = until - clock_s();
    if (left <= 0) return late = true, false;
    timespec most = {time_t(std::fmin(left, 1e6)), 0};
    most.tv_nsec = long(1e9 * (std::fmin(left, 1e6) - double(most.tv_sec)));
    const int got = ppoll(&ready, 1, &most, signals);
    if (got < 0) stopped = errno == EINTR;
    return got >= 0;
}

bool box_pipe::take(void *to, size_t bytes) {
    char *at = static_cast<char *>(to);
    while (!failed && bytes > 0) {
        if (!wait()) return failed = true, false;
        pollfd ready = {fd, POLLIN, 0};
        if (poll(&ready, 1, 0) <= 0) continue;
        const ssize_t got = read(fd, at, bytes);
        if (got <= 0) return failed = true, false;
        at += got;
        bytes -= size_t(got);
    }
    return !failed;
}

void *box_pipe::take_array(double count, size_t bytes, double most) {
    if (failed || !(count >= 0) || count > most) return nullptr;
    void *to = malloc(size_t(count) * bytes + 1);
    if (to && take(to, size_t(count) * bytes)) return to;
    free(to);
    return nullptr;
}

bool box_pipe::put(const void *from, size_t bytes) {
    const char *at = static_cast<const char *>(from);
    while (!failed && bytes > 0) {
        const ssize_t sent = write(fd, at, bytes);
        if (sent < 0 && errno != EINTR) failed = true;
        if (sent > 0) at += sent, bytes -= size_t(sent);
    }
    return !failed;
}

image_end image_box(const box_limits &limits, char why[IMAGE_WHY], const std::function<image_end(char *)> &work,
                    const std::function<void(box_pipe &)> &give, const std::function<bool(box_pipe &)> &take) {
    int pipes[2], status = 0;
    sigset_t watched, before;
    why[0] = 0;
    if (pipe2(pipes, O_CLOEXEC) != 0) {
        snprintf(why, IMAGE_WHY, "no process can be started to read it: %s; close other programs", strerror(errno));
        return IMAGE_FAILED;
    }
    sigemptyset(&watched);
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&watched, number);
    sigprocmask(SIG_BLOCK, &watched, &before);
    const pid_t parent = getpid(), child = fork();
    if (child == 0) {
        sigprocmask(SIG_SETMASK, &before, nullptr);
        close(pipes[0]);
        run_child(limits, pipes[1], parent, work, give);
    }
    close(pipes[1]);
    image_end end = IMAGE_FAILED;
    if (child < 0)
        snprintf(why, IMAGE_WHY, "no process can be started to read it: %s; close other programs", strerror(errno));
    else
        end = hear(limits, pipes[0], &before, why, take);
    close(pipes[0]);
    if (child > 0 && (end == IMAGE_STOPPED || why[0])) kill(child, SIGKILL); // late, stopped, or no longer needed
    if (child > 0)
        while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
        }
    sigset_t pending;
    sigpending(&pending);
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) // signal arrived outside a wait; the child may have died of it
        if (!why[0] && end == IMAGE_FAILED && sigismember(&pending, number)) end = IMAGE_STOPPED;
    sigprocmask(SIG_SETMASK, &before, nullptr);
    if (end != IMAGE_FAILED || why[0]) return end;
    if (WIFSIGNALED(status)) return tell_signal(limits, WTERMSIG(status), why);
    snprintf(why, IMAGE_WHY, "%s ended without a message, so the file is truncated or damaged; save it again",
             limits.library);
    return IMAGE_BAD_INPUT;
}
