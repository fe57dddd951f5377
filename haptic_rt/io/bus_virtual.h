/* Memory layout of the virtual bus, for its driver and for tests. One file, mapped by all endpoints; little-endian,
 * 8-byte aligned. */
#ifndef HRT_BUS_VIRTUAL_H
#define HRT_BUS_VIRTUAL_H

#include <stdatomic.h>

#include "can/frame.h"

enum { HRT_VIRTUAL_SLOTS = 4096 };
#define HRT_VIRTUAL_MAGIC 0x324e414354524854ULL

typedef struct hrt_virtual_bus {
    _Atomic uint64_t magic;
    _Atomic uint64_t head; /* number of frames ever claimed */
    _Atomic uint64_t off;  /* not 0: bus-off for all endpoints */
    uint64_t reserved[5];
    struct {
        _Atomic uint64_t stamp; /* number of its frame plus 1; 0 while it is being written */
        uint64_t writer;
        hrt_can_frame frame;
    } slot[HRT_VIRTUAL_SLOTS];
} hrt_virtual_bus;

#endif
