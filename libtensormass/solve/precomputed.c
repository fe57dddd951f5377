/* Precomputed model: stored responses of the surface, and the online contact solver on them. */
#include "precomputed.h"

#include <math.h>
#include <string.h>

tm_precomputed_def tm_precomputed_def_default(void) {
    return (tm_precomputed_def){.cookie = TMS_COOKIE_PRECOMPUTED,
                                .size = sizeof(tm_precomputed_def),
                                .problem = tm_solve_def_default(),
                                .max_contact_vertices = 256,
                                .update_s = 0.002};
}

static tm_status get_responses(const tm_precomputed_def *def, bool force, tms_responses *responses,
                               tm_solve_report *report, tm_error *error) {
    const tm_surface_view surface = tm_tissue_surface(def->problem.tissue);
    uint8_t *wanted = tms_alloc_zeroed((size_t)tm_tissue_mesh(def->problem.tissue)->vertex_count, 1);
    if (!wanted) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to list the surface; use a coarser mesh");
    for (int32_t i = 0; i < 3 * surface.count; i++) wanted[surface.triangle[i]] = 1;
    const tms_request request = {.def = &def->problem,
                                 .wanted = wanted,
                                 .precision = def->precision,
                                 .file = def->file,
                                 .resume = def->resume,
                                 .ranks = def->ranks};
    const tm_status status = tms_responses_get(&request, force, responses, report, error);
    tms_free(wanted);
    return status;
}

void tms_precomputed_compliance(void *self, int32_t a, int32_t b, double C[9]) {
    const tm_precomputed *m = self;
    for (int i = 0; i < 9; i++) {
        const int32_t row = m->kept_index[3 * a + i / 3], column = m->kept_index[3 * b + i % 3];
        C[i] = row < 0 || column < 0 ? 0 : tms_response(&m->responses, column, row);
    }
}

static tm_status set_up(tm_precomputed *m, const tm_precomputed_def *def, tm_error *error) {
    const tm_mesh *mesh = tm_tissue_mesh(def->problem.tissue);
    const int32_t n = 3 * mesh->vertex_count;
    const tms_responses *r = &m->responses;
    m->tissue = def->problem.tissue;
    m->kept_index = tms_alloc((size_t)n * sizeof *m->kept_index);
    m->surface = tms_alloc((size_t)(r->kept_count + 1) * sizeof *m->surface);
    m->sum = tms_alloc_zeroed((size_t)(r->kept_count + 1), sizeof *m->sum);
    if (!m->kept_index || !m->surface || !m->sum)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the online contact solver; use a coarser mesh");
    tm_status status = tms_contact_solver_create(mesh, tm_tissue_surface(m->tissue), def->contact, def->grasp,
                                                 def->max_contact_vertices, &m->solver, error);
    if (status != TM_OK) return status;
    m->solver.update_s = def->update_s;
    if (def->contact && def->friction) {
        m->solver.friction = tms_friction_create(def->friction, &m->solver.def, mesh->vertex_count);
        if (!m->solver.friction) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for friction; use a coarser mesh");
        m->solver.now.station = m->solver.friction->station[0],
        m->solver.probe.station = m->solver.friction->station[1];
        for (int32_t t = 0; t < m->solver.tool_count; t++) tms_contact_solver_friction_place(&m->solver, t);
    }
    m->solver.self = m;
    if (def->contact && !(m->yield = tms_alloc((size_t)(3 * TMS_FELT) * 24 * (size_t)m->solver.capacity)))
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the online contact solver; use a coarser mesh");
    if (def->contact && def->grasp && (status = tm_patch_solver_create(&m->patch_solver, error)) != TM_OK)
        return status;
    m->solver.compliance = tms_precomputed_compliance;
    for (int32_t d = 0; d < n; d++) m->kept_index[d] = -1;
    for (int32_t i = 0; i < r->kept_count; i++) {
        const int32_t v = r->kept[i] / 3;
        m->kept_index[r->kept[i]] = i;
        m->solver.base_m[r->kept[i]] = r->base_m[i];
        if (!m->surface_count || m->surface[m->surface_count - 1] != v) m->surface[m->surface_count++] = v;
    }
    const tm_surface_view surface = m->solver.surface;
    for (int32_t i = 0; i < 9 * surface.count; i++) { /* prescribed components of the surface */
        const int32_t d = 3 * surface.triangle[i / 3] + i % 3;
        if (def->problem.fixed[d]) m->solver.base_m[d] = def->problem.fixed_value_m ? def->problem.fixed_value_m[d] : 0;
    }
    memcpy(m->solver.u_m, m->solver.base_m, (size_t)n * 8);
    return TM_OK;
}

static tm_status check(const tm_precomputed_def *def, tm_error *error) {
    tm_status status = tms_check_problem(&def->problem, error);
    if (status == TM_OK) status = tms_check_precision(def->precision, error);
    if (status == TM_OK && def->ranks && def->ranks->distributed && def->problem.solver != TM_SOLVER_CHOLESKY)
        status = tm_fail(error, TM_ERR_ARGUMENT, -1,
                         "conjugate gradients have no factor to distribute; leave one of the two out");
    if (status == TM_OK && !(def->update_s > 0 && def->update_s <= 1e6))
        status =
            tm_fail(error, TM_ERR_ARGUMENT, -1, "the update interval is %g s; give a positive time", def->update_s);
    for (int32_t t = 0; status == TM_OK && def->contact && def->friction && t < def->contact->instrument_count; t++) {
        const tm_friction_coefficient *c = &def->friction->instrument[t];
        if (!(c->mu_kinetic >= 0 && c->mu_kinetic <= c->mu_static && c->mu_static <= TM_FRICTION_MAX))
            status = tm_fail(error, TM_ERR_ARGUMENT, t,
                             "friction of instrument %d: static %g, kinetic %g; give 0 <= kinetic <= static <= %g",
                             (int)t, c->mu_static, c->mu_kinetic, TM_FRICTION_MAX);
    }
    if (status == TM_OK && (def->max_contact_vertices < 4 || def->max_contact_vertices > 4096))
        status = tm_fail(error, TM_ERR_ARGUMENT, -1, "max_contact_vertices is %d; give 4 to 4096",
                         (int)def->max_contact_vertices);
    return status;
}

tm_status tm_precomputed_create(const tm_precomputed_def *def, tm_precomputed **model, tm_solve_report *report,
                                tm_error *error) {
    TM_REQUIRE_DEF(def, TMS_COOKIE_PRECOMPUTED, TM_ERR_ARGUMENT);
    TMS_REQUIRE_PROBLEM(&def->problem);
    TM_REQUIRE(model && (!def->ranks || def->ranks->count == 1),
               "model is null, or the run has ranks, which a model cannot use", TM_ERR_ARGUMENT);
    tm_status status = check(def, error);
    if (status != TM_OK) return status;
    tm_solve_report mine = {0};
    tm_precomputed *m = tms_alloc_zeroed(1, sizeof *m);
    status = m ? get_responses(def, false, &m->responses, &mine, error)
               : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a model; use a coarser mesh");
    if (report) *report = mine;
    if (status == TM_OK) status = set_up(m, def, error);
    if (status != TM_OK) {
        tm_precomputed_destroy(m);
        return status;
    }
    *model = m;
    return TM_OK;
}

tm_status tm_precomputed_write(const tm_precomputed_def *def, tm_solve_report *report, tm_error *error) {
    TM_REQUIRE_DEF(def, TMS_COOKIE_PRECOMPUTED, TM_ERR_ARGUMENT);
    TMS_REQUIRE_PROBLEM(&def->problem);
    TM_REQUIRE(def->file, "def->file is null", TM_ERR_ARGUMENT);
    const tm_status good = check(def, error);
    if (good != TM_OK) return good;
    tm_solve_report mine = {0};
    tms_responses responses;
    const tm_status status = get_responses(def, true, &responses, &mine, error);
    if (status == TM_OK) tms_responses_release(&responses);
    if (report) *report = mine;
    return status;
}

void tm_precomputed_destroy(tm_precomputed *m) {
    if (!m) return;
    tms_friction_destroy(m->solver.friction);
    tms_contact_solver_destroy(&m->solver);
    tms_responses_release(&m->responses);
    tms_free(m->kept_index);
    tms_free(m->surface);
    tms_free(m->sum);
    tms_free(m->yield);
    tm_patch_solver_destroy(m->patch_solver);
    tms_free(m);
}

int64_t tm_precomputed_bytes(const tm_precomputed *m) {
    TM_REQUIRE(m, "model is null", 0);
    return m->responses.bytes + m->solver.bytes + (int64_t)sizeof *m +
           12 * (int64_t)tm_tissue_mesh(m->tissue)->vertex_count + 12 * (int64_t)m->responses.kept_count;
}

/* --- online --- */

static void add_double(double *restrict sum, const double *restrict column, double f, int32_t n) {
    for (int32_t i = 0; i < n; i++) sum[i] += f * column[i];
}
static void add_single(double *restrict sum, const float *restrict column, double f, int32_t n) {
    for (int32_t i = 0; i < n; i++) sum[i] += f * (double)column[i];
}

/* Computes the complete surface: base plus the responses to the forces, by ascending vertex. */
static void superpose(tm_precomputed *m) {
    const tms_responses *r = &m->responses;
    const tms_contact_solver *l = &m->solver;
    memcpy(m->sum, r->base_m, (size_t)r->kept_count * 8);
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t column = m->kept_index[3 * l->vertex[l->used[i]] + c];
            const double f = l->f[3 * l->used[i] + c];
            if (column < 0 || f == 0) continue;
            const int64_t at = (int64_t)column * r->kept_count;
            if (r->precision == TM_DOUBLE)
                add_double(m->sum, (const double *)r->column + at, f, r->kept_count);
            else
                add_single(m->sum, (const float *)r->column + at, f, r->kept_count);
        }
    for (int32_t i = 0; i < r->kept_count; i++) l->u_m[r->kept[i]] = m->sum[i];
    m->superposed = true;
}

int32_t tm_precomputed_update(tm_precomputed *m, const tm_tool_pose *pose) {
    TM_REQUIRE(m && (pose || m->solver.tool_count == 0), "model or pose is null", -1);
    for (int32_t t = 0; t < m->solver.tool_count; t++)
        TM_REQUIRE(TM_IS_POSE(pose + t), "a pose is not finite or beyond 1e6", -1);
    if (!m->superposed) superpose(m); /* the broad phase reads the complete surface */
    const int32_t steps = tms_contact_solver_update(&m->solver, pose);
    m->superposed = false;
    return m->solver.converged ? steps : -steps - 1;
}

#define INSTRUMENT_IS_THERE(...)                                                                                       \
    TM_REQUIRE(m &&instrument >= 0 && instrument < m->solver.tool_count,                                               \
               "model is null or instrument is not one of its own", __VA_ARGS__)

void tm_precomputed_set_pose(tm_precomputed *m, int32_t instrument, const tm_tool_pose *at) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(at), "at is null, not finite or beyond 1e6", );
    tms_contact_solver_set_pose(&m->solver, instrument, at);
    tms_contact_solver_friction_place(&m->solver, instrument);
}

tm_tool_pose tm_precomputed_pose(const tm_precomputed *m, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_pose){0});
    return m->solver.tool[instrument].pose;
}

uint32_t tm_precomputed_force(const tm_precomputed *m, int32_t instrument, double force_N[3]) {
    INSTRUMENT_IS_THERE(0);
    TM_REQUIRE(force_N, "force_N is null", 0);
    double resultant[3];
    tms_contact_solver_force(&m->solver, instrument, force_N, resultant);
    return tms_contact_solver_flags(&m->solver, instrument);
}

tm_tool_reaction tm_precomputed_reaction(tm_precomputed *m, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_reaction){0});
    tm_tool_reaction reaction = tms_contact_solver_reaction(&m->solver, instrument);
    tms_contact_solver_stiffness(&m->solver, instrument, reaction.stiffness_N_m);
    reaction.stiffness_kind = 2;
    return reaction;
}

int32_t tm_precomputed_rows(const tm_precomputed *m, const tm_contact_row **rows) {
    TM_REQUIRE(m && rows, "model or rows is null", 0);
    *rows = m->solver.now.row;
    return m->solver.now.count;
}

int32_t tm_precomputed_grasped(const tm_precomputed *m, int32_t instrument, const int32_t **vertex,
                               tm_grasp_state *state) {
    INSTRUMENT_IS_THERE(0);
    const tms_grasp *h = &m->solver.grasp_of[instrument];
    if (vertex) *vertex = h->vertex;
    if (state) *state = h->state;
    return h->count;
}

const double *tm_precomputed_displacement(tm_precomputed *m) {
    TM_REQUIRE(m, "model is null", NULL);
    if (!m->superposed) superpose(m);
    return m->solver.u_m;
}

int32_t tm_precomputed_surface(const tm_precomputed *m, const int32_t **vertex) {
    TM_REQUIRE(m && vertex, "model or vertex is null", 0);
    *vertex = m->surface;
    return m->surface_count;
}

/* --- imposed displacements --- */

static bool has_response(const tm_precomputed *m, int32_t v) {
    return v >= 0 && v < tm_tissue_mesh(m->tissue)->vertex_count &&
           (m->kept_index[3 * v] >= 0 || m->kept_index[3 * v + 1] >= 0 || m->kept_index[3 * v + 2] >= 0);
}

/* Converts to the original number, for messages; an invalid number is kept. */
static int32_t given_number(const tm_precomputed *m, int32_t v) {
    const tm_mesh *mesh = tm_tissue_mesh(m->tissue);
    return v >= 0 && v < mesh->vertex_count ? tm_mesh_original_vertex(mesh, v) : v;
}

tm_status tm_precomputed_impose(tm_precomputed *m, int32_t count, const int32_t *vertex, const double *u_m,
                                double compliance_m_N, tm_error *error) {
    TM_REQUIRE(m && ((vertex && u_m) || count <= 0), "model, vertex or u_m is null", TM_ERR_ARGUMENT);
    tms_contact_solver *l = &m->solver;
    if (count < 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the number of imposed vertices is %d; give 0 or more", (int)count);
    if (count + TM_MAX_INSTRUMENTS * l->grasp.max_vertices > l->capacity)
        return tm_fail(error, TM_ERR_LIMIT, count, "%d vertices are imposed and %d fit; raise max_contact_vertices",
                       (int)count, (int)l->capacity);
    if (!(compliance_m_N >= 0) || !isfinite(compliance_m_N))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "the compliance of the imposed displacements is %g m/N; give 0 or more", compliance_m_N);
    l->stamp_now++;
    for (int32_t i = 0; i < count; i++) {
        const int32_t given = given_number(m, vertex[i]);
        if (!has_response(m, vertex[i]))
            return tm_fail(
                error, TM_ERR_ARGUMENT, given,
                "vertex %d is not on the free surface, so it has no responses; impose vertices of the free surface",
                (int)given);
        if (!tm_are_places(u_m + 3 * (int64_t)i))
            return tm_fail(error, TM_ERR_ARGUMENT, given,
                           "the imposed displacement of vertex %d is (%g %g %g) m; give finite numbers", (int)given,
                           u_m[3 * (int64_t)i], u_m[3 * (int64_t)i + 1], u_m[3 * (int64_t)i + 2]);
        if (l->stamp[vertex[i]] == l->stamp_now)
            return tm_fail(error, TM_ERR_ARGUMENT, given, "vertex %d is imposed twice; give it once", (int)given);
        l->stamp[vertex[i]] = l->stamp_now;
    }
    for (int32_t i = 0; i < count; i++) {
        l->pin[i] = (tms_pin){.vertex = vertex[i], .tool = -1, .compliance_m_N = compliance_m_N};
        memcpy(l->pin[i].u_m, u_m + 3 * (int64_t)i, 24);
    }
    l->pin_count = l->imposed_count = count; /* grasped vertices follow in the next update */
    l->pair_count = 0;                       /* the changes were of other unknowns */
    tms_contact_solver_regather(l);
    return TM_OK;
}

void tm_precomputed_imposed_force(const tm_precomputed *m, int32_t i, double force_N[3]) {
    TM_REQUIRE(m && force_N && i >= 0 && i < m->solver.imposed_count,
               "model or force_N is null, or vertex i is not imposed", );
    const tms_contact_solver *l = &m->solver;
    const int32_t s = l->slot_of[l->pin[i].vertex]; /* its reaction is its force minus the tools' share */
    for (int c = 0; c < 3; c++) force_N[c] = s < 0 ? 0 : l->f[3 * s + c] - l->now.fc[3 * s + c];
}
