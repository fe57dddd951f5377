/* File of a virtual bus: creation, mapping, sharing, claims, recovery after its removal. The last user removes it. */
#ifndef HRT_BUS_VIRTUAL_FILE_H
#define HRT_BUS_VIRTUAL_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "bus_virtual.h"

typedef enum hrt_virtual_trouble {
    HRT_VIRTUAL_WELL = 0,
    HRT_VIRTUAL_CUT_SHORT, /* truncated: its pages are lost */
    HRT_VIRTUAL_REMOVED,   /* removed or replaced: other endpoints would use another file */
    HRT_VIRTUAL_TAKEN      /* another process holds our role in the new file */
} hrt_virtual_trouble;

/* Handle of one endpoint on the file; at most HRT_VIRTUAL_HOLDS per process. */
enum { HRT_VIRTUAL_HOLDS = 16 };
typedef struct hrt_virtual_hold {
    _Atomic(hrt_virtual_bus *) memory; /* constant until closed; null: this handle is free */
    _Atomic int
        trouble; /* hrt_virtual_trouble; unless HRT_VIRTUAL_WELL, read data are invalid and sending is forbidden */
    _Atomic bool ready; /* mapped again: the tick's thread may reset `trouble` and continue */
    int fd;             /* kept open for its locks */
    int claimed, told;
    const char *path;
} hrt_virtual_hold;

/* Computes the file's path for a bus name. Returns false with `why`. */
bool hrt_virtual_path(const char *name, char *path, int path_size, char *why, int why_size);
/* Opens the file; `path` must outlive the handle. Returns null with `why`. */
hrt_virtual_hold *hrt_virtual_open(const char *path, char *why, int why_size);
/* Claims a role. Returns 1 if claimed, 0 if another process holds it. It is released when the process ends in any way.
 */
int hrt_virtual_claim(hrt_virtual_hold *hold, int place);
/* Checks the file; call it from one thread other than the tick's. If the file is missing, or that thread found its
 * mapping invalid, maps the file again in the same place and sets `ready`. Returns each new problem once, else null. */
const char *hrt_virtual_look(hrt_virtual_hold *hold);
/* Closes the handle. The last user removes the file, and its folder if that is the default one and empty. */
void hrt_virtual_close(hrt_virtual_hold *hold);

#endif
