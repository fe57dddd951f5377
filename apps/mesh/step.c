/* Computes critical steps of a mesh with one material, and the cost per simulated second. */
#include "step.h"

#include <math.h>
#include <stdlib.h>

#include "command.h"
#include "common/bandwidth.h"
#include "libtensormass/numeric/order.h"
#include "tensormass/world.h"

/* Makes a tissue of one material. */
static tm_status make_tissue(const tm_mesh *mesh, double young_Pa, double poisson, double density_kg_m3,
                             tm_tissue **tissue, tm_error *error) {
    tm_material material;
    tm_status status = tm_material_young(young_Pa, poisson, &material, error);
    if (status) return status;
    material.density_kg_m3 = density_kg_m3;
    int32_t *one = calloc((size_t)mesh->region_count + 1, sizeof *one);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh;
    def.material_count = 1;
    def.material = &material;
    def.region_material = one;
    status = one ? tm_tissue_create(&def, tissue, error) : tm_fail(error, TM_ERR_MEMORY, -1, "no memory");
    free(one);
    return status;
}

tm_status step_measure(const tm_mesh *mesh, double young_Pa, double poisson, double density_kg_m3, step_figures *out,
                       tm_error *error) {
    tm_tissue *tissue = NULL;
    tm_status status = make_tissue(mesh, young_Pa, poisson, density_kg_m3, &tissue, error);
    if (status) return status;
    double *step = malloc((size_t)mesh->tet_count * sizeof *step);
    if (!step) {
        tm_tissue_destroy(tissue);
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory");
    }
    *out = (step_figures){.cut_s = HUGE_VAL};
    out->guaranteed_s = tm_critical_step_guaranteed(tissue, &out->tet);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        step[t] = tm_critical_step_element(tissue, t);
        if (step[t] >= out->cut_s) continue;
        out->cut_s = step[t];
        out->cut_tet = t;
    }
    num_sort(step, mesh->tet_count);
    out->median_s = step[mesh->tet_count / 2];
    free(step);
    tm_tissue_destroy(tissue);
    return TM_OK;
}

/* Returns the minimum time per step of several short runs, s. */
static double time_step(tm_world *world) {
    double best = HUGE_VAL;
    for (int run = 0; run < 8; run++) {
        const double from = app_seconds();
        tm_world_step(world, 20);
        best = fmin(best, (app_seconds() - from) / 20);
    }
    return best;
}

static tm_status measure_load(const tm_mesh *mesh, double young_Pa, double poisson, double density_kg_m3, double *load,
                              tm_error *error) {
    tm_tissue *tissue = NULL;
    tm_world *world = NULL;
    step_figures figures;
    tm_status status = step_measure(mesh, young_Pa, poisson, density_kg_m3, &figures, error);
    if (!status) status = make_tissue(mesh, young_Pa, poisson, density_kg_m3, &tissue, error);
    if (!status) {
        tm_world_def def = tm_world_def_default();
        static const double g[3] = {0, 0, -9.81};
        def.tissue = tissue;
        def.dt_s = def.step_fraction * figures.cut_s;
        status = tm_world_create(&def, &world, error);
        if (!status) status = tm_stage_gravity(world, g, error);
        if (!status) *load = time_step(world) / def.dt_s;
    }
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    return status;
}

int step_load(const char *file, const image_tets *tets, double young_Pa, double poisson, double density_kg_m3,
              double *load) {
    tm_mesh_def def = tm_mesh_def_default();
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    def.vertex_count = tets->vertices;
    def.vertex_m = tets->vertex_m;
    def.tet_count = tets->tets;
    def.tet = tets->tet;
    tm_status status = tm_mesh_create(&def, &mesh, &error);
    if (!status) status = measure_load(mesh, young_Pa, poisson, density_kg_m3, load, &error);
    tm_mesh_destroy(mesh);
    return status ? app_report(file, 0, &error) : APP_DONE;
}
