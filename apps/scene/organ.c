/* Reads the mesh: regions, box, step. */
#include "organ.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double largest_m = 1.0, smallest_m = 5e-3, frame_s = 1.0 / 25;

static int check_size(const char *path, double scale, const organ *o) {
    if (o->size_m > largest_m)
        return app_bad_input(path, 0,
                             "the mesh is %.4g m across, too large for an organ; if its numbers are millimetres, add "
                             "--unit mm",
                             o->size_m);
    if (o->size_m < smallest_m)
        return app_bad_input(path, 0, "the mesh is %.4g mm across, too small for an organ%s", 1e3 * o->size_m,
                             scale < 1 ? "; leave --unit out if its numbers are metres" : "; name its --unit");
    return 0;
}

/* Finds each region's constants by its name, else by the title (the parenchyma of a liver). */
static void find_tissues(const char *title, organ *o) {
    for (int32_t r = 0; r < o->file.region_count; r++) {
        const tissue_constants *found = tissue_find(o->file.region_name[r]);
        if (!found) found = tissue_find(title);
        o->known[r] = found != NULL;
        o->tissue[r] = found ? found : &tissue_unknown;
    }
}

tm_status organ_tissue(const organ *o, bool cut, tm_tissue **tissue, tm_error *error) {
    const int32_t regions = o->file.region_count;
    tm_material *material = malloc(sizeof *material * (size_t)regions);
    int32_t *own = malloc(sizeof *own * (size_t)regions);
    tm_status status = material && own ? TM_OK : tm_fail(error, TM_ERR_MEMORY, -1, "no memory; use a coarser mesh");
    for (int32_t r = 0; r < regions && !status; r++) {
        own[r] = r;
        status = tm_material_young(o->tissue[r]->young_Pa, o->tissue[r]->poisson, &material[r], error);
        if (!status) material[r].density_kg_m3 = o->tissue[r]->density_kg_m3;
    }
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = o->mesh, def.material = material, def.material_count = regions, def.region_material = own;
    def.cuttable = cut;
    if (!status) status = tm_tissue_create(&def, tissue, error);
    free(material);
    free(own);
    return status;
}

static tm_status find_timing(bool cut, organ *o, tm_error *error) {
    tm_tissue *tissue = NULL;
    const tm_status status = organ_tissue(o, cut, &tissue, error);
    if (status) return status;
    o->step_s = 0.9 * tm_critical_step_guaranteed(tissue, NULL);
    o->substeps = (int)ceil(frame_s / o->step_s);
    tm_tissue_destroy(tissue);
    return TM_OK;
}

static void measure(organ *o) {
    for (int a = 0; a < 3; a++) o->low_m[a] = INFINITY, o->high_m[a] = -INFINITY;
    for (int32_t i = 0; i < 3 * o->mesh->vertex_count; i++) {
        o->low_m[i % 3] = fmin(o->low_m[i % 3], o->mesh->rest_m[i]);
        o->high_m[i % 3] = fmax(o->high_m[i % 3], o->mesh->rest_m[i]);
    }
    for (int a = 0; a < 3; a++) o->size_m = fmax(o->size_m, o->high_m[a] - o->low_m[a]);
}

int organ_load(const char *path, double scale, const char *up, const char *title, bool cut, organ *o) {
    tm_error error = {0};
    *o = (organ){0};
    const bool down = *up == '-';
    o->up_axis = up[down] - 'x';
    o->up[o->up_axis] = down ? -1 : 1;
    if (tm_mesh_file_load(path, scale, &o->file, &error)) return app_report(NULL, 0, &error);
    if (tm_mesh_file_build(&o->file, &o->mesh, &error)) return app_report(NULL, 0, &error);
    measure(o);
    int rc = check_size(path, scale, o);
    if (rc) return rc;
    o->tissue = calloc((size_t)o->file.region_count, sizeof *o->tissue);
    o->known = calloc((size_t)o->file.region_count, sizeof *o->known);
    if (!o->tissue || !o->known) return app_bad_input(path, 0, "no memory; use a coarser mesh") - 1;
    find_tissues(title, o);
    return find_timing(cut, o, &error) ? app_report(path, 0, &error) : 0;
}

void organ_free(organ *o) {
    for (int i = 0; i < o->supports; i++) free(o->support[i].vertex);
    free(o->tissue);
    free(o->known);
    tm_mesh_destroy(o->mesh);
    tm_mesh_file_free(&o->file);
    *o = (organ){0};
}
