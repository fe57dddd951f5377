/* Every row of nonlinear laws beyond its limit of stretch, and inverted: energy and force have no jump at the limit,
 * the flag says who is beyond, the force grows linearly, and inverted tetrahedra return to rest, with strain
 * smoothing and viscosity too. */
#include "law_body.h"
#include "material/hyperelastic.h"
#include "material/law.h"
#include "tensormass/viscosity.h"

/* --- one tetrahedron, whose shape gradients are the unit vectors --- */

typedef struct one {
    tm_material material;
    tm_mesh *mesh;
    tm_pool pool;
    tm_hyperelastic hyper;
} one;

static void make_one(one *o, tm_law_kind law, bool fibred) {
    static const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const uint8_t alive = 1;
    static const int32_t own = 0;
    tm_error error;
    *o = (one){.material = material_of(law, 0.4, fibred)};
    fix_ok(fix_one_tet(corner, &o->mesh, &error), &error);
    const tm_material_field field = {.mesh = o->mesh,
                                     .alive = &alive,
                                     .material = &o->material,
                                     .region_material = &own,
                                     .material_count = 1,
                                     .fibre = FIBRE};
    assert_true(tm_hyperelastic_take(&o->hyper, &o->pool, &field));
}

static void destroy_one(one *o) {
    tm_pool_release(&o->pool);
    tm_mesh_destroy(o->mesh);
}

/* P [9] and the energy density at F = t N; returns whether the tetrahedron is flagged, alike in all forms. */
static bool stress(const one *o, double t, const double N[9], double P_Pa[9], double *energy_Pa) {
    double u[12] = {0}, corner[12 * TM_LANES];
    int32_t beyond = -1;
    for (int k = 1; k < 4; k++)
        for (int i = 0; i < 3; i++) u[3 * k + i] = t * N[3 * i + k - 1] - (i == k - 1);
    for (int form = 2; form >= 0; form--) {
        const tm_hyper_force pass = tm_hyper_force_form(form);
        if (!pass) continue;
        const int32_t count = pass(&o->hyper, 0, 1, u, corner);
        assert_true(beyond < 0 || count == beyond);
        beyond = count;
    }
    const double volume = o->mesh->volume_m3[0];
    for (int k = 1; k < 4; k++)
        for (int i = 0; i < 3; i++) P_Pa[3 * i + k - 1] = corner[TM_LANES * (3 * k + i)] / volume;
    *energy_Pa = tm_hyperelastic_tet_energy(&o->hyper, 0, u) / volume;
    return beyond == 1;
}

static double dot9(const double A[9], const double B[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += A[i] * B[i];
    return sum;
}

/* Along one direction of F: across the limit, and far beyond. */
static void crosses_its_limit(const one *o, const double N[9]) {
    const double s = o->material.stretch_max, limit = sqrt(s * s + 2 / s),
                 bound = tm_law_stiffest_Pa(&o->material, false);
    const double h = 1e-6 * limit;
    double below[9], above[9], there[9], J[2], at, change = 0;
    stress(o, limit - h, N, below, &J[0]);
    assert_true(stress(o, limit + h, N, above, &J[1]));
    stress(o, limit, N, there, &at);
    for (int i = 0; i < 9; i++) change = fmax(change, fabs(above[i] - below[i]));
    const double force = sqrt(dot9(there, there));
    assert_true(change <= 20 * bound * 2 * h); /* also where it softens beyond the limit */
    assert_true(fabs(J[1] - J[0] - dot9(there, N) * 2 * h) < 1e-4 * (force + bound * 1e-2) * 2 * h);
    double before = 0;
    for (double t = 2 * limit; t < 3000 * limit; t *= 10) {
        assert_true(stress(o, t, N, above, &at));
        const double size = sqrt(dot9(above, above)), spring = 4.0 / 3 * o->material.mu_Pa * (t - limit);
        assert_true(size < force + 2 * bound * (t - limit) && size > before && at > 0);
        if (t > 1000 * limit) assert_true(fabs(size - spring) < 0.02 * spring); /* the spring alone */
        before = size;
    }
}

static void no_jump_at_the_limit(void **state) {
    (void)state;
    fix_random random = {5};
    for (const tm_law *const *law = tm_laws; *law; law++)
        for (int fibred = 0;
             law_is_tested((*law)->kind) && fibred <= tm_law_has_fibres((*law)->kind) && (*law)->kind != TM_LAW_LINEAR;
             fibred++) {
            one o;
            double P[9], J;
            make_one(&o, (*law)->kind, fibred);
            static const double rest[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
            assert_false(stress(&o, 1, rest, P, &J));
            for (int k = 0; k < 200; k++) {
                double N[9], length;
                for (int i = 0; i < 9; i++) N[i] = (k % 2 && i % 4 ? 0.1 : 1) * fix_signed(&random);
                length = sqrt(dot9(N, N));
                for (int i = 0; i < 9; i++) N[i] /= length;
                crosses_its_limit(&o, N);
            }
            destroy_one(&o);
        }
}

/* --- inverted tetrahedra --- */

/* What is beside the law. */
enum { PLAIN, SMOOTHED, VISCOUS, BOTH, EFFECTS };

static double returns(tm_mesh *mesh, tm_law_kind law, bool fibred, int effect, double size_m, int inverted_min) {
    fix_random random = {3};
    tm_error error;
    tm_material m = material_of(law, 0.4, fibred);
    m.damping_1_s = 60;
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.material_count = 1, tissue.material = &m;
    tissue.strain_smoothing = effect == SMOOTHED || effect == BOTH, tissue.smoothed_shear_share = 0;
    body b = make(mesh, tissue, 1, true);
    tm_state *s = tm_world_state(b.world);
    for (int32_t i = 0; i < b.n; i++)
        if (is_at(&b, i / 3 * 3 + 2, 0)) hold(&b, i, 0);
    support(&b);
    tm_viscosity_def def = tm_viscosity_def_default();
    def.count = 1, def.term[0] = (tm_viscosity_term){.time_s = 0.02, .shear = 0.4, .bulk = 0.3};
    if (effect >= VISCOUS) fix_ok(tm_stage_viscosity(b.world, &def, &error), &error);
    for (int32_t i = 0; i < b.n; i++) {
        if (is_at(&b, i / 3 * 3 + 2, 0)) continue;
        s->u_m[i] =
            b.n == 12 ? (i % 3 == 2 ? -1.6 : 0.2) * b.mesh->rest_m[i / 3 * 3 + 2] : size_m * fix_signed(&random);
        s->u_prev_m[i] = s->u_m[i];
    }
    assert_true(tm_tissue_deformation(b.tissue, s->u_m).inverted >= inverted_min);
    int32_t parts = 0;
    do fix_ok(tm_world_step(b.world, (int32_t)(0.1 / s->dt_s)), &error);
    while (++parts < 40 && fix_largest(s->u_m, b.n) > 1e-4 * SIDE_M);
    const double left = fix_largest(s->u_m, b.n) / SIDE_M;
    if (left > 1e-3 || effect == BOTH)
        print_message("%s%s, effects %d, %d tetrahedra: %.1e of the side after %.1f s\n", tm_law_name(law),
                      fibred ? ", fibred" : "", effect, b.mesh->tet_count, left, 0.1 * parts);
    destroy(&b);
    return left;
}

static void inverted_tetrahedra_come_back(void **state) {
    (void)state;
    int failed = 0;
    for (const tm_law *const *law = tm_laws; *law; law++)
        for (int fibred = 0;
             law_is_tested((*law)->kind) && fibred <= tm_law_has_fibres((*law)->kind) && (*law)->kind != TM_LAW_LINEAR;
             fibred++)
            for (int effect = 0; effect < EFFECTS; effect++) {
                fix_random random = {11};
                tm_error error;
                tm_mesh *single;
                static const double corner[12] = {0, 0, 0, 0.02, 0, 0, 0, 0.02, 0, 0.004, 0.005, 0.02};
                fix_ok(fix_one_tet(corner, &single, &error), &error);
                failed += returns(single, (*law)->kind, fibred, effect, 0, 1) > 1e-3;
                tm_mesh *block = fix_block((int[]){2, 2, 2}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.2, &random);
                failed += returns(block, (*law)->kind, fibred, effect, 0.4 * SIDE_M, 5) > 1e-3;
            }
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(no_jump_at_the_limit),
                                       cmocka_unit_test(inverted_tetrahedra_come_back)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
