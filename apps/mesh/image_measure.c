/* Compares each label in the mesh with its voxels. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "libtensormass/numeric/union_find.h"
#include "mesh_builder.h"
#include "signed_distance.h"

typedef struct side {
    int v[3], at; /* v ascending; at = 4*tet + opposite corner */
} side;

static int by_corners(const void *a, const void *b) {
    const side *x = a, *y = b;
    for (int k = 0; k < 3; k++)
        if (x->v[k] != y->v[k]) return x->v[k] < y->v[k] ? -1 : 1;
    return (x->at > y->at) - (x->at < y->at);
}

static side side_of(const int *tet, int at) {
    side s = {{0}, at};
    for (int k = 0, n = 0; k < 4; k++)
        if (k != at % 4) s.v[n++] = tet[k];
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2 - i; k++)
            if (s.v[k] > s.v[k + 1]) {
                const int spare = s.v[k];
                s.v[k] = s.v[k + 1];
                s.v[k + 1] = spare;
            }
    return s;
}

/* Returns all faces of one label's tetrahedra (0: of all), sorted. */
static side *sides_of(const image_tets *m, int label, int *count) {
    side *all = malloc((4 * (size_t)m->tets + 1) * sizeof *all);
    *count = 0;
    for (int t = 0; all && t < m->tets; t++)
        for (int k = 0; (!label || m->label[t] == label) && k < 4; k++)
            all[(*count)++] = side_of(m->tet + 4 * (size_t)t, 4 * t + k);
    if (all) qsort(all, (size_t)*count, sizeof *all, by_corners);
    return all;
}

static bool same_face(const side *a, const side *b) { return memcmp(a->v, b->v, sizeof a->v) == 0; }

int image_faces(const image_tets *m, int label, int **face) {
    int count, faces = 0;
    side *all = sides_of(m, label, &count);
    *face = malloc((3 * (size_t)count + 1) * sizeof **face);
    if (!all || !*face) {
        free(all);
        return -1;
    }
    for (int i = 0; i < count; i++) {
        if (i + 1 < count && same_face(&all[i], &all[i + 1])) {
            i++;
            continue;
        }
        const int *tet = m->tet + 4 * (size_t)(all[i].at / 4);
        for (int k = 0; k < 3; k++) (*face)[3 * faces + k] = tet[tm_face_vertex[all[i].at % 4][k]];
        faces++;
    }
    free(all);
    return faces;
}

int image_interfaces(const image_tets *m, int labels, int **face) {
    int total = 0;
    *face = malloc((12 * (size_t)m->tets + 1) * sizeof **face);
    for (int l = 1; l <= labels && *face; l++) {
        int *one = NULL;
        const int faces = image_faces(m, l, &one);
        if (faces < 0) return -1;
        memcpy(*face + 3 * (size_t)total, one, 3 * (size_t)faces * sizeof **face);
        total += faces;
        free(one);
    }
    return *face ? total : -1;
}

static double triangle_m2(const double *a, const double *b, const double *c) {
    double u[3], w[3], n[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], w[k] = c[k] - a[k];
    for (int k = 0; k < 3; k++) n[k] = u[(k + 1) % 3] * w[(k + 2) % 3] - u[(k + 2) % 3] * w[(k + 1) % 3];
    return 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

static double tet_m3(const image_tets *m, int t) {
    const int *v = m->tet + 4 * (size_t)t;
    const double *p[4];
    for (int k = 0; k < 4; k++) p[k] = m->vertex_m + 3 * (size_t)v[k];
    double e[3][3];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) e[k][i] = p[k + 1][i] - p[0][i];
    return (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
           6;
}

/* Connects tetrahedra through faces, within a label or across labels; parent[t] is their union-find tree. */
static bool join_tets(const image_tets *m, bool across, int32_t *parent) {
    int count;
    side *all = sides_of(m, 0, &count);
    for (int t = 0; t < m->tets; t++) parent[t] = t;
    for (int i = 0; all && i + 1 < count; i++) {
        const int a = all[i].at / 4, b = all[i + 1].at / 4;
        if (same_face(&all[i], &all[i + 1]) && (across || m->label[a] == m->label[b])) law_join(parent, a, b);
    }
    free(all);
    return all != NULL;
}

/* Counts the pieces of each label, connected through faces, and the volume of the largest. */
static bool count_pieces(image_mesh *mesh) {
    const image_tets *m = &mesh->tets;
    int32_t *parent = malloc(((size_t)m->tets + 1) * sizeof *parent);
    double *volume_m3 = calloc((size_t)m->tets + 1, sizeof *volume_m3);
    const bool good = parent && volume_m3 && join_tets(m, false, parent);
    for (int t = 0; t < m->tets && good; t++) volume_m3[law_root(parent, t)] += tet_m3(m, t);
    for (int t = 0; t < m->tets && good; t++) {
        if (parent[t] != t) continue;
        image_result *of = &mesh->of[m->label[t]];
        of->pieces++;
        of->largest_m3 = fmax(of->largest_m3, volume_m3[t]);
    }
    free(parent);
    free(volume_m3);
    return good;
}

/* --- loose parts --- */

const double image_loose_share = 0.01;

/* Keeps the selected tetrahedra, in order, and the vertices that they use. */
static bool keep_tets(image_tets *m, const uint8_t *stays) {
    int *number = malloc(((size_t)m->vertices + 1) * sizeof *number), tets = 0, vertices = 0;
    if (!number) return false;
    for (int v = 0; v < m->vertices; v++) number[v] = -1;
    for (int t = 0; t < m->tets; t++)
        for (int k = 0; stays[t] && k < 4; k++) number[m->tet[4 * (size_t)t + k]] = 0;
    for (int v = 0; v < m->vertices; v++) {
        if (number[v] < 0) continue;
        memmove(m->vertex_m + 3 * (size_t)vertices, m->vertex_m + 3 * (size_t)v, 3 * sizeof *m->vertex_m);
        number[v] = vertices++;
    }
    for (int t = 0; t < m->tets; t++) {
        if (!stays[t]) continue;
        for (int k = 0; k < 4; k++) m->tet[4 * (size_t)tets + k] = number[m->tet[4 * (size_t)t + k]];
        m->label[tets++] = m->label[t];
    }
    m->tets = tets;
    m->vertices = vertices;
    free(number);
    return true;
}

bool image_drop_loose(const label_field *field, image_mesh *mesh) {
    image_tets *m = &mesh->tets;
    const size_t room = (size_t)m->tets + 1;
    int32_t *parent = malloc(room * sizeof *parent);
    double *volume_m3 = calloc(room, sizeof *volume_m3), all_m3 = 0;
    uint8_t *stays = malloc(room), *whole = calloc(room, 1); /* whole: contains a label without additional pieces */
    bool good = parent && volume_m3 && stays && whole && join_tets(m, true, parent);
    for (int t = 0; t < m->tets && good; t++) {
        const int32_t root = law_root(parent, t);
        const double one_m3 = tet_m3(m, t);
        volume_m3[root] += one_m3;
        all_m3 += one_m3;
        whole[root] |= mesh->of[m->label[t]].pieces <= field->pieces[m->label[t]];
    }
    for (int t = 0; t < m->tets && good; t++) {
        const int32_t root = law_root(parent, t);
        stays[t] = whole[root] || volume_m3[root] >= image_loose_share * all_m3;
        if (stays[t] || root != t) continue;
        mesh->loose++;
        mesh->loose_m3 += volume_m3[t];
    }
    if (good && mesh->loose) good = keep_tets(m, stays);
    free(parent);
    free(volume_m3);
    free(stays);
    free(whole);
    return good;
}

bool image_measure(const label_field *field, image_mesh *mesh) {
    const image_tets *m = &mesh->tets;
    const double voxel_m3 = field->spacing_m[0] * field->spacing_m[1] * field->spacing_m[2];
    memset(mesh->of, 0, sizeof mesh->of);
    for (int t = 0; t < m->tets; t++) {
        mesh->of[m->label[t]].volume_m3 += tet_m3(m, t);
        mesh->of[0].volume_m3 += tet_m3(m, t);
        mesh->of[m->label[t]].tets++;
    }
    for (int l = 1; l <= field->labels; l++) {
        int *face = NULL;
        const int faces = image_faces(m, l, &face);
        for (int f = 0; f < faces; f++)
            mesh->of[l].area_m2 +=
                triangle_m2(m->vertex_m + 3 * (size_t)face[3 * f], m->vertex_m + 3 * (size_t)face[3 * f + 1],
                            m->vertex_m + 3 * (size_t)face[3 * f + 2]);
        free(face);
        if (faces < 0) return false;
        mesh->of[l].image_m3 = (double)field->voxels[l] * voxel_m3;
    }
    return count_pieces(mesh);
}

/* --- distances --- */

typedef struct soup {
    double *corner; /* [9*count] */
    int count, capacity;
    bool no_memory;
} soup;

static void add_triangle(soup *s, const double *a, const double *b, const double *c) {
    if (s->count == s->capacity) {
        s->capacity = s->capacity ? 2 * s->capacity : 1024;
        double *grown = realloc(s->corner, 9 * (size_t)s->capacity * sizeof *grown);
        s->no_memory = s->no_memory || !grown;
        if (grown) s->corner = grown;
    }
    if (s->no_memory) return;
    double *to = s->corner + 9 * (size_t)s->count++;
    memcpy(to, a, 3 * sizeof *to);
    memcpy(to + 3, b, 3 * sizeof *to);
    memcpy(to + 6, c, 3 * sizeof *to);
}

/* Makes two triangles of each face between a voxel of the label and another. */
static void voxel_faces(const label_field *f, int label, soup *out) {
    const int64_t step[3] = {1, f->size[0], (int64_t)f->size[0] * f->size[1]};
    int64_t i = 0;
    for (int z = 0; z < f->size[2]; z++)
        for (int y = 0; y < f->size[1]; y++)
            for (int x = 0; x < f->size[0]; x++, i++)
                for (int n = 0; f->at[i] == label && n < 6; n++) {
                    const int axis = n / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
                    if (f->at[i + (n & 1 ? step[axis] : -step[axis])] == label) continue;
                    const int at[3] = {x + f->begin[0], y + f->begin[1], z + f->begin[2]};
                    double p[4][3];
                    for (int c = 0; c < 4; c++) {
                        p[c][axis] = (at[axis] + (n & 1 ? 0.5 : -0.5)) * f->spacing_m[axis];
                        p[c][u] = (at[u] + (c == 1 || c == 2 ? 0.5 : -0.5)) * f->spacing_m[u];
                        p[c][v] = (at[v] + (c >= 2 ? 0.5 : -0.5)) * f->spacing_m[v];
                    }
                    add_triangle(out, p[0], p[1], p[2]);
                    add_triangle(out, p[0], p[2], p[3]);
                }
}

static void mesh_faces(const image_tets *m, int label, soup *out) {
    int *face = NULL;
    const int faces = image_faces(m, label, &face);
    out->no_memory = out->no_memory || faces < 0;
    for (int f = 0; f < faces; f++)
        add_triangle(out, m->vertex_m + 3 * (size_t)face[3 * f], m->vertex_m + 3 * (size_t)face[3 * f + 1],
                     m->vertex_m + 3 * (size_t)face[3 * f + 2]);
    free(face);
}

/* Measures distances to a surface at the centres of at most 20,000 triangles, evenly sampled. */
static void farthest(const soup *from, const shell *to, double *most, double *sum, int *count) {
    const int step = 1 + from->count / 20000;
    for (int t = 0; t < from->count; t += step) {
        const double *c = from->corner + 9 * (size_t)t;
        const double middle[3] = {(c[0] + c[3] + c[6]) / 3, (c[1] + c[4] + c[7]) / 3, (c[2] + c[5] + c[8]) / 3};
        const double d = shell_distance_m(to, middle);
        if (d > *most) *most = d;
        *sum += d;
        ++*count;
    }
}

static soup copy_of(const soup *s) {
    soup out = {malloc((9 * (size_t)s->count + 1) * sizeof *out.corner), s->count, s->count, false};
    if (out.corner) memcpy(out.corner, s->corner, 9 * (size_t)s->count * sizeof *out.corner);
    out.no_memory = !out.corner;
    return out;
}

static tm_status distance_of_label(const label_field *field, int label, image_mesh *mesh, tm_error *error) {
    soup voxels = {0}, tets = {0};
    shell *of_voxels = NULL, *of_tets = NULL;
    double sum = 0;
    int count = 0;
    voxel_faces(field, label, &voxels);
    mesh_faces(&mesh->tets, label, &tets);
    soup voxels_too = copy_of(&voxels), tets_too = copy_of(&tets);
    tm_status status = TM_OK;
    if (voxels.no_memory || tets.no_memory || voxels_too.no_memory || tets_too.no_memory) {
        free(voxels_too.corner);
        free(tets_too.corner);
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surfaces; choose a larger --size");
    } else {
        status = shell_of_triangles(voxels_too.corner, voxels.count, false, &of_voxels, error);
        if (status) free(tets_too.corner);
    }
    if (!status) status = shell_of_triangles(tets_too.corner, tets.count, false, &of_tets, error);
    if (!status) {
        farthest(&tets, of_voxels, &mesh->of[label].hausdorff_m, &sum, &count);
        farthest(&voxels, of_tets, &mesh->of[label].hausdorff_m, &sum, &count);
        mesh->of[label].mean_m = sum / count;
    }
    shell_free(of_voxels);
    shell_free(of_tets);
    free(voxels.corner);
    free(tets.corner);
    return status;
}

tm_status image_distances(const label_field *field, image_mesh *mesh, tm_error *error) {
    tm_status status = TM_OK;
    for (int l = 1; l <= field->labels && !status; l++)
        if (mesh->of[l].tets > 0) status = distance_of_label(field, l, mesh, error);
    return status;
}
