/* Reads a hand script from CSV. */
#include "hand_file.h"

#include <stdlib.h>

#include "app.h"
#include "io/csv_table.h"

static bool fill(const hrt_table *t, const char *path, const hrt_device_type *device, hrt_keyframe *key) {
    int32_t time, joint[HRT_JOINTS];
    const int32_t active = hrt_table_column(t, "active");
    if (!hrt_table_need(t, path, "time_s", &time)) return false;
    for (int j = 0; j < device->joints; j++)
        if (!hrt_table_need(t, path, device->joint[j].name, &joint[j])) return false;
    for (int32_t r = 0; r < t->rows; r++) {
        const double *row = &t->value[r * t->fields];
        key[r].time_s = row[time];
        for (int j = 0; j < device->joints; j++) key[r].joint[j] = row[joint[j]];
        key[r].active = active >= 0 && row[active] != 0.0;
        if (row[time] < 0.0 || (r > 0 && row[time] <= key[r - 1].time_s)) {
            app_bad_input(path, t->line[r],
                          "time %g s is not later than that of the previous row; write rows in ascending time from 0",
                          row[time]);
            return false;
        }
    }
    return true;
}

bool hrt_hand_file_read(const char *path, const hrt_device_type *device, hrt_hand_script *script) {
    hrt_table t;
    if (!hrt_table_read(path, &t)) return false;
    hrt_keyframe *key = calloc((size_t)t.rows, sizeof *key);
    const bool good = key && fill(&t, path, device, key);
    script->key = good ? key : NULL;
    script->key_count = good ? t.rows : 0;
    if (!good) free(key);
    hrt_table_free(&t);
    return good;
}
