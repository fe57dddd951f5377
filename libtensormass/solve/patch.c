/* The patch of the precomputed model: its compliance is exact, and knows what the other tools hold. */
#include "precomputed.h"

#include <string.h>

typedef struct source {
    tm_precomputed *model;
    const tm_patch *patch;
    bool others; /* there are some: yield is filled */
} source;

static bool others_hold(const tms_local *l, int32_t tool) {
    bool any = l->pin_count > 0;
    for (int32_t i = 0; i < l->now.count; i++) any |= l->now.row[i].instrument != tool && l->now.row[i].lambda_N > 0;
    return any;
}

/* Forces of the others by a unit force on each component of the patch. */
static void fill_yield(tm_precomputed *m, int32_t tool, const tm_patch *patch) {
    tms_local *l = &m->local;
    double *u = l->step;
    for (int32_t j = 0; j < 3 * patch->vertex_count; j++) {
        for (int32_t i = 0; i < l->act_count; i++) {
            double C[9];
            tms_precomputed_compliance(m, l->vertex[l->act[i]], patch->vertex[j / 3], C);
            for (int c = 0; c < 3; c++) u[3 * i + c] = C[3 * c + j % 3];
        }
        tms_local_yield(l, tool, u, m->yield + (int64_t)j * 3 * l->capacity);
    }
}

static bool block(void *self, int32_t a, int32_t b, double C[9]) {
    const source *from = self;
    tm_precomputed *m = from->model;
    const tms_local *l = &m->local;
    tms_precomputed_compliance(m, a, b, C);
    int32_t at = 0;
    while (from->patch->vertex[at] != b) at++;
    for (int32_t i = 0; from->others && i < l->act_count; i++) {
        double A[9];
        tms_precomputed_compliance(m, a, l->vertex[l->act[i]], A);
        for (int k = 0; k < 9; k++) {
            const double *df = m->yield + (int64_t)(3 * at + k % 3) * 3 * l->capacity + 3 * i;
            for (int c = 0; c < 3; c++) C[k] += A[3 * (k / 3) + c] * df[c];
        }
    }
    return true;
}

bool tms_bears_outside(const tm_contact_row *rows, int32_t count, const tm_patch *patch) {
    for (int32_t k = 0; k < count; k++) {
        const tm_contact_row *row = &rows[k];
        for (int j = 0; j < 3 && row->instrument == patch->instrument && row->lambda_N > 0; j++) {
            bool within = row->weight[j] == 0;
            for (int32_t i = 0; i < patch->vertex_count; i++) within |= patch->vertex[i] == row->vertex[j];
            if (!within) return true;
        }
    }
    return false;
}

bool tm_precomputed_patch(tm_precomputed *m, int32_t instrument, const double velocity_m_s[3], double horizon_s,
                          int32_t max_vertices, int32_t max_triangles, tm_patch *patch) {
    TM_REQUIRE(m && patch && velocity_m_s && instrument >= 0 && instrument < m->local.tool_count,
               "something is null, or instrument is not one of the model's", false);
    TM_REQUIRE(max_vertices >= 3 && max_vertices <= TM_PATCH_VERTICES && max_triangles >= 1 &&
                   max_triangles <= TM_PATCH_TRIANGLES && horizon_s >= 0 && tm_are_places(velocity_m_s),
               "max_vertices, max_triangles, horizon_s or velocity_m_s is out of range", false);
    tms_local *l = &m->local;
    const tms_tool *tool = &l->tool[instrument];
    memset(patch, 0, sizeof *patch);
    patch->instrument = instrument;
    if (!tms_local_can_touch(tool) || l->hold[instrument].count > 0)
        return false; /* jaws' springs are not in this patch: without them it would push only */
    const double *u = tm_precomputed_displacement(m);
    if (!tm_patch_choose(l->mesh->rest_m, u, &l->surface, &tool->capsule, velocity_m_s, horizon_s, l->now.row,
                         l->now.count, max_vertices, max_triangles, patch) ||
        tms_bears_outside(l->now.row, l->now.count, patch))
        return false;
    patch->kind = 2;
    patch->topology_revision = l->surface.revision;
    patch->skin_compliance_m_N = l->def.skin_compliance_m_N;
    patch->force_cap_N = l->def.force_cap_N;
    patch->radius_m = tool->def.radius_m;
    patch->contact_length_m = tool->def.contact_length_m;
    memcpy(patch->trocar_m, tool->def.trocar_m, sizeof patch->trocar_m);
    source from = {m, patch, others_hold(l, instrument) && tms_local_without(l, instrument)};
    if (from.others) fill_yield(m, instrument, patch);
    return tm_patch_fill(patch, block, &from, l->now.row, l->now.count);
}
