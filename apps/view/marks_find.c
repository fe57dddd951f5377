/* Finds the tetrahedron of a surface triangle, and with it the triangle's region. */
#include "picture.h"

static int32_t order_of(const int32_t a[3], const int32_t b[3]) {
    return a[0] != b[0] ? a[0] - b[0] : a[1] != b[1] ? a[1] - b[1] : a[2] - b[2];
}

int32_t view_marks_tet(const view_marks *m, const int32_t corner[3]) {
    int32_t key[3] = {corner[0], corner[1], corner[2]}, low = 0, high = 4 * m->tet_count, swaps = 0;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++)
            if (key[j] > key[j + 1]) {
                int32_t swap = key[j];
                key[j] = key[j + 1], key[j + 1] = swap, ++swaps;
            }
    while (low < high) { /* first entry that is not smaller */
        int32_t middle = low + (high - low) / 2;
        if (order_of(m->face + 4 * (int64_t)middle, key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    int32_t found = -1;
    for (int64_t i = low; i < 4 * (int64_t)m->tet_count && !order_of(m->face + 4 * i, key); i++) {
        const int32_t side = m->face[4 * i + 3];
        if ((side & 1) == (swaps & 1)) return side / 2;
        found = side / 2;
    }
    return found;
}

void view_marks_tint(const view_marks *m, view_surface *surface) {
    for (int32_t t = 0; m->region && t < surface->triangle_count; t++) {
        int32_t id[3];
        bool known = true;
        for (int c = 0; c < 3; c++) {
            id[c] = surface->vertex_id[surface->triangle[3 * t + c]];
            known = known && id[c] < m->vertex_count;
        }
        const int32_t tet = known ? view_marks_tet(m, id) : -1;
        surface->kind[t] = (uint8_t)((surface->kind[t] & 1) | view_kind_of(tet < 0 ? 0 : m->region[tet]));
    }
}
