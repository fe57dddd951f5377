/* An organ with a condensed part, in a world, with access to its internals, for test_hybrid and test_contact_reuse. */
#ifndef SOLVE_HYBRID_SET_H
#define SOLVE_HYBRID_SET_H

#include "../../libtensormass/solve/hybrid.h"
#include "../physics/contact_scene.h"
#include "kit.h"

typedef struct hybrid_set {
    tm_mesh *mesh;
    tm_tissue *whole, *tissue;
    uint8_t *fixed, *dynamic;
    double *load;
    tm_hybrid *hybrid;
    tm_world *world;
    tm_contact *contact;
} hybrid_set;

/* Dynamic where a tetrahedron's centre is beyond `cut_x`. */
static inline uint8_t *set_beyond(const tm_mesh *mesh, double cut_x) {
    uint8_t *dynamic = malloc((size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x = 0;
        for (int i = 0; i < 4; i++) x += mesh->rest_m[3 * mesh->tet[4 * t + i]] / 4;
        dynamic[t] = x > cut_x;
    }
    return dynamic;
}

static inline tm_tissue_def set_tissue_def(const tm_mesh *mesh, const tm_material *material) {
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh;
    def.material_count = 1;
    def.material = material;
    def.form = TM_FORCE_PLAIN;
    return def;
}

/* Takes ownership of `mesh`. */
static inline hybrid_set set_make(tm_mesh *mesh, const tm_material *material, uint8_t *fixed, double cut_x,
                                  const double g[3], const tm_contact_def *contact, double step_fraction) {
    hybrid_set s = {.mesh = mesh, .fixed = fixed, .dynamic = set_beyond(mesh, cut_x)};
    tm_error error;
    tm_tissue_def def = set_tissue_def(mesh, material);
    fix_ok(tm_tissue_create(&def, &s.whole, &error), &error);
    s.load = calloc(3 * (size_t)mesh->vertex_count, 8);
    for (int32_t d = 0; g && d < 3 * mesh->vertex_count; d++) s.load[d] = tm_tissue_mass_kg(s.whole)[d / 3] * g[d % 3];
    tm_hybrid_def hybrid = tm_hybrid_def_default();
    hybrid.problem = kit_problem(s.whole, fixed);
    hybrid.problem.load_N = s.load;
    hybrid.dynamic = s.dynamic;
    hybrid.contact = contact;
    fix_ok(tm_hybrid_create(&hybrid, &s.hybrid, NULL, &error), &error);
    def.cuttable = true;
    tm_hybrid_tissue(s.hybrid, &def);
    fix_ok(tm_tissue_create(&def, &s.tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = s.tissue;
    world.dt_s = step_fraction * tm_hybrid_critical_step(s.hybrid, NULL);
    world.damped = material->damping_1_s > 0;
    fix_ok(tm_world_create(&world, &s.world, &error), &error);
    uint8_t *outside = calloc(3 * (size_t)mesh->vertex_count, 1); /* supports of the world's own vertices */
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++)
        outside[d] = fixed[d] && tm_tissue_mass_kg(s.tissue)[d / 3] > 0;
    kit_support(s.world, outside, NULL);
    free(outside);
    if (g) fix_ok(tm_stage_gravity(s.world, g, &error), &error);
    if (contact) fix_ok(tm_stage_contact(s.world, contact, &s.contact, &error), &error);
    fix_ok(tm_stage_hybrid(s.world, s.hybrid, s.contact, &error), &error);
    return s;
}

static inline void set_free(hybrid_set *s) {
    tm_world_destroy(s->world);
    tm_hybrid_destroy(s->hybrid);
    tm_tissue_destroy(s->tissue);
    tm_tissue_destroy(s->whole);
    tm_mesh_destroy(s->mesh);
    free(s->fixed), free(s->dynamic), free(s->load);
}

/* A block under one probe, half of it condensed. */
static inline hybrid_set set_touched_by(const scene_def *by, const tm_tool_pose *start) {
    const scene_def def = *by;
    tm_mesh *mesh = scene_mesh(&def);
    uint8_t *fixed = calloc(3 * (size_t)mesh->vertex_count, 1);
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++) fixed[d] = mesh->rest_m[d / 3 * 3 + 2] < 1e-9;
    tm_instrument_def tool = {
        .mode = TM_TOOL_PROBE, .radius_m = def.radius_m, .contact_length_m = def.length_m, .pose = *start};
    memcpy(tool.trocar_m, def.trocar_m[0], 24);
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1;
    contact.instrument = &tool;
    tm_material material = kit_material(def.young_Pa, def.poisson);
    material.damping_1_s = def.damping_1_s;
    return set_make(mesh, &material, fixed, 0.0, NULL, &contact, 0.9);
}

static inline scene_def set_def(void) {
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    def.damping_1_s = 150;
    return def;
}

static inline hybrid_set set_touched(const tm_tool_pose *start) {
    const scene_def def = set_def();
    return set_touched_by(&def, start);
}

static inline void set_go(hybrid_set *s, const tm_tool_pose *to, double seconds, double force_N[3]) {
    const int32_t steps = (int32_t)ceil(seconds / tm_world_step_s(s->world));
    tm_contact_begin_frame(s->contact, steps, 1);
    tm_contact_set_target(s->contact, 0, to, steps);
    assert_int_equal(tm_world_step(s->world, steps), TM_OK);
    tm_hybrid_recover(s->hybrid, s->world);
    const tm_tool_reaction r = tm_hybrid_reaction(s->hybrid, 0);
    if (force_N) memcpy(force_N, r.force_N, 24);
}

/* Lists far tetrahedra of the dynamic part, high up. */
static inline int32_t set_far_corner(const hybrid_set *s, int32_t *list, int32_t most) {
    int32_t count = 0;
    for (int32_t t = 0; t < s->mesh->tet_count && count < most; t++) {
        const double *x = s->mesh->rest_m + 3 * (int64_t)s->mesh->tet[4 * (int64_t)t];
        if (s->dynamic[t] && x[0] > 0.02 && x[2] > 0.02) list[count++] = t;
    }
    return count;
}

#endif
