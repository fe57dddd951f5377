/* Proposes supports of an organ from its labels and its shape. */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "organ.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

static organ_support *add(organ *o, support_kind kind, const char *name) {
    if (o->supports == SUPPORTS_MAX) return NULL;
    organ_support *s = &o->support[o->supports++];
    *s = (organ_support){.kind = kind, .name = name};
    return s;
}

static int32_t group_size(const organ *o, const char *name) {
    for (int32_t g = 0; g < o->file.group_count; g++)
        if (strcmp(o->file.group_name[g], name) == 0) return o->file.group_begin[g + 1] - o->file.group_begin[g];
    return 0;
}

/* Fixes the vertices of a region on the organ's outer surface: where a vessel enters. */
static bool hold_at_surface(organ *o, int32_t region) {
    const tm_mesh *m = o->mesh;
    uint8_t *mark = calloc((size_t)m->vertex_count, 1);
    if (!mark) return false;
    int32_t count = 0;
    for (int32_t f = 0; f < m->surface_count; f++)
        for (int k = 0; k < 3 && m->region[m->surface_face[f] / 4] == region; k++) {
            count += !mark[m->surface[3 * f + k]];
            mark[m->surface[3 * f + k]] = 1;
        }
    organ_support *s = count ? add(o, SUPPORT_VERTICES, o->file.region_name[region]) : NULL;
    if (s) s->vertex = malloc(sizeof *s->vertex * (size_t)count);
    for (int32_t v = 0; v < m->vertex_count && s && s->vertex; v++)
        if (mark[v]) s->vertex[s->count++] = v;
    free(mark);
    return !s || s->vertex;
}

static bool is_region(const organ *o, const char *name) {
    for (int32_t r = 0; r < o->file.region_count; r++)
        if (strcmp(o->file.region_name[r], name) == 0) return true;
    return false;
}

/* Returns whether a surface group has the name of a support. */
static bool names_a_hold(const char *name) {
    static const char *const words[] = {"cava", "ligament", "fixed", "support", "held", "attach", "hilum", "hilus"};
    char lower[64] = "";
    for (size_t i = 0; name[i] && i < sizeof lower - 1; i++) lower[i] = (char)tolower((unsigned char)name[i]);
    for (size_t w = 0; w < sizeof words / sizeof *words; w++)
        if (strstr(lower, words[w])) return true;
    return false;
}

/* Returns the surface area in the plane of one of its triangles; also computes that normal and the total area. */
static double area_in_plane(const tm_mesh *m, const double point[3], const double normal[3], double within_m) {
    double area = 0;
    for (int32_t f = 0; f < m->surface_count; f++) {
        double e[3], g[3], n[3], d[3];
        const double *a = m->rest_m + 3 * m->surface[3 * f], *b = m->rest_m + 3 * m->surface[3 * f + 1],
                     *c = m->rest_m + 3 * m->surface[3 * f + 2];
        vsub(b, a, e), vsub(c, a, g), vsub(a, point, d);
        vcross(e, g, n);
        if (vdot(n, normal) > 0.998 * vnorm(n) && fabs(vdot(d, normal)) < within_m) area += 0.5 * vnorm(n);
    }
    return area;
}

/* Finds the largest flat area that does not face up and is a sufficient share of the surface. */
static void find_plane(organ *o) {
    enum { TRIED = 300 };
    const tm_mesh *m = o->mesh;
    const double within_m = 2e-3 * o->size_m;
    organ_support best = {.kind = SUPPORT_PLANE, .name = "flat side", .within_m = within_m};
    double whole = 0, best_score = 0;
    for (int32_t f = 0; f < m->surface_count; f++) {
        double e[3], g[3], n[3];
        const double *a = m->rest_m + 3 * m->surface[3 * f];
        vsub(m->rest_m + 3 * m->surface[3 * f + 1], a, e), vsub(m->rest_m + 3 * m->surface[3 * f + 2], a, g);
        vcross(e, g, n);
        whole += 0.5 * vnorm(n);
        if (f % (m->surface_count / TRIED + 1)) continue;
        for (int k = 0; k < 3; k++) n[k] /= fmax(vnorm(n), 1e-300);
        const double looks_up = vdot(n, o->up);
        if (looks_up > 0.3) continue;
        const double area = area_in_plane(m, a, n, within_m), score = area * (1.2 - looks_up);
        if (score <= best_score) continue;
        best_score = score, best.share = area;
        memcpy(best.point_m, a, sizeof best.point_m);
        memcpy(best.normal, n, sizeof best.normal);
    }
    best.share /= whole;
    organ_support *s = best.share > 0.04 ? add(o, SUPPORT_PLANE, "flat side") : NULL;
    if (s) *s = best;
}

/* Finds the lowest part: a slice of the box, from 1/12 of the height upwards, until enough vertices are in it. */
static void find_bottom(organ *o) {
    const tm_mesh *m = o->mesh;
    const int a = o->up_axis;
    const double height = o->high_m[a] - o->low_m[a], margin = 1e-3 + 0.01 * o->size_m;
    int32_t inside = 0;
    double part = 1.0 / 12;
    for (; part < 0.4; part *= 1.3) {
        inside = 0;
        for (int32_t v = 0; v < m->vertex_count; v++) {
            const double x = m->rest_m[3 * v + a];
            inside += o->up[a] > 0 ? x < o->low_m[a] + part * height : x > o->high_m[a] - part * height;
        }
        if (inside >= 12 && inside >= m->vertex_count / 50) break;
    }
    organ_support *s = add(o, SUPPORT_BOX, "underside");
    if (!s) return;
    s->count = inside;
    for (int k = 0; k < 3; k++) s->low_m[k] = o->low_m[k] - margin, s->high_m[k] = o->high_m[k] + margin;
    if (o->up[a] > 0)
        s->high_m[a] = o->low_m[a] + part * height;
    else
        s->low_m[a] = o->high_m[a] - part * height;
}

bool organ_find_supports(organ *o) {
    for (int32_t r = 0; r < o->file.region_count; r++) {
        const char *name = o->file.region_name[r];
        organ_support *s = NULL;
        if (o->tissue[r]->role == TISSUE_BONE && group_size(o, name)) s = add(o, SUPPORT_GROUP, name);
        if (s) s->count = group_size(o, name);
        if (o->tissue[r]->role == TISSUE_VESSEL && !hold_at_surface(o, r)) return false;
    }
    for (int32_t g = 0; g < o->file.group_count; g++) {
        if (is_region(o, o->file.group_name[g]) || !names_a_hold(o->file.group_name[g])) continue;
        organ_support *s = add(o, SUPPORT_GROUP, o->file.group_name[g]);
        if (s) s->count = group_size(o, s->name);
    }
    if (!o->supports) find_plane(o);
    if (!o->supports) find_bottom(o);
    return true;
}

bool organ_holds(const organ_support *s, const double x[3]) {
    double d[3];
    vsub(x, s->point_m, d);
    if (s->kind == SUPPORT_PLANE) return fabs(vdot(d, s->normal)) <= s->within_m;
    for (int a = 0; a < 3; a++)
        if (x[a] < s->low_m[a] || x[a] > s->high_m[a]) return false;
    return true;
}

void organ_mark_held(const organ *o, uint8_t *mark) {
    for (int i = 0; i < o->supports; i++) {
        const organ_support *s = &o->support[i];
        for (int32_t k = 0; k < s->count && s->kind == SUPPORT_VERTICES; k++) mark[s->vertex[k]] = 1;
        for (int32_t g = 0; g < o->file.group_count && s->kind == SUPPORT_GROUP; g++)
            for (int32_t k = o->file.group_begin[g]; k < o->file.group_begin[g + 1]; k++)
                if (strcmp(o->file.group_name[g], s->name) == 0) mark[o->file.group_vertex[k]] = 1;
        for (int32_t v = 0; v < o->mesh->vertex_count; v++)
            if ((s->kind == SUPPORT_PLANE || s->kind == SUPPORT_BOX) && organ_holds(s, o->mesh->rest_m + 3 * v))
                mark[v] = 1;
    }
}
