/* Contact rows (docs/contact.md) in single precision, for the few triangles of a patch. Stations of the tool's axis
 * against faces, edges and vertices, with weights that vary smoothly between features. Normals are blended over the
 * smooth surface. Tests compare it with the simulation's detection (libtensormass/src/contact/narrow_phase_rows.c).
 *
 * For each station, distances from the vertices and heights over the faces are computed once; a comparison then rejects
 * most features. For a station p over a face with unit normal n, n . (p-a) x (p-b) is twice the area of p and edge ab.
 * Divided by the edge's length it is the distance from the edge; by twice the face's area, a barycentric weight.
 *
 * Over 400 lines: one search, whose small parts are inlined into each other. */
#include "internal.h"

#include "contact_law/feature.h"

enum { HITS = 24, STATIONS = 256 }; /* HITS: maximum per station */

enum { FACE, EDGE, VERTEX };

typedef struct hit {
    uint8_t kind, index;
    float raw, distance_m;
} hit;

typedef struct face {
    law_v3 normal;        /* outward; zero: degenerate face */
    float size;           /* twice the area */
    float base_m, rise_m; /* height of the tip over it, and increment per station */
} face;

typedef struct edge {
    float length_m;
    float span_m2; /* half width of the transition across it, times its length */
} edge;

typedef struct search {
    const hrt_patch *patch;
    const hrt_patch_topology *t;
    const hrt_contact_row *before;
    int32_t before_count;
    law_v3 axis;    /* away from the tip, one radius long */
    float length_m; /* of the axis, from trocar to tip; large without a trocar */
    float radius_m, reach_m, sunk_m;
    face face[HRT_PATCH_MAX_TRIANGLES];
    edge edge[HRT_PATCH_EDGES];
    int32_t ridges;
    uint8_t ridge[HRT_PATCH_EDGES];         /* convex edges */
    float close_m2[HRT_PATCH_MAX_VERTICES]; /* squared distance beyond which a station is not near faces or edges at
                                               this vertex */
    /* of the current station */
    int32_t station, from_station;       /* from_station: station that `from` holds */
    uint32_t close;                      /* bit v: vertex v is close */
    law_v3 from[HRT_PATCH_MAX_VERTICES]; /* vector from the vertex to the station */
    int32_t hits;
    hit hit[HITS];
    uint32_t blended; /* bit v: the normal at vertex v is computed */
    law_v3 corner[HRT_PATCH_MAX_VERTICES];
} search;

static const uint8_t *corners(const search *q, int32_t f) { return &q->patch->triangle[HRT_XYZ * f]; }

static inline __attribute__((always_inline)) float height(const face *f, int32_t station) {
    return f->base_m + (float)station * f->rise_m;
}

/* Returns the vector from vertex a to vertex b. */
static inline __attribute__((always_inline)) law_v3 way(const search *q, int32_t a, int32_t b) {
    return vminus(q->from[a], q->from[b]);
}

static void place_faces(search *q) {
    const uint8_t *corner = q->patch->triangle;
    for (face *f = q->face; f < q->face + q->patch->triangle_count; f++, corner += 3) {
        const law_v3 a = way(q, corner[0], corner[1]), b = way(q, corner[0], corner[2]), area = vouter(a, b);
        f->size = vsize(area);
        f->normal = vtimes(f->size > 1.0e-6f * law_max(vinner(a, a), vinner(b, b)) ? 1.0f / f->size : 0.0f, area);
        f->base_m = vinner(f->normal, q->from[corner[0]]);
        f->rise_m = vinner(f->normal, q->axis);
    }
}

/* Returns the depth of the second face's third corner below the first face; positive if the edge is convex. */
static inline __attribute__((always_inline)) float fold(const search *q, const uint8_t end[2], const uint8_t side[2]) {
    const uint8_t *corner = corners(q, side[1]);
    return vinner(q->face[side[0]].normal, way(q, corner[0] + corner[1] + corner[2] - end[0] - end[1], end[0]));
}

/* Computes lengths and transitions of the edges. Both faces use the same transition, so that their weights add up to
 * one. A triangle's height over an edge is twice its area over the edge's length. Over a face and its transition, the
 * nearest corner is within three quarters of its longest edge. */
static void place_edges(search *q) {
    const uint8_t *end = q->t->edge_vertex[0], *side = q->t->edge_face[0];
    for (int32_t v = 0; v < q->patch->vertex_count; v++) q->close_m2[v] = 0.0f;
    q->ridges = 0;
    for (edge *e = q->edge; e < q->edge + q->t->edge_count; e++, end += 2, side += 2) {
        const bool two = side[1] != HRT_NO_FACE;
        const float length = law_max(vsize(way(q, end[0], end[1])), 1.0e-9f), wide = 0.75f * length,
                    close2 = q->reach_m * q->reach_m + wide * wide;
        const float size = law_min(q->face[side[0]].size, q->face[side[two ? 1 : 0]].size);
        e->length_m = length;
        e->span_m2 = law_max(law_transition(q->radius_m * length, size), 1.0e-9f * length);
        for (int i = 0; i < 2; i++) q->close_m2[end[i]] = law_max(q->close_m2[end[i]], close2);
        if (!two || fold(q, end, side) > 0.0f) q->ridge[q->ridges++] = (uint8_t)(e - q->edge);
    }
}

/* Returns twice the area, in the plane of face f, of the station and the edge from corner j; positive on the face's
 * side. */
static inline __attribute__((always_inline)) float part(const search *q, int32_t f, int j) {
    const uint8_t *corner = corners(q, f);
    return vinner(q->face[f].normal, vouter(q->from[corner[j]], q->from[corner[j == 2 ? 0 : j + 1]]));
}

static void add_hit(search *q, uint8_t kind, int32_t index, float raw, float distance_m) {
    if (q->hits < HITS) q->hit[q->hits++] = (hit){kind, (uint8_t)index, raw, distance_m};
}

/* Returns whether the station touched a corner of this face in the previous shape. */
static bool known(const search *q, int32_t f) {
    for (int32_t i = 0; i < q->before_count; i++) {
        if (q->before[i].station != q->station || !(q->before[i].lambda_N > 0.0f)) continue;
        for (int j = 0; j < 9; j++)
            if (corners(q, q->before[i].triangle)[j / 3] == corners(q, f)[j % 3]) return true;
    }
    return false;
}

static void face_hit(search *q, int32_t f) {
    const float high = height(&q->face[f], q->station);
    float raw = 1.0f, outside = 0.0f;
    if (high > q->reach_m || high < -q->sunk_m || !(vinner(q->face[f].normal, q->face[f].normal) > 0.0f)) return;
    for (int j = 0; j < 3; j++) {
        const int32_t e = q->t->face_edge[f][j];
        const float inward = part(q, f, j);
        if (!(inward > -q->edge[e].span_m2)) return;
        raw *= law_ramp(inward / q->edge[e].span_m2);
        outside = law_max(outside, -inward / q->edge[e].length_m);
    }
    if (law_wants_history(high, outside, q->radius_m) && !known(q, f)) return;
    if (raw > 0.0f) add_hit(q, FACE, f, raw, high > 0.0f ? sqrtf(high * high + outside * outside) : high);
}

/* Returns 0 for a flat edge, 1 for a sharp convex one. */
static float edge_sharpness(const search *q, int32_t e) {
    const uint8_t *end = q->t->edge_vertex[e], *side = q->t->edge_face[e];
    if (side[1] == HRT_NO_FACE || vinner(q->face[side[0]].normal, q->face[side[1]].normal) < 0.0f) return 1.0f;
    return law_sharpness(fold(q, end, side) * q->edge[e].length_m / law_max(q->face[side[1]].size, 1.0e-30f));
}

static inline __attribute__((always_inline)) float end_blend(const search *q, int32_t e) {
    return law_transition(q->radius_m, q->edge[e].length_m);
}

static void edge_hit(search *q, int32_t e) {
    const uint8_t *end = q->t->edge_vertex[e], *side = q->t->edge_face[e];
    const bool two = side[1] != HRT_NO_FACE;
    const float one_side = height(&q->face[side[0]], q->station),
                other_side = two ? height(&q->face[side[1]], q->station) : 0.0f;
    if (!(one_side + other_side > 0.0f) || one_side > q->reach_m || other_side > q->reach_m) return;
    const law_v3 a = q->from[end[0]], b = q->from[end[1]];
    const float y = vinner(a, vminus(a, b)) / q->edge[e].length_m, distance2 = vinner(a, a) - y * y;
    if (distance2 > q->reach_m * q->reach_m) return;
    const law_v3 across = vtimes(1.0f / q->edge[e].span_m2, vouter(b, a)); /* from the first face into the second */
    const float ends = end_blend(q, e);
    float raw = law_ramp(vinner(q->face[side[0]].normal, across)) * law_ramp(y / ends) *
                law_ramp((q->edge[e].length_m - y) / ends);
    if (two) raw *= law_ramp(-vinner(q->face[side[1]].normal, across));
    if (raw > 0.0f) raw *= edge_sharpness(q, e);
    if (raw > 0.0f) add_hit(q, EDGE, e, raw, sqrtf(law_max(distance2, 0.0f)));
}

static void vertex_hit(search *q, int32_t v) {
    const hrt_patch_topology *t = q->t;
    const law_v3 d = q->from[v];
    const float distance2 = vinner(d, d);
    law_v3 up = {0.0f, 0.0f, 0.0f};
    float raw = 1.0f, sharp = 1.0f;
    if (distance2 > q->reach_m * q->reach_m) return;
    for (int32_t i = t->fan_begin[v]; i < t->fan_begin[v + 1]; i++) up = vplus(up, q->face[t->fan_face[i]].normal);
    if (!(vinner(d, up) > 0.0f)) return;
    const float steep = -1.0f / vsize(up);
    for (int32_t e = 0; e < t->edge_count; e++) {
        const uint8_t *end = t->edge_vertex[e];
        if (end[0] != v && end[1] != v) continue;
        const law_v3 to = vtimes(1.0f / q->edge[e].length_m, way(q, v, end[0] + end[1] - v));
        sharp = law_min(sharp, law_sharpness(steep * vinner(to, up)));
        raw *= law_ramp(-vinner(d, to) / law_max(end_blend(q, e), 1.0e-9f));
        if (!(sharp * raw > 0.0f)) return;
    }
    add_hit(q, VERTEX, v, sharp * raw, sqrtf(distance2));
}

/* ---------------------------------------------------------------------------------------------- hits to rows */

/* Returns how smooth the undeformed surface is from face f to face g, 0..255. */
static int32_t smooth(const search *q, int32_t f, int32_t g) {
    if (f == g) return 255;
    return f > g ? q->t->smooth[f * (f - 1) / 2 + g] : q->t->smooth[g * (g - 1) / 2 + f];
}

/* Returns the normal at corner v of face f: the area-weighted mean over faces of the same smooth surface. Without a
 * crease it is the same for each face. */
static law_v3 corner_normal(search *q, int32_t f, int32_t v) {
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    if ((q->blended >> v & 1u) != 0) return q->corner[v];
    for (int32_t i = q->t->fan_begin[v]; i < q->t->fan_begin[v + 1]; i++) {
        const int32_t g = q->t->fan_face[i];
        sum = vplus(sum, vtimes((float)smooth(q, f, g) * q->face[g].size, q->face[g].normal));
    }
    const float size = vsize(sum);
    q->corner[v] = vtimes(size > 0.0f ? 1.0f / size : 0.0f, sum);
    q->blended |= ~q->t->creased & 1u << v;
    return q->corner[v];
}

static law_v3 face_row(search *q, int32_t f, hrt_contact_row *row) {
    law_v3 normal = {0.0f, 0.0f, 0.0f};
    float sum = 0.0f;
    for (int j = 0; j < 3; j++) { /* areas of the parts, not negative: a row never pulls on a vertex */
        float *weight = &row->weight[j == 0 ? 2 : j - 1];
        *weight = law_max(part(q, f, j), 0.0f);
        sum += *weight;
    }
    for (int j = 0; j < 3; j++) {
        row->weight[j] /= sum;
        normal = vplus(normal, vtimes(row->weight[j], corner_normal(q, f, corners(q, f)[j])));
    }
    row->gap_m = height(&q->face[f], q->station);
    row->triangle = (uint8_t)f;
    /* Keep the blended normal only on the face's own side. */
    const float size = vsize(normal);
    normal = vtimes(1.0f / law_max(size, 1.0e-9f), normal);
    return law_normal_stands(size, vinner(normal, q->face[f].normal)) ? normal : q->face[f].normal;
}

/* Returns the negative row normal: from the nearest point, at share s of the edge from corner j to the next, to the
 * station. */
static law_v3 line_row(const search *q, int32_t f, int j, float s, hrt_contact_row *row) {
    const int k = j == 2 ? 0 : j + 1;
    const uint8_t *corner = corners(q, f);
    const law_v3 d = vminus(q->from[corner[j]], vtimes(s, way(q, corner[j], corner[k])));
    row->weight[k] = hrt_clamp(s, 0.0f, 1.0f);
    row->weight[j] = 1.0f - row->weight[k];
    row->triangle = (uint8_t)f;
    row->gap_m = vsize(d);
    return vtimes(row->gap_m > 0.0f ? 1.0f / row->gap_m : 0.0f, d);
}

static law_v3 edge_row(const search *q, int32_t e, hrt_contact_row *row) {
    const int32_t a = q->t->edge_vertex[e][0], f = q->t->edge_face[e][0];
    const law_v3 along = way(q, a, q->t->edge_vertex[e][1]);
    int j = 0;
    while (j < 2 && q->t->face_edge[f][j] != e) j++;
    row->feature = (uint8_t)(1 + j);
    return line_row(q, f, j, vinner(q->from[a], along) / vinner(along, along), row);
}

static law_v3 vertex_row(const search *q, int32_t v, hrt_contact_row *row) {
    const int32_t f = q->t->fan_face[q->t->fan_begin[v]];
    int j = 0;
    while (j < 2 && corners(q, f)[j] != v) j++;
    row->feature = (uint8_t)(4 + j);
    return line_row(q, f, j, 0.0f, row);
}

/* Returns whether all of a row's vertices are grasped. */
static bool is_held(const search *q, const hrt_contact_row *row) {
    bool held = true;
    for (int j = 0; j < 3; j++)
        held = held && (!(row->weight[j] > 0.0f) || (q->patch->grasped >> corners(q, row->triangle)[j] & 1u) != 0);
    return held;
}

/* Adds a row; at capacity, replaces the shallowest if the new one is deeper. */
static int32_t push_row(hrt_contact_row *row, int32_t count, const hrt_contact_row *candidate) {
    int32_t shallow = count;
    if (count == HRT_CONTACT_ROWS) {
        shallow = 0;
        for (int32_t i = 1; i < count; i++)
            if (row[i].gap_m > row[shallow].gap_m) shallow = i;
        if (!(candidate->gap_m < row[shallow].gap_m)) return count;
    } else
        count++;
    row[shallow] = *candidate;
    return count;
}

static int32_t station_rows(search *q, hrt_contact_row *row, int32_t count) {
    float nearest = 1.0e30f, total = 1.0e-30f;
    for (int32_t i = 0; i < q->hits; i++) nearest = law_min(nearest, q->hit[i].distance_m);
    for (int32_t i = 0; i < q->hits; i++) {
        q->hit[i].raw *= law_nearness(q->hit[i].distance_m, nearest, q->radius_m);
        total += q->hit[i].raw;
    }
    for (int32_t i = 0; i < q->hits; i++) {
        const hit *h = &q->hit[i];
        hrt_contact_row new_row = {.station = (uint8_t)q->station, .share = law_share(h->raw, total)};
        if (new_row.share < LAW_MIN_SHARE) continue;
        const law_v3 normal = h->kind == FACE   ? face_row(q, h->index, &new_row)
                              : h->kind == EDGE ? edge_row(q, h->index, &new_row)
                                                : vertex_row(q, h->index, &new_row);
        vput(vtimes(-1.0f, normal), new_row.normal);
        new_row.gap_m -= q->radius_m;
        if (new_row.gap_m <= LAW_MARGIN * q->radius_m && !is_held(q, &new_row)) count = push_row(row, count, &new_row);
    }
    return count;
}

/* ---------------------------------------------------------------------------------------------- the search */

static bool sinks(const search *q, const hrt_contact_row *row) {
    return law_sinks(row->gap_m, row->lambda_N, q->radius_m);
}

/* Moves the search to a station. Returns false if no face is near enough; then no edge or vertex is. */
static bool stand(search *q, int32_t station) {
    bool near = false;
    q->station = station;
    q->hits = 0;
    q->close = 0;
    q->sunk_m = LAW_SUNK * q->radius_m;
    for (int32_t i = 0; i < q->before_count; i++) {
        const hrt_contact_row *row = &q->before[i];
        if (row->station != station || !(row->lambda_N > 0.0f)) continue;
        if (sinks(q, row)) q->sunk_m = LAW_SUNK_KNOWN * q->radius_m;
        for (int j = 0; j < 3; j++) q->close |= 1u << corners(q, row->triangle)[j];
    }
    for (const face *f = q->face; f < q->face + q->patch->triangle_count && !near; f++) {
        const float high = height(f, station);
        near = high <= q->reach_m && high >= -q->sunk_m;
    }
    if (!near) return false;
    const law_v3 step = vtimes((float)(station - q->from_station), q->axis);
    q->from_station = station;
    for (int32_t v = 0; v < q->patch->vertex_count; v++) {
        q->from[v] = vplus(q->from[v], step);
        if (vinner(q->from[v], q->from[v]) <= q->close_m2[v]) q->close |= 1u << v;
    }
    return q->close != 0;
}

/* Computes the range of stations that may be near the patch. */
static void station_range(const search *q, int32_t *first, int32_t *last) {
    const float square = q->radius_m * q->radius_m, reach = q->reach_m / q->radius_m;
    const float stations = law_min(q->patch->contact_length_m, q->length_m) / q->radius_m + 1.0e-4f,
                end = law_min(stations, (float)(STATIONS - 1));
    float low = end, high = -1.0f;
    for (int32_t v = 0; v < q->patch->vertex_count; v++) {
        const float along = -vinner(q->from[v], q->axis) / square;
        low = law_min(low, along - reach);
        high = law_max(high, along + reach);
    }
    for (int32_t i = 0; i < q->before_count; i++)
        if (sinks(q, &q->before[i])) {
            low = law_min(low, (float)q->before[i].station);
            high = law_max(high, (float)q->before[i].station);
        }
    *first = (int32_t)law_max(low, 0.0f);
    *last = high < 0.0f ? -1 : (int32_t)law_min(high, end);
}

static void find_rows(search *q, hrt_hits *hits) {
    const uint8_t *corner = q->patch->triangle;
    for (int32_t f = 0; f < q->patch->triangle_count; f++, corner += 3)
        if (((q->close >> corner[0] | q->close >> corner[1] | q->close >> corner[2]) & 1u) != 0) face_hit(q, f);
    for (int32_t i = 0; i < q->ridges; i++) {
        const uint8_t *end = q->t->edge_vertex[q->ridge[i]];
        if (((q->close >> end[0] | q->close >> end[1]) & 1u) != 0) edge_hit(q, q->ridge[i]);
    }
    for (int32_t v = 0; v < q->patch->vertex_count; v++)
        if ((q->close >> v & 1u) != 0) vertex_hit(q, v);
    for (int32_t i = 0; i < q->hits && hits->count < HRT_HITS_MAX; i++) {
        hits->at[hits->count].station = (uint8_t)q->station;
        hits->at[hits->count].kind = q->hit[i].kind;
        hits->at[hits->count++].index = q->hit[i].index;
    }
}

static void prepare(search *q, const hrt_patch *patch, const float *shift_m, const float tip_m[3],
                    const hrt_shaft *shaft) {
    const law_v3 tip = vget(tip_m);
    q->patch = patch;
    q->t = &patch->topology;
    q->radius_m = patch->radius_m;
    q->reach_m = q->radius_m * (1.0f + LAW_PROXIMITY + LAW_MARGIN);
    q->length_m = hrt_is_free(shaft) ? 1.0e6f : vsize(tip);
    q->axis =
        hrt_is_free(shaft) ? vtimes(-q->radius_m, vget(shaft->direction)) : vtimes(-q->radius_m / q->length_m, tip);
    q->from_station = 0;
    q->blended = 0;
    for (int32_t v = 0; v < patch->vertex_count; v++)
        q->from[v] = vminus(tip, vplus(vget(&patch->vertex_m[HRT_XYZ * v]), vget(&shift_m[HRT_XYZ * v])));
    place_faces(q);
    place_edges(q);
}

static void repeat_detection(search *q, uint8_t kind, int32_t index) {
    if (kind == FACE)
        face_hit(q, index);
    else if (kind == EDGE)
        edge_hit(q, index);
    else
        vertex_hit(q, index);
}

int32_t hrt_contact_rows(const hrt_patch *patch, const float *shift_m, const float tip_m[3], const hrt_shaft *shaft,
                         const hrt_contact_row *before, int32_t before_count, hrt_hits *hits, hrt_contact_row *row) {
    search q;
    int32_t count = 0, next = 0, first, last;
    prepare(&q, patch, shift_m, tip_m, shaft);
    q.before = before;
    q.before_count = before_count;
    if (hits->count < 0) {
        hits->count = 0;
        station_range(&q, &first, &last);
        for (int32_t k = first; k <= last; k++) {
            if (!stand(&q, k)) continue;
            find_rows(&q, hits);
            count = station_rows(&q, row, count);
        }
        return count;
    }
    while (next < hits->count) {
        const bool near = stand(&q, hits->at[next].station);
        for (; next < hits->count && hits->at[next].station == q.station; next++)
            if (near) repeat_detection(&q, hits->at[next].kind, hits->at[next].index);
        count = station_rows(&q, row, count);
    }
    return count;
}
