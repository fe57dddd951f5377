/* Which surface an instrument's patch has, and what is known of its compliance: all of it, or the patch is not made. */
#include "patch/patch_internal.h"

#include <string.h>

#include "base/vec.h"

tm_surface_view tm_patch_surface_of(const tm_patch_maker *maker) {
    return maker->surface.view ? maker->surface.view(maker->surface.self) : tm_tissue_surface(maker->world->tissue);
}

enum { ROUNDS = 4 }; /* of asking for a patch's columns */

/* Nothing holds a piece that gives way more than this: its rest is nowhere, and no patch says where. */
#define LOOSE_M_N 1.0

/* Where a vertex stands in what the source gave, -1: it does not. */
static int32_t place_in(const tm_compliance *known, int32_t vertex) {
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

static bool is_loose(const tm_compliance *known, int32_t at) {
    for (int c = 0; c < 3; c++)
        if (!(known->C_m_N[(int64_t)(3 * at + c) * (3 * known->count + 1)] < LOOSE_M_N)) return true;
    return false;
}

bool tm_patch_is_known(const tm_patch_maker *maker, int32_t vertex) {
    if (maker->columns) return tm_columns_good(maker->columns, vertex);
    const int32_t at = place_in(maker->known, vertex);
    return at >= 0 && !is_loose(maker->known, at);
}

/* Not known to be loose. */
static bool may_be_held(void *self, int32_t vertex) {
    const tm_patch_maker *maker = self;
    const int32_t at = maker->columns ? -1 : place_in(maker->known, vertex);
    return at < 0 || !is_loose(maker->known, at);
}

/* The tissue has turned since: C = Qa C Qb^T. */
static void turn_block(const double *Qa, const double *Qb, double C[9]) {
    double half[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) half[3 * i + j] = vdot(C + 3 * i, Qb + 3 * j);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            C[3 * i + j] = Qa[3 * i] * half[j] + Qa[3 * i + 1] * half[3 + j] + Qa[3 * i + 2] * half[6 + j];
}

bool tm_patch_known_block(void *self, int32_t a, int32_t b, double C[9]) {
    const tm_patch_maker *maker = self;
    if (maker->columns) return tm_columns_block(maker->columns, a, b, C);
    const tm_compliance *known = maker->known;
    const int32_t i = place_in(known, a), j = place_in(known, b);
    if (i < 0 || j < 0) return false;
    const int64_t width = 3 * known->count;
    for (int k = 0; k < 9; k++) C[k] = known->C_m_N[(3 * i + k / 3) * width + 3 * j + k % 3];
    if (known->turn) turn_block(known->turn + 9 * i, known->turn + 9 * j, C);
    return true;
}

int32_t tm_patch_known_kind(const tm_patch_maker *maker) {
    return !maker->columns && !maker->turns && maker->known && maker->known->revision == maker->revision ? 2 : 1;
}

/* --- which surface --- */

static bool grow_by(tm_patch_maker *maker, int32_t t, int32_t max_vertices, bool by_load, tm_patch *patch) {
    const tm_contact *contact = maker->contact;
    const tm_surface_view surface = tm_patch_surface_of(maker);
    bool fans;
    tm_patch_grow(maker->world->tissue->mesh->rest_m, maker->world->state.u_m, &surface, &contact->tool[t].capsule,
                  maker->velocity_m_s[t], maker->def.horizon_s, contact->row, contact->row_count, max_vertices,
                  maker->def.max_triangles, by_load, may_be_held, maker, &fans, patch);
    return fans;
}

/* Around the tip's way, or, where a shaft bears too broadly for that, where it bears most. */
static bool grow(tm_patch_maker *maker, int32_t t, int32_t max_vertices, tm_patch *patch) {
    const bool fans = grow_by(maker, t, max_vertices, false, patch);
    if (!tm_patch_bears_outside(patch, 0, maker->contact->row, maker->contact->row_count)) return fans;
    return grow_by(maker, t, max_vertices, true, patch);
}

static bool is_known(const tm_patch_maker *maker, double held_N, const tm_patch *patch) {
    bool known = patch->triangle_count > 0;
    for (int32_t i = 0; i < patch->vertex_count && known; i++) known = tm_patch_is_known(maker, patch->vertex[i]);
    return known && !tm_patch_bears_outside(patch, held_N, maker->contact->row, maker->contact->row_count);
}

/* A smaller patch is one only with all that surrounds what bears the load. */
bool tm_patch_find_known(tm_patch_maker *maker, int32_t t, int32_t max_vertices, double held_N, tm_patch *patch) {
    if (is_known(maker, held_N, patch)) return true;
    for (int32_t quarters = 4; quarters >= 2 && quarters * max_vertices >= 32; quarters--)
        if (grow(maker, t, quarters * max_vertices / 4, patch) && is_known(maker, held_N, patch)) return true;
    return false;
}

static bool among(const int32_t *list, int32_t count, int32_t vertex) {
    for (int32_t i = 0; i < count; i++)
        if (list[i] == vertex) return true;
    return false;
}

/* --- what is asked for --- */

/* The patch's vertices by their distance from the tip, behind those that are in the list. */
static int32_t list_patch(const tm_patch_maker *maker, int32_t t, const tm_patch *patch, int32_t *list, int32_t first) {
    double distance[TM_HOLD_VERTICES + TM_PATCH_VERTICES];
    int32_t n = first;
    for (int32_t i = 0; i < patch->vertex_count; i++) {
        if (among(list, first, patch->vertex[i])) continue;
        double d[3];
        vsub(patch->vertex_m + 3 * i, maker->contact->tool[t].pose.tip_m, d);
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

/* By conjugate gradients there is room for so many: a patch beside much that is held is smaller. */
static void want_columns(tm_patch_maker *maker, int32_t t, int32_t held, int32_t max_vertices, int32_t *list,
                         tm_patch *patch) {
    int32_t n = held < TM_PATCH_VERTICES ? list_patch(maker, t, patch, list, held) : held;
    while (n > TM_PATCH_VERTICES && max_vertices >= 4) {
        max_vertices -= n - TM_PATCH_VERTICES;
        if (max_vertices < 3) break;
        grow(maker, t, max_vertices, patch);
        n = list_patch(maker, t, patch, list, held);
    }
    if (n > TM_PATCH_VERTICES) {
        patch->vertex_count = patch->triangle_count = 0;
        n = held < TM_PATCH_VERTICES ? held : TM_PATCH_VERTICES;
    }
    tm_columns_want(maker->columns, t, list, n);
    tm_columns_work(maker->columns, maker->def.iterations);
}

/* Of the source, and beside these what surrounds the tool's way. */
static void want_pieces(tm_patch_maker *maker, int32_t t, int32_t held, const tm_patch *patch, int32_t *list) {
    const tm_contact *contact = maker->contact;
    const tm_tissue *tissue = maker->world->tissue;
    const tm_surface_view surface = tm_patch_surface_of(maker);
    int32_t near[TM_COMPLIANCE_WANTS], n = list_patch(maker, t, patch, list, held);
    if (n > TM_COMPLIANCE_WANTS) n = TM_COMPLIANCE_WANTS;
    const int32_t needed = n, found = tm_patch_nearest(
                                  tissue->mesh->rest_m, maker->world->state.u_m, &surface, &contact->tool[t].capsule,
                                  maker->velocity_m_s[t], maker->def.horizon_s, contact->row, contact->row_count,
                                  contact->tool[t].def.mode == TM_TOOL_CAUTERY ? tissue->mass_kg : NULL,
                                  tissue->mesh->vertex_count, near);
    for (int32_t i = 0; i < found && n < TM_COMPLIANCE_WANTS; i++)
        if (!among(list, needed, near[i])) list[n++] = near[i];
    const tm_compliance_wish wish = {
        .count = n, .needed = needed, .vertex = list, .u_m = maker->turns ? maker->world->state.u_m : NULL};
    maker->known = maker->source.exchange(maker->source.self, t, &wish);
    const bool fresh = maker->known && maker->known->revision == maker->revision;
    maker->missing[t] = fresh ? 0 : needed;
    for (int32_t i = 0; i < needed && fresh; i++) maker->missing[t] += place_in(maker->known, list[i]) < 0;
}

void tm_patch_want(tm_patch_maker *maker, int32_t t, const int32_t *held, int32_t count, tm_patch *patch) {
    int32_t list[TM_HOLD_VERTICES + TM_PATCH_VERTICES], first = count < 0 ? 0 : count;
    const int32_t max_vertices = maker->def.max_vertices - (count > 0);
    if (first > TM_HOLD_VERTICES) first = 0; /* more than a patch can hold */
    for (int32_t i = 0; i < first; i++) list[i] = held[i];
    if (max_vertices >= 3) grow(maker, t, max_vertices, patch);
    if (maker->columns) {
        want_columns(maker, t, first, max_vertices, list, patch);
        return;
    }
    /* What a cut has made loose is known only when its columns are there, and then its neighbours' are asked for. */
    for (int round = 0; round < ROUNDS; round++) {
        want_pieces(maker, t, first, patch, list);
        if (patch->triangle_count == 0 || is_known(maker, 0, patch)) return;
        if (round < ROUNDS - 1) grow(maker, t, max_vertices, patch);
    }
}
