/* Coarser meshes of the same organ: its surface filled anew by tm-mesh fill, with regions, groups and fibres of what
 * lies nearest. Surface and inner boundaries are then rounder than the scene's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "study.h"

static bool write_surface(const tm_mesh *mesh, const char *path) {
    tm_error error = {0};
    app_output output;
    if (!app_output_begin(&output, path, &error)) return false;
    FILE *file = app_output_stream(&output);
    if (file) fputs("solid organ\n", file);
    for (int32_t i = 0; file && i < mesh->surface_count; i++) {
        fputs("facet normal 0 0 0\nouter loop\n", file);
        for (int k = 0; k < 3; k++) {
            const double *p = mesh->rest_m + 3 * (size_t)mesh->surface[3 * (size_t)i + (size_t)k];
            fprintf(file, "vertex %.9g %.9g %.9g\n", p[0], p[1], p[2]);
        }
        fputs("endloop\nendfacet\n", file);
    }
    if (file) fputs("endsolid organ\n", file);
    return app_output_end(&output, file, &error);
}

/* The lattice has twelve tetrahedra in the cube of its longest edge. */
static double edge_m(const tm_mesh *mesh, double tets) {
    double volume_m3 = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) volume_m3 += mesh->volume_m3[t];
    return cbrt(12 * volume_m3 / tets);
}

static bool fill(const study *t, const sim *own, double factor, const char *surface, const char *path) {
    char size[40];
    snprintf(size, sizeof size, "%.9g", edge_m(own->mesh, own->mesh->tet_count / factor));
    const char *const argument[] = {"tm-mesh", "fill", "--size", size, "--unit", "m", surface, "-o", path, NULL};
    char *copy[sizeof argument / sizeof *argument];
    for (size_t i = 0; i < sizeof argument / sizeof *argument; i++) copy[i] = (char *)(uintptr_t)argument[i];
    return write_surface(own->mesh, surface) && study_run_mesh(t, copy);
}

/* Regions, groups and fibres into the mesh of `path`; how many tetrahedra it has, 0: cannot be. */
static int dress(const sim *own, study_mesh *m) {
    tm_mesh_file file = {0};
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    int tets = 0;
    if (!tm_mesh_file_load(m->path, 1, &file, &error) && !tm_mesh_file_build(&file, &mesh, &error)) {
        double *fibre = calloc(3 * (size_t)mesh->tet_count + 1, sizeof *fibre);
        if (!fibre) abort();
        const bool good = study_transfer(own, mesh, m->path, fibre) &&
                          (!own->fibre || study_write_fibres(fibre, mesh->tet_count, m->fibres));
        tets = good ? mesh->tet_count : 0;
        free(fibre);
    }
    tm_mesh_destroy(mesh);
    tm_mesh_file_free(&file);
    return tets;
}

bool study_coarsen(study *t, const sim *own, double factor, const char *name) {
    study_mesh *m = &t->mesh[t->mesh_count];
    char surface[1024];
    *m = (study_mesh){.made = true, .foreign = true};
    snprintf(m->path, sizeof m->path, "%.990s/%.8s.msh", t->folder, name);
    snprintf(surface, sizeof surface, "%.990s/surface.stl", t->folder);
    if (own->fibre) snprintf(m->fibres, sizeof m->fibres, "%.990s/%.8s.fibres.csv", t->folder, name);
    if (fill(t, own, factor, surface, m->path)) m->tets = dress(own, m);
    unlink(surface);
    if (!m->tets || m->tets > own->mesh->tet_count) {
        unlink(m->path);
        app_remark("tm-accuracy: no mesh of %.3g times fewer tetrahedra holds this organ's surface, regions and groups",
                   factor);
        return false;
    }
    snprintf(m->name, sizeof m->name, "%s mesh, %d tetrahedra", name, m->tets);
    t->mesh_count++;
    return true;
}
