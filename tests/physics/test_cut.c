/* Cutting: bits of a fresh build after every batch, manifold surface, no remainder at the end, no allocation. */
#include "../cut_check.h"
#include "../long.h"

static tm_mesh *organ(uint64_t seed) {
    fix_random random = {seed};
    return fix_block((int[3]){7, 5, 4}, (double[3]){0.07, 0.05, 0.04}, 0.3, &random);
}

typedef struct scene {
    tm_mesh *mesh;
    double *fibre;
    tm_material material[1];
    tm_tissue_def def;
    tm_tissue *tissue;
    tm_world *world;
} scene;

/* Makes a block with fibres (or isotropic), fixed at x = 0, under gravity. */
static scene make(bool fibred, tm_precision precision) {
    scene s = {.mesh = organ(41)};
    tm_error error;
    if (fibred)
        fix_ok(tm_material_paper(1e4, 3e3, 1.2e4, 9e3, s.material, &error), &error);
    else
        fix_ok(tm_material_young(1e4, 0.45, s.material, &error), &error);
    s.material->damping_1_s = 20;
    s.fibre = fix_fibres(s.mesh, (const double[3]){1, 2, 2});
    s.def = tm_tissue_def_default();
    s.def.mesh = s.mesh, s.def.material_count = 1, s.def.fibre = fibred ? s.fibre : NULL, s.def.precision = precision,
    s.def.cuttable = true;
    s.def.form = TM_FORCE_PLAIN;
    return s;
}

static void start(scene *s) {
    tm_error error;
    s->def.material = s->material;
    fix_ok(tm_tissue_create(&s->def, &s->tissue, &error), &error);
    s->world = fix_world(s->tissue, true);
    const double zero[90] = {0};
    int32_t dof[90];
    for (int i = 0; i < 90; i++) dof[i] = i; /* the 30 vertices at x = 0 */
    tm_support_def def = tm_support_def_default();
    def.count = 90, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(s->world, &def, &error), &error);
    fix_ok(tm_stage_gravity(s->world, (const double[3]){0, 0, -9.81}, &error), &error);
}

static void stop(scene *s) {
    tm_world_destroy(s->world);
    tm_tissue_destroy(s->tissue);
}

static void finish(scene *s) {
    free(s->fibre);
    tm_mesh_destroy(s->mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void cuts_in_twenty_orders_equal_a_fresh_build(void **state) {
    (void)state;
    for (int order = 0; order < 20; order++) {
        scene s = make(order % 2, order % 3 == 2 ? TM_SINGLE : TM_DOUBLE);
        if (order % 5 == 4) s.def.form = TM_FORCE_BEST;
        start(&s);
        fix_random random = {100 + (uint64_t)order};
        int32_t *list = malloc(sizeof(int32_t) * (size_t)s.mesh->tet_count);
        for (int32_t t = 0; t < s.mesh->tet_count; t++) list[t] = t;
        if (order % 4 == 3)
            cut_order_from(s.mesh, list, &random);
        else
            cut_shuffle(list, s.mesh->tet_count, &random);
        const double bound = tm_critical_step_guaranteed(s.tissue, NULL);
        cut_down(s.tissue, &s.def, s.world, list, 0.95, test_is_long() ? 1 : 1 + order, true);
        assert_true(tm_tissue_alive_count(s.tissue) <= s.mesh->tet_count / 20);
        assert_true(tm_critical_step_guaranteed(s.tissue, NULL) >= bound);
        free(list);
        stop(&s);
        finish(&s);
    }
}

static void tissue_can_be_removed_completely(void **state) {
    (void)state;
    scene s = make(true, TM_DOUBLE);
    start(&s);
    fix_random random = {5};
    int32_t *list = malloc(sizeof(int32_t) * (size_t)s.mesh->tet_count);
    for (int32_t t = 0; t < s.mesh->tet_count; t++) list[t] = t;
    cut_shuffle(list, s.mesh->tet_count, &random);
    cut_down(s.tissue, &s.def, s.world, list, 1, 37, true);
    assert_int_equal(tm_tissue_alive_count(s.tissue), 0);
    assert_int_equal(tm_tissue_surface(s.tissue).count, 0);
    for (int32_t v = 0; v < s.mesh->vertex_count; v++) assert_true(tm_tissue_mass_kg(s.tissue)[v] == 0);
    /* Checks that the tissue is empty and valid: it steps, nothing moves, and nothing more can be removed. */
    double *u = malloc(sizeof(double) * 3 * (size_t)s.mesh->vertex_count);
    memcpy(u, tm_world_state(s.world)->u_m, sizeof(double) * 3 * (size_t)s.mesh->vertex_count);
    assert_int_equal(tm_world_step(s.world, 50), TM_OK);
    assert_memory_equal(u, tm_world_state(s.world)->u_m, sizeof(double) * 3 * (size_t)s.mesh->vertex_count);
    assert_int_equal(tm_cut_remove(s.tissue, list, s.mesh->tet_count, NULL, 0), 0);
    tm_error error;
    double step_s = 0;
    fix_ok(tm_critical_step_estimate(s.tissue, NULL, 1e-6, 100, &step_s, &error), &error);
    tm_settle_def settle = tm_settle_def_default();
    fix_ok(tm_world_settle(s.world, &settle, NULL, &error), &error);
    free(list), free(u);
    stop(&s);
    finish(&s);
}

/* Two boxes have only an edge in common after the cut: the smaller fan about it is removed, with everything that
 * hangs only on it. */
static void parts_hanging_on_an_edge_are_removed(void **state) {
    (void)state;
    fix_random random = {1};
    tm_mesh *mesh = fix_block((int[3]){2, 2, 1}, (double[3]){0.02, 0.02, 0.01}, 0, &random);
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.3, &material, &error), &error);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, true);
    int32_t gone[24], n = 0;
    for (int32_t t = 0; t < 24; t++)
        if (t / 6 == 1 || t / 6 == 2 || t == 0)
            gone[n++] = t; /* boxes (0,1) and (1,0) complete, and one of box (0,0) */
    assert_int_equal(n, 13);
    assert_true(tm_cut_remove(tissue, gone, n, NULL, 0) > n);
    assert_true(tm_tissue_alive_count(tissue) >= 6);
    assert_null(cut_not_manifold(tissue));
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* A tunnel that ends in a point: the star of its end vertex is a ring, which must be opened. Found by removing every
 * line of cells. */
static void ring_around_a_vertex_is_opened(void **state) {
    (void)state;
    fix_random random = {9};
    tm_mesh *mesh = fix_block((int[3]){4, 4, 4}, (double[3]){0.04, 0.04, 0.04}, 0.2, &random);
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.3, &material, &error), &error);
    int32_t inner = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        /* Two tetrahedra of an inner vertex with only this vertex in common: removing both pierces its star twice. */
        const int32_t *star = mesh->vertex_tet + mesh->vertex_tet_begin[v],
                      n = mesh->vertex_tet_begin[v + 1] - mesh->vertex_tet_begin[v];
        for (int32_t i = 1; i < n; i++) {
            int shared = 0;
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < 4; b++) shared += mesh->tet[4 * star[0] + a] == mesh->tet[4 * star[i] + b];
            if (shared != 1) continue;
            tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, true);
            const int32_t removed = tm_cut_remove(tissue, (const int32_t[2]){star[0], star[i]}, 2, NULL, 0);
            assert_null(cut_not_manifold(tissue));
            inner += removed > 2;
            tm_tissue_destroy(tissue);
        }
    }
    assert_true(inner > 20);
    tm_mesh_destroy(mesh);
}

/* Removed tetrahedra cost nothing: none of their numbers is read, and every force on them is 0. */
static void removed_tetrahedra_are_not_read(void **state) {
    (void)state;
    for (int kind = 0; kind < 8; kind++) {
        scene s = make(kind % 2, kind & 2 ? TM_SINGLE : TM_DOUBLE);
        s.def.form = kind & 4 ? TM_FORCE_BEST : TM_FORCE_PLAIN;
        start(&s);
        for (int32_t t = 0; t < s.mesh->tet_count / 2; t++) tm_cut_remove(s.tissue, &t, 1, NULL, 0);
        const int32_t n = s.mesh->vertex_count;
        double *u = tm_world_state(s.world)->u_m, *f = malloc(sizeof(double) * 3 * (size_t)n);
        int32_t dead = 0;
        for (int32_t v = 0; v < n; v++) {
            if (tm_tissue_mass_kg(s.tissue)[v] > 0) continue;
            dead++;
            for (int i = 0; i < 3; i++) u[3 * v + i] = NAN;
        }
        assert_true(dead > n / 4);
        tm_tissue_force(s.tissue, u, f);
        for (int32_t i = 0; i < 3 * n; i++) assert_true(f[i] == 0);
        /* Displacements of removed vertices stay unchanged through the rotation of the three arrays of u. */
        fix_random random = {3};
        for (int32_t v = 30; v < n; v++) /* the first 30 are fixed */
            for (int i = 0; i < 3 && tm_tissue_mass_kg(s.tissue)[v] == 0; i++) f[3 * v + i] = fix_signed(&random);
        memcpy(u, f, sizeof(double) * 3 * (size_t)n);
        for (int step = 0; step < 5; step++) {
            assert_int_equal(tm_world_step(s.world, 1), TM_OK);
            u = tm_world_state(s.world)->u_m;
            for (int32_t v = 30; v < n; v++)
                if (tm_tissue_mass_kg(s.tissue)[v] == 0) assert_memory_equal(u + 3 * v, f + 3 * v, 3 * sizeof(double));
        }
        free(f);
        stop(&s);
        finish(&s);
    }
}

/* Repair removes only what it must: each tetrahedron that it removed, put back alone, would share no face with the
 * others or make the surface non-manifold. */
static void repair_removes_no_more_than_necessary(void **state) {
    (void)state;
    scene s = make(false, TM_DOUBLE);
    start(&s);
    const int32_t n = s.mesh->tet_count;
    int32_t *list = malloc(sizeof(int32_t) * (size_t)n), *gone = malloc(sizeof(int32_t) * (size_t)n), extra = 0;
    uint8_t *alive = malloc((size_t)n);
    for (int32_t t = 0; t < n; t++) list[t] = t;
    fix_random random = {77};
    cut_shuffle(list, n, &random);
    tm_tissue_def def = s.def;
    def.cuttable = false, def.alive = alive;
    for (int32_t i = 0; i < n; i++) {
        const int32_t count = tm_cut_remove(s.tissue, list + i, 1, gone, n);
        for (int32_t k = 1; k < count; k++, extra++) { /* the first is the requested one */
            memcpy(alive, tm_tissue_alive(s.tissue), (size_t)n);
            bool joined = false;
            for (int f = 0; f < 4; f++) {
                const int32_t other = s.mesh->tet_neighbour[4 * gone[k] + f];
                joined |= other >= 0 && alive[other];
            }
            if (!joined) continue;
            alive[gone[k]] = 1;
            tm_tissue *with = NULL;
            tm_error error;
            fix_ok(tm_tissue_create(&def, &with, &error), &error);
            if (!cut_not_manifold(with)) fail_msg("removal %d took %d, which could have stayed", i, gone[k]);
            tm_tissue_destroy(with);
        }
    }
    print_message("  %d tetrahedra went for others\n", extra);
    assert_true(extra > n / 4);
    free(list), free(gone), free(alive);
    stop(&s);
    finish(&s);
}

static void *no_alloc(size_t bytes, void *user) {
    (void)bytes, (void)user;
    fail_msg("an allocation while cutting");
    return NULL;
}
static void plain_free(void *memory, size_t bytes, void *user) {
    (void)bytes, (void)user;
    free(memory);
}

static void cuts_allocate_nothing(void **state) {
    (void)state;
    scene s = make(true, TM_DOUBLE);
    start(&s);
    tm_set_allocator(&(tm_allocator){no_alloc, plain_free, NULL});
    for (int32_t t = 0; t < s.mesh->tet_count; t += 3) {
        tm_cut_remove(s.tissue, &t, 1, NULL, 0);
        assert_int_equal(tm_world_step(s.world, 1), TM_OK);
    }
    tm_set_allocator(NULL);
    stop(&s);
    finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(parts_hanging_on_an_edge_are_removed),
                                       cmocka_unit_test(ring_around_a_vertex_is_opened),
                                       cmocka_unit_test(cuts_in_twenty_orders_equal_a_fresh_build),
                                       cmocka_unit_test(tissue_can_be_removed_completely),
                                       cmocka_unit_test(cuts_allocate_nothing),
                                       cmocka_unit_test(removed_tetrahedra_are_not_read),
                                       cmocka_unit_test(repair_removes_no_more_than_necessary)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
