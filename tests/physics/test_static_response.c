/* Derivatives of an equilibrium (tm_world_static_force, tm_world_static_response): residual and tangent of pressed
 * blocks against equilibria under small loads; and what has none. */
#include "../fixture.h"

#include <string.h>

enum { CELLS = 3 };
static const double SIDE_M = 0.02;

typedef struct block {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n;
} block;

static bool is_end(const block *b, int32_t vertex) {
    const double z = b->mesh->rest_m[3 * vertex + 2];
    return z < 1e-9 || z > SIDE_M - 1e-9;
}

/* A block between plates of which the upper one is lowered by `press` of its height. */
static block make(double press, const double *load_N, bool viscous) {
    block b = {0};
    tm_material m;
    tm_error error;
    fix_random random = {3};
    b.mesh = fix_block((int[]){CELLS, CELLS, CELLS}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.1, &random);
    b.n = 3 * b.mesh->vertex_count;
    fix_ok(tm_material_young(5e3, 0.3, &m, &error), &error);
    fix_ok(tm_material_set_law(&m, TM_LAW_NEO_HOOKE, NULL, 0, &error), &error);
    b.tissue = fix_tissue(b.mesh, &m, NULL, TM_DOUBLE, false);
    b.world = fix_world(b.tissue, false);
    int32_t *dof = malloc(sizeof *dof * (size_t)b.n);
    double *value = calloc((size_t)b.n, sizeof *value);
    tm_support_def def = tm_support_def_default();
    for (int32_t i = 0; i < b.n; i++)
        if (is_end(&b, i / 3)) {
            value[def.count] = i % 3 == 2 && b.mesh->rest_m[i] > 1e-9 ? -press * SIDE_M : 0;
            dof[def.count++] = i;
        }
    def.dof = dof, def.value_m = value;
    fix_ok(tm_stage_support(b.world, &def, &error), &error);
    if (load_N) fix_ok(tm_stage_load(b.world, load_N, &error), &error);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 1;
    viscosity.term[0] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.3};
    if (viscous) fix_ok(tm_stage_viscosity(b.world, &viscosity, &error), &error);
    free(dof);
    free(value);
    return b;
}

static void destroy(block *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
}

static const double *settle(const block *b) {
    tm_settle_def def = tm_settle_def_default();
    tm_error error;
    def.tolerance = 1e-11;
    fix_ok(tm_world_settle(b->world, &def, NULL, &error), &error);
    return tm_world_state(b->world)->u_m;
}

/* A load on the vertices between the plates. */
static double *some_load(const block *b, double size_N) {
    double *load = calloc((size_t)b->n, sizeof *load);
    fix_random random = {7};
    for (int32_t i = 0; i < b->n; i++) load[i] = is_end(b, i / 3) ? 0 : size_N * fix_signed(&random);
    return load;
}

/* x of K x = b is the derivative of the equilibrium with respect to a load along b. */
static void check_response(bool viscous) {
    tm_error error;
    block b = make(0.3, NULL, viscous);
    double *load = some_load(&b, 1e-5), *force = malloc(sizeof *force * (size_t)b.n);
    double *x = calloc((size_t)b.n, sizeof *x), *moved[2], least = 1e-9;
    settle(&b);
    const uint64_t before = tm_world_hash(b.world);
    fix_ok(tm_world_static_force(b.world, tm_world_state(b.world)->u_m, force, &error), &error);
    double most = fix_largest(force, b.n), loose = 0;
    for (int32_t i = 0; i < b.n; i++)
        if (!is_end(&b, i / 3)) loose = fmax(loose, fabs(force[i]));
    assert_true(most > 1e-3 && loose < 1e-9 * most);
    fix_ok(tm_world_static_response(b.world, load, 1e-10, x, &error), &error);
    assert_true(tm_world_hash(b.world) == before);
    for (int side = 0; side < 2; side++) {
        for (int32_t i = 0; i < b.n; i++) load[i] = side ? -load[i] : load[i];
        block with = make(0.3, load, viscous);
        moved[side] = malloc(sizeof(double) * (size_t)b.n);
        memcpy(moved[side], settle(&with), sizeof(double) * (size_t)b.n);
        destroy(&with);
    }
    const double size = fix_largest(x, b.n);
    for (int32_t i = 0; i < b.n; i++) least = fmax(least, fabs((moved[0][i] - moved[1][i]) / 2 - x[i]) / size);
    assert_true(size > 1e-8 && least < 1e-5);
    free(moved[0]), free(moved[1]), free(x), free(force), free(load);
    destroy(&b);
}

static void a_response_is_the_derivative_of_equilibria(void **unused) {
    (void)unused;
    check_response(false);
}

static void a_response_is_that_of_the_long_term_law(void **unused) {
    (void)unused;
    check_response(true);
}

/* Twisted inside out by displacements that are no equilibrium: the tangent has negative curvature. */
static void a_tangent_that_is_not_positive_is_refused(void **unused) {
    (void)unused;
    tm_error error;
    block b = make(0, NULL, false);
    double *load = some_load(&b, 1), *x = calloc((size_t)b.n, sizeof *x), *u = tm_world_state(b.world)->u_m;
    for (int32_t i = 2; i < b.n; i += 3) u[i] = -1.6 * b.mesh->rest_m[i];
    assert_int_equal(tm_world_static_response(b.world, load, 1e-10, x, &error), TM_ERR_CONVERGENCE);
    assert_non_null(strstr(error.message, "not positive"));
    free(load), free(x);
    destroy(&b);
}

static void pressures_are_refused(void **unused) {
    (void)unused;
    tm_error error;
    block b = make(0.1, NULL, false);
    double *pressure = calloc((size_t)b.mesh->surface_count, sizeof *pressure);
    double *x = calloc((size_t)b.n, sizeof *x);
    pressure[0] = 10;
    fix_ok(tm_stage_pressure(b.world, pressure, &error), &error);
    assert_int_equal(tm_world_static_force(b.world, x, x, &error), TM_ERR_EXCLUDED);
    assert_int_equal(tm_world_static_response(b.world, NULL, 1e-10, x, &error), TM_ERR_EXCLUDED);
    assert_non_null(strstr(error.message, "use differences"));
    free(pressure), free(x);
    destroy(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_response_is_the_derivative_of_equilibria),
        cmocka_unit_test(a_response_is_that_of_the_long_term_law),
        cmocka_unit_test(a_tangent_that_is_not_positive_is_refused),
        cmocka_unit_test(pressures_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
