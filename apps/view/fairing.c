#include "fairing.h"

#include <stdlib.h>
#include <string.h>

#include "cut_outline.h"

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"

/* Taubin, "A signal processing approach to fair surface design", 1995: each round moves every vertex towards its
 * neighbours' mean, then back by a little more. Waves of several edge lengths remain; shorter ones vanish. */
enum { ROUNDS = 12 };
static const float DRAW = 0.5f, PUSH = -0.53f;
static const float SLIDE = 0.33f; /* maximum slide as a share of a triangle's height */

void view_fairing_free(view_fairing *f) {
    free(f->vertex);
    free(f->near_begin);
    free(f->near);
    free(f->beside);
    free(f->across);
    free(f->slot);
    free(f->normal);
    free(f->reach_m);
    free(f->step_m);
    memset(f, 0, sizeof *f);
}

/* --- selection of vertices --- */

enum { OPENED = 1, OUTER = 2 };

static bool is_opened(const view_surface *s, int32_t triangle) { return s->kind[triangle] & 1; }

/* Returns whether smoothing acts along an edge: every edge within the wall, at the rim only edges between wall and
 * outer surface. */
static bool is_drawn_along(const view_surface *s, const uint8_t *touches, const view_side *side, int32_t sides,
                           int32_t from) {
    int faces = 0;
    for (int32_t i = 0; i < sides; i++) faces |= is_opened(s, side[i].triangle) ? OPENED : OUTER;
    return touches[from] == OPENED ? faces & OPENED : faces == (OPENED | OUTER) && sides == 2;
}

/* Stores neighbours from fill[slot] on and increments it; only counts them if `near` is null. */
static void find_near(view_fairing *f, const view_surface *s, const uint8_t *touches, const view_side *sides,
                      int32_t side_count, int32_t *fill) {
    for (int32_t i = 0, end; i < side_count; i = end) {
        end = view_sides_end(sides, side_count, i);
        const int32_t ends[2] = {(int32_t)(sides[i].key >> 32), (int32_t)(sides[i].key & 0xffffffffu)};
        for (int e = 0; e < 2; e++) {
            const int32_t slot = f->slot[ends[e]];
            if (slot < 0 || !is_drawn_along(s, touches, sides + i, end - i, ends[e])) continue;
            if (f->near) f->near[fill[slot]] = ends[!e];
            fill[slot]++;
        }
    }
}

static void number(view_fairing *f, int32_t vertex_count, const uint8_t *touches) {
    f->count = 0;
    for (int32_t v = 0; v < vertex_count; v++) f->slot[v] = -1;
    for (int rim = 0; rim < 2; rim++) {
        for (int32_t v = 0; v < vertex_count; v++)
            if (touches[v] == (rim ? OPENED | OUTER : OPENED)) f->vertex[f->count] = v, f->slot[v] = f->count++;
        if (!rim) f->inner_count = f->count;
    }
}

/* Fixes rim vertices where the rim forks or ends. */
static void hold_forks(view_fairing *f, int32_t *near_count) {
    int32_t kept = f->inner_count;
    for (int32_t i = f->inner_count; i < f->count; i++) {
        const int32_t v = f->vertex[i];
        f->slot[v] = near_count[i] == 2 ? kept : -1;
        if (near_count[i] == 2) f->vertex[kept] = v, near_count[kept++] = 2;
    }
    f->count = kept;
}

static void find_beside(view_fairing *f, const view_surface *s) {
    f->beside_count = 0;
    for (int32_t t = s->between_count; t < s->triangle_count; t++) {
        bool at_rim = false;
        for (int c = 0; c < 3; c++) at_rim = at_rim || f->slot[s->triangle[3 * t + c]] >= f->inner_count;
        if (!is_opened(s, t) && at_rim) f->beside[f->beside_count++] = t;
    }
}

static bool find(view_fairing *f, const view_surface *s, const uint8_t *touches, const view_side *sides,
                 int32_t side_count) {
    number(f, s->vertex_count, touches);
    const size_t room = (size_t)f->count + 1;
    int32_t *fill = calloc(room, sizeof *fill);
    f->near_begin = calloc(room, sizeof *f->near_begin);
    f->normal = malloc(3 * room * sizeof *f->normal);
    f->step_m = malloc(3 * room * sizeof *f->step_m);
    f->reach_m = malloc(room * sizeof *f->reach_m);
    bool good = fill && f->near_begin && f->normal && f->step_m && f->reach_m;
    if (good) {
        find_near(f, s, touches, sides, side_count, fill);
        hold_forks(f, fill);
        for (int32_t i = 0; i < f->count; i++) f->near_begin[i + 1] = f->near_begin[i] + fill[i];
        memcpy(fill, f->near_begin, room * sizeof *fill);
        good = (f->near = malloc(((size_t)f->near_begin[f->count] + 1) * sizeof *f->near)) != NULL;
    }
    if (good) {
        find_near(f, s, touches, sides, side_count, fill);
        find_beside(f, s);
        good = (f->across = malloc((12 * (size_t)f->beside_count + 1) * sizeof *f->across)) != NULL;
    }
    free(fill);
    return good;
}

bool view_fairing_take(view_fairing *f, const view_surface *s) {
    bool cut = false;
    view_fairing_free(f);
    for (int32_t t = s->between_count; t < s->triangle_count; t++) cut = cut || is_opened(s, t);
    if (!cut || s->planed) return true;
    const int32_t triangles = s->triangle_count - s->between_count;
    const uint32_t *index = (const uint32_t *)s->triangle + 3 * (size_t)s->between_count;
    uint8_t *touches = calloc((size_t)s->vertex_count + 1, 1);
    view_side *sides = view_sides_sorted(index, triangles);
    f->vertex = malloc(((size_t)s->vertex_count + 1) * sizeof *f->vertex);
    f->slot = malloc(((size_t)s->vertex_count + 1) * sizeof *f->slot);
    f->beside = malloc(((size_t)triangles + 1) * sizeof *f->beside);
    bool good = touches && sides && f->vertex && f->slot && f->beside;
    for (int32_t i = 0; good && i < 3 * triangles; i++) {
        sides[i].triangle += s->between_count;
        touches[index[i]] |= is_opened(s, s->between_count + i / 3) ? OPENED : OUTER;
    }
    good = good && find(f, s, touches, sides, 3 * triangles);
    free(touches);
    free(sides);
    if (!good || !f->count) view_fairing_free(f);
    return good;
}

/* --- positions --- */

/* Computes the outer surface's normals at the rim, and how far a corner may slide towards the opposite side. */
static void measure_rim(view_fairing *f, const view_surface *s, const float *at) {
    for (int32_t i = 0; i < f->beside_count; i++) {
        const int32_t *v = s->triangle + 3 * (int64_t)f->beside[i];
        float edge[3][3], n[3];
        for (int c = 0; c < 3; c++) vsub(at + 3 * v[(c + 2) % 3], at + 3 * v[(c + 1) % 3], edge[c]);
        vcross(edge[0], edge[1], n);
        const float twice_m2 = vnorm(n);
        for (int c = 0; c < 3; c++) {
            float *across = f->across + 4 * (3 * (int64_t)i + c);
            vcross(edge[c], n, across);
            vunit(across, across);
            across[3] = SLIDE * twice_m2 / fmaxf(vnorm(edge[c]), 1e-12f);
            if (f->slot[v[c]] >= f->inner_count) vadd(f->normal + 3 * f->slot[v[c]], 1, n);
        }
    }
    for (int32_t i = f->inner_count; i < f->count; i++) vunit(f->normal + 3 * i, f->normal + 3 * i);
}

/* Limits the displacements so that no triangle at the rim inverts, even if all its corners slide. */
static void hold_back(view_fairing *f, const view_surface *s, const float *from) {
    for (int32_t i = 0; i < 3 * f->beside_count; i++) {
        const int32_t v = s->triangle[3 * (int64_t)f->beside[i / 3] + i % 3], slot = f->slot[v];
        if (slot < f->inner_count) continue;
        const float *across = f->across + 4 * (int64_t)i;
        float moved[3];
        vsub(f->step_m + 3 * slot, from + 3 * v, moved);
        const float over = vdot(moved, across) - across[3];
        if (over > 0) vadd(f->step_m + 3 * slot, -over, across);
    }
}

static void measure(view_fairing *f, const view_surface *s, const float *at) {
    memset(f->normal, 0, 3 * (size_t)f->count * sizeof *f->normal);
    for (int32_t i = 0; i < f->count; i++) {
        float sum = 0, edge[3];
        for (int32_t k = f->near_begin[i]; k < f->near_begin[i + 1]; k++) {
            vsub(at + 3 * f->near[k], at + 3 * f->vertex[i], edge);
            sum += vnorm(edge);
        }
        f->reach_m[i] = VIEW_FAIRING_REACH * sum / (float)(f->near_begin[i + 1] - f->near_begin[i]);
    }
    measure_rim(f, s, at);
}

/* Moves all vertices simultaneously towards (or away from) the mean of their neighbours. */
static void step(view_fairing *f, const view_surface *s, float share, const float *from, float *at) {
    for (int32_t i = 0; i < f->count; i++) {
        float mean[3] = {0}, *out = f->step_m + 3 * i;
        const int32_t begin = f->near_begin[i], end = f->near_begin[i + 1];
        for (int32_t k = begin; k < end; k++) vadd(mean, 1.0f / (float)(end - begin), at + 3 * f->near[k]);
        const float *here = at + 3 * f->vertex[i], *was = from + 3 * f->vertex[i], *normal = f->normal + 3 * i;
        for (int a = 0; a < 3; a++) out[a] = here[a] + share * (mean[a] - here[a]) - was[a];
        if (i >= f->inner_count) vadd(out, -vdot(out, normal), normal);
        const float length = vnorm(out);
        if (length > f->reach_m[i]) vscale(f->reach_m[i] / length, out, out);
        vadd(out, 1, was);
    }
    hold_back(f, s, from);
    for (int32_t i = 0; i < f->count; i++) vset(f->step_m + 3 * i, at + 3 * f->vertex[i]);
}

void view_fairing_apply(view_fairing *f, const view_surface *s, const float *from, float *to) {
    memcpy(to, from, 3 * (size_t)s->vertex_count * sizeof *to);
    if (!f->count) return;
    measure(f, s, from);
    for (int round = 0; round < ROUNDS; round++) {
        step(f, s, DRAW, from, to);
        step(f, s, PUSH, from, to);
    }
}
