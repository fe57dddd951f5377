/* Dynamic model: a tissue, a world that steps it, and the stages that the definition requests. */
#include <math.h>
#include <string.h>

#include "model/model_internal.h"
#include "touch/touch_internal.h"
#include "world/world_internal.h"

typedef struct dynamic {
    tm_model is;
    tm_patch_builder *builder; /* null: no patches */
} dynamic;

enum { MAX_SUBSTEPS = 10000000 }; /* per frame */

/* --- creation --- */

/* Records which member of the definition is invalid, and returns `status`. */
static tm_status set_invalid_member(const tm_model_def *def, const char *member, tm_status status) {
    if (status != TM_OK && def->invalid_member) *def->invalid_member = member;
    return status;
}

/* Chooses an integer number of equal substeps per frame, none above the requested or guaranteed step. */
static tm_status choose_timing(const tm_model_def *def, tm_model *m, tm_error *error) {
    tm_timing *p = &m->timing;
    if (def->step_limit_s > 0) {
        p->critical_s = def->step_limit_s;
        p->critical_tet = def->step_limit_tet;
    } else
        p->critical_s = tm_critical_step_guaranteed(m->tissue, &p->critical_tet);
    double longest_s = p->critical_s;
    if (def->adaptive) {
        tm_status status = tm_adaptive_check(m->tissue, error);
        if (!status && !(longest_s = tm_adaptive_longest_s(m->tissue))) status = tm_fail_memory(error, "adaptive step");
        if (status) return set_invalid_member(def, "adaptive", status);
    }
    const double largest = def->step_s > 0 ? def->step_s : longest_s * def->step_fraction;
    if (def->adaptive && largest > longest_s * (1 + 1e-9))
        return set_invalid_member(def, "step_s",
                                  tm_fail(error, TM_ERR_STEP, p->critical_tet,
                                          "adaptive step %.4g s is above %.4g s, which is guaranteed for strains up to "
                                          "%g; lower it or leave it out",
                                          largest, longest_s, TM_STRAIN_REST));
    if (!def->adaptive && largest > longest_s)
        return set_invalid_member(
            def, "step_s",
            tm_fail(error, TM_ERR_STEP, p->critical_tet,
                    "time step %.4g s is above the guaranteed critical step %.4g s, set by tetrahedron %d; "
                    "lower it or leave it out",
                    largest, p->critical_s, (int)p->critical_tet));
    const double count = ceil(def->frame_s / largest - 1e-9);
    if (!(count < MAX_SUBSTEPS))
        return set_invalid_member(
            def, "frame_s",
            tm_fail(error, TM_ERR_LIMIT, p->critical_tet,
                    "a frame would take %.3g substeps of %.3g s because of tetrahedron %d; check its material (Young's "
                    "modulus, density) and its shape",
                    count, largest, (int)p->critical_tet));
    p->frame_s = def->frame_s;
    p->substeps = count < 1 ? 1 : (int32_t)count;
    p->dt_s = p->frame_s / p->substeps;
    p->average = (int32_t)(def->average * p->substeps + 0.5);
    if (p->average < 1) p->average = 1;
    return TM_OK;
}

/* Creates the world on the tissue, with supports, loads and gravity. */
static tm_status make_world(const tm_model_def *def, tm_model *m, tm_error *error) {
    tm_world_def world = tm_world_def_default();
    world.tissue = m->tissue;
    world.dt_s = m->timing.dt_s;
    while (def->adaptive && world.dt_s > m->timing.critical_s * def->step_fraction) world.dt_s *= 0.5;
    world.damped = def->damped;
    world.threads = def->threads;
    world.parallel_for = def->parallel_for;
    world.parallel_for_user = def->parallel_for_user;
    tm_status status = set_invalid_member(def, "step_s", tm_world_create(&world, &m->world, error));
    if (status == TM_OK && def->adaptive)
        status = set_invalid_member(def, "adaptive", tm_world_adapt(m->world, m->timing.dt_s, error));
    if (status == TM_OK && def->support_count > 0) {
        tm_support_def support = tm_support_def_default();
        support.count = def->support_count;
        support.dof = def->support_dof;
        support.value_m = def->support_m;
        status = set_invalid_member(def, "support", tm_stage_support(m->world, &support, error));
    }
    if (status == TM_OK && def->load_N)
        status = set_invalid_member(def, "load", tm_stage_load(m->world, def->load_N, error));
    /* Tissue attached to a condensed part is held by it. */
    if (status == TM_OK && def->tissue.precision == TM_SINGLE && !def->tissue.condensed)
        status = set_invalid_member(def, "precision", tm_world_check_constrained(m->world, error));
    if (status == TM_OK && def->gravity_m_s2)
        status = set_invalid_member(def, "gravity", tm_stage_gravity(m->world, def->gravity_m_s2, error));
    return status;
}

/* Adds contact and the stages that need it: grasp, friction, cut. */
static tm_status make_contact(const tm_model_def *def, tm_model *m, tm_error *error) {
    tm_grasp *grasp;
    tm_status status = TM_OK;
    if (def->contact)
        status = set_invalid_member(def, "contact", tm_stage_contact(m->world, def->contact, &m->contact, error));
    if (status == TM_OK && def->contact) {
        m->instrument_count = def->contact->instrument_count;
        for (int i = 0; i < m->instrument_count; i++) m->pose[i] = def->contact->instrument[i].pose;
    }
    if (status == TM_OK && def->grasp)
        status = set_invalid_member(def, "grasp", tm_stage_grasp(m->world, m->contact, def->grasp, &grasp, error));
    tm_friction *friction;
    if (status == TM_OK && def->friction)
        status = set_invalid_member(def, "friction",
                                    tm_stage_friction(m->world, m->contact, def->friction, &friction, error));
    if (status == TM_OK && def->cut)
        status = set_invalid_member(def, "cut", tm_stage_cut(m->world, m->contact, def->cut, error));
    return status;
}

static void destroy(tm_model *m) {
    if (m->world) tm_world_destroy(m->world);
    if (m->tissue) tm_tissue_destroy(m->tissue);
    tm_release(m, sizeof(dynamic));
}

/* --- frames --- */

static void begin(tm_model *m, const tm_tool_pose *to, int32_t substeps) {
    if (!m->contact) return;
    tm_contact_begin_frame(m->contact, substeps, m->timing.average < substeps ? m->timing.average : substeps);
    for (int i = 0; i < m->instrument_count; i++) tm_contact_set_target(m->contact, i, &to[i], substeps);
}

static tm_status step(tm_model *m, int32_t substeps) { return tm_world_step(m->world, substeps); }
static void set_pose(tm_model *m, int32_t instrument, const tm_tool_pose *at) {
    tm_contact_set_pose(m->contact, instrument, at);
}

static tm_tool_reaction reaction(const tm_model *m, int32_t instrument) {
    return tm_contact_reaction(m->contact, instrument);
}

static const double *displacement(tm_model *m) { return tm_world_state(m->world)->u_m; }
static double time_s(const tm_model *m) { return tm_world_state(m->world)->time_s; }
static uint64_t hash(tm_model *m) { return tm_world_hash(m->world); }

/* --- patches --- */

static tm_status allow_patches(tm_model *m, const tm_patch_def *def, tm_error *error) {
    return tm_stage_patch(m->world, m->contact, def, &((dynamic *)m)->builder, error);
}

/* Computes a patch. The builder continues while nothing is near; missing columns come a frame later. */
static bool patch(tm_model *m, int32_t instrument, tm_patch *out) {
    tm_patch_builder *builder = ((dynamic *)m)->builder;
    tm_patch unused;
    return builder && tm_patch_compute(builder, instrument, out ? out : &unused) && out;
}

static tm_status start(tm_model *m, tm_error *error) {
    tm_patch_builder *builder = ((dynamic *)m)->builder;
    return builder ? tm_patch_start(builder, error) : TM_OK;
}

/* --- equilibrium, snapshots, stages --- */

static tm_status settle(tm_model *m, const tm_settle_def *def, double *u_m, double *reaction_N,
                        tm_settle_result *result, tm_error *error) {
    const tm_status status = tm_world_settle(m->world, def, result, error);
    if (m->contact)
        tm_contact_begin_frame(m->contact, 1, 1); /* reactions are those of the equilibrium, not of the path to it */
    const size_t bytes = sizeof(double) * 3 * (size_t)tm_tissue_mesh(m->tissue)->vertex_count;
    memcpy(u_m, displacement(m), bytes);
    memset(reaction_N, 0, bytes);
    tm_support_reaction(m->world, reaction_N);
    return status;
}

static int64_t snapshot_bytes(const tm_model *m) { return tm_snapshot_bytes(m->world); }
static int64_t snapshot_bytes_max(const tm_model *m) { return tm_snapshot_bytes_max(m->world); }

static tm_status save(const tm_model *m, void *buffer, int64_t bytes, tm_error *error) {
    return tm_snapshot_save(m->world, buffer, bytes, error);
}

static tm_status restore(tm_model *m, const void *buffer, int64_t bytes, tm_error *error) {
    const tm_status status = tm_snapshot_restore(m->world, buffer, bytes, error);
    for (int i = 0; status == TM_OK && i < m->instrument_count; i++) m->pose[i] = tm_contact_pose(m->contact, i);
    return status;
}

static int32_t stages(const tm_model *m, tm_stage_report report[TM_MAX_STAGES]) {
    return tm_world_stages(m->world, report);
}

static void set_timing(tm_model *m, bool on) { tm_world_set_timing(m->world, on); }

static const tm_model_kind kind = {.size = sizeof(tm_model_kind),
                                   .name = "dynamic",
                                   .destroy = destroy,
                                   .begin = begin,
                                   .step = step,
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
                                   .start = start,
                                   .stages = stages,
                                   .set_timing = set_timing,
                                   .snapshot_bytes_max = snapshot_bytes_max};

tm_status tm_model_check(const tm_model_def *def, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_MODEL, TM_ERR_ARGUMENT);
    if (def->invalid_member) *def->invalid_member = NULL;
    if (!(def->frame_s > 0 && def->frame_s < 1e3) || !(def->step_s >= 0) || !(def->average >= 0 && def->average <= 1) ||
        !(def->step_fraction > 0 && def->step_fraction <= 1) || !(def->step_limit_s >= 0))
        return set_invalid_member(
            def, "frame_s",
            tm_fail(error, TM_ERR_ARGUMENT, -1,
                    "frame %g s, step %g s, step fraction %g, average %g; give positive times, and shares from 0 to 1",
                    def->frame_s, def->step_s, def->step_fraction, def->average));
    if (!def->contact && (def->grasp || def->friction || def->cut)) {
        const char *what = def->grasp ? "grasp" : def->friction ? "friction" : "cut";
        return set_invalid_member(def, what,
                                  tm_fail(error, TM_ERR_ARGUMENT, -1,
                                          "%s needs contact, and this model has none; give tm_model_def.contact",
                                          what));
    }
    if (def->support_count < 0 || (def->support_count > 0 && (!def->support_dof || !def->support_m)))
        return set_invalid_member(
            def, "support",
            tm_fail(error, TM_ERR_ARGUMENT, -1,
                    "%d supported components without a list; give tm_model_def.support_dof and support_m",
                    (int)def->support_count));
    return TM_OK;
}

tm_status tm_model_dynamic(const tm_model_def *def, tm_model **model, tm_error *error) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    tm_status status = tm_model_check(def, error);
    if (status != TM_OK) return status;
    dynamic *d = tm_allocate(sizeof *d);
    if (!d) return tm_fail_memory(error, "model");
    memset(d, 0, sizeof *d);
    d->is.kind = &kind;
    tm_tissue_def tissue = def->tissue;
    tissue.cuttable = tissue.cuttable || def->cut;
    if (def->adaptive && tissue.scaled_step_s > 0 && tissue.material) /* step_s is that of small strains */
        tissue.scaled_step_s /= tm_adaptive_gain(tissue.material, tissue.material_count, tissue.strain_smoothing);
    status = set_invalid_member(def, "tissue", tm_tissue_create(&tissue, &d->is.tissue, error));
    if (status == TM_OK) status = choose_timing(def, &d->is, error);
    if (status == TM_OK) status = make_world(def, &d->is, error);
    if (status == TM_OK) status = make_contact(def, &d->is, error);
    if (status != TM_OK) {
        destroy(&d->is);
        return status;
    }
    *model = &d->is;
    return TM_OK;
}
