/* Builds batches from a tissue, and lists those that must be checked. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "material/material_internal.h"

static bool has_fibre(const tm_material_field *field, int32_t tet) {
    return !tm_material_is_isotropic(tm_field_material(field, tet));
}

static bool batch_has_fibre(const tm_material_field *field, tm_tet_span span) {
    bool any = false;
    for (int32_t t = span.tet; t < tm_tet_span_end(span); t++) any = any || has_fibre(field, t);
    return any;
}

static const tm_material *law_of(const tm_material_field *field, int32_t tet) {
    return field->smoothed ? field->smoothed->remainder + field->mesh->region[tet] : tm_field_material(field, tet);
}

static void fill(const tm_material_field *field, int32_t tet, tm_tet_batch *batch, int l) {
    const tm_mesh *mesh = field->mesh;
    const tm_material *m = law_of(field, tet);
    const double volume = mesh->volume_m3[tet];
    for (int k = 0; k < 4; k++) batch->component[k][l] = 3 * mesh->tet[4 * (int64_t)tet + k];
    for (int i = 0; i < 9; i++) batch->shape_1_m[i][l] = mesh->shape_1_m[12 * (int64_t)tet + 3 + i];
    batch->mu_J[l] = volume * m->mu_Pa;
    batch->lambda_J[l] = volume * m->lambda_Pa;
}

static void fill_fibre(const tm_material_field *field, int32_t tet, tm_fibre_batch *batch, int l) {
    const tm_material *m = tm_field_material(field, tet);
    const double volume = field->mesh->volume_m3[tet], *a = tm_field_fibre(field, tet);
    batch->dlambda_J[l] = volume * m->dlambda_Pa;
    batch->dmu_J[l] = volume * m->dmu_Pa;
    batch->beta_J[l] = volume * m->beta_Pa;
    for (int i = 0; i < 3; i++) batch->fibre[i][l] = a ? a[i] : 0;
}

/* Divides the ranges, each from its begin on. Returns null without memory. */
static tm_tet_span *take_spans(const tm_ranges *ranges, tm_pool *pool, int32_t *count) {
    *count = 0;
    for (int32_t i = 0; i < ranges->count; i++)
        *count += (ranges->end[2 * i + 1] - ranges->end[2 * i] + TM_LANES - 1) / TM_LANES;
    tm_tet_span *span = TM_ALLOC(pool, tm_tet_span, *count);
    for (int32_t i = 0, p = 0; span && i < ranges->count; i++)
        for (int32_t t = ranges->end[2 * i]; t < ranges->end[2 * i + 1]; t += TM_LANES)
            span[p++] = (tm_tet_span){t, ranges->end[2 * i + 1]};
    return span;
}

bool tm_tet_batches_init(tm_tet_batches *batches, tm_pool *pool, const tm_material_field *field) {
    tm_material_field all = *field;
    if (!(field->rotation > 0)) all.effects = NULL;
    return tm_tet_batches_init_where(batches, pool, &all, TM_REGION_ROTATION);
}

bool tm_tet_batches_init_where(tm_tet_batches *batches, tm_pool *pool, const tm_material_field *field, int effects) {
    int32_t fibred = 0, count = 0;
    tm_ranges ranges;
    const tm_tet_span *span =
        tm_effect_tets(&ranges, pool, field, effects, 0) ? take_spans(&ranges, pool, &count) : NULL;
    for (int32_t p = 0; span && p < count; p++) fibred += batch_has_fibre(field, span[p]);
    tm_tet_batch *batch = TM_ALLOC(pool, tm_tet_batch, count);
    tm_fibre_batch *fibre_pack = fibred ? TM_ALLOC(pool, tm_fibre_batch, fibred) : NULL;
    int32_t *fibred_of = fibred ? TM_ALLOC(pool, int32_t, count) : NULL;
    if (pool->failed) return false;
    for (int32_t p = 0, at = 0; p < count; p++) {
        const bool has = fibred && batch_has_fibre(field, span[p]);
        if (fibred_of) fibred_of[p] = has ? at : -1;
        for (int32_t t = span[p].tet; t < tm_tet_span_end(span[p]); t++) {
            fill(field, t, batch + p, t - span[p].tet);
            if (has) fill_fibre(field, t, fibre_pack + at, t - span[p].tet);
        }
        at += has;
    }
    const double begin = field->rotation, end = TM_ROTATION_BAND * begin;
    *batches = (tm_tet_batches){.mesh = field->mesh,
                                .count = count,
                                .tet_count = field->mesh->tet_count,
                                .span = span,
                                .alive = field->alive,
                                .batch = batch,
                                .fibred = fibre_pack,
                                .fibred_of = fibred_of,
                                .begin_1_2 = begin * begin,
                                .width_1_2 = end * end - begin * begin};
    return true;
}

int64_t tm_tet_slot(const tm_tet_batches *batches, int32_t tet) {
    int32_t low = 0, high = batches->count; /* the last batch that begins at `tet` or before */
    while (high - low > 1) {
        const int32_t middle = low + (high - low) / 2;
        *(batches->span[middle].tet <= tet ? &low : &high) = middle;
    }
    if (low == high || tet < batches->span[low].tet || tet >= tm_tet_span_end(batches->span[low])) return -1;
    return TM_LANES * (int64_t)low + tet - batches->span[low].tet;
}

/* Index of the corner forces on each vertex, in the order of mesh->vertex_tet. */
void tm_packs_corners(const tm_tet_batches *batches, int32_t *place) {
    const tm_mesh *mesh = batches->mesh;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t tet = mesh->vertex_tet[i], slot = (int32_t)tm_tet_slot(batches, tet);
            int k = 0;
            if (slot < 0) continue;
            while (mesh->tet[4 * (int64_t)tet + k] != v) k++;
            place[i] = TM_LANES * (12 * (slot / TM_LANES) + 3 * k) + slot % TM_LANES;
        }
}

/* --- which batches to check --- */

double tm_tet_batch_spread(const tm_tet_batches *batches, int32_t p) {
    const tm_mesh *mesh = batches->mesh;
    double most = 0;
    for (int32_t t = batches->span[p].tet; t < tm_tet_span_end(batches->span[p]); t++) {
        double sum = 0;
        for (int k = 0; k < 4; k++) {
            const double *alpha = mesh->shape_1_m + 12 * (int64_t)t + 3 * k;
            sum += sqrt(vdot(alpha, alpha));
        }
        most = fmax(most, sqrt(3.0) * sum);
    }
    return most;
}

/* Returns the largest |grad u| of the batch's tetrahedra, removed ones included; these never come back within a
 * step. */
static double steepest(const tm_tet_batches *batches, int32_t p, const double *u) {
    const tm_mesh *mesh = batches->mesh;
    double most = 0;
    for (int32_t t = batches->span[p].tet; t < tm_tet_span_end(batches->span[p]); t++) {
        const int32_t *v = mesh->tet + 4 * (int64_t)t;
        const double *alpha = mesh->shape_1_m + 12 * (int64_t)t;
        double H[9] = {0}, s = 0;
        for (int k = 1; k < 4; k++)
            for (int i = 0; i < 9; i++)
                H[i] += (u[3 * (int64_t)v[k] + i / 3] - u[3 * (int64_t)v[0] + i / 3]) * alpha[3 * k + i % 3];
        for (int i = 0; i < 9; i++) s += H[i] * H[i];
        if (!(s <= most)) most = s; /* NaN: check it */
    }
    return sqrt(most);
}

/* tm_ranges_next in components of displacement. */
static bool next_components(const tm_ranges *where, int32_t *i, int32_t first, int32_t last, int32_t *begin,
                            int32_t *end) {
    int32_t from, to;
    if (!tm_ranges_next(where, i, first / 3, (last + 2) / 3, &from, &to)) return false;
    *begin = 3 * from > first ? 3 * from : first;
    *end = 3 * to < last ? 3 * to : last;
    return true;
}

void tm_tet_batches_mark_seen(tm_rotation *r, const double *u, int32_t partition, int32_t parts) {
    const int32_t n = 3 * r->batches.mesh->vertex_count, first = tm_tet_batches_before(n, partition, parts),
                  last = tm_tet_batches_before(n, partition + 1, parts);
    for (int32_t i = 0, begin, end; next_components(&r->where, &i, first, last, &begin, &end);)
        memcpy(r->seen_m + begin, u + begin, sizeof(double) * (size_t)(end - begin));
    for (int32_t p = tm_tet_batches_before(r->batches.count, partition, parts);
         p < tm_tet_batches_before(r->batches.count, partition + 1, parts); p++) {
        const double margin = 1e-9 + r->rounding_m * r->spread_1_m[p];
        const double reach = (r->threshold * (1 - margin) - steepest(&r->batches, p, u)) / r->spread_1_m[p];
        r->reach_m[p] = r->relaxes && r->relaxes[p] ? HUGE_VAL : reach > 0 ? reach : 0;
    }
}

void tm_tet_batches_seen(tm_rotation *r) {
    r->seen = true;
    r->idle = 0;
    r->listed_m = -1;
}

/* Returns the largest change of a component since `seen_m`; infinite where a number is not finite. */
static double way(const double *TM_RESTRICT u, const double *TM_RESTRICT seen, int32_t n) {
    double most[8] = {0};
    int32_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int l = 0; l < 8; l++) {
            const double d = u[i + l] - seen[i + l], size = d < 0 ? -d : d;
            most[l] = size > most[l] ? size : most[l];
        }
    for (; i < n; i++) most[0] = fmax(most[0], fabs(u[i] - seen[i]));
    for (int l = 1; l < 8; l++) most[0] = fmax(most[0], most[l]);
    return most[0];
}

double tm_tet_batches_increment(const tm_rotation *r, const double *u, int32_t partition, int32_t parts) {
    const int32_t n = 3 * r->batches.mesh->vertex_count, first = tm_tet_batches_before(n, partition, parts),
                  last = tm_tet_batches_before(n, partition + 1, parts);
    double most = 0;
    for (int32_t i = 0, begin, end; next_components(&r->where, &i, first, last, &begin, &end);)
        most = fmax(most, way(u + begin, r->seen_m + begin, end - begin));
    return most;
}

/* Returns whether batches checked without result have cost as much as a new reference state: at most twice the cost of
 * the best choice. */
bool tm_tet_batches_wait(const tm_rotation *r) { return !r->seen || r->idle > r->batches.count; }

void tm_tet_batches_list(tm_rotation *r, double way_m) {
    if (way_m < r->listed_m) return;
    /* For some steps ahead; the list only grows until the next reference state. */
    r->listed_m = 2 * way_m;
    int32_t count = 0;
    bool changed = false;
    for (int32_t p = 0; p < r->batches.count; p++) {
        if (!(r->reach_m[p] <= r->listed_m)) continue;
        changed |= count >= r->list_count || r->list[count] != p;
        r->list[count++] = p;
    }
    r->listing += changed || count != r->list_count;
    r->list_count = count;
}
