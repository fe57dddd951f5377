/* The energy account keeps the forces of a nonlinear law between steps: the same account, bit for bit, as one that
 * computes them anew, through cuts, a new velocity, and displacements that the caller wrote. */
#include "turning.h"

#include "tensormass/energy.h"

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
} body;

/* Makes a body whose account comes after the law, and so keeps its forces, or before. */
static body make(bool keeps) {
    fix_random random = {7};
    tm_error error;
    tm_material m;
    body b = {0};
    fix_ok(tm_material_young(5e3, 0.4, &m, &error), &error);
    m.damping_1_s = 20;
    b.mesh = fix_block((int[]){4, 4, 3}, (double[]){0.04, 0.04, 0.03}, 0.2, &random);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b.mesh, def.material_count = 1, def.material = &m;
    def.rotation = TM_ROTATION_THRESHOLD, def.cuttable = true;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    tm_world_def of = tm_world_def_default();
    of.tissue = b.tissue, of.damped = true, of.dt_s = 0.9 * tm_critical_step_guaranteed(b.tissue, NULL);
    fix_ok(tm_world_create(&of, &b.world, &error), &error);
    if (!keeps) fix_ok(tm_stage_energy(b.world, &error), &error);
    fix_ok(tm_stage_rotation(b.world, NULL, &error), &error);
    if (keeps) fix_ok(tm_stage_energy(b.world, &error), &error);
    return b;
}

static tm_energy story(bool keeps) {
    body b = make(keeps);
    tm_state *s = tm_world_state(b.world);
    const int32_t n = 3 * b.mesh->vertex_count;
    tm_error error;
    tm_energy e;
    for (int32_t round = 0; round < 6; round++) {
        const int32_t gone[] = {30 * round, 30 * round + 7};
        if (round % 2)
            for (int32_t i = 0; i < n; i++) s->u_m[i] += 1e-4 * (i % 7);
        else
            for (int32_t i = 0; i < n; i++) s->u_prev_m[i] -= 3e-5 * (i % 5);
        assert_int_equal(tm_world_step(b.world, 20), TM_OK);
        assert_true(tm_cut_remove(b.tissue, gone, 2, NULL, 0) > 0);
        assert_int_equal(tm_world_step(b.world, 20), TM_OK);
    }
    fix_ok(tm_world_energy(b.world, &e, &error), &error);
    assert_true(e.cut_J > 0 && e.damping_J > 0 && e.elastic_J > 0 && e.state_change_J != 0);
    tm_world_destroy(b.world);
    tm_tissue_destroy(b.tissue);
    tm_mesh_destroy(b.mesh);
    return e;
}

static void kept_forces_give_the_same_account(void **unused) {
    (void)unused;
    const tm_energy kept = story(true), anew = story(false);
    assert_memory_equal(&kept, &anew, sizeof kept);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(kept_forces_give_the_same_account)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
