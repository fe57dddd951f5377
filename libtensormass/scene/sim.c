/* Builds a world from a scene, and computes its frames. */
#include "sim.h"
#include "bodies.h"
#include "choices.h"
#include "libtensormass/platform/clock.h"
#include "models.h"
#include "surface_distance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* --- the complete scene --- */

tm_status sim_scene_load(const char *file, char *const *set, int set_count, const app_host *host, app_scene **scene) {
    app_schema schema[SIM_MAX_EFFECTS] = {0};
    for (int i = 0; i < sim_effect_count; i++) schema[i] = sim_effects[i]->schema;
    const tm_status rc = app_scene_load(file, set, set_count, schema, sim_effect_count, host, scene);
    if (rc) return rc;
    app_effect_key *key = app_scene_alloc(*scene, sizeof *key * SIM_MAX_EFFECTS);
    if (!key) {
        app_scene_free(*scene);
        *scene = NULL;
        return app_scene_no_memory(host, file);
    }
    for (int i = 0; i < sim_effect_count; i++) key[i] = (app_effect_key){sim_effects[i]->name, sim_effects[i]->model};
    (*scene)->effect_key = key;
    const tm_status merged = sim_merge_body_effects(*scene);
    if (merged) {
        app_scene_free(*scene);
        *scene = NULL;
    }
    return merged;
}

static tm_status check_effect(const app_scene *scene, int index) {
    const sim_effect *e = sim_effects[index];
    int line = sim_effect_line(scene, index);
    char where[600];
    for (int i = 0; i < 4 && e->needs[i]; i++) {
        if (!strcmp(e->needs[i], "instruments") ? scene->instrument.count > 0 : sim_options(scene, e->needs[i]) != NULL)
            continue;
        return app_scene_bad(scene, line, "%s needs %s, which the scene does not name; add '%s:' or remove '%s:'",
                             e->name, e->needs[i], e->needs[i], e->name);
    }
    for (int i = 0; i < 4 && e->excludes[i].other; i++) {
        const int other = sim_effect_find(scene, e->excludes[i].other);
        if (other < 0 || !sim_effect_line(scene, other)) continue;
        app_scene_where(scene, sim_effect_line(scene, other), where, sizeof where);
        return app_scene_bad(scene, line, "%s and %s (%s) exclude each other: %s", e->name, e->excludes[i].other, where,
                             e->excludes[i].why);
    }
    return e->check ? e->check(scene, scene->effect[index]) : 0;
}

bool sim_effect_left_out(const char *name) {
    for (int i = 0; i < sim_effect_count; i++)
        if (!strcmp(sim_effects[i]->name, name)) return sim_effects[i]->trial == SIM_TRIAL_LEAVE_OUT;
    return false;
}

/* Checks what nonlinear laws cannot be combined with. */
static tm_status check_law(const app_scene *scene, const app_material *m) {
    const tm_status constants = app_scene_law_check(scene, m);
    if (constants) return constants;
    if (m->law.index == TM_LAW_LINEAR) {
        if (m->stretch.line)
            return app_scene_bad(
                scene, m->stretch.line,
                "material '%s' has 'stretch:', and the linear law has no limit; give a nonlinear 'law:', or remove "
                "'stretch:'",
                m->region.s);
        return 0;
    }
    for (int i = 0; i < sim_effect_count; i++)
        if (sim_effects[i]->of_linear_law && sim_effect_line(scene, i))
            return app_scene_bad(scene, m->law.line, "law '%s' and %s exclude each other: %s; leave one of them out",
                                 tm_law_name((tm_law_kind)m->law.index), sim_effects[i]->name,
                                 sim_effects[i]->of_linear_law);
    if (scene->model.index != APP_DYNAMIC)
        return app_scene_bad(
            scene, m->law.line,
            "law '%s' needs 'model: dynamic', as the other models support only the linear law; write 'model: dynamic'",
            tm_law_name((tm_law_kind)m->law.index));
    if (scene->precision.index == TM_SINGLE && sim_options(scene, "viscosity"))
        return app_scene_bad(scene, scene->precision.line,
                             "tissue.precision = single and law '%s' with 'viscosity:' exclude each other: what "
                             "relaxes is kept in double; write 'precision: double', or leave viscosity out",
                             tm_law_name((tm_law_kind)m->law.index));
    return 0;
}

static tm_status check_scene(const app_scene *scene) {
    tm_status rc = sim_check_bodies(scene);
    if (!rc) rc = app_scene_check(scene);
    for (int i = 0; i < sim_effect_count && !rc; i++)
        if (sim_effect_line(scene, i)) rc = check_effect(scene, i);
    for (int i = 0; i < scene->material.count && !rc; i++) {
        const app_material *m = (const app_material *)scene->material.item + i;
        app_law law;
        rc = app_scene_law(scene, m, &law);
        const bool fibred = app_law_fibred(law) || tm_law_needs_fibre((tm_law_kind)m->law.index);
        if (!rc && fibred && !sim_options(scene, "anisotropy"))
            rc = app_scene_bad(scene, m->region.line,
                               "material '%s' is fibred, but the scene names no fibres; add 'anisotropy:' with a file "
                               "or a rule, or %s",
                               m->region.s, app_law_fibred(law) ? "give isotropic constants" : "another 'law:'");
        if (!rc) rc = check_law(scene, m);
        if (!rc && m->damping.line && !sim_options(scene, "damping"))
            rc = app_scene_bad(scene, m->damping.line,
                               "material '%s' has a damping rate, but the scene does not name the effect; add "
                               "'damping:' or remove the rate",
                               m->region.s);
    }
    static const char *const mode[] = APP_CHOICE_LIST(APP_TOOL_MODES);
    for (int i = 0; i < scene->instrument.count && !rc; i++) {
        const app_instrument *t = (const app_instrument *)scene->instrument.item + i;
        const char *needed = t->mode.index == TM_TOOL_GRASPER   ? "grasp"
                             : t->mode.index == TM_TOOL_CAUTERY ? "cut"
                                                                : NULL;
        if (needed && !sim_options(scene, needed))
            rc = app_scene_bad(
                scene, t->mode.line,
                "instrument %d is a %s, but the scene does not name the effect '%s'; add '%s:' or use the mode probe",
                i, mode[t->mode.index], needed, needed);
    }
    return rc;
}

/* --- building --- */

static tm_status load_mesh(sim *s) {
    tm_error error = {0};
    const app_scene *scene = s->scene;
    const tm_status rc = scene->body.count
                             ? sim_load_bodies(s)
                             : sim_load_mesh_file(scene, "tissue.mesh", &scene->mesh, scene->scale.si, &s->file);
    if (rc) return rc;
    if (tm_mesh_file_build_numbered(&s->file, scene->renumber.on ? TM_NUMBERING_IMPROVED : TM_NUMBERING_ORIGINAL,
                                    &s->mesh, &error))
        return sim_report_file(scene, scene->body.count ? scene->body.line : scene->mesh.line, NULL, 0, &error);
    return 0;
}

/* Assigns new stages since the last call to `effect`; with SIM_OWNER_ALL, to the owners of their names. Returns their
 * memory. */
static int64_t own_stages(sim *s, int effect) {
    tm_stage_report report[TM_MAX_STAGES];
    const int count = tm_model_stages(s->model, report);
    int64_t bytes = 0;
    for (int i = 0; i < count; i++) {
        bool known = false;
        int owner = effect;
        char whole[64];
        for (int j = 0; j < s->owner_count; j++) known |= !strcmp(s->owner[j].stage, report[i].name);
        if (known) continue;
        snprintf(whole, sizeof whole, "%.*s", (int)strcspn(report[i].name, " "), report[i].name); /* of a substage */
        if (owner == SIM_OWNER_ALL) owner = sim_effect_find(s->scene, whole);
        if (owner < 0)
            owner = !strcmp(whole, "support")                              ? SIM_OWNER_SUPPORTS
                    : !strcmp(whole, "load") || !strcmp(whole, "pressure") ? SIM_OWNER_LOADS
                                                                           : SIM_OWNER_ALL;
        s->owner[s->owner_count++] = (sim_owner){report[i].name, owner};
        bytes += report[i].bytes;
    }
    return bytes;
}

/* Runs one hook of each named effect; records memory and stages. */
static tm_status run_hook(sim *s, bool build) {
    tm_status rc = 0;
    for (int i = 0; i < sim_effect_count && !rc; i++) {
        tm_status (*hook)(sim *, const void *) = build ? sim_effects[i]->build : sim_effects[i]->prepare;
        if (!sim_effect_line(s->scene, i) || !hook) continue;
        int64_t before = tm_memory_in_use();
        rc = hook(s, s->scene->effect[i]);
        s->cost[i].bytes += tm_memory_in_use() - before;
        if (build && !rc) s->cost[i].bytes -= own_stages(s, i);
    }
    return rc;
}

static tm_status define_model(sim *s) {
    tm_model_def *def = &s->def.model;
    s->material = calloc((size_t)s->mesh->region_count, sizeof *s->material);
    if (!s->material) return app_scene_fail(s->scene, 0, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    *def = tm_model_def_default();
    def->damped = false;
    tm_status rc = sim_mark_rigid(s);
    if (!rc) rc = sim_set_region_effects(s);
    if (!rc) rc = run_hook(s, false);
    if (!rc) rc = app_scene_materials(s->scene, &s->file, s->damping_1_s, s->material);
    if (!rc) rc = sim_build_supports(s);
    if (!rc) rc = sim_build_loads(s);
    if (!rc) rc = sim_build_instruments(s);
    def->tissue.mesh = s->mesh;
    def->tissue.material_count = s->mesh->region_count;
    def->tissue.material = s->material;
    def->tissue.fibre = s->fibre;
    def->tissue.precision = (tm_precision)s->scene->precision.index;
    def->tissue.form = (tm_force_form)s->scene->force.index;
    def->support_count = s->fixed_count;
    def->support_dof = s->fixed_dof;
    def->support_m = s->fixed_m;
    def->load_N = s->load_N;
    s->samples = sim_stream_per_frame(s->scene);
    def->frame_s = 1 / (s->scene->frame_rate.si * s->samples);
    def->step_s = s->scene->step.line ? s->scene->step.si : 0;
    def->step_fraction = s->scene->step_fraction.si;
    def->tissue.scaled_step_s = s->scene->mass_scaling.on ? s->scene->step.si : 0;
    def->tissue.scaled_share = s->scene->mass_scaling_max.si;
    def->adaptive = s->scene->adaptive.on;
    def->average = s->scene->average.si;
    def->threads = (int32_t)s->scene->threads.value;
    def->invalid_member = &s->def.invalid_member;
    return rc;
}

static tm_status make_model(sim *s) {
    const tm_status rc = sim_models[s->scene->model.index].build(s);
    if (rc) return rc;
    const tm_timing *pace = &s->model->timing;
    s->sample_s = pace->frame_s;
    s->frame_s = 1 / s->scene->frame_rate.si;
    s->dt_s = pace->dt_s;
    s->substeps = s->samples * pace->substeps;
    s->average = pace->average;
    own_stages(s, SIM_OWNER_ALL);
    return sim_warn_timing(s);
}

tm_status sim_prepare(app_scene *scene, sim **out) {
    sim *s = calloc(1, sizeof *s);
    if (!s) {
        const tm_status none = app_scene_no_memory(&scene->host, scene->file);
        app_scene_free(scene);
        return none;
    }
    s->scene = scene;
    tm_status rc = check_scene(scene);
    if (!rc) rc = load_mesh(s);
    if (!rc) rc = define_model(s);
    if (!rc) rc = sim_warn(s);
    if (rc)
        sim_destroy(s);
    else
        *out = s;
    return rc;
}

tm_status sim_create(app_scene *scene, sim **out) {
    sim *s;
    tm_status rc = sim_prepare(scene, &s);
    if (rc) return rc;
    rc = make_model(s);
    if (!rc) rc = sim_build_paths(s);
    if (!rc) rc = sim_add_pressures(s);
    if (!rc) rc = run_hook(s, true);
    if (rc)
        sim_destroy(s);
    else
        *out = s;
    return rc;
}

void sim_destroy(sim *s) {
    if (!s) return;
    for (int i = 0; i < sim_effect_count; i++)
        if (sim_effects[i]->destroy) sim_effects[i]->destroy(s);
    tm_model_destroy(s->model);
    if (s->mesh) tm_mesh_destroy(s->mesh);
    tm_mesh_file_free(&s->file);
    free(s->body);
    free(s->support_of);
    free(s->fixed_dof);
    free(s->fixed_m);
    free(s->fixed_by);
    free(s->rigid_tet);
    free(s->region_effects);
    free(s->load_N);
    free(s->fibre);
    free(s->material);
    app_scene_free(s->scene);
    free(s);
}

/* --- one frame --- */

static bool is_stopped(const sim *s) {
    const app_host *host = &s->scene->host;
    return host->stop && host->stop(host->user);
}

/* Computes a frame in slices of 0.1 s, so that Ctrl-C does not wait for millions of substeps. The slices do not change
 * a bit. */
static tm_status step_in_slices(sim *s, int32_t substeps) {
    const double piece_s = 0.1;
    tm_status status = TM_OK;
    int32_t done = 0;
    if (!s->slice) s->slice = 1 + 1000000 / s->mesh->tet_count; /* until measured: 0.1 us per tetrahedron */
    while (!status && done < substeps && !is_stopped(s)) {
        int32_t count = s->slice < substeps - done ? s->slice : substeps - done;
        if (s->between) {
            const int32_t most = s->between(s->between_user, s);
            if (most < count) count = most;
        }
        int64_t begin = app_monotonic_us();
        status = tm_model_step(s->model, count);
        done += count;
        double cost_s = ((double)(app_monotonic_us() - begin) + 1) * 1e-6 / count;
        s->slice = cost_s < piece_s ? (int32_t)fmin(piece_s / cost_s, 1e6) : 1;
    }
    s->broken_off = !status && done < substeps;
    return status;
}

static void take_reactions(sim *s) {
    for (int i = 0; i < s->model->instrument_count; i++) s->reaction[i] = tm_model_reaction(s->model, i);
}

/* Computes what the instrument's controller requests besides the force. */
static void feel(sim *s, int i) {
    s->patch_valid[i] = false;
    if (i >= s->model->instrument_count || s->wants[i] == SIM_SENDS_FORCE) return;
    const bool made = tm_model_patch(s->model, i, s->patch ? &s->patch[i] : NULL);
    s->reaction[i] = tm_model_reaction(s->model, i);
    s->patch_valid[i] = made && s->wants[i] == SIM_SENDS_PATCH;
    const tm_tool_reaction *r = &s->reaction[i];
    const bool felt = r->force_N[0] != 0 || r->force_N[1] != 0 || r->force_N[2] != 0;
    if (!felt || (r->flags & TM_REACTION_RELEASING)) return;
    s->coverage[i].touched++;
    if (s->patch_valid[i]) s->coverage[i].age_max = fmax(s->coverage[i].age_max, s->patch[i].age);
    s->coverage[i].carried += s->wants[i] == SIM_SENDS_PATCH ? s->patch_valid[i] : r->stiffness_kind != 0;
}

tm_status sim_sample(sim *s, const tm_tool_pose *to, int32_t substeps) {
    s->broken_off = false;
    tm_model_begin(s->model, to, substeps);
    tm_status status = step_in_slices(s, substeps);
    if (s->broken_off) return status; /* Ctrl-C: a partial frame is not reported */
    if (!status) tm_model_end(s->model);
    take_reactions(s);
    if (status) { /* the frame failed: nothing of it is sent or drawn */
        memset(s->patch_valid, 0, sizeof s->patch_valid);
        return status;
    }
    s->last_s = substeps * s->dt_s;
    const int64_t begin = app_monotonic_us();
    for (int i = 0; i < s->instrument_count; i++) {
        for (int a = 0; a < 3; a++) s->velocity_m_s[i][a] = (to[i].tip_m[a] - s->pose[i].tip_m[a]) / s->last_s;
        s->pose[i] = to[i];
        feel(s, i);
    }
    s->patches_s = 1e-6 * (double)(app_monotonic_us() - begin);
    return status;
}

void sim_frame_end(sim *s) {
    for (int i = 0; i < sim_effect_count; i++)
        if (sim_effects[i]->frame && sim_effect_line(s->scene, i)) sim_effects[i]->frame(s);
    s->frames++;
}

tm_status sim_frame(sim *s, const tm_tool_pose *to, int32_t substeps) {
    const tm_status status = sim_sample(s, to, substeps);
    if (!status && !s->broken_off) sim_frame_end(s);
    return status;
}
