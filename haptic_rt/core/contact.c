/* `contact`: a small model of the tissue at the hand. A patch of the surface with its compliance; in every tick the
 * tool's rows are found anew against the patch as the reactions of the last tick deform it, 0 <= gap + skin _|_ lambda
 * >= 0 is solved by branches from those reactions, and both once more. */
#include "vector.h"

enum { ROUNDS = 2, BRANCHES = 4 };
enum { LAW_ROWS = HRT_CONTACT_ROWS, LAW_DOFS = HRT_PATCH_DOFS, LAW_MEMORY = HRT_MIXING_MEMORY };
#include "law/branch.h"
#define LAW_MIXING hrt_mixing
#define LAW_MIX_FLOOR 1.0e-5f
#include "law/mixing.h"

_Static_assert(ROUNDS % 2 == 0, "the last round's rows are to end up in the extrapolation");
_Static_assert(HRT_PATCH_MAX_VERTICES <= 32, "a bit a vertex");
static const float LITTLE = 0.1f; /* change of the forces, squared */

typedef struct solve {
    law_problem p; /* first: law_couple finds the others by it */
    const hrt_patch *patch;
    hrt_contact_row *row,
        other[HRT_CONTACT_ROWS];   /* of this round; its rows, or, from round to round in turn, the extrapolation's */
    float *force_N;                /* f: what the shape is made with */
    float shift_m[HRT_PATCH_DOFS]; /* C f; then what one row does; at the tip's place the hold */
    uint32_t coupled;              /* bit i: line i of p.w is there */
    law_round round;
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
    for (int32_t j = 0; j < s->p.rows; j++)
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
    // cppcheck-suppress ctuuninitvar ; what is read of s is set: the patch, its forces
    for (int32_t v = 0; v < s->patch->vertex_count; v++) {
        from[count] = (uint8_t)v;
        force[count] = at(s->force_N, v);
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
static void law_couple(law_problem *p, int32_t i) {
    solve *s = (solve *)p;
    const hrt_contact_row *row = &s->row[i];
    uint8_t from[3];
    hrt_v3 newton[3];
    int32_t count = 0;
    if (is_coupled(s, i)) return;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) {
            from[count] = corners(s, row)[k];
            newton[count++] = hrt_times(row->weight[k], hrt_get(row->normal));
        }
    respond_under_rows(s, from, newton, count);
    for (int32_t j = 0; j < p->rows; j++) p->w[i][j] = is_coupled(s, j) ? p->w[j][i] : along_row(s, &s->row[j]);
    s->coupled |= 1u << i;
}

static void find_rows(solve *s, const float tip_m[3], hrt_hits *hits, hrt_contact_row *row) {
    const hrt_contact_row *before = s->row;
    const int32_t count = s->p.rows;
    s->p.rows = hrt_contact_rows(s->patch, s->shift_m, tip_m, before, count, hits, row);
    s->row = row;
    s->coupled = 0;
    if (hrt_patch_holds(s->patch)) shift_by_forces(s, NULL);
    for (int32_t r = 0; r < s->p.rows; r++, row++) {
        s->p.lambda_N[r] = 0.0f;
        for (int32_t b = 0; b < count; b++)
            if (before[b].station == row->station && before[b].triangle == row->triangle &&
                before[b].feature == row->feature)
                s->p.lambda_N[r] = before[b].lambda_N;
        s->p.gap_m[r] = row->gap_m - along_row(s, row);
        s->p.skin_m_N[r] = s->patch->skin_compliance_m_N / row->share;
    }
}

/* The rows' forces, less those that the shape was made with. */
static void find_residual(solve *s) {
    float *residual_N = s->round.residual_N;
    for (int32_t i = 0; i < 3 * s->patch->vertex_count; i++) residual_N[i] = -s->force_N[i];
    for (int32_t r = 0; r < s->p.rows; r++) {
        hrt_contact_row *row = &s->row[r];
        row->lambda_N = s->p.lambda_N[r];
        for (int k = 0; k < 3; k++)
            hrt_add_scaled(&residual_N[HRT_XYZ * corners(s, row)[k]], row->weight[k] * row->lambda_N, row->normal);
    }
}

/* Bears mainly upon the patch's edge: the tissue goes on there and we do not know how. */
static bool on_edge(const solve *s, const hrt_contact_row *row) {
    float weight = 0.0f;
    for (int k = 0; k < 3; k++)
        weight += (s->patch->topology.border >> corners(s, row)[k] & 1u) != 0 ? row->weight[k] : 0.0f;
    return weight > 0.5f;
}

/* Of the tip since the last tick, m/s. What its mean of the last while leaves of it is `swing`. */
static hrt_v3 tip_speed(hrt_extrapolation *x, int64_t now_us, const float tip_m[3], hrt_v3 *swing) {
    const float passed_s = law_max(1.0e-6f * (float)(uint32_t)(now_us - x->film_us), 1.0e-6f);
    const hrt_v3 speed = hrt_times(1.0f / passed_s, hrt_minus(hrt_get(tip_m), hrt_get(x->film_tip_m)));
    *swing =
        hrt_times(x->patch->radiation_s / (passed_s + x->patch->radiation_s), hrt_minus(speed, hrt_get(x->mean_m_s)));
    hrt_put(hrt_minus(speed, *swing), x->mean_m_s);
    hrt_copy(x->film_tip_m, tip_m);
    x->film_us = now_us;
    return speed;
}

/* What waves carry off into tissue that has mass, where a patch is at rest at every instant: a dashpot on the swing
 * along the force, of a hold on all of it. The mean speed is no swing: what it does is in the sample's shape. Never
 * more than half of the force, so that a probe is never pulled. */
static void radiate(hrt_extrapolation *x, hrt_v3 swing, float force_N[3]) {
    const hrt_v3 force = hrt_get(force_N);
    const float size2 = hrt_inner(force, force);
    if (!(size2 > 0.0f)) {
        for (int i = 0; i < 3; i++) x->mean_m_s[i] = 0.0f;
        return;
    }
    if (!hrt_patch_holds(x->patch)) swing = hrt_times(hrt_inner(swing, force) / size2, force);
    const float size = x->patch->radiation_N_s_m * hrt_size(swing), most = 0.5f * sqrtf(size2);
    hrt_put(hrt_minus(force, hrt_times(x->patch->radiation_N_s_m * (size > most ? most / size : 1.0f), swing)),
            force_N);
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
    for (int32_t r = 0; r < s->p.rows; r++) {
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
    s.p.rows = x->row_count;
    s.p.soft_m = LAW_SKIN_TRAVEL * x->patch->radius_m;
    s.p.cap_N = x->patch->force_cap_N;
    s.row = x->row;
    s.force_N = x->patch_force_N;
    x->mixing.used = true;
    for (int32_t k = 0; k < ROUNDS; k++) {
        shift_by_forces(&s, tip_m);
        find_rows(&s, tip_m, &hits, s.row == x->row ? s.other : x->row);
        law_solve(&s.p, BRANCHES);
        find_residual(&s);
        /* On much the same shape the tool is near the same features. */
        if (law_take_forces(&x->mixing, &s.round, s.force_N, 3 * s.patch->vertex_count, k == 0) >= LITTLE)
            hits.count = -1;
    }
    x->row_count = s.p.rows;
    hrt_v3 swing;
    const hrt_v3 speed = tip_speed(x, now_us, tip_m, &swing);
    const bool within = gather(&s, tip_m, hrt_times(x->patch->film_s_m, speed), force_N);
    radiate(x, swing, force_N);
    return within;
}

void hrt_contact_clear(hrt_extrapolation *x) {
    x->row_count = 0;
    if (!x->mixing.used) return;
    x->mixing = (hrt_mixing){0};
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
    for (int32_t v = 0; v < old->vertex_count; v++) {
        const hrt_v3 force = at(x->patch_force_N, v);
        to[v] = (int8_t)(hrt_inner(force, force) > 0.0f ? same_vertex(old, v, fresh) : -1);
    }
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
