/* The hybrid model behind the interface of all models: a dynamic model of the part that may be cut, and the condensed
 * rest as a stage of its world. */
#include "hybrid.h"
#include "model_problem.h"

typedef struct part {
    tm_model is;
    tm_model *moving; /* dynamic part */
    tm_hybrid *hybrid;
    tms_problem problem; /* of the complete organ */
    tm_solve_def solve;  /* of that problem, for equilibrium */
    double gravity_m_s2[3];
} part;

static part *of(const tm_model *m) { return (part *)(uintptr_t)m; }

static void destroy(tm_model *m) {
    part *p = of(m);
    tm_model_destroy(p->moving); /* also destroys the stage that owns the condensed part */
    tm_hybrid_destroy(p->hybrid);
    tms_problem_free(&p->problem);
    tms_free(p);
}

/* --- frames --- */

static void end(tm_model *m) {
    tm_model_end(of(m)->moving);
    of(m)->hybrid->owed = true;
}

/* Solves for the interior when it is read; contact computes what a frame needs of it. */
static part *with_inside(const tm_model *m) {
    part *p = of(m);
    if (p->hybrid->owed) tm_hybrid_recover(p->hybrid, m->world);
    return p;
}

static tm_tool_reaction reaction(const tm_model *m, int32_t instrument) {
    return tm_hybrid_reaction(of(m)->hybrid, instrument);
}

static tm_surface_view surface(tm_model *m) { return tm_hybrid_surface(of(m)->hybrid); }
static const double *displacement(tm_model *m) { return tm_model_displacement(with_inside(m)->moving); }
static uint64_t hash(tm_model *m) { return tm_model_hash(with_inside(m)->moving); }

/* --- patches: of the complete organ's surface, with its compliance --- */

static tm_surface_view view(void *self) { return tm_hybrid_surface(self); }

static tm_status allow_patches(tm_model *m, const tm_patch_def *def, tm_error *error) {
    part *p = of(m);
    tm_compliance_factor *factored;
    tm_compliance_factor_def whole = tm_compliance_factor_def_default();
    whole.tissue = m->tissue;
    whole.fixed = p->problem.fixed;
    whole.condensed = p->hybrid->condensed_tet;
    tm_status status = tm_compliance_factor_create(&whole, &factored, error);
    if (status != TM_OK) return status;
    const tm_compliance_source source = tm_compliance_factor_owned_source(factored);
    const tm_patch_surface both = {p->hybrid, view};
    tm_patch_def mine = *def;
    mine.source = &source;
    mine.surface = &both;
    status = tm_model_allow_patches(p->moving, &mine, error);
    if (status != TM_OK) tm_compliance_factor_destroy(factored);
    return status;
}

static bool patch(tm_model *m, int32_t instrument, tm_patch *out) {
    return tm_model_patch(with_inside(m)->moving, instrument, out);
}

/* --- equilibrium, snapshots, statistics --- */

/* Builds the organ in its present state as one tissue, without removed tetrahedra and their weight. */
static tm_status whole_of(const part *p, bool uncut, tm_tissue **whole, tm_error *error) {
    const tm_hybrid *h = p->hybrid;
    const uint8_t *now = tm_tissue_alive(p->is.tissue), *condensed = tm_tissue_alive(h->condensed);
    uint8_t *alive = tms_alloc((size_t)h->mesh->tet_count + 1);
    if (!alive)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the equilibrium of the organ; use a coarser mesh");
    for (int32_t t = 0; t < h->mesh->tet_count; t++) alive[t] = condensed[t] || (uncut ? h->alive[t] : now[t]);
    const tm_status status = tms_sub_tissue(p->is.tissue, alive, whole, error);
    tms_free(alive);
    return status;
}

/* Solves for the complete organ's equilibrium, without instruments; the model does not change. */
static tm_status settle(tm_model *m, const tm_settle_def *def, double *u_m, double *reaction_N,
                        tm_settle_result *result, tm_error *error) {
    const part *p = of(m);
    const size_t n = 3 * (size_t)tm_tissue_mesh(m->tissue)->vertex_count;
    tm_tissue *whole = NULL, *uncut = NULL;
    tm_solve_def solve = p->solve;
    tm_solve_report report;
    double *load = tms_alloc(n * sizeof *load);
    tm_status status =
        load ? TM_OK
             : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the equilibrium of the organ; use a coarser mesh");
    (void)def;
    if (status == TM_OK) status = whole_of(p, false, &whole, error);
    if (status == TM_OK) status = whole_of(p, true, &uncut, error);
    if (status == TM_OK) {
        const double *mass = tm_tissue_mass_kg(whole), *was = tm_tissue_mass_kg(uncut);
        for (size_t d = 0; d < n; d++)
            load[d] = p->problem.load_N[d] + (mass[d / 3] - was[d / 3]) * p->gravity_m_s2[d % 3];
        solve.tissue = whole;
        solve.load_N = load;
        status = tm_solve_static(&solve, u_m, reaction_N, &report, error);
    }
    if (status == TM_OK) {
        result->energy_J = tm_tissue_energy(whole, u_m);
        result->deformation = tm_tissue_deformation(whole, u_m);
    }
    tm_tissue_destroy(whole);
    tm_tissue_destroy(uncut);
    tms_free(load);
    return status;
}

static tm_status save(const tm_model *m, void *buffer, int64_t bytes, tm_error *error) {
    return tm_model_save(with_inside(m)->moving, buffer, bytes, error);
}

static tm_status restore(tm_model *m, const void *buffer, int64_t bytes, tm_error *error) {
    const tm_status status = tm_model_restore(of(m)->moving, buffer, bytes, error);
    if (status == TM_OK) of(m)->hybrid->owed = false;
    for (int i = 0; status == TM_OK && i < m->instrument_count; i++) m->pose[i] = of(m)->moving->pose[i];
    return status;
}

static const tm_model_kind kind = {.size = sizeof(tm_model_kind),
                                   .name = "hybrid",
                                   .knows_compliance = true,
                                   .destroy = destroy,
                                   .end = end,
                                   .reaction = reaction,
                                   .surface = surface,
                                   .displacement = displacement,
                                   .hash = hash,
                                   .allow_patches = allow_patches,
                                   .patch = patch,
                                   .settle = settle,
                                   .save = save,
                                   .restore = restore};

/* --- construction --- */

/* The complete organ's tissue gives the condensed part, and is freed before the world's own is built. */
static tm_status condense(const tm_model_def *def, const tm_hybrid_def *how, part *p, tm_solve_report *report,
                          tm_error *error) {
    tm_tissue *whole = NULL;
    tm_tissue_def uncut = def->tissue;
    tm_hybrid_def mine = *how;
    uncut.cuttable = false;
    tm_status status = tms_invalid_member(def, "tissue", tm_tissue_create(&uncut, &whole, error));
    if (status != TM_OK) return status;
    status = tms_invalid_member(def, "support", tms_problem_build(def, whole, &p->problem, &mine.problem, error));
    p->solve = mine.problem;
    for (int c = 0; c < 3 && def->gravity_m_s2; c++) p->gravity_m_s2[c] = def->gravity_m_s2[c];
    mine.contact = def->contact;
    if (status == TM_OK) status = tms_invalid_member(def, "model", tm_hybrid_create(&mine, &p->hybrid, report, error));
    tm_tissue_destroy(whole);
    return status;
}

static tm_status make(const tm_model_def *def, const tm_hybrid_def *how, part *p, tm_solve_report *report,
                      tm_error *error) {
    tm_status status = condense(def, how, p, report, error);
    if (status != TM_OK) return status;
    tm_model_def moving = *def;
    tm_hybrid_tissue(p->hybrid, &moving.tissue);
    moving.step_limit_s = tm_hybrid_critical_step(p->hybrid, &moving.step_limit_tet);
    status = tm_model_dynamic(&moving, &p->moving, error);
    if (status == TM_OK)
        status =
            tms_invalid_member(def, "model", tm_stage_hybrid(p->moving->world, p->hybrid, p->moving->contact, error));
    if (status != TM_OK) return status;
    const tm_model_kind *own = p->is.kind;
    p->is = *p->moving;
    p->is.kind = own;
    p->is.inner = p->moving;
    p->is.condensed_tets = tm_tissue_mesh(p->is.tissue)->tet_count - tm_tissue_alive_count(p->is.tissue);
    return TM_OK;
}

tm_status tm_model_hybrid(const tm_model_def *def, const tm_hybrid_def *how, tm_model **model, tm_solve_report *report,
                          tm_error *error) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    TM_REQUIRE_DEF(how, TMS_COOKIE_HYBRID, TM_ERR_ARGUMENT);
    tm_status status = tm_model_check(def, error);
    if (status == TM_OK && def->friction)
        status = tms_invalid_member(
            def, "friction",
            tm_fail(error, TM_ERR_EXCLUDED, -1,
                    "its contact solver has no friction; choose the dynamic or the precomputed model"));
    if (status == TM_OK && def->cut && def->cut->fade_s > 0)
        status =
            tms_invalid_member(def, "cut",
                               tm_fail(error, TM_ERR_EXCLUDED, -1,
                                       "its contact forces cannot fade; set fade_s to 0, or choose the dynamic model"));
    if (status != TM_OK) return status;
    part *p = tms_alloc_zeroed(1, sizeof *p);
    if (!p) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a model; use a coarser mesh");
    p->is.kind = &kind;
    status = make(def, how, p, report, error);
    if (status != TM_OK) {
        destroy(&p->is);
        return status;
    }
    *model = &p->is;
    return TM_OK;
}
