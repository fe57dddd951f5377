/* All sixteen combinations of rotation, strain smoothing, viscosity and friction through the same events: contact,
 * grasp, cut during the grasp, a snapshot from which another world continues bit-identically, and rest. */
#include "../fixture.h"
#include "../long.h"
#include "combination.h"

/* Forces of both hands in frame 11 (pressed, slid) and in the last (grasped, rotated), and the number of removed
 * tetrahedra. */
typedef struct felt {
    double press_N, friction_N, held_N;
    int32_t held, removed;
} felt;

static double size_of(const double f[3]) { return sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]); }

static felt story(int effects) {
    combination c = combination_open(effects), other = combination_open(effects);
    felt f = {0};
    void *buffer = NULL;
    int64_t bytes = 0, largest = 0;
    const int64_t untouched = tm_snapshot_bytes(c.s.world), most = tm_snapshot_bytes_max(c.s.world);
    tm_error error;
    for (int i = 0; i < COMBINATION_FRAMES; i++) {
        if (!combination_frame(&c)) fail_msg("effects %d: frame %d is unstable", effects, i);
        /* The snapshot's size changes with contact, grasp and cut; a buffer of the maximum size is always
         * sufficient. */
        if (tm_snapshot_bytes(c.s.world) > largest) largest = tm_snapshot_bytes(c.s.world);
        assert_true(largest <= most && tm_snapshot_bytes_max(c.s.world) == most);
        const tm_tool_reaction r = tm_contact_reaction(c.s.contact, 0);
        if (i == 11) f.press_N = r.force_N[2], f.friction_N = r.force_N[0];
        if (i == 26) { /* grasped and half cut */
            bytes = tm_snapshot_bytes(c.s.world);
            buffer = malloc((size_t)bytes);
            fix_ok(tm_snapshot_save(c.s.world, buffer, bytes, &error), &error);
            fix_ok(tm_snapshot_restore(other.s.world, buffer, bytes, &error), &error);
            other.frame = c.frame;
        } else if (i > 26)
            assert_true(combination_frame(&other));
    }
    assert_true(largest > untouched + 1000);
    assert_true(tm_world_hash(c.s.world) == tm_world_hash(other.s.world));
    f.held = tm_grasp_vertices(c.grasp, 1, NULL, NULL);
    f.held_N = size_of(tm_contact_reaction(c.s.contact, 1).force_N);
    f.removed = c.s.mesh->tet_count - tm_tissue_alive_count(c.s.tissue);
    free(buffer);
    scene_destroy(&c.s), scene_destroy(&other.s);
    return f;
}

static void every_combination_passes_all_events(void **state) {
    (void)state;
    felt f[COMBINATIONS];
    bool told[COMBINATIONS];
    for (int e = 0; e < COMBINATIONS; e++) {
        /* Under a sanitizer: none of the effects, all, and all but one. */
        told[e] = !test_is_sanitized() || e == 0 || __builtin_popcount((unsigned)e) > 2;
        if (!told[e]) continue;
        f[e] = story(e);
        print_message("%2d: press %.3f N, rub %.3f N, held %.3f N by %d vertices, %d cut\n", e, f[e].press_N,
                      f[e].friction_N, f[e].held_N, f[e].held, f[e].removed);
        assert_true(f[e].press_N > 0.05 && f[e].held > 3 && f[e].held_N > 0.05 && f[e].removed > 1);
    }
    for (int e = 0; e < COMBINATIONS; e++) {
        if (!told[e]) continue;
        /* Each effect acts in every combination. */
        if (e & FRICTION && told[e ^ FRICTION])
            assert_true(f[e].friction_N < f[e ^ FRICTION].friction_N - 0.02 * f[e].press_N);
        if (e & VISCOSITY && told[e ^ VISCOSITY]) assert_true(f[e].press_N < 0.97 * f[e ^ VISCOSITY].press_N);
        if (e & VOLUME && told[e ^ VOLUME]) assert_true(f[e].press_N < 0.97 * f[e ^ VOLUME].press_N);
        if (e & ROTATION && told[e ^ ROTATION]) assert_true(fabs(f[e].held_N / f[e ^ ROTATION].held_N - 1) > 0.01);
    }
}

static void averaged_shears_with_rotation_are_rejected(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = def.cells[2] = 2;
    tm_mesh *mesh = scene_mesh(&def);
    tm_material material;
    tm_tissue *tissue = NULL;
    tm_error error = {0};
    fix_ok(tm_material_young(5000, 0.45, &material, &error), &error);
    tm_tissue_def tissue_def = tm_tissue_def_default();
    tissue_def.mesh = mesh, tissue_def.material_count = 1, tissue_def.material = &material;
    tissue_def.strain_smoothing = true, tissue_def.rotation = TM_ROTATION_THRESHOLD;
    assert_int_equal(tm_tissue_create(&tissue_def, &tissue, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "rotation excludes smoothed_shear_share = 0.4"));
    tissue_def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&tissue_def, &tissue, &error), &error);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_combination_passes_all_events),
                                       cmocka_unit_test(averaged_shears_with_rotation_are_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
