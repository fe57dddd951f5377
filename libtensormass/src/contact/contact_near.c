/* Which of the gathered faces, edges and vertices the tool may touch: found with some room, and kept until what moved
 * may have used the room up. Most of what was gathered is never touched, and its normals take roots. Hits are those of
 * a look at everything: what is left out is out of reach for certain. */
#include <string.h>

#include "base/vec.h"
#include "contact/contact_surface.h"

/* Where the stations are: along a piece of a line. */
typedef struct piece {
    double end_m[2][3];
} piece;

static double distance_m(const piece *p, const double point_m[3]) {
    return vsegment(point_m, p->end_m[0], p->end_m[1]);
}

static double travel2(const double a[3], const double b[3]) {
    double d[3];
    vsub(a, b, d);
    return vdot(d, d);
}

/* A ball around three vertices moves with them, and its radius changes by twice as much at most. */
static bool still_near(const tm_local_surface *s, const piece *p, double reach_m, double sunk_m, double room_m) {
    static const double SURELY = 1 - 1e-6;
    const tm_near *n = &s->near;
    if (!n->known || sunk_m > n->sunk_m) return false;
    double vertex2 = 0;
    for (int32_t v = 0; v < s->vertex_count; v++)
        vertex2 = law_max(travel2(s->position_m[v], n->position_m[v]), vertex2);
    const double end2 = law_max(travel2(p->end_m[0], n->end_m[0]), travel2(p->end_m[1], n->end_m[1]));
    return 3 * sqrt(vertex2) + sqrt(end2) + law_max(reach_m - n->reach_m, 0) <= SURELY * room_m;
}

static void list_features(tm_local_surface *s, const piece *p, double reach_m, double sunk_m) {
    tm_near *n = &s->near;
    n->face_count = n->edge_count = n->vertex_count = 0;
    for (int32_t f = 0; f < s->face_count; f++)
        if (!(distance_m(p, s->center_m[f]) > s->reach_m[f] + sunk_m + reach_m)) n->face[n->face_count++] = f;
    for (int32_t e = 0; e < s->edge_count; e++) {
        const double *a = s->position_m[s->edge_vertex[e][0]], *b = s->position_m[s->edge_vertex[e][1]];
        double middle[3], edge[3];
        vsub(b, a, edge);
        vmadd(a, 0.5, edge, middle);
        if (!(distance_m(p, middle) > 0.5 * vnorm(edge) + reach_m)) n->edge[n->edge_count++] = e;
    }
    for (int32_t v = 0; v < s->vertex_count; v++)
        if (!(distance_m(p, s->position_m[v]) > reach_m)) n->vertex[n->vertex_count++] = v;
}

/* Faces around all vertices of what is listed: normals are blended from those. */
static void list_wanted(tm_local_surface *s) {
    tm_near *n = &s->near;
    bool at[3 * TM_LOCAL_FACES];
    memset(at, 0, sizeof *at * (size_t)s->vertex_count);
    for (int32_t i = 0; i < n->face_count; i++)
        for (int j = 0; j < 3; j++) at[s->face_vertex[n->face[i]][j]] = true;
    for (int32_t i = 0; i < n->edge_count; i++)
        for (int j = 0; j < 2; j++) at[s->edge_vertex[n->edge[i]][j]] = true;
    for (int32_t i = 0; i < n->vertex_count; i++) at[n->vertex[i]] = true;
    n->wanted_count = 0;
    for (int32_t f = 0; f < s->face_count; f++)
        if (at[s->face_vertex[f][0]] || at[s->face_vertex[f][1]] || at[s->face_vertex[f][2]])
            n->wanted[n->wanted_count++] = f;
}

void tm_near_find(tm_local_surface *s, const tm_capsule *capsule, const double axis[3], double length_m, double reach_m,
                  double sunk_m) {
    tm_near *n = &s->near;
    const double room_m = 0.5 * capsule->radius_m;
    piece p;
    vset(capsule->tip_m, p.end_m[0]);
    vmadd(capsule->tip_m, length_m, axis, p.end_m[1]);
    if (still_near(s, &p, reach_m, sunk_m, room_m)) {
        for (int32_t i = 0; i < n->wanted_count; i++) tm_local_face(s, n->wanted[i]);
        return;
    }
    for (int32_t f = 0; f < s->face_count; f++) tm_local_face(s, f);
    list_features(s, &p, reach_m + room_m, sunk_m);
    list_wanted(s);
    n->known = true;
    n->reach_m = reach_m, n->sunk_m = sunk_m;
    memcpy(n->end_m, p.end_m, sizeof n->end_m);
    memcpy(n->position_m, s->position_m, sizeof *s->position_m * (size_t)s->vertex_count);
}
