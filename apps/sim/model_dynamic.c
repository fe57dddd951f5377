/* The tensor/mass model: every effect a stage of one world. */
#include "sim.h"

#include <math.h>
#include <stdio.h>

enum { MANY_SUBSTEPS = 20000, MOST_SUBSTEPS = 10000000 }; /* a frame: slow, and hopeless */

/* A whole number of equal substeps a frame, none above what the scene or the guaranteed bound allows. */
int sim_choose_step(sim *s) {
    const app_scene *scene = s->scene;
    double largest = s->critical_s * scene->step_fraction.si;
    if (scene->step.line) {
        largest = scene->step.si;
        if (largest > s->critical_s)
            return app_scene_bad(scene, scene->step.line,
                                 "time.step = %.4g s is above the guaranteed critical step %.4g s, set by tetrahedron "
                                 "%lld of the mesh file; lower it or leave it out",
                                 largest, s->critical_s, (long long)s->file.tet_tag[s->critical_tet]);
    }
    s->frame_s = 1 / scene->frame_rate.si;
    double count = ceil(s->frame_s / largest - 1e-9);
    char why[200];
    snprintf(why, sizeof why,
             "substeps of %.3g s, set by tetrahedron %lld; look at its material (Young's modulus, density) and its "
             "shape (tm-mesh info)",
             largest, (long long)s->file.tet_tag[s->critical_tet]);
    int line = scene->step.line ? scene->step.line : scene->material.line;
    if (!(count < MOST_SUBSTEPS)) return app_scene_bad(scene, line, "a frame would take %.3g %s", count, why);
    if (count > MANY_SUBSTEPS) {
        int rc = app_scene_warn(scene, line, "a frame takes %.3g %s", count, why);
        if (rc) return rc;
    }
    s->substeps = count < 1 ? 1 : (int32_t)count;
    s->dt_s = s->frame_s / s->substeps;
    s->average = (int32_t)(scene->average.si * s->substeps + 0.5);
    if (s->average < 1) s->average = 1;
    return 0;
}

/* World, supports and loads: what every scene with a world has. */
int sim_make_world(sim *s) {
    tm_error error = {0};
    int rc = sim_choose_step(s);
    if (rc) return rc;
    s->world_def.tissue = s->tissue;
    s->world_def.dt_s = s->dt_s;
    if (tm_world_create(&s->world_def, &s->world, &error)) return sim_report(s->scene, s->scene->step.line, &error);
    sim_own_stages(s, SIM_OWNER_ALL);
    tm_support_def def = tm_support_def_default();
    def.count = s->held_count;
    def.dof = s->held_dof;
    def.value_m = s->held_m;
    if (s->held_count && tm_stage_support(s->world, &def, &error))
        return sim_report(s->scene, s->scene->support.line, &error);
    sim_own_stages(s, SIM_OWNER_SUPPORTS);
    if (s->load_N && tm_stage_load(s->world, s->load_N, &error))
        return sim_report(s->scene, s->scene->load.line, &error);
    sim_own_stages(s, SIM_OWNER_LOADS);
    return 0;
}

static int begin(sim *s) {
    s->critical_s = tm_critical_step_guaranteed(s->tissue, &s->critical_tet);
    const int rc = sim_make_world(s);
    tm_error error = {0};
    if (rc || s->tissue_def.precision != TM_SINGLE || !tm_world_check_held(s->world, &error)) return rc;
    return app_scene_bad(s->scene, s->scene->precision.line,
                         "tissue.precision = single, and %s, or take double: rounded tensors would set it turning",
                         error.message);
}

/* A frame in pieces of a tenth of a second, so that Ctrl-C does not wait for millions of substeps. Bits do not depend
 * on the pieces. */
static tm_status step_in_slices(sim *s, int32_t substeps) {
    const double piece_s = 0.1;
    tm_status status = TM_OK;
    int32_t done = 0;
    if (!s->slice) s->slice = 1 + 1000000 / s->mesh->tet_count; /* until it is measured: 0.1 us a tetrahedron */
    while (!status && done < substeps && !app_interrupted()) {
        int32_t count = s->slice < substeps - done ? s->slice : substeps - done;
        int64_t begin = app_monotonic_us();
        status = tm_world_step(s->world, count);
        done += count;
        double cost_s = ((double)(app_monotonic_us() - begin) + 1) * 1e-6 / count;
        s->slice = cost_s < piece_s ? (int32_t)fmin(piece_s / cost_s, 1e6) : 1;
    }
    s->broken_off = !status && done < substeps;
    return status;
}

tm_status sim_world_frame(sim *s, const tm_tool_pose *to, int32_t substeps) {
    if (s->contact) {
        tm_contact_begin_frame(s->contact, substeps, s->average < substeps ? s->average : substeps);
        for (int i = 0; i < s->instrument_count; i++) tm_contact_move(s->contact, i, &to[i], substeps);
    }
    tm_status status = step_in_slices(s, substeps);
    for (int i = 0; s->contact && i < s->instrument_count; i++) s->reaction[i] = tm_contact_reaction(s->contact, i);
    return status;
}

/* The patch maker goes on computing while nothing is near; what it lacks comes a frame later. */
static void feel(sim *s, int i) {
    tm_patch unused, *patch = s->patch ? &s->patch[i] : &unused;
    if (!s->patch_maker) return;
    bool made = tm_patch_make(s->patch_maker, i, patch);
    s->reaction[i] = tm_contact_reaction(s->contact, i);
    s->patch_valid[i] = made && s->patch && s->wants[i] == SIM_SENDS_PATCH;
}

static tm_surface_view surface(const sim *s) { return tm_tissue_surface(s->tissue); }
static const double *displacement(const sim *s) { return tm_world_state(s->world)->u_m; }
static double time_s(const sim *s) { return tm_world_state(s->world)->time_s; }
static uint64_t hash(const sim *s) { return tm_world_hash(s->world); }

static const sim_model dynamic = {.begin = begin,
                                  .frame = sim_world_frame,
                                  .feel = feel,
                                  .surface = surface,
                                  .displacement = displacement,
                                  .time_s = time_s,
                                  .hash = hash};

/* By the index of the scene's `model`. */
const sim_model *const sim_models[] = {&dynamic, &sim_model_precomputed, &sim_model_hybrid};
