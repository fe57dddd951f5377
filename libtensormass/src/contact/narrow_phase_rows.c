/* Narrow phase, second part: rows from the features near the stations (narrow_phase_features.c). */
#include <string.h>

#include "base/vec.h"
#include "contact/contact_internal.h"
#include "contact_law/feature.h"

/* Computes the normal at a corner of face f: area-weighted over the faces around the vertex that belong to the same
 * smooth surface. */
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
    /* surface folded over itself: use the face's own normal */
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
    for (int j = 0; j < 3; j++) { /* sub-triangle areas, clamped at zero: a row never pulls on a vertex */
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
    int j = tm_local_edge_slot(s, f, e), k = (j + 1) % 3;
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

static void make_row(const tm_local_surface *s, const tm_capsule *capsule, const tm_hit *hit, double share,
                     tm_contact_row *row) {
    int32_t f = hit->kind == 0 ? hit->index : hit->kind == 1 ? s->edge_face[hit->index][0] : s->vertex_face[hit->index];
    double p[3];
    tm_capsule_station(capsule, hit->station, p);
    if (hit->kind == 0)
        face_row(s, hit->index, p, row);
    else if (hit->kind == 1)
        edge_row(s, hit->index, p, row);
    else
        vertex_row(s, hit->index, p, row);
    row->face = s->face_id[f];
    for (int j = 0; j < 3; j++) row->vertex[j] = s->vertex_id[s->face_vertex[f][j]];
    row->instrument = capsule->instrument;
    row->station = hit->station;
    row->share = share;
    vset(p, row->point_m);
    row->gap_m -= capsule->radius_m;
    row->lambda_N = 0;
}

/* Inserts a row in order; beyond the capacity the shallowest is dropped. */
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

static int32_t station_rows(const tm_local_surface *s, const tm_capsule *capsule, const tm_hits *hits, int32_t k,
                            double margin_m, tm_contact_row *row, int32_t count, int32_t max_rows, bool *overflowed) {
    int32_t begin = hits->begin[k], end = hits->begin[k + 1], first = count;
    double nearest = INFINITY, total = 0, weight[64];
    if (end - begin > 64) {
        end = begin + 64;
        *overflowed = true;
    }
    for (int32_t i = begin; i < end; i++) nearest = law_min(nearest, hits->hit[hits->order[i]].distance_m);
    for (int32_t i = begin; i < end; i++) {
        const tm_hit *hit = hits->hit + hits->order[i];
        weight[i - begin] = hit->raw * law_nearness(hit->distance_m, nearest, capsule->radius_m);
        total += weight[i - begin];
    }
    for (int32_t i = begin; i < end; i++) {
        tm_contact_row new_row;
        double share = law_share(weight[i - begin], total);
        if (share < LAW_MIN_SHARE) continue;
        make_row(s, capsule, hits->hit + hits->order[i], share, &new_row);
        if (new_row.gap_m <= margin_m) count = push_row(row, count, max_rows, &new_row, overflowed);
    }
    for (int32_t i = first + 1; i < count; i++) { /* few elements: insertion sort */
        tm_contact_row moving = row[i];
        int32_t j = i;
        for (; j > first && row[j - 1].station == moving.station && row_before(&moving, row + j - 1); j--)
            row[j] = row[j - 1];
        row[j] = moving;
    }
    return count;
}

int32_t tm_local_rows(tm_local_surface *surface, tm_hits *hits, const tm_capsule *capsule, double margin_m,
                      const tm_contact_row *history, int32_t history_count, tm_contact_row *row, int32_t max_rows,
                      bool *overflowed) {
    tm_local_hits(surface, hits, capsule, margin_m, history, history_count);
    int32_t count = 0;
    *overflowed = surface->overflowed || hits->overflowed;
    const int32_t stations = tm_capsule_stations(capsule);
    for (int32_t k = 0; k < stations; k++)
        count = station_rows(surface, capsule, hits, k, margin_m, row, count, max_rows, overflowed);
    return count;
}
