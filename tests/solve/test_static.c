/* Static solutions and superposed responses against the oracle and the settled tensor/mass model; rejected input. */
#include "../physics/oracle.h"
#include "kit.h"

#include <dlfcn.h>
#include <pthread.h>
#include <SuiteSparse_config.h>

/* --- oracle --- */

static tm_tissue *oracle_tissue(const oracle *o) {
    tm_material material;
    tm_error error;
    fix_ok(tm_material_five(o->lame[0], o->lame[1], o->lame[2], o->lame[3], o->lame[4], &material, &error), &error);
    material.density_kg_m3 = o->density;
    return fix_tissue(o->mesh, &material, tm_material_is_isotropic(&material) ? NULL : o->fibre, TM_DOUBLE, false);
}

static bool at_tip(const oracle *o, int32_t v) {
    return o->vertex[3 * v] > fix_largest(o->vertex, 3 * o->vertex_count) - 1e-12;
}

/* Clamp, prescribed values and loads of one case. */
static void oracle_case(const oracle *o, const tm_tissue *tissue, int kase, uint8_t *fixed, double *value,
                        double *load) {
    const int32_t n = 3 * o->vertex_count;
    memset(value, 0, 8 * (size_t)n);
    memset(load, 0, 8 * (size_t)n);
    for (int32_t d = 0; d < n; d++) {
        fixed[d] = o->vertex[d / 3 * 3] < 1e-12 || (kase == 1 && at_tip(o, d / 3));
        if (kase == 1 && at_tip(o, d / 3)) value[d] = o->press[d % 3];
        if (kase == 0) load[d] = tm_tissue_mass_kg(tissue)[d / 3] * o->g[d % 3];
    }
    if (kase == 2) memcpy(load + 3 * o->poke_vertex, o->poke, sizeof o->poke);
}

static double reaction_off(const oracle *o, int kase, const double *reaction) {
    double clamp[3] = {0}, tip[3] = {0}, worst = 0;
    for (int32_t d = 0; d < 3 * o->vertex_count; d++) {
        if (o->vertex[d / 3 * 3] < 1e-12)
            clamp[d % 3] += reaction[d];
        else if (at_tip(o, d / 3))
            tip[d % 3] += reaction[d];
    }
    for (int i = 0; i < 3; i++)
        worst = fmax(worst, fmax(fabs(clamp[i] - o->clamp[kase][i]), fabs(tip[i] - o->tip[kase][i])));
    return worst / fix_largest(o->clamp[kase], 3);
}

static void direct(const oracle *o, const tm_tissue *tissue, tm_solver solver) {
    const int32_t n = 3 * o->vertex_count;
    uint8_t *fixed = malloc((size_t)n);
    double *value = malloc(8 * (size_t)n), *load = malloc(8 * (size_t)n), *u = malloc(8 * (size_t)n),
           *reaction = malloc(8 * (size_t)n);
    for (int kase = 0; kase < 3; kase++) {
        oracle_case(o, tissue, kase, fixed, value, load);
        tm_solve_def def = kit_problem(tissue, fixed);
        def.fixed_value_m = value;
        def.load_N = load;
        def.solver = solver;
        def.cg_tolerance = 1e-12;
        tm_solve_report report;
        tm_error error;
        fix_ok(tm_solve_static(&def, u, reaction, &report, &error), &error);
        const double off = kit_difference(u, o->u[kase], n), force_off = reaction_off(o, kase, reaction);
        print_message("  %s case %d: displacement %.1e, reaction %.1e\n", solver == TM_SOLVER_CG ? "cg" : "cholesky",
                      kase, off, force_off);
        assert_true(off < 1e-7);
        assert_true(force_off < 1e-7);
    }
    free(fixed), free(value), free(load), free(u), free(reaction);
}

/* The precomputed model: gravity as its base shape; `press` as displacements imposed on its surface, by the paper's
 * method. */
static void superposed(const oracle *o, const tm_tissue *tissue, tm_precision precision, double tolerance) {
    const int32_t n = 3 * o->vertex_count;
    uint8_t *fixed = malloc((size_t)n);
    double *value = malloc(8 * (size_t)n), *load = malloc(8 * (size_t)n), *u = calloc((size_t)n, 8), push[3] = {0};
    int32_t *vertex = malloc(4 * (size_t)o->vertex_count), count = 0;
    for (int kase = 0; kase < 2; kase++) {
        oracle_case(o, tissue, kase, fixed, value, load);
        for (int32_t d = 0; d < n; d++) fixed[d] = o->vertex[d / 3 * 3] < 1e-12;
        tm_precomputed_def def = tm_precomputed_def_default();
        def.problem = kit_problem(tissue, fixed);
        def.problem.load_N = load;
        def.precision = precision;
        tm_precomputed *model;
        tm_error error;
        fix_ok(tm_precomputed_create(&def, &model, NULL, &error), &error);
        for (int32_t v = 0; kase == 1 && v < o->vertex_count; v++)
            if (at_tip(o, v)) memcpy(u + 3 * count, o->press, 24), vertex[count++] = v;
        fix_ok(tm_precomputed_impose(model, count, vertex, u, 0, &error), &error);
        assert_true(tm_precomputed_update(model, NULL) >= 0);
        const double *shape = tm_precomputed_displacement(model), most = fix_largest(o->u[kase], n);
        const int32_t *surface, on_surface = tm_precomputed_surface(model, &surface);
        double worst = 0;
        assert_true(on_surface > count);
        for (int32_t i = 0; i < 3 * on_surface; i++)
            worst =
                fmax(worst, fabs(shape[3 * surface[i / 3] + i % 3] - o->u[kase][3 * surface[i / 3] + i % 3]) / most);
        for (int32_t i = 0; i < count; i++) {
            double f[3];
            tm_precomputed_imposed_force(model, i, f);
            for (int c = 0; c < 3; c++) push[c] += f[c];
        }
        const double off = kase == 1 ? kit_difference(push, o->tip[kase], 3) : 0;
        print_message("  superposed %s case %d: displacement %.1e, reaction %.1e\n",
                      precision == TM_DOUBLE ? "double" : "single", kase, worst, off);
        assert_true(worst < tolerance);
        assert_true(off < tolerance);
        tm_precomputed_destroy(model);
    }
    free(fixed), free(value), free(load), free(u), free(vertex);
}

static void check_oracle(const char *name) {
    oracle o = {0};
    oracle_load(name, &o);
    tm_tissue *tissue = oracle_tissue(&o);
    direct(&o, tissue, TM_SOLVER_CHOLESKY);
    direct(&o, tissue, TM_SOLVER_CG);
    superposed(&o, tissue, TM_DOUBLE, 1e-7);
    superposed(&o, tissue, TM_SINGLE, 1e-4);
    tm_tissue_destroy(tissue);
    oracle_unload(&o);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void isotropic_law_agrees_with_reference(void **state) { (void)state, check_oracle("iso"); }
static void paper_law_agrees_with_reference(void **state) { (void)state, check_oracle("fibre"); }
static void engineering_constants_agree_with_reference(void **state) { (void)state, check_oracle("muscle"); }

/* --- settled tensor/mass --- */

static void check_settled(const int cells[3]) {
    fix_random random = {5};
    const double size[3] = {0.1, 0.06, 0.05}, g[3] = {1, -2, -9.81}, along[3] = {1, 2, 2};
    tm_mesh *mesh = fix_block(cells, size, 0.2, &random);
    tm_material material;
    tm_error error;
    fix_ok(tm_material_engineering(12e3, 6e3, 0.3, 0.35, 4e3, &material, &error), &error);
    tm_tissue *tissue = fix_tissue(mesh, &material, along, TM_DOUBLE, false);
    tm_world *world = fix_world(tissue, true);
    uint8_t *fixed = kit_clamp(mesh, 1e-9);
    const size_t n = 3 * (size_t)mesh->vertex_count;
    double *value = calloc(n, 8), *load = calloc(n, 8), *u = malloc(8 * n), *reaction = malloc(8 * n),
           *settled = calloc(n, 8);
    for (size_t d = 0; d < n; d++) {
        if (fixed[d]) value[d] = 1e-3 * fix_signed(&random); /* a deformed clamp */
        load[d] = tm_tissue_mass_kg(tissue)[d / 3] * g[d % 3];
    }
    kit_support(world, fixed, value);
    fix_ok(tm_stage_gravity(world, g, &error), &error);
    kit_settle(world);
    tm_support_reaction(world, settled);
    tm_solve_def def = kit_problem(tissue, fixed);
    def.fixed_value_m = value;
    def.load_N = load;
    tm_solve_report report;
    fix_ok(tm_solve_static(&def, u, reaction, &report, &error), &error);
    const double off = kit_difference(u, tm_world_state(world)->u_m, (int32_t)n),
                 force_off = kit_difference(reaction, settled, (int32_t)n);
    print_message("  %d tetrahedra: displacement %.1e, reaction %.1e; factor %.2f s\n", mesh->tet_count, off, force_off,
                  report.factor_s);
    assert_true(off < 1e-6);
    assert_true(force_off < 1e-6);
    free(fixed), free(value), free(load), free(u), free(reaction), free(settled);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

static void static_solution_agrees_with_the_settled_model(void **state) {
    (void)state;
    check_settled((int[]){8, 5, 4});                        /* 960 */
    check_settled((int[]){17, 10, 10});                     /* 10,200 */
    if (test_is_long()) check_settled((int[]){30, 17, 16}); /* 48,960 */
}

/* --- rejected input --- */

static tm_status try_solve(const tm_tissue *tissue, const uint8_t *fixed, int64_t limit, tm_error *error) {
    tm_solve_def def = kit_problem(tissue, fixed);
    def.memory_limit_bytes = limit;
    return tm_solve_static(&def, NULL, NULL, NULL, error);
}

static void tissue_without_supports_is_rejected(void **state) {
    (void)state;
    const tm_material material = kit_material(1e4, 0.4);
    tm_mesh *mesh = fix_block((int[]){6, 2, 2}, (double[]){0.06, 0.02, 0.02}, 0, NULL);
    uint8_t *fixed = calloc(3 * (size_t)mesh->vertex_count, 1), *alive = malloc((size_t)mesh->tet_count);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    tm_error error;
    assert_int_equal(try_solve(tissue, fixed, 0, &error), TM_ERR_SUPPORT);
    assert_non_null(strstr(error.message, "no vertex of the tissue is fixed"));
    for (int i = 0; i < 6; i++) fixed[i] = 1; /* two vertices: it can still rotate about their line */
    assert_int_equal(try_solve(tissue, fixed, 0, &error), TM_ERR_SUPPORT);
    assert_non_null(strstr(error.message, "rigid body"));
    for (int i = 0; i < 9; i++) fixed[i] = 1; /* three in one line */
    assert_int_equal(try_solve(tissue, fixed, 0, &error), TM_ERR_SUPPORT);
    for (int i = 9; i < 12; i++) fixed[i] = 1; /* a fourth one, off the line */
    fix_ok(try_solve(tissue, fixed, 0, &error), &error);
    /* a slice removed from the middle leaves a far part without support; its vertices are beyond x = 0.04 */
    for (int32_t t = 0; t < mesh->tet_count; t++) alive[t] = t / 24 != 3;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material, def.alive = alive;
    tm_tissue *apart;
    fix_ok(tm_tissue_create(&def, &apart, &error), &error);
    assert_int_equal(try_solve(apart, fixed, 0, &error), TM_ERR_SUPPORT);
    assert_non_null(strstr(error.message, "has no fixed vertex"));
    assert_true(mesh->rest_m[3 * error.entity] > 0.0399);
    tm_tissue_destroy(apart);
    /* two parts with one common vertex only: the far one can rotate about it */
    for (int32_t t = 0; t < mesh->tet_count; t++) alive[t] = t / 24 < 3;
    int32_t corner = -1, keep = -1;
    for (int32_t t = 72; t < 96 && keep < 0; t++)
        for (int i = 0; i < 4 && keep < 0; i++) {
            int on_plane = 0;
            for (int j = 0; j < 4; j++) on_plane += mesh->rest_m[3 * mesh->tet[4 * t + j]] < 0.0301;
            if (on_plane == 1 && mesh->rest_m[3 * mesh->tet[4 * t + i]] < 0.0301)
                corner = mesh->tet[4 * t + i], keep = t;
        }
    assert_true(keep >= 0 && corner >= 0);
    alive[keep] = 1;
    fix_ok(tm_tissue_create(&def, &apart, &error), &error);
    assert_int_equal(try_solve(apart, fixed, 0, &error), TM_ERR_SUPPORT);
    print_message("  hinge: %s\n", error.message);
    tm_tissue_destroy(apart);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    free(fixed), free(alive);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void too_large_problems_are_rejected(void **state) {
    (void)state;
    const tm_material material = kit_material(1e4, 0.4);
    tm_mesh *mesh = fix_block((int[]){10, 6, 6}, (double[]){0.1, 0.06, 0.06}, 0, NULL);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    tm_precomputed_def def = tm_precomputed_def_default();
    uint8_t *fixed = kit_clamp(mesh, 1e-9);
    def.problem = kit_problem(tissue, fixed);
    def.problem.memory_limit_bytes = 1000000;
    tm_precomputed *model = NULL;
    tm_error error;
    assert_int_equal(tm_precomputed_create(&def, &model, NULL, &error), TM_ERR_MEMORY);
    print_message("  %s\n", error.message);
    assert_null(model);
    assert_non_null(strstr(error.message, "too large: "));
    assert_non_null(strstr(error.message, "1 MB is allowed"));
    assert_non_null(strstr(error.message, "single precision responses ("));
    assert_non_null(strstr(error.message, "conjugate gradients ("));
    def.problem.solver = TM_SOLVER_CG;
    def.precision = TM_SINGLE;
    assert_int_equal(tm_precomputed_create(&def, &model, NULL, &error), TM_ERR_MEMORY);
    assert_null(strstr(error.message, "conjugate")); /* already chosen */
    free(fixed);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* --- several threads, and state of the process --- */

typedef struct one_solution {
    const tm_solve_def *def;
    double *u;
} one_solution;

static void *solve_one(void *argument) {
    const one_solution *s = argument;
    tm_error error;
    return tm_solve_static(s->def, s->u, NULL, NULL, &error) == TM_OK ? NULL : argument;
}

static void four_threads_agree(void **state) {
    (void)state;
    fix_random random = {7};
    const tm_material material = kit_material(6e3, 0.45);
    tm_mesh *mesh = fix_block((int[]){10, 8, 8}, (double[]){0.1, 0.08, 0.08}, 0.2, &random);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    const size_t n = 3 * (size_t)mesh->vertex_count;
    uint8_t *fixed = kit_clamp(mesh, 1e-9);
    double *load = calloc(n, 8), *alone = malloc(8 * n), *u[4];
    for (size_t d = 2; d < n; d += 3) load[d] = -1e-3;
    tm_solve_def def = kit_problem(tissue, fixed);
    def.load_N = load;
    def.threads = 2;
    assert_null(solve_one(&(one_solution){&def, alone}));
    for (int i = 0; i < 4; i++) u[i] = malloc(8 * n);
    for (int round = 0; round < (test_is_long() ? 60 : 12); round++) {
        pthread_t thread[4];
        one_solution work[4];
        for (int i = 0; i < 4; i++) {
            work[i] = (one_solution){&def, u[i]};
            assert_int_equal(pthread_create(&thread[i], NULL, solve_one, &work[i]), 0);
        }
        for (int i = 0; i < 4; i++) {
            void *failed;
            pthread_join(thread[i], &failed);
            assert_null(failed);
            assert_memory_equal(u[i], alone, 8 * n);
        }
    }
    for (int i = 0; i < 4; i++) free(u[i]);
    free(alone), free(load), free(fixed);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* OpenBLAS's threads, SuiteSparse's allocator and rand() are unchanged. */
static void global_state_of_the_process_is_unchanged(void **state) {
    (void)state;
    const tm_material material = kit_material(6e3, 0.45);
    fix_random random = {9};
    tm_mesh *mesh = fix_block((int[]){6, 5, 4}, (double[]){0.06, 0.05, 0.04}, 0.2, &random);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    uint8_t *fixed = kit_clamp(mesh, 1e-9);
    const tm_solve_def def = kit_problem(tissue, fixed);
    int (*get)(void), draw[2];
    void (*set)(int);
    *(void **)&get = dlsym(RTLD_DEFAULT, "openblas_get_num_threads");
    *(void **)&set = dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    const struct SuiteSparse_config_struct before = SuiteSparse_config;
    for (int solved = 0; solved < 2; solved++) {
        if (set) set(2);
        const int threads = get ? get() : 0;
        srand(77);
        rand();
        tm_error error;
        tm_precomputed_def full = tm_precomputed_def_default();
        full.problem = def;
        tm_precomputed *model;
        if (solved) {
            fix_ok(tm_solve_static(&def, NULL, NULL, NULL, &error), &error);
            fix_ok(tm_precomputed_create(&full, &model, NULL, &error), &error);
            tm_precomputed_destroy(model);
        }
        draw[solved] = rand();
        assert_int_equal(get ? get() : 0, threads);
    }
    assert_int_equal(draw[0], draw[1]);
    assert_memory_equal(&SuiteSparse_config, &before, sizeof before);
    free(fixed);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(four_threads_agree),
                                       cmocka_unit_test(global_state_of_the_process_is_unchanged),
                                       cmocka_unit_test(isotropic_law_agrees_with_reference),
                                       cmocka_unit_test(paper_law_agrees_with_reference),
                                       cmocka_unit_test(engineering_constants_agree_with_reference),
                                       cmocka_unit_test(static_solution_agrees_with_the_settled_model),
                                       cmocka_unit_test(tissue_without_supports_is_rejected),
                                       cmocka_unit_test(too_large_problems_are_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
