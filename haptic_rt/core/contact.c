/* `contact`: a small model of the tissue at the hand. A patch of the surface with its compliance; in every tick the tool's contact is found anew against the
 * patch as it was left deformed, 0 <= gap _|_ lambda >= 0 is solved by projected Gauss-Seidel sweeps from the last tick's reactions, twice. */
#include "internal.h"

enum { SWEEPS = 10 };
static const float SEARCH_M = 0.001f; /* rows further apart than this cannot touch within a tick, even at 0.5 m/s */

typedef struct found {
    int32_t triangle;
    bool behind, on_border; /* behind the triangle's plane; nearest to its edge or corner */
    float weight[3], point_m[3], normal[3], distance_m;
} found;

/* Closest points of the segment a + s (b - a) and a triangle. */
typedef struct nearest {
    float s, weight[3], distance2;
} nearest;

static float clamp01(float x) { return hrt_clamp(x, 0.0f, 1.0f); }

static void keep_if_nearer(nearest *best, const nearest *candidate) {
    if (candidate->distance2 < best->distance2) *best = *candidate;
}

static float distance2_at(const float v[3][3], const float a[3], const float ab[3], const nearest *n) {
    float d[3];
    for (int i = 0; i < 3; i++)
        d[i] = n->weight[0] * v[0][i] + n->weight[1] * v[1][i] + n->weight[2] * v[2][i] - a[i] - n->s * ab[i];
    return hrt_dot(d, d);
}

/* Segment against one edge (corners i and j); the inner optimum of both lines, clamped one after the other. */
static void against_edge(const float v[3][3], int i, int j, const float a[3], const float ab[3], nearest *best) {
    float e[3], r[3];
    hrt_sub(v[j], v[i], e);
    hrt_sub(a, v[i], r);
    const float aa = hrt_dot(ab, ab), ee = hrt_dot(e, e), ae = hrt_dot(ab, e), ar = hrt_dot(ab, r), er = hrt_dot(e, r);
    const float denominator = aa * ee - ae * ae;
    float s = denominator > 1.0e-9f * aa * ee ? clamp01((ae * er - ar * ee) / denominator) : 0.0f;
    const float t = clamp01((ae * s + er) / fmaxf(ee, 1.0e-18f));
    s = clamp01((ae * t - ar) / fmaxf(aa, 1.0e-18f));
    nearest n = {.s = s};
    n.weight[i] = 1.0f - t;
    n.weight[j] = t;
    n.distance2 = distance2_at(v, a, ab, &n);
    keep_if_nearer(best, &n);
}

/* Barycentric coordinates of the foot of p on the triangle's plane; false when the foot is outside or the triangle has no area. */
static bool foot(const float v[3][3], const float p[3], float weight[3]) {
    float e0[3], e1[3], r[3];
    hrt_sub(v[1], v[0], e0);
    hrt_sub(v[2], v[0], e1);
    hrt_sub(p, v[0], r);
    const float d00 = hrt_dot(e0, e0), d01 = hrt_dot(e0, e1), d11 = hrt_dot(e1, e1), r0 = hrt_dot(r, e0), r1 = hrt_dot(r, e1);
    const float area = d00 * d11 - d01 * d01;
    if (!(area > 1.0e-9f * d00 * d11)) return false;
    weight[1] = (d11 * r0 - d01 * r1) / area;
    weight[2] = (d00 * r1 - d01 * r0) / area;
    weight[0] = 1.0f - weight[1] - weight[2];
    return weight[0] >= 0.0f && weight[1] >= 0.0f && weight[2] >= 0.0f;
}

static void against_face(const float v[3][3], const float a[3], const float ab[3], const float normal[3], nearest *best) {
    float r[3];
    hrt_sub(a, v[0], r);
    const float at_a = hrt_dot(r, normal), along = hrt_dot(ab, normal);
    /* The ends, and where the axis pierces the plane. */
    const float pierce = fabsf(along) > 1.0e-12f ? -at_a / along : -1.0f;
    const float at[3] = {0.0f, 1.0f, pierce};
    for (int k = 0; k < 3; k++) {
        if (at[k] < 0.0f || at[k] > 1.0f) continue;
        float p[3];
        hrt_copy(p, a);
        hrt_add_scaled(p, at[k], ab);
        nearest n = {.s = at[k]};
        if (!foot(v, p, n.weight)) continue;
        n.distance2 = distance2_at(v, a, ab, &n);
        keep_if_nearer(best, &n);
    }
}

/* True when the triangle is further than `reach_m` from the axis: its middle is further than that and its own size. */
static bool is_far(const float v[3][3], const float a[3], const float ab[3], float reach_m) {
    float m[3], r[3], size2 = 0.0f;
    for (int i = 0; i < 3; i++) m[i] = (v[0][i] + v[1][i] + v[2][i]) * (1.0f / 3.0f);
    for (int k = 0; k < 3; k++) {
        hrt_sub(v[k], m, r);
        size2 = fmaxf(size2, hrt_dot(r, r));
    }
    hrt_sub(m, a, r);
    hrt_add_scaled(r, -clamp01(hrt_dot(r, ab) / fmaxf(hrt_dot(ab, ab), 1.0e-18f)), ab);
    const float reach = reach_m + sqrtf(size2);
    return hrt_dot(r, r) > reach * reach;
}

/* One triangle against the tool's axis from tip `a` along `ab`. False: no area. The normal points from the tool to the tissue. */
static bool measure(const float v[3][3], const float a[3], const float ab[3], found *f) {
    float e0[3], e1[3], normal[3], d[3];
    hrt_sub(v[1], v[0], e0);
    hrt_sub(v[2], v[0], e1);
    hrt_cross(e0, e1, normal);
    const float area = hrt_length(normal);
    if (!(area > 1.0e-14f)) return false;
    hrt_scale(normal, 1.0f / area);
    nearest best = {.distance2 = 1.0e30f};
    against_face(v, a, ab, normal, &best);
    for (int e = 0; e < 3; e++) against_edge(v, e, (e + 1) % 3, a, ab, &best);
    hrt_copy(f->weight, best.weight);
    for (int i = 0; i < 3; i++) {
        f->point_m[i] = a[i] + best.s * ab[i];
        d[i] = best.weight[0] * v[0][i] + best.weight[1] * v[1][i] + best.weight[2] * v[2][i] - f->point_m[i];
    }
    const float distance = hrt_length(d);
    f->behind = hrt_dot(d, normal) > 0.0f;
    f->on_border = best.weight[0] <= 0.0f || best.weight[1] <= 0.0f || best.weight[2] <= 0.0f;
    for (int i = 0; i < 3; i++) f->normal[i] = distance > 1.0e-6f ? (f->behind ? -d[i] : d[i]) / distance : -normal[i];
    f->distance_m = distance;
    return true;
}

typedef struct solve {
    const hrt_patch *patch;
    int32_t dofs, rows;
    uint16_t start[HRT_PATCH_DOFS];                    /* compliance_m_N[start[i] + j], j >= i */
    float shift_m[HRT_PATCH_DOFS];                     /* u = C f */
    float response[HRT_PATCH_DOFS];                    /* u for one newton in one row, at the vertices that rows touch */
    bool touched[HRT_PATCH_MAX_VERTICES];
    float w[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS];
    hrt_contact_row row[HRT_CONTACT_ROWS];
} solve;

static const uint8_t *corners(const solve *s, const hrt_contact_row *row) { return &s->patch->triangle[3 * row->triangle]; }

/* u += C_ba f, the block of vertices b and a of the packed upper triangle. */
static void add_block(const solve *s, int32_t b, int32_t a, const float f[3], float u[3]) {
    const float *c = s->patch->compliance_m_N;
    const bool flip = b > a;
    const int32_t row = 3 * (flip ? a : b), column = 3 * (flip ? b : a);
    const float *r0 = &c[s->start[row] + column], *r1 = &c[s->start[row + 1] + column], *r2 = &c[s->start[row + 2] + column];
    if (b == a) {
        u[0] += r0[0] * f[0] + r0[1] * f[1] + r0[2] * f[2];
        u[1] += r0[1] * f[0] + r1[1] * f[1] + r1[2] * f[2];
        u[2] += r0[2] * f[0] + r1[2] * f[1] + r2[2] * f[2];
    } else if (flip) {
        for (int j = 0; j < 3; j++) u[j] += r0[j] * f[0] + r1[j] * f[1] + r2[j] * f[2];
    } else {
        u[0] += hrt_dot(r0, f);
        u[1] += hrt_dot(r1, f);
        u[2] += hrt_dot(r2, f);
    }
}

/* The response to one newton in `row`, where `touched` says that somebody will look. */
static void respond(solve *s, const hrt_contact_row *row) {
    float pull[3][3];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) pull[k][i] = row->weight[k] * row->normal[i];
    const uint8_t *corner = corners(s, row);
    for (int32_t b = 0; b < s->patch->vertex_count; b++) {
        if (!s->touched[b]) continue;
        float *u = &s->response[3 * b];
        u[0] = u[1] = u[2] = 0.0f;
        for (int k = 0; k < 3; k++)
            if (row->weight[k] != 0.0f) add_block(s, b, corner[k], pull[k], u);
    }
}

static float row_shift(const solve *s, const hrt_contact_row *row, const float *u) {
    float sum = 0.0f;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] != 0.0f) sum += row->weight[k] * hrt_dot(row->normal, &u[3 * corners(s, row)[k]]);
    return sum;
}

/* u = C f for the forces of all pressing rows, gathered by vertex first. */
static void shift_from_reactions(solve *s) {
    float force[HRT_PATCH_DOFS] = {0};
    bool loaded[HRT_PATCH_MAX_VERTICES] = {false};
    for (int32_t r = 0; r < s->rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        if (!(row->lambda_N > 0.0f)) continue;
        for (int k = 0; k < 3; k++) {
            const int32_t a = corners(s, row)[k];
            if (row->weight[k] == 0.0f) continue;
            hrt_add_scaled(&force[3 * a], row->weight[k] * row->lambda_N, row->normal);
            loaded[a] = true;
        }
    }
    for (int32_t i = 0; i < s->dofs; i++) s->shift_m[i] = 0.0f;
    for (int32_t a = 0; a < s->patch->vertex_count; a++)
        for (int32_t b = 0; loaded[a] && b < s->patch->vertex_count; b++) add_block(s, b, a, &force[3 * a], &s->shift_m[3 * b]);
}

/* Keeps the rows with the smallest gaps. */
static void keep_row(hrt_contact_row *row, int32_t *count, const hrt_contact_row *candidate) {
    if (*count < HRT_CONTACT_ROWS) {
        row[(*count)++] = *candidate;
        return;
    }
    int32_t widest = 0;
    for (int32_t r = 1; r < HRT_CONTACT_ROWS; r++)
        if (row[r].gap_m > row[widest].gap_m) widest = r;
    if (candidate->gap_m < row[widest].gap_m) row[widest] = *candidate;
}

/* Behind this triangle's plane, but only its border is near, and a triangle no further off has the same piece of the tool before it: a ridge, seen
 * from its other side. Not so in a dent, where all say behind. */
static bool is_ridge(const found *f, const found *all, int32_t count, float radius_m) {
    if (!f->behind || !f->on_border) return false;
    for (int32_t i = 0; i < count; i++) {
        float apart[3];
        if (all[i].behind || all[i].distance_m > f->distance_m + 1.0e-6f) continue;
        hrt_sub(all[i].point_m, f->point_m, apart);
        if (hrt_dot(apart, apart) < radius_m * radius_m) return true;
    }
    return false;
}

static void find_rows(solve *s, const float a[3], const float ab[3]) {
    float lambda[HRT_PATCH_MAX_TRIANGLES] = {0};
    found near[HRT_PATCH_MAX_TRIANGLES];
    const float radius = s->patch->radius_m;
    int32_t count = 0;
    for (int32_t r = 0; r < s->rows; r++) lambda[s->row[r].triangle] = s->row[r].lambda_N;
    for (int32_t t = 0; t < s->patch->triangle_count; t++) {
        float v[3][3];
        for (int k = 0; k < 3; k++) {
            const int32_t vertex = 3 * s->patch->triangle[3 * t + k];
            for (int i = 0; i < 3; i++) v[k][i] = s->patch->vertex_m[vertex + i] + s->shift_m[vertex + i];
        }
        near[count].triangle = t;
        if (is_far((const float(*)[3])v, a, ab, radius + SEARCH_M)) continue;
        if (measure((const float(*)[3])v, a, ab, &near[count]) && (near[count].behind || near[count].distance_m < radius + SEARCH_M)) count++;
    }
    s->rows = 0;
    for (int32_t c = 0; c < count; c++) {
        const found *f = &near[c];
        if (is_ridge(f, near, count, radius)) continue;
        hrt_contact_row row = {.triangle = (uint8_t)f->triangle, .lambda_N = lambda[f->triangle]};
        hrt_copy(row.weight, f->weight);
        hrt_copy(row.normal, f->normal);
        hrt_copy(row.point_m, f->point_m);
        /* The gap that this geometry would have with the patch undeformed. */
        row.gap_m = (f->behind ? -f->distance_m : f->distance_m) - radius - row_shift(s, &row, s->shift_m);
        keep_row(s->row, &s->rows, &row);
    }
}

static void touch(solve *s) {
    for (int32_t v = 0; v < s->patch->vertex_count; v++) s->touched[v] = false;
    for (int32_t r = 0; r < s->rows; r++)
        for (int k = 0; k < 3; k++) s->touched[corners(s, &s->row[r])[k]] |= s->row[r].weight[k] != 0.0f;
}

/* Projected Gauss-Seidel; `gap` is kept up to date, so that a row that stays open costs next to nothing. */
static void sweep_rows(solve *s) {
    float gap[HRT_CONTACT_ROWS];
    for (int32_t i = 0; i < s->rows; i++) {
        gap[i] = s->row[i].gap_m;
        for (int32_t j = 0; j < s->rows; j++)
            if (s->row[j].lambda_N > 0.0f) gap[i] += s->w[i][j] * s->row[j].lambda_N;
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (int32_t i = 0; i < s->rows; i++) {
            if (!(s->w[i][i] > 1.0e-12f)) continue;
            const float before = s->row[i].lambda_N, after = fmaxf(0.0f, before - gap[i] / s->w[i][i]);
            if (after == before) continue;
            s->row[i].lambda_N = after;
            for (int32_t j = 0; j < s->rows; j++) gap[j] += s->w[i][j] * (after - before);
        }
}

static void relax(solve *s) {
    const float skin = s->patch->skin_compliance_m_N;
    touch(s);
    for (int32_t i = 0; i < s->rows; i++) {
        respond(s, &s->row[i]);
        for (int32_t j = 0; j <= i; j++) s->w[i][j] = s->w[j][i] = row_shift(s, &s->row[j], s->response);
        s->w[i][i] += skin;
    }
    sweep_rows(s);
}

/* A pressing row on the patch's edge: the tissue goes on there and we do not know how. */
static bool on_edge(const solve *s, const hrt_contact_row *row) {
    for (int e = 0; e < 3; e++)
        if ((s->patch->boundary[row->triangle] & (1u << e)) != 0u && row->weight[e] < 0.02f) return true;
    return false;
}

/* Reactions to the equivalent force at the tip of a tool that pivots about the origin. */
static bool gather(const solve *s, const float tip[3], float force[3]) {
    const float reach = hrt_length(tip);
    float axis[3] = {tip[0] / reach, tip[1] / reach, tip[2] / reach};
    bool inside = true;
    for (int i = 0; i < 3; i++) force[i] = 0.0f;
    for (int32_t r = 0; r < s->rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        if (!(row->lambda_N > 0.0f)) continue;
        inside = inside && !on_edge(s, row);
        const float share = hrt_dot(row->point_m, axis) / reach;
        const float along = hrt_dot(row->normal, axis);
        for (int i = 0; i < 3; i++)
            force[i] -= row->lambda_N * (along * axis[i] + share * (row->normal[i] - along * axis[i]));
    }
    return inside;
}

bool hrt_contact_force(hrt_extrapolation *x, const float tip_m[3], int32_t linearisations, float force_N[3]) {
    solve s;
    s.patch = x->patch;
    s.dofs = 3 * x->patch->vertex_count;
    s.rows = x->row_count;
    const float reach = hrt_length(tip_m);
    if (!(reach > 1.0e-4f)) return false;
    float ab[3];
    hrt_copy(ab, tip_m);
    hrt_scale(ab, -fminf(x->patch->contact_length_m, reach) / reach);
    for (int32_t r = 0; r < s.rows; r++) s.row[r] = x->row[r];
    for (int32_t i = 0; i < s.dofs; i++) s.start[i] = (uint16_t)(i * (2 * s.dofs - i - 1) / 2);
    for (int32_t k = 0; k < linearisations; k++) {
        shift_from_reactions(&s);
        find_rows(&s, tip_m, ab);
        relax(&s);
    }
    x->row_count = s.rows;
    for (int32_t r = 0; r < s.rows; r++) x->row[r] = s.row[r];
    return gather(&s, tip_m, force_N);
}

static void centroid(const hrt_patch *patch, int32_t t, float c[3]) {
    const uint8_t *corner = &patch->triangle[3 * t];
    for (int i = 0; i < 3; i++)
        c[i] = (patch->vertex_m[3 * corner[0] + i] + patch->vertex_m[3 * corner[1] + i] + patch->vertex_m[3 * corner[2] + i]) * (1.0f / 3.0f);
}

void hrt_contact_warm(hrt_extrapolation *x, const hrt_patch *old, const hrt_patch *fresh) {
    float middle[HRT_PATCH_MAX_TRIANGLES][3];
    for (int32_t t = 0; t < fresh->triangle_count; t++) centroid(fresh, t, middle[t]);
    int32_t kept = 0;
    for (int32_t r = 0; r < x->row_count; r++) {
        if (!(x->row[r].lambda_N > 0.0f)) continue;
        float from[3], apart[3], best2 = 4.0e-6f; /* the same triangle lies within 2 mm of itself */
        int32_t best = -1;
        centroid(old, x->row[r].triangle, from);
        for (int32_t t = 0; t < fresh->triangle_count; t++) {
            hrt_sub(middle[t], from, apart);
            const float apart2 = hrt_dot(apart, apart);
            if (apart2 < best2) {
                best2 = apart2;
                best = t;
            }
        }
        if (best < 0) continue;
        x->row[kept] = x->row[r];
        x->row[kept++].triangle = (uint8_t)best;
    }
    x->row_count = kept;
}
