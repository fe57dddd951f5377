/* Undamped corotational tissue conserves energy at the guaranteed step: for every law, fast or only rotating, with
 * good tetrahedra and slivers. With damping, slivers come to rest. */
#include "../long.h"
#include "turning.h"

#include "tensormass/energy.h"

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_rotation *rotation;
    int32_t n;
} body;

typedef struct hot {
    const char *name;
    double ratio, poisson; /* of fibres; 1: isotropic */
    bool volume, slivers, single;
    double noise; /* initial displacement, of an edge of 10 mm, or of a sliver's height */
    double rate;  /* angular velocity, rad/s */
    double share; /* of the guaranteed step */
    double most;  /* tolerance of the mean energy of a thousand steps, */
    double swing; /* and of a single step */
} hot;

static body make(const hot *h, double damping) {
    fix_random random = {7};
    tm_material m;
    tm_error error;
    body b = {0};
    if (h->ratio > 1)
        fix_ok(tm_material_engineering(h->ratio * 5e3, 5e3, 0.4, 0.45, 2e3, &m, &error), &error);
    else
        fix_ok(tm_material_young(5e3, h->poisson, &m, &error), &error);
    m.damping_1_s = damping;
    b.mesh =
        fix_block((int[]){3, 3, 3}, (double[]){0.03, 0.03, h->slivers ? 0.002 : 0.03}, h->slivers ? 0.4 : 0.2, &random);
    b.n = 3 * b.mesh->vertex_count;
    double *fibre = fix_fibres(b.mesh, (double[]){1, 0.3, -0.2});
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b.mesh, def.material_count = 1, def.material = &m, def.fibre = h->ratio > 1 ? fibre : NULL;
    def.rotation = TM_ROTATION_THRESHOLD;
    if (h->single) def.precision = TM_SINGLE;
    if (h->volume) def.strain_smoothing = true, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    free(fibre);
    tm_world_def of = tm_world_def_default();
    of.tissue = b.tissue, of.damped = damping > 0;
    of.dt_s = h->share * tm_critical_step_guaranteed(b.tissue, NULL);
    fix_ok(tm_world_create(&of, &b.world, &error), &error);
    fix_ok(tm_stage_rotation(b.world, &b.rotation, &error), &error);
    tm_state *s = tm_world_state(b.world);
    const double a = h->rate * s->dt_s, size_m = h->noise * (h->slivers ? 0.002 / 3 : 0.01);
    for (int32_t v = 0; v < b.mesh->vertex_count; v++) {
        const double x = b.mesh->rest_m[3 * v] - 0.015, y = b.mesh->rest_m[3 * v + 1] - 0.015;
        s->u_prev_m[3 * v] = x * (cos(a) - 1) + y * sin(a);
        s->u_prev_m[3 * v + 1] = -x * sin(a) + y * (cos(a) - 1);
        for (int i = 3 * v; i < 3 * v + 3; i++) {
            const double noise = size_m * fix_signed(&random);
            s->u_m[i] += noise, s->u_prev_m[i] += noise;
        }
    }
    return b;
}

static void destroy(body *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
}

/* Returns the error of the energy account in the worst mean of a thousand steps. In single steps it oscillates more,
 * as corrections follow in the next steps: by tenths for slivers, which invert and return within a step. */
static double drift(const hot *h, int32_t steps) {
    enum { WINDOW = 1000 };
    body b = make(h, 0);
    tm_error error;
    tm_energy e;
    double worst = 0, swing = 0, sum = 0;
    fix_ok(tm_stage_energy(b.world, &error), &error);
    for (int32_t n = 1; n <= steps; n++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        fix_ok(tm_world_energy(b.world, &e, &error), &error);
        const double off = (e.kinetic_J + e.elastic_J) / e.start_J - 1;
        swing = fmax(swing, fabs(off));
        sum += off / WINDOW;
        if (n % WINDOW) continue;
        worst = fmax(worst, fabs(sum));
        sum = 0;
    }
    print_message("%-28s energy within %.1e over %d steps, in any step within %.1e\n", h->name, worst, steps, swing);
    assert_true(swing < h->swing);
    destroy(&b);
    return worst;
}

static void test_undamped_energy_is_conserved(void **state) {
    (void)state;
    static const hot all[] = {
        {"warm", 1, 0.45, false, false, false, 0.05, 0, 1, 3e-4, 0.01},
        {"hot", 1, 0.45, false, false, false, 0.2, 0, 1, 3e-4, 0.03},
        {"spun", 1, 0.3, false, false, false, 0.02, 20, 1, 3e-4, 0.01},
        {"fibred 2:1, hot", 2, 0, false, false, false, 0.2, 0, 1, 3e-4, 0.01},
        {"fibred 7:1, spun", 7, 0, false, false, false, 0.1, 20, 1, 3e-4, 0.01},
        {"volume, hot", 1, 0.49, true, false, false, 0.2, 0, 1, 3e-4, 0.01},
        {"slivers, spun", 1, 0.45, false, true, false, 0.03, 20, 1, 3e-3, 0.1},
        {"slivers, warm", 1, 0.45, false, true, false, 0.05, 0, 1, 0.01, 0.3},
        {"slivers, hot", 1, 0.45, false, true, false, 0.1, 0, 1, 3e-3, 0.1},
        {"slivers, hot, 0.9", 1, 0.45, false, true, false, 0.1, 0, 0.9, 3e-3, 0.1},
        {"slivers, fibred", 7, 0, false, true, false, 0.1, 0, 1, 3e-3, 0.1},
        {"single, hot", 1, 0.45, false, false, true, 0.2, 0, 1, 3e-4, 0.03},
        {"single, fibred 7:1, spun", 7, 0, false, false, true, 0.1, 20, 1, 3e-4, 0.01},
        {"single, slivers, hot", 1, 0.45, false, true, true, 0.1, 0, 1, 3e-3, 0.1},
        {"single, slivers, fibred", 7, 0, false, true, true, 0.1, 0, 1, 3e-3, 0.1},
    };
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        assert_true(drift(all + k, test_is_long() ? 100000 : test_is_sanitized() ? 1000 : 3000) < all[k].most);
}

/* Fibres ten times as stiff in flat tetrahedra: without the energy correction they oscillate indefinitely despite
 * damping of 20 1/s. */
static void test_slivers_come_to_rest(void **state) {
    (void)state;
    const hot h = {"slivers", 10, 0, false, true, false, 3, 0, 0.9, 0, 0};
    body b = make(&h, 20);
    tm_state *s = tm_world_state(b.world);
    const double start = turning_energy(b.tissue, b.rotation, s->u_m);
    assert_int_equal(tm_world_step(b.world, (int32_t)(0.8 / s->dt_s)), TM_OK);
    const double left = turning_energy(b.tissue, b.rotation, s->u_m) / start;
    print_message("slivers: %.1e of the energy left\n", left);
    assert_true(left < 1e-4);
    destroy(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_undamped_energy_is_conserved),
        cmocka_unit_test(test_slivers_come_to_rest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
