/* Solver of contact against a patch, which is used as a model with its own compliance. */
#include "patch/patch_internal.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"

#define BRANCHES 16
#define SWEEPS 50
#define ROUNDS 40

enum { LAW_ROWS = 64, LAW_DOFS = TM_PATCH_DOFS, ANDERSON_DEPTH = 6 };
#include "contact_law/active_set.h"

/* Anderson mixing over the last iterations. */
typedef struct anderson {
    uint8_t next;
    double residual_change_N[ANDERSON_DEPTH][LAW_DOFS], step_N[ANDERSON_DEPTH][LAW_DOFS];
} anderson;
#define LAW_ANDERSON anderson
#define ANDERSON_FLOOR 1e-12
#define ANDERSON_NOISE 0.0
#include "contact_law/anderson.h"

/* State from which a solve starts. */
struct rest {
    tm_contact_row row[LAW_ROWS];
    int32_t row_count;
    double force_N[TM_PATCH_DOFS];
};

struct tm_patch_solver {
    tm_pool pool;
    tm_contact_search *search;
    int32_t vertex[TM_PATCH_VERTICES], vertex_count; /* of the patch to which the rows belong */
    tm_contact_row row[LAW_ROWS], previous[LAW_ROWS];
    int32_t row_count, previous_count;
    double response[LAW_ROWS][TM_PATCH_DOFS]; /* C J^T of each row */
    law_problem problem;
    double free_m[TM_PATCH_DOFS]; /* displacement without the row forces, for the present tip */
    double force_N[TM_PATCH_DOFS], u_m[TM_PATCH_DOFS];
    tm_grasp_work grasp;
    law_anderson_iterate iterate;
    anderson anderson;
    struct rest rest; /* at the present tip; others are for tips nearby */
    double here_N[3]; /* force there */
};

int32_t tm_patch_place(const tm_patch *patch, int32_t vertex) {
    for (int32_t i = 0; i < patch->vertex_count; i++)
        if (patch->vertex[i] == vertex) return i;
    return -1;
}

void tm_patch_deform(const tm_patch *patch, const double *force_N, double sign, double *position_m) {
    int32_t n = 3 * patch->vertex_count;
    for (int32_t j = 0; j < n; j++) {
        double force = sign * force_N[j];
        if (force == 0) continue;
        int32_t at = j; /* column j above the diagonal; packed rows, each from its diagonal on */
        for (int32_t i = 0; i < j; at += n - 1 - i, i++) position_m[i] += force * patch->compliance_m_N[at];
        const double *row = patch->compliance_m_N + at;
        for (int32_t i = j; i < n; i++) position_m[i] += force * row[i - j];
    }
}

tm_status tm_patch_solver_create(tm_patch_solver **made, tm_error *error) {
    tm_pool pool = {0};
    tm_patch_solver *solver = TM_ALLOC(&pool, tm_patch_solver, 1);
    if (!solver) return tm_fail_memory(error, "patch solver");
    tm_status status = tm_contact_search_create(&solver->search, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    solver->pool = pool;
    *made = solver;
    return TM_OK;
}

void tm_patch_solver_destroy(tm_patch_solver *solver) {
    if (!solver) return;
    tm_contact_search_destroy(solver->search);
    tm_pool pool = solver->pool;
    tm_pool_release(&pool);
}

static bool same_row(const tm_contact_row *a, const tm_contact_row *b) {
    return a->station == b->station && a->face == b->face && a->feature == b->feature;
}

/* Removes rows on held vertices, which are no obstacle. */
static void leave_out_held(tm_patch_solver *s, const tm_patch *patch) {
    int32_t kept = 0;
    for (int32_t i = 0; i < s->row_count; i++) {
        bool all = true;
        for (int j = 0; j < 3; j++)
            all = all && (s->row[i].weight[j] <= 0 || (patch->grasped >> s->row[i].vertex[j] & 1u) != 0);
        if (!all) s->row[kept++] = s->row[i];
    }
    s->row_count = kept;
}

/* Finds rows on the shape under the present forces, with the previous multipliers of equal rows. */
static void find_rows(tm_patch_solver *s, const tm_patch *patch, const tm_capsule *capsule) {
    memcpy(s->previous, s->row, sizeof *s->row * (size_t)s->row_count);
    s->previous_count = s->row_count;
    memcpy(s->u_m, s->free_m, sizeof s->u_m);
    tm_patch_deform(patch, s->force_N, 1, s->u_m);
    bool overflowed;
    s->row_count = tm_contact_search_rows(s->search, patch->rest_m, s->u_m, capsule, 0.2 * capsule->radius_m,
                                          s->previous, s->previous_count, s->row, LAW_ROWS, &overflowed);
    leave_out_held(s, patch);
    for (int32_t i = 0; i < s->row_count; i++)
        for (int32_t k = 0; k < s->previous_count; k++)
            if (same_row(s->row + i, s->previous + k)) s->row[i].lambda_N = s->previous[k].lambda_N;
}

static double row_shift(const tm_contact_row *row, const double *u_m) {
    double sum = 0;
    for (int j = 0; j < 3; j++) sum += row->weight[j] * vdot(row->normal, u_m + 3 * row->vertex[j]);
    return sum;
}

/* Does nothing: all rows are coupled when they are found. */
static void law_couple(law_problem *p, int32_t i) { (void)p, (void)i; }

static void linearise(tm_patch_solver *s, const tm_patch *patch) {
    double shift[TM_PATCH_DOFS];
    law_problem *p = &s->problem;
    p->rows = s->row_count;
    p->soft_m = LAW_COMPLIANCE_TRAVEL * patch->radius_m;
    p->cap_N = patch->force_cap_N;
    for (int32_t i = 0; i < 3 * patch->vertex_count; i++) shift[i] = s->u_m[i] - s->free_m[i];
    for (int32_t i = 0; i < s->row_count; i++) {
        double unit[TM_PATCH_DOFS] = {0};
        for (int j = 0; j < 3; j++)
            vmadd(unit + 3 * s->row[i].vertex[j], s->row[i].weight[j], s->row[i].normal,
                  unit + 3 * s->row[i].vertex[j]);
        memset(s->response[i], 0, sizeof s->response[i]);
        tm_patch_deform(patch, unit, 1, s->response[i]);
        p->gap_m[i] = s->row[i].gap_m - row_shift(s->row + i, shift);
        p->row_compliance_m_N[i] = patch->contact_compliance_m_N / s->row[i].share;
        p->lambda_N[i] = s->row[i].lambda_N;
    }
    for (int32_t i = 0; i < s->row_count; i++)
        for (int32_t k = 0; k < s->row_count; k++) p->w[k][i] = row_shift(s->row + i, s->response[k]);
}

static void solve_rows(tm_patch_solver *s) {
    law_problem *p = &s->problem;
    const bool settled = law_solve(p, BRANCHES);
    p->loaded_count = p->rows;
    for (int32_t i = 0; i < p->rows; i++) p->loaded[i] = (uint8_t)i;
    for (int k = 0; k < SWEEPS && !settled; k++) /* fallback if the statuses do not converge */
        for (int32_t i = 0; i < p->rows; i++) {
            const double free_gap = law_row_error(p, i) -
                                    law_compliance_depth(p->row_compliance_m_N[i], p->soft_m, p->lambda_N[i]) -
                                    p->w[i][i] * p->lambda_N[i];
            p->lambda_N[i] =
                law_compliance_reaction(p->row_compliance_m_N[i], p->soft_m, free_gap, fmax(p->w[i][i], 0), p->cap_N);
        }
    for (int32_t i = 0; i < p->rows; i++) s->row[i].lambda_N = p->lambda_N[i];
}

/* Compares the row forces with those that produced the shape, and sets the next ones. Returns the maximum residual. */
static double take_forces(tm_patch_solver *s, const tm_patch *patch, int32_t round) {
    const int32_t n = 3 * patch->vertex_count;
    double largest = 0, *residual = s->iterate.residual_N;
    for (int32_t i = 0; i < n; i++) residual[i] = -s->force_N[i];
    for (int32_t i = 0; i < s->row_count; i++)
        for (int j = 0; j < 3; j++)
            vmadd(residual + 3 * s->row[i].vertex[j], s->row[i].lambda_N * s->row[i].weight[j], s->row[i].normal,
                  residual + 3 * s->row[i].vertex[j]);
    for (int32_t i = 0; i < n; i++) largest = fmax(largest, fabs(residual[i]));
    law_anderson_step(&s->anderson, &s->iterate, s->force_N, n, round == 0);
    return largest;
}

/* Finds the border: vertices of edges that only one triangle of the patch has. */
static void find_boundary(const tm_patch *patch, bool boundary[TM_PATCH_VERTICES]) {
    memset(boundary, 0, sizeof(bool) * TM_PATCH_VERTICES);
    for (int32_t t = 0; t < patch->triangle_count; t++)
        for (int j = 0; j < 3; j++) {
            int8_t a = patch->triangle[3 * t + j], b = patch->triangle[3 * t + (j + 1) % 3];
            int seen = 0;
            for (int32_t o = 0; o < 3 * patch->triangle_count; o++) {
                int8_t c = patch->triangle[o], d = patch->triangle[o - o % 3 + (o + 1) % 3];
                seen += (a == c && b == d) || (a == d && b == c);
            }
            if (seen < 2) boundary[a] = boundary[b] = true;
        }
}

static bool is_inside(const tm_patch_solver *s, const tm_patch *patch) {
    bool boundary[TM_PATCH_VERTICES];
    find_boundary(patch, boundary);
    for (int32_t i = 0; i < s->row_count; i++) {
        double weight = 0;
        for (int j = 0; j < 3; j++) weight += boundary[s->row[i].vertex[j]] ? s->row[i].weight[j] : 0;
        if (s->row[i].lambda_N > 0 && weight > 0.5) return false;
    }
    return true;
}

/* Returns whether all indices of the patch are within its arrays. */
static bool is_whole(const tm_patch *patch) {
    if (patch->vertex_count < 0 || patch->vertex_count > TM_PATCH_VERTICES || patch->triangle_count < 0 ||
        patch->triangle_count > TM_PATCH_TRIANGLES || !(patch->radius_m > 0))
        return false;
    for (int32_t i = 0; i < 3 * patch->triangle_count; i++)
        if (patch->triangle[i] < 0 || patch->triangle[i] >= patch->vertex_count) return false;
    return true;
}

/* Computes the grasp force on the tool: at the original tip, by tip motion, and by the rows' effect on held
 * vertices. */
static void grasp_force(const tm_patch_solver *s, const tm_patch *patch, const double moved[3], double force_N[3]) {
    memset(force_N, 0, 3 * sizeof(double));
    if (!patch->grasps) return;
    for (int i = 0; i < 3; i++) force_N[i] = patch->grasp_N[i] + vdot(patch->grasp_stiffness_N_m + 3 * i, moved);
    for (int32_t k = 0; k < s->row_count; k++)
        for (int j = 0; j < 9; j++)
            vmadd(force_N, s->row[k].lambda_N * s->row[k].weight[j / 3] * s->row[k].normal[j % 3],
                  patch->dvertex_dtip + 9 * s->row[k].vertex[j / 3] + 3 * (j % 3), force_N);
}

/* Computes the force of grasp and rows on the tool, equivalent at the tip. */
static void tip_force(const tm_patch_solver *s, const tm_patch *patch, const double tip_m[3], double force_N[3]) {
    double moved[3];
    vsub(tip_m, patch->grasp_tip_m, moved);
    grasp_force(s, patch, moved, force_N);
    const tm_lever lever = tm_patch_lever(patch, tip_m);
    for (int32_t i = 0; i < s->row_count; i++) {
        double on_tool[3], at_tip[3];
        vscale(-s->row[i].lambda_N, s->row[i].normal, on_tool);
        tm_lever_force(&lever, s->row[i].point_m, on_tool, at_tip);
        vmadd(force_N, 1, at_tip, force_N);
    }
}

tm_grasp_work *tm_patch_solver_work(tm_patch_solver *s) { return &s->grasp; }

static void forget(tm_patch_solver *s, const tm_patch *patch) {
    s->vertex_count = patch->vertex_count;
    memcpy(s->vertex, patch->vertex, sizeof(int32_t) * (size_t)patch->vertex_count);
    s->row_count = 0;
    memset(s->force_N, 0, sizeof s->force_N);
}

/* Starts the next solve from the model's own reactions. Tissue may have several equilibria under one tool; those of the
 * previous frame may lead to another one. */
static void tm_patch_solver_start(tm_patch_solver *s, const tm_patch *patch, const tm_contact_row *row,
                                  int32_t row_count) {
    forget(s, patch);
    for (int32_t k = 0; k < row_count && s->row_count < LAW_ROWS; k++) {
        tm_contact_row own = row[k];
        bool within = own.instrument == patch->instrument && own.lambda_N > 0;
        for (int j = 0; j < 3 && within; j++) {
            const int32_t at = tm_patch_place(patch, own.vertex[j]);
            within = at >= 0 || own.weight[j] == 0;
            own.vertex[j] = at >= 0 ? at : 0;
        }
        if (!within) continue;
        for (int j = 0; j < 3; j++)
            vmadd(s->force_N + 3 * own.vertex[j], own.lambda_N * own.weight[j], own.normal,
                  s->force_N + 3 * own.vertex[j]);
        s->row[s->row_count++] = own;
    }
}

void tm_patch_force(tm_patch_solver *s, const tm_patch *patch, const double tip_m[3], double force_N[3], bool *inside) {
    TM_REQUIRE(s && patch && tip_m && force_N, "solver, patch, tip_m or force_N is null", );
    TM_REQUIRE(is_whole(patch) && tm_are_places(tip_m),
               "the patch's counts, triangles or radius are out of range, or tip_m is", );
    tm_instrument_def def = {
        .is_free = patch->is_free, .radius_m = patch->radius_m, .contact_length_m = patch->contact_length_m};
    tm_tool_pose pose = {.active = true};
    tm_surface_view surface = {.count = patch->triangle_count};
    int32_t triangle[3 * TM_PATCH_TRIANGLES];
    double moved[3];
    vset(patch->trocar_m, def.trocar_m);
    vset(tip_m, pose.tip_m);
    vset(patch->direction, pose.direction);
    tm_capsule capsule = tm_tool_capsule(&def, &pose, patch->instrument);
    for (int32_t i = 0; i < 3 * patch->triangle_count; i++) triangle[i] = patch->triangle[i];
    surface.triangle = triangle;
    surface.face = patch->face;
    if (s->vertex_count != patch->vertex_count ||
        memcmp(s->vertex, patch->vertex, sizeof(int32_t) * (size_t)patch->vertex_count))
        forget(s, patch);
    vsub(tip_m, patch->grasp_tip_m, moved);
    for (int32_t i = 0; i < 3 * patch->vertex_count; i++)
        s->free_m[i] =
            patch->vertex_m[i] - patch->rest_m[i] + (patch->grasps ? vdot(patch->dvertex_dtip + 3 * i, moved) : 0);
    memcpy(s->u_m, s->free_m, sizeof s->u_m);
    tm_patch_deform(patch, s->force_N, 1, s->u_m);
    tm_contact_search_gather(s->search, patch->rest_m, s->u_m, &surface, &capsule, 1);
    s->anderson = (anderson){0};
    for (int32_t k = 0; k < ROUNDS; k++) {
        find_rows(s, patch, &capsule);
        linearise(s, patch);
        solve_rows(s);
        if (take_forces(s, patch, k) < 2e-8) break;
    }
    tip_force(s, patch, tip_m, force_N);
    if (inside) *inside = is_inside(s, patch);
}

static void keep_rest(const tm_patch_solver *s, struct rest *rest) {
    rest->row_count = s->row_count;
    memcpy(rest->row, s->row, sizeof *s->row * (size_t)s->row_count);
    memcpy(rest->force_N, s->force_N, sizeof rest->force_N);
}

static void return_to_rest(tm_patch_solver *s, const struct rest *rest) {
    s->row_count = rest->row_count;
    memcpy(s->row, rest->row, sizeof *s->row * (size_t)rest->row_count);
    memcpy(s->force_N, rest->force_N, sizeof s->force_N);
}

/* Returns whether the change of force over a step, N/m, leads to another equilibrium. Only rotating normals reduce the
 * force on an approaching tool, and by at most the force over the radius. */
static bool snapped(const double change[3], int along, double force_N, double radius_m) {
    return change[along] > 4 * force_N / radius_m;
}

/* Uses differences to both sides, each from the equilibrium at the present tip; if the tissue snaps on one side, those
 * of the other. */
void tm_patch_stiffness(tm_patch_solver *s, const tm_patch *patch, const double tip_m[3], double stiffness_N_m[9]) {
    TM_REQUIRE(s && patch && tip_m && stiffness_N_m && is_whole(patch) && tm_are_places(tip_m),
               "an argument is null, or the patch or tip_m is out of range", );
    const double h = 2e-5;
    double here[3];
    tm_patch_force(s, patch, tip_m, here, NULL);
    vset(here, s->here_N);
    keep_rest(s, &s->rest);
    for (int c = 0; c < 3; c++) {
        double change[2][3];
        bool snaps[2];
        for (int side = 0; side < 2; side++) {
            double at[3], there[3];
            vset(tip_m, at);
            at[c] += side ? -h : h;
            tm_patch_force(s, patch, at, there, NULL);
            return_to_rest(s, &s->rest);
            for (int i = 0; i < 3; i++) change[side][i] = (side ? here[i] - there[i] : there[i] - here[i]) / h;
            snaps[side] = snapped(change[side], c, vnorm(here), patch->radius_m);
        }
        const double ahead = snaps[0] ? 0 : snaps[1] ? 1 : 0.5, behind = snaps[1] ? 0 : 1 - ahead;
        for (int i = 0; i < 3; i++) stiffness_N_m[3 * i + c] = ahead * change[0][i] + behind * change[1][i];
    }
}

bool tm_patch_find_stiffness(tm_patch_solver *s, const tm_patch *patch, const tm_contact_row *row, int32_t row_count,
                             const double tip_m[3], double stiffness_N_m[9]) {
    const double share = 0.3, least_N = 0.05; /* as much comes from the drag of a moving tool, and from waves */
    double is[3], off[3];
    tm_patch_solver_start(s, patch, row, row_count);
    tip_force(s, patch, tip_m, is);
    tm_patch_stiffness(s, patch, tip_m, stiffness_N_m);
    vsub(s->here_N, is, off);
    return vnorm(off) <= share * vnorm(is) + least_N;
}
