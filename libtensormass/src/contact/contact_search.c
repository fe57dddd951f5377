/* Contact search for callers outside the stage: triangles around a tool, gathered once and searched many times. */
#include "contact/contact_internal.h"
#include "contact_law/feature.h"

struct tm_contact_search {
    tm_pool pool;
    tm_local_surface surface;
    tm_hits hits;
};

tm_status tm_contact_search_create(tm_contact_search **made, tm_error *error) {
    TM_REQUIRE(made, "search is null", TM_ERR_ARGUMENT);
    tm_pool pool = {0};
    tm_contact_search *self = TM_ALLOC(&pool, tm_contact_search, 1);
    if (!self) return tm_fail_memory(error, "search around a tool");
    self->pool = pool;
    *made = self;
    return TM_OK;
}

void tm_contact_search_destroy(tm_contact_search *self) {
    if (!self) return;
    tm_pool pool = self->pool;
    tm_pool_release(&pool);
}

bool tm_contact_search_gather(tm_contact_search *self, const double *rest_m, const double *u_m,
                              const tm_surface_view *surface, const tm_capsule *capsule, double reach_m) {
    TM_REQUIRE(self && rest_m && surface && capsule && (surface->count == 0 || (surface->triangle && surface->face)),
               "search, rest_m, surface or capsule is null", false);
    tm_local_gather(&self->surface, rest_m, u_m, surface->triangle, surface->face, NULL, surface->count, capsule,
                    reach_m);
    return !self->surface.overflowed;
}

int32_t tm_contact_search_vertices(const tm_contact_search *self, const int32_t **vertex) {
    TM_REQUIRE(self && vertex, "search or vertex is null", 0);
    *vertex = self->surface.vertex_id;
    return self->surface.vertex_count;
}

int32_t tm_contact_search_faces(const tm_contact_search *self, const int32_t **face, double *edge_m) {
    TM_REQUIRE(self && face && edge_m, "search, face or edge_m is null", 0);
    *face = self->surface.face_id;
    *edge_m = self->surface.edge_m;
    return self->surface.face_count;
}

static bool is_listed(const int32_t *face, int32_t count, int32_t wanted) {
    int32_t low = 0;
    while (low < count) {
        const int32_t middle = (low + count) / 2;
        if (face[middle] < wanted)
            low = middle + 1;
        else
            count = middle;
    }
    return face[low] == wanted;
}

bool tm_contact_search_restore(tm_contact_search *self, const double *rest_m, const tm_surface_view *surface,
                               const int32_t *face, int32_t count, double edge_m) {
    TM_REQUIRE(self && rest_m && surface && (face || count <= 0), "search, rest_m, surface or face is null", false);
    const tm_capsule anywhere = {.radius_m = 1};
    int32_t slot[TM_LOCAL_FACES + 1], found = 0;
    if (count < 0 || count > TM_LOCAL_FACES) count = 0;
    for (int32_t i = 0; i < surface->count && count > 0 && found < count; i++)
        if (surface->face[i] <= face[count - 1] && is_listed(face, count, surface->face[i])) slot[found++] = i;
    const bool all = found == count;
    tm_local_gather(&self->surface, rest_m, NULL, surface->triangle, surface->face, slot, all ? found : 0, &anywhere,
                    1e9);
    self->surface.edge_m = edge_m;
    return all;
}

int32_t tm_contact_search_rows(tm_contact_search *self, const double *rest_m, const double *u_m,
                               const tm_capsule *capsule, double margin_m, const tm_contact_row *before,
                               int32_t before_count, tm_contact_row *row, int32_t max_rows, bool *overflowed) {
    TM_REQUIRE(self && rest_m && u_m && capsule && overflowed, "search, rest_m, u_m, capsule or overflowed is null", 0);
    TM_REQUIRE((before || before_count <= 0) && (row || max_rows <= 0), "before or row is null", 0);
    tm_local_place(&self->surface, rest_m, u_m);
    return tm_local_rows(&self->surface, &self->hits, capsule, margin_m, before, before_count, row, max_rows,
                         overflowed);
}

int32_t tm_contact_find(tm_contact_search *work, const double *rest_m, const double *u_m, const int32_t *triangle,
                        const int32_t *face, const int32_t *candidate, int32_t candidate_count,
                        const tm_capsule *capsule, double margin_m, tm_contact_row *row, int32_t max_rows,
                        bool *overflowed) {
    TM_REQUIRE(work && rest_m && u_m && triangle && face && capsule && candidate_count >= 0 && row && max_rows >= 0,
               "an argument is null, or a count is negative", 0);
    TM_REQUIRE(capsule->radius_m > 0, "the capsule's radius is not positive", 0);
    bool too_many;
    work->surface.edge_m = 0; /* an estimate from before may gather more than these */
    tm_local_gather(&work->surface, rest_m, u_m, triangle, face, candidate, candidate_count, capsule,
                    capsule->radius_m * (1 + LAW_PROXIMITY) + margin_m);
    tm_local_place(&work->surface, rest_m, u_m);
    const int32_t count =
        tm_local_rows(&work->surface, &work->hits, capsule, margin_m, NULL, 0, row, max_rows, &too_many);
    if (overflowed && too_many) *overflowed = true;
    return count;
}
