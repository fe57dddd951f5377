/* The known compliance of a patch builder: entries of the columns that its source has supplied. */
#include "patch/patch_internal.h"

#include "base/vec.h"

/* Compliance of tissue that a cut detached after its columns were computed: it is beyond this. */
#define ADRIFT_M_N 1e3

int32_t tm_patch_column_of(const tm_compliance *known, int32_t vertex) {
    int32_t low = 0, high = known ? known->count : 0;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (known->vertex[middle] < vertex)
            low = middle + 1;
        else
            high = middle;
    }
    return known && low < known->count && known->vertex[low] == vertex ? low : -1;
}

bool tm_patch_is_beyond(const tm_compliance *known, int32_t at, double limit_m_N) {
    for (int c = 0; c < 3; c++)
        if (!(known->C_m_N[(int64_t)(3 * at + c) * (3 * known->count + 1)] < limit_m_N)) return true;
    return false;
}

bool tm_patch_has_column(const tm_patch_builder *builder, int32_t vertex) {
    if (builder->columns) return tm_columns_good(builder->columns, vertex);
    const int32_t at = tm_patch_column_of(builder->columns_known, vertex);
    return at >= 0 && !tm_patch_is_beyond(builder->columns_known, at, ADRIFT_M_N);
}

/* Rotates a block with the tissue: C = Qa C Qb^T. */
static void turn_block(const double *Qa, const double *Qb, double C[9]) {
    double half[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) half[3 * i + j] = vdot(C + 3 * i, Qb + 3 * j);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            C[3 * i + j] = Qa[3 * i] * half[j] + Qa[3 * i + 1] * half[3 + j] + Qa[3 * i + 2] * half[6 + j];
}

bool tm_patch_known_block(void *self, int32_t a, int32_t b, double C[9]) {
    const tm_patch_builder *builder = self;
    if (builder->columns) return tm_columns_block(builder->columns, a, b, C);
    const tm_compliance *known = builder->columns_known;
    const int32_t i = tm_patch_column_of(known, a), j = tm_patch_column_of(known, b);
    if (i < 0 || j < 0) return false;
    const int64_t width = 3 * known->count;
    for (int k = 0; k < 9; k++) C[k] = known->C_m_N[(3 * i + k / 3) * width + 3 * j + k % 3];
    /* The large rigid motions of tissue without supports must agree among vertices: it is not rotated one by one. */
    if (known->rotation && !tm_patch_is_beyond(known, i, TM_PATCH_LOOSE_M_N) &&
        !tm_patch_is_beyond(known, j, TM_PATCH_LOOSE_M_N))
        turn_block(known->rotation + 9 * i, known->rotation + 9 * j, C);
    return true;
}
