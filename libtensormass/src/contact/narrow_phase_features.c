/* Narrow phase, first part: stations of the tool's axis against faces, edges and vertices of the surface.
 *
 * The force of a sphere on a triangulated plane must be that of the plane, and must not jump when the closest feature
 * changes. So each feature has a weight that changes smoothly from 0 to 1 across the borders of its Voronoi region.
 * Edges and vertices count according to their sharpness. The weights of a station are normalised to shares of its
 * contact compliance.
 *
 * The normal of a face is blended with those of its neighbours where the undeformed surface is smooth. A dent has few
 * facets, and with their own normals the force would jump from one to the next. docs/contact.md, "Rows". */
#include "base/vec.h"

#include <string.h>

#include "contact/broad_phase.h"
#include "contact/contact_internal.h"
#include "contact_law/feature.h"

/* Cull: lists the gathered faces, edges and vertices that the tool may touch, within a margin. The list is kept until
 * motion may have used up the margin. Most gathered features are never touched, and their normals need square roots.
 * The hits equal those of a complete search: only features certainly out of reach are left out. */

/* Segment of a line that contains the stations. */
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

/* Returns whether a face may be near. The bounding sphere of its three vertices moves with them; its radius changes by
 * at most twice their motion. */
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

/* Lists the faces around all listed vertices, from which normals are blended. */
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

/* Lists what may be within reach of stations on `length_m` of the axis from the tip, and faces sunk_m farther, unless
 * the list is up to date. Computes the faces that this requires. */
static void tm_near_find(tm_local_surface *s, const tm_capsule *capsule, const double axis[3], double length_m,
                         double reach_m, double sunk_m) {
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

int32_t tm_capsule_stations(const tm_capsule *capsule) {
    double axis[3];
    vsub(capsule->tail_m, capsule->tip_m, axis);
    double n = floor(vnorm(axis) / capsule->radius_m + 1e-9) + 1;
    return n < TM_MAX_STATIONS ? (int32_t)n : TM_MAX_STATIONS;
}

void tm_capsule_station(const tm_capsule *capsule, int32_t station, double point_m[3]) {
    double axis[3], e[3];
    vsub(capsule->tail_m, capsule->tip_m, axis);
    vunit(axis, e);
    vmadd(capsule->tip_m, station * capsule->radius_m, e, point_m);
}

static const double MIN_WIDTH_M = 1e-9; /* of a transition */

/* One search: capsule, surface and limits. */
typedef struct search {
    tm_local_surface *s;
    const tm_capsule *capsule;
    const tm_contact_row *history;
    int32_t history_count;
    double axis[3];
    int32_t stations;
    double reach_m;
    double sunk_m; /* maximum depth of a station behind a face */
    tm_hits *hits;
} search;

/* Computes a station as tm_capsule_station, with the axis already known. */
static void station_at(const search *q, int32_t station, double point_m[3]) {
    vmadd(q->capsule->tip_m, station * q->capsule->radius_m, q->axis, point_m);
}

/* Computes the range of stations whose spheres, widened to the reach, can touch a bounding sphere. Returns false if
 * there is none. Most spheres are rejected at once. */
static inline bool station_range(const search *q, const double center[3], double radius, int32_t *first,
                                 int32_t *last) {
    double to[3], across[3];
    vsub(center, q->capsule->tip_m, to);
    double along = vdot(to, q->axis), reach = radius + q->reach_m;
    vmadd(to, -along, q->axis, across);
    double chord2 = reach * reach - vdot(across, across);
    if (!(chord2 >= 0)) return false;
    double half = sqrt(chord2), step = q->capsule->radius_m;
    if (!(along + half >= 0 && along - half <= step * (q->stations - 1)))
        return false; /* also keeps the casts below in range for any position */
    *first = (int32_t)ceil(law_max((along - half) / step, 0));
    *last = (int32_t)floor(law_min((along + half) / step, q->stations - 1));
    return *first <= *last;
}

/* Returns whether an edge with half length sqrt(half2) is certainly beyond reach of the line. Square roots would cost
 * more than the rest, and few edges need them: (half + reach)^2 < across^2, squared once more. */
static inline bool is_beyond(const search *q, const double middle[3], double half2) {
    static const double SURELY = 1 - 1e-6;
    double to[3], across[3];
    vsub(middle, q->capsule->tip_m, to);
    vmadd(to, -vdot(to, q->axis), q->axis, across);
    const double reach2 = q->reach_m * q->reach_m, over = SURELY * vdot(across, across) - half2 - reach2;
    return over > 0 && SURELY * over * over > 4 * half2 * reach2;
}

static void add_hit(search *q, int32_t station, int32_t kind, int32_t index, double raw, double distance) {
    if (q->hits->count == TM_LOCAL_HITS) {
        q->hits->overflowed = true;
        return;
    }
    q->hits->hit[q->hits->count++] = (tm_hit){station, kind, index, raw, distance};
}

/* Returns the in-plane unit vector of face f, across its edge j into the face, with the distance `altitude` of the
 * opposite vertex. Computed once a search, as several features use it. */
static const tm_inward *inward(const search *q, int32_t f, int j) {
    tm_local_surface *s = q->s;
    tm_inward *in = &s->inward[f][j];
    if (s->inward_known[f] & 1u << j) return in;
    const double *a = s->position_m[s->face_vertex[f][j]], *b = s->position_m[s->face_vertex[f][(j + 1) % 3]];
    double edge[3], apex[3];
    vsub(b, a, edge);
    vcross(s->normal[f], edge, in->unit);
    vunit(in->unit, in->unit);
    vsub(s->position_m[s->face_vertex[f][(j + 2) % 3]], a, apex);
    in->altitude_m = vdot(apex, in->unit);
    s->inward_known[f] |= (uint8_t)(1u << j);
    return in;
}

/* Returns the half width of the transition across an edge: equal from both faces, so that their weights sum to one. */
static double edge_blend(const search *q, int32_t edge) {
    double width = LAW_BLEND * q->capsule->radius_m;
    for (int k = 0; k < 2; k++) {
        int32_t f = q->s->edge_face[edge][k];
        if (f >= 0)
            width = law_min(width, law_transition(q->capsule->radius_m,
                                                  inward(q, f, tm_local_edge_slot(q->s, f, edge))->altitude_m));
    }
    return law_max(width, MIN_WIDTH_M);
}

static bool known(const search *q, int32_t station, int32_t f) {
    for (int32_t i = 0; i < q->history_count; i++) {
        const tm_contact_row *row = q->history + i;
        if (row->instrument != q->capsule->instrument || row->station != station || row->lambda_N <= 0) continue;
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                if (row->vertex[j] == q->s->vertex_id[q->s->face_vertex[f][k]]) return true;
    }
    return false;
}

/* Computes how far a station at `p`, over or behind the face, is inside its three edges. Returns false if it is so far
 * outside one that the face's weight is zero for any transition width. */
static bool is_over(const search *q, int32_t f, const double p[3], double x[3]) {
    const double widest = law_max(LAW_BLEND * q->capsule->radius_m, MIN_WIDTH_M);
    for (int j = 0; j < 3; j++) {
        double d[3];
        vsub(p, q->s->position_m[q->s->face_vertex[f][j]], d);
        x[j] = vdot(d, inward(q, f, j)->unit);
        if (x[j] <= -widest) return false;
    }
    return true;
}

/* Finds the hits of a face. Values with square roots are computed once, only if a station is near. */
static void face_hits(search *q, int32_t f) {
    const tm_local_surface *s = q->s;
    double width[3], x[3], radius = q->capsule->radius_m;
    int32_t first, last;
    bool has_width = false;
    if (vdot(s->normal[f], s->normal[f]) == 0 ||
        !station_range(q, s->center_m[f], s->reach_m[f] + q->sunk_m, &first, &last))
        return;
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3], raw = 1, outside = 0;
        station_at(q, k, p);
        vsub(p, s->position_m[s->face_vertex[f][0]], d);
        double height = vdot(d, s->normal[f]);
        if (height > q->reach_m || height < -q->sunk_m) continue;
        if (!is_over(q, f, p, x)) continue;
        for (int j = 0; j < 3 && !has_width; j++) width[j] = edge_blend(q, s->face_edge[f][j]);
        has_width = true;
        for (int j = 0; j < 3 && raw > 0; j++) {
            raw *= law_ramp(x[j] / width[j]);
            outside = law_max(outside, -x[j]);
        }
        if (raw <= 0) continue;
        if (law_wants_history(height, outside, radius) && !known(q, k, f)) continue;
        add_hit(q, k, 0, f, raw, height > 0 ? sqrt(height * height + outside * outside) : height);
    }
}

/* Returns the sharpness of an edge: 0 flat or concave, 1 a convex fold of LAW_SHARP or more. */
static double edge_sharpness(const search *q, int32_t e) {
    const tm_local_surface *s = q->s;
    int32_t a = s->edge_face[e][0], b = s->edge_face[e][1];
    if (b < 0) return 1;
    double sine = -vdot(s->normal[a], inward(q, b, tm_local_edge_slot(s, b, e))->unit);
    if (sine > 0 && vdot(s->normal[a], s->normal[b]) < 0) return 1;
    return law_sharpness(sine);
}

/* Returns the weight of an edge towards the faces on both sides, for a station `across` from it, and whether the
 * station is outside them. */
static double side_weight(const search *q, int32_t e, const double across[3], double width, double raw, double *out) {
    const tm_local_surface *s = q->s;
    *out = 0;
    for (int side = 0; side < 2 && raw > 0; side++) {
        int32_t f = s->edge_face[e][side];
        if (f < 0) continue;
        raw *= law_ramp(-vdot(across, inward(q, f, tm_local_edge_slot(s, f, e))->unit) / width);
        *out += vdot(across, s->normal[f]);
    }
    return raw;
}

static void edge_hits(search *q, int32_t e) {
    const tm_local_surface *s = q->s;
    const double *a = s->position_m[s->edge_vertex[e][0]], *b = s->position_m[s->edge_vertex[e][1]];
    double middle[3], edge[3], unit[3], sharp = -1, width = 0, out;
    int32_t first, last;
    vsub(b, a, edge);
    vmadd(a, 0.5, edge, middle);
    if (is_beyond(q, middle, 0.25 * vdot(edge, edge))) return;
    double length = vunit(edge, unit);
    if (length <= 0 || !station_range(q, middle, 0.5 * length, &first, &last)) return;
    const double along_width = law_transition(q->capsule->radius_m, length);
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3], across[3];
        station_at(q, k, p);
        vsub(p, a, d);
        double y = vdot(d, unit);
        vmadd(d, -y, unit, across);
        double distance = vnorm(across);
        if (distance > q->reach_m) continue;
        const double along = law_ramp(y / along_width) * law_ramp((length - y) / along_width);
        if (!(along > 0)) continue;
        if (sharp < 0) { /* computed on first use */
            sharp = edge_sharpness(q, e);
            if (!(sharp > 0)) return;
            width = edge_blend(q, e);
        }
        const double raw = side_weight(q, e, across, width, sharp * along, &out);
        if (raw > 0 && out > 0) add_hit(q, k, 1, e, raw, distance);
    }
}

/* Computes the mean normal around a vertex, and how far the vertex stands out of its fan. */
static double vertex_sharpness(const tm_local_surface *s, int32_t v, double up[3]) {
    const int32_t begin = s->vertex_edge_begin[v], end = s->vertex_edge_begin[v + 1];
    double sharp = 1, spoke[3];
    vset((const double[3]){0, 0, 0}, up);
    for (int32_t i = begin; i < end; i++)
        for (int side = 0; side < 2; side++)
            if (s->edge_face[s->vertex_edge[i]][side] >= 0)
                vmadd(up, 1, s->normal[s->edge_face[s->vertex_edge[i]][side]], up);
    vunit(up, up);
    for (int32_t i = begin; i < end && sharp > 0; i++) {
        const int32_t *ends = s->edge_vertex[s->vertex_edge[i]];
        vsub(s->position_m[ends[0] == v ? ends[1] : ends[0]], s->position_m[v], spoke);
        vunit(spoke, spoke);
        sharp = law_min(sharp, law_sharpness(-vdot(spoke, up)));
    }
    return sharp;
}

static void vertex_hits(search *q, int32_t v) {
    const tm_local_surface *s = q->s;
    const double *at = s->position_m[v];
    double up[3], sharp = -1, spoke[3];
    int32_t first, last, begin = s->vertex_edge_begin[v], end = s->vertex_edge_begin[v + 1];
    if (!station_range(q, at, 0, &first, &last)) return;
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3];
        station_at(q, k, p);
        vsub(p, at, d);
        if (vnorm(d) > q->reach_m) continue;
        if (sharp < 0) sharp = vertex_sharpness(s, v, up);
        if (!(sharp > 0)) return;
        if (vdot(d, up) <= 0) continue;
        double raw = sharp;
        for (int32_t i = begin; i < end && raw > 0; i++) {
            const int32_t *ends = s->edge_vertex[s->vertex_edge[i]];
            vsub(s->position_m[ends[0] == v ? ends[1] : ends[0]], at, spoke);
            double length = vunit(spoke, spoke);
            raw *= law_ramp(-vdot(d, spoke) / law_max(law_transition(q->capsule->radius_m, length), MIN_WIDTH_M));
        }
        if (raw > 0) add_hit(q, k, 2, v, raw, vnorm(d));
    }
}

/* Sorts the hits by station, stably. */
static void sort_hits(tm_hits *hits, int32_t stations) {
    memset(hits->begin, 0, sizeof(int32_t) * (size_t)(stations + 1));
    for (int32_t i = 0; i < hits->count; i++) hits->begin[hits->hit[i].station + 1]++;
    for (int32_t k = 0; k < stations; k++) hits->begin[k + 1] += hits->begin[k];
    for (int32_t i = hits->count - 1; i >= 0; i--) hits->order[--hits->begin[hits->hit[i].station + 1]] = i;
    for (int32_t k = 0; k < stations; k++) hits->begin[k] = hits->begin[k + 1];
    hits->begin[stations] = hits->count;
}

void tm_local_hits(tm_local_surface *surface, tm_hits *hits, const tm_capsule *capsule, double margin_m,
                   const tm_contact_row *history, int32_t history_count) {
    search q = {.s = surface, .capsule = capsule, .history = history, .history_count = history_count, .hits = hits};
    double axis[3];
    vsub(capsule->tail_m, capsule->tip_m, axis);
    vunit(axis, q.axis);
    q.stations = tm_capsule_stations(capsule);
    q.reach_m = capsule->radius_m * (1 + LAW_PROXIMITY) + margin_m;
    q.sunk_m = LAW_SUNK * capsule->radius_m;
    for (int32_t i = 0; i < history_count; i++)
        if (law_sinks(history[i].gap_m, history[i].lambda_N, capsule->radius_m))
            q.sunk_m = LAW_SUNK_KNOWN * capsule->radius_m;
    hits->count = 0;
    hits->overflowed = false;
    tm_near_find(surface, capsule, q.axis, capsule->radius_m * (q.stations - 1), q.reach_m, q.sunk_m);
    const tm_near *near = &surface->near;
    for (int32_t i = 0; i < near->face_count; i++) face_hits(&q, near->face[i]);
    for (int32_t i = 0; i < near->edge_count; i++) edge_hits(&q, near->edge[i]);
    for (int32_t i = 0; i < near->vertex_count; i++) vertex_hits(&q, near->vertex[i]);
    sort_hits(hits, q.stations);
}
