/* The precomputed model: quasi-static, one update a frame. */
#include <stdlib.h>
#include <string.h>

#include "solve_api.h"

#define OPTION(member) offsetof(sim_solve_options, member), 0

static const app_field fields[] = {
    {"precomputed", APP_SECTION, NULL, NULL, 0, 0, OPTION(here),
     "how `model: precomputed` is computed; the section alone asks for nothing"},
    {"precomputed.solver", APP_CHOICE, "cholesky|cg", "cholesky", 0, 0, OPTION(solver),
     "CHOLMOD, or conjugate gradients as in the paper"},
    {"precomputed.precision", APP_CHOICE, "double|single", "double", 0, 0, OPTION(precision),
     "of the stored responses"},
    {"precomputed.cache", APP_FLAG, NULL, "yes", 0, 0, OPTION(cache),
     "keep them on disk: $TM_CACHE_DIR, $XDG_CACHE_HOME/tensormass or ~/.cache/tensormass"},
    {"precomputed.max_vertices", APP_INTEGER, NULL, "256", 8, 4096, OPTION(max_vertices),
     "of the on-line contact system"},
};

typedef struct model {
    sim_precomputed_api api;
    tm_precomputed *precomputed;
    sim_problem problem;
    double time_s;
    int64_t bytes;
} model;

static void destroy(void *own) {
    model *m = own;
    if (m->precomputed) m->api.tm_precomputed_destroy_(m->precomputed);
    sim_problem_free(&m->problem);
    free(m);
}

/* No steps: one update a frame, whatever its length. */
static int begin(sim *s) {
    s->critical_s = tm_critical_step_guaranteed(s->tissue, &s->critical_tet);
    s->dt_s = s->frame_s = 1 / s->scene->frame_rate.si;
    s->substeps = s->average = 1;
    return 0;
}

static int end(sim *s) {
    const sim_solve_options *o = sim_options(s->scene, "precomputed");
    model *m = s->model_own = calloc(1, sizeof *m);
    char file[1024];
    tm_error error = {0};
    tm_solve_report report = {0};
    if (!m) return APP_FAILED;
    int rc = sim_open_precomputed(s, &m->api);
    if (rc) return rc;
    tm_precomputed_def def = m->api.tm_precomputed_def_default_();
    rc = sim_problem_make(s, s->tissue, &m->problem, &def.problem);
    if (rc) return rc;
    sim_solve_file(s, o, "precomputed", file, sizeof file);
    def.problem.solver = (tm_solver)o->solver.index;
    def.precision = (tm_precision)o->precision.index;
    def.file = *file ? file : NULL;
    def.contact = sim_has(s, "contact") ? &s->contact_def : NULL;
    def.grasp = sim_has(s, "grasp") ? &s->grasp_def : NULL;
    def.update_s = s->frame_s;
    def.max_local_vertices = (int32_t)o->max_vertices.value;
    if (m->api.tm_precomputed_create_(&def, &m->precomputed, &report, &error))
        return sim_report(s->scene, s->scene->model.line, &error);
    m->bytes = m->api.tm_precomputed_bytes_(m->precomputed);
    sim_solve_told(s, "the precomputed model", &report);
    return 0;
}

static tm_status frame(sim *s, const tm_tool_pose *to, int32_t substeps) {
    model *m = s->model_own;
    bool touching = sim_has(s, "contact");
    (void)substeps;
    if (touching) m->api.tm_precomputed_update_(m->precomputed, to);
    m->time_s += s->frame_s;
    for (int i = 0; touching && i < s->instrument_count; i++) {
        tm_tool_reaction *r = &s->reaction[i];
        if (s->wants[i] != SIM_SENDS_FORCE)
            *r = m->api.tm_precomputed_reaction_(m->precomputed, i);
        else {
            *r = (tm_tool_reaction){0};
            r->flags = m->api.tm_precomputed_force_(m->precomputed, i, r->force_N);
            memcpy(r->tip_m, to[i].tip_m, sizeof r->tip_m);
        }
        const tm_contact_row *rows;
        int32_t count = m->api.tm_precomputed_rows_(m->precomputed, &rows);
        r->row_count = 0;
        for (int32_t k = 0; k < count; k++) r->row_count += rows[k].instrument == i && rows[k].lambda_N > 0;
        r->time_s = m->time_s;
    }
    return TM_OK;
}

static void feel(sim *s, int i) {
    model *m = s->model_own;
    if (s->wants[i] != SIM_SENDS_PATCH || !s->patch) return;
    s->patch_valid[i] =
        m->api.tm_precomputed_patch_(m->precomputed, i, s->velocity_m_s[i], 2 * s->frame_s, s->patch_vertices,
                                     s->patch_vertices > 12 ? TM_PATCH_TRIANGLES : 16, &s->patch[i]);
}

static tm_surface_view surface(const sim *s) { return tm_tissue_surface(s->tissue); }

static const double *displacement(const sim *s) {
    model *m = s->model_own;
    return m->api.tm_precomputed_displacement_(m->precomputed);
}

static double time_s(const sim *s) { return ((model *)s->model_own)->time_s; }

static uint64_t hash(const sim *s) {
    return tm_hash(displacement(s), sizeof(double) * 3 * (size_t)s->mesh->vertex_count, TM_HASH_SEED);
}

static int64_t bytes(const sim *s) { return ((model *)s->model_own)->bytes; }

static tm_status solve(sim *s, double *u_m, double *reaction_N, tm_error *error) {
    model *m = s->model_own;
    tm_precomputed_def def = m->api.tm_precomputed_def_default_();
    tm_solve_report report = {0};
    sim_problem problem;
    if (sim_problem_make(s, s->tissue, &problem, &def.problem)) return TM_ERR_MEMORY;
    def.problem.solver = (tm_solver)((const sim_solve_options *)sim_options(s->scene, "precomputed"))->solver.index;
    tm_status status = m->api.tm_solve_static_(&def.problem, u_m, reaction_N, &report, error);
    sim_problem_free(&problem);
    return status;
}

const sim_model sim_model_precomputed = {.begin = begin,
                                         .end = end,
                                         .frame = frame,
                                         .feel = feel,
                                         .surface = surface,
                                         .displacement = displacement,
                                         .time_s = time_s,
                                         .hash = hash,
                                         .bytes = bytes,
                                         .solve = solve,
                                         .destroy = destroy};

const sim_effect sim_effect_precomputed = {
    .name = "precomputed",
    .doc = "`model: precomputed` asks for it: responses of the surface to unit forces, solved once and kept on disk; "
           "contact on line as a small system. "
           "Quasi-static: mass and damping play no part. Nothing can be cut. Opens the module `solve` (CHOLMOD).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_solve_options)},
    .model = APP_PRECOMPUTED,
    .excludes = {{"cut", "responses hold for uncut tissue; write 'model: dynamic', or 'model: hybrid' with the part to "
                         "cut under 'hybrid:'"},
                 {"breathing", "its supports stand still; write 'model: dynamic'"}},
};
