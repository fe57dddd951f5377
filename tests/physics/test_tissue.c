/* Stiffness tensors: patch test, force against energy differences, symmetry, rigid motions, the elements' critical
 * steps. */
#include "../fixture.h"

static const double FIBRE[3] = {1, 2, -2};

/* Isotropic, the paper's law, five constants. */
static void three_materials(tm_material m[3]) {
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.45, m, &error), &error);
    fix_ok(tm_material_paper(1e4, 3e3, 1.2e4, 9e3, m + 1, &error), &error);
    fix_ok(tm_material_engineering(3e4, 6e3, 0.4, 0.45, 5e3, m + 2, &error), &error);
}

static tm_mesh *irregular(void) {
    fix_random random = {7};
    return fix_block((int[3]){4, 3, 3}, (double[3]){0.04, 0.03, 0.03}, 0.25, &random);
}

static bool on_boundary(const tm_mesh *mesh, int32_t v) {
    for (int32_t s = 0; s < 3 * mesh->surface_count; s++)
        if (mesh->surface[s] == v) return true;
    return false;
}

/* A linear displacement prescribed on the boundary is the solution inside. */
static void linear_displacements_are_solutions(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    tm_mesh *mesh = irregular();
    const int32_t n = 3 * mesh->vertex_count;
    const double H[9] = {1e-3, 2e-3, -1e-3, 5e-4, -2e-3, 3e-3, -7e-4, 4e-4, 1.5e-3};
    int32_t *dof = malloc(sizeof(int32_t) * (size_t)n), count = 0;
    double *value = malloc(sizeof(double) * (size_t)n), *exact = malloc(sizeof(double) * (size_t)n);
    for (int32_t i = 0; i < n; i++) {
        exact[i] = 1e-4;
        for (int j = 0; j < 3; j++) exact[i] += H[3 * (i % 3) + j] * mesh->rest_m[3 * (i / 3) + j];
        if (!on_boundary(mesh, i / 3)) continue;
        dof[count] = i, value[count++] = exact[i];
    }
    assert_true(count < n);
    for (int law = 0; law < 3; law++) {
        tm_tissue *tissue = fix_tissue(mesh, m + law, law ? FIBRE : NULL, TM_DOUBLE, false);
        tm_world *world = fix_world(tissue, true);
        tm_support_def def = tm_support_def_default();
        def.count = count, def.dof = dof, def.value_m = value;
        tm_error error;
        fix_ok(tm_stage_support(world, &def, &error), &error);
        double *force = malloc(sizeof(double) * (size_t)n);
        tm_tissue_force(tissue, exact, force);
        for (int32_t i = 0; i < n; i++)
            if (!on_boundary(mesh, i / 3)) assert_true(fabs(force[i]) < 1e-13 * fix_largest(force, n));
        free(force);
        tm_settle_def settle = tm_settle_def_default();
        settle.tolerance = 1e-13;
        fix_ok(tm_world_settle(world, &settle, NULL, &error), &error);
        const double *u = tm_world_state(world)->u_m;
        for (int32_t i = 0; i < n; i++) assert_true(fabs(u[i] - exact[i]) < 1e-12 * fix_largest(exact, n));
        tm_world_destroy(world);
        tm_tissue_destroy(tissue);
    }
    free(dof), free(value), free(exact);
    tm_mesh_destroy(mesh);
}

/* F = -dW/du: W is quadratic, so the central quotient is exact up to rounding, whatever the difference. */
static void force_is_the_gradient(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    tm_mesh *mesh = irregular();
    const int32_t n = 3 * mesh->vertex_count;
    double *u = malloc(sizeof(double) * (size_t)n), *force = malloc(sizeof(double) * (size_t)n);
    fix_random random = {11};
    for (int32_t i = 0; i < n; i++) u[i] = 1e-3 * fix_signed(&random);
    for (int law = 0; law < 3; law++)
        for (tm_precision p = TM_DOUBLE; p <= TM_SINGLE; p++) {
            tm_tissue *tissue = fix_tissue(mesh, m + law, law ? FIBRE : NULL, p, false);
            tm_tissue_force(tissue, u, force);
            double work = 0;
            for (int32_t i = 0; i < n; i++) {
                const double keep = u[i], h = 1e-3;
                u[i] = keep + h;
                const double up = tm_tissue_energy(tissue, u);
                u[i] = keep - h;
                const double down = tm_tissue_energy(tissue, u);
                u[i] = keep;
                assert_true(fabs(-(up - down) / (2 * h) - force[i]) < 1e-10 * fix_largest(force, n));
                work -= force[i] * u[i] / 2;
            }
            assert_true(fabs(tm_tissue_energy(tissue, u) / work - 1) < 1e-12);
            tm_tissue_destroy(tissue);
        }
    free(u), free(force);
    tm_mesh_destroy(mesh);
}

/* The energy of one tetrahedron by its definition: V w(E). */
static double element_energy(const tm_mesh *mesh, const tm_material *m, const double a[3], const double u[12]) {
    double E[9], C[36], w = 0;
    for (int i = 0; i < 9; i++) {
        E[i] = 0;
        for (int k = 0; k < 4; k++)
            E[i] += (u[3 * k + i / 3] * mesh->shape_1_m[3 * k + i % 3] +
                     u[3 * k + i % 3] * mesh->shape_1_m[3 * k + i / 3]) /
                    2;
    }
    const double e[6] = {E[0], E[4], E[8], 2 * E[5], 2 * E[2], 2 * E[1]};
    tm_material_voigt(m, a, C);
    for (int i = 0; i < 36; i++) w += e[i / 6] * C[i] * e[i % 6] / 2;
    return w * mesh->volume_m3[0];
}

static void stiffness_blocks_are_symmetric(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    fix_random random = {13};
    const double a[3] = {1 / 3.0, 2 / 3.0, -2 / 3.0};
    for (int trial = 0; trial < 60; trial++) {
        double p[12], u[12];
        tm_mesh *mesh = NULL;
        do {
            for (int i = 0; i < 12; i++) p[i] = 0.01 * fix_signed(&random), u[i] = 1e-3 * fix_signed(&random);
        } while (fix_one_tet(p, &mesh, NULL) != TM_OK);
        for (int law = 0; law < 3; law++) {
            double energy = 0, most = 0, K[9], T[9];
            for (int k = 0; k < 4; k++)
                for (int l = 0; l < 4; l++) {
                    const double *fibre = law ? a : NULL, *x = mesh->shape_1_m + 3 * k, *y = mesh->shape_1_m + 3 * l;
                    tm_stiffness_block(m + law, fibre, mesh->volume_m3[0], x, y, K);
                    tm_stiffness_block(m + law, fibre, mesh->volume_m3[0], y, x, T);
                    most = fmax(most, fix_largest(K, 9));
                    for (int i = 0; i < 9; i++) {
                        assert_true(fabs(K[i] - T[3 * (i % 3) + i / 3]) <= 1e-13 * most);
                        energy += u[3 * k + i / 3] * K[i] * u[3 * l + i % 3] / 2;
                    }
                }
            const double exact = element_energy(mesh, m + law, a, u);
            assert_true(fabs(energy - exact) < 1e-11 * (exact + most * 1e-6));
        }
        tm_mesh_destroy(mesh);
    }
}

static void rigid_motions_give_no_force(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    tm_mesh *mesh = irregular();
    const int32_t n = 3 * mesh->vertex_count;
    double *u = malloc(sizeof(double) * (size_t)n), *force = malloc(sizeof(double) * (size_t)n);
    const double t[3] = {0.01, -0.02, 0.03}, w[3] = {0.3, -0.5, 0.2};
    for (int law = 0; law < 3; law++) {
        tm_tissue *tissue = fix_tissue(mesh, m + law, law ? FIBRE : NULL, TM_DOUBLE, false);
        for (int motion = 0; motion < 2; motion++) {
            for (int32_t v = 0; v < mesh->vertex_count; v++) {
                const double *p = mesh->rest_m + 3 * v;
                for (int i = 0; i < 3; i++)
                    u[3 * v + i] = motion ? w[(i + 1) % 3] * p[(i + 2) % 3] - w[(i + 2) % 3] * p[(i + 1) % 3] : t[i];
            }
            tm_tissue_force(tissue, u, force);
            double K[9], scale = 0;
            for (int32_t v = 0; v < mesh->vertex_count; v++)
                tm_tissue_vertex_tensor(tissue, v, K), scale = fmax(scale, fix_largest(K, 9));
            assert_true(fix_largest(force, n) < 1e-14 * scale * fix_largest(u, n) * 10);
        }
        tm_tissue_destroy(tissue);
    }
    free(u), free(force);
    tm_mesh_destroy(mesh);
}

static void mass_and_views_are_consistent(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    m[0].density_kg_m3 = 1050, m[0].damping_1_s = 3;
    tm_mesh *mesh = irregular();
    tm_tissue *tissue = fix_tissue(mesh, m, NULL, TM_DOUBLE, false);
    double mass = 0, volume = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        mass += tm_tissue_mass_kg(tissue)[v];
        assert_true(fabs(tm_tissue_damping_kg_s(tissue)[v] / (3 * tm_tissue_mass_kg(tissue)[v]) - 1) < 1e-14);
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) volume += mesh->volume_m3[t];
    assert_true(fabs(mass / (1050 * volume) - 1) < 1e-12);
    assert_int_equal(tm_tissue_surface(tissue).count, mesh->surface_count);
    assert_int_equal(tm_tissue_alive_count(tissue), mesh->tet_count);
    tm_tissue_destroy(tissue);
    /* Rejected input. */
    tm_error error;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = m + 1;
    assert_int_equal(tm_tissue_create(&def, &tissue, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "no fibre"));
    double *fibre = fix_fibres(mesh, FIBRE);
    fibre[3 * 17] = 5;
    def.fibre = fibre;
    assert_int_equal(tm_tissue_create(&def, &tissue, &error), TM_ERR_ARGUMENT);
    assert_int_equal(error.entity, 17);
    free(fibre);
    m[0].lambda_Pa = -1e9;
    def.material = m;
    assert_int_equal(tm_tissue_create(&def, &tissue, &error), TM_ERR_MATERIAL);
    m[0].lambda_Pa = 1e4;
    def.region_material = (const int32_t[1]){3};
    assert_int_equal(tm_tissue_create(&def, &tissue, &error), TM_ERR_ARGUMENT);
    tm_mesh_destroy(mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

/* Checks guaranteed <= estimated step, that the named element sets it, and its value by power iteration on K_e. */
static void critical_steps_name_the_element_that_sets_them(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    fix_random random = {17};
    for (int trial = 0; trial < 12; trial++) {
        const double flat = trial % 4 == 3 ? 1e-4 : 1;
        tm_mesh *mesh = fix_block((int[3]){3, 2, 3}, (double[3]){0.03, 0.02, 0.03 * flat}, 0.1 * (trial % 4), &random);
        for (int law = 0; law < 3; law++) {
            tm_tissue *tissue =
                fix_tissue(mesh, m + law, law ? FIBRE : NULL, trial % 3 == 2 ? TM_SINGLE : TM_DOUBLE, false);
            int32_t worst = -1;
            tm_error error;
            double estimate = 0, least = HUGE_VAL;
            const double guaranteed = tm_critical_step_guaranteed(tissue, &worst);
            fix_ok(tm_critical_step_estimate(tissue, NULL, 1e-8, 20000, &estimate, &error), &error);
            assert_true(guaranteed <= estimate && guaranteed > 0.3 * estimate);
            for (int32_t t = 0; t < mesh->tet_count; t++) least = fmin(least, tm_critical_step_element(tissue, t));
            assert_true(least <= guaranteed && worst >= 0);
            /* Tissue that will be cut uses the shortest step of its tetrahedra. */
            tm_tissue *cuttable =
                fix_tissue(mesh, m + law, law ? FIBRE : NULL, trial % 3 == 2 ? TM_SINGLE : TM_DOUBLE, true);
            const double after_any_cut = tm_critical_step_guaranteed(cuttable, &worst);
            assert_true(least == after_any_cut && tm_critical_step_element(cuttable, worst) == after_any_cut);
            tm_tissue_destroy(cuttable);
            /* Fixing vertices never shortens the estimated step. */
            uint8_t *fixed = calloc(3 * (size_t)mesh->vertex_count, 1);
            memset(fixed, 1, 30);
            double held = 0;
            fix_ok(tm_critical_step_estimate(tissue, fixed, 1e-8, 20000, &held, &error), &error);
            assert_true(held >= estimate * (1 - 1e-7));
            free(fixed);
            tm_tissue_destroy(tissue);
        }
        tm_mesh_destroy(mesh);
    }
}

/* One tetrahedron is its own assembled system: both steps must agree, down to slivers of aspect 1e6. */
static void critical_steps_agree_for_one_tetrahedron(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    fix_random random = {19};
    for (int trial = 0; trial < 40; trial++) {
        const double thin = pow(10, -(trial % 7));
        double p[12];
        tm_mesh *mesh = NULL;
        do {
            for (int i = 0; i < 12; i++) p[i] = 0.01 * fix_signed(&random) * (i % 3 == 2 ? thin : 1);
        } while (fix_one_tet(p, &mesh, NULL) != TM_OK);
        const bool single = trial % 5 == 4;
        tm_tissue *tissue =
            fix_tissue(mesh, m + trial % 3, trial % 3 ? FIBRE : NULL, single ? TM_SINGLE : TM_DOUBLE, false);
        double estimate = 0;
        tm_error error;
        fix_ok(tm_critical_step_estimate(tissue, NULL, 1e-9, 20000, &estimate, &error), &error);
        const double guaranteed = tm_critical_step_guaranteed(tissue, NULL);
        assert_true(fabs(guaranteed / estimate - 1) < (single ? 2e-5 : 1e-8));
        if (single) assert_true(guaranteed <= estimate); /* for any rounding of the tensors */
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh);
    }
}

/* The selected form against the plain one; the arrays end where the last vertex does, so that ASan detects any
 * access beyond. */
static void force_forms_agree(void **state) {
    (void)state;
    tm_material m[3];
    three_materials(m);
    fix_random random = {43};
    for (int size = 1; size <= 5; size++)
        for (tm_precision p = TM_DOUBLE; p <= TM_SINGLE; p++) {
            tm_mesh *mesh = fix_block((int[3]){size, 1, 2}, (double[3]){0.01 * size, 0.01, 0.02}, 0.2, &random);
            const size_t n = 3 * (size_t)mesh->vertex_count;
            double *u = malloc(sizeof(double) * n), *plain = malloc(sizeof(double) * n),
                   *best = malloc(sizeof(double) * n);
            for (size_t i = 0; i < n; i++) u[i] = fix_signed(&random), best[i] = NAN;
            tm_tissue *a = fix_tissue(mesh, m + size % 3, size % 3 ? FIBRE : NULL, p, false), *b = NULL;
            tm_tissue_def def = tm_tissue_def_default();
            double *fibre = fix_fibres(mesh, FIBRE);
            def.mesh = mesh, def.material_count = 1, def.material = m + size % 3, def.fibre = fibre, def.precision = p,
            def.form = TM_FORCE_BEST;
            tm_error error;
            fix_ok(tm_tissue_create(&def, &b, &error), &error);
            tm_tissue_force(a, u, plain), tm_tissue_force(b, u, best);
            for (size_t i = 0; i < n; i++)
                assert_true(fabs(plain[i] - best[i]) <= 1e-14 * fix_largest(plain, (int32_t)n));
            tm_tissue_destroy(a), tm_tissue_destroy(b);
            free(u), free(plain), free(best), free(fibre);
            tm_mesh_destroy(mesh);
        }
}

#if defined(__x86_64__) && !defined(_WIN32)
/* The wide form's sums by their definition, number by number: fused, by lanes, in ascending order. */
static void by_lanes(const tm_tissue *tissue, const double *u, double *force) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const uint8_t *alive = tm_tissue_alive(tissue);
    memset(force, 0, 3 * sizeof(double) * (size_t)mesh->vertex_count);
    for (int32_t k = 0; k < mesh->vertex_count; k++) {
        const double *uk = u + 3 * k;
        double f[9], K[9];
        tm_tissue_vertex_tensor(tissue, k, K);
        for (int i = 0; i < 9; i++) f[i] = K[i] * uk[i % 3];
        for (int32_t i = mesh->vertex_edge_begin[k]; i < mesh->vertex_edge_begin[k + 1]; i++) {
            const int32_t e = mesh->vertex_edge[i], l = mesh->edge[2 * e + 1];
            bool lives = false;
            for (int32_t t = mesh->edge_tet_begin[e]; t < mesh->edge_tet_begin[e + 1]; t++)
                lives |= alive[mesh->edge_tet[t]];
            if (mesh->edge[2 * e] != k || !lives) continue;
            tm_tissue_edge_tensor(tissue, e, K);
            for (int j = 0; j < 9; j++) f[j] = fma(K[j], u[3 * l + j % 3], f[j]);
            for (int j = 0; j < 3; j++) force[3 * l + j] -= fma(K[6 + j], uk[2], fma(K[3 + j], uk[1], K[j] * uk[0]));
        }
        for (int i = 0; i < 3; i++) force[3 * k + i] -= (f[3 * i] + f[3 * i + 1]) + f[3 * i + 2];
    }
}

/* Swaps the numbers of some vertices with others far away. */
static tm_mesh *with_jumps(tm_mesh *mesh, fix_random *random) {
    const int32_t n = mesh->vertex_count;
    int32_t *now = malloc(sizeof(int32_t) * (size_t)n), *tet = malloc(4 * sizeof(int32_t) * (size_t)mesh->tet_count);
    double *vertex = malloc(3 * sizeof(double) * (size_t)n);
    for (int32_t v = 0; v < n; v++) now[v] = v;
    for (int i = 0; i < 12; i++) {
        const int32_t a = (int32_t)(fix_uniform(random) * n), b = (int32_t)(fix_uniform(random) * n), keep = now[a];
        now[a] = now[b], now[b] = keep;
    }
    for (int32_t v = 0; v < n; v++) memcpy(vertex + 3 * now[v], mesh->rest_m + 3 * v, 3 * sizeof(double));
    for (int32_t i = 0; i < 4 * mesh->tet_count; i++) tet[i] = now[mesh->tet[i]];
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = n, def.vertex_m = vertex, def.tet_count = mesh->tet_count, def.tet = tet;
    tm_mesh *made = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &made, &error), &error);
    free(now), free(tet), free(vertex);
    tm_mesh_destroy(mesh);
    return made;
}

/* Bits of the wide form if the ring of partial sums holds all neighbours, if few are beyond it, and if so many are
 * that there is no ring; in blocks of eight, in blocks of nine and one by one; uncut, and with removed vertices and
 * edges in between. */
static void wide_form_sums_by_lanes(void **state) {
    (void)state;
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) skip();
    static const int cells[4][3] = {{3, 3, 4}, {15, 2, 9}, {9, 9, 20}, {36, 36, 1}}; /* layers of the last: 1,369 */
    tm_material m[3];
    three_materials(m);
    fix_random random = {19};
    for (int size = 0; size < 4; size++)
        for (tm_precision p = TM_DOUBLE; p <= TM_SINGLE; p++) {
            tm_mesh *mesh = fix_block(cells[size], (double[3]){0.04, 0.03, 0.02}, 0.1, &random);
            if (size == 2) mesh = with_jumps(mesh, &random);
            const size_t n = 3 * (size_t)mesh->vertex_count;
            double *u = malloc(sizeof(double) * n), *sums = malloc(sizeof(double) * n),
                   *got = malloc(sizeof(double) * n);
            for (size_t i = 0; i < n; i++) u[i] = 1e-3 * fix_signed(&random), got[i] = NAN;
            tm_tissue *tissue = NULL;
            tm_tissue_def def = tm_tissue_def_default();
            def.mesh = mesh, def.material_count = 1, def.material = m, def.precision = p, def.cuttable = true;
            tm_error error;
            fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
            for (int cut = 0; cut < 2; cut++) {
                tm_tissue_force(tissue, u, got);
                by_lanes(tissue, u, sums);
                assert_memory_equal(sums, got, sizeof(double) * n);
                for (int32_t t = 0; t < mesh->tet_count; t++) { /* a slab, and single ones here and there */
                    const double z = mesh->rest_m[3 * mesh->tet[4 * t] + 2], y = mesh->rest_m[3 * mesh->tet[4 * t] + 1];
                    if (cut || !(t % 29 == 0 || (z < 0.012 && y > 0.011 && y < 0.019))) continue;
                    if (tm_tissue_alive(tissue)[t]) tm_cut_remove(tissue, &t, 1, NULL, 0);
                }
            }
            tm_tissue_destroy(tissue);
            free(u), free(sums), free(got);
            tm_mesh_destroy(mesh);
        }
}
#else
static void wide_form_sums_by_lanes(void **state) {
    (void)state;
    skip();
}
#endif

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(force_forms_agree),
                                       cmocka_unit_test(linear_displacements_are_solutions),
                                       cmocka_unit_test(force_is_the_gradient),
                                       cmocka_unit_test(stiffness_blocks_are_symmetric),
                                       cmocka_unit_test(rigid_motions_give_no_force),
                                       cmocka_unit_test(mass_and_views_are_consistent),
                                       cmocka_unit_test(critical_steps_name_the_element_that_sets_them),
                                       cmocka_unit_test(critical_steps_agree_for_one_tetrahedron),
                                       cmocka_unit_test(wide_form_sums_by_lanes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
