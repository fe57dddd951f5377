/* Surfaces with corners that are not finite, and points far away from a valid one. */
#include "../fixture.h"
#include "mesh/signed_distance.h"

/* Makes a tetrahedron of 1 m with this value as one of its coordinates. */
static double *corners(double odd, int at) {
    static const double place[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const int side[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    double *corner_m = malloc(36 * sizeof *corner_m);
    for (int t = 0; t < 4; t++)
        for (int c = 0; c < 3; c++) memcpy(corner_m + 9 * t + 3 * c, place[side[t][c]], sizeof *place);
    if (at >= 0) corner_m[at] = odd;
    return corner_m;
}

static void non_finite_corners_are_rejected(void **state) {
    (void)state;
    static const double odd[] = {NAN, INFINITY, -INFINITY, 1e300, -1e200};
    for (int i = 0; i < 5; i++)
        for (int closed = 0; closed < 2; closed++) {
            shell *s = NULL;
            tm_error error;
            assert_int_equal(shell_of_triangles(corners(odd[i], 20), 4, closed, &s, &error), TM_ERR_MESH);
            assert_non_null(strstr(error.message, "triangle 3 has a coordinate that is nan or infinite"));
        }
    shell *s = NULL;
    tm_error error;
    assert_int_equal(shell_of_triangles(malloc(8), 0, true, &s, &error), TM_ERR_MESH);
}

static void distance_of_far_points_is_correct(void **state) {
    (void)state;
    static const double way_m[] = {2, 1e6, 1e12, 1e30};
    shell *s = NULL;
    tm_error error;
    fix_ok(shell_of_triangles(corners(0, -1), 4, true, &s, &error), &error);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            for (int sign = -1; sign < 2; sign += 2) {
                double p[3] = {0, 0, 0};
                p[k] = sign * way_m[i];
                const double true_m = way_m[i] - (sign > 0 ? 1 : 0);
                assert_true(fabs(shell_distance_m(s, p) / true_m - 1) < 1e-12);
                assert_false(shell_contains(s, p));
            }
    shell_free(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(non_finite_corners_are_rejected),
        cmocka_unit_test(distance_of_far_points_is_correct),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
