/* The rows of docs/contact.md in single precision, for the few triangles of a patch: stations of the tool's axis against faces, edges and vertices, with weights
 * that run smoothly from one feature to the next, and normals blended over the smooth surface. The simulation's own finder
 * (libtensormass/src/contact_find.c) is the reference that tests hold this one to. */
#include "internal.h"

static const float BLEND = 0.2f;     /* half width of the transition between neighbouring features, in radii */
static const float PROXIMITY = 0.4f; /* a feature that much farther (radii) than the nearest has no share */
static const float SHARP = 0.25f;    /* sine of the fold from which an edge or a vertex counts fully */
static const float SUNK = 0.5f;      /* how far (radii) behind a face a station may be that it did not touch before */
static const float SUNK_KNOWN = 8.0f;
static const float MARGIN = 0.2f;    /* radii */
enum { HITS = 64, STATIONS = 256 };

typedef struct hit {
    uint8_t station, kind, index; /* kind 0 face, 1 edge, 2 vertex */
    float raw, distance_m;
} hit;

typedef struct search {
    const hrt_patch *patch;
    const hrt_patch_topology *t;
    const hrt_contact_row *before;
    int32_t before_count;
    float tip_m[3], axis[3]; /* axis: from the tip towards the trocar */
    int32_t stations;
    float radius_m, reach_m, sunk_m;
    float at[HRT_PATCH_DOFS];
    float area[HRT_PATCH_MAX_TRIANGLES][3], normal[HRT_PATCH_MAX_TRIANGLES][3]; /* outward; area: twice as long as the area */
    float length_m[HRT_PATCH_EDGES], blend_m[HRT_PATCH_EDGES];                  /* of edges; half width of the transition across */
    int32_t hits;
    hit hit[HITS];
} search;

/* 0 below -1, 1 above 1, smooth between. */
static float ramp(float x) {
    const float q = hrt_clamp(0.5f * (x + 1.0f), 0.0f, 1.0f);
    return q * q * (3.0f - 2.0f * q);
}

static float unit(float v[3]) {
    const float size = hrt_length(v);
    hrt_scale(v, size > 0.0f ? 1.0f / size : 0.0f);
    return size;
}

static const float *vertex(const search *q, int32_t f, int j) { return &q->at[HRT_XYZ * q->patch->triangle[3 * f + j]]; }

static void station_point(const search *q, int32_t k, float p[3]) {
    hrt_copy(p, q->tip_m);
    hrt_add_scaled(p, (float)k * q->radius_m, q->axis);
}

static void place_faces(search *q) {
    for (int32_t f = 0; f < q->patch->triangle_count; f++) {
        float a[3], b[3];
        hrt_sub(vertex(q, f, 1), vertex(q, f, 0), a);
        hrt_sub(vertex(q, f, 2), vertex(q, f, 0), b);
        hrt_cross(a, b, q->area[f]);
        hrt_copy(q->normal[f], q->area[f]);
        const float size = fmaxf(hrt_dot(a, a), hrt_dot(b, b));
        if (unit(q->normal[f]) <= 1.0e-6f * size) hrt_scale(q->normal[f], 0.0f); /* crushed to a line */
    }
}

/* The transition across an edge is the same seen from both faces, so that their weights add up to one. The height of a triangle over its edge is
 * twice its area by the edge's length. */
static void place_edges(search *q) {
    for (uint8_t e = 0; e < q->t->edge_count; e++) {
        float edge[3], width = BLEND * q->radius_m;
        hrt_sub(&q->at[HRT_XYZ * q->t->edge_vertex[e][1]], &q->at[HRT_XYZ * q->t->edge_vertex[e][0]], edge);
        q->length_m[e] = fmaxf(hrt_length(edge), 1.0e-9f);
        for (int side = 0; side < 2; side++) {
            const uint8_t f = q->t->edge_face[e][side];
            if (f != HRT_NO_FACE) width = fminf(width, 0.25f * hrt_dot(q->area[f], q->normal[f]) / q->length_m[e]);
        }
        q->blend_m[e] = fmaxf(width, 1.0e-9f);
    }
}

/* Stations within `reach` of a point; false if none. */
static bool station_range(const search *q, const float centre[3], float reach, int32_t *first, int32_t *last) {
    float to[3];
    hrt_sub(centre, q->tip_m, to);
    const float along = hrt_dot(to, q->axis);
    const float chord2 = reach * reach - hrt_dot(to, to) + along * along;
    if (!(chord2 >= 0.0f)) return false;
    const float half = sqrtf(chord2), low = (along - half) / q->radius_m, high = (along + half) / q->radius_m;
    const float end = (float)(q->stations - 1);
    if (high < 0.0f || low > end) return false;
    *first = low > 0.0f ? (int32_t)low + ((float)(int32_t)low < low ? 1 : 0) : 0;
    *last = high < end ? (int32_t)high : q->stations - 1;
    return *first <= *last;
}

static void add_hit(search *q, int32_t station, uint8_t kind, int32_t index, float raw, float distance_m) {
    if (q->hits < HITS) q->hit[q->hits++] = (hit){(uint8_t)station, kind, (uint8_t)index, raw, distance_m};
}

/* In-plane unit vector of face f across its edge j, into the face. */
static void inward(const search *q, int32_t f, int j, float in[3]) {
    float edge[3];
    hrt_sub(vertex(q, f, (j + 1) % 3), vertex(q, f, j), edge);
    hrt_cross(q->normal[f], edge, in);
    hrt_scale(in, 1.0f / q->length_m[q->t->face_edge[f][j]]);
}

static int edge_slot(const search *q, int32_t f, uint8_t edge) {
    return q->t->face_edge[f][0] == edge ? 0 : q->t->face_edge[f][1] == edge ? 1 : 2;
}

/* Touched a corner of this face in the shape before. */
static bool known(const search *q, int32_t station, int32_t f) {
    for (int32_t i = 0; i < q->before_count; i++) {
        if (q->before[i].station != station || !(q->before[i].lambda_N > 0.0f)) continue;
        for (int j = 0; j < 9; j++)
            if (q->patch->triangle[3 * q->before[i].triangle + j / 3] == q->patch->triangle[3 * f + j % 3]) return true;
    }
    return false;
}

static void face_station(search *q, int32_t f, int32_t k, float height) {
    float p[3], d[3], in[3], raw = 1.0f, outside = 0.0f;
    station_point(q, k, p);
    for (int j = 0; j < 3 && raw > 0.0f; j++) {
        inward(q, f, j, in);
        hrt_sub(p, vertex(q, f, j), d);
        const float x = hrt_dot(d, in);
        raw *= ramp(x / q->blend_m[q->t->face_edge[f][j]]);
        outside = fmaxf(outside, -x);
    }
    if (!(raw > 0.0f)) return;
    if ((height < -SUNK * q->radius_m || (height < 0.0f && outside > 0.0f)) && !known(q, k, f)) return;
    add_hit(q, k, 0, f, raw, height > 0.0f ? sqrtf(height * height + outside * outside) : height);
}

static void face_hits(search *q, int32_t f) {
    float d[3];
    int32_t first, last;
    const float *a = vertex(q, f, 0), *b = vertex(q, f, 1), *c = vertex(q, f, 2);
    if (!(hrt_dot(q->normal[f], q->normal[f]) > 0.0f)) return;
    hrt_sub(q->tip_m, a, d);
    const float height = hrt_dot(d, q->normal[f]), step = q->radius_m * hrt_dot(q->axis, q->normal[f]);
    if (step > 0.0f ? height > q->reach_m : height < -q->sunk_m) return; /* and farther on from station to station */
    const float centre[3] = {(a[0] + b[0] + c[0]) / 3.0f, (a[1] + b[1] + c[1]) / 3.0f, (a[2] + b[2] + c[2]) / 3.0f};
    /* No corner is farther from the centre than two thirds of the longest edge; the transitions reach 0.75 of that beyond. */
    const uint8_t *edge = q->t->face_edge[f];
    const float wide = 1.17f * fmaxf(q->length_m[edge[0]], fmaxf(q->length_m[edge[1]], q->length_m[edge[2]])), high = fmaxf(q->reach_m, q->sunk_m);
    if (!station_range(q, centre, sqrtf(wide * wide + high * high), &first, &last)) return;
    for (int32_t k = first; k <= last; k++) {
        const float h = height + (float)k * step;
        if (h <= q->reach_m && h >= -q->sunk_m) face_station(q, f, k, h);
    }
}

/* 0 flat or hollow, 1 a fold that sticks out. */
static float edge_sharpness(const search *q, uint8_t e) {
    const uint8_t a = q->t->edge_face[e][0], b = q->t->edge_face[e][1];
    float in[3];
    if (b == HRT_NO_FACE) return 1.0f;
    inward(q, b, edge_slot(q, b, e), in);
    const float sine = -hrt_dot(q->normal[a], in);
    if (sine > 0.0f && hrt_dot(q->normal[a], q->normal[b]) < 0.0f) return 1.0f;
    return ramp(2.0f * sine / SHARP - 1.0f);
}

static void edge_station(search *q, uint8_t e, int32_t k, const float along[3], float length, float sharp, float width) {
    float p[3], d[3], in[3], out = 0.0f, raw = sharp;
    const float ends = fminf(BLEND * q->radius_m, 0.25f * length);
    station_point(q, k, p);
    hrt_sub(p, &q->at[HRT_XYZ * q->t->edge_vertex[e][0]], d);
    const float y = hrt_dot(d, along);
    hrt_add_scaled(d, -y, along);
    const float distance = hrt_length(d);
    if (distance > q->reach_m) return;
    raw *= ramp(y / ends) * ramp((length - y) / ends);
    for (int side = 0; side < 2 && raw > 0.0f; side++) {
        const uint8_t f = q->t->edge_face[e][side];
        if (f == HRT_NO_FACE) continue;
        inward(q, f, edge_slot(q, f, e), in);
        raw *= ramp(-hrt_dot(d, in) / width);
        out += hrt_dot(d, q->normal[f]);
    }
    if (raw > 0.0f && out > 0.0f) add_hit(q, k, 1, e, raw, distance);
}

static void edge_hits(search *q, uint8_t e) {
    const float *a = &q->at[HRT_XYZ * q->t->edge_vertex[e][0]], *b = &q->at[HRT_XYZ * q->t->edge_vertex[e][1]], length = q->length_m[e];
    float along[3], middle[3];
    int32_t first, last;
    hrt_sub(b, a, along);
    hrt_copy(middle, a);
    hrt_add_scaled(middle, 0.5f, along);
    if (!station_range(q, middle, 0.5f * length + q->reach_m, &first, &last)) return;
    const float sharp = edge_sharpness(q, e);
    if (!(sharp > 0.0f)) return;
    hrt_scale(along, 1.0f / length);
    for (int32_t k = first; k <= last; k++) edge_station(q, e, k, along, length, sharp, q->blend_m[e]);
}

/* Unit vector from vertex v along its i-th spoke; returns its length. */
static float spoke(const search *q, uint8_t v, int32_t i, float to[3]) {
    const uint8_t *ends = q->t->edge_vertex[q->t->spoke_edge[i]];
    hrt_sub(&q->at[HRT_XYZ * (ends[0] == v ? ends[1] : ends[0])], &q->at[HRT_XYZ * v], to);
    return unit(to);
}

static void vertex_hits(search *q, uint8_t v) {
    const hrt_patch_topology *t = q->t;
    const int32_t begin = t->spoke_begin[v], end = t->spoke_begin[v + 1];
    float up[3] = {0.0f, 0.0f, 0.0f}, sharp = 1.0f, to[3];
    int32_t first, last;
    if (!station_range(q, &q->at[HRT_XYZ * v], q->reach_m, &first, &last)) return;
    for (int32_t i = begin; i < end; i++)
        for (int side = 0; side < 2; side++) {
            const uint8_t f = t->edge_face[t->spoke_edge[i]][side];
            if (f != HRT_NO_FACE) hrt_add_scaled(up, 1.0f, q->normal[f]);
        }
    unit(up);
    for (int32_t i = begin; i < end && sharp > 0.0f; i++) {
        spoke(q, v, i, to);
        sharp = fminf(sharp, ramp(-2.0f * hrt_dot(to, up) / SHARP - 1.0f));
    }
    if (!(sharp > 0.0f)) return;
    for (int32_t k = first; k <= last; k++) {
        float p[3], raw = sharp;
        station_point(q, k, p);
        hrt_add_scaled(p, -1.0f, &q->at[HRT_XYZ * v]);
        const float distance = hrt_length(p);
        if (!(hrt_dot(p, up) > 0.0f) || distance > q->reach_m) continue;
        for (int32_t i = begin; i < end && raw > 0.0f; i++) {
            const float length = spoke(q, v, i, to);
            raw *= ramp(-hrt_dot(p, to) / fmaxf(fminf(BLEND * q->radius_m, 0.25f * length), 1.0e-9f));
        }
        if (raw > 0.0f) add_hit(q, k, 2, v, raw, distance);
    }
}

/* ---------------------------------------------------------------------------------------------- hits to rows */

/* Of the faces around corner j of face f, by area, as far as they belong to the same smooth surface; weighted and added to `sum`. */
static void add_corner_normal(const search *q, int32_t f, int j, float weight, float sum[3]) {
    const uint8_t v = q->patch->triangle[3 * f + j];
    float corner[3] = {0.0f, 0.0f, 0.0f};
    for (int32_t i = q->t->fan_begin[v]; i < q->t->fan_begin[v + 1]; i++) {
        const uint8_t g = q->t->fan_face[i];
        hrt_add_scaled(corner, (float)q->t->smooth[f][g] / 255.0f, q->area[g]);
    }
    unit(corner);
    hrt_add_scaled(sum, weight, corner);
}

static void face_row(const search *q, int32_t f, const float p[3], hrt_contact_row *row) {
    float edge[3], d[3], part[3], normal[3] = {0.0f, 0.0f, 0.0f}, sum = 0.0f;
    const float area2 = hrt_dot(q->area[f], q->area[f]);
    for (int j = 0; j < 3; j++) { /* areas of the parts, not below zero: a row never pulls on a vertex */
        hrt_sub(vertex(q, f, (j + 2) % 3), vertex(q, f, (j + 1) % 3), edge);
        hrt_sub(p, vertex(q, f, (j + 1) % 3), d);
        hrt_cross(edge, d, part);
        row->weight[j] = fmaxf(hrt_dot(part, q->area[f]) / area2, 0.0f);
        sum += row->weight[j];
    }
    for (int j = 0; j < 3; j++) {
        row->weight[j] /= sum;
        add_corner_normal(q, f, j, row->weight[j], normal);
    }
    /* A surface folded over itself: stay on the face's own side. */
    if (unit(normal) <= 0.1f || hrt_dot(normal, q->normal[f]) < 0.2f) hrt_copy(normal, q->normal[f]);
    for (int i = 0; i < 3; i++) row->normal[i] = -normal[i];
    hrt_sub(p, vertex(q, f, 0), d);
    row->gap_m = hrt_dot(d, q->normal[f]) - q->radius_m;
    row->triangle = (uint8_t)f;
    row->feature = 0;
}

static void edge_row(const search *q, uint8_t e, const float p[3], hrt_contact_row *row) {
    const uint8_t f = q->t->edge_face[e][0];
    const int j = edge_slot(q, f, e), k = (j + 1) % 3;
    float edge[3], d[3];
    hrt_sub(vertex(q, f, k), vertex(q, f, j), edge);
    hrt_sub(p, vertex(q, f, j), d);
    const float s = hrt_dot(d, edge) / hrt_dot(edge, edge);
    hrt_add_scaled(d, -s, edge);
    row->gap_m = unit(d) - q->radius_m;
    for (int i = 0; i < 3; i++) row->normal[i] = -d[i];
    row->weight[k] = hrt_clamp(s, 0.0f, 1.0f);
    row->weight[j] = 1.0f - row->weight[k];
    row->weight[(j + 2) % 3] = 0.0f;
    row->triangle = f;
    row->feature = (uint8_t)(1 + j);
}

static void vertex_row(const search *q, uint8_t v, const float p[3], hrt_contact_row *row) {
    const uint8_t f = q->t->fan_face[q->t->fan_begin[v]];
    float d[3];
    hrt_sub(p, &q->at[HRT_XYZ * v], d);
    row->gap_m = unit(d) - q->radius_m;
    row->triangle = f;
    for (int j = 0; j < 3; j++) {
        const bool here = q->patch->triangle[3 * f + j] == v;
        row->normal[j] = -d[j];
        row->weight[j] = here ? 1.0f : 0.0f;
        if (here) row->feature = (uint8_t)(4 + j);
    }
}

/* Keeps the deepest. */
static int32_t push_row(hrt_contact_row *row, int32_t count, const hrt_contact_row *candidate) {
    if (count < HRT_CONTACT_ROWS) {
        row[count] = *candidate;
        return count + 1;
    }
    int32_t shallow = 0;
    for (int32_t i = 1; i < count; i++)
        if (row[i].gap_m > row[shallow].gap_m) shallow = i;
    if (candidate->gap_m < row[shallow].gap_m) row[shallow] = *candidate;
    return count;
}

static int32_t station_rows(const search *q, uint8_t station, hrt_contact_row *row, int32_t count) {
    float nearest = 1.0e30f, total = 0.0f, weight[HITS];
    for (int32_t i = 0; i < q->hits; i++)
        if (q->hit[i].station == station) nearest = fminf(nearest, q->hit[i].distance_m);
    for (int32_t i = 0; i < q->hits; i++) {
        weight[i] = 0.0f;
        if (q->hit[i].station != station) continue;
        weight[i] = q->hit[i].raw * ramp(1.0f - 2.0f * (q->hit[i].distance_m - nearest) / (PROXIMITY * q->radius_m));
        total += weight[i];
    }
    for (int32_t i = 0; i < q->hits; i++) {
        hrt_contact_row new_row = {.station = station, .share = weight[i] / fmaxf(total, 1.0e-3f)};
        if (new_row.share < 1.0e-6f) continue;
        station_point(q, station, new_row.point_m);
        if (q->hit[i].kind == 0) face_row(q, q->hit[i].index, new_row.point_m, &new_row);
        else if (q->hit[i].kind == 1) edge_row(q, q->hit[i].index, new_row.point_m, &new_row);
        else vertex_row(q, q->hit[i].index, new_row.point_m, &new_row);
        if (new_row.gap_m <= MARGIN * q->radius_m) count = push_row(row, count, &new_row);
    }
    return count;
}

static void aim(search *q, const float tip_m[3]) {
    const float reach = hrt_length(tip_m);
    hrt_copy(q->tip_m, tip_m);
    hrt_copy(q->axis, tip_m);
    hrt_scale(q->axis, -1.0f / reach);
    const float stations = fminf(q->patch->contact_length_m, reach) / q->radius_m + 1.0e-4f;
    q->stations = stations < (float)(STATIONS - 1) ? (int32_t)stations + 1 : STATIONS;
}

int32_t hrt_contact_rows(const hrt_patch *patch, const float *shift_m, const float tip_m[3], const hrt_contact_row *before, int32_t before_count,
                         hrt_contact_row *row) {
    search q;
    q.patch = patch;
    q.t = &patch->topology;
    q.before = before;
    q.before_count = before_count;
    q.radius_m = patch->radius_m;
    q.reach_m = q.radius_m * (1.0f + PROXIMITY + MARGIN);
    q.sunk_m = SUNK * q.radius_m;
    q.hits = 0;
    for (int32_t i = 0; i < before_count; i++) /* it sinks little by little: looked for only when it has begun to */
        if (before[i].lambda_N > 0.0f && before[i].gap_m < -(0.7f + SUNK) * q.radius_m) q.sunk_m = SUNK_KNOWN * q.radius_m;
    aim(&q, tip_m);
    for (int32_t i = 0; i < 3 * patch->vertex_count; i++) q.at[i] = patch->vertex_m[i] + shift_m[i];
    place_faces(&q);
    place_edges(&q);
    for (int32_t f = 0; f < patch->triangle_count; f++) face_hits(&q, f);
    for (uint8_t e = 0; e < q.t->edge_count; e++) edge_hits(&q, e);
    for (uint8_t v = 0; v < patch->vertex_count; v++) vertex_hits(&q, v);
    int32_t count = 0, low = 0;
    while (low < STATIONS) { /* stations that were hit, in order */
        int32_t next = STATIONS;
        for (int32_t i = 0; i < q.hits; i++)
            if (q.hit[i].station >= low && q.hit[i].station < next) next = q.hit[i].station;
        if (next == STATIONS) break;
        count = station_rows(&q, (uint8_t)next, row, count);
        low = next + 1;
    }
    return count;
}
