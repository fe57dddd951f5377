/* A sequence of events for every combination of rotation, strain smoothing, viscosity and friction: a cautery
 * presses, slides and cuts while a grasper grasps, lifts and rotates the tissue. */
#ifndef COMBINATION_H
#define COMBINATION_H

#include "contact_scene.h"

enum { ROTATION = 1, VOLUME = 2, VISCOSITY = 4, FRICTION = 8, COMBINATIONS = 16 };

typedef struct combination {
    scene s;
    tm_grasp *grasp;
    tm_friction *friction; /* or null */
    int frame;
} combination;

static inline tm_status combination_tissue(const tm_mesh *mesh, int effects, tm_material *material, tm_tissue **tissue,
                                           tm_error *error) {
    scene_must(tm_material_young(5000, 0.45, material, error), error);
    material->damping_1_s = 60;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = material, def.form = TM_FORCE_PLAIN;
    def.cuttable = true, def.strain_smoothing = effects & VOLUME;
    def.rotation = effects & ROTATION ? TM_ROTATION_THRESHOLD : 0;
    if (def.strain_smoothing && def.rotation > 0) def.smoothed_shear_share = 0; /* all effects that may be combined */
    return tm_tissue_create(&def, tissue, error);
}

static inline void combination_effects(combination *c, int effects, tm_error *error) {
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.3, 0.1}, viscosity.term[1] = (tm_viscosity_term){0.3, 0.2, 0};
    if (effects & ROTATION) scene_must(tm_stage_rotation(c->s.world, NULL, error), error);
    if (effects & VISCOSITY) scene_must(tm_stage_viscosity(c->s.world, &viscosity, error), error);
}

static inline combination combination_open(int effects) {
    combination c = {.s.def = scene_def_default()};
    scene *s = &c.s;
    tm_error error;
    s->def.cells[0] = s->def.cells[1] = 6, s->def.cells[2] = 4;
    s->mesh = scene_mesh(&s->def);
    scene_must(combination_tissue(s->mesh, effects, &s->material, &s->tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = s->tissue;
    scene_must(tm_world_create(&world, &s->world, &error), &error);
    scene_support(s);
    scene_must(tm_stage_gravity(s->world, (const double[3]){0, 0, -9.81}, &error), &error);
    combination_effects(&c, effects, &error);
    const tm_instrument_def tool[2] = {{.mode = TM_TOOL_CAUTERY,
                                        .trocar_m = {0.02, 0, 0.25},
                                        .radius_m = 0.0025,
                                        .contact_length_m = 0.1,
                                        .pose = {.tip_m = {0.012, 0.005, 0.06}}},
                                       {.mode = TM_TOOL_GRASPER,
                                        .trocar_m = {-0.02, 0, 0.25},
                                        .radius_m = 0.004,
                                        .contact_length_m = 0.1,
                                        .pose = {.tip_m = {-0.015, 0.005, 0.06}, .active = true}}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 2, contact.instrument = tool;
    scene_must(tm_stage_contact(s->world, &contact, &s->contact, &error), &error);
    const tm_grasp_def grasp = tm_grasp_def_default();
    scene_must(tm_stage_grasp(s->world, s->contact, &grasp, &c.grasp, &error), &error);
    const tm_cut_def cut = tm_cut_def_default();
    scene_must(tm_stage_cut(s->world, s->contact, &cut, &error), &error);
    tm_friction_def friction = tm_friction_def_default();
    friction.instrument[0] = friction.instrument[1] = (tm_friction_coefficient){0.4, 0.25};
    if (effects & FRICTION) scene_must(tm_stage_friction(s->world, s->contact, &friction, &c.friction, &error), &error);
    return c;
}

/* Runs one frame of 10 ms. Frames 0 to 9 press, 10 to 19 slide; the jaw closes at 12, lifts and rotates from 15 on;
 * the cautery cuts from 20 on. Returns false if the step failed. */
enum { COMBINATION_FRAMES = 36 };
static inline bool combination_frame(combination *c) {
    const double i = c->frame++, in = fmin(i, 9), slide = fmin(fmax(i - 9, 0), 16), lift = fmax(i - 14, 0);
    const int32_t substeps = (int32_t)ceil(0.01 / tm_world_step_s(c->s.world));
    tm_tool_pose cautery = {.tip_m = {0.012 + 0.0004 * slide, 0.005, 0.052 - 0.0016 * in}, .active = i >= 20};
    tm_tool_pose grasper = {.tip_m = {-0.015, 0.005, 0.052 - 0.0014 * in + 0.0006 * lift},
                            .grip = i >= 12 ? 1 : 0,
                            .roll_rad = 0.03 * lift,
                            .active = true};
    tm_contact_begin_frame(c->s.contact, substeps, substeps);
    tm_contact_set_target(c->s.contact, 0, &cautery, substeps);
    tm_contact_set_target(c->s.contact, 1, &grasper, substeps);
    return tm_world_step(c->s.world, substeps) == TM_OK;
}

#endif
