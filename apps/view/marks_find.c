#include "picture.h"

int32_t view_marks_tet(const view_marks *m, const int32_t corner[3]) {
    int32_t key[3] = {corner[0], corner[1], corner[2]}, low = 0, high = 4 * m->tet_count;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++)
            if (key[j] > key[j + 1]) {
                int32_t swap = key[j];
                key[j] = key[j + 1], key[j + 1] = swap;
            }
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        const int32_t *face = m->face + 4 * (int64_t)middle;
        int32_t order = face[0] != key[0] ? face[0] - key[0] : face[1] != key[1] ? face[1] - key[1] : face[2] - key[2];
        if (order == 0) return face[3];
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return -1;
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
