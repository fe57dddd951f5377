/* --record: every tick as a row of CSV. The loop puts rows into a ring of fixed size, another thread writes them. */
#ifndef HRT_RECORD_H
#define HRT_RECORD_H

#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>

#include "app.h"
#include "hrt.h"

enum { HRT_RECORD_ROWS = 8192, HRT_RECORD_FIELDS = 8 + HRT_JOINTS + HRT_MOTORS }; /* 4 s at 2 kHz */

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

/* An exit code; 0: begun. */
int hrt_record_begin(hrt_record *record, const hrt_device_type *device, const char *path);
/* In the loop: never waits. A row that finds no room is lost and counted. */
void hrt_record_put(hrt_record *record, double time_s, const hrt_result *result);
/* Outside of it: writes what has come. */
void hrt_record_write(hrt_record *record);
/* Writes the rest and puts the file in place. An exit code. */
int hrt_record_end(hrt_record *record);
void hrt_record_abandon(hrt_record *record);

#endif
