/* Surface and ties for viewers: allocated with the scene, filled once a frame. */
#include <string.h>

#include "effects.h"
#include "picture.h"

static const app_field fields[] = {
    {"rendering", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_rendering, here), 0,
     "send surface and ties for pictures, on channel TISSUE"},
    {"rendering.every", APP_INTEGER, NULL, "1", 1, 10000, offsetof(sim_rendering, every), 0, "send every n-th frame"},
};

/* Allocates one block: the message's arrays of rows, the rows, and the numbering. */
static tm_status build(sim *s, const void *own) {
    const sim_rendering *o = own;
    size_t n = (size_t)s->mesh->vertex_count;
    /* Cutting may expose each face of each tetrahedron, but faces pair up: two per tetrahedron at most, plus the
     * hull. */
    size_t t = (size_t)s->mesh->surface_count + (s->def.model.tissue.cuttable ? 2 * (size_t)s->mesh->tet_count : 0);
    size_t bytes = sizeof(sim_picture) + n * (sizeof(float *) + 3 * sizeof(float) + 2 * sizeof(int32_t)) +
                   t * (sizeof(int32_t *) + 3 * sizeof(int32_t) + 1);
    const tm_ties *ties = s->model->world ? tm_world_ties(s->model->world) : NULL;
    const size_t k = ties ? (size_t)tm_ties_count(ties) : 0;
    bytes += k * (sizeof(float *) + 6 * sizeof(float) + sizeof(int32_t));
    const bool renumbered = s->mesh->original_vertex;
    if (renumbered) bytes += n * sizeof(int32_t);
    sim_picture *p = s->picture = tm_allocate(bytes);
    if (!p) return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    memset(p, 0, bytes);
    p->bytes = bytes;
    p->revision = -1;
    p->vertex_m = (float **)(p + 1);
    p->triangle = (int32_t **)(p->vertex_m + n);
    p->tie_m = (float **)(p->triangle + t);
    float *xyz = (float *)(p->tie_m + k), *ends = xyz + 3 * n;
    int32_t *corner = (int32_t *)(ends + 6 * k);
    p->tie_id = corner + 3 * t;
    p->vertex_id = p->tie_id + k;
    p->slot_of = p->vertex_id + n;
    if (renumbered) sim_vertices_of_file(s, p->of_file = p->slot_of + n);
    p->triangle_kind = (int8_t *)(p->slot_of + (renumbered ? 2 : 1) * n);
    for (size_t i = 0; i < n; i++) p->vertex_m[i] = xyz + 3 * i;
    for (size_t i = 0; i < t; i++) p->triangle[i] = corner + 3 * i;
    for (size_t i = 0; i < k; i++) p->tie_m[i] = ends + 6 * i;
    p->tie_total = (int32_t)k;
    return 0;
}

static void destroy(sim *s) {
    if (s->picture) tm_release(s->picture, s->picture->bytes);
}

static bool was_outside(const tm_mesh *mesh, int32_t face) {
    int32_t low = 0, high = mesh->surface_count;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (mesh->surface_face[middle] < face)
            low = middle + 1;
        else
            high = middle;
    }
    return low < mesh->surface_count && mesh->surface_face[low] == face;
}

/* Converts the file's vertex number to the mesh's. */
static int32_t vertex_of(const sim_picture *p, int32_t in_file) { return p->of_file ? p->of_file[in_file] : in_file; }

static void renumber(sim_picture *p, const sim *s, const tm_surface_view *surface) {
    p->vertex_count = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) p->slot_of[v] = -1;
    for (int32_t i = 0; i < 3 * surface->count; i++) p->slot_of[surface->triangle[i]] = 0;
    for (int32_t in_file = 0; in_file < s->mesh->vertex_count; in_file++) {
        const int32_t v = vertex_of(p, in_file);
        if (p->slot_of[v]) continue;
        p->slot_of[v] = p->vertex_count;
        p->vertex_id[p->vertex_count++] = in_file;
    }
    p->triangle_count = surface->count;
    for (int32_t t = 0; t < surface->count; t++) {
        for (int c = 0; c < 3; c++) p->triangle[t][c] = p->slot_of[surface->triangle[3 * t + c]];
        p->triangle_kind[t] = !was_outside(s->mesh, surface->face[t]);
    }
    p->revision = surface->revision;
}

/* Lists the ties that hold. */
static void place_ties(sim_picture *p, const tm_ties *ties) {
    p->tie_count = 0;
    for (int32_t i = 0; i < p->tie_total; i++) {
        if (!tm_ties_is_whole(ties, i)) continue;
        double end[6];
        tm_ties_force_N(ties, i, end, end + 3);
        for (int a = 0; a < 6; a++) p->tie_m[p->tie_count][a] = (float)end[a];
        p->tie_id[p->tie_count++] = i;
    }
}

const sim_picture *sim_picture_now(sim *s) {
    sim_picture *p = s->picture;
    tm_surface_view surface = sim_surface(s);
    if (surface.revision != p->revision) renumber(p, s, &surface);
    const double *u = sim_displacement(s);
    for (int32_t i = 0; i < p->vertex_count; i++)
        for (int a = 0; a < 3; a++) {
            int32_t d = 3 * vertex_of(p, p->vertex_id[i]) + a;
            p->vertex_m[i][a] = (float)(s->mesh->rest_m[d] + u[d]);
        }
    if (p->tie_total) place_ties(p, tm_world_ties(s->model->world));
    return p;
}

const sim_effect sim_effect_rendering = {
    .name = "rendering",
    .doc = "`tissue` messages for tm-view, live or in the recording. The simulation itself opens no graphics library.",
    .example = "",
    .trial = SIM_TRIAL_LEAVE_OUT,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_rendering)},
    .build = build,
    .destroy = destroy,
};
