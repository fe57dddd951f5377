/* Narrow phase: stations of the tool's axis against faces, edges and vertices of the surface.
 *
 * A sphere over a triangulated plane must feel the plane and not the triangles, and its force must change without a
 * jump when its closest feature changes. So a feature is not simply in or out: it has a weight that runs smoothly from
 * 0 to 1 across the borders of its Voronoi region, edges and vertices count as far as they stick out, and the weights
 * of a station are normalised to shares of the one skin that the station has. And the normal of a face is blended from
 * those of its neighbours, as far as the undeformed surface is smooth there: a dent is as faceted as its triangles are
 * few, and with their own normals the force would click from one to the next. docs/contact.md, "Rows". */
#include <string.h>

#include "base/vec.h"
#include "contact/contact_internal.h"

#define BLEND 0.2      /* half width of the transition between neighbouring features, in tool radii */
#define PROXIMITY 0.4  /* a feature that much (radii) farther than the nearest has no share */
#define SHARP 0.25     /* sine of the fold from which an edge or a vertex counts fully */
#define SUNK 0.5       /* a station may be that far (radii) behind a face that it does not know from the step before */
#define SUNK_KNOWN 8.0 /* and that far behind one that it does */
#define MIN_RAW 1e-3
#define SMOOTH_COSINE 0.766 /* normals blend fully across rest folds up to 40 degrees, */
#define CREASE_COSINE 0.342 /* and not at all from 70 */
#include "law/feature.h"

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

/* One search: the capsule with what it is looked at against. */
typedef struct search {
    const tm_local_surface *s;
    const tm_capsule *capsule;
    const tm_contact_row *history;
    int32_t history_count;
    double axis[3];
    int32_t stations;
    double reach_m;
    double sunk_m; /* how far behind a face a station may be */
    tm_hits *hits;
} search;

/* Stations whose spheres, widened to reach, can touch a ball; false if none. */
static bool station_range(const search *q, const double center[3], double radius, int32_t *first, int32_t *last) {
    double to[3], across[3];
    vsub(center, q->capsule->tip_m, to);
    double along = vdot(to, q->axis), reach = radius + q->reach_m;
    vmadd(to, -along, q->axis, across);
    double chord2 = reach * reach - vdot(across, across);
    if (!(chord2 >= 0)) return false;
    double half = sqrt(chord2), step = q->capsule->radius_m;
    if (!(along + half >= 0 && along - half <= step * (q->stations - 1)))
        return false; /* and the casts below are in range, wherever the surface was thrown */
    *first = (int32_t)ceil(law_max((along - half) / step, 0));
    *last = (int32_t)floor(law_min((along + half) / step, q->stations - 1));
    return *first <= *last;
}

static void add_hit(search *q, int32_t station, int32_t kind, int32_t index, double raw, double distance) {
    if (q->hits->count == TM_LOCAL_HITS) {
        q->hits->overflowed = true;
        return;
    }
    q->hits->hit[q->hits->count++] = (tm_hit){station, kind, index, raw, distance};
}

/* In-plane unit vector of face f, across its edge j, into the face; the vertex opposite is `altitude` away. */
static double inward(const tm_local_surface *s, int32_t f, int j, double out[3]) {
    const double *a = s->position_m[s->face_vertex[f][j]], *b = s->position_m[s->face_vertex[f][(j + 1) % 3]];
    double edge[3], apex[3];
    vsub(b, a, edge);
    vcross(s->normal[f], edge, out);
    vunit(out, out);
    vsub(s->position_m[s->face_vertex[f][(j + 2) % 3]], a, apex);
    return vdot(apex, out);
}

static int edge_slot(const tm_local_surface *s, int32_t f, int32_t edge) {
    return s->face_edge[f][0] == edge ? 0 : s->face_edge[f][1] == edge ? 1 : 2;
}

/* Half width of the transition across an edge: the same seen from both faces, so that their weights add up to one. */
static double edge_blend(const search *q, int32_t edge) {
    double width = LAW_BLEND * q->capsule->radius_m, in[3];
    for (int k = 0; k < 2; k++) {
        int32_t f = q->s->edge_face[edge][k];
        if (f >= 0)
            width = law_min(width, law_transition(q->capsule->radius_m, inward(q->s, f, edge_slot(q->s, f, edge), in)));
    }
    return law_max(width, 1e-9);
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

static void face_hits(search *q, int32_t f) {
    const tm_local_surface *s = q->s;
    double in[3][3], width[3], radius = q->capsule->radius_m;
    int32_t first, last;
    if (vdot(s->normal[f], s->normal[f]) == 0 ||
        !station_range(q, s->center_m[f], s->reach_m[f] + q->sunk_m, &first, &last))
        return;
    for (int j = 0; j < 3; j++) {
        inward(s, f, j, in[j]);
        width[j] = edge_blend(q, s->face_edge[f][j]);
    }
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3], raw = 1, outside = 0;
        tm_capsule_station(q->capsule, k, p);
        vsub(p, s->position_m[s->face_vertex[f][0]], d);
        double height = vdot(d, s->normal[f]);
        if (height > q->reach_m || height < -q->sunk_m) continue;
        for (int j = 0; j < 3 && raw > 0; j++) {
            vsub(p, s->position_m[s->face_vertex[f][j]], d);
            double x = vdot(d, in[j]);
            raw *= law_ramp(x / width[j]);
            outside = law_max(outside, -x);
        }
        if (raw <= 0) continue;
        if (law_wants_history(height, outside, radius) && !known(q, k, f)) continue;
        add_hit(q, k, 0, f, raw, height > 0 ? sqrt(height * height + outside * outside) : height);
    }
}

/* 0 flat or hollow, 1 a fold that sticks out by SHARP or more. */
static double edge_sharpness(const tm_local_surface *s, int32_t e) {
    int32_t a = s->edge_face[e][0], b = s->edge_face[e][1];
    double in[3];
    if (b < 0) return 1;
    inward(s, b, edge_slot(s, b, e), in);
    double sine = -vdot(s->normal[a], in);
    if (sine > 0 && vdot(s->normal[a], s->normal[b]) < 0) return 1;
    return law_sharpness(sine);
}

static void edge_hits(search *q, int32_t e) {
    const tm_local_surface *s = q->s;
    const double *a = s->position_m[s->edge_vertex[e][0]], *b = s->position_m[s->edge_vertex[e][1]];
    double middle[3], edge[3], unit[3];
    int32_t first, last;
    vsub(b, a, edge);
    vmadd(a, 0.5, edge, middle);
    double length = vunit(edge, unit);
    if (length <= 0 || !station_range(q, middle, 0.5 * length, &first, &last)) return;
    double sharp = edge_sharpness(s, e);
    if (sharp <= 0) return;
    double width = edge_blend(q, e), along_width = law_transition(q->capsule->radius_m, length);
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3], across[3], in[3], out = 0, raw = sharp;
        tm_capsule_station(q->capsule, k, p);
        vsub(p, a, d);
        double y = vdot(d, unit);
        vmadd(d, -y, unit, across);
        double distance = vnorm(across);
        if (distance > q->reach_m) continue;
        raw *= law_ramp(y / along_width) * law_ramp((length - y) / along_width);
        for (int side = 0; side < 2 && raw > 0; side++) {
            int32_t f = s->edge_face[e][side];
            if (f < 0) continue;
            inward(s, f, edge_slot(s, f, e), in);
            raw *= law_ramp(-vdot(across, in) / width);
            out += vdot(across, s->normal[f]);
        }
        if (raw > 0 && out > 0) add_hit(q, k, 1, e, raw, distance);
    }
}

static void vertex_hits(search *q, int32_t v) {
    const tm_local_surface *s = q->s;
    const double *at = s->position_m[v];
    double up[3] = {0, 0, 0}, sharp = 1, spoke[3];
    int32_t first, last, begin = s->vertex_edge_begin[v], end = s->vertex_edge_begin[v + 1];
    if (!station_range(q, at, 0, &first, &last)) return;
    for (int32_t i = begin; i < end; i++)
        for (int side = 0; side < 2; side++)
            if (s->edge_face[s->vertex_edge[i]][side] >= 0)
                vmadd(up, 1, s->normal[s->edge_face[s->vertex_edge[i]][side]], up);
    vunit(up, up);
    for (int32_t i = begin; i < end && sharp > 0; i++) {
        const int32_t *ends = s->edge_vertex[s->vertex_edge[i]];
        vsub(s->position_m[ends[0] == v ? ends[1] : ends[0]], at, spoke);
        vunit(spoke, spoke);
        sharp = law_min(sharp, law_sharpness(-vdot(spoke, up)));
    }
    if (sharp <= 0) return;
    for (int32_t k = first; k <= last; k++) {
        double p[3], d[3], raw = sharp;
        tm_capsule_station(q->capsule, k, p);
        vsub(p, at, d);
        if (vdot(d, up) <= 0 || vnorm(d) > q->reach_m) continue;
        for (int32_t i = begin; i < end && raw > 0; i++) {
            const int32_t *ends = s->edge_vertex[s->vertex_edge[i]];
            vsub(s->position_m[ends[0] == v ? ends[1] : ends[0]], at, spoke);
            double length = vunit(spoke, spoke);
            raw *= law_ramp(-vdot(d, spoke) / law_max(law_transition(q->capsule->radius_m, length), 1e-9));
        }
        if (raw > 0) add_hit(q, k, 2, v, raw, vnorm(d));
    }
}

/* Hits by station, in the order they were found within one. */
static void sort_hits(tm_hits *hits, int32_t stations) {
    memset(hits->begin, 0, sizeof(int32_t) * (size_t)(stations + 1));
    for (int32_t i = 0; i < hits->count; i++) hits->begin[hits->hit[i].station + 1]++;
    for (int32_t k = 0; k < stations; k++) hits->begin[k + 1] += hits->begin[k];
    for (int32_t i = hits->count - 1; i >= 0; i--) hits->order[--hits->begin[hits->hit[i].station + 1]] = i;
    for (int32_t k = 0; k < stations; k++) hits->begin[k] = hits->begin[k + 1];
    hits->begin[stations] = hits->count;
}

/* Normal at a corner of face f: of the faces around the vertex, by area, as far as they belong to the same smooth
 * surface. */
static void corner_normal(const tm_local_surface *s, int32_t f, int32_t v, double out[3]) {
    double sum[3] = {0, 0, 0};
    for (int32_t i = s->vertex_edge_begin[v]; i < s->vertex_edge_begin[v + 1]; i++)
        for (int side = 0; side < 2; side++) {
            int32_t g = s->edge_face[s->vertex_edge[i]][side];
            if (g < 0) continue;
            vmadd(sum, law_smooth(vdot(s->rest_normal[f], s->rest_normal[g])), s->area_normal[g], sum);
        }
    vunit(sum, out);
}

static void blended_normal(const tm_local_surface *s, int32_t f, const double weight[3], double out[3]) {
    double sum[3] = {0, 0, 0}, corner[3];
    for (int j = 0; j < 3; j++) {
        corner_normal(s, f, s->face_vertex[f][j], corner);
        vmadd(sum, weight[j], corner, sum);
    }
    /* a surface folded over itself: stay on the face's own side */
    const double length = vunit(sum, out);
    if (!law_normal_stands(length, vdot(out, s->normal[f]))) vset(s->normal[f], out);
}

static void face_row(const tm_local_surface *s, int32_t f, const double p[3], tm_contact_row *row) {
    const double *x[3];
    double a[3], b[3], d[3], total[3], part[3], sum = 0;
    for (int j = 0; j < 3; j++) x[j] = s->position_m[s->face_vertex[f][j]];
    vsub(x[1], x[0], a);
    vsub(x[2], x[0], b);
    vcross(a, b, total);
    double area2 = vdot(total, total);
    for (int j = 0; j < 3; j++) { /* sub-triangle areas, not below zero: a row never pulls on a vertex */
        vsub(x[(j + 2) % 3], x[(j + 1) % 3], a);
        vsub(p, x[(j + 1) % 3], d);
        vcross(a, d, part);
        row->weight[j] = law_max(vdot(part, total) / area2, 0);
        sum += row->weight[j];
    }
    for (int j = 0; j < 3; j++) row->weight[j] /= sum;
    blended_normal(s, f, row->weight, row->normal);
    vscale(-1, row->normal, row->normal);
    vsub(p, x[0], d);
    row->gap_m = vdot(d, s->normal[f]);
    row->feature = TM_FEATURE_FACE;
}

static void edge_row(const tm_local_surface *s, int32_t e, const double p[3], tm_contact_row *row) {
    int32_t f = s->edge_face[e][0];
    int j = edge_slot(s, f, e), k = (j + 1) % 3;
    double edge[3], d[3];
    const double *a = s->position_m[s->face_vertex[f][j]], *b = s->position_m[s->face_vertex[f][k]];
    vsub(b, a, edge);
    vsub(p, a, d);
    double t = vdot(d, edge) / vdot(edge, edge);
    vmadd(d, -t, edge, d);
    row->gap_m = vunit(d, d);
    vscale(-1, d, row->normal);
    row->weight[k] = law_clamp(t, 0, 1);
    row->weight[j] = 1 - row->weight[k];
    row->weight[(j + 2) % 3] = 0;
    row->feature = TM_FEATURE_EDGE + j;
}

static void vertex_row(const tm_local_surface *s, int32_t v, const double p[3], tm_contact_row *row) {
    int32_t f = s->vertex_face[v];
    double d[3];
    vsub(p, s->position_m[v], d);
    row->gap_m = vunit(d, d);
    vscale(-1, d, row->normal);
    for (int j = 0; j < 3; j++) {
        row->weight[j] = s->face_vertex[f][j] == v;
        if (s->face_vertex[f][j] == v) row->feature = TM_FEATURE_VERTEX + j;
    }
}

static void make_row(const search *q, const tm_hit *hit, double share, tm_contact_row *row) {
    const tm_local_surface *s = q->s;
    int32_t f = hit->kind == 0 ? hit->index : hit->kind == 1 ? s->edge_face[hit->index][0] : s->vertex_face[hit->index];
    double p[3];
    tm_capsule_station(q->capsule, hit->station, p);
    if (hit->kind == 0)
        face_row(s, hit->index, p, row);
    else if (hit->kind == 1)
        edge_row(s, hit->index, p, row);
    else
        vertex_row(s, hit->index, p, row);
    row->face = s->face_id[f];
    for (int j = 0; j < 3; j++) row->vertex[j] = s->vertex_id[s->face_vertex[f][j]];
    row->instrument = q->capsule->instrument;
    row->station = hit->station;
    row->share = share;
    vset(p, row->point_m);
    row->gap_m -= q->capsule->radius_m;
    row->lambda_N = 0;
}

/* Keeps the rows in order but, when there are too many, drops the shallowest. */
static int32_t push_row(tm_contact_row *row, int32_t count, int32_t max_rows, const tm_contact_row *new_row,
                        bool *overflowed) {
    if (count < max_rows) {
        row[count] = *new_row;
        return count + 1;
    }
    *overflowed = true;
    int32_t shallow = 0;
    for (int32_t i = 1; i < count; i++)
        if (row[i].gap_m > row[shallow].gap_m) shallow = i;
    if (count == 0 || row[shallow].gap_m <= new_row->gap_m) return count;
    memmove(row + shallow, row + shallow + 1, sizeof *row * (size_t)(count - 1 - shallow));
    row[count - 1] = *new_row;
    return count;
}

static bool row_before(const tm_contact_row *a, const tm_contact_row *b) {
    return a->face != b->face ? a->face < b->face : a->feature < b->feature;
}

static int32_t station_rows(const search *q, int32_t k, double margin_m, tm_contact_row *row, int32_t count,
                            int32_t max_rows, bool *overflowed) {
    const tm_hits *hits = q->hits;
    int32_t begin = hits->begin[k], end = hits->begin[k + 1], first = count;
    double nearest = INFINITY, total = 0, weight[64];
    if (end - begin > 64) {
        end = begin + 64;
        *overflowed = true;
    }
    for (int32_t i = begin; i < end; i++) nearest = law_min(nearest, hits->hit[hits->order[i]].distance_m);
    for (int32_t i = begin; i < end; i++) {
        const tm_hit *hit = hits->hit + hits->order[i];
        weight[i - begin] = hit->raw * law_nearness(hit->distance_m, nearest, q->capsule->radius_m);
        total += weight[i - begin];
    }
    for (int32_t i = begin; i < end; i++) {
        tm_contact_row new_row;
        double share = law_share(weight[i - begin], total);
        if (share < LAW_MIN_SHARE) continue;
        make_row(q, hits->hit + hits->order[i], share, &new_row);
        if (new_row.gap_m <= margin_m) count = push_row(row, count, max_rows, &new_row, overflowed);
    }
    for (int32_t i = first + 1; i < count; i++) { /* a handful: insertion sort */
        tm_contact_row moving = row[i];
        int32_t j = i;
        for (; j > first && row[j - 1].station == moving.station && row_before(&moving, row + j - 1); j--)
            row[j] = row[j - 1];
        row[j] = moving;
    }
    return count;
}

int32_t tm_local_rows(const tm_local_surface *surface, tm_hits *hits, const tm_capsule *capsule, double margin_m,
                      const tm_contact_row *history, int32_t history_count, tm_contact_row *row, int32_t max_rows,
                      bool *overflowed) {
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
    for (int32_t f = 0; f < surface->face_count; f++) face_hits(&q, f);
    for (int32_t e = 0; e < surface->edge_count; e++) edge_hits(&q, e);
    for (int32_t v = 0; v < surface->vertex_count; v++) vertex_hits(&q, v);
    sort_hits(hits, q.stations);
    int32_t count = 0;
    *overflowed = surface->overflowed || hits->overflowed;
    for (int32_t k = 0; k < q.stations; k++) count = station_rows(&q, k, margin_m, row, count, max_rows, overflowed);
    return count;
}

int32_t tm_contact_find(const double *rest_m, const double *u_m, const int32_t *triangle, const int32_t *face,
                        const int32_t *candidate, int32_t candidate_count, const tm_capsule *capsule, double margin_m,
                        tm_contact_row *row, int32_t max_rows, bool *overflowed) {
    TM_REQUIRE(rest_m && u_m && triangle && face && capsule && candidate_count >= 0 && row && max_rows >= 0,
               "something is null, or a count is negative", 0);
    TM_REQUIRE(capsule->radius_m > 0, "the capsule's radius is not positive", 0);
    tm_local_surface surface;
    tm_hits hits;
    bool too_many;
    surface.edge_m = 0;
    tm_local_gather(&surface, rest_m, u_m, triangle, face, candidate, candidate_count, capsule,
                    capsule->radius_m * (1 + LAW_PROXIMITY) + margin_m);
    tm_local_place(&surface, rest_m, u_m);
    const int32_t count = tm_local_rows(&surface, &hits, capsule, margin_m, NULL, 0, row, max_rows, &too_many);
    if (overflowed && too_many) *overflowed = true;
    return count;
}

/* --- gathered once --- */

struct tm_contact_search {
    tm_pool pool;
    tm_local_surface surface;
    tm_hits hits;
};

tm_status tm_contact_search_create(tm_contact_search **made, tm_error *error) {
    TM_REQUIRE(made, "search is null", TM_ERR_ARGUMENT);
    tm_pool pool = {0};
    tm_contact_search *self = TM_TAKE(&pool, tm_contact_search, 1);
    if (!self) return tm_fail_memory(error, "search around a tool");
    self->pool = pool;
    *made = self;
    return TM_OK;
}

void tm_contact_search_destroy(tm_contact_search *self) {
    if (!self) return;
    tm_pool pool = self->pool;
    tm_pool_release(&pool);
}

bool tm_contact_search_gather(tm_contact_search *self, const double *rest_m, const double *u_m,
                              const tm_surface_view *surface, const tm_capsule *capsule, double reach_m) {
    TM_REQUIRE(self && rest_m && surface && capsule && (surface->count == 0 || (surface->triangle && surface->face)),
               "search, rest_m, surface or capsule is null", false);
    tm_local_gather(&self->surface, rest_m, u_m, surface->triangle, surface->face, NULL, surface->count, capsule,
                    reach_m);
    return !self->surface.overflowed;
}

int32_t tm_contact_search_vertices(const tm_contact_search *self, const int32_t **vertex) {
    TM_REQUIRE(self && vertex, "search or vertex is null", 0);
    *vertex = self->surface.vertex_id;
    return self->surface.vertex_count;
}

int32_t tm_contact_search_faces(const tm_contact_search *self, const int32_t **face, double *edge_m) {
    TM_REQUIRE(self && face && edge_m, "search, face or edge_m is null", 0);
    *face = self->surface.face_id;
    *edge_m = self->surface.edge_m;
    return self->surface.face_count;
}

static bool is_listed(const int32_t *face, int32_t count, int32_t wanted) {
    int32_t low = 0;
    while (low < count) {
        const int32_t middle = (low + count) / 2;
        if (face[middle] < wanted)
            low = middle + 1;
        else
            count = middle;
    }
    return face[low] == wanted;
}

bool tm_contact_search_take(tm_contact_search *self, const double *rest_m, const tm_surface_view *surface,
                            const int32_t *face, int32_t count, double edge_m) {
    TM_REQUIRE(self && rest_m && surface && (face || count <= 0), "search, rest_m, surface or face is null", false);
    const tm_capsule anywhere = {.radius_m = 1};
    int32_t slot[TM_LOCAL_FACES + 1], found = 0;
    if (count < 0 || count > TM_LOCAL_FACES) count = 0;
    for (int32_t i = 0; i < surface->count && count > 0 && found < count; i++)
        if (surface->face[i] <= face[count - 1] && is_listed(face, count, surface->face[i])) slot[found++] = i;
    const bool all = found == count;
    tm_local_gather(&self->surface, rest_m, NULL, surface->triangle, surface->face, slot, all ? found : 0, &anywhere,
                    1e9);
    self->surface.edge_m = edge_m;
    return all;
}

int32_t tm_contact_search_rows(tm_contact_search *self, const double *rest_m, const double *u_m,
                               const tm_capsule *capsule, double margin_m, const tm_contact_row *before,
                               int32_t before_count, tm_contact_row *row, int32_t max_rows, bool *overflowed) {
    TM_REQUIRE(self && rest_m && u_m && capsule && overflowed, "search, rest_m, u_m, capsule or overflowed is null", 0);
    TM_REQUIRE((before || before_count <= 0) && (row || max_rows <= 0), "before or row is null", 0);
    tm_local_place(&self->surface, rest_m, u_m);
    return tm_local_rows(&self->surface, &self->hits, capsule, margin_m, before, before_count, row, max_rows,
                         overflowed);
}
