/* The guaranteed step against dense eigenvalues: never above 2/omega_max, on random meshes with slivers, before and
 * after random cuts; longer than the uniform bound if there are slivers. */
#include "../long.h"
#include "dense.h"

static const double FIBRE[3] = {2, -1, 2};

/* Makes a block with every vertex displaced as far as the tetrahedra permit, some nearly flat. */
static tm_mesh *crooked(int trial, fix_random *random) {
    const int cells[3] = {2, 1 + trial % 2, 1 + trial / 2 % 2};
    const double flat = trial % 5 == 4 ? 0.02 : 1, cell = 0.01;
    tm_mesh *plain = fix_block(cells, (double[3]){cell * cells[0], cell * cells[1], cell * cells[2] * flat}, 0, random);
    double *vertex = malloc(sizeof *vertex * 3 * (size_t)plain->vertex_count);
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = plain->vertex_count, def.vertex_m = vertex, def.tet_count = plain->tet_count,
    def.tet = plain->tet;
    tm_mesh *mesh = NULL;
    tm_error error;
    for (double throw = 0.35; !mesh;
         throw *= 0.98) { /* an inverted tetrahedron is refused: try again with a smaller displacement */
        for (int32_t i = 0; i < 3 * plain->vertex_count; i++)
            vertex[i] = plain->rest_m[i] + throw *cell * (i % 3 == 2 ? flat : 1) * fix_signed(random);
        if (tm_mesh_create(&def, &mesh, &error)) mesh = NULL;
    }
    tm_mesh_destroy(plain);
    free(vertex);
    return mesh;
}

static tm_tissue *build(const tm_mesh *mesh, const tm_material *m, int trial, const double *fibre, bool cuttable,
                        const uint8_t *alive) {
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = m + trial % 2, def.fibre = fibre,
    def.precision = trial % 3 == 2 ? TM_SINGLE : TM_DOUBLE, def.cuttable = cuttable, def.alive = alive,
    def.form = TM_FORCE_PLAIN;
    tm_tissue *tissue = NULL;
    tm_error error;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

static double least_element(const tm_tissue *tissue) {
    double least = HUGE_VAL;
    for (int32_t t = 0; t < tm_tissue_mesh(tissue)->tet_count; t++)
        if (tm_tissue_alive(tissue)[t]) least = fmin(least, tm_critical_step_element(tissue, t));
    return least;
}

static void guaranteed_step_is_below_the_true_one(void **state) {
    (void)state;
    tm_material m[2];
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.45, m, &error), &error);
    fix_ok(tm_material_engineering(3e4, 6e3, 0.4, 0.45, 5e3, m + 1, &error), &error);
    m[1].density_kg_m3 = 1600;
    fix_random random = {29};
    const int trials = test_is_long() ? 400 : 20;
    double gain = 0, nearest = 0;
    for (int trial = 0; trial < trials; trial++) {
        tm_mesh *mesh = crooked(trial, &random);
        double *fibre = fix_fibres(mesh, FIBRE);
        tm_tissue *cut = build(mesh, m, trial, fibre, true, NULL);
        const double at_first = tm_critical_step_guaranteed(cut, NULL);
        assert_true(at_first == least_element(cut));
        while (tm_tissue_alive_count(cut) > 0) {
            /* The step of the uncut tissue holds for the remainder; so does the longer one of tissue that can no
             * more be cut. */
            const double estimate = dense_step(cut);
            tm_tissue *fixed = build(mesh, m, trial, fibre, false, tm_tissue_alive(cut));
            int32_t tet = -1;
            const double step = tm_critical_step_guaranteed(fixed, &tet);
            assert_true(tet >= 0 && tm_tissue_alive(cut)[tet]);
            if (!(step <= estimate && at_first <= estimate && step >= least_element(cut) && step >= at_first))
                fail_msg("trial %d, %d tetrahedra: %g s, at first %g s, sharp %g s", trial, tm_tissue_alive_count(cut),
                         step, at_first, estimate);
            gain = fmax(gain, step / least_element(cut));
            nearest = fmax(nearest, step / estimate);
            tm_tissue_destroy(fixed);
            int32_t some[8];
            for (int i = 0; i < 8; i++) some[i] = (int32_t)(fix_uniform(&random) * mesh->tet_count);
            tm_cut_remove(cut, some, 8, NULL, 0);
        }
        tm_tissue_destroy(cut);
        free(fibre);
        tm_mesh_destroy(mesh);
    }
    print_message("  %d meshes: at most %.6f of the estimated step, %.2f times the even bound\n", trials, nearest,
                  gain);
    assert_true(gain > 1.5);
}

/* One vertex moved close to a face: its slivers alone would need a shorter step than with the masses around them. */
static void slivers_use_the_masses_around_them(void **state) {
    (void)state;
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.45, &material, &error), &error);
    fix_random random = {31};
    tm_mesh *plain = fix_block((int[3]){3, 3, 3}, (double[3]){0.03, 0.03, 0.03}, 0, &random), *mesh = NULL;
    double *vertex = malloc(sizeof(double) * 3 * (size_t)plain->vertex_count);
    memcpy(vertex, plain->rest_m, sizeof(double) * 3 * (size_t)plain->vertex_count);
    vertex[3 * (1 * 16 + 1 * 4 + 1)] = 0.001; /* of 0.01 */
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = plain->vertex_count, def.vertex_m = vertex, def.tet_count = plain->tet_count,
    def.tet = plain->tet;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    tm_tissue *whole = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    tm_tissue *cuttable = fix_tissue(mesh, &material, NULL, TM_DOUBLE, true);
    double estimate = 0;
    fix_ok(tm_critical_step_estimate(whole, NULL, 1e-8, 20000, &estimate, &error), &error);
    const double even = tm_critical_step_guaranteed(cuttable, NULL), shared = tm_critical_step_guaranteed(whole, NULL);
    print_message("  even %.3f of the estimated step, shared %.3f\n", even / estimate, shared / estimate);
    assert_true(even < 0.7 * estimate && shared > 1.3 * even && shared <= estimate);
    /* A fragment that hangs on the tissue depends on its extra masses: they are not available to other elements. */
    double *extra = malloc(sizeof(double) * (size_t)mesh->vertex_count);
    for (int32_t v = 0; v < mesh->vertex_count; v++) extra[v] = 1;
    tm_tissue_def heavy = tm_tissue_def_default();
    heavy.mesh = mesh, heavy.material_count = 1, heavy.material = &material, heavy.extra_mass_kg = extra;
    tm_tissue *loaded = NULL;
    fix_ok(tm_tissue_create(&heavy, &loaded, &error), &error);
    assert_true(tm_critical_step_guaranteed(loaded, NULL) == even);
    tm_tissue_destroy(loaded);
    free(extra);
    tm_tissue_destroy(whole), tm_tissue_destroy(cuttable);
    tm_mesh_destroy(plain), tm_mesh_destroy(mesh);
    free(vertex);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(guaranteed_step_is_below_the_true_one),
                                       cmocka_unit_test(slivers_use_the_masses_around_them)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
