#include "inner_regions.h"

#include <stdlib.h>
#include <string.h>

void view_inside_free(view_inside *in) {
    free(in->rest_m);
    free(in->tet);
    free(in->tet_neighbour);
    free(in->face);
    free(in->side_of);
    free(in->kind);
    free(in->alive);
    free(in->blocked);
    free(in->flood);
    free(in->index);
    view_surface_free(&in->shown);
    memset(in, 0, sizeof *in);
}

/* --- from the mesh --- */

/* Returns whether this side of a face draws it: the side with the smaller region does. */
static bool draws(const tm_mesh *m, const double *volume_m3, int32_t face) {
    const int32_t tet = face / 4, other = m->tet_neighbour[face];
    if (other < 0 || m->region[other] == m->region[tet]) return false;
    const double mine = volume_m3[m->region[tet]], theirs = volume_m3[m->region[other]];
    return mine < theirs || (mine == theirs && tet < other);
}

static void read_faces(view_inside *in, const tm_mesh *m, const double *volume_m3) {
    for (int32_t f = 0; f < 4 * m->tet_count; f++) {
        if (!draws(m, volume_m3, f)) continue;
        for (int k = 0; k < 3; k++)
            in->face[3 * in->face_count + k] = m->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][k]];
        in->side_of[2 * in->face_count] = f / 4, in->side_of[2 * in->face_count + 1] = m->tet_neighbour[f];
        in->kind[in->face_count++] = view_kind_of(m->region[f / 4]);
    }
}

bool view_inside_take(view_inside *in, const tm_mesh *m) {
    double *volume_m3 = calloc((size_t)m->region_count + 1, sizeof *volume_m3);
    size_t faces = 0;
    memset(in, 0, sizeof *in);
    for (int32_t t = 0; t < m->tet_count && volume_m3; t++) volume_m3[m->region[t]] += m->volume_m3[t];
    for (int32_t f = 0; f < 4 * m->tet_count && volume_m3; f++) faces += draws(m, volume_m3, f);
    const size_t tets = (size_t)m->tet_count;
    in->vertex_count = m->vertex_count, in->tet_count = m->tet_count;
    in->rest_m = malloc(3 * (size_t)m->vertex_count * sizeof *in->rest_m);
    in->index = malloc((size_t)m->vertex_count * sizeof *in->index);
    in->face = malloc((3 * faces + 1) * sizeof *in->face);
    in->side_of = malloc((2 * faces + 1) * sizeof *in->side_of);
    in->kind = malloc(faces + 1);
    in->tet = malloc(4 * tets * sizeof *in->tet);
    in->tet_neighbour = malloc(4 * tets * sizeof *in->tet_neighbour);
    in->flood = malloc(tets * sizeof *in->flood);
    in->alive = malloc(tets);
    in->blocked = malloc(4 * tets);
    const bool good = volume_m3 && in->rest_m && in->index && in->face && in->side_of && in->kind && in->tet &&
                      in->tet_neighbour && in->flood && in->alive && in->blocked;
    for (int32_t i = 0; good && i < 3 * m->vertex_count; i++) in->rest_m[i] = (float)m->rest_m[i];
    if (good) {
        memcpy(in->tet, m->tet, 4 * tets * sizeof *in->tet);
        memcpy(in->tet_neighbour, m->tet_neighbour, 4 * tets * sizeof *in->tet_neighbour);
    }
    if (good) read_faces(in, m, volume_m3);
    free(volume_m3);
    if (!good) view_inside_free(in);
    return good;
}

/* --- with a message's surface --- */

static void seed(view_inside *in, int32_t tet, const int32_t corner[3], int32_t *waiting) {
    for (int i = 0; i < 4; i++) {
        const int32_t opposite = in->tet[4 * (int64_t)tet + i];
        if (opposite != corner[0] && opposite != corner[1] && opposite != corner[2])
            in->blocked[4 * (int64_t)tet + i] = 1;
    }
    if (!in->alive[tet]) in->alive[tet] = 1, in->flood[(*waiting)++] = tet;
}

/* Finds the tetrahedra within the message's triangles: a flood fill from adjacent tetrahedra through all faces that are
 * not such triangles. */
static void find_alive(view_inside *in, const view_surface *s, const view_marks *marks) {
    int32_t waiting = 0;
    memset(in->alive, 0, (size_t)in->tet_count);
    memset(in->blocked, 0, 4 * (size_t)in->tet_count);
    for (int32_t t = 0; t < s->triangle_count; t++) {
        int32_t id[3];
        for (int c = 0; c < 3; c++) id[c] = s->vertex_id[s->triangle[3 * t + c]];
        const int32_t tet = view_marks_tet(marks, id);
        if (tet >= 0) seed(in, tet, id, &waiting);
    }
    while (waiting) {
        const int64_t tet = in->flood[--waiting];
        for (int i = 0; i < 4; i++) {
            const int32_t next = in->tet_neighbour[4 * tet + i];
            if (next >= 0 && !in->blocked[4 * tet + i] && !in->alive[next])
                in->alive[next] = 1, in->flood[waiting++] = next;
        }
    }
}

/* Returns whether both sides of a face are active. With one active side the message has the face; with none it is
 * gone. */
static bool is_between(const view_inside *in, int32_t face) {
    return in->alive[in->side_of[2 * face]] && in->alive[in->side_of[2 * face + 1]];
}

/* Numbers the vertices: the message's first, then inner ones that it lacks. Returns their count. */
static int32_t number(view_inside *in, const view_surface *s) {
    for (int32_t v = 0; v < in->vertex_count; v++) in->index[v] = -1;
    for (int32_t i = 0; i < s->vertex_count; i++)
        if (s->vertex_id[i] < in->vertex_count) in->index[s->vertex_id[i]] = i;
    int32_t count = in->told = s->vertex_count;
    for (int32_t i = 0; i < 3 * in->face_count; i++)
        if (is_between(in, i / 3) && in->index[in->face[i]] < 0) in->index[in->face[i]] = count++;
    return count;
}

static void add(view_surface *out, const int32_t corner[3], uint8_t kind) {
    memcpy(out->triangle + 3 * out->triangle_count, corner, 3 * sizeof *corner);
    out->kind[out->triangle_count++] = kind;
}

static bool arrange(view_inside *in, const view_picture *p) {
    const view_surface *s = &p->surface;
    view_surface *out = &in->shown;
    find_alive(in, s, p->marks);
    const int32_t count = number(in, s);
    if (!view_surface_reserve(out, count, s->triangle_count + in->face_count)) return false;
    memcpy(out->vertex_id, s->vertex_id, (size_t)s->vertex_count * sizeof *out->vertex_id);
    out->vertex_count = count, out->triangle_count = 0;
    for (int32_t f = 0; f < in->face_count; f++) {
        int32_t corner[3];
        if (!is_between(in, f)) continue;
        for (int k = 0; k < 3; k++) {
            corner[k] = in->index[in->face[3 * f + k]];
            out->vertex_id[corner[k]] = in->face[3 * f + k];
        }
        add(out, corner, in->kind[f]);
    }
    out->between_count = out->triangle_count;
    for (int solid = 1; solid >= 0; solid--) {
        for (int32_t t = 0; t < s->triangle_count; t++) {
            const int region = s->kind[t] / 2;
            if ((region < p->regions && p->region[region].tinted) == solid) add(out, s->triangle + 3 * t, s->kind[t]);
        }
        if (solid) out->inside_count = out->triangle_count;
    }
    in->topology = s->topology;
    return true;
}

static void follow(const view_inside *in, const view_surface *s, const float rest_m[3], float at_m[3]) {
    double sum[3] = {0}, weights = 1e-300;
    for (int32_t i = 0; i < s->vertex_count; i++) {
        if (s->vertex_id[i] >= in->vertex_count) continue;
        const float *from = in->rest_m + 3 * (int64_t)s->vertex_id[i], *to = s->vertex_m + 3 * (int64_t)i;
        double square = 1e-12;
        for (int a = 0; a < 3; a++) square += (double)(from[a] - rest_m[a]) * (double)(from[a] - rest_m[a]);
        const double weight = 1 / (square * square);
        for (int a = 0; a < 3; a++) sum[a] += weight * (double)(to[a] - from[a]);
        weights += weight;
    }
    for (int a = 0; a < 3; a++) at_m[a] = rest_m[a] + (float)(sum[a] / weights);
}

bool view_inside_show(view_inside *in, const view_picture *p) {
    const view_surface *s = &p->surface;
    view_surface *out = &in->shown;
    if (in->topology != s->topology && !arrange(in, p)) return false;
    memcpy(out->vertex_m, s->vertex_m, 3 * (size_t)s->vertex_count * sizeof *out->vertex_m);
    for (int32_t v = in->told; v < out->vertex_count; v++)
        follow(in, s, in->rest_m + 3 * (int64_t)out->vertex_id[v], out->vertex_m + 3 * (int64_t)v);
    out->session = s->session, out->revision = s->revision;
    out->version = s->version, out->topology = s->topology;
    return true;
}
