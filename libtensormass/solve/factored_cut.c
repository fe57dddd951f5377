/* Cuts since the factor: the vertices they touched, and the stiffness they removed. */
#include "factored.h"

#include <string.h>

/* A new factor is best made while nothing is cut: after this many calls without a cut, if this many vertices are
 * touched. */
enum { CALM = 25, WORTH_IT = 32 };

bool tms_engine_partial_tissue(const tms_engine *e, const uint8_t *alive, const double *u_m, tm_tissue **part) {
    if (tms_sub_tissue(e->tissue, alive, part, NULL) != TM_OK) return false;
    if (!u_m) return true;
    if (e->has_law ? !tm_tissue_take_tangent(*part, e->tissue, u_m, e->definite, NULL)
                   : !tm_tissue_corotate(*part, tm_tissue_rotation(e->tissue), u_m, NULL))
        return true;
    tm_tissue_destroy(*part);
    *part = NULL;
    return false;
}

/* Adds the vertices of a tetrahedron to the list. Returns false if there are too many. */
static bool touch(const tm_mesh *mesh, int32_t tet, int32_t *list, int32_t *count) {
    for (int i = 0; i < 4; i++) {
        const int32_t v = mesh->tet[4 * (int64_t)tet + i];
        bool known = false;
        for (int32_t k = 0; k < *count && !known; k++) known = list[k] == v;
        if (known) continue;
        if (*count == TMS_TOUCHED_VERTICES) return false;
        list[(*count)++] = v;
    }
    return true;
}

/* Adds the vertices whose blocks change when a tetrahedron is removed: its own; with strain smoothing, all around
 * these. */
static bool touch_around(const tms_engine *e, int32_t tet, int32_t *list, int32_t *count) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    if (tm_tissue_smoothed_shear_share(e->tissue) < 0) return touch(mesh, tet, list, count);
    for (int i = 0; i < 4; i++) {
        const int32_t v = mesh->tet[4 * (int64_t)tet + i];
        for (int32_t j = mesh->vertex_tet_begin[v]; j < mesh->vertex_tet_begin[v + 1]; j++)
            if (e->base[mesh->vertex_tet[j]] && !touch(mesh, mesh->vertex_tet[j], list, count)) return false;
    }
    return true;
}

bool tms_engine_follow(tms_engine *e, const uint8_t *alive) {
    int32_t count = 0, list[TMS_TOUCHED_VERTICES];
    bool changed = false;
    for (int32_t t = 0; t < e->tet_count; t++) {
        if (alive[t] && !e->base[t]) return false;
        const uint8_t gone = e->base[t] && !alive[t];
        changed = changed || gone != e->gone[t];
        e->gone[t] = gone;
        if (gone && !touch_around(e, t, list, &count)) return false;
    }
    e->calm = changed ? 0 : e->calm + 1;
    if (!changed) return e->calm != CALM || e->touched_count < WORTH_IT;
    e->touched_count = count;
    memcpy(e->touched, list, sizeof *list * (size_t)count);
    e->middle_known = false;
    return true;
}

/* D += sign K among the touched vertices of the tissue of these tetrahedra. */
static bool add_stiffness(tms_engine *e, const uint8_t *alive, double sign) {
    tm_tissue *part = NULL;
    const int32_t width = 3 * e->touched_count;
    if (!tms_engine_partial_tissue(e, alive, e->at_m, &part)) return false;
    const tm_pair_view pairs = tm_tissue_pairs(part);
    for (int32_t a = 0; a < e->touched_count; a++) {
        const int32_t v = e->touched[a];
        double K[9];
        tm_tissue_vertex_tensor(part, v, K);
        for (int k = 0; k < 9; k++) e->D[(3 * a + k / 3) * width + 3 * a + k % 3] += sign * K[k];
        for (int32_t p = pairs.begin[v]; p < pairs.begin[v + 1]; p++) {
            int32_t b = 0;
            while (b < e->touched_count && e->touched[b] != pairs.ends[2 * (int64_t)p + 1]) b++;
            if (b == e->touched_count) continue; /* the cut changed nothing between them */
            tm_tissue_pair_tensor(part, p, K);
            for (int k = 0; k < 9; k++) {
                e->D[(3 * a + k / 3) * width + 3 * b + k % 3] += sign * K[k];
                e->D[(3 * b + k % 3) * width + 3 * a + k / 3] += sign * K[k];
            }
        }
    }
    tm_tissue_destroy(part);
    return true;
}

/* Strain smoothing averages a cut tetrahedron with those that share a vertex with it. Sets `around` [tet_count] to
 * these, without the cut ones unless `before`. */
static void mark_around(const tms_engine *e, bool before, uint8_t *around) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    memset(around, 0, (size_t)e->tet_count);
    for (int32_t t = 0; t < e->tet_count; t++)
        for (int i = 0; e->gone[t] && i < 4; i++) {
            const int32_t v = mesh->tet[4 * (int64_t)t + i];
            for (int32_t j = mesh->vertex_tet_begin[v]; j < mesh->vertex_tet_begin[v + 1]; j++) {
                const int32_t near = mesh->vertex_tet[j];
                around[near] = e->base[near] && (before || !e->gone[near]);
            }
        }
}

/* Keeps the own block of a vertex that lost all its tetrahedra: it constrains the vertex and couples to no other. */
static void keep_isolated(tms_engine *e) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    const int32_t width = 3 * e->touched_count;
    for (int32_t a = 0; a < e->touched_count; a++) {
        const int32_t v = e->touched[a];
        bool alone = true;
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t t = mesh->vertex_tet[i];
            alone = alone && (!e->base[t] || e->gone[t]);
        }
        for (int k = 0; alone && k < 9; k++) e->D[(3 * a + k / 3) * width + 3 * a + k % 3] = 0;
    }
}

bool tms_engine_cut_stiffness(tms_engine *e) {
    const int32_t width = 3 * e->touched_count;
    memset(e->D, 0, sizeof(double) * (size_t)width * (size_t)width);
    bool good;
    if (tm_tissue_smoothed_shear_share(e->tissue) < 0) {
        good = add_stiffness(e, e->gone, 1);
    } else {
        uint8_t *around = tm_allocate((size_t)e->tet_count);
        good = around != NULL;
        for (int before = 1; good && before >= 0; before--) {
            mark_around(e, before, around);
            good = add_stiffness(e, around, before ? 1 : -1);
        }
        tm_release(around, (size_t)e->tet_count);
    }
    if (good) keep_isolated(e);
    return good;
}
