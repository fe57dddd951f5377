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
/* Finds functions of an open library. Returns the name of the first that is missing; null if none is. */
const char *hrt_library_find(void *handle, const hrt_symbol *symbol);
/* Computes the quaternion (x, y, z, w) of a rotation; r[i][j] is component i of the handle's axis j. A matrix that is
 * no rotation or not finite gives a quaternion that is not of unit length, or not finite. */
void hrt_quaternion_of(const double r[3][3], double q[4]);

#endif
