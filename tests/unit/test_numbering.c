/* Internally renumbered meshes: what stays, conversion back, original numbers in messages, exhausted memory. */
#include "../allocator.h"

/* A block and the same one numbered at random. */
typedef struct numbered {
    int32_t count, tets;
    double *vertex_m;
    int32_t *tet, *region;
} numbered;

static numbered numbered_block(int cells, bool at_random) {
    fix_random random = {7};
    tm_mesh *mesh = fix_block((int[3]){cells, cells, cells}, (double[3]){0.1, 0.1, 0.1}, 0.2, &random);
    const int32_t n = mesh->vertex_count;
    numbered b = {n, mesh->tet_count, malloc(24 * (size_t)n), malloc(16 * (size_t)mesh->tet_count),
                  malloc(4 * (size_t)mesh->tet_count)};
    int32_t *now = malloc(4 * (size_t)n);
    for (int32_t v = 0; v < n; v++) now[v] = v;
    for (int32_t v = n - 1; v > 0 && at_random; v--) {
        const int32_t w = (int32_t)(fix_uniform(&random) * (v + 1)), other = now[w];
        now[w] = now[v], now[v] = other;
    }
    for (int32_t v = 0; v < n; v++) memcpy(b.vertex_m + 3 * now[v], mesh->rest_m + 3 * v, 24);
    for (int32_t i = 0; i < 4 * b.tets; i++) b.tet[i] = now[mesh->tet[i]];
    for (int32_t t = 0; t < b.tets; t++) b.region[t] = t % 3;
    tm_mesh_destroy(mesh);
    free(now);
    return b;
}

static void give(numbered *b) {
    free(b->vertex_m);
    free(b->tet);
    free(b->region);
}

static tm_mesh_def def_of(const numbered *b, tm_numbering renumber) {
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = b->count, def.vertex_m = b->vertex_m;
    def.tet_count = b->tets, def.tet = b->tet, def.region = b->region;
    def.renumber = renumber;
    return def;
}

static tm_mesh *build(const numbered *b, tm_numbering renumber) {
    const tm_mesh_def def = def_of(b, renumber);
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    return mesh;
}

static double distance(const tm_mesh *mesh) {
    double sum = 0;
    for (int32_t e = 0; e < mesh->edge_count; e++) sum += mesh->edge[2 * e + 1] - mesh->edge[2 * e];
    return sum / mesh->edge_count;
}

static void meshes_of_large_bandwidth_are_renumbered(void **state) {
    (void)state;
    numbered b = numbered_block(10, true);
    tm_mesh *as_given = build(&b, TM_NUMBERING_ORIGINAL), *mesh = build(&b, TM_NUMBERING_IMPROVED);
    assert_null(as_given->original_vertex);
    assert_non_null(mesh->original_vertex);
    assert_true(distance(as_given) > 3 * distance(mesh));
    uint8_t *seen = calloc((size_t)b.count, 1);
    for (int32_t v = 0; v < b.count; v++) {
        const int32_t given = tm_mesh_original_vertex(mesh, v);
        assert_int_equal(given, mesh->original_vertex[v]);
        assert_int_equal(seen[given]++, 0);
        assert_memory_equal(mesh->rest_m + 3 * v, b.vertex_m + 3 * given, 24);
        assert_int_equal(tm_mesh_original_vertex(as_given, v), v);
    }
    free(seen);
    for (int32_t i = 0; i < 4 * b.tets; i++) assert_int_equal(tm_mesh_original_vertex(mesh, mesh->tet[i]), b.tet[i]);
    /* Tetrahedra, corners and faces keep their numbers, and shapes every bit. */
    assert_memory_equal(mesh->region, b.region, 4 * (size_t)b.tets);
    assert_memory_equal(mesh->tet_neighbour, as_given->tet_neighbour, 16 * (size_t)b.tets);
    assert_int_equal(mesh->surface_count, as_given->surface_count);
    assert_memory_equal(mesh->surface_face, as_given->surface_face, 4 * (size_t)mesh->surface_count);
    assert_memory_equal(mesh->shape_1_m, as_given->shape_1_m, 96 * (size_t)b.tets);
    assert_memory_equal(mesh->volume_m3, as_given->volume_m3, 8 * (size_t)b.tets);
    tm_numbering_stats inside, given;
    assert_true(tm_mesh_numbering_measure(mesh, &inside) && tm_mesh_numbering_measure(as_given, &given));
    assert_true(inside.should_renumber && given.should_renumber && inside.distance == given.distance);
    assert_true(inside.renumbered == given.renumbered && fabs(given.renumbered / distance(mesh) - 1) < 1e-12);
    tm_mesh_destroy(as_given);
    tm_mesh_destroy(mesh);
    give(&b);
}

static void values_convert_there_and_back(void **state) {
    (void)state;
    numbered b = numbered_block(10, true);
    tm_mesh *mesh = build(&b, TM_NUMBERING_IMPROVED), *as_given = build(&b, TM_NUMBERING_ORIGINAL);
    double *to = malloc(24 * (size_t)b.count), *back = malloc(24 * (size_t)b.count);
    tm_mesh_to_original(mesh, 3, mesh->rest_m, to);
    assert_memory_equal(to, b.vertex_m, 24 * (size_t)b.count);
    tm_mesh_from_original(mesh, 3, to, back);
    assert_memory_equal(back, mesh->rest_m, 24 * (size_t)b.count);
    tm_mesh_to_original(as_given, 1, b.vertex_m, to);
    assert_memory_equal(to, b.vertex_m, 8 * (size_t)b.count);
    free(to);
    free(back);
    tm_mesh_destroy(mesh);
    tm_mesh_destroy(as_given);
    give(&b);
}

static void meshes_in_order_keep_their_numbers(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) { /* in order; at random, but small */
        numbered b = numbered_block(i ? 4 : 10, i);
        tm_mesh *mesh = build(&b, TM_NUMBERING_IMPROVED), *as_given = build(&b, TM_NUMBERING_ORIGINAL);
        assert_null(mesh->original_vertex);
        assert_memory_equal(mesh->rest_m, b.vertex_m, 24 * (size_t)b.count);
        assert_memory_equal(mesh->tet, b.tet, 16 * (size_t)b.tets);
        assert_true(mesh->bytes == as_given->bytes);
        tm_mesh_destroy(mesh);
        tm_mesh_destroy(as_given);
        give(&b);
    }
}

/* Two values for one component: the message and `entity` give the vertex's original number. */
static void messages_give_the_original_number(void **state) {
    (void)state;
    numbered b = numbered_block(10, true);
    tm_mesh *mesh = build(&b, TM_NUMBERING_IMPROVED);
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.4, &material, &error), &error);
    material.density_kg_m3 = 1000;
    const tm_material all[3] = {material, material, material};
    tm_tissue_def tissue_def = tm_tissue_def_default();
    tissue_def.mesh = mesh, tissue_def.material_count = 3, tissue_def.material = all;
    tm_tissue *tissue;
    fix_ok(tm_tissue_create(&tissue_def, &tissue, &error), &error);
    tm_world *world = fix_world(tissue, false);
    int32_t v = 0;
    while (tm_mesh_original_vertex(mesh, v) == v) v++;
    char named[40];
    snprintf(named, sizeof named, "vertex %d ", tm_mesh_original_vertex(mesh, v));
    tm_support_def support = tm_support_def_default();
    support.count = 2, support.dof = (int32_t[2]){3 * v, 3 * v}, support.value_m = (double[2]){0, 1e-3};
    assert_int_equal(tm_stage_support(world, &support, &error), TM_ERR_SUPPORT);
    assert_int_equal(error.entity, tm_mesh_original_vertex(mesh, v));
    assert_non_null(strstr(error.message, named));
    double *load = calloc(3 * (size_t)b.count, sizeof *load);
    load[3 * v + 1] = NAN;
    assert_int_equal(tm_stage_load(world, load, &error), TM_ERR_ARGUMENT);
    assert_int_equal(error.entity, tm_mesh_original_vertex(mesh, v));
    assert_non_null(strstr(error.message, named));
    free(load);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    /* Also for a defect of the mesh itself. */
    b.tet[4 * 5] = b.tet[4 * 5 + 1];
    const tm_mesh_def def = def_of(&b, TM_NUMBERING_IMPROVED);
    tm_mesh *none = NULL;
    snprintf(named, sizeof named, "it has vertex %d twice", b.tet[4 * 5]);
    assert_int_equal(tm_mesh_create(&def, &none, &error), TM_ERR_MESH);
    assert_non_null(strstr(error.message, named));
    assert_null(none);
    tm_mesh_destroy(mesh);
    give(&b);
}

static void bad_value_is_refused(void **state) {
    (void)state;
    numbered b = numbered_block(2, false);
    const tm_mesh_def def = def_of(&b, (tm_numbering)7);
    tm_mesh *mesh = NULL;
    tm_error error;
    assert_int_equal(tm_mesh_create(&def, &mesh, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "renumber is 7"));
    assert_null(mesh);
    give(&b);
}

static void renumbering_without_memory_fails_cleanly(void **state) {
    (void)state;
    numbered b = numbered_block(10, true);
    const tm_mesh_def def = def_of(&b, TM_NUMBERING_IMPROVED);
    int failures = 0;
    for (tm_status status = TM_ERR_MEMORY; status; failures++) {
        tm_mesh *mesh = NULL;
        tm_error error;
        hook_install(failures + 1);
        status = tm_mesh_create(&def, &mesh, &error);
        assert_true(status == TM_OK ? mesh != NULL : status == TM_ERR_MEMORY && !mesh);
        tm_mesh_destroy(mesh);
        hook_check_empty();
    }
    assert_true(failures > 50); /* two meshes and the conversion between them */
    tm_set_allocator(NULL);
    give(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_of_large_bandwidth_are_renumbered),
        cmocka_unit_test(values_convert_there_and_back),
        cmocka_unit_test(meshes_in_order_keep_their_numbers),
        cmocka_unit_test(messages_give_the_original_number),
        cmocka_unit_test(bad_value_is_refused),
        cmocka_unit_test(renumbering_without_memory_fails_cleanly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
