#include "sides.h"

#include <stdlib.h>

static int by_key(const void *a, const void *b) {
    const view_side *p = a, *q = b;
    if (p->key != q->key) return p->key < q->key ? -1 : 1;
    return p->triangle != q->triangle ? (p->triangle < q->triangle ? -1 : 1) : p->local - q->local;
}

view_side *view_sides_sorted(const uint32_t *index, int32_t triangle_count) {
    view_side *sides = malloc(((size_t)triangle_count * 3 + 1) * sizeof *sides);
    if (!sides) return NULL;
    for (int32_t t = 0; t < triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t a = index[3 * t + i], b = index[3 * t + (i + 1) % 3];
            sides[3 * t + i] = (view_side){a < b ? a << 32 | b : b << 32 | a, t, i};
        }
    qsort(sides, (size_t)triangle_count * 3, sizeof *sides, by_key);
    return sides;
}
