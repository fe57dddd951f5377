/* `contact`: a small model of the tissue at the hand. A patch of the surface with its compliance; in every tick the
 * tool's rows are found anew against the patch as the reactions of the last tick deform it, 0 <= gap + skin _|_ lambda
 * >= 0 is solved by branches from those reactions, and both once more. */
#include "vector.h"

enum { ROUNDS = 2, BRANCHES = 4, WIDTH = HRT_CONTACT_ROWS + 1 };
_Static_assert(ROUNDS % 2 == 0, "the last round's rows are to end up in the extrapolation");
_Static_assert(HRT_PATCH_MAX_VERTICES <= 32, "a bit a vertex");
/* The skin gives way up to this share of the radius and a twentieth as easily beyond (docs/contact.md). */
static const float SKIN_TRAVEL = 0.3f, SKIN_HARDENING = 20.0f;
static const float LITTLE = 0.1f; /* change of the forces, squared */

typedef struct solve {
    const hrt_patch *patch;
    int32_t rows;
    hrt_contact_row *row,
        other[HRT_CONTACT_ROWS];   /* of this round; its rows, or, from round to round in turn, the extrapolation's */
    float soft_m;                  /* as far as the skin is soft */
    float *force_N;                /* f: what the shape is made with */
    float shift_m[HRT_PATCH_DOFS]; /* C f; then what one row does; at the tip's place the hold */
    uint32_t coupled;              /* bit i: line i of w is there */
    float w[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS]; /* compliance between rows */
    int32_t load_count;
    uint8_t loaded[HRT_CONTACT_ROWS]; /* rows that bear */
    float gap_m[HRT_CONTACT_ROWS];    /* without forces, at the row's geometry */
    float skin_m_N[HRT_CONTACT_ROWS];
    int32_t touched;
    uint8_t vertex[HRT_PATCH_MAX_VERTICES]; /* that rows have touched, of this round or before */
    float residual_N[HRT_PATCH_DOFS];       /* what the rows make of that shape, less f; at touched vertices */
    float before_N[HRT_PATCH_DOFS], before_residual_N[HRT_PATCH_DOFS]; /* f and the residual of the round before */
} solve;

static inline __attribute__((always_inline)) hrt_v3 at(const float *list, int32_t v) {
    return hrt_get(&list[HRT_XYZ * v]);
}
static inline __attribute__((always_inline)) void put(float *list, int32_t v, hrt_v3 x) {
    hrt_put(x, &list[HRT_XYZ * v]);
}

/* shift[a] := the sum of C_ab x over `count` places b, of which C's upper triangle is there. */
static __attribute__((noinline)) void respond(const hrt_patch *patch, uint32_t a, const uint8_t *b, const hrt_v3 *x,
                                              int32_t count, float *shift_m) {
    const uint32_t n = 3u * (uint32_t)hrt_patch_places(patch);
    hrt_v3 sum = {0.0f, 0.0f, 0.0f};
    for (; count > 0; count--, b++, x++) {
        const uint32_t i = 3u * (a < *b ? a : *b), j = 3u * (a + *b) - i, after = n - i - 1u;
        const float *p = &patch->compliance_m_N[i * (n + after) / 2u + j], *q = p + after, *r = q + after - 1;
        const hrt_v3 u = hrt_get(p);
        hrt_v3 v = hrt_get(q), w = hrt_get(r);
        if (a == *b) v.x = u.y, w.x = u.z, w.y = v.z;
        if (a > *b)
            sum = hrt_plus(hrt_plus(hrt_plus(sum, hrt_times(x->x, u)), hrt_times(x->y, v)), hrt_times(x->z, w));
        else
            sum = hrt_plus(sum, (hrt_v3){hrt_inner(u, *x), hrt_inner(v, *x), hrt_inner(w, *x)});
    }
    put(shift_m, (int32_t)a, sum);
}

static const uint8_t *corners(const solve *s, const hrt_contact_row *row) {
    return &s->patch->triangle[HRT_XYZ * row->triangle];
}

static bool is_coupled(const solve *s, int32_t i) { return (s->coupled >> i & 1u) != 0; }

/* To the vertices that bear rows which are not coupled yet. */
static void respond_under_rows(solve *s, const uint8_t *from, const hrt_v3 *x, int32_t count) {
    uint32_t under = 0;
    for (int32_t j = 0; j < s->rows; j++)
        for (int k = 0; k < 3 && !is_coupled(s, j); k++) under |= 1u << corners(s, &s->row[j])[k];
    for (int32_t v = 0; v < s->patch->vertex_count; v++)
        if ((under >> v & 1u) != 0) respond(s->patch, (uint32_t)v, from, x, count, s->shift_m);
}

/* What the forces do to the vertices and, with the tip, what its motion since the sample does to those of a hold; there
 * the tip's own place gets what the hold pulls with more than at the sample. Without the tip forces alone, under the
 * rows. */
static void shift_by_forces(solve *s, const float *tip_m) {
    hrt_v3 force[HRT_PATCH_MAX_VERTICES];
    uint8_t from[HRT_PATCH_MAX_VERTICES];
    int32_t count = 0;
    for (int32_t i = 0; i < s->touched; i++) {
        from[count] = s->vertex[i];
        force[count] = at(s->force_N, s->vertex[i]);
        if (hrt_inner(force[count], force[count]) > 0.0f) count++;
    }
    if (!tip_m) {
        respond_under_rows(s, from, force, count);
        return;
    }
    if (hrt_patch_holds(s->patch)) {
        from[count] = (uint8_t)s->patch->vertex_count;
        force[count++] = hrt_minus(hrt_get(tip_m), at(s->patch->vertex_m, s->patch->vertex_count));
    }
    for (int32_t a = 0; a < hrt_patch_places(s->patch); a++)
        respond(s->patch, (uint32_t)a, from, force, count, s->shift_m);
}

static float along_row(const solve *s, const hrt_contact_row *row) {
    const uint8_t *corner = corners(s, row);
    hrt_v3 shift = {0.0f, 0.0f, 0.0f};
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) shift = hrt_plus(shift, hrt_times(row->weight[k], at(s->shift_m, corner[k])));
    return hrt_inner(hrt_get(row->normal), shift);
}

/* What one newton in row i does along all rows; along those that have been coupled before it is what theirs does along
 * it. */
static void couple(solve *s, int32_t i) {
    const hrt_contact_row *row = &s->row[i];
    uint8_t from[3];
    hrt_v3 newton[3];
    int32_t count = 0;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) {
            from[count] = corners(s, row)[k];
            newton[count++] = hrt_times(row->weight[k], hrt_get(row->normal));
        }
    respond_under_rows(s, from, newton, count);
    for (int32_t j = 0; j < s->rows; j++) s->w[i][j] = is_coupled(s, j) ? s->w[j][i] : along_row(s, &s->row[j]);
    s->coupled |= 1u << i;
}

static void find_rows(solve *s, const float tip_m[3], hrt_hits *hits, hrt_contact_row *row) {
    const hrt_contact_row *before = s->row;
    const int32_t count = s->rows;
    s->rows = hrt_contact_rows(s->patch, s->shift_m, tip_m, before, count, hits, row);
    s->row = row;
    s->coupled = 0;
    if (hrt_patch_holds(s->patch)) shift_by_forces(s, NULL);
    for (int32_t r = 0; r < s->rows; r++, row++) {
        for (int32_t b = 0; b < count; b++)
            if (before[b].station == row->station && before[b].triangle == row->triangle &&
                before[b].feature == row->feature)
                row->lambda_N = before[b].lambda_N;
        s->gap_m[r] = row->gap_m - along_row(s, row);
        s->skin_m_N[r] = s->patch->skin_compliance_m_N / row->share;
    }
}

/* --- the unilateral problem of one set of rows --- */

/* Which branch of its skin a row is in. Sweeps over rows would need hundreds: the tissue gives way far more than the
 * skin, and neighbours all feel the same tissue. By branches it is a small symmetric positive definite system, and the
 * branches of the last tick nearly always hold. */
typedef enum branch { OFF, SOFT, HARD, CAPPED } branch;

static bool stands(branch b) { return b == SOFT || b == HARD; }

/* gap + W lambda + depth(lambda) of row i. */
static float row_error(const solve *s, int32_t i) {
    const float straight = s->skin_m_N[i] * s->row[i].lambda_N;
    float error =
        s->gap_m[i] + (straight <= s->soft_m ? straight : s->soft_m + (straight - s->soft_m) / SKIN_HARDENING);
    for (int32_t k = 0; k < s->load_count; k++) error += s->w[s->loaded[k]][i] * s->row[s->loaded[k]].lambda_N;
    return error;
}

/* a x = a[][n], symmetric: the upper triangle alone is read and written. x comes back in a[][n]. */
static __attribute__((noinline)) void eliminate(float a[][WIDTH], int32_t n) {
    for (int32_t k = 0; k < n; k++) {
        const float inverse = a[k][k] > 1.0e-12f ? 1.0f / a[k][k] : 0.0f;
        for (int32_t i = k + 1; i < n; i++) {
            const float factor = a[k][i] * inverse;
            float *to = &a[i][i];
            const float *from = &a[k][i], *end = &a[k][n];
            do *to++ -= factor * *from;
            while (++from <= end);
        }
    }
    for (int32_t k = n - 1; k >= 0; k--) {
        float sum = a[k][n];
        for (int32_t j = k + 1; j < n; j++) sum -= a[k][j] * a[j][n];
        a[k][n] = a[k][k] > 1.0e-12f ? sum / a[k][k] : 0.0f;
    }
}

static void load(solve *s, int32_t i, float lambda_N) {
    s->row[i].lambda_N = lambda_N;
    s->loaded[s->load_count++] = (uint8_t)i;
    if (!is_coupled(s, i)) couple(s, i);
}

static void solve_branches(solve *s, const branch state[HRT_CONTACT_ROWS]) {
    float a[HRT_CONTACT_ROWS][WIDTH];
    s->load_count = 0;
    for (int32_t i = 0; i < s->rows; i++) {
        s->row[i].lambda_N = 0.0f;
        if (stands(state[i])) load(s, i, 0.0f);
    }
    const int32_t n = s->load_count;
    for (int32_t i = 0; i < s->rows; i++)
        if (state[i] == CAPPED) load(s, i, s->patch->force_cap_N);
    for (int32_t r = 0; r < n; r++) {
        const int32_t i = s->loaded[r];
        const bool soft = state[i] == SOFT;
        for (int32_t c = r; c < n; c++) a[r][c] = s->w[i][s->loaded[c]];
        a[r][r] += soft ? s->skin_m_N[i] : s->skin_m_N[i] / SKIN_HARDENING;
        a[r][n] = (soft ? 0.0f : s->soft_m / SKIN_HARDENING - s->soft_m) - s->gap_m[i];
        for (int32_t k = n; k < s->load_count; k++) a[r][n] -= s->w[s->loaded[k]][i] * s->patch->force_cap_N;
    }
    eliminate(a, n);
    for (int32_t r = 0; r < n; r++) s->row[s->loaded[r]].lambda_N = a[r][n];
}

static branch next_branch(const solve *s, int32_t i, branch now) {
    const float lambda = s->row[i].lambda_N;
    if (now == OFF) return row_error(s, i) < 0.0f ? SOFT : OFF;
    if (now == CAPPED && row_error(s, i) > 0.0f) return HARD;
    if (!(lambda > 0.0f)) return OFF;
    if (lambda >= s->patch->force_cap_N) return CAPPED;
    return s->skin_m_N[i] * lambda > s->soft_m ? HARD : SOFT;
}

static void solve_rows(solve *s) {
    branch state[HRT_CONTACT_ROWS];
    for (int32_t i = 0; i < s->rows; i++) {
        const float lambda = s->row[i].lambda_N;
        state[i] = s->skin_m_N[i] * lambda > s->soft_m ? HARD : lambda > 0.0f || s->gap_m[i] < 0.0f ? SOFT : OFF;
    }
    bool changed = true;
    for (int32_t k = 0; k < BRANCHES && changed; k++) {
        solve_branches(s, state);
        changed = false;
        for (int32_t i = 0; i < s->rows; i++) {
            const branch next = next_branch(s, i, state[i]);
            changed = changed || next != state[i];
            state[i] = next;
        }
    }
    for (int32_t i = 0; i < s->rows; i++)
        s->row[i].lambda_N = hrt_clamp(s->row[i].lambda_N, 0.0f, s->patch->force_cap_N);
}

/* --- rounds: the rows' normals turn with the shape that their forces make --- */

/* Vertices touched in this patch's life. */
static void list_touched(solve *s, const hrt_mixing *m) {
    s->touched = 0;
    for (int32_t v = 0; v < s->patch->vertex_count; v++)
        if ((m->touched >> v & 1u) != 0) s->vertex[s->touched++] = (uint8_t)v;
}

/* Those of this round's rows among them. Nothing is remembered of a new one. */
static void touch(solve *s, hrt_mixing *m) {
    const hrt_v3 none = {0.0f, 0.0f, 0.0f};
    for (int32_t r = 0; r < 3 * s->rows; r++) {
        const uint8_t v = corners(s, &s->row[r / 3])[r % 3];
        if ((m->touched >> v & 1u) != 0) continue;
        m->touched |= 1u << v;
        s->vertex[s->touched++] = v;
        put(s->before_N, v, none);
        put(s->before_residual_N, v, none);
        for (int i = 0; i < HRT_MIXING_MEMORY; i++) {
            put(m->residual_change_N[i], v, none);
            put(m->step_N[i], v, none);
        }
    }
}

static float inner_at(const solve *s, const float *a, const float *b) {
    float sum = 0.0f;
    for (int32_t i = 0; i < s->touched; i++) sum += hrt_inner(at(a, s->vertex[i]), at(b, s->vertex[i]));
    return sum;
}

/* mix[][HRT_MIXING_MEMORY]: the combination of the remembered changes of the residual that is nearest to it. */
static void nearest_mix(const solve *s, const hrt_mixing *m, float mix[HRT_MIXING_MEMORY][WIDTH]) {
    float trace = 1.0e-30f;
    for (int i = 0; i < HRT_MIXING_MEMORY; i++) {
        for (int j = i; j <= HRT_MIXING_MEMORY; j++)
            mix[i][j] =
                inner_at(s, m->residual_change_N[i], j < HRT_MIXING_MEMORY ? m->residual_change_N[j] : s->residual_N);
        trace += mix[i][i];
    }
    for (int i = 0; i < HRT_MIXING_MEMORY; i++) {
        for (int j = i; j <= HRT_MIXING_MEMORY; j++) mix[i][j] /= trace;
        mix[i][i] += 1.0e-5f;
    }
    eliminate(mix, HRT_MIXING_MEMORY);
}

static void find_residual(solve *s) {
    for (int32_t i = 0; i < s->touched; i++)
        put(s->residual_N, s->vertex[i], hrt_times(-1.0f, at(s->force_N, s->vertex[i])));
    for (int32_t r = 0; r < s->rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        const hrt_v3 force = hrt_times(row->lambda_N, hrt_get(row->normal));
        for (int k = 0; k < 3; k++) {
            const uint8_t v = corners(s, row)[k];
            put(s->residual_N, v, hrt_plus(at(s->residual_N, v), hrt_times(row->weight[k], force)));
        }
    }
}

/* What the last two rounds say of how the residual follows the forces. Where it grows with them, the rows themselves
 * have changed: a step to where it would vanish leads the wrong way, and far. */
static void remember(const solve *s, hrt_mixing *m) {
    float along = 0.0f;
    for (int32_t i = 0; i < s->touched; i++) {
        const int32_t v = s->vertex[i];
        along += hrt_inner(hrt_minus(at(s->residual_N, v), at(s->before_residual_N, v)),
                           hrt_minus(at(s->force_N, v), at(s->before_N, v)));
    }
    const float known = along < 0.0f ? 1.0f : 0.0f;
    for (int32_t i = 0; i < s->touched; i++) {
        const int32_t v = s->vertex[i];
        const hrt_v3 change = hrt_times(known, hrt_minus(at(s->residual_N, v), at(s->before_residual_N, v)));
        put(m->residual_change_N[m->next], v, change);
        put(m->step_N[m->next], v,
            hrt_plus(change, hrt_times(known, hrt_minus(at(s->force_N, v), at(s->before_N, v)))));
    }
    m->next = (uint8_t)((m->next + 1) % HRT_MIXING_MEMORY);
}

/* The next forces from those the shape was made with and those the rows made of it: Anderson's mixing over the last
 * rounds, of earlier ticks too. Taking the rows' forces as they are swings or creeps. True when the forces changed
 * little. */
static bool take_forces(solve *s, hrt_mixing *m, bool first) {
    float mix[HRT_MIXING_MEMORY][WIDTH], moved = 0.0f, size = 0.0f;
    if (!first) remember(s, m);
    for (int32_t i = 0; i < s->touched; i++) {
        put(s->before_residual_N, s->vertex[i], at(s->residual_N, s->vertex[i]));
        put(s->before_N, s->vertex[i], at(s->force_N, s->vertex[i]));
    }
    nearest_mix(s, m, mix);
    for (int32_t i = 0; i < s->touched; i++) {
        const int32_t v = s->vertex[i];
        hrt_v3 step = at(s->residual_N, v);
        for (int k = 0; k < HRT_MIXING_MEMORY; k++)
            step = hrt_minus(step, hrt_times(mix[k][HRT_MIXING_MEMORY], at(m->step_N[k], v)));
        const hrt_v3 force = hrt_plus(at(s->force_N, v), step);
        put(s->force_N, v, force);
        moved += hrt_inner(step, step);
        size += hrt_inner(force, force);
    }
    return moved < LITTLE * size;
}

/* Bears mainly upon the patch's edge: the tissue goes on there and we do not know how. */
static bool on_edge(const solve *s, const hrt_contact_row *row) {
    float weight = 0.0f;
    for (int k = 0; k < 3; k++)
        weight += (s->patch->topology.border >> corners(s, row)[k] & 1u) != 0 ? row->weight[k] : 0.0f;
    return weight > 0.5f;
}

/* What the film drags with, of the reaction: its coefficient times the tip's speed since the last tick. */
static hrt_v3 film_drag(hrt_extrapolation *x, int64_t now_us, const float tip_m[3]) {
    const hrt_v3 moved = hrt_minus(hrt_get(tip_m), hrt_get(x->film_tip_m));
    const float passed_us = (float)(uint32_t)(now_us - x->film_us);
    hrt_copy(x->film_tip_m, tip_m);
    x->film_us = now_us;
    return hrt_times(1.0e6f * x->patch->film_s_m / hrt_max(passed_us, 1.0f), moved);
}

/* Reactions, the film's drag along the surface and the hold to the equivalent force at the tip of a tool that pivots
 * about the origin; false when most of it is on the edge. */
static bool gather(const solve *s, const float tip_m[3], hrt_v3 drag, float force_N[3]) {
    const hrt_v3 tip = hrt_get(tip_m);
    const float reach = hrt_size(tip);
    const hrt_v3 axis = hrt_times(1.0f / reach, tip);
    hrt_v3 force = {0.0f, 0.0f, 0.0f};
    float along_N = 0.0f, on_edge_N = 0.0f; /* what is on the edge less what is not */
    if (hrt_patch_holds(s->patch)) {
        force = hrt_plus(at(s->patch->rest_m, s->patch->vertex_count), at(s->shift_m, s->patch->vertex_count));
        on_edge_N = -hrt_size(force);
    }
    for (int32_t r = 0; r < s->rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        if (!(row->lambda_N > 0.0f)) continue;
        on_edge_N += on_edge(s, row) ? row->lambda_N : -row->lambda_N;
        const hrt_v3 normal = hrt_get(row->normal);
        const hrt_v3 push = hrt_plus(drag, hrt_times(1.0f - hrt_inner(drag, normal), normal));
        const float lever = 1.0f - (float)row->station * s->patch->radius_m / reach;
        force = hrt_minus(force, hrt_times(row->lambda_N * lever, push));
        along_N -= row->lambda_N * (1.0f - lever) * hrt_inner(push, axis);
    }
    hrt_put(hrt_plus(force, hrt_times(along_N, axis)), force_N);
    return !(on_edge_N > 0.0f);
}

bool hrt_contact_force(hrt_extrapolation *x, int64_t now_us, const float tip_m[3], float force_N[3]) {
    solve s;
    hrt_hits hits = {.count = -1};
    if (!(hrt_length(tip_m) > 1.0e-4f)) return false;
    s.patch = x->patch;
    s.rows = x->row_count;
    s.row = x->row;
    s.soft_m = SKIN_TRAVEL * x->patch->radius_m;
    s.force_N = x->patch_force_N;
    list_touched(&s, &x->mixing);
    for (int32_t k = 0; k < ROUNDS; k++) {
        shift_by_forces(&s, tip_m);
        find_rows(&s, tip_m, &hits, s.row == x->row ? s.other : x->row);
        solve_rows(&s);
        touch(&s, &x->mixing);
        find_residual(&s);
        /* On much the same shape the tool is near the same features. */
        if (!take_forces(&s, &x->mixing, k == 0)) hits.count = -1;
    }
    x->row_count = s.rows;
    return gather(&s, tip_m, film_drag(x, now_us, tip_m), force_N);
}

void hrt_contact_clear(hrt_extrapolation *x) {
    x->row_count = 0;
    x->mixing.touched = 0;
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) x->patch_force_N[i] = 0.0f;
}

/* The vertex of `fresh` that is vertex v of `old`: the undeformed surface does not move. -1: not in it. */
static int32_t same_vertex(const hrt_patch *old, int32_t v, const hrt_patch *fresh) {
    const hrt_v3 place = at(old->rest_m, v);
    for (int32_t u = 0; u < fresh->vertex_count; u++) {
        const hrt_v3 apart = hrt_minus(at(fresh->rest_m, u), place);
        if (hrt_inner(apart, apart) < 1.0e-10f) return u;
    }
    return -1;
}

/* Numbers by the old patch's vertices to numbers by the fresh one's; what has no place there is dropped. */
static void renumber(float *by_vertex, const int8_t to[HRT_PATCH_MAX_VERTICES], int32_t old_count) {
    float moved[HRT_PATCH_DOFS] = {0};
    for (int32_t v = 0; v < old_count; v++)
        if (to[v] >= 0) hrt_copy(&moved[HRT_XYZ * to[v]], &by_vertex[HRT_XYZ * v]);
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) by_vertex[i] = moved[i];
}

void hrt_contact_warm(hrt_extrapolation *x, const hrt_patch *old, const hrt_patch *fresh) {
    int8_t to[HRT_PATCH_MAX_VERTICES];
    uint32_t touched = 0;
    for (int32_t v = 0; v < old->vertex_count; v++) {
        to[v] = (int8_t)((x->mixing.touched >> v & 1u) != 0 ? same_vertex(old, v, fresh) : -1);
        if (to[v] >= 0) touched |= 1u << to[v];
    }
    x->mixing.touched = touched;
    /* What the rounds remember stays true of the same tissue. One call, so that it is in flash once. */
    for (int k = -1; k < 2 * HRT_MIXING_MEMORY; k++)
        renumber(k < 0        ? x->patch_force_N
                 : k % 2 == 0 ? x->mixing.residual_change_N[k / 2]
                              : x->mixing.step_N[k / 2],
                 to, old->vertex_count);
    int32_t kept = 0;
    for (int32_t r = 0; r < x->row_count; r++)
        for (int32_t t = 0; t < fresh->triangle_count; t++) {
            if (fresh->face[t] != old->face[x->row[r].triangle]) continue;
            x->row[kept] = x->row[r];
            x->row[kept++].triangle = (uint8_t)t;
            break;
        }
    x->row_count = kept;
}
