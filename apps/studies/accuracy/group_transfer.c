/* Transfers supports by vertex number to other meshes of the same organ. Each becomes a group of vertices, which
 * tm-mesh refine keeps; on a new mesh it consists of the nearest vertices. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "mesh_file.h"
#include "study.h"

static const app_integers *numbers_of(const sim *own, int support) {
    const app_support *s = (const app_support *)own->scene->support.item + support;
    return s->select.vertex.line ? &s->select.vertex : NULL;
}

static void name_of(int support, char name[64]) { snprintf(name, 64, "support_%d", support); }

int study_carried(const sim *own) {
    int count = 0;
    for (int i = 0; i < own->scene->support.count; i++) count += numbers_of(own, i) != NULL;
    return count;
}

void study_set_carried(study_run *r, const sim *own) {
    char name[64];
    for (int i = 0; i < own->scene->support.count; i++) {
        if (!numbers_of(own, i)) continue;
        name_of(i, name);
        study_set(r, "supports[%d].vertex", i);
        study_set(r, "supports[%d].group=%s", i, name);
    }
}

/* Groups of the scene's file and of its supports, as marks [group][vertex]. Names of regions are not groups here; they
 * are written as regions. Null: memory exhausted. */
typedef struct groups {
    int count;
    char (*name)[64];
    unsigned char *mark;
} groups;

static bool is_region(const tm_mesh_file *file, const char *name) {
    for (int32_t r = 0; r < file->region_count; r++)
        if (!strcmp(file->region_name[r], name)) return true;
    return false;
}

static groups groups_of(const sim *own) {
    const tm_mesh_file *file = &own->file;
    const size_t vertices = (size_t)file->vertex_count, room = (size_t)(file->group_count + own->scene->support.count);
    groups g = {.name = calloc(room + 1, sizeof *g.name), .mark = calloc(room + 1, vertices)};
    if (!g.name || !g.mark) abort();
    for (int32_t i = 0; i < file->group_count; i++) {
        if (is_region(file, file->group_name[i])) continue;
        memcpy(g.name[g.count], file->group_name[i], sizeof *g.name);
        for (int32_t k = file->group_begin[i]; k < file->group_begin[i + 1]; k++)
            g.mark[(size_t)g.count * vertices + (size_t)file->group_vertex[k]] = 1;
        g.count++;
    }
    for (int i = 0; i < own->scene->support.count; i++) {
        const app_integers *vertex = numbers_of(own, i);
        if (!vertex) continue;
        name_of(i, g.name[g.count]);
        for (int k = 0; k < vertex->count; k++) g.mark[(size_t)g.count * vertices + (size_t)vertex->item[k]] = 1;
        g.count++;
    }
    return g;
}

static void free_groups(groups *g) {
    free(g->name);
    free(g->mark);
}

/* Assigns groups to `out`, which has its own vertices and tetrahedra; `from` [vertex_count] is the vertex whose groups
 * each one takes, -1: none. Returns false if a group is empty. */
static bool put_groups(const sim *own, const groups *g, const int32_t *from, tm_mesh_file *out) {
    const size_t vertices = (size_t)own->file.vertex_count;
    int32_t n = 0;
    memcpy(out->region_name, own->file.region_name, (size_t)out->region_count * sizeof *out->region_name);
    for (int i = 0; i < g->count; i++) {
        const int32_t begin = n;
        memcpy(out->group_name[i], g->name[i], sizeof *g->name);
        for (int32_t v = 0; v < out->vertex_count; v++)
            if (from[v] >= 0 && g->mark[(size_t)i * vertices + (size_t)from[v]]) out->group_vertex[n++] = v;
        out->group_begin[i + 1] = n;
        if (n == begin) return false;
    }
    return true;
}

static bool like(const sim *own, const groups *g, int32_t vertices, int32_t tets, tm_mesh_file *out) {
    *out = (tm_mesh_file){
        .vertex_count = vertices, .tet_count = tets, .region_count = own->file.region_count, .group_count = g->count};
    if ((int64_t)g->count * vertices > INT32_MAX || !tm_mesh_file_allocate(out, g->count * vertices)) return false;
    for (int32_t v = 0; v < vertices; v++) out->vertex_tag[v] = v + 1;
    for (int32_t t = 0; t < tets; t++) out->tet_tag[t] = t + 1;
    return true;
}

bool study_write_carried(const sim *own, const char *path) {
    const tm_mesh_file *file = &own->file;
    tm_mesh_file out;
    tm_error error = {0};
    groups g = groups_of(own);
    int32_t *self = app_zeroed((size_t)file->vertex_count, sizeof *self);
    for (int32_t v = 0; v < file->vertex_count; v++) self[v] = v;
    bool good = like(own, &g, file->vertex_count, file->tet_count, &out);
    if (good) {
        memcpy(out.vertex_m, file->vertex_m, 3 * (size_t)file->vertex_count * sizeof *out.vertex_m);
        memcpy(out.tet, file->tet, 4 * (size_t)file->tet_count * sizeof *out.tet);
        memcpy(out.region, file->region, (size_t)file->tet_count * sizeof *out.region);
        good = put_groups(own, &g, self, &out) && !app_mesh_write(&out, path, &error);
        tm_mesh_file_free(&out);
    }
    free(self);
    free_groups(&g);
    return good;
}

/* --- a new mesh --- */

/* Returns the nearest of `count` points by linear search: organs have ten thousand. `among` null: all. */
static int32_t nearest(const double *point, int32_t count, const unsigned char *among, const double p[3]) {
    int32_t best = -1;
    double least = INFINITY;
    for (int32_t i = 0; i < count; i++) {
        const double *q = point + 3 * (size_t)i, x = q[0] - p[0], y = q[1] - p[1], z = q[2] - p[2],
                     d = x * x + y * y + z * z;
        if (d < least && (!among || among[i])) least = d, best = i;
    }
    return best;
}

static double *centres(const double *vertex, const int32_t *tet, int32_t count) {
    double *out = app_zeroed(3 * (size_t)count, sizeof *out);
    for (int32_t i = 0; i < 12 * count; i++) /* tetrahedron, corner, axis */
        out[3 * (i / 12) + i % 3] += 0.25 * vertex[3 * (size_t)tet[i / 3] + (size_t)(i % 3)];
    return out;
}

static unsigned char *outer(const tm_mesh *mesh) {
    unsigned char *out = app_zeroed((size_t)mesh->vertex_count, 1);
    for (int32_t i = 0; i < 3 * mesh->surface_count; i++) out[mesh->surface[i]] = 1;
    return out;
}

/* Finds, for each vertex of `mesh`, the vertex of the scene's file whose groups it takes. Surface vertices take groups
 * of surface vertices. */
static int32_t *partners(const sim *own, const tm_mesh *mesh) {
    int32_t *from = app_zeroed((size_t)mesh->vertex_count, sizeof *from);
    unsigned char *old_outer = outer(own->mesh), *new_outer = outer(mesh);
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        from[v] = nearest(own->mesh->rest_m, own->mesh->vertex_count, new_outer[v] ? old_outer : NULL,
                          mesh->rest_m + 3 * (size_t)v);
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        from[v] = !new_outer[v] && old_outer[from[v]] ? -1 : tm_mesh_original_vertex(own->mesh, from[v]);
    free(old_outer);
    free(new_outer);
    return from;
}

static bool every_region_is_there(const tm_mesh_file *file) {
    for (int32_t r = 0; r < file->region_count; r++) {
        int32_t t = 0;
        while (t < file->tet_count && file->region[t] != r) t++;
        if (t == file->tet_count) return false;
    }
    return true;
}

bool study_transfer(const sim *own, const tm_mesh *mesh, const char *path, double *fibre) {
    tm_mesh_file out;
    tm_error error = {0};
    groups g = groups_of(own);
    int32_t *from = partners(own, mesh);
    double *old = centres(own->mesh->rest_m, own->mesh->tet, own->mesh->tet_count),
           *new = centres(mesh->rest_m, mesh->tet, mesh->tet_count);
    bool good = like(own, &g, mesh->vertex_count, mesh->tet_count, &out);
    if (good) {
        memcpy(out.vertex_m, mesh->rest_m, 3 * (size_t)mesh->vertex_count * sizeof *out.vertex_m);
        memcpy(out.tet, mesh->tet, 4 * (size_t)mesh->tet_count * sizeof *out.tet);
        for (int32_t t = 0; t < mesh->tet_count; t++) {
            const int32_t in = nearest(old, own->mesh->tet_count, NULL, new + 3 * (size_t)t);
            out.region[t] = own->file.region[in];
            if (own->fibre) memcpy(fibre + 3 * (size_t)t, own->fibre + 3 * (size_t)in, 3 * sizeof *fibre);
        }
        good = put_groups(own, &g, from, &out) && every_region_is_there(&out) && !app_mesh_write(&out, path, &error);
        tm_mesh_file_free(&out);
    }
    free(from);
    free(old);
    free(new);
    free_groups(&g);
    return good;
}
