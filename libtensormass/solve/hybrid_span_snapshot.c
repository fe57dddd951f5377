/* What a span keeps and a snapshot must hold: how far it is, what tools are followed by, the offsets of its rows (the
 * rows themselves are the on-line system's, "before"), and where condensed vertices around the tools were looked at. */
#include "hybrid.h"

#include <math.h>
#include <string.h>

typedef struct kept_span {
    int32_t age, limit, length, passed, row_count, use_count;
    int32_t kind[TM_MAX_INSTRUMENTS];
    double at_m[TM_MAX_INSTRUMENTS][6], room_m[TM_MAX_INSTRUMENTS], swell[TM_MAX_INSTRUMENTS],
        drift[TM_MAX_INSTRUMENTS], wandered_m;
} kept_span;

typedef struct kept_row {
    double offset_m;
    int64_t frozen;
} kept_row;

static int64_t bytes_of(const kept_span *k) {
    return (int64_t)sizeof *k + (int64_t)sizeof(kept_row) * k->row_count + 24 * (int64_t)k->use_count;
}

static kept_span pack(const tm_hybrid *h, bool forgotten) {
    const tms_span *s = h->span;
    kept_span k;
    memset(&k, 0, sizeof k);
    k.age = -1;
    k.limit = k.length = 1;
    if (!forgotten) k.wandered_m = h->local.wandered_m;
    if (forgotten || s->age < 0) return k;
    k.age = s->age;
    k.limit = s->limit;
    k.length = s->length;
    k.passed = s->passed;
    memcpy(k.swell, s->swell, sizeof k.swell);
    memcpy(k.drift, s->drift, sizeof k.drift);
    k.row_count = h->local.before_count;
    k.use_count = h->local.use_count;
    memcpy(k.kind, s->kind, sizeof k.kind);
    memcpy(k.at_m, s->at_m, sizeof k.at_m);
    memcpy(k.room_m, s->room_m, sizeof k.room_m);
    return k;
}

int64_t tms_span_snapshot(const tm_hybrid *h, bool forgotten, void *buffer) {
    const kept_span k = pack(h, forgotten);
    const tms_local *l = &h->local;
    if (!buffer) return bytes_of(&k);
    char *to = memcpy(buffer, &k, sizeof k);
    to += sizeof k;
    for (int32_t i = 0; i < k.row_count; i++, to += sizeof(kept_row)) {
        const kept_row row = {h->span->offset_m[i], h->span->frozen[i]};
        memcpy(to, &row, sizeof row);
    }
    for (int32_t i = 0; i < k.use_count; i++, to += 24) memcpy(to, l->u_m + 3 * (int64_t)l->vertex[l->use[i]], 24);
    return bytes_of(&k);
}

int64_t tms_span_snapshot_most(const tm_hybrid *h) {
    const kept_span most = {.row_count = TMS_SPAN_ROWS, .use_count = h->local.capacity};
    return bytes_of(&most);
}

static bool fits(const tm_hybrid *h, const kept_span *k) {
    bool good = k->age >= -1 && k->age < TMS_SPAN_MOST && k->limit >= 1 && k->limit <= TMS_SPAN_MOST &&
                k->length >= 1 && k->length <= TMS_SPAN_MOST && k->row_count >= 0 && k->row_count <= TMS_SPAN_ROWS &&
                k->use_count >= 0 && k->use_count <= h->local.capacity && (k->passed == 0 || k->passed == 1) &&
                isfinite(k->wandered_m);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) {
        good = good && k->kind[t] >= TMS_TOOL_FROZEN && k->kind[t] <= TMS_TOOL_NONE && isfinite(k->room_m[t]) &&
               isfinite(k->swell[t]) && isfinite(k->drift[t]);
        for (int c = 0; c < 6; c++) good = good && isfinite(k->at_m[t][c]);
    }
    return good;
}

int64_t tms_span_snapshot_bytes(const tm_hybrid *h, const void *buffer, int64_t bytes) {
    kept_span k;
    if (bytes < (int64_t)sizeof k) return -1;
    memcpy(&k, buffer, sizeof k);
    if (!fits(h, &k) || bytes < bytes_of(&k)) return -1;
    const char *at = (const char *)buffer + sizeof k;
    for (int64_t i = 0; i < 2 * k.row_count + 3 * (int64_t)k.use_count; i++, at += 8) {
        kept_row row; /* offsets, and marks in their turn */
        double value;
        memcpy(&value, at, 8);
        memcpy(&row.frozen, at, 8);
        const bool mark = i < 2 * k.row_count && i % 2 == 1;
        if (mark ? row.frozen < -1 || row.frozen >= k.row_count : !isfinite(value)) return -1;
    }
    return bytes_of(&k);
}

/* Every row's vertices have slots and are of the parts that it may be on; each of the frozen ones is there once. */
static bool rows_stand(const tm_hybrid *h) {
    const tms_span *s = h->span;
    const tms_local *l = &h->local;
    int32_t next = 0;
    for (int32_t i = 0; i < l->before_count; i++) {
        const tm_contact_row *row = &l->before[i];
        const bool frozen = s->kind[row->instrument] == TMS_TOOL_FROZEN;
        if (s->frozen[i] != (frozen ? next++ : -1)) return false;
        for (int k = 0; k < 3; k++)
            if (l->slot_of[row->vertex[k]] < 0 ||
                (row->weight[k] != 0 && h->part[row->vertex[k]] == (frozen ? TMS_DYNAMIC : TMS_CONDENSED)))
                return false;
    }
    return true;
}

void tms_span_restore(tm_hybrid *h, const void *buffer) {
    kept_span k;
    tms_span *s = h->span;
    tms_local *l = &h->local;
    memcpy(&k, buffer, sizeof k);
    tms_span_forget(h);
    l->wandered_m = k.wandered_m;
    if (k.age < 0 || k.row_count != l->before_count || k.use_count != l->use_count) return;
    const char *from = (const char *)buffer + sizeof k;
    for (int32_t i = 0; i < k.row_count; i++, from += sizeof(kept_row)) {
        kept_row row;
        memcpy(&row, from, sizeof row);
        s->offset_m[i] = row.offset_m;
        s->frozen[i] = (int32_t)row.frozen;
    }
    memcpy(s->kind, k.kind, sizeof s->kind);
    memcpy(s->at_m, k.at_m, sizeof s->at_m);
    memcpy(s->room_m, k.room_m, sizeof s->room_m);
    if (!rows_stand(h)) return;
    for (int32_t i = 0; i < k.use_count; i++, from += 24) memcpy(l->u_m + 3 * (int64_t)l->vertex[l->use[i]], from, 24);
    memcpy(s->swell, k.swell, sizeof s->swell);
    memcpy(s->drift, k.drift, sizeof s->drift);
    s->passed = k.passed != 0;
    s->age = k.age;
    s->limit = k.limit;
    s->length = k.length;
    tms_span_make(h);
}
