/* State of the online contact solver between solves, for a snapshot: forces, slots, pairs of the secant steps, previous
 * rows and the gathered neighbourhood. Compliances are recomputed: they do not depend on the order of requests. */
#include "contact/row_snapshot.h"
#include "contact_solver.h"

#include <math.h>
#include <string.h>

typedef struct saved_tool {
    double tip_m[3], tail_m[3], edge_m;
    int32_t near, overflowed, face_count, reserved;
} saved_tool;

typedef struct saved {
    int32_t tool_count, high, used_count, previous_count, pair_count, pair_next, gathered_age, reserved;
    saved_tool tool[TM_MAX_INSTRUMENTS];
} saved;

static size_t even(int32_t count) { return 4 * (size_t)(count + count % 2); }

static int64_t bytes_of(const saved *k) {
    size_t bytes = sizeof *k + even(k->high) + even(k->used_count) + 24 * (size_t)k->high * (1 + 2 * TMS_PAIRS) +
                   sizeof(tm_packed_row) * (size_t)k->previous_count;
    for (int32_t t = 0; t < k->tool_count; t++) bytes += even(k->tool[t].face_count);
    return (int64_t)bytes;
}

/* Copies, or only counts if there is no buffer. */
static char *put(char *to, const void *from, size_t bytes, size_t room) {
    memcpy(to, from, bytes);
    memset(to + bytes, 0, room - bytes);
    return to + room;
}

static saved pack(const tms_contact_solver *l, bool forgotten) {
    saved k;
    memset(&k, 0, sizeof k);
    k.tool_count = l->tool_count;
    k.previous_count = l->previous_count;
    k.gathered_age = l->gather_every;
    if (forgotten) return k;
    k.high = l->high;
    k.used_count = l->used_count;
    k.pair_count = l->pair_count;
    k.pair_next = l->pair_next;
    k.gathered_age = l->gathered_age;
    for (int32_t t = 0; t < l->tool_count; t++) {
        const tms_tool *tool = &l->tool[t];
        const int32_t *face;
        memcpy(k.tool[t].tip_m, tool->gathered_at.tip_m, 24);
        memcpy(k.tool[t].tail_m, tool->gathered_at.tail_m, 24);
        k.tool[t].near = tool->near;
        k.tool[t].overflowed = tool->overflowed;
        k.tool[t].face_count = tm_contact_search_faces(tool->search, &face, &k.tool[t].edge_m);
    }
    return k;
}

static char *put_rows(char *to, const tms_contact_solver *l) {
    for (int32_t i = 0; i < l->previous_count; i++) {
        const tm_packed_row r = tm_row_pack(&l->previous[i]);
        to = put(to, &r, sizeof r, sizeof r);
    }
    return to;
}

int64_t tms_contact_solver_snapshot(const tms_contact_solver *l, bool forgotten, void *buffer) {
    const saved k = pack(l, forgotten);
    if (!buffer) return bytes_of(&k);
    const size_t forces = 24 * (size_t)k.high;
    char *to = put(buffer, &k, sizeof k, sizeof k);
    to = put(to, l->vertex, 4 * (size_t)k.high, even(k.high));
    to = put(to, l->used, 4 * (size_t)k.used_count, even(k.used_count));
    to = put(to, l->f, forces, forces);
    for (int i = 0; i < TMS_PAIRS; i++) {
        to = put(to, l->pair_f[i], forces, forces);
        to = put(to, l->pair_r[i], forces, forces);
    }
    to = put_rows(to, l);
    for (int32_t t = 0; t < l->tool_count; t++) {
        const int32_t *face;
        double unused;
        tm_contact_search_faces(l->tool[t].search, &face, &unused);
        to = put(to, face, 4 * (size_t)k.tool[t].face_count, even(k.tool[t].face_count));
    }
    return bytes_of(&k);
}

/* --- restore --- */

/* Reads `count` different numbers below `limit`. */
static bool distinct(tms_contact_solver *l, const char *from, int32_t count, int32_t limit) {
    l->stamp_now++;
    for (int32_t i = 0; i < count; i++) {
        int32_t at;
        memcpy(&at, from + 4 * (size_t)i, 4);
        if (at < 0 || at >= limit || l->stamp[at] == l->stamp_now) return false;
        l->stamp[at] = l->stamp_now;
    }
    return true;
}

static bool rows_fit(const tms_contact_solver *l, const char *from, int32_t count) {
    for (int32_t i = 0; i < count; i++, from += sizeof(tm_packed_row)) {
        tm_packed_row r;
        memcpy(&r, from, sizeof r);
        bool fits = tms_are_below(from, offsetof(tm_packed_row, face) / 8, INFINITY) && r.share > 0 && r.share <= 1 &&
                    r.face >= 0 && r.face < 4 * l->mesh->tet_count && r.instrument >= 0 &&
                    r.instrument < l->tool_count && r.station >= 0 && r.station < 256 && r.feature >= 0 &&
                    r.feature < 7;
        for (int j = 0; j < 3; j++) fits = fits && r.vertex[j] >= 0 && r.vertex[j] < l->mesh->vertex_count;
        if (!fits) return false;
    }
    return true;
}

static bool head_fits(const tms_contact_solver *l, const saved *k) {
    bool fits = k->tool_count == l->tool_count && k->high >= 0 && k->high <= l->capacity && k->used_count >= 0 &&
                k->used_count <= k->high && k->previous_count >= 0 && k->previous_count <= l->def.max_rows &&
                k->pair_count >= 0 && k->pair_count <= TMS_PAIRS && k->pair_next >= 0 && k->pair_next < TMS_PAIRS &&
                k->gathered_age >= 0;
    for (int32_t t = 0; fits && t < k->tool_count; t++)
        fits = k->tool[t].face_count >= 0 && k->tool[t].face_count <= 1024 &&
               tms_are_below((const char *)&k->tool[t], offsetof(saved_tool, near) / 8, INFINITY);
    return fits;
}

/* Start of each part. */
typedef struct parts {
    const char *vertex, *use, *force, *row, *face;
} parts;

static parts find_parts(const saved *k, const void *buffer) {
    parts p;
    p.vertex = (const char *)buffer + sizeof *k;
    p.use = p.vertex + even(k->high);
    p.force = p.use + even(k->used_count);
    p.row = p.force + 24 * (size_t)k->high * (1 + 2 * TMS_PAIRS);
    p.face = p.row + sizeof(tm_packed_row) * (size_t)k->previous_count;
    return p;
}

static void take_rows(tms_contact_solver *l, const char *from, int32_t count) {
    l->previous_count = count;
    for (int32_t i = 0; i < count; i++, from += sizeof(tm_packed_row)) {
        tm_packed_row r;
        memcpy(&r, from, sizeof r);
        l->previous[i] = tm_row_unpack(&r);
    }
}

/* Returns false if a face is missing; all must then be gathered again. */
static bool take_tools(tms_contact_solver *l, const saved *k, const char *from) {
    bool all = true;
    for (int32_t t = 0; t < k->tool_count; t++) {
        const saved_tool *kept_here = &k->tool[t];
        tms_tool *tool = &l->tool[t];
        int32_t face[1024];
        memcpy(face, from, 4 * (size_t)kept_here->face_count);
        from += even(kept_here->face_count);
        tool->gathered_at = tool->capsule;
        memcpy(tool->gathered_at.tip_m, kept_here->tip_m, 24);
        memcpy(tool->gathered_at.tail_m, kept_here->tail_m, 24);
        tool->near = kept_here->near != 0;
        tool->overflowed = kept_here->overflowed != 0;
        all = tm_contact_search_restore(tool->search, l->mesh->rest_m, &l->surface, face, kept_here->face_count,
                                        kept_here->edge_m) &&
              all;
    }
    return all;
}

bool tms_contact_solver_restore(tms_contact_solver *l, const void *buffer, int64_t bytes, bool apply) {
    saved k;
    if (bytes < (int64_t)sizeof k) return false;
    memcpy(&k, buffer, sizeof k);
    if (!head_fits(l, &k) || bytes != bytes_of(&k)) return false;
    const parts p = find_parts(&k, buffer);
    if (!distinct(l, p.vertex, k.high, l->mesh->vertex_count) || !distinct(l, p.use, k.used_count, k.high) ||
        !tms_are_below(p.force, 3 * (size_t)k.high * (1 + 2 * TMS_PAIRS), INFINITY) ||
        !rows_fit(l, p.row, k.previous_count))
        return false;
    if (!apply) return true;
    const size_t forces = 24 * (size_t)k.high;
    tms_contact_solver_forget(l);
    take_rows(l, p.row, k.previous_count);
    if (!take_tools(l, &k, p.face)) return true;
    for (int32_t s = 0; s < k.high; s++) {
        int32_t vertex;
        memcpy(&vertex, p.vertex + 4 * (size_t)s, 4);
        tms_contact_solver_fill(l, s, vertex);
    }
    memcpy(l->used, p.use, 4 * (size_t)k.used_count);
    memcpy(l->f, p.force, forces);
    for (int i = 0; i < TMS_PAIRS; i++) {
        memcpy(l->pair_f[i], p.force + forces * (size_t)(1 + 2 * i), forces);
        memcpy(l->pair_r[i], p.force + forces * (size_t)(2 + 2 * i), forces);
    }
    l->used_count = k.used_count;
    for (int32_t i = 0; i < k.used_count; i++) l->list[i] = l->vertex[l->used[i]];
    l->pair_count = k.pair_count;
    l->pair_next = k.pair_next;
    l->gathered_age = k.gathered_age;
    return true;
}

int64_t tms_contact_solver_snapshot_max(const tms_contact_solver *l) {
    saved k = {
        .tool_count = l->tool_count, .high = l->capacity, .used_count = l->capacity, .previous_count = l->def.max_rows};
    for (int32_t t = 0; t < l->tool_count; t++) k.tool[t].face_count = 1024;
    return bytes_of(&k);
}
