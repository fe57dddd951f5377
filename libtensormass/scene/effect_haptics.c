/* Effect `haptics`: patches and stiffness for the controllers of a scene. */
#include <stdlib.h>

#include "choices.h"
#include "effects.h"
#include "hrt.h"
#include "sim.h"
#include "solve_api.h"

#define SENDS(ROW) ROW("force", SIM_SENDS_FORCE) ROW("stiffness", SIM_SENDS_STIFFNESS) ROW("patch", SIM_SENDS_PATCH)
APP_CHOICE_CHECK(SENDS)

static const app_field fields[] = {
    {"haptics", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_haptics, here), 0,
     "forces are sent to a controller: over LCM in real time; in lockstep controller and virtual device "
     "run in the same process"},
    {"haptics.extrapolator", APP_CHOICE, HRT_EXTRAPOLATOR_CHOICE, "adaptive", 0, 0, offsetof(sim_haptics, extrapolator),
     0, "extrapolator in lockstep; in real time the controller chooses it"},
    {"haptics.sends", APP_CHOICE, APP_CHOICE_WORDS(SENDS), NULL, 0, 0, offsetof(sim_haptics, sends), 0,
     "what may be sent with the force if the controller's extrapolator needs it (`tangent`: stiffness, "
     "`local_model`: patch); left out: what `extrapolator` needs"},
    {"haptics.compliance", APP_CHOICE, "factor|iterations", "factor", 0, 0, offsetof(sim_haptics, compliance), 0,
     "source of the dynamic model's stiffness and patches. `factor`: a Cholesky factor (opens the module "
     "`solve`; a thread in real time), exact except where `rotation` or a `law` changes it. `iterations`: a few "
     "conjugate-gradient iterations a frame; few are ready while a cautery cuts; with `rotation` or a `law` they are of an earlier shape"},
    {"haptics.patch_vertices", APP_INTEGER, NULL, "24", 3, 24, offsetof(sim_haptics, patch_vertices), 0,
     "largest number of vertices of a patch; up to 12 with 16 triangles, more with 32"},
    {"haptics.rate", APP_NUMBER, "rate|auto", "auto", 10, 1000, offsetof(sim_haptics, rate), 0,
     "rate of force samples, a multiple of the frame rate; `auto`: 500 Hz in lockstep, in real time up to "
     "500 Hz as fast as the machine allows; the paper uses 25 Hz"},
    {"haptics.tick_rate", APP_NUMBER, "rate", "500 Hz", 50, 10000, offsetof(sim_haptics, tick_rate), 0,
     "rate of controller ticks, in lockstep"},
    {"haptics.passivity", APP_FLAG, NULL, "yes", 0, 0, offsetof(sim_haptics, passivity), 0,
     "passivity control, in lockstep"},
    {"haptics.profile", APP_PATH, NULL, NULL, 0, 0, offsetof(sim_haptics, profile), 0,
     "device profile (haptic_rt/device/profiles; `haptic-rt --params`) of all instruments, in lockstep; "
     "left out: the device's default; for different devices give `instruments[].profile`"},
    {"haptics.latency", APP_NUMBER, "none", "1", 0, 100, offsetof(sim_haptics, latency), 0,
     "in lockstep: periods of `rate` between a tool sample and the sending of its force; a warning "
     "follows if the force is then older than the controller accepts (`stale_us`)"},
    {"haptics.jitter", APP_NUMBER, "time", "0 s", 0, 1, offsetof(sim_haptics, jitter), 0,
     "in lockstep: largest random delay of each sample"},
    {"haptics.loss", APP_NUMBER, "none", "0", 0, 1, offsetof(sim_haptics, loss), 0,
     "in lockstep: share of force samples that are lost, at random"},
    {"haptics.seed", APP_INTEGER, NULL, "1", 0, 1e9, offsetof(sim_haptics, seed), 0,
     "seed of `jitter` and `loss`; the same seed gives the same run"},
};

sim_sends sim_sends_of(int extrapolator) {
    return extrapolator == HRT_LOCAL_MODEL || extrapolator == HRT_ADAPTIVE ? SIM_SENDS_PATCH
           : extrapolator == HRT_TANGENT                                   ? SIM_SENDS_STIFFNESS
                                                                           : SIM_SENDS_FORCE;
}

/* Returns what the scene's controllers may request, known before the build. */
static sim_sends sim_may_send(const sim *s) {
    const sim_haptics *o = sim_options(s->scene, "haptics");
    if (!o || !sim_has(s, "contact")) return SIM_SENDS_FORCE;
    if (o->sends.line) return (sim_sends)o->sends.index;
    /* In real time `auto` may drop to the frame rate. */
    const bool falls = s->scene->pace == SIM_REALTIME && o->rate.si == 0;
    const double rate_Hz = falls ? s->scene->frame_rate.si : sim_stream_per_frame(s->scene) * s->scene->frame_rate.si;
    const sim_sends most = sim_stream_sends(s, rate_Hz), wanted = sim_sends_of(o->extrapolator.index);
    return wanted < most ? wanted : most;
}

/* Opens exact compliance for patches of the dynamic model, from the module `solve`. */
static tm_status open_exact(sim *s, int line, tm_compliance_source *source) {
    tm_error error = {0};
    tm_compliance_factor *factored;
    sim_solve_api api;
    if (!sim_solve_open(&s->scene->host, &api, &error)) return sim_report(s->scene, line, &error);
    uint8_t *fixed = calloc(3 * (size_t)s->mesh->vertex_count, 1);
    if (!fixed) return app_scene_fail(s->scene, line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    for (int32_t i = 0; i < s->fixed_count; i++) fixed[s->fixed_dof[i]] = 1;
    tm_compliance_factor_def def = api.tm_compliance_factor_def_default_();
    def.tissue = s->model->tissue;
    def.fixed = fixed;
    def.corotated = sim_options(s->scene, "rotation") != NULL;
    const tm_status status = api.tm_compliance_factor_create_(&def, &factored, &error);
    free(fixed);
    if (status) return sim_report(s->scene, line, &error);
    *source = api.tm_compliance_factor_owned_source_(factored);
    return 0;
}

/* Warns of old patches: by iterations their columns take many frames, so they are outdated where tissue turns or
 * strains. */
static tm_status warn_of_coverage(const sim *s, const sim_haptics *o) {
    const app_section *turns = sim_options(s->scene, "rotation");
    const int line = turns ? turns->line : sim_law_line(s->scene);
    if (!line || o->compliance.index == 0) return 0;
    char where[600];
    app_scene_where(s->scene, line, where, sizeof where);
    return app_scene_warn(s->scene, o->compliance.line,
                          "with %s (%s) the stiffness changes faster than 'compliance: iterations' can follow, so "
                          "patches are of an earlier shape, and few are sent while a cautery cuts; leave 'compliance' "
                          "out to use a factor",
                          turns ? "rotation" : "the law", where);
}

/* Adds memory and a stage only for what may be sent. */
static tm_status build(sim *s, const void *own) {
    const sim_haptics *o = own;
    tm_error error = {0};
    s->can_send = sim_may_send(s);
    if (s->can_send == SIM_SENDS_PATCH) {
        s->patch = tm_allocate(sizeof *s->patch * (size_t)s->instrument_count);
        if (!s->patch)
            return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    }
    if (s->can_send == SIM_SENDS_FORCE) return 0;
    tm_patch_def def = tm_patch_def_default();
    def.max_vertices = (int32_t)o->patch_vertices.value;
    def.max_triangles = def.max_vertices > 12 ? TM_PATCH_TRIANGLES : 16;
    /* One sample period, plus two for a late sample. */
    def.horizon_s = 3 * (o->rate.si > 0 ? s->sample_s : s->frame_s);
    tm_compliance_source source;
    tm_status rc = warn_of_coverage(s, o);
    if (rc) return rc;
    if (!s->model->kind->knows_compliance && o->compliance.index == 0) {
        rc = open_exact(s, o->here.line, &source);
        if (rc) return rc;
        def.source = &source;
        s->exact_patches = true;
    }
    if (!tm_model_allow_patches(s->model, &def, &error)) return 0;
    if (def.source) source.destroy(source.self);
    return sim_report(s->scene, o->here.line, &error);
}

static void destroy(sim *s) {
    if (s->patch) tm_release(s->patch, sizeof *s->patch * (size_t)s->instrument_count);
}

const sim_effect sim_effect_haptics = {
    .name = "haptics",
    .doc = "Force samples for a 500 Hz controller. Without it instruments follow the `hand` exactly and no "
           "force is computed for a hand.",
    .example = "{extrapolator: adaptive}",
    .trial = SIM_TRIAL_LEAVE_OUT,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_haptics)},
    .needs = {"instruments"},
    .build = build,
    .destroy = destroy,
};
