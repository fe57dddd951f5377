/* `local_model`: solves contact on a patch of the surface with its compliance, in each tick. Detects the tool's rows
 * against the patch deformed by the last reactions. Solves 0 <= gap + contact compliance _|_ lambda >= 0 by active
 * sets, starting from these reactions. Does both twice. */
#include "internal.h"

enum { ROUNDS = 2, BRANCHES = 4 };
enum { LAW_ROWS = HRT_CONTACT_ROWS, LAW_DOFS = HRT_PATCH_DOFS, ANDERSON_DEPTH = HRT_ANDERSON_DEPTH };
#include "contact_law/active_set.h"
#define LAW_ANDERSON hrt_anderson
#define ANDERSON_FLOOR 1.0e-5f
#define ANDERSON_NOISE 1.0e-12f
#include "contact_law/anderson.h"

_Static_assert(ROUNDS % 2 == 0, "the rows of the last iteration are stored in the extrapolation");
_Static_assert(HRT_PATCH_MAX_VERTICES <= 32, "one bit for each vertex");
static const float MAINLY = 0.65f; /* boundary weight of a row, less than two of three corners */
static const float LITTLE = 0.1f;  /* squared change of the forces */

typedef struct solve {
    law_problem p; /* first member: law_couple casts it to solve */
    const hrt_patch *patch;
    hrt_contact_row *row,
        other[HRT_CONTACT_ROWS];   /* rows of this iteration, in `other` or the extrapolation's `row` in turn */
    float *force_N;                /* f: forces that deform the patch */
    float shift_m[HRT_PATCH_DOFS]; /* C f, then the response to one row; for the tip: the grasp's force */
    uint32_t coupled, under[HRT_CONTACT_ROWS]; /* bit i: row i of p.w is computed; bit v: the row acts on vertex v */
    law_anderson_iterate iterate;
#if HRT_WITH_FRICTION
    hrt_friction *friction; /* null: no friction */
#endif
} solve;

static inline __attribute__((always_inline)) law_v3 at(const float *list, int32_t v) {
    return vget(&list[HRT_XYZ * v]);
}

static const uint8_t *corners(const solve *s, const hrt_contact_row *row) {
    return &s->patch->triangle[HRT_XYZ * row->triangle];
}

/* Returns the vertices under a row, one bit each. */
static uint32_t vertices_under(const solve *s, const hrt_contact_row *row) {
    uint32_t under = 0;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) under |= 1u << corners(s, row)[k];
    return under;
}

static bool is_coupled(const solve *s, int32_t i) { return (s->coupled >> i & 1u) != 0; }

/* Computes the response of the vertices under rows that are not coupled yet. */
static void respond_under_rows(solve *s, const uint8_t *from, const law_v3 *x, int32_t count) {
    uint32_t under = 0;
    for (int32_t j = 0; j < s->p.rows; j++)
        if (!is_coupled(s, j)) under |= s->under[j];
    for (int32_t v = 0; v < s->patch->vertex_count; v++)
        if ((under >> v & 1u) != 0) hrt_patch_respond(s->patch, (uint32_t)v, from, x, count, s->shift_m);
}

/* Computes the vertices' displacements from the forces and, with `tip_m`, from the tip's motion since the sample
 * (grasp). The tip's entry is then the change of the grasp's force. Without `tip_m`: response to forces only, under the
 * rows only. */
static void shift_by_forces(solve *s, const float *tip_m) {
    law_v3 force[HRT_PATCH_MAX_VERTICES];
    uint8_t from[HRT_PATCH_MAX_VERTICES];
    int32_t count = 0;
    // cppcheck-suppress ctuuninitvar ; what is read of s is set: the patch, its forces
    for (int32_t v = 0; v < s->patch->vertex_count; v++) {
        from[count] = (uint8_t)v;
        force[count] = at(s->force_N, v);
        if (vinner(force[count], force[count]) > 0.0f) count++;
    }
    if (!tip_m) {
        respond_under_rows(s, from, force, count);
        return;
    }
    if (hrt_patch_grasps(s->patch)) {
        from[count] = (uint8_t)s->patch->vertex_count;
        force[count++] = vminus(vget(tip_m), at(s->patch->vertex_m, s->patch->vertex_count));
    }
    for (int32_t a = 0; a < hrt_patch_nodes(s->patch); a++)
        hrt_patch_respond(s->patch, (uint32_t)a, from, force, count, s->shift_m);
}

static float along_row(const solve *s, const hrt_contact_row *row) {
    const uint8_t *corner = corners(s, row);
    law_v3 shift = {0.0f, 0.0f, 0.0f};
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) shift = vplus(shift, vtimes(row->weight[k], at(s->shift_m, corner[k])));
    return vinner(vget(row->normal), shift);
}

/* Computes the gap change of all rows per newton in row i. For rows coupled before, symmetry gives the entry. */
static void law_couple(law_problem *p, int32_t i) {
    solve *s = (solve *)p;
    const hrt_contact_row *row = &s->row[i];
    uint8_t from[3];
    law_v3 newton[3];
    int32_t count = 0;
    if (is_coupled(s, i)) return;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0.0f) {
            from[count] = corners(s, row)[k];
            newton[count++] = vtimes(row->weight[k], vget(row->normal));
        }
    respond_under_rows(s, from, newton, count);
    for (int32_t j = 0; j < p->rows; j++) p->w[i][j] = is_coupled(s, j) ? p->w[j][i] : along_row(s, &s->row[j]);
    s->coupled |= 1u << i;
}

#if HRT_WITH_FRICTION
/* Computes the displacements by contact reactions alone, less friction as the previous rows distributed it. The gaps
 * less these keep friction's deformation. */
static void shift_without_friction(solve *s, const hrt_contact_row *before, int32_t count) {
    float pressing_N[HRT_PATCH_DOFS], *all_N = s->force_N;
    for (int32_t i = 0; i < 3 * s->patch->vertex_count; i++) pressing_N[i] = all_N[i];
    hrt_friction_load(s->friction, before, count);
    hrt_friction_add(s->friction, before, count, -1.0f, pressing_N);
    s->force_N = pressing_N;
    shift_by_forces(s, NULL);
    s->force_N = all_N;
}
#endif

static void find_rows(solve *s, const float tip_m[3], const hrt_shaft *shaft, hrt_hits *hits, hrt_contact_row *row) {
    const hrt_contact_row *before = s->row;
    const int32_t count = s->p.rows;
    s->p.rows = hrt_contact_rows(s->patch, s->shift_m, tip_m, shaft, before, count, hits, row);
    s->row = row;
    s->coupled = 0;
    for (int32_t r = 0; r < s->p.rows; r++) s->under[r] = vertices_under(s, &row[r]);
#if HRT_WITH_FRICTION
    if (s->friction) {
        hrt_friction_shape(s->friction, s->shift_m);
        shift_without_friction(s, before, count);
    } else
#endif
        if (hrt_patch_grasps(s->patch))
        shift_by_forces(s, NULL);
    for (int32_t r = 0; r < s->p.rows; r++, row++) {
        s->p.lambda_N[r] = 0.0f;
        for (int32_t b = 0; b < count; b++)
            if (before[b].station == row->station && before[b].triangle == row->triangle &&
                before[b].feature == row->feature)
                s->p.lambda_N[r] = before[b].lambda_N;
        s->p.gap_m[r] = row->gap_m - along_row(s, row);
        s->p.row_compliance_m_N[r] = s->patch->contact_compliance_m_N / row->share;
    }
}

/* Computes the residual: the rows' forces less those that deformed the patch. */
static void find_residual(solve *s) {
    float *residual_N = s->iterate.residual_N;
    for (int32_t i = 0; i < 3 * s->patch->vertex_count; i++) residual_N[i] = -s->force_N[i];
    for (int32_t r = 0; r < s->p.rows; r++) {
        hrt_contact_row *row = &s->row[r];
        row->lambda_N = s->p.lambda_N[r];
        for (int k = 0; k < 3; k++) {
            float *on = &residual_N[HRT_XYZ * corners(s, row)[k]];
            vadd(on, row->weight[k] * row->lambda_N, row->normal);
        }
    }
#if HRT_WITH_FRICTION
    if (s->friction) hrt_friction_iterate(s->friction, s->row, s->p.rows, residual_N);
#endif
}

/* Returns whether a row acts mainly on the patch's boundary: the compliance beyond it is unknown. */
static bool on_edge(const solve *s, const hrt_contact_row *row) {
    float weight = 0.0f;
    for (int k = 0; k < 3; k++)
        weight += (s->patch->topology.boundary >> corners(s, row)[k] & 1u) != 0 ? row->weight[k] : 0.0f;
    return weight > MAINLY;
}

/* Returns the tip's velocity since the last tick, m/s; `swing` is the velocity less its mean over radiation_s. */
static law_v3 tip_speed(const hrt_patch *patch, hrt_touch *touch, int64_t now_us, const float tip_m[3], law_v3 *swing) {
    const float passed_s = law_max(1.0e-6f * (float)(uint32_t)(now_us - touch->drag_us), 1.0e-6f);
    const law_v3 speed = vtimes(1.0f / passed_s, vminus(vget(tip_m), vget(touch->drag_tip_m)));
    *swing = vtimes(patch->radiation_s / (passed_s + patch->radiation_s), vminus(speed, vget(touch->mean_m_s)));
    vput(vminus(speed, *swing), touch->mean_m_s);
    vset(tip_m, touch->drag_tip_m);
    touch->drag_us = now_us;
    return speed;
}

/* Adds radiation damping: waves carry energy into tissue with mass, but a patch is quasi-static. The damper acts on the
 * swing along the force, of a grasp on all of it. The sample's shape includes the mean velocity already. Limited to
 * half of the force, so that a probe is never pulled. */
static void radiate(const hrt_patch *patch, hrt_touch *touch, law_v3 swing, float force_N[3]) {
    const law_v3 force = vget(force_N);
    const float size2 = vinner(force, force);
    if (!(size2 > 0.0f)) {
        for (int i = 0; i < 3; i++) touch->mean_m_s[i] = 0.0f;
        return;
    }
    if (!hrt_patch_grasps(patch)) swing = vtimes(vinner(swing, force) / size2, force);
    const float size = patch->radiation_N_s_m * vsize(swing), most = 0.5f * sqrtf(size2);
    vput(vminus(force, vtimes(patch->radiation_N_s_m * (size > most ? most / size : 1.0f), swing)), force_N);
}

/* Sums reactions, drag along the surface and the grasp's force to the equivalent tip force of a tool that pivots about
 * the origin, or is free: then to their sum. Returns false if most of it is on the boundary. */
static bool gather(const solve *s, const float tip_m[3], const hrt_shaft *shaft, law_v3 drag, float force_N[3]) {
    const law_v3 tip = vget(tip_m);
    const float reach = hrt_is_free(shaft) ? 1.0e6f : vsize(tip);
    const law_v3 axis = vtimes(1.0f / reach, tip);
    law_v3 force = {0.0f, 0.0f, 0.0f};
    float along_N = 0.0f, on_edge_N = 0.0f; /* load on the boundary less load elsewhere */
    if (hrt_patch_grasps(s->patch)) {
        force = vplus(at(s->patch->rest_m, s->patch->vertex_count), at(s->shift_m, s->patch->vertex_count));
        on_edge_N = -vsize(force);
    }
    for (int32_t r = 0; r < s->p.rows; r++) {
        const hrt_contact_row *row = &s->row[r];
        if (!(row->lambda_N > 0.0f)) continue;
        on_edge_N += on_edge(s, row) ? row->lambda_N : -row->lambda_N;
        const law_v3 normal = vget(row->normal);
        law_v3 push = vplus(drag, vtimes(1.0f - vinner(drag, normal), normal));
#if HRT_WITH_FRICTION
        const hrt_friction_station *g = s->friction ? hrt_friction_station_of(s->friction, row) : NULL;
        if (g) push = vplus(push, vtimes(1.0f / g->load_N, vget(g->is.force_N)));
#endif
        const float lever = hrt_is_free(shaft) ? 1.0f : 1.0f - (float)row->station * s->patch->radius_m / reach;
        force = vminus(force, vtimes(row->lambda_N * lever, push));
        along_N -= row->lambda_N * (1.0f - lever) * vinner(push, axis);
    }
    vput(vplus(force, vtimes(along_N, axis)), force_N);
    return !(on_edge_N > 0.0f);
}

bool hrt_contact_force(const hrt_patch *patch, hrt_touch *touch, int64_t now_us, const float tip_m[3],
                       float force_N[3]) {
    solve s;
    hrt_hits hits = {.count = -1};
    if (!hrt_is_free(&touch->shaft) && !(vnorm(tip_m) > 1.0e-4f)) return false;
    s.patch = patch;
    s.p.rows = touch->row_count;
    s.p.soft_m = LAW_COMPLIANCE_TRAVEL * patch->radius_m;
    s.p.cap_N = patch->force_cap_N;
    s.row = touch->row;
    s.force_N = touch->patch_force_N;
    touch->anderson.used = true;
#if HRT_WITH_FRICTION
    hrt_friction friction;
    // cppcheck-suppress uninitvar ; hrt_friction_begin sets what is read of it
    s.friction = s.patch->friction_static > 0.0f ? &friction : NULL;
    if (s.friction) hrt_friction_begin(&friction, s.patch, &touch->friction, tip_m, &touch->shaft);
#endif
    for (int32_t k = 0; k < ROUNDS; k++) {
        shift_by_forces(&s, tip_m);
        find_rows(&s, tip_m, &touch->shaft, &hits, s.row == touch->row ? s.other : touch->row);
        law_solve(&s.p, BRANCHES);
        find_residual(&s);
        /* On nearly the same shape the tool is near the same features. */
        if (law_anderson_step(&touch->anderson, &s.iterate, s.force_N, 3 * s.patch->vertex_count, k == 0) >= LITTLE)
            hits.count = -1;
    }
    touch->row_count = s.p.rows;
#if HRT_WITH_FRICTION
    if (s.friction) hrt_friction_settle(&friction, 1.0e-6f * (float)(uint32_t)(now_us - touch->drag_us));
#endif
    law_v3 swing;
    const law_v3 speed = tip_speed(patch, touch, now_us, tip_m, &swing);
    const bool within = gather(&s, tip_m, &touch->shaft, vtimes(patch->drag_s_m, speed), force_N);
    radiate(patch, touch, swing, force_N);
    return within;
}

void hrt_local_model_clear(hrt_touch *touch) {
    touch->row_count = 0;
    if (!touch->anderson.used) return;
    touch->anderson = (hrt_anderson){0};
#if HRT_WITH_FRICTION
    touch->friction = (hrt_friction_history){0};
#endif
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) touch->patch_force_N[i] = 0.0f;
}

/* Returns the vertex of `fresh` with the undeformed position of vertex v of `old`, -1 if there is none. */
static int32_t same_vertex(const hrt_patch *old, int32_t v, const hrt_patch *fresh) {
    const law_v3 place = at(old->rest_m, v);
    for (int32_t u = 0; u < fresh->vertex_count; u++) {
        const law_v3 apart = vminus(at(fresh->rest_m, u), place);
        if (vinner(apart, apart) < 1.0e-10f) return u;
    }
    return -1;
}

/* Renumbers values per vertex from the old patch to the new one; drops vertices that are not in it. */
static void renumber(float *by_vertex, const int8_t to[HRT_PATCH_MAX_VERTICES], int32_t old_count) {
    float moved[HRT_PATCH_DOFS] = {0};
    for (int32_t v = 0; v < old_count; v++)
        if (to[v] >= 0) vset(&by_vertex[HRT_XYZ * v], &moved[HRT_XYZ * to[v]]);
    for (int32_t i = 0; i < HRT_PATCH_DOFS; i++) by_vertex[i] = moved[i];
}

#if HRT_WITH_FRICTION
static void renumber_friction(hrt_friction_history *r, const int8_t to[HRT_PATCH_MAX_VERTICES], int32_t old_count,
                              const hrt_patch *fresh) {
    uint32_t known = 0;
    for (int32_t v = 0; v < old_count; v++)
        if (to[v] >= 0 && (r->known >> v & 1u) != 0) known |= 1u << to[v];
    renumber(r->u_m, to, old_count);
    r->known = known;
    if (!(fresh->friction_static > 0.0f)) *r = (hrt_friction_history){0};
}
#endif

void hrt_local_model_warm(hrt_touch *touch, const hrt_patch *old, const hrt_patch *fresh) {
    int8_t to[HRT_PATCH_MAX_VERTICES];
    for (int32_t v = 0; v < old->vertex_count; v++) {
        const law_v3 force = at(touch->patch_force_N, v);
        to[v] = (int8_t)(vinner(force, force) > 0.0f || old->friction_static > 0.0f ? same_vertex(old, v, fresh) : -1);
    }
#if HRT_WITH_FRICTION
    if (old->friction_static > 0.0f) renumber_friction(&touch->friction, to, old->vertex_count, fresh);
#endif
    /* The Anderson history stays valid for the same tissue. One call, so that it is in flash once. */
    for (int k = -1; k < 2 * HRT_ANDERSON_DEPTH; k++)
        renumber(k < 0        ? touch->patch_force_N
                 : k % 2 == 0 ? touch->anderson.residual_change_N[k / 2]
                              : touch->anderson.step_N[k / 2],
                 to, old->vertex_count);
    int32_t kept = 0;
    for (int32_t r = 0; r < touch->row_count; r++)
        for (int32_t t = 0; t < fresh->triangle_count; t++) {
            if (fresh->face[t] != old->face[touch->row[r].triangle]) continue;
            touch->row[kept] = touch->row[r];
            touch->row[kept++].triangle = (uint8_t)t;
            break;
        }
    touch->row_count = kept;
}
