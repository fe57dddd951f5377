/* Moves the vertices of an image's mesh to enlarge the smallest tetrahedron, and keeps its surfaces in place. */
#include <stdlib.h>

#include "image.h"
#include "mesh_builder.h"

static const double TURNED_MIN = 0.7; /* cosine */

static bool none_wanted(const growing *m, int tet, double longest_m, const void *context) {
    (void)m, (void)tet, (void)longest_m, (void)context;
    return false;
}

/* Labels that meet at a vertex: their number, 3 for more, and the first two; 0 is outside. */
typedef struct sides {
    uint8_t count, label[2];
} sides;

typedef struct meeting {
    const growing *mesh; /* its faces are those between labels */
    sides *at;           /* [vertices] */
    int *begin, *face;   /* faces around vertex v: face[begin[v]] to before begin[v + 1] */
    double *normal;      /* [3*faces] unit, at the start */
    image_between_fn *between;
    const void *shape;
} meeting;

static void enter(sides *at, uint8_t label) {
    for (int i = 0; i < at->count && i < 2; i++)
        if (at->label[i] == label) return;
    if (at->count < 2) at->label[at->count] = label;
    if (at->count < 3) at->count++;
}

/* Records every tetrahedron's label at its vertices, and 0 at those of outer faces. Returns false if memory is
 * exhausted. */
static bool enter_all(const image_tets *m, sides *at) {
    int *face = NULL;
    const int faces = image_faces(m, 0, &face);
    for (int i = 0; i < 3 * faces; i++) enter(&at[face[i]], 0);
    for (int i = 0; i < 4 * m->tets && faces >= 0; i++) enter(&at[m->tet[i]], (uint8_t)m->label[i / 4]);
    for (int v = 0; v < m->vertices; v++)
        if (at[v].count == 2 && at[v].label[0] > at[v].label[1]) at[v] = (sides){2, {at[v].label[1], at[v].label[0]}};
    free(face);
    return faces >= 0;
}

/* Moves a vertex onto its surface; returns false if a face around it rotated far. A vertex that slides round a thin
 * label's edge leaves a spike. */
static bool settle(const void *context, int v, double p[3]) {
    const meeting *of = context;
    if (of->at[v].count < 2) return true;
    if (!of->between(of->shape, of->at[v].label[0], of->at[v].label[1], p)) return false;
    for (int i = of->begin[v]; i < of->begin[v + 1]; i++) {
        const int *c = of->mesh->face + 3 * (size_t)of->face[i];
        const double *was = of->normal + 3 * (size_t)of->face[i];
        double n[3];
        growing_face_normal(of->mesh, c, n);
        if (n[0] * was[0] + n[1] * was[1] + n[2] * was[2] < TURNED_MIN) return false;
    }
    return true;
}

static bool make_meeting(const image_tets *m, int labels, growing *g, meeting *of) {
    of->mesh = g;
    of->at = calloc((size_t)m->vertices + 1, sizeof *of->at);
    bool good = of->at && (g->face_count = image_interfaces(m, labels, &g->face)) >= 0;
    of->begin = calloc((size_t)m->vertices + 2, sizeof *of->begin);
    of->face = malloc((3 * (size_t)g->face_count + 1) * sizeof *of->face);
    of->normal = malloc((3 * (size_t)g->face_count + 1) * sizeof *of->normal);
    good = good && of->begin && of->face && of->normal;
    if (!good || !enter_all(m, of->at)) return false;
    for (int i = 0; i < 3 * g->face_count; i++) of->begin[g->face[i] + 2]++;
    for (int v = 0; v < m->vertices; v++) of->begin[v + 2] += of->begin[v + 1];
    for (int i = 0; i < 3 * g->face_count; i++) of->face[of->begin[g->face[i] + 1]++] = i / 3;
    for (int f = 0; f < g->face_count; f++) growing_face_normal(g, g->face + 3 * (size_t)f, of->normal + 3 * (size_t)f);
    return true;
}

/* Enlarges the smallest tetrahedron, which sets the time step. Vertices move freely within a label, along the surface
 * between two labels, and not at all where three meet. */
bool image_improve(image_tets *m, int labels, image_between_fn *between, const void *shape) {
    growing g = {.vertex_count = m->vertices, .tet_count = m->tets, .vertex = m->vertex_m, .tet = m->tet};
    meeting of = {.between = between, .shape = shape};
    growing_hold hold = {.freedom = malloc((size_t)m->vertices + 1),
                         .direction = calloc(3 * (size_t)m->vertices + 1, sizeof(double)),
                         .wanted = none_wanted,
                         .settle = settle,
                         .shape = &of};
    const bool good = make_meeting(m, labels, &g, &of) && hold.freedom && hold.direction;
    for (int v = 0; v < m->vertices && good; v++) hold.freedom[v] = of.at[v].count > 2 ? FIXED : FREE;
    if (good) growing_improve(&g, NULL, &hold, 12);
    free(hold.freedom);
    free(hold.direction);
    free(g.face);
    free(of.at);
    free(of.begin);
    free(of.face);
    free(of.normal);
    return good && !g.no_memory;
}
