/* The measure of true overlap (overlap.h) on planted overlaps of known depth, and on tissue that does not overlap. */
#include "overlap.h"
#include "touch_blocks.h"

static overlap measure(const bodies *b) {
    return measure_overlap(b->tissue, tm_world_state(b->world)->u_m, b->tet_body, b->count, NULL);
}

/* Moves what is above a height at rest down. */
static void sink(bodies *b, double above_m, double by_m) {
    for (int32_t v = 0; v < b->mesh->vertex_count; v++)
        if (b->mesh->rest_m[3 * v + 2] > above_m) tm_world_state(b->world)->u_m[3 * v + 2] -= by_m;
}

static bool is_near(double a, double b) { return fabs(a - b) < 1e-6 * fabs(b); }

static void a_block_pressed_into_another_is_as_deep_as_it_is_pressed(void **state) {
    (void)state;
    static const part p[] = {{{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0},
                             {{3, 3, 2}, {0.03, 0.03, 0.02}, {0.0132, 0.0071, 0.0206}, 0.3}};
    const double depth_m[] = {1e-6, 1e-4, 4e-3};
    setup s = plain();
    bodies b = make(p, 2, &s);
    assert_true(measure(&b).deepest_m == 0 && measure(&b).crossings == 0);
    double sunk_m = 0.6e-3;
    sink(&b, 0.02001, sunk_m);
    for (int i = 0; i < 3; i++) {
        sink(&b, 0.02001, depth_m[i] - (i ? depth_m[i - 1] : 0));
        const overlap o = measure(&b);
        printf("pressed in by %.4g mm: %.4g mm, %d vertices, %d crossings\n", 1e3 * depth_m[i], 1e3 * o.deepest_m,
               o.vertices, o.crossings);
        assert_true(is_near(o.deepest_m, depth_m[i]) && o.vertices >= 16);
    }
    static const uint8_t only_themselves[] = {1, 0, 0, 1};
    const double *u = tm_world_state(b.world)->u_m;
    assert_true(measure_overlap(b.tissue, u, b.tet_body, 2, only_themselves).deepest_m == 0);
    drop(&b);
}

/* One body of two parts: fold and fold of the same body. */
static void parts_of_one_body_that_overlap_are_found(void **state) {
    (void)state;
    static const part p[] = {{{4, 4, 2}, {0.04, 0.04, 0.02}, {0, 0, 0}, 0},
                             {{3, 3, 2}, {0.03, 0.03, 0.02}, {0.0042, 0.0031, 0.021}, 0.1}};
    setup s = plain();
    bodies b = make(p, 2, &s);
    memset(b.tet_body, 0, sizeof *b.tet_body * (size_t)b.mesh->tet_count);
    assert_true(measure(&b).deepest_m == 0);
    sink(&b, 0.0201, 1.3e-3);
    assert_true(is_near(measure(&b).deepest_m, 0.3e-3));
    drop(&b);
}

/* Two bars whose ridges cross: no vertex of one is inside the other. */
static void ridges_that_cross_are_found_without_a_vertex_inside(void **state) {
    (void)state;
    static const part p[] = {{{1, 1, 1}, {0.04, 0.01, 0.01}, {-0.02, -0.005, -0.005}, 0},
                             {{1, 1, 1}, {0.01, 0.04, 0.01}, {-0.005, -0.02, -0.005}, 0}};
    const double depth_m[] = {-1e-4, 1e-4, 1e-3}, half_m = 0.01 / sqrt(2);
    for (int i = 0; i < 3; i++) {
        setup s = plain();
        bodies b = make(p, 2, &s);
        double *u = tm_world_state(b.world)->u_m;
        for (int32_t v = 0; v < b.mesh->vertex_count; v++) { /* turned by 45 degrees about its length */
            const bool upper = v >= b.body_begin[1];
            const double *x = b.mesh->rest_m + 3 * v, y = x[!upper], z = x[2];
            u[3 * v + !upper] = (y - z) / sqrt(2) - y;
            u[3 * v + 2] = (y + z) / sqrt(2) - z + (upper ? 2 * half_m - depth_m[i] : 0);
        }
        const overlap o = measure(&b);
        printf("ridges %.2g mm deep: %.4g mm, %d vertices, %d crossings\n", 1e3 * depth_m[i], 1e3 * o.deepest_m,
               o.vertices, o.crossings);
        assert_int_equal(o.vertices, 0);
        assert_int_equal(o.crossings, depth_m[i] > 0 ? 2 : 0);
        if (depth_m[i] > 0) assert_true(fabs(o.deepest_m - depth_m[i] / sqrt(2)) < 1e-6 * depth_m[i]);
        drop(&b);
    }
}

/* Lips of a cut: a layer of cells is removed, and the upper lip sinks through the gap. */
static void lips_that_overlap_are_found(void **state) {
    (void)state;
    static const part p = {{6, 3, 5}, {0.03, 0.015, 0.025}, {0, 0, 0}, 0};
    setup s = plain();
    s.cuttable = true;
    bodies b = make(&p, 1, &s);
    int32_t *gone = malloc(sizeof *gone * (size_t)b.mesh->tet_count), count = 0;
    for (int32_t t = 0; t < b.mesh->tet_count; t++) {
        double x = 0, z = 0;
        for (int j = 0; j < 4; j++) x += b.mesh->rest_m[3 * b.mesh->tet[4 * t + j]] / 4;
        for (int j = 0; j < 4; j++) z += b.mesh->rest_m[3 * b.mesh->tet[4 * t + j] + 2] / 4;
        if (x > 0.01 && z > 0.01 && z < 0.015) gone[count++] = t;
    }
    tm_cut_remove(b.tissue, gone, count, NULL, 0);
    free(gone);
    double *u = tm_world_state(b.world)->u_m;
    assert_true(measure(&b).deepest_m == 0 && measure(&b).crossings == 0);
    for (int32_t v = 0; v < b.mesh->vertex_count; v++) /* turned about where it is joined */
        if (b.mesh->rest_m[3 * v + 2] > 0.0149 && b.mesh->rest_m[3 * v] > 0.011)
            u[3 * v] = -1e-3, u[3 * v + 2] = -0.0052 * (b.mesh->rest_m[3 * v] - 0.01) / 0.02;
    const overlap o = measure(&b);
    printf("lips: %.4g mm, %d vertices, %d crossings\n", 1e3 * o.deepest_m, o.vertices, o.crossings);
    assert_true(fabs(o.deepest_m - 0.2e-3) < 1e-6 && o.vertices >= 2);
    drop(&b);
}

/* A vertex that is pushed past its neighbours inverts tetrahedra. That is no overlap. */
static void tissue_that_is_crushed_does_not_overlap(void **state) {
    (void)state;
    static const part p = {{4, 4, 2}, {0.04, 0.04, 0.02}, {0, 0, 0}, 0};
    fix_random random = {7};
    setup s = plain();
    bodies b = make(&p, 1, &s);
    double *u = tm_world_state(b.world)->u_m;
    for (int i = 0; i < 200; i++) {
        const int32_t v = (int32_t)(fix_uniform(&random) * b.mesh->vertex_count);
        const double *x = b.mesh->rest_m + 3 * v;
        memset(u, 0, sizeof *u * 3 * (size_t)b.mesh->vertex_count);
        for (int c = 0; c < 2; c++) u[3 * v + c] = 0.4 * (0.02 - x[c]); /* inward */
        u[3 * v + 2] = 1.4 * (0.01 - x[2]);
        const overlap o = measure(&b);
        if (o.deepest_m > 0)
            fail_msg("vertex %d: %.3g mm, %d vertices, %d crossings", v, 1e3 * o.deepest_m, o.vertices, o.crossings);
    }
    drop(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_block_pressed_into_another_is_as_deep_as_it_is_pressed),
        cmocka_unit_test(parts_of_one_body_that_overlap_are_found),
        cmocka_unit_test(ridges_that_cross_are_found_without_a_vertex_inside),
        cmocka_unit_test(lips_that_overlap_are_found),
        cmocka_unit_test(tissue_that_is_crushed_does_not_overlap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
