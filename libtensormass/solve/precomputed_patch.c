/* Patch of the precomputed model: its compliance is exact and includes the grasps of other tools. */
#include "precomputed.h"

#include <math.h>
#include <string.h>

/* Source of compliance: the patch's vertices, then those that its tool grasps. */
typedef struct source {
    tm_precomputed *model;
    int32_t count, vertex[TMS_FELT];
    bool others; /* there are other tools: yield is filled */
} source;

static bool others_hold(const tms_contact_solver *l, int32_t tool) {
    bool any = false;
    for (int32_t i = 0; i < l->pin_count; i++) any |= l->pin[i].tool != tool;
    for (int32_t i = 0; i < l->now.count; i++) any |= l->now.row[i].instrument != tool && l->now.row[i].lambda_N > 0;
    return any;
}

/* Computes the other tools' forces per unit force on each component. */
static void fill_yield(const source *from, int32_t tool) {
    tm_precomputed *m = from->model;
    tms_contact_solver *l = &m->solver;
    double *u = l->step;
    for (int32_t j = 0; j < 3 * from->count; j++) {
        for (int32_t i = 0; i < l->active_count; i++) {
            double C[9];
            tms_precomputed_compliance(m, l->vertex[l->active[i]], from->vertex[j / 3], C);
            for (int c = 0; c < 3; c++) u[3 * i + c] = C[3 * c + j % 3];
        }
        tms_contact_solver_yield(l, tool, u, m->yield + (int64_t)j * 3 * l->capacity);
    }
}

static bool block(void *self, int32_t a, int32_t b, double C[9]) {
    const source *from = self;
    tm_precomputed *m = from->model;
    const tms_contact_solver *l = &m->solver;
    tms_precomputed_compliance(m, a, b, C);
    int32_t at = 0;
    while (from->vertex[at] != b) at++;
    for (int32_t i = 0; from->others && i < l->active_count; i++) {
        double A[9];
        tms_precomputed_compliance(m, a, l->vertex[l->active[i]], A);
        for (int k = 0; k < 9; k++) {
            const double *df = m->yield + (int64_t)(3 * at + k % 3) * 3 * l->capacity + 3 * i;
            for (int c = 0; c < 3; c++) C[k] += A[3 * (k / 3) + c] * df[c];
        }
    }
    return true;
}

/* The tool's grasp, as springs. */
typedef struct station {
    tm_patch_grasp is;
    int32_t vertex[TM_GRASP_VERTICES];
    double target_m[3 * TM_GRASP_VERTICES], force_N[3 * TM_GRASP_VERTICES], size_N;
} station;

/* Returns false if it exceeds a patch's capacity. */
static bool find_station(const tms_contact_solver *l, int32_t tool, station *g) {
    double sum[3] = {0};
    g->is = (tm_patch_grasp){
        .vertex = g->vertex, .target_m = g->target_m, .force_N = g->force_N, .compliance_m_N = l->grasp.compliance_m_N};
    for (int32_t i = l->imposed_count; i < l->pin_count; i++) {
        const tms_pin *pin = &l->pin[i];
        if (pin->tool != tool) continue;
        if (g->is.count == TM_GRASP_VERTICES) return false;
        const int32_t at = 3 * g->is.count, s = l->slot_of[pin->vertex];
        for (int c = 0; c < 3; c++) {
            g->target_m[at + c] = l->mesh->rest_m[3 * (int64_t)pin->vertex + c] + pin->u_m[c];
            g->force_N[at + c] = s < 0 ? 0 : l->f[3 * s + c] - l->now.fc[3 * s + c];
            sum[c] += g->force_N[at + c];
        }
        g->vertex[g->is.count++] = pin->vertex;
    }
    g->size_N = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    return true;
}

static void describe(const tms_contact_solver *l, const tms_tool *tool, tm_patch *patch) {
    patch->kind = 2;
    patch->topology_revision = l->surface.revision;
    patch->contact_compliance_m_N = l->def.contact_compliance_m_N;
    patch->force_cap_N = l->def.force_cap_N;
    patch->radius_m = tool->def.radius_m;
    patch->contact_length_m = tool->def.contact_length_m;
    memcpy(patch->trocar_m, tool->def.trocar_m, sizeof patch->trocar_m);
    patch->is_free = tool->def.is_free;
    memcpy(patch->direction, tool->pose.direction, sizeof patch->direction);
}

static bool fill(tm_precomputed *m, int32_t instrument, const station *g, tm_patch *patch) {
    tms_contact_solver *l = &m->solver;
    source from = {.model = m};
    for (int32_t i = 0; i < patch->vertex_count; i++) from.vertex[from.count++] = patch->vertex[i];
    for (int32_t i = 0; i < g->is.count; i++) from.vertex[from.count++] = g->vertex[i];
    from.others = others_hold(l, instrument) && tms_contact_solver_without(l, instrument);
    if (from.others) fill_yield(&from, instrument);
    return g->is.count ? tm_patch_fill_grasped(m->patch_solver, patch, &g->is, l->tool[instrument].pose.tip_m, block,
                                               &from, l->now.row, l->now.count)
                       : tm_patch_fill(patch, block, &from, l->now.row, l->now.count);
}

/* Removes friction's forces from the shape; the controller's law adds its own. */
static bool remove_friction(const tms_contact_solver *l, int32_t instrument, tm_patch *patch) {
    if (!tms_contact_solver_has_friction(l, instrument)) return true;
    patch->friction_static = l->friction->coefficient[instrument].mu_static;
    patch->friction_kinetic = l->friction->coefficient[instrument].mu_kinetic;
    for (int32_t k = 0; k < l->now.station_count; k++) {
        const tms_friction_station *g = &l->now.station[k];
        for (int32_t i = g->first; i < g->first + g->count && g->load_N > 0; i++) {
            double part[3];
            for (int c = 0; c < 3; c++) part[c] = l->now.row[i].lambda_N / g->load_N * g->force_N[c];
            tm_patch_remove_friction(patch, &l->now.row[i], part);
        }
    }
    return true;
}

bool tm_precomputed_patch(tm_precomputed *m, int32_t instrument, const double velocity_m_s[3], double horizon_s,
                          int32_t max_vertices, int32_t max_triangles, tm_patch *patch) {
    TM_REQUIRE(m && patch && velocity_m_s && instrument >= 0 && instrument < m->solver.tool_count,
               "an argument is null, or instrument is not one of the model's", false);
    TM_REQUIRE(max_vertices >= 3 && max_vertices <= TM_PATCH_VERTICES && max_triangles >= 1 &&
                   max_triangles <= TM_PATCH_TRIANGLES && horizon_s >= 0 && tm_are_places(velocity_m_s),
               "max_vertices, max_triangles, horizon_s or velocity_m_s is out of range", false);
    tms_contact_solver *l = &m->solver;
    const tms_tool *tool = &l->tool[instrument];
    station g;
    memset(patch, 0, sizeof *patch);
    patch->instrument = instrument;
    if (!tms_contact_solver_can_touch(tool) || l->grasp_of[instrument].state == TM_GRASP_RELEASING ||
        !find_station(l, instrument, &g))
        return false;
    if (g.is.count && max_vertices < 4) return false; /* the tip takes one place */
    const double *u = tm_precomputed_displacement(m);
    if (!tm_patch_choose(l->mesh->rest_m, u, &l->surface, &tool->capsule, velocity_m_s, horizon_s, l->now.row,
                         l->now.count, max_vertices - (g.is.count > 0), max_triangles, patch) ||
        tm_patch_has_outside_load(patch, g.size_N, l->now.row, l->now.count))
        return false;
    describe(l, tool, patch);
    return fill(m, instrument, &g, patch) && remove_friction(l, instrument, patch);
}
