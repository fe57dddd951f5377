// Runs a library's work in a child process with limits, so that no file can crash, block or exhaust the caller.
#ifndef IMAGE_BOX_H
#define IMAGE_BOX_H

#include <csignal>
#include <cstddef>
#include <functional>

#include "image_api.h"

struct box_limits {
    const char *library; // named in messages: "ITK"
    double processor_s;  // processor time limit, s; wall clock limit 2.4 times as long; 0: none
    double memory_bytes; // in addition to the caller's memory; 0: no limit
    bool quiet;          // true: stderr is closed and no file can be written; false: the work reports progress
};

// One end of the pipe between child and caller. After an error every call fails.
class box_pipe {
  public:
    box_pipe(int descriptor, double deadline_s, const sigset_t *open)
        : fd(descriptor), until(deadline_s), signals(open) {}
    bool put(const void *from, size_t bytes);
    bool take(void *to, size_t bytes);
    // Reads `count` items of `bytes` into malloced memory. Returns null after an error, or for more than `most` items.
    void *take_array(double count, size_t bytes, double most);
    bool stopped = false, late = false; // a signal arrived; a time limit expired

  private:
    bool wait();
    const int fd;
    const double until;
    const sigset_t *const signals;
    bool failed = false;
};

// Runs `work` in a child. After IMAGE_DONE, `give` writes its results and `take` reads them in the caller. `take`
// returns false if they are invalid, and must then free what it allocated. A crash or an exceeded limit returns
// IMAGE_BAD_INPUT with a message in `why`; a signal that the caller handles returns IMAGE_STOPPED.
image_end image_box(const box_limits &limits, char why[IMAGE_WHY], const std::function<image_end(char *)> &work,
                    const std::function<void(box_pipe &)> &give, const std::function<bool(box_pipe &)> &take);

#endif
