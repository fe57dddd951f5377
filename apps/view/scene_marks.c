/* Reads the marks of an open scene: title, supports, fibres, regions, faces. */
#include "scene_decoration.h"

#include "picture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void view_marks_free(view_marks *m) {
    free(m->support_of);
    free(m->rest_m);
    free(m->fibre);
    free(m->region);
    free(m->face);
    memset(m, 0, sizeof *m);
}

static int by_vertices(const void *a, const void *b) {
    const int32_t *x = a, *y = b;
    for (int k = 0; k < 3; k++)
        if (x[k] != y[k]) return x[k] < y[k] ? -1 : 1;
    return (x[3] > y[3]) - (x[3] < y[3]);
}

static void fill_faces(const tm_mesh *mesh, int32_t *face) {
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++, face += 4) {
        int32_t swaps = 0;
        for (int n = 0; n < 3; n++) {
            const int32_t v = mesh->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][n]];
            int at = n;
            for (; at > 0 && face[at - 1] > v; at--, swaps++) face[at] = face[at - 1];
            face[at] = v;
        }
        face[3] = f / 4 * 2 + (swaps & 1);
    }
}

static void names(const app_scene *scene, char *out, size_t size) {
    size_t used = 0;
    for (int i = 0; i < scene->support.count && used < size; i++) {
        const char *name = ((const app_support *)scene->support.item)[i].name.s;
        if (*name) used += (size_t)snprintf(out + used, size - used, "%s%s", used ? ", " : "", name);
    }
}

bool view_marks_take(view_marks *m, const sim *s, bool supports, bool fibres) {
    const tm_mesh *mesh = s->mesh;
    size_t vertices = (size_t)mesh->vertex_count, tets = (size_t)mesh->tet_count;
    memset(m, 0, sizeof *m);
    snprintf(m->title, sizeof m->title, "%s", s->scene->title.s);
    names(s->scene, m->held_by, sizeof m->held_by);
    m->vertex_count = mesh->vertex_count, m->tet_count = mesh->tet_count;
    bool good = true;
    if (supports && s->scene->support.count && s->support_of) {
        good = (m->support_of = malloc(vertices)) != NULL;
        if (good) memcpy(m->support_of, s->support_of, vertices);
    }
    const bool lines = fibres && s->fibre, regions = s->file.region_count > 1;
    if ((lines || regions) && good) {
        m->face = malloc(16 * tets * sizeof *m->face);
        good = m->face;
        if (good) {
            fill_faces(mesh, m->face);
            qsort(m->face, 4 * tets, 4 * sizeof *m->face, by_vertices);
        }
    }
    if (regions && good) {
        good = (m->region = malloc(tets)) != NULL;
        for (size_t t = 0; good && t < tets; t++)
            m->region[t] = (uint8_t)(mesh->region[t] < VIEW_REGIONS ? mesh->region[t] : 0);
    }
    if (lines && good) {
        m->rest_m = malloc(3 * vertices * sizeof *m->rest_m);
        m->fibre = malloc(3 * tets * sizeof *m->fibre);
        good = m->rest_m && m->fibre;
        for (size_t i = 0; good && i < 3 * vertices; i++) m->rest_m[i] = (float)mesh->rest_m[i];
        for (size_t i = 0; good && i < 3 * tets; i++) m->fibre[i] = (float)s->fibre[i];
    }
    if (!good) view_marks_free(m);
    return good;
}
