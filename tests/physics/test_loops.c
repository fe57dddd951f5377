/* Closed loops: corotational tissue returns the energy it received. The force is the gradient of one energy,
 * single-valued in F: fibres 1:1 to 10:1, from small strains to inverted tetrahedra and back, with and without nodal
 * dilatation. The undeformed shape is the only equilibrium: tissue moved far out returns. */
#include "../long.h"
#include "turning.h"

enum { WAVES = 3 };
static const double NET = 1e-6; /* remaining work of a loop, relative to the sum of its absolute contributions */

/* Fibres `ratio` times as stiff as the directions across; 1: isotropic with Poisson's ratio `poisson`. */
static tm_material law(double ratio, double poisson) {
    tm_material m;
    tm_error error;
    if (ratio == 1)
        fix_ok(tm_material_young(5e3, poisson, &m, &error), &error);
    else
        fix_ok(tm_material_engineering(ratio * 5e3, 5e3, poisson, 0.45, 2e3, &m, &error), &error);
    return m;
}

typedef struct piece {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_rotation *rotation;
    int32_t n;
} piece;

static piece make(tm_mesh *mesh, const tm_material *m, bool volume, double damping, fix_random *random) {
    piece p = {.mesh = mesh, .n = 3 * mesh->vertex_count};
    tm_material own = *m;
    tm_error error;
    tm_tissue_def def = tm_tissue_def_default();
    double *fibre = malloc(sizeof(double) * 3 * (size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double *a = fibre + 3 * t, size = 0;
        for (int i = 0; i < 3; i++) a[i] = fix_signed(random), size += a[i] * a[i];
        for (int i = 0; i < 3; i++) a[i] /= sqrt(size);
    }
    own.damping_1_s = damping;
    def.mesh = mesh, def.material_count = 1, def.material = &own;
    def.fibre = tm_material_is_isotropic(m) ? NULL : fibre;
    def.rotation = TM_ROTATION_THRESHOLD;
    if (volume) def.strain_smoothing = true, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &p.tissue, &error), &error);
    free(fibre);
    p.world = fix_world(p.tissue, damping > 0);
    fix_ok(tm_stage_rotation(p.world, &p.rotation, &error), &error);
    return p;
}

static void destroy(piece *p) {
    tm_world_destroy(p->world);
    tm_tissue_destroy(p->tissue);
    tm_mesh_destroy(p->mesh);
}

static double normal(fix_random *random) {
    double sum = 0;
    for (int i = 0; i < 12; i++) sum += fix_uniform(random);
    return sum - 6;
}

/* Runs one loop of n numbers, u = c + sum of waves; returns its work, and the sum of absolute contributions. */
static double go_round(const piece *p, double *wave, int points, double *sizes) {
    const int32_t n = p->n;
    double *u = calloc((size_t)n * 4, sizeof(double)), *f = u + n, *s = u + 2 * n, *way = u + 3 * n, net = 0;
    *sizes = 0;
    for (int k = 0; k < points; k++) {
        const double t = 2 * M_PI * k / points;
        memcpy(u, wave, sizeof(double) * (size_t)n);
        memset(way, 0, sizeof(double) * (size_t)n);
        for (int w = 0; w < WAVES; w++) {
            const double *a = wave + (1 + 2 * w) * n, *b = a + n, c = cos((w + 1) * t), q = sin((w + 1) * t);
            for (int32_t i = 0; i < n; i++) u[i] += c * a[i] + q * b[i], way[i] += (w + 1) * (c * b[i] - q * a[i]);
        }
        turning_force(p->tissue, p->rotation, u, f, s);
        double power = 0;
        for (int32_t i = 0; i < n; i++) power += f[i] * way[i];
        net += power, *sizes += fabs(power);
    }
    free(u);
    return net;
}

static void loops(const piece *p, double size_m, int count, int points, fix_random *random) {
    double *wave = calloc((size_t)p->n * (1 + 2 * WAVES), sizeof(double)), worst = 0;
    for (int loop = 0; loop < count; loop++) {
        double sizes;
        for (int32_t i = 0; i < p->n * (1 + 2 * WAVES); i++) wave[i] = size_m * normal(random) / (i < p->n ? 1 : 2);
        worst = fmax(worst, fabs(go_round(p, wave, points, &sizes)) / sizes);
    }
    if (worst >= NET) printf("  a loop of %.3g m left %.2e of its work\n", size_m, worst);
    assert_true(worst < NET);
    free(wave);
}

static const double RATIO[] = {1, 1, 2, 5, 10}, POISSON[] = {0.3, 0.45, 0.4, 0.4, 0.4};

static void test_one_tetrahedron_returns_the_energy_of_a_loop(void **state) {
    (void)state;
    static const double corner[12] = {0, 0, 0, 0.01, 0, 0, 0.002, 0.009, 0, 0.003, 0.002, 0.011};
    for (int volume = 0; volume < 2; volume++)
        for (int k = 0; k < 5; k++) {
            fix_random random = {31 + k};
            tm_mesh *mesh = NULL;
            tm_error error;
            const tm_material m = law(RATIO[k], POISSON[k]);
            fix_ok(fix_one_tet(corner, &mesh, &error), &error);
            piece p = make(mesh, &m, volume, 0, &random);
            static const double size_m[] = {5e-4, 3e-3, 1e-2, 3e-2};
            for (int s = 0; s < 4; s++) loops(&p, size_m[s], test_is_long() ? 200 : 4, 1 << 13, &random);
            destroy(&p);
        }
}

/* A small mesh with tetrahedra that are inverted on the way; a path in many more dimensions. */
static void test_meshes_return_the_energy_of_a_loop(void **state) {
    (void)state;
    for (int volume = 0; volume < 2; volume++) {
        fix_random random = {5};
        const tm_material m = law(7, 0.4);
        piece p = make(fix_block((int[]){2, 2, 2}, (double[]){0.02, 0.02, 0.02}, 0.3, &random), &m, volume, 0, &random);
        loops(&p, 4e-3, test_is_long() ? 40 : 2, 1 << 12, &random);
        destroy(&p);
    }
}

/* Fibres ten times as stiff, of random directions, in flat tetrahedra; every vertex displaced at random by up to
 * twice their height. */
static void test_fibred_tissue_returns_to_its_shape(void **state) {
    (void)state;
    for (int volume = 0; volume < 2; volume++)
        for (int round = 0; round < (test_is_long() ? 3 : 1); round++) {
            fix_random random = {77 + round};
            const tm_material m = law(10, 0.4);
            tm_mesh *mesh = fix_block((int[]){3, 3, 3}, (double[]){0.03, 0.03, 0.01}, 0.45, &random);
            piece p = make(mesh, &m, volume, 20, &random);
            tm_state *s = tm_world_state(p.world);
            for (int32_t i = 0; i < p.n; i++) s->u_m[i] = s->u_prev_m[i] = 8e-3 * fix_signed(&random);
            const double start = turning_energy(p.tissue, p.rotation, s->u_m);
            assert_int_equal(tm_world_step(p.world, (int32_t)(0.8 / s->dt_s)), TM_OK);
            const double left = turning_energy(p.tissue, p.rotation, s->u_m);
            if (!(left < 1e-6 * start)) printf("  round %d: left %.2g of %.2g J\n", round, left, start);
            assert_true(left < 1e-6 * start);
            destroy(&p);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_tetrahedron_returns_the_energy_of_a_loop),
        cmocka_unit_test(test_meshes_return_the_energy_of_a_loop),
        cmocka_unit_test(test_fibred_tissue_returns_to_its_shape),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
