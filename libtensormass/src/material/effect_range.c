/* Ranges of vertices and tetrahedra of the regions where effects act. */
#include "material/effect_range.h"

bool tm_effect_is_everywhere(const tm_material_field *field, int effects) {
    for (int32_t r = 0; field->effects && r < field->mesh->region_count; r++)
        if ((field->effects[r] & effects) != effects) return false;
    return true;
}

bool tm_effects_meet(const tm_material_field *field, int effects) {
    bool meet = !field->effects;
    for (int32_t r = 0; !meet && r < field->mesh->region_count; r++) meet = (field->effects[r] & effects) == effects;
    return meet;
}

/* Lists runs of equal marks other than 0. Returns false without memory. */
static bool list_runs(tm_ranges *ranges, tm_pool *pool, const uint8_t *mark, int32_t count) {
    int32_t runs = 0, at = -1;
    for (int32_t i = 0; i < count; i++) runs += mark[i] && (i == 0 || mark[i] != mark[i - 1]);
    int32_t *end = TM_ALLOC(pool, int32_t, 2 * (int64_t)runs + 1);
    *ranges = (tm_ranges){runs, end};
    for (int32_t i = 0; end && i < count; i++) {
        if (!mark[i]) continue;
        if (i == 0 || mark[i] != mark[i - 1]) end[2 * ++at] = i;
        end[2 * at + 1] = i + 1;
    }
    return end;
}

/* Returns 0, or a mark of the effects that act in the region. */
static uint8_t mark_of(const tm_material_field *field, int32_t tet, int with, int without) {
    const int effects = field->effects ? field->effects[field->mesh->region[tet]] : TM_REGION_EFFECTS;
    return (effects & with) == with && !(effects & without) ? (uint8_t)(effects + 1) : 0;
}

bool tm_effect_vertices(tm_ranges *ranges, tm_pool *pool, const tm_material_field *field, int with, int without) {
    const tm_mesh *mesh = field->mesh;
    tm_pool scratch = {0};
    uint8_t *mark = TM_ALLOC(&scratch, uint8_t, mesh->vertex_count);
    for (int32_t i = 0; mark && i < 4 * mesh->tet_count; i++)
        if (mark_of(field, i / 4, with, without)) mark[mesh->tet[i]] = 1;
    const bool good = mark && list_runs(ranges, pool, mark, mesh->vertex_count);
    tm_pool_release(&scratch);
    return good;
}

bool tm_effect_tets(tm_ranges *ranges, tm_pool *pool, const tm_material_field *field, int with, int without) {
    const tm_mesh *mesh = field->mesh;
    tm_pool scratch = {0};
    uint8_t *mark = TM_ALLOC(&scratch, uint8_t, mesh->tet_count);
    for (int32_t t = 0; mark && t < mesh->tet_count; t++) mark[t] = mark_of(field, t, with, without);
    const bool good = mark && list_runs(ranges, pool, mark, mesh->tet_count);
    tm_pool_release(&scratch);
    return good;
}
