/* The compliance of a row of touch: its three slopes, the inverse, the energy, and that the cap keeps surfaces apart.
 */
#include "../fixture.h"

#include "tensormass/touch.h"
#include "touch/touch_law.h"

static const double FORCE_N[] = {0.05, 0.29, 0.31, 5, 10.2, 10.4, 30, 50};
enum { FORCES = sizeof FORCE_N / sizeof *FORCE_N };

static double soft_m(const tm_touching_def *def) { return LAW_COMPLIANCE_TRAVEL * def->thickness_m; }

static void surfaces_do_not_meet_at_the_cap(void **unused) {
    (void)unused;
    const tm_touching_def def = tm_touching_def_default();
    const double depth_m = touch_law_depth(def.compliance_m_N, soft_m(&def), def.force_cap_N);
    print_message("depth at %.0f N: %.3f of the thickness\n", def.force_cap_N, depth_m / def.thickness_m);
    assert_true(depth_m > TOUCH_CLOSE * def.thickness_m && depth_m < 0.95 * def.thickness_m);
}

static void slope_is_the_derivative_of_depth(void **unused) {
    (void)unused;
    const tm_touching_def def = tm_touching_def_default();
    const double c = def.compliance_m_N, soft = soft_m(&def), expected[FORCES] = {1, 1, 20, 20, 20, 400, 400, 400};
    for (int i = 0; i < FORCES; i++) {
        const double f = FORCE_N[i], step = 1e-4;
        const double slope = (touch_law_depth(c, soft, f + step) - touch_law_depth(c, soft, f - step)) / (2 * step);
        assert_true(fabs(slope * expected[i] / c - 1) < 1e-6);
        assert_true(fabs(touch_law_slope(c, soft, f) / slope - 1) < 1e-6);
    }
}

/* With any diagonal; and a cap below the solution is the result. */
static void reaction_is_the_inverse_of_depth(void **unused) {
    (void)unused;
    const tm_touching_def def = tm_touching_def_default();
    const double c = def.compliance_m_N, soft = soft_m(&def), diagonal[] = {0, 1e-7, 1e-5, 1e-3};
    for (int i = 0; i < FORCES; i++)
        for (int k = 0; k < 4; k++) {
            const double gap_m = -touch_law_depth(c, soft, FORCE_N[i]) - diagonal[k] * FORCE_N[i];
            assert_true(fabs(touch_law_reaction(c, soft, gap_m, diagonal[k], 1000) / FORCE_N[i] - 1) < 1e-9);
            assert_true(touch_law_reaction(c, soft, gap_m, diagonal[k], 0.5 * FORCE_N[i]) == 0.5 * FORCE_N[i]);
        }
    assert_true(touch_law_reaction(c, soft, 1e-6, 1e-5, 50) == 0);
}

/* The energy is the integral of the force over the depth. */
static void energy_is_the_work_of_pressing(void **unused) {
    (void)unused;
    enum { STEPS = 100000 };
    const tm_touching_def def = tm_touching_def_default();
    const double c = def.compliance_m_N, soft = soft_m(&def);
    double work_J = 0, most = 0;
    for (int k = 1; k <= STEPS; k++) {
        const double from = 50.0 * (k - 1) / STEPS, to = 50.0 * k / STEPS;
        work_J += 0.5 * (from + to) * (touch_law_depth(c, soft, to) - touch_law_depth(c, soft, from));
        if (k % 1000 == 0) most = fmax(most, fabs(touch_law_energy(c, soft, to) / work_J - 1));
    }
    assert_true(most < 1e-5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_do_not_meet_at_the_cap), cmocka_unit_test(slope_is_the_derivative_of_depth),
        cmocka_unit_test(reaction_is_the_inverse_of_depth), cmocka_unit_test(energy_is_the_work_of_pressing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
