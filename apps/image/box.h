// Runs a library's work in a child process with limits, so that no file can crash, block or fill the caller.
#ifndef IMAGE_BOX_H
#define IMAGE_BOX_H

#include <csignal>
#include <cstddef>
#include <functional>

#include "image_api.h"

struct box_limits {
    const char *library; // named in messages: "ITK"
    double processor_s;  // 0: none; 2.4 times as long by the clock
    double memory_bytes; // beside what the caller holds; 0: none
    bool quiet;          // stderr is closed and no file can be written; false: the work reports progress
};

// One end of the pipe between child and caller. After an error every call fails.
class box_pipe {
  public:
    box_pipe(int descriptor, double deadline_s, const sigset_t *open)
        : fd(descriptor), until(deadline_s), signals(open) {}
    bool put(const void *from, size_t bytes);
    bool take(void *to, size_t bytes);
    // Takes `count` items of `bytes` into memory of malloc; null after an error, or with more than `most` items.
    void *take_array(double count, size_t bytes, double most);
    bool stopped = false, late = false; // a signal came; the clock ran out

  private:
    bool wait();
    const int fd;
    const double until;
    const sigset_t *const signals;
    bool failed = false;
};

// Runs `work` in a child. When it ends with IMAGE_DONE, `give` writes its results and `take` reads them in the caller;
// `take` returns false if they cannot be, and must then free what it has. A crash or a limit is IMAGE_BAD_INPUT with a
// sentence in `why`; a signal that the caller handles is IMAGE_STOPPED.
image_end image_box(const box_limits &limits, char why[IMAGE_WHY], const std::function<image_end(char *)> &work,
                    const std::function<void(box_pipe &)> &give, const std::function<bool(box_pipe &)> &take);

#endif
