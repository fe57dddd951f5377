/* The precomputed model behind the interface of all models: one update per frame, no world. */
#include <string.h>

#include "model_problem.h"
#include "precomputed.h"

typedef struct quasi {
    tm_model is;
    tm_precomputed *model;
    tms_problem problem;
    tm_solve_def solve; /* of that problem, for equilibrium */
    tm_patch_def patches;
    bool patches_allowed, timing;
    double time_s, seconds, velocity_m_s[TM_MAX_INSTRUMENTS][3];
    double travel_time_s; /* length of the present frame */
    int64_t runs;
    bool reported[TM_MAX_INSTRUMENTS]; /* stiffness[i] is of the last frame */
    double stiffness_N_m[TM_MAX_INSTRUMENTS][9];
} quasi;

static quasi *of(const tm_model *m) { return (quasi *)(uintptr_t)m; }

static void destroy(tm_model *m) {
    quasi *q = of(m);
    tm_precomputed_destroy(q->model);
    tms_problem_free(&q->problem);
    tm_tissue_destroy(m->tissue);
    tms_free(q);
}

/* --- frames --- */

static void begin(tm_model *m, const tm_tool_pose *to, int32_t substeps) {
    (void)to;
    of(m)->travel_time_s = substeps * m->timing.dt_s;
}

static void end(tm_model *m) {
    quasi *q = of(m);
    const double start_s = q->timing ? tms_clock_s() : 0;
    if (m->instrument_count > 0) tm_precomputed_update(q->model, m->to);
    q->time_s += q->travel_time_s;
    for (int i = 0; i < m->instrument_count; i++) {
        q->reported[i] = false;
        for (int c = 0; c < 3; c++)
            q->velocity_m_s[i][c] = (m->to[i].tip_m[c] - m->pose[i].tip_m[c]) / q->travel_time_s;
    }
    q->runs++;
    if (q->timing) q->seconds += tms_clock_s() - start_s;
}

static void set_pose(tm_model *m, int32_t instrument, const tm_tool_pose *at) {
    tm_precomputed_set_pose(of(m)->model, instrument, at);
}

static tm_tool_reaction reaction(const tm_model *m, int32_t instrument) {
    const quasi *q = of(m);
    tm_tool_reaction r = tms_contact_solver_reaction(&q->model->solver, instrument);
    r.time_s = q->time_s;
    r.stiffness_kind = q->reported[instrument] ? 2 : 0;
    memcpy(r.stiffness_N_m, q->stiffness_N_m[instrument], sizeof r.stiffness_N_m);
    return r;
}

static const double *displacement(tm_model *m) { return tm_precomputed_displacement(of(m)->model); }
static double time_s(const tm_model *m) { return of(m)->time_s; }

static uint64_t hash(tm_model *m) {
    return tm_hash(displacement(m), sizeof(double) * 3 * (size_t)tm_tissue_mesh(m->tissue)->vertex_count, TM_HASH_SEED);
}

/* --- patches --- */

static tm_status allow_patches(tm_model *m, const tm_patch_def *def, tm_error *error) {
    (void)error;
    of(m)->patches = *def;
    of(m)->patches_allowed = true;
    return TM_OK;
}

static bool patch(tm_model *m, int32_t instrument, tm_patch *out) {
    quasi *q = of(m);
    if (!q->patches_allowed) return false;
    const double start_s = q->timing ? tms_clock_s() : 0;
    const tm_tool_reaction r = tm_precomputed_reaction(q->model, instrument);
    memcpy(q->stiffness_N_m[instrument], r.stiffness_N_m, sizeof r.stiffness_N_m);
    q->reported[instrument] = true;
    const bool made =
        out && tm_precomputed_patch(q->model, instrument, q->velocity_m_s[instrument], q->patches.horizon_s,
                                    q->patches.max_vertices, q->patches.max_triangles, out);
    if (q->timing) q->seconds += tms_clock_s() - start_s;
    return made;
}

/* --- equilibrium, snapshots, statistics --- */

static tm_status settle(tm_model *m, const tm_settle_def *def, double *u_m, double *reaction_N,
                        tm_settle_result *result, tm_error *error) {
    (void)def;
    tm_solve_report report;
    const tm_status status = tm_solve_static(&of(m)->solve, u_m, reaction_N, &report, error);
    if (status == TM_OK) {
        result->energy_J = tm_tissue_energy(m->tissue, u_m);
        result->deformation = tm_tissue_deformation(m->tissue, u_m);
    }
    return status;
}

/* State between frames outside the contact solver; only numbers, without padding. */
typedef struct saved {
    char magic[8];
    double time_s, velocity_m_s[TM_MAX_INSTRUMENTS][3], stiffness_N_m[TM_MAX_INSTRUMENTS][9];
    int64_t reported[TM_MAX_INSTRUMENTS];
    uint64_t checksum; /* of what follows */
} saved;
static const char magic[8] = "TMPRESN1";

static uint64_t checksum(const char *buffer, int64_t bytes) {
    return tm_hash(buffer + sizeof(saved), (size_t)bytes - sizeof(saved), TM_HASH_SEED);
}

static int64_t snapshot_bytes(const tm_model *m) {
    return (int64_t)sizeof(saved) + tms_precomputed_snapshot(of(m)->model, NULL);
}

static int64_t snapshot_bytes_max(const tm_model *m) {
    return (int64_t)sizeof(saved) + tms_precomputed_snapshot_max(of(m)->model);
}

static tm_status save(const tm_model *m, void *buffer, int64_t bytes, tm_error *error) {
    const quasi *q = of(m);
    saved k = {.time_s = q->time_s};
    if (bytes < snapshot_bytes(m))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "the buffer has %lld bytes and the snapshot needs %lld; allocate tm_model_snapshot_bytes()",
                       (long long)bytes, (long long)snapshot_bytes(m));
    tms_precomputed_snapshot(q->model, (char *)buffer + sizeof k);
    memcpy(k.magic, magic, sizeof magic);
    memcpy(k.velocity_m_s, q->velocity_m_s, sizeof k.velocity_m_s);
    memcpy(k.stiffness_N_m, q->stiffness_N_m, sizeof k.stiffness_N_m);
    for (int i = 0; i < m->instrument_count; i++) k.reported[i] = q->reported[i];
    k.checksum = checksum(buffer, snapshot_bytes(m));
    memcpy(buffer, &k, sizeof k);
    return TM_OK;
}

static tm_status restore(tm_model *m, const void *buffer, int64_t bytes, tm_error *error) {
    quasi *q = of(m);
    saved k;
    if (bytes >= (int64_t)sizeof k) memcpy(&k, buffer, sizeof k);
    if (bytes < (int64_t)sizeof k || memcmp(k.magic, magic, sizeof magic) || k.checksum != checksum(buffer, bytes))
        return tm_fail(
            error, TM_ERR_FILE, -1,
            "this is not a snapshot of a precomputed model, or it is damaged; give one that tm_model_save wrote");
    const tm_status status =
        tms_precomputed_restore(q->model, (const char *)buffer + sizeof k, bytes - (int64_t)sizeof k, error);
    if (status != TM_OK) return status;
    q->time_s = k.time_s;
    memcpy(q->velocity_m_s, k.velocity_m_s, sizeof k.velocity_m_s);
    memcpy(q->stiffness_N_m, k.stiffness_N_m, sizeof k.stiffness_N_m);
    for (int i = 0; i < m->instrument_count; i++) {
        q->reported[i] = k.reported[i] != 0;
        m->pose[i] = tm_precomputed_pose(q->model, i);
    }
    return TM_OK;
}

static int32_t stages(const tm_model *m, tm_stage_report report[TM_MAX_STAGES]) {
    const quasi *q = of(m);
    report[0] = (tm_stage_report){.name = "precomputed",
                                  .phase = TM_PHASE_END,
                                  .bytes = tm_precomputed_bytes(q->model),
                                  .runs = q->runs,
                                  .seconds = q->seconds};
    return 1;
}

static void set_timing(tm_model *m, bool on) { of(m)->timing = on; }

static const tm_model_kind kind = {.size = sizeof(tm_model_kind),
                                   .name = "precomputed",
                                   .knows_compliance = true,
                                   .destroy = destroy,
                                   .begin = begin,
                                   .end = end,
                                   .set_pose = set_pose,
                                   .reaction = reaction,
                                   .displacement = displacement,
                                   .time_s = time_s,
                                   .hash = hash,
                                   .allow_patches = allow_patches,
                                   .patch = patch,
                                   .settle = settle,
                                   .snapshot_bytes = snapshot_bytes,
                                   .save = save,
                                   .restore = restore,
                                   .stages = stages,
                                   .set_timing = set_timing,
                                   .snapshot_bytes_max = snapshot_bytes_max};

/* Applies `def` to a copy of `how`. */
static tm_status define(const tm_model_def *def, const tm_precomputed_def *how, tm_tissue **tissue,
                        tms_problem *problem, tm_precomputed_def *mine, tm_error *error) {
    *mine = *how;
    mine->contact = def->contact;
    mine->grasp = def->grasp;
    mine->friction = def->friction;
    mine->update_s = def->frame_s;
    const tm_status status = tms_invalid_member(def, "tissue", tm_tissue_create(&def->tissue, tissue, error));
    return status != TM_OK
               ? status
               : tms_invalid_member(def, "support", tms_problem_build(def, *tissue, problem, &mine->problem, error));
}

static tm_status check(const tm_model_def *def, tm_error *error) {
    const tm_status status = tm_model_check(def, error);
    if (status != TM_OK || !def->cut) return status;
    return tms_invalid_member(
        def, "cut",
        tm_fail(error, TM_ERR_EXCLUDED, -1,
                "its responses are valid only for uncut tissue; choose the dynamic or the hybrid model"));
}

static tm_status make(const tm_model_def *def, const tm_precomputed_def *how, quasi *q, tm_solve_report *report,
                      tm_error *error) {
    tm_model *m = &q->is;
    tm_precomputed_def mine;
    tm_status status = define(def, how, &m->tissue, &q->problem, &mine, error);
    if (status != TM_OK) return status;
    q->solve = mine.problem;
    status = tms_invalid_member(def, "model", tm_precomputed_create(&mine, &q->model, report, error));
    if (status != TM_OK) return status;
    m->timing = (tm_timing){.frame_s = def->frame_s, .dt_s = def->frame_s, .substeps = 1, .average = 1};
    m->timing.critical_s = tm_critical_step_guaranteed(m->tissue, &m->timing.critical_tet);
    m->instrument_count = def->contact ? def->contact->instrument_count : 0;
    for (int i = 0; i < m->instrument_count; i++) m->pose[i] = def->contact->instrument[i].pose;
    return TM_OK;
}

tm_status tm_model_precomputed(const tm_model_def *def, const tm_precomputed_def *how, tm_model **model,
                               tm_solve_report *report, tm_error *error) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    TM_REQUIRE_DEF(how, TMS_COOKIE_PRECOMPUTED, TM_ERR_ARGUMENT);
    tm_status status = check(def, error);
    if (status != TM_OK) return status;
    quasi *q = tms_alloc_zeroed(1, sizeof *q);
    if (!q) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a model; use a coarser mesh");
    q->is.kind = &kind;
    status = make(def, how, q, report, error);
    if (status != TM_OK) {
        destroy(&q->is);
        return status;
    }
    *model = &q->is;
    return TM_OK;
}

tm_status tm_model_precompute(const tm_model_def *def, const tm_precomputed_def *how, tm_solve_report *report,
                              tm_error *error) {
    TM_REQUIRE_DEF(how, TMS_COOKIE_PRECOMPUTED, TM_ERR_ARGUMENT);
    tm_tissue *tissue = NULL;
    tms_problem problem = {0};
    tm_precomputed_def mine;
    tm_status status = check(def, error);
    if (status == TM_OK) status = define(def, how, &tissue, &problem, &mine, error);
    if (status == TM_OK) status = tms_invalid_member(def, "model", tm_precomputed_write(&mine, report, error));
    tms_problem_free(&problem);
    tm_tissue_destroy(tissue);
    return status;
}
