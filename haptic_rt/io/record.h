/* Records every tick as a CSV row (--record). The loop puts rows into a ring buffer; another thread writes them. */
#ifndef HRT_RECORD_H
#define HRT_RECORD_H

#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>

#include "app.h"
#include "hrt.h"

enum { HRT_RECORD_ROWS = 8192, HRT_RECORD_FIELDS = 11 + HRT_JOINTS + HRT_MOTORS }; /* 4 s at 2 kHz */

typedef struct hrt_record {
    const hrt_device_type *device;
    app_output output;
    FILE *file;
    _Atomic uint64_t put, written, lost;
    struct {
        double time_s;
        int count;
        float value[HRT_RECORD_FIELDS];
    } row[HRT_RECORD_ROWS];
} hrt_record;

/* Opens the recording. Returns 0 or an exit code. */
int hrt_record_begin(hrt_record *record, const hrt_device_type *device, const char *path);
/* Adds a row, in the loop's thread; never blocks. Without capacity, the row is dropped and counted. */
void hrt_record_put(hrt_record *record, double time_s, const hrt_result *result);
/* Writes the waiting rows, in another thread. */
void hrt_record_write(hrt_record *record);
/* Writes the remaining rows and publishes the file. Returns an exit code. */
int hrt_record_end(hrt_record *record);
void hrt_record_abandon(hrt_record *record);

#endif
