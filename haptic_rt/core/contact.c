/* `contact`: a small model of the tissue at the hand. A patch of the surface with its compliance; in every tick the tool's rows are found anew against the patch as
 * the reactions of the last tick deform it, 0 <= gap + skin _|_ lambda >= 0 is solved by branches from those reactions, and both once more. */
#include "internal.h"

enum { BRANCHES = 4 };
/* The skin gives way up to this share of the radius and a twentieth as easily beyond (docs/contact.md). */
static const float SKIN_TRAVEL = 0.3f, SKIN_HARDENING = 20.0f;

typedef struct solve {
    const hrt_patch *patch;
    int32_t dofs, rows;
    uint16_t start[HRT_PATCH_DOFS];               /* compliance of (i, j), j >= i, is at start[i] + j */
    float shift_m[HRT_PATCH_DOFS];                /* C f, or what one row does at the vertices that rows touch */
    int32_t touched_count;
    uint8_t touched[HRT_PATCH_MAX_VERTICES];      /* vertices under rows, ascending */
    float w[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS];  /* compliance between rows */
    float gap_m[HRT_CONTACT_ROWS];                /* with the patch undeformed, at the row's geometry */
    hrt_contact_row *row;
    float *force_N;                               /* f: what the shape is made with */
    float made_N[HRT_PATCH_DOFS];                 /* what the rows make of that shape */
} solve;

/* shift += c * column `dof` of the compliance. */
static void add_column(solve *s, int32_t dof, float c) {
    const int32_t n = s->dofs;
    float *shift = s->shift_m;
    const float *above = &s->patch->compliance_m_N[dof];
    for (int32_t i = 0; i < dof; i++) {
        shift[i] += c * *above;
        above += n - 1 - i;
    }
    const float *row = &s->patch->compliance_m_N[s->start[dof]];
    for (int32_t j = dof; j < n; j++) shift[j] += c * row[j];
}

static const uint8_t *corners(const solve *s, const hrt_contact_row *row) { return &s->patch->triangle[HRT_XYZ * row->triangle]; }

static void shift_by_forces(solve *s) {
    for (int32_t i = 0; i < s->dofs; i++) s->shift_m[i] = 0.0f;
    for (int32_t i = 0; i < s->dofs; i++)
        if (s->force_N[i] < 0.0f || s->force_N[i] > 0.0f) add_column(s, i, s->force_N[i]);
}

/* sum += weight * C_ab normal: the block of vertices a and b, of which the upper triangle is there. */
static void add_block(const solve *s, int32_t a, int32_t b, const float normal[3], float weight, float sum[3]) {
    const float *c = s->patch->compliance_m_N;
    const uint16_t *start = &s->start[HRT_XYZ * (a < b ? a : b)];
    const ptrdiff_t column = HRT_XYZ * (a < b ? b : a);
    const float *p = &c[start[0] + column], *q = &c[start[1] + column], *r = &c[start[2] + column];
    if (a < b) {
        sum[0] += weight * hrt_dot(normal, p);
        sum[1] += weight * hrt_dot(normal, q);
        sum[2] += weight * hrt_dot(normal, r);
    } else if (a > b) {
        for (int i = 0; i < 3; i++) sum[i] += weight * (normal[0] * p[i] + normal[1] * q[i] + normal[2] * r[i]);
    } else {
        sum[0] += weight * (normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2]);
        sum[1] += weight * (normal[0] * p[1] + normal[1] * q[1] + normal[2] * q[2]);
        sum[2] += weight * (normal[0] * p[2] + normal[1] * q[2] + normal[2] * r[2]);
    }
}

/* shift := C f of one newton in a row, at the touched vertices alone. */
static void shift_by_row(solve *s, const hrt_contact_row *row) {
    for (int32_t t = 0; t < s->touched_count; t++) {
        float *sum = &s->shift_m[HRT_XYZ * s->touched[t]];
        sum[0] = sum[1] = sum[2] = 0.0f;
        for (int k = 0; k < 3; k++)
            if (row->weight[k] > 0.0f) add_block(s, s->touched[t], corners(s, row)[k], row->normal, row->weight[k], sum);
    }
}

static void find_touched(solve *s) {
    bool under[HRT_PATCH_MAX_VERTICES] = {false};
    for (int32_t r = 0; r < s->rows; r++)
        for (int k = 0; k < 3; k++) under[corners(s, &s->row[r])[k]] = true;
    s->touched_count = 0;
    for (int32_t v = 0; v < s->patch->vertex_count; v++)
        if (under[v]) s->touched[s->touched_count++] = (uint8_t)v;
}

static float row_shift(const solve *s, const hrt_contact_row *row) {
    float sum = 0.0f;
    for (int k = 0; k < 3; k++) sum += row->weight[k] * hrt_dot(row->normal, &s->shift_m[HRT_XYZ * corners(s, row)[k]]);
    return sum;
}

static void find_rows(solve *s, const float tip_m[3]) {
    hrt_contact_row before[HRT_CONTACT_ROWS];
    const int32_t count = s->rows;
    for (int32_t r = 0; r < count; r++) before[r] = s->row[r];
    s->rows = hrt_contact_rows(s->patch, s->shift_m, tip_m, before, count, s->row);
    for (int32_t r = 0; r < s->rows; r++) {
        hrt_contact_row *row = &s->row[r];
        for (int32_t b = 0; b < count; b++)
            if (before[b].station == row->station && before[b].triangle == row->triangle && before[b].feature == row->feature)
                row->lambda_N = before[b].lambda_N;
        s->gap_m[r] = row->gap_m - row_shift(s, row);
    }
}

/* --- the unilateral problem of one set of rows --- */

/* Which branch of its skin a row is in. Sweeps over rows would need hundreds: the tissue gives way far more than the skin, and neighbours all feel
 * the same tissue. By branches it is a small symmetric positive definite system, and the branches of the last tick nearly always hold. */
typedef enum branch { OFF, SOFT, HARD, CAPPED } branch;

static float row_skin(const solve *s, int32_t i) { return s->patch->skin_compliance_m_N / s->row[i].share; }
static float soft_depth(const solve *s) { return SKIN_TRAVEL * s->patch->radius_m; }

static bool stands(branch b) { return b == SOFT || b == HARD; }

/* gap + W lambda + depth(lambda) of row i. */
static float row_error(const solve *s, int32_t i) {
    const float skin = row_skin(s, i), soft = soft_depth(s), straight = skin * s->row[i].lambda_N;
    float error = s->gap_m[i] + (straight <= soft ? straight : soft + (straight - soft) / SKIN_HARDENING);
    for (int32_t k = 0; k < s->rows; k++) error += s->w[i][k] * s->row[k].lambda_N;
    return error;
}

/* a x = a[][n], symmetric: the upper triangle alone is read and written. x comes back in a[][n]. */
static void eliminate(float a[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS + 1], int32_t n) {
    for (int32_t k = 0; k < n; k++) {
        const float inverse = a[k][k] > 1.0e-12f ? 1.0f / a[k][k] : 0.0f;
        for (int32_t i = k + 1; i < n; i++) {
            const float factor = a[k][i] * inverse;
            for (int32_t j = i; j <= n; j++) a[i][j] -= factor * a[k][j];
        }
    }
    for (int32_t k = n - 1; k >= 0; k--) {
        for (int32_t j = k + 1; j < n; j++) a[k][n] -= a[k][j] * a[j][n];
        a[k][n] = a[k][k] > 1.0e-12f ? a[k][n] / a[k][k] : 0.0f;
    }
}

static void solve_branches(solve *s, const branch state[HRT_CONTACT_ROWS]) {
    float a[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS + 1];
    int32_t at[HRT_CONTACT_ROWS], n = 0;
    for (int32_t i = 0; i < s->rows; i++) {
        if (stands(state[i])) at[n++] = i;
        else s->row[i].lambda_N = state[i] == CAPPED ? s->patch->force_cap_N : 0.0f;
    }
    for (int32_t r = 0; r < n; r++) {
        const int32_t i = at[r];
        const float skin = row_skin(s, i), soft = soft_depth(s);
        for (int32_t c = r; c < n; c++) a[r][c] = s->w[i][at[c]];
        a[r][r] += state[i] == SOFT ? skin : skin / SKIN_HARDENING;
        a[r][n] = -s->gap_m[i] - (state[i] == SOFT ? 0.0f : soft - soft / SKIN_HARDENING);
        for (int32_t k = 0; k < s->rows; k++)
            if (state[k] == CAPPED) a[r][n] -= s->w[i][k] * s->patch->force_cap_N;
    }
    eliminate(a, n);
    for (int32_t r = 0; r < n; r++) s->row[at[r]].lambda_N = a[r][n];
}

static branch next_branch(const solve *s, int32_t i, branch now) {
    const float lambda = s->row[i].lambda_N;
    if (now == OFF) return row_error(s, i) < 0.0f ? SOFT : OFF;
    if (now == CAPPED && row_error(s, i) > 0.0f) return HARD;
    if (!(lambda > 0.0f)) return OFF;
    if (lambda >= s->patch->force_cap_N) return CAPPED;
    return row_skin(s, i) * lambda > soft_depth(s) ? HARD : SOFT;
}

static void solve_rows(solve *s) {
    branch state[HRT_CONTACT_ROWS];
    for (int32_t i = 0; i < s->rows; i++) state[i] = s->row[i].lambda_N > 0.0f || s->gap_m[i] < 0.0f ? SOFT : OFF;
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
    for (int32_t i = 0; i < s->rows; i++) s->row[i].lambda_N = hrt_clamp(s->row[i].lambda_N, 0.0f, s->patch->force_cap_N);
}

/* --- rounds: the rows' normals turn with the shape that their forces make --- */

static void relax(solve *s) {
    find_touched(s);
    for (int32_t i = 0; i < s->rows; i++) {
        shift_by_row(s, &s->row[i]);
        for (int32_t j = 0; j <= i; j++) s->w[i][j] = s->w[j][i] = row_shift(s, &s->row[j]);
    }
    solve_rows(s);
    for (int32_t i = 0; i < s->dofs; i++) s->made_N[i] = 0.0f;
    for (int32_t r = 0; r < s->rows; r++)
        for (int k = 0; k < 3; k++)
            hrt_add_scaled(&s->made_N[HRT_XYZ * corners(s, &s->row[r])[k]], s->row[r].lambda_N * s->row[r].weight[k], s->row[r].normal);
}

static float dot_n(const float *a, const float *b, int32_t n) {
    float sum = 0.0f;
    for (int32_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* mix: the combination of the remembered changes of the residual that is nearest to it. */
static void nearest_mix(const hrt_mixing *m, int32_t n, float mix[HRT_MIXING_MEMORY]) {
    float a[HRT_MIXING_MEMORY][HRT_MIXING_MEMORY + 1], trace = 0.0f;
    const int32_t count = m->count;
    for (int32_t i = 0; i < count; i++) {
        for (int32_t j = 0; j <= i; j++) a[i][j] = a[j][i] = dot_n(m->residual_change_N[i], m->residual_change_N[j], n);
        a[i][count] = dot_n(m->residual_change_N[i], m->residual_N, n);
        trace += a[i][i];
    }
    for (int32_t k = 0; k < count; k++) {
        a[k][k] += 1.0e-5f * trace + 1.0e-30f;
        for (int32_t i = k + 1; i < count; i++) {
            const float factor = a[i][k] / a[k][k];
            for (int32_t j = k; j <= count; j++) a[i][j] -= factor * a[k][j];
        }
    }
    for (int32_t k = count - 1; k >= 0; k--) {
        for (int32_t j = k + 1; j < count; j++) a[k][count] -= a[k][j] * mix[j];
        mix[k] = a[k][count] / a[k][k];
    }
}

/* The next forces from those the shape was made with and those the rows made of it: Anderson's mixing over the last rounds, of earlier ticks too.
 * Taking the rows' forces as they are swings or creeps. */
static void take_forces(solve *s, hrt_mixing *m) {
    float mix[HRT_MIXING_MEMORY];
    const int32_t n = s->dofs, slot = m->next;
    for (int32_t i = 0; i < n; i++) {
        const float residual = s->made_N[i] - s->force_N[i];
        if (m->primed) {
            m->residual_change_N[slot][i] = residual - m->residual_N[i];
            m->force_change_N[slot][i] = s->force_N[i] - m->force_N[i];
        }
        m->residual_N[i] = residual;
        m->force_N[i] = s->force_N[i];
    }
    if (m->primed) {
        m->next = (slot + 1) % HRT_MIXING_MEMORY;
        if (m->count < HRT_MIXING_MEMORY) m->count++;
    }
    m->primed = true;
    nearest_mix(m, n, mix);
    for (int32_t i = 0; i < n; i++) {
        s->force_N[i] += m->residual_N[i];
        for (int32_t k = 0; k < m->count; k++) s->force_N[i] -= mix[k] * (m->force_change_N[k][i] + m->residual_change_N[k][i]);
    }
}

/* Bears mainly upon the patch's edge: the tissue goes on there and we do not know how. */
static bool on_edge(const solve *s, const hrt_contact_row *row) {
    float weight = 0.0f;
    for (int k = 0; k < 3; k++) weight += s->patch->topology.border[corners(s, row)[k]] != 0 ? row->weight[k] : 0.0f;
    return weight > 0.5f;
}

/* Reactions to the equivalent force at the tip of a tool that pivots about the origin; false when one is on the edge. */
static bool gather(const solve *s, const float tip_m[3], float force_N[3]) {
    const float reach = hrt_length(tip_m);
    const float axis[3] = {tip_m[0] / reach, tip_m[1] / reach, tip_m[2] / reach};
    bool inside = true;
    for (int i = 0; i < 3; i++) force_N[i] = 0.0f;
    for (int32_t r = 0; r < s->rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        if (!(row->lambda_N > 0.0f)) continue;
        inside = inside && !on_edge(s, row);
        const float lever = hrt_dot(row->point_m, axis) / reach, along = hrt_dot(row->normal, axis);
        for (int i = 0; i < 3; i++) force_N[i] -= row->lambda_N * (along * axis[i] + lever * (row->normal[i] - along * axis[i]));
    }
    return inside;
}

bool hrt_contact_force(hrt_extrapolation *x, const float tip_m[3], int32_t linearisations, float force_N[3]) {
    solve s;
    if (!(hrt_length(tip_m) > 1.0e-4f)) return false;
    s.patch = x->patch;
    s.dofs = 3 * x->patch->vertex_count;
    s.rows = x->row_count;
    for (int32_t i = 0; i < s.dofs; i++) s.start[i] = (uint16_t)(i * (2 * s.dofs - i - 1) / 2);
    s.row = x->row;
    s.force_N = x->patch_force_N;
    x->mixing.primed = false;
    for (int32_t k = 0; k < linearisations; k++) {
        shift_by_forces(&s);
        find_rows(&s, tip_m);
        relax(&s);
        take_forces(&s, &x->mixing);
    }
    x->row_count = s.rows;
    return gather(&s, tip_m, force_N);
}

void hrt_contact_clear(hrt_extrapolation *x) {
    x->row_count = 0;
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) x->patch_force_N[i] = 0.0f;
    x->mixing.count = x->mixing.next = 0;
    x->mixing.primed = false;
}

/* The vertex of `fresh` that is vertex v of `old`: the undeformed surface does not move. -1: not in it. */
static int32_t same_vertex(const hrt_patch *old, int32_t v, const hrt_patch *fresh) {
    for (int32_t u = 0; u < fresh->vertex_count; u++) {
        float apart[3];
        hrt_sub(&fresh->rest_m[HRT_XYZ * u], &old->rest_m[HRT_XYZ * v], apart);
        if (hrt_dot(apart, apart) < 1.0e-10f) return u;
    }
    return -1;
}

/* Numbers by the old patch's vertices to numbers by the fresh one's; what has no place there is dropped. */
static void renumber(float *by_vertex, const int32_t to[HRT_PATCH_MAX_VERTICES], int32_t old_count) {
    float moved[HRT_PATCH_DOFS] = {0};
    for (int32_t v = 0; v < old_count; v++)
        if (to[v] >= 0) hrt_copy(&moved[HRT_XYZ * to[v]], &by_vertex[HRT_XYZ * v]);
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) by_vertex[i] = moved[i];
}

void hrt_contact_warm(hrt_extrapolation *x, const hrt_patch *old, const hrt_patch *fresh) {
    int32_t to[HRT_PATCH_MAX_VERTICES];
    for (int32_t v = 0; v < old->vertex_count; v++) to[v] = same_vertex(old, v, fresh);
    /* What the rounds remember stays true of the same tissue. One call, so that it is in flash once. */
    for (int32_t k = 0; k <= 2 * x->mixing.count; k++) {
        float *list = x->patch_force_N;
        if (k > 0) list = k % 2 == 0 ? x->mixing.residual_change_N[(k - 1) / 2] : x->mixing.force_change_N[(k - 1) / 2];
        renumber(list, to, old->vertex_count);
    }
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
