/* Surface of an instrument's patch and its known compliance. There is no patch unless all of it is known. */
#include "patch/patch_internal.h"

#include <string.h>

#include "base/vec.h"

tm_surface_view tm_patch_surface_of(const tm_patch_builder *builder) {
    return builder->surface.view ? builder->surface.view(builder->surface.self)
                                 : tm_tissue_surface(builder->world->tissue);
}

enum { ITERATIONS = 4 }; /* of requests for a patch's columns */

/* Returns whether supports, or tissue that it rests on, hold a vertex whose column is known. */
static bool is_held(const tm_patch_builder *builder, int32_t vertex, int32_t at) {
    return !tm_patch_is_beyond(builder->columns_known, at, TM_PATCH_LOOSE_M_N) ||
           (builder->behind && tm_patch_behind_holds(builder, vertex));
}

bool tm_patch_is_known(const tm_patch_builder *builder, int32_t vertex) {
    if (builder->columns) return tm_columns_good(builder->columns, vertex);
    const int32_t at = tm_patch_column_of(builder->columns_known, vertex);
    return at >= 0 && is_held(builder, vertex, at);
}

/* Returns false if the vertex is known to be in a detached fragment. */
static bool may_be_held(void *self, int32_t vertex) {
    const tm_patch_builder *builder = self;
    const int32_t at = builder->columns ? -1 : tm_patch_column_of(builder->columns_known, vertex);
    return at < 0 || is_held(builder, vertex, at);
}

int32_t tm_patch_known_kind(const tm_patch_builder *builder) {
    return !builder->columns && !builder->corotated && builder->columns_known &&
                   builder->columns_known->revision == builder->revision
               ? 2
               : 1;
}

/* --- surface --- */

static bool grow_by(tm_patch_builder *builder, int32_t t, int32_t max_vertices, bool by_load, tm_patch *patch) {
    const tm_contact *contact = builder->contact;
    const tm_surface_view surface = tm_patch_surface_of(builder);
    bool fans;
    tm_patch_grow(builder->world->tissue->mesh->rest_m, builder->world->state.u_m, &surface, &contact->tool[t].capsule,
                  builder->velocity_m_s[t], builder->def.horizon_s, contact->row, contact->row_count, max_vertices,
                  builder->def.max_triangles, by_load, may_be_held, builder, &fans, patch);
    return fans;
}

/* Grows the patch around the tip's path or, if the load of a shaft is too widespread for that, around the largest
 * load. */
static bool grow(tm_patch_builder *builder, int32_t t, int32_t max_vertices, tm_patch *patch) {
    const bool fans = grow_by(builder, t, max_vertices, false, patch);
    if (!tm_patch_has_outside_load(patch, 0, builder->contact->row, builder->contact->row_count)) return fans;
    return grow_by(builder, t, max_vertices, true, patch);
}

static bool is_known(const tm_patch_builder *builder, double held_N, const tm_patch *patch) {
    bool known = patch->triangle_count > 0;
    for (int32_t i = 0; i < patch->vertex_count && known; i++) known = tm_patch_is_known(builder, patch->vertex[i]);
    return known && !tm_patch_has_outside_load(patch, held_N, builder->contact->row, builder->contact->row_count);
}

/* A smaller patch is used only if it has all triangles around the load. */
bool tm_patch_find_known(tm_patch_builder *builder, int32_t t, int32_t max_vertices, double held_N, tm_patch *patch) {
    if (is_known(builder, held_N, patch)) return true;
    for (int32_t quarters = 4; quarters >= 2 && quarters * max_vertices >= 32; quarters--)
        if (grow(builder, t, quarters * max_vertices / 4, patch) && is_known(builder, held_N, patch)) return true;
    return false;
}

static bool among(const int32_t *list, int32_t count, int32_t vertex) {
    for (int32_t i = 0; i < count; i++)
        if (list[i] == vertex) return true;
    return false;
}

/* --- requests --- */

/* Lists the patch's vertices by their distance from the tip, after those already in the list. */
static int32_t list_patch(const tm_patch_builder *builder, int32_t t, const tm_patch *patch, int32_t *list,
                          int32_t first) {
    double distance[TM_GRASP_VERTICES + TM_PATCH_VERTICES];
    int32_t n = first;
    for (int32_t i = 0; i < patch->vertex_count; i++) {
        if (among(list, first, patch->vertex[i])) continue;
        double d[3];
        vsub(patch->vertex_m + 3 * i, builder->contact->tool[t].pose.tip_m, d);
        double far = vdot(d, d);
        int32_t j = n++;
        for (; j > first && distance[j - 1] > far; j--) {
            list[j] = list[j - 1];
            distance[j] = distance[j - 1];
        }
        list[j] = patch->vertex[i];
        distance[j] = far;
    }
    return n;
}

/* Finds the vertices nearest to the tool's path; for a cautery also inner ones, which the next cut may expose. */
static int32_t find_near(const tm_patch_builder *builder, int32_t t, int32_t near[TM_COMPLIANCE_REQUEST_MAX]) {
    const tm_contact *contact = builder->contact;
    const tm_tissue *tissue = builder->world->tissue;
    const tm_surface_view surface = tm_patch_surface_of(builder);
    return tm_patch_nearest(tissue->mesh->rest_m, builder->world->state.u_m, &surface, &contact->tool[t].capsule,
                            builder->velocity_m_s[t], builder->def.horizon_s, contact->row, contact->row_count,
                            contact->tool[t].def.mode == TM_TOOL_CAUTERY ? tissue->mass_kg : NULL,
                            tissue->mesh->vertex_count, near);
}

/* Appends the vertices nearest to the tool's path, so that their columns are there when the tool is. Returns
 * the count. */
static int32_t list_next(const tm_patch_builder *builder, int32_t t, int32_t *list, int32_t n) {
    int32_t near[TM_COMPLIANCE_REQUEST_MAX], most = builder->def.column_vertices;
    if (most > TM_COMPLIANCE_REQUEST_MAX) most = TM_COMPLIANCE_REQUEST_MAX;
    const int32_t needed = n, found = find_near(builder, t, near);
    for (int32_t i = 0; i < found && n < most; i++)
        if (!among(list, needed, near[i])) list[n++] = near[i];
    return n;
}

/* Requests columns from conjugate gradients, whose capacity is limited: with many held vertices the patch is
 * smaller. */
static void want_columns(tm_patch_builder *builder, int32_t t, int32_t fixed, int32_t max_vertices, int32_t *list,
                         tm_patch *patch) {
    int32_t n = fixed < TM_PATCH_VERTICES ? list_patch(builder, t, patch, list, fixed) : fixed;
    while (n > TM_PATCH_VERTICES && max_vertices >= 4) {
        max_vertices -= n - TM_PATCH_VERTICES;
        if (max_vertices < 3) break;
        grow(builder, t, max_vertices, patch);
        n = list_patch(builder, t, patch, list, fixed);
    }
    if (n > TM_PATCH_VERTICES) {
        patch->vertex_count = patch->triangle_count = 0;
        n = fixed < TM_PATCH_VERTICES ? fixed : TM_PATCH_VERTICES;
    }
    tm_columns_want(builder->columns, t, list, n, list_next(builder, t, list, n));
    tm_columns_work(builder->columns, builder->def.iterations);
}

/* Requests compliance from the source: the patch, and then the surroundings of the tool's path. */
static void want_pieces(tm_patch_builder *builder, int32_t t, int32_t fixed, const tm_patch *patch, int32_t *list) {
    int32_t near[TM_COMPLIANCE_REQUEST_MAX], n = list_patch(builder, t, patch, list, fixed);
    if (n > TM_COMPLIANCE_REQUEST_MAX) n = TM_COMPLIANCE_REQUEST_MAX;
    for (int32_t i = 0; i < builder->behind_count && n < TM_COMPLIANCE_REQUEST_MAX; i++)
        if (!among(list, n, builder->behind_vertex[i])) list[n++] = builder->behind_vertex[i];
    const int32_t needed = n, found = find_near(builder, t, near);
    for (int32_t i = 0; i < found && n < TM_COMPLIANCE_REQUEST_MAX; i++)
        if (!among(list, needed, near[i])) list[n++] = near[i];
    const tm_compliance_request request = {
        .count = n, .needed = needed, .vertex = list, .u_m = builder->corotated ? builder->world->state.u_m : NULL};
    builder->columns_known = builder->source.exchange(builder->source.self, t, &request);
    const bool fresh = builder->columns_known && builder->columns_known->revision == builder->revision;
    builder->missing[t] = fresh ? 0 : needed;
    for (int32_t i = 0; i < needed && fresh; i++)
        builder->missing[t] += tm_patch_column_of(builder->columns_known, list[i]) < 0;
    if (builder->behind) tm_patch_behind_prepare(builder->behind, builder);
}

void tm_patch_want(tm_patch_builder *builder, int32_t t, const int32_t *fixed, int32_t count, tm_patch *patch) {
    int32_t list[TM_GRASP_VERTICES + TM_PATCH_VERTICES], first = count < 0 ? 0 : count;
    const int32_t max_vertices = builder->def.max_vertices - (count > 0);
    if (first > TM_GRASP_VERTICES) first = 0; /* more than the capacity of a patch */
    for (int32_t i = 0; i < first; i++) list[i] = fixed[i];
    if (max_vertices >= 3) grow(builder, t, max_vertices, patch);
    if (builder->columns) {
        want_columns(builder, t, first, max_vertices, list, patch);
        return;
    }
    /* Fragments that a cut detached are known only when their columns are there; then their neighbours' are
     * requested. */
    for (int round = 0; round < ITERATIONS; round++) {
        want_pieces(builder, t, first, patch, list);
        if (patch->triangle_count == 0 || is_known(builder, 0, patch)) return;
        if (round < ITERATIONS - 1) grow(builder, t, max_vertices, patch);
    }
}
