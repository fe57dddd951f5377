/* Reuse state in a snapshot: age of the interval, treatment of tools, offsets of the rows (the rows themselves are in
 * the contact solver, `previous`), and the gathered positions of condensed vertices around the tools. */
#include "hybrid.h"

#include <math.h>
#include <string.h>

typedef struct saved_reuse {
    int32_t age, limit, length, passed, row_count, used_count;
    int32_t kind[TM_MAX_INSTRUMENTS];
    double at_m[TM_MAX_INSTRUMENTS][6], margin_m[TM_MAX_INSTRUMENTS], predicted_growth[TM_MAX_INSTRUMENTS],
        last_growth[TM_MAX_INSTRUMENTS], wandered_m;
    tms_hybrid_passivity passivity;
} saved_reuse;

typedef struct saved_row {
    double offset_m;
    int64_t frozen;
} saved_row;

static int64_t bytes_of(const saved_reuse *k) {
    return (int64_t)sizeof *k + (int64_t)sizeof(saved_row) * k->row_count + 24 * (int64_t)k->used_count;
}

static saved_reuse pack(const tm_hybrid *h, bool forgotten) {
    const tms_contact_reuse *s = h->reuse;
    saved_reuse k;
    memset(&k, 0, sizeof k);
    k.age = -1;
    k.limit = k.length = 1;
    k.passivity = h->passivity;
    if (!forgotten) k.wandered_m = h->solver_contact.wandered_m;
    if (forgotten || s->age < 0) return k;
    k.age = s->age;
    k.limit = s->limit;
    k.length = s->length;
    k.passed = s->passed;
    memcpy(k.predicted_growth, s->predicted_growth, sizeof k.predicted_growth);
    memcpy(k.last_growth, s->last_growth, sizeof k.last_growth);
    k.row_count = h->solver_contact.previous_count;
    k.used_count = h->solver_contact.used_count;
    memcpy(k.kind, s->kind, sizeof k.kind);
    memcpy(k.at_m, s->at_m, sizeof k.at_m);
    memcpy(k.margin_m, s->margin_m, sizeof k.margin_m);
    return k;
}

int64_t tms_contact_reuse_snapshot(const tm_hybrid *h, bool forgotten, void *buffer) {
    const saved_reuse k = pack(h, forgotten);
    const tms_contact_solver *l = &h->solver_contact;
    if (!buffer) return bytes_of(&k);
    char *to = memcpy(buffer, &k, sizeof k);
    to += sizeof k;
    for (int32_t i = 0; i < k.row_count; i++, to += sizeof(saved_row)) {
        const saved_row row = {h->reuse->offset_m[i], h->reuse->frozen[i]};
        memcpy(to, &row, sizeof row);
    }
    for (int32_t i = 0; i < k.used_count; i++, to += 24) memcpy(to, l->u_m + 3 * (int64_t)l->vertex[l->used[i]], 24);
    return bytes_of(&k);
}

int64_t tms_contact_reuse_snapshot_max(const tm_hybrid *h) {
    const saved_reuse most = {.row_count = TMS_REUSE_ROWS, .used_count = h->solver_contact.capacity};
    return bytes_of(&most);
}

static bool fits(const tm_hybrid *h, const saved_reuse *k) {
    bool good = k->age >= -1 && k->age < TMS_REUSE_MAX && k->limit >= 1 && k->limit <= TMS_REUSE_MAX &&
                k->length >= 1 && k->length <= TMS_REUSE_MAX && k->row_count >= 0 && k->row_count <= TMS_REUSE_ROWS &&
                k->used_count >= 0 && k->used_count <= h->solver_contact.capacity &&
                (k->passed == 0 || k->passed == 1) && isfinite(k->wandered_m) &&
                tms_are_below(k->passivity.was_m, sizeof k->passivity.was_m / 8, 1e6) &&
                tms_are_below(k->passivity.strained_J, 4 + LAW_LEDGER, 1e12);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) {
        good = good && k->kind[t] >= TMS_TOOL_FROZEN && k->kind[t] <= TMS_TOOL_NONE && isfinite(k->margin_m[t]) &&
               isfinite(k->predicted_growth[t]) && isfinite(k->last_growth[t]);
        for (int c = 0; c < 6; c++) good = good && isfinite(k->at_m[t][c]);
    }
    return good;
}

int64_t tms_contact_reuse_snapshot_bytes(const tm_hybrid *h, const void *buffer, int64_t bytes) {
    saved_reuse k;
    if (bytes < (int64_t)sizeof k) return -1;
    memcpy(&k, buffer, sizeof k);
    if (!fits(h, &k) || bytes < bytes_of(&k)) return -1;
    const char *at = (const char *)buffer + sizeof k;
    for (int64_t i = 0; i < 2 * k.row_count + 3 * (int64_t)k.used_count; i++, at += 8) {
        saved_row row; /* offsets, alternating with marks */
        double value;
        memcpy(&value, at, 8);
        memcpy(&row.frozen, at, 8);
        const bool mark = i < 2 * k.row_count && i % 2 == 1;
        if (mark ? row.frozen < -1 || row.frozen >= k.row_count : !isfinite(value)) return -1;
    }
    return bytes_of(&k);
}

/* Returns whether all vertices of rows have slots and are in a permitted part, and each frozen row occurs once. */
static bool rows_stand(const tm_hybrid *h) {
    const tms_contact_reuse *s = h->reuse;
    const tms_contact_solver *l = &h->solver_contact;
    int32_t next = 0;
    for (int32_t i = 0; i < l->previous_count; i++) {
        const tm_contact_row *row = &l->previous[i];
        const bool frozen = s->kind[row->instrument] == TMS_TOOL_FROZEN;
        if (s->frozen[i] != (frozen ? next++ : -1)) return false;
        for (int k = 0; k < 3; k++)
            if (l->slot_of[row->vertex[k]] < 0 ||
                (row->weight[k] != 0 && h->vertex_kind[row->vertex[k]] == (frozen ? TMS_DYNAMIC : TMS_CONDENSED)))
                return false;
    }
    return true;
}

void tms_contact_reuse_restore(tm_hybrid *h, const void *buffer) {
    saved_reuse k;
    tms_contact_reuse *s = h->reuse;
    tms_contact_solver *l = &h->solver_contact;
    memcpy(&k, buffer, sizeof k);
    tms_contact_reuse_forget(h);
    l->wandered_m = k.wandered_m;
    h->passivity = k.passivity;
    if (k.age < 0 || k.row_count != l->previous_count || k.used_count != l->used_count) return;
    const char *from = (const char *)buffer + sizeof k;
    for (int32_t i = 0; i < k.row_count; i++, from += sizeof(saved_row)) {
        saved_row row;
        memcpy(&row, from, sizeof row);
        s->offset_m[i] = row.offset_m;
        s->frozen[i] = (int32_t)row.frozen;
    }
    memcpy(s->kind, k.kind, sizeof s->kind);
    memcpy(s->at_m, k.at_m, sizeof s->at_m);
    memcpy(s->margin_m, k.margin_m, sizeof s->margin_m);
    if (!rows_stand(h)) return;
    for (int32_t i = 0; i < k.used_count; i++, from += 24)
        memcpy(l->u_m + 3 * (int64_t)l->vertex[l->used[i]], from, 24);
    memcpy(s->predicted_growth, k.predicted_growth, sizeof s->predicted_growth);
    memcpy(s->last_growth, k.last_growth, sizeof s->last_growth);
    s->passed = k.passed != 0;
    s->age = k.age;
    s->limit = k.limit;
    s->length = k.length;
    tms_contact_reuse_build(h);
}
