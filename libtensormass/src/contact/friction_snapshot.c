/* What friction is between steps: for snapshots, and for a step that fails. */
#include "contact/friction_internal.h"

#include <math.h>
#include <string.h>

enum { NUMBERS = 4 * TM_MAX_STATIONS }; /* of an instrument that has friction */

_Static_assert(sizeof(tm_rubbed) == 4 * sizeof(double), "without padding");

int64_t tm_friction_snapshot(void *self, void *buffer) {
    const tm_friction *f = self;
    int64_t bytes = 0;
    for (int32_t t = 0; t < f->contact->tool_count; t++) {
        if (!f->rubbed[t]) continue;
        if (buffer) memcpy((char *)buffer + bytes, f->rubbed[t], NUMBERS * sizeof(double));
        bytes += NUMBERS * (int64_t)sizeof(double);
    }
    return bytes;
}

bool tm_friction_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    tm_friction *f = self;
    if (bytes != tm_friction_snapshot(self, NULL)) return false;
    for (int64_t i = 0; i < bytes / (int64_t)sizeof(double); i++) {
        double number;
        memcpy(&number, (const char *)buffer + i * (int64_t)sizeof number, sizeof number);
        if (!isfinite(number) || (i % 4 == 3 && !(number >= 0 && number <= 1))) return false;
    }
    const char *from = buffer;
    for (int32_t t = 0; t < f->contact->tool_count && apply; t++) {
        f->placings[t] = f->contact->tool[t].placings;
        if (!f->rubbed[t]) continue;
        memcpy(f->rubbed[t], from, NUMBERS * sizeof(double));
        from += NUMBERS * sizeof(double);
    }
    if (apply) f->touch_count = 0;
    return true;
}

void tm_friction_keep(void *self) {
    tm_friction *f = self;
    for (int32_t t = 0; t < f->contact->tool_count; t++)
        if (f->rubbed[t]) memcpy(f->kept[t], f->rubbed[t], NUMBERS * sizeof(double));
}

void tm_friction_give_back(void *self, tm_world *world) {
    (void)world;
    tm_friction *f = self;
    for (int32_t t = 0; t < f->contact->tool_count; t++)
        if (f->rubbed[t]) memcpy(f->rubbed[t], f->kept[t], NUMBERS * sizeof(double));
}
