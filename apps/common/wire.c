#include "wire.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static int64_t integer(const uint8_t *p) {
    return (int32_t)((uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3]);
}

bool app_wire_sound(const char *layout, const void *data, int size) {
    const uint8_t *bytes = data;
    int64_t at = 8, count = 1;
    if (size < 8) return false;
    while (*layout) {
        if (*layout == 's' || *layout == '#') {
            if (at + 4 > size) return false;
            int64_t length = integer(bytes + at);
            at += 4;
            if (length < 0) return false;
            if (*layout++ == '#')
                count = length;
            else {
                if (length < 1 || at + length > size || bytes[at + length - 1] != 0) return false;
                at += length;
            }
        } else {
            bool each = *layout == '*';
            char *end;
            int64_t skip = strtol(layout + each, &end, 10);
            layout = end + 1; /* past the point */
            at += each ? skip * count : skip;
            if (at > size) return false;
        }
    }
    return at == size;
}

bool app_wire_sound_head(const char *head, int head_bytes, int strings, int empty_size, const void *data, int size) {
    char layout[64];
    snprintf(layout, sizeof layout, "%s%d.", head, empty_size - 8 - head_bytes - 5 * strings);
    return app_wire_sound(layout, data, size);
}
