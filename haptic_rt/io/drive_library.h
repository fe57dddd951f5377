/* Opens a maker's library at run time: no header of it is needed to build, and it may be missing. */
#ifndef HRT_DRIVE_LIBRARY_H
#define HRT_DRIVE_LIBRARY_H

#include <stdbool.h>

typedef struct hrt_symbol {
    const char *name;
    void **function;
} hrt_symbol;

/* Opens the library in $`variable` if that is set, else the first of `names` (null at the end) that is installed, and
 * finds its functions (a null name at the end). Returns its handle, or null with `why`, which names the library. */
void *hrt_library_open(const char *variable, const char *const *names, const char *what, const hrt_symbol *symbol,
                       char *why, int why_size);

#endif
