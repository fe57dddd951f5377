#include "surface_smoothing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cut_outline.h"
#include "fairing.h"
#include "reference.h"

#define LAW_REAL float
#include "libtensormass/numeric/union_find.h"
#include "libtensormass/numeric/vec.h"

enum { LEVELS_MAX = VIEW_RIM_LEVELS };
static const float COS_TORN = -0.25f;

/* One split: every edge of the previous level gets a vertex in its middle, every triangle becomes four. */
typedef struct level {
    int32_t edge_count, triangle_count;
    int32_t *edge;   /* [2*edge_count] ends, vertices of the previous level */
    uint8_t *curved; /* [edge_count] 0 at creases and boundaries: straight, so no gap opens */
    int32_t *rim;    /* [edge_count] point of the cut's rim that is its middle; -1: none */
    uint32_t *index; /* [3*triangle_count] */
} level;

struct view_skin {
    int levels;
    float cos_crease, grain_m;
    bool built, index_changed;
    uint32_t version, topology;
    view_fairing fairing;
    view_rim rim;
    float *place;           /* [3*vertex_count of the surface] drawn positions of its vertices */
    int32_t sector_count;   /* vertices of the surface, split where creases separate their triangles */
    int32_t *sector_vertex; /* [sector_count] */
    int32_t *normal_of;     /* [sector_count] sector that gives its normal: a cut's wall has one across all regions */
    uint32_t *index;        /* [3*triangle_count] sectors */
    int32_t triangle_count, inside_count;
    level level[LEVELS_MAX];
    int32_t vertex_count;
    view_vertex *vertex; /* sectors, then the middles of each level */
    view_references references;
};

view_skin *view_skin_create(int levels, float crease_rad) {
    view_skin *skin = calloc(1, sizeof *skin);
    if (!skin) return NULL;
    skin->levels = levels < 0 ? 0 : levels > LEVELS_MAX ? LEVELS_MAX : levels;
    skin->cos_crease = cosf(crease_rad);
    return skin;
}

static void drop_topology(view_skin *skin) {
    free(skin->place), skin->place = NULL;
    free(skin->sector_vertex), skin->sector_vertex = NULL;
    free(skin->normal_of), skin->normal_of = NULL;
    free(skin->index), skin->index = NULL;
    free(skin->vertex), skin->vertex = NULL;
    for (int i = 0; i < LEVELS_MAX; i++) {
        free(skin->level[i].edge);
        free(skin->level[i].curved);
        free(skin->level[i].rim);
        free(skin->level[i].index);
    }
    memset(skin->level, 0, sizeof skin->level);
    skin->built = false;
}

void view_skin_free(view_skin *skin) {
    if (!skin) return;
    drop_topology(skin);
    view_fairing_free(&skin->fairing);
    view_rim_free(&skin->rim);
    view_references_free(&skin->references);
    free(skin);
}

static void face_normal(const float *a, const float *b, const float *c, float n[3]) {
    float u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    n[0] = u[1] * v[2] - u[2] * v[1];
    n[1] = u[2] * v[0] - u[0] * v[2];
    n[2] = u[0] * v[1] - u[1] * v[0];
}

static void normalise(float n[3]) {
    float length = sqrtf(vdot(n, n));
    if (length > 0)
        n[0] /= length, n[1] /= length, n[2] /= length;
    else
        n[0] = 0, n[1] = 0, n[2] = 1;
}

/* Returns whether two sides of one edge belong to one smooth patch, regions aside. */
static bool smooth(const view_skin *skin, const view_surface *s, const view_side *p, const view_side *q) {
    const int32_t *a = s->triangle + 3 * p->triangle, *b = s->triangle + 3 * q->triangle;
    const bool opened = s->kind[p->triangle] & 1;
    if (opened != (s->kind[q->triangle] & 1) || a[p->local] != b[(q->local + 1) % 3]) return false;
    float m[3], n[3];
    face_normal(skin->place + 3 * a[0], skin->place + 3 * a[1], skin->place + 3 * a[2], m);
    face_normal(skin->place + 3 * b[0], skin->place + 3 * b[1], skin->place + 3 * b[2], n);
    /* Removed tetrahedra leave jagged surfaces. Exposed surfaces are smoothed even across angles beyond 90 degrees. */
    float limit = opened ? fminf(skin->cos_crease, COS_TORN) : skin->cos_crease;
    return vdot(m, n) >= limit * sqrtf(vdot(m, m) * vdot(n, n));
}

/* Joins corners that meet across smooth edges into one sector: one position, one normal, one region. Where a cut's wall
 * crosses regions, their sectors share only the normal (`blend`). */
static void join_corners(const view_skin *skin, const view_surface *s, const view_side *sides, int32_t *parent,
                         int32_t *blend) {
    const int32_t corners = 3 * s->triangle_count;
    for (int32_t c = 0; c < corners; c++) parent[c] = blend[c] = c;
    for (int32_t i = 0, end; i < corners; i = end) {
        end = view_sides_end(sides, corners, i);
        const view_side *p = &sides[i], *q = &sides[end - 1];
        const uint8_t kind = s->kind[p->triangle];
        const bool same = kind == s->kind[q->triangle], wall = (kind & 1) && !s->planed;
        if (end - i != 2 || !(same || wall) || !smooth(skin, s, p, q)) continue;
        const int32_t from = 3 * p->triangle, to = 3 * q->triangle;
        const int32_t pair[2][2] = {{from + p->local, to + (q->local + 1) % 3},
                                    {from + (p->local + 1) % 3, to + q->local}};
        for (int e = 0; e < 2; e++) {
            if (same) law_join(parent, pair[e][0], pair[e][1]);
            law_join(blend, pair[e][0], pair[e][1]);
        }
    }
}

static bool build_sectors(view_skin *skin, const view_surface *s) {
    const int32_t corners = 3 * s->triangle_count;
    const size_t room = (size_t)corners + 1;
    int32_t *parent = malloc(room * sizeof *parent), *blend = malloc(room * sizeof *blend);
    skin->index = malloc(room * sizeof *skin->index);
    skin->sector_vertex = malloc(room * sizeof *skin->sector_vertex);
    skin->normal_of = malloc(room * sizeof *skin->normal_of);
    view_side *sides = view_sides_sorted((const uint32_t *)s->triangle, s->triangle_count);
    const bool good = parent && blend && skin->index && skin->sector_vertex && skin->normal_of && sides;
    if (good) join_corners(skin, s, sides, parent, blend);
    skin->sector_count = 0;
    for (int32_t c = 0; good && c < corners; c++) {
        int32_t root = law_root(parent, c);
        skin->index[c] = root == c ? (uint32_t)skin->sector_count : skin->index[root];
        if (root != c) continue;
        skin->sector_vertex[skin->sector_count] = s->triangle[c];
        skin->normal_of[skin->sector_count++] = (int32_t)skin->index[law_root(blend, c)];
    }
    skin->triangle_count = s->triangle_count, skin->inside_count = s->inside_count;
    free(parent);
    free(blend);
    free(sides);
    return good;
}

static bool build_level(level *out, const uint32_t *index, int32_t triangle_count, int32_t vertex_count) {
    int32_t corners = 3 * triangle_count;
    view_side *sides = view_sides_sorted(index, triangle_count);
    uint32_t *middle = malloc(((size_t)corners + 1) * sizeof *middle);
    out->edge = malloc(((size_t)corners * 2 + 1) * sizeof *out->edge);
    out->curved = malloc((size_t)corners + 1);
    out->index = malloc(((size_t)corners * 4 + 1) * sizeof *out->index);
    if (!sides || !middle || !out->edge || !out->curved || !out->index) return free(sides), free(middle), false;
    for (int32_t i = 0; i < corners;) {
        int32_t end = i;
        for (; end < corners && sides[end].key == sides[i].key; end++)
            middle[3 * sides[end].triangle + sides[end].local] = (uint32_t)(vertex_count + out->edge_count);
        out->edge[2 * out->edge_count] = (int32_t)(sides[i].key >> 32);
        out->edge[2 * out->edge_count + 1] = (int32_t)(sides[i].key & 0xffffffffu);
        out->curved[out->edge_count++] = end - i == 2;
        i = end;
    }
    for (int32_t t = 0; t < triangle_count; t++) {
        const uint32_t *v = index + 3 * t, *m = middle + 3 * t;
        const uint32_t four[12] = {v[0], m[0], m[2], m[0], v[1], m[1], m[2], m[1], v[2], m[0], m[1], m[2]};
        memcpy(out->index + 12 * t, four, sizeof four);
    }
    out->triangle_count = 4 * triangle_count;
    free(sides);
    free(middle);
    return true;
}

/* Finds edges whose middles are on the cut's rim: those of its segments, whatever triangles they bound. */
static bool find_rim(view_skin *skin, const view_surface *s) {
    int32_t count = skin->sector_count, *point = NULL;
    if (!view_rim_take(&skin->rim, s, skin->levels)) return false;
    for (int i = 0; i < skin->levels; i++) count += skin->level[i].edge_count;
    bool good = (point = malloc(((size_t)count + 1) * sizeof *point)) != NULL;
    count = skin->sector_count;
    for (int32_t i = 0; good && i < count; i++)
        point[i] = skin->rim.piece_count[0] ? skin->rim.point[skin->sector_vertex[i]] : -1;
    for (int i = 0; i < skin->levels && good; i++) {
        level *l = &skin->level[i];
        good = (l->rim = malloc(((size_t)l->edge_count + 1) * sizeof *l->rim)) != NULL;
        for (int32_t e = 0; good && e < l->edge_count; e++)
            l->rim[e] = point[count++] =
                view_rim_middle(&skin->rim, i, point[l->edge[2 * e]], point[l->edge[2 * e + 1]]);
    }
    free(point);
    return good;
}

static void middle_reference(view_vertex *m, const view_vertex *a, const view_vertex *b) {
    for (int k = 0; k < 3; k++) m->reference_m[k] = (a->reference_m[k] + b->reference_m[k]) / 2;
    m->kind = a->kind;
}

/* Computes each sector's position and reference position as drawn: a cut's wall is faired in both. */
static bool lay_out(view_skin *skin, const view_surface *s) {
    const size_t room = 3 * (size_t)s->vertex_count + 1;
    float *seen = malloc(room * sizeof *seen), *drawn = malloc(room * sizeof *drawn);
    const bool good = seen && drawn && view_references_update(&skin->references, s, seen);
    if (good) view_fairing_apply(&skin->fairing, s, seen, drawn);
    for (int32_t i = 0; good && i < skin->sector_count; i++)
        vset(drawn + 3 * skin->sector_vertex[i], skin->vertex[i].reference_m);
    free(seen);
    free(drawn);
    return good;
}

static bool build(view_skin *skin, const view_surface *s) {
    drop_topology(skin);
    skin->place = malloc((3 * (size_t)s->vertex_count + 1) * sizeof *skin->place);
    if (!skin->place || !view_fairing_take(&skin->fairing, s)) return false;
    view_fairing_apply(&skin->fairing, s, s->vertex_m, skin->place);
    if (!build_sectors(skin, s)) return false;
    int32_t count = skin->sector_count, triangles = skin->triangle_count;
    const uint32_t *index = skin->index;
    for (int i = 0; i < skin->levels; i++) {
        if (!build_level(&skin->level[i], index, triangles, count)) return false;
        count += skin->level[i].edge_count, triangles = skin->level[i].triangle_count, index = skin->level[i].index;
    }
    skin->vertex = calloc((size_t)count + 1, sizeof *skin->vertex);
    if (!skin->vertex || !find_rim(skin, s) || !lay_out(skin, s)) return false;
    skin->vertex_count = count;
    for (int32_t c = 0; c < 3 * skin->triangle_count; c++) skin->vertex[skin->index[c]].kind = s->kind[c / 3];
    view_vertex *middle = skin->vertex + skin->sector_count;
    for (int i = 0; i < skin->levels; i++)
        for (int32_t e = 0; e < skin->level[i].edge_count; ++e, ++middle)
            middle_reference(middle, &skin->vertex[skin->level[i].edge[2 * e]],
                             &skin->vertex[skin->level[i].edge[2 * e + 1]]);
    for (int32_t i = 0; i < count; i++)
        view_reference_mottle(skin->vertex[i].reference_m, skin->grain_m, skin->vertex[i].mottle);
    skin->topology = s->topology;
    skin->built = skin->index_changed = true;
    return true;
}

/* Normals weighted by the corner angle do not depend on the triangulation of a flat patch. */
static void sector_normals(view_skin *skin) {
    for (int32_t i = 0; i < skin->sector_count; i++) memset(skin->vertex[i].normal, 0, sizeof skin->vertex[i].normal);
    for (int32_t t = 0; t < skin->triangle_count; t++) {
        view_vertex *v[3];
        float *normal[3];
        for (int i = 0; i < 3; i++) {
            const uint32_t sector = skin->index[3 * t + i];
            v[i] = &skin->vertex[sector], normal[i] = skin->vertex[skin->normal_of[sector]].normal;
        }
        float n[3];
        face_normal(v[0]->at_m, v[1]->at_m, v[2]->at_m, n);
        normalise(n);
        for (int i = 0; i < 3; i++) {
            float a[3], b[3];
            for (int k = 0; k < 3; k++)
                a[k] = v[(i + 1) % 3]->at_m[k] - v[i]->at_m[k], b[k] = v[(i + 2) % 3]->at_m[k] - v[i]->at_m[k];
            normalise(a);
            normalise(b);
            float angle = acosf(fminf(fmaxf(vdot(a, b), -1), 1));
            for (int k = 0; k < 3; k++) normal[i][k] += angle * n[k];
        }
    }
    for (int32_t i = 0; i < skin->sector_count; i++)
        if (skin->normal_of[i] == i) normalise(skin->vertex[i].normal);
    for (int32_t i = 0; i < skin->sector_count; i++)
        vset(skin->vertex[skin->normal_of[i]].normal, skin->vertex[i].normal);
}

/* Darkens hollows: by the neighbours' mean height above the tangent plane. */
static void sector_shade(view_skin *skin) {
    for (int32_t i = 0; i < skin->sector_count; i++) skin->vertex[i].shade = 0;
    int32_t corners = 3 * skin->triangle_count;
    for (int32_t c = 0; c < corners; c++) {
        view_vertex *v = &skin->vertex[skin->index[c]];
        const view_vertex *w = &skin->vertex[skin->index[c % 3 == 2 ? c - 2 : c + 1]];
        float d[3] = {w->at_m[0] - v->at_m[0], w->at_m[1] - v->at_m[1], w->at_m[2] - v->at_m[2]};
        normalise(d);
        v->shade += vdot(v->normal, d) / 6; /* usual number of neighbours */
    }
    for (int32_t i = 0; i < skin->sector_count; i++)
        skin->vertex[i].shade = fminf(fmaxf(1 - 1.6f * skin->vertex[i].shade, 0.35f), 1.0f);
}

/* Computes the middle of the cubic that is perpendicular to the normals at both ends (Vlachos and others, "Curved PN
 * triangles", 2001). */
static void middle_of(view_vertex *m, const view_vertex *a, const view_vertex *b, bool curved) {
    float d[3], h[3];
    for (int k = 0; k < 3; k++) {
        d[k] = b->at_m[k] - a->at_m[k];
        h[k] = a->normal[k] + b->normal[k];
        m->at_m[k] = (a->at_m[k] + b->at_m[k]) / 2;
    }
    m->shade = (a->shade + b->shade) / 2;
    if (curved) {
        float wa = vdot(d, a->normal), wb = vdot(d, b->normal), length2 = vdot(d, d);
        float turn = length2 > 0 ? 2 * vdot(d, h) / length2 : 0;
        for (int k = 0; k < 3; k++) {
            m->at_m[k] += (wb * b->normal[k] - wa * a->normal[k]) / 8;
            h[k] -= turn * d[k];
        }
    }
    memcpy(m->normal, h, sizeof h);
    normalise(m->normal);
}

bool view_skin_update(view_skin *skin, const view_surface *s, float grain_m) {
    skin->grain_m = grain_m;
    if (skin->built && skin->version == s->version && skin->topology == s->topology) return true;
    if (!skin->built || skin->topology != s->topology)
        if (!build(skin, s)) return drop_topology(skin), false;
    view_fairing_apply(&skin->fairing, s, s->vertex_m, skin->place);
    for (int32_t i = 0; i < skin->sector_count; i++)
        vset(skin->place + 3 * skin->sector_vertex[i], skin->vertex[i].at_m);
    sector_normals(skin);
    sector_shade(skin);
    view_rim_lay(&skin->rim, skin->levels, skin->place);
    view_vertex *middle = skin->vertex + skin->sector_count;
    for (int i = 0; i < skin->levels; i++) {
        const level *l = &skin->level[i];
        for (int32_t e = 0; e < l->edge_count; ++e, ++middle) {
            middle_of(middle, &skin->vertex[l->edge[2 * e]], &skin->vertex[l->edge[2 * e + 1]], l->curved[e]);
            if (l->rim[e] >= 0) vset(skin->rim.at + 3 * l->rim[e], middle->at_m);
        }
    }
    skin->version = s->version;
    return true;
}

int32_t view_skin_vertices(const view_skin *skin, const view_vertex **vertex) {
    *vertex = skin->vertex;
    return skin->built ? skin->vertex_count : 0;
}

float *view_skin_places(const view_skin *skin) { return skin->place; }

int32_t view_skin_inside(const view_skin *skin) {
    return skin->built ? 3 * (skin->inside_count << 2 * skin->levels) : 0;
}

int32_t view_skin_coarse_indices(const view_skin *skin, const uint32_t **index) {
    *index = skin->index;
    return skin->built ? 3 * skin->triangle_count : 0;
}

int32_t view_skin_indices(view_skin *skin, const uint32_t **index, bool *changed) {
    *changed = skin->index_changed;
    skin->index_changed = false;
    if (!skin->built) return 0;
    *index = skin->levels ? skin->level[skin->levels - 1].index : skin->index;
    return 3 * (skin->levels ? skin->level[skin->levels - 1].triangle_count : skin->triangle_count);
}
