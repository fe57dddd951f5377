/* An incomplete patch is not sent: with conjugate gradients there is no stiffness while columns are missing; then it
 * is the tissue's, within 5 % from the first patch, whose columns are rough, and within 1 % once none are pending. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

static double pressed_at(scene *s, double z) {
    scene_frame(s, 0, scene_pose(0.003, 0.002, z), 0.02);
    scene_frame(s, 0, scene_pose(0.003, 0.002, z), 0.5);
    return scene_frame(s, 0, scene_pose(0.003, 0.002, z), 0.004).force_N[2];
}

/* Pressed 6.5 mm and held, on a block of 14,400 tetrahedra. */
static void test_incomplete_patch_has_no_stiffness(void **unused) {
    (void)unused;
    scene_def d = scene_def_default();
    memcpy(d.cells, (int[3]){20, 15, 8}, sizeof d.cells);
    memcpy(d.size_m, (double[3]){0.08, 0.06, 0.03}, sizeof d.size_m);
    memcpy(d.tip_m[0], (double[3]){0.003, 0.002, 0.034}, sizeof d.tip_m[0]);
    scene s = scene_create_full(&d, false, NULL);
    tm_patch_def def = tm_patch_def_default();
    if (test_is_sanitized()) def.iterations = 500;
    tm_patch_builder *maker;
    tm_error error;
    scene_must(tm_stage_patch(s.world, s.contact, &def, &maker, &error), &error);
    tm_patch patch;
    double most = 0, least = INFINITY, final = 0;
    int none = 0, sent = 0;
    for (int k = 0; k < 400 && (sent < 10 || tm_patch_pending(maker) > 0); k++) {
        scene_frame(&s, 0, scene_pose(0.003, 0.002, k < 20 ? 0.034 - 0.0004 * k : 0.026), 0.04);
        const bool made = tm_patch_compute(maker, 0, &patch);
        const tm_tool_reaction r = tm_contact_reaction(s.contact, 0);
        assert_true(made == (r.stiffness_kind != 0) && made == (patch.kind != 0));
        none += !made;
        if (!made || k < 60) continue; /* pressed and held: the comparison is made at this equilibrium */
        sent++;
        final = -r.stiffness_N_m[8];
        most = fmax(most, -r.stiffness_N_m[8]), least = fmin(least, -r.stiffness_N_m[8]);
    }
    const double is = (pressed_at(&s, 0.0259) - pressed_at(&s, 0.0261)) / 2e-4;
    print_message("none in %d frames, then %d with %.1f to %.1f N/m, at last %.2f; moving the tool %.2f N/m\n", none,
                  sent, least, most, final, is);
    assert_true(none > 5 && sent >= 10);
    assert_int_equal(tm_patch_pending(maker), 0);
    assert_in_range((int)(1e4 * final / is), 9900, 10100);
    assert_true(least > 0.95 * is && most < 1.05 * is);
    scene_destroy(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_incomplete_patch_has_no_stiffness)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
