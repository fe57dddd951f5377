/* Property test of cutting on an organ from a file: removes 95 % of the tetrahedra in random orders. After every
 * batch the bits equal a fresh build, the surface is manifold, and steps are finite. A mesh that no tissue can use
 * is reported and not counted. */
#ifndef TM_TEST_ORGAN_H
#define TM_TEST_ORGAN_H

#include "../cut_check.h"

#include "tensormass_io.h"

enum { ORDERS = 20 };

/* Returns whether the mesh was accepted. */
static inline bool organ_cut_down(const char *path, int orders, int batches, bool volume) {
    tm_mesh_file file;
    tm_error error;
    tm_mesh *mesh = NULL;
    tm_status status = tm_mesh_file_load(path, 1, &file, &error);
    if (!status) {
        status = tm_mesh_file_build(&file, &mesh, &error);
        tm_mesh_file_free(&file);
    }
    if (status) {
        print_message("  %s: refused, %s\n", path, error.message);
        return false;
    }
    tm_material material;
    fix_ok(tm_material_paper(1e4, 3e3, 1.2e4, 9e3, &material, &error), &error);
    double *fibre = fix_fibres(mesh, (const double[3]){1, 2, 2});
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.fibre = fibre, def.cuttable = true, def.form = TM_FORCE_PLAIN,
    def.strain_smoothing = volume;
    material.damping_1_s = 20;
    int32_t *same = calloc((size_t)mesh->region_count, sizeof *same); /* one material in every region */
    def.region_material = same;
    /* A foreign surface need not be a manifold at the start; then only bits are compared. */
    int32_t *order = malloc(sizeof(int32_t) * (size_t)mesh->tet_count), calls = 0;
    bool manifold = true;
    for (int k = 0; k < orders; k++) {
        fix_random random = {1000 + (uint64_t)k};
        def.material = &material;
        tm_tissue *tissue = NULL;
        fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
        manifold = !cut_not_manifold(tissue);
        tm_world *world = fix_world(tissue, true);
        fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
        for (int32_t t = 0; t < mesh->tet_count; t++) order[t] = t;
        if (k % 2)
            cut_order_from(mesh, order, &random);
        else
            cut_shuffle(order, mesh->tet_count, &random);
        calls += cut_down(tissue, &def, world, order, 0.95, mesh->tet_count / batches + 1, manifold);
        assert_true(tm_tissue_alive_count(tissue) <= mesh->tet_count / 20 + 1);
        tm_world_destroy(world);
        tm_tissue_destroy(tissue);
    }
    print_message("  %s: %d tetrahedra, %d orders, %d batches, surface %s\n", path, mesh->tet_count, orders, calls,
                  manifold ? "a manifold throughout" : "no manifold to begin with");
    free(order), free(fibre), free(same);
    tm_mesh_destroy(mesh);
    assert_int_equal(tm_memory_in_use(), 0);
    return true;
}

#endif
