/* Patch and stiffness of the hybrid model: compliance of the whole, uncut organ by its own factor, a few columns a
 * call, remembered. Exact at rest; an estimate in motion. After a cut it is another organ's, and there is none. */
#include "hybrid.h"

#include <assert.h>
#include <string.h>

enum { AT_ONCE = 8 }; /* vertices solved in one call */

struct tms_whole {
    tms_system system;
    tms_solver *solver;
    tms_work *work;
    tm_patch_solver *patch_solver;
    int32_t capacity, *vertex; /* [capacity] -1: empty */
    int64_t *used, now;        /* [capacity] when it was wanted last */
    float *column;             /* [capacity][3][n] */
};

tm_status tms_whole_create(const tm_solve_def *problem, int32_t capacity, tms_whole **whole, tm_error *error) {
    tms_whole *w = tms_take_zeroed(1, sizeof *w);
    tm_solve_report report = {0};
    tm_status status = w ? tms_system_create(problem->tissue, problem->fixed, &w->system, error)
                         : tms_fail(error, TM_ERR_MEMORY, -1, "no memory for patches; use a coarser mesh");
    if (status == TM_OK) status = tms_solver_create(&w->system, problem, 0, 0, &w->solver, &report, error);
    if (status == TM_OK) status = tm_patch_solver_create(&w->patch_solver, error);
    if (status == TM_OK) {
        w->capacity = capacity;
        w->work = tms_work_create(w->solver, 3 * AT_ONCE);
        w->vertex = tms_take((size_t)capacity * sizeof *w->vertex);
        w->used = tms_take_zeroed((size_t)capacity, sizeof *w->used);
        w->column = tms_take((size_t)capacity * 12 * (size_t)w->system.n);
        if (!w->work || !w->vertex || !w->used || !w->column)
            status = tms_fail(error, TM_ERR_MEMORY, -1, "no memory for the compliance of %d vertices; use fewer",
                              (int)capacity);
    }
    if (status != TM_OK) {
        tms_whole_destroy(w);
        return status;
    }
    for (int32_t i = 0; i < capacity; i++) w->vertex[i] = -1;
    *whole = w;
    return TM_OK;
}

void tms_whole_destroy(tms_whole *w) {
    if (!w) return;
    tms_work_destroy(w->work);
    tms_solver_destroy(w->solver);
    tms_system_destroy(&w->system);
    tm_patch_solver_destroy(w->patch_solver);
    tms_give(w->vertex);
    tms_give(w->used);
    tms_give(w->column);
    tms_give(w);
}

int64_t tms_whole_bytes(const tms_whole *w) {
    return w ? tms_solver_bytes(w->solver) + tms_system_bytes(&w->system) +
                   12 * (int64_t)w->capacity * (w->system.n + 1)
             : 0;
}

static int32_t find(const tms_whole *w, int32_t vertex) {
    for (int32_t i = 0; i < w->capacity; i++)
        if (w->vertex[i] == vertex) return i;
    return -1;
}

/* Columns that the patch lacks, at most AT_ONCE of them, over those unused for the longest. True when none is lacking.
 */
static bool learn(tms_whole *w, const tm_patch *patch) {
    int32_t place[AT_ONCE], count = 0;
    bool all = true;
    double *b = tms_work_rhs(w->work);
    w->now++;
    for (int32_t i = 0; i < patch->vertex_count; i++) {
        const int32_t at = find(w, patch->vertex[i]);
        if (at >= 0) w->used[at] = w->now;
    }
    memset(b, 0, 24 * AT_ONCE * (size_t)w->system.n);
    for (int32_t i = 0; i < patch->vertex_count; i++) {
        if (find(w, patch->vertex[i]) >= 0) continue;
        if (count == AT_ONCE) {
            all = false;
            break;
        }
        int32_t oldest = 0;
        for (int32_t k = 1; k < w->capacity; k++)
            if (w->used[k] < w->used[oldest]) oldest = k;
        w->used[oldest] = w->now;
        w->vertex[oldest] = patch->vertex[i];
        for (int c = 0; c < 3; c++) {
            const int32_t dof = w->system.index[3 * patch->vertex[i] + c];
            if (dof >= 0) b[(3 * count + c) * (int64_t)w->system.n + dof] = 1;
        }
        place[count++] = oldest;
    }
    if (count == 0) return all;
    const double *x = tms_work_solve(w->work);
    for (int32_t k = 0; k < count; k++) {
        float *column = w->column + 3 * (int64_t)place[k] * w->system.n;
        for (int64_t i = 0; x && i < 3 * (int64_t)w->system.n; i++)
            column[i] = (float)x[3 * k * (int64_t)w->system.n + i];
        if (!x) w->vertex[place[k]] = -1;
    }
    return all && x;
}

static bool block(void *self, int32_t a, int32_t b, double C[9]) {
    const tms_whole *w = self;
    const int32_t at = find(w, b);
    for (int i = 0; i < 9 && at >= 0; i++) {
        const int32_t row = w->system.index[3 * a + i / 3];
        C[i] = row < 0 ? 0 : (double)w->column[(3 * (int64_t)at + i % 3) * w->system.n + row];
    }
    return at >= 0;
}

static bool make(tm_hybrid *h, int32_t instrument, const double velocity_m_s[3], double horizon_s, int32_t max_vertices,
                 int32_t max_triangles, tm_patch *patch, double stiffness_N_m[9]) {
    tms_whole *w = h->whole;
    memset(patch, 0, sizeof *patch);
    patch->instrument = instrument;
    if (!w || !h->contact || tm_tissue_alive_count(tm_world_tissue(h->world)) != h->uncut_count) return false;
    const tm_instrument_def *def = &h->instrument[instrument];
    const tm_tool_pose pose = tm_contact_pose(h->contact, instrument);
    if (!pose.active || (def->mode == TM_TOOL_GRASPER && pose.grip > 0))
        return false; /* jaws' springs are not in a patch */
    const tm_capsule capsule = tm_tool_capsule(def, &pose, instrument);
    const tm_surface_view surface = tm_hybrid_surface(h);
    const tm_contact_row *row;
    const int32_t count = tm_contact_rows(h->contact, &row);
    if (!tm_patch_choose(h->mesh->rest_m, tm_world_state(h->world)->u_m, &surface, &capsule, velocity_m_s, horizon_s,
                         row, count, max_vertices, max_triangles, patch) ||
        !learn(w, patch) || tms_bears_outside(row, count, patch))
        return false;
    patch->kind = 1;
    patch->topology_revision = surface.revision;
    patch->skin_compliance_m_N = h->contact_def.skin_compliance_m_N;
    patch->force_cap_N = h->contact_def.force_cap_N;
    patch->radius_m = def->radius_m;
    patch->contact_length_m = def->contact_length_m;
    memcpy(patch->trocar_m, def->trocar_m, sizeof patch->trocar_m);
    if (!tm_patch_fill(patch, block, w, row, count)) return false;
    tm_patch_stiffness(w->patch_solver, patch, pose.tip_m, stiffness_N_m);
    return true;
}

bool tm_hybrid_patch(tm_hybrid *h, int32_t instrument, const double velocity_m_s[3], double horizon_s,
                     int32_t max_vertices, int32_t max_triangles, tm_patch *patch, double stiffness_N_m[9]) {
    TM_REQUIRE(h && patch && velocity_m_s && stiffness_N_m && instrument >= 0 &&
                   instrument < (h->has_contact ? h->contact_def.instrument_count : TM_MAX_INSTRUMENTS),
               "something is null, or instrument is not one of the model's", false);
    TM_REQUIRE(max_vertices >= 3 && max_vertices <= TM_PATCH_VERTICES && max_triangles >= 1 &&
                   max_triangles <= TM_PATCH_TRIANGLES && horizon_s >= 0 && tm_are_places(velocity_m_s),
               "max_vertices, max_triangles, horizon_s or velocity_m_s is out of range", false);
    if (h->world) tm_world_work_of(h->world, h);
    const bool made = make(h, instrument, velocity_m_s, horizon_s, max_vertices, max_triangles, patch, stiffness_N_m);
    if (h->world) tm_world_work_of(h->world, NULL);
    return made;
}
