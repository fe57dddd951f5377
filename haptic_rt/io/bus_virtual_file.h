/* The file of a virtual bus: made, mapped, shared, claimed, missed when it goes, and removed by the last one. */
#ifndef HRT_BUS_VIRTUAL_FILE_H
#define HRT_BUS_VIRTUAL_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "bus_virtual.h"

typedef enum hrt_virtual_trouble {
    HRT_VIRTUAL_WELL = 0,
    HRT_VIRTUAL_CUT_SHORT, /* truncated: its pages are gone */
    HRT_VIRTUAL_REMOVED,   /* or replaced: others would meet on another file */
    HRT_VIRTUAL_TAKEN      /* on the new file somebody else has our place */
} hrt_virtual_trouble;

/* One endpoint's hold on the file. At most HRT_VIRTUAL_HOLDS in a process. */
enum { HRT_VIRTUAL_HOLDS = 16 };
typedef struct hrt_virtual_hold {
    _Atomic(hrt_virtual_bus *) memory; /* the same until it is closed; null: this hold is free */
    _Atomic int trouble;               /* hrt_virtual_trouble; not well: what is read is worth nothing, do not send */
    _Atomic bool ready;                /* mapped anew: the tick's thread may say that all is well, and go on */
    int fd;                            /* kept for its locks */
    int claimed, told;
    const char *path;
} hrt_virtual_hold;

/* The file's path for a bus name. False with `why`. */
bool hrt_virtual_path(const char *name, char *path, int path_size, char *why, int why_size);
/* `path` outlives the hold. Null with `why`. */
hrt_virtual_hold *hrt_virtual_open(const char *path, char *why, int why_size);
/* 1 claimed, 0 somebody else has that place. Released when the process ends, however it does. */
int hrt_virtual_claim(hrt_virtual_hold *hold, int place);
/* From one thread other than the tick's: is the file still there? Where it was not when last looked at, or that thread
 * ran into it, maps it anew in its place and says `ready`. What is wrong, once each time; null: nothing new. */
const char *hrt_virtual_look(hrt_virtual_hold *hold);
/* The last one removes the file, and its folder if that is the default one and empty. */
void hrt_virtual_close(hrt_virtual_hold *hold);

#endif
