/* Computes the surface of a mesh at rest in its regions' colours, complete or cut open by a plane. */
#include "scene_decoration.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

/* --- names and colours --- */

/* Colours in linear light, as in anatomical atlases: veins blue, arteries red, bone ivory, bile green. */
static const struct {
    const char *words;
    float rgb[3];
} known[] = {{"_bed fossa", {0.33f, 0.115f, 0.075f}}, /* of an organ that lay there: paler than its neighbour */
             {"tumo cancer lesion metasta carcin", {0.62f, 0.46f, 0.20f}},
             {"vein vena portal cava", {0.035f, 0.07f, 0.30f}},
             {"arter aorta", {0.42f, 0.02f, 0.015f}},
             {"vessel", {0.06f, 0.06f, 0.28f}},
             {"gall bile biliary duct", {0.05f, 0.20f, 0.06f}},
             {"bone rib vertebr spine sternum skull pelvis", {0.66f, 0.58f, 0.42f}},
             {"fat adipos", {0.62f, 0.42f, 0.10f}},
             {"kidney renal", {0.20f, 0.035f, 0.022f}},
             {"spleen", {0.12f, 0.015f, 0.03f}},
             {"muscle", {0.30f, 0.03f, 0.022f}},
             {"lung", {0.50f, 0.20f, 0.18f}},
             {"brain", {0.48f, 0.34f, 0.30f}}};
static const float others[][3] = {
    {0.05f, 0.25f, 0.25f}, {0.30f, 0.12f, 0.32f}, {0.40f, 0.24f, 0.05f}, {0.10f, 0.28f, 0.08f}, {0.12f, 0.16f, 0.34f}};

static const float rigid_grey[3] = {0.27f, 0.29f, 0.31f};

/* Returns the colour of a known word in the name, or `other`. */
static const float *colour_of(const char *name, const float other[3]) {
    char lower[64] = "";
    for (size_t i = 0; name[i] && i < sizeof lower - 1; i++) lower[i] = (char)tolower((unsigned char)name[i]);
    for (size_t k = 0; k < sizeof known / sizeof *known; k++)
        for (const char *word = known[k].words; *word;) {
            const size_t length = strcspn(word, " ");
            for (const char *at = lower; *at; at++)
                if (strncmp(at, word, length) == 0) return known[k].rgb;
            word += length + (word[length] == ' ');
        }
    return other;
}

void view_regions_name(const tm_mesh_file *file, const tm_mesh *mesh, const uint8_t *rigid_tet, view_picture *picture) {
    double volume_m3[VIEW_REGIONS] = {0};
    bool rigid[VIEW_REGIONS] = {false};
    picture->regions = file->region_count < VIEW_REGIONS ? file->region_count : VIEW_REGIONS;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const int32_t r = mesh->region[t];
        if (r >= picture->regions) continue;
        rigid[r] = rigid_tet && rigid_tet[t];
        if (!rigid[r]) volume_m3[r] += mesh->volume_m3[t];
    }
    int largest = 0, number = 0;
    for (int r = 1; r < picture->regions; r++)
        if (volume_m3[r] > volume_m3[largest]) largest = r;
    for (int r = 0; r < picture->regions; r++) {
        view_region *region = &picture->region[r];
        const float *other = rigid[r] ? rigid_grey : others[number % (int)(sizeof others / sizeof *others)];
        snprintf(region->name, sizeof region->name, "%s", file->region_name[r]);
        region->tinted = r != largest || rigid[r];
        memcpy(region->rgb, colour_of(region->name, other), sizeof region->rgb);
        number += region->tinted && !rigid[r];
    }
}

/* --- the surface --- */

/* Unordered triangles. Corners are mesh vertices, or vertex_count + e where the plane crosses edge e. */
typedef struct soup {
    const tm_mesh *mesh;
    const view_picture *picture; /* picture that has the regions */
    const view_cutaway *cut;
    const double *side; /* [vertex_count] distance beyond the plane; null: no plane */
    int32_t *corner;    /* [3*count] */
    uint8_t *kind;
    int32_t count, capacity;
    bool full;
} soup;

static void add(soup *s, const int32_t corner[3], uint8_t kind) {
    if (s->count == s->capacity) {
        const int32_t more = 2 * s->capacity + 1024;
        int32_t *c = realloc(s->corner, 3 * (size_t)more * sizeof *c);
        if (c) s->corner = c;
        uint8_t *k = c ? realloc(s->kind, (size_t)more) : NULL;
        if (k) s->kind = k, s->capacity = more;
        s->full = s->full || !k;
        if (!k) return;
    }
    memcpy(s->corner + 3 * (size_t)s->count, corner, 3 * sizeof *corner);
    s->kind[s->count++] = kind;
}

/* Appends a polygon of three or four corners. */
static void add_polygon(soup *s, const int32_t *corner, int n, uint8_t kind) {
    for (int i = 2; i < n; i++) add(s, (const int32_t[3]){corner[0], corner[i - 1], corner[i]}, kind);
}

/* Returns the edge between two vertices, which must exist. */
static int32_t edge_of(const tm_mesh *m, int32_t a, int32_t b) {
    for (int32_t i = m->vertex_edge_begin[a]; i < m->vertex_edge_begin[a + 1]; i++) {
        const int32_t e = m->vertex_edge[i];
        if (m->edge[2 * e] + m->edge[2 * e + 1] == a + b) return e;
    }
    return -1;
}

static void add_clipped(soup *s, const int32_t v[3], uint8_t kind) {
    int32_t out[4];
    int n = 0;
    for (int i = 0; i < 3; i++) {
        const int32_t a = v[i], b = v[(i + 1) % 3];
        const bool a_stays = !s->side || s->side[a] <= 0, b_stays = !s->side || s->side[b] <= 0;
        if (a_stays) out[n++] = a;
        if (a_stays != b_stays) out[n++] = s->mesh->vertex_count + edge_of(s->mesh, a, b);
    }
    if (n >= 3) add_polygon(s, out, n, kind);
}

/* Appends the intersection of the plane and a tetrahedron: three or four edges, in the order that faces the viewer. */
static void add_cap(soup *s, int32_t tet) {
    const tm_mesh *m = s->mesh;
    const int32_t *v = m->tet + 4 * (int64_t)tet;
    int gone[4], here[4], goes = 0, stays = 0;
    for (int k = 0; k < 4; k++)
        if (s->side[v[k]] > 0)
            gone[goes++] = k;
        else
            here[stays++] = k;
    if (!goes || !stays) return;
    int32_t out[4];
    int n = 0;
    const int pairs[2][4][2] = {{{0, 0}, {0, 1}, {1, 1}, {1, 0}}, {{0, 0}, {0, 1}, {0, 2}, {0, 0}}};
    const bool two = goes == 2;
    for (int i = 0; i < (two ? 4 : 3); i++) {
        const int *p = pairs[!two][i];
        const int a = two || goes == 1 ? gone[p[0]] : here[p[0]], b = two || goes == 1 ? here[p[1]] : gone[p[1]];
        out[n++] = m->vertex_count + edge_of(m, v[a], v[b]);
    }
    double at[3][3], e[3], f[3], normal[3];
    for (int i = 0; i < 3; i++) {
        const int32_t *ends = m->edge + 2 * (int64_t)(out[i] - m->vertex_count);
        const double share = s->side[ends[0]] / (s->side[ends[0]] - s->side[ends[1]]);
        for (int a = 0; a < 3; a++)
            at[i][a] = m->rest_m[3 * ends[0] + a] + share * (m->rest_m[3 * ends[1] + a] - m->rest_m[3 * ends[0] + a]);
    }
    vsub(at[1], at[0], e), vsub(at[2], at[0], f);
    vcross(e, f, normal);
    if (vdot(normal, s->cut->normal) < 0) {
        const int32_t swap = out[0];
        out[0] = out[n - 1], out[n - 1] = swap;
        if (n == 4) {
            const int32_t inner = out[1];
            out[1] = out[2], out[2] = inner;
        }
    }
    add_polygon(s, out, n, (uint8_t)(view_kind_of(m->region[tet]) | 1));
}

/* Appends the faces between two regions, seen from outside the smaller one. */
static void add_inside(soup *s, const double *volume_m3) {
    const tm_mesh *m = s->mesh;
    for (int32_t f = 0; f < 4 * m->tet_count; f++) {
        const int32_t t = f / 4, other = m->tet_neighbour[f], region = m->region[t];
        if (other < 0 || m->region[other] == region) continue;
        if (volume_m3[region] > volume_m3[m->region[other]] ||
            (volume_m3[region] == volume_m3[m->region[other]] && t > other))
            continue;
        int32_t v[3];
        for (int k = 0; k < 3; k++) v[k] = m->tet[4 * (int64_t)t + tm_face_vertex[f % 4][k]];
        add_clipped(s, v, view_kind_of(region));
    }
}

/* Returns whether a region is drawn opaque: coloured regions are, the largest one is translucent. */
static bool is_solid(const soup *s, int32_t region) {
    return region < s->picture->regions && s->picture->region[region].tinted;
}

static bool collect(soup *s, int32_t *inside, int32_t *between) {
    const tm_mesh *m = s->mesh;
    double *volume_m3 = calloc((size_t)m->region_count + 1, sizeof *volume_m3);
    if (!volume_m3) return false;
    for (int32_t t = 0; t < m->tet_count; t++) volume_m3[m->region[t]] += m->volume_m3[t];
    if (s->cut->through > 0) add_inside(s, volume_m3);
    *between = s->count;
    for (int pass = s->cut->through > 0 ? 0 : 1; pass < 2; pass++) {
        for (int32_t f = 0; f < m->surface_count; f++) {
            const int32_t region = m->region[m->surface_face[f] / 4];
            if (s->cut->through > 0 && is_solid(s, region) != (pass == 0)) continue;
            add_clipped(s, m->surface + 3 * f, view_kind_of(region));
        }
        for (int32_t t = 0; t < m->tet_count && s->side; t++)
            if (s->cut->through <= 0 || is_solid(s, m->region[t]) == (pass == 0)) add_cap(s, t);
        if (pass == 0) *inside = s->count;
    }
    free(volume_m3);
    return !s->full;
}

static double *sides(const tm_mesh *m, const view_cutaway *cut) {
    double *side = malloc((size_t)m->vertex_count * sizeof *side), low[3], high[3], middle[3];
    for (int a = 0; a < 3; a++) low[a] = INFINITY, high[a] = -INFINITY;
    for (int32_t i = 0; i < 3 * m->vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], m->rest_m[i]);
        high[i % 3] = fmax(high[i % 3], m->rest_m[i]);
    }
    for (int a = 0; a < 3; a++) middle[a] = 0.5 * (low[a] + high[a]);
    for (int32_t v = 0; v < m->vertex_count && side; v++) {
        double d[3];
        vsub(m->rest_m + 3 * v, middle, d);
        side[v] = vdot(d, cut->normal) / vnorm(cut->normal) - cut->offset_m;
        if (side[v] == 0) side[v] = -1e-12; /* a vertex on the plane is kept */
    }
    return side;
}

static void place(const soup *s, int32_t corner, float at_m[3]) {
    const tm_mesh *m = s->mesh;
    if (corner < m->vertex_count) {
        for (int a = 0; a < 3; a++) at_m[a] = (float)m->rest_m[3 * corner + a];
        return;
    }
    const int32_t *ends = m->edge + 2 * (int64_t)(corner - m->vertex_count);
    const double share = s->side[ends[0]] / (s->side[ends[0]] - s->side[ends[1]]);
    for (int a = 0; a < 3; a++)
        at_m[a] =
            (float)(m->rest_m[3 * ends[0] + a] + share * (m->rest_m[3 * ends[1] + a] - m->rest_m[3 * ends[0] + a]));
}

/* Copies the corners that triangles use, renumbered in their order. */
static bool fill(const soup *s, int32_t inside, int32_t between, view_surface *out) {
    const int32_t all = s->mesh->vertex_count + s->mesh->edge_count;
    int32_t *number = calloc((size_t)all, sizeof *number), count = 0;
    for (int32_t i = 0; i < 3 * s->count && number; i++) number[s->corner[i]] = 1;
    for (int32_t c = 0; c < all && number; c++) number[c] = number[c] ? count++ : -1;
    const bool good = number && view_surface_reserve(out, count, s->count);
    for (int32_t c = 0; c < all && good; c++) {
        if (number[c] < 0) continue;
        out->vertex_id[number[c]] = c;
        place(s, c, out->vertex_m + 3 * number[c]);
    }
    for (int32_t i = 0; i < 3 * s->count && good; i++) out->triangle[i] = number[s->corner[i]];
    if (good) {
        memcpy(out->kind, s->kind, (size_t)s->count);
        out->vertex_count = count, out->triangle_count = s->count, out->inside_count = inside;
        out->between_count = between, out->planed = s->cut->clipped;
        ++out->version, ++out->topology;
    }
    free(number);
    return good;
}

bool view_regions_surface(const tm_mesh *mesh, const view_cutaway *cut, view_picture *picture) {
    double *side = cut->clipped ? sides(mesh, cut) : NULL;
    soup s = {.mesh = mesh, .picture = picture, .cut = cut, .side = side};
    int32_t inside = 0, between = 0;
    const bool good = (side || !cut->clipped) && collect(&s, &inside, &between) &&
                      (!s.count || fill(&s, inside, between, &picture->surface));
    picture->through = (float)cut->through;
    free(side);
    free(s.corner);
    free(s.kind);
    return good;
}

bool view_regions_ties(const tm_mesh *mesh, const tm_ties *ties, const view_cutaway *cut, view_picture *picture) {
    const int32_t count = tm_ties_count(ties);
    double *side = cut->clipped ? sides(mesh, cut) : NULL;
    const bool good = (side || !cut->clipped) && count <= VIEW_TIES_MAX && view_ties_reserve(&picture->ties, count);
    view_ties *to = &picture->ties;
    for (int32_t i = 0; i < count && good; i++) {
        const tm_tie tie = tm_ties_get(ties, i);
        bool hidden = !tm_ties_is_whole(ties, i) || (side && side[tie.vertex] > 0);
        for (int j = 0; j < 3; j++) hidden = hidden || (side && side[tie.other[j]] > 0);
        if (hidden) continue;
        double end[6];
        tm_ties_force_N(ties, i, end, end + 3);
        for (int a = 0; a < 6; a++) to->end_m[6 * to->count + a] = (float)end[a];
        to->count++;
    }
    to->total = good ? count : 0;
    free(side);
    return good;
}
