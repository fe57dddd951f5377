/* Steps one body with effects, one without, or both in one world, under callgrind, for
 * tests/effects/test_plain_body.py.
 *
 * body_effects with|without|both EFFECTS FRAMES
 * EFFECTS: the sum of tm_region_effect that act in the first body. Prints the bytes in use. */
#include "../fixture.h"

enum { SUBSTEPS = 10 };

/* Makes the bodies [first, last): blocks at a distance, each a region. */
static tm_mesh *make_bodies(int first, int last) {
    tm_mesh *block = fix_block((const int[3]){9, 6, 6}, (const double[3]){0.09, 0.06, 0.06}, 0.1, &(fix_random){7});
    const int32_t v = block->vertex_count, t = block->tet_count, bodies = last - first;
    double *vertex = malloc(sizeof *vertex * 3 * (size_t)(bodies * v));
    int32_t *tet = malloc(sizeof *tet * 4 * (size_t)(bodies * t)),
            *region = malloc(sizeof *region * (size_t)(bodies * t));
    for (int b = 0; b < bodies; b++) {
        for (int32_t i = 0; i < 3 * v; i++) vertex[3 * b * v + i] = block->rest_m[i] + (i % 3 ? 0 : 0.3 * (first + b));
        for (int32_t i = 0; i < 4 * t; i++) tet[4 * b * t + i] = block->tet[i] + b * v;
        for (int32_t i = 0; i < t; i++) region[b * t + i] = b;
    }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = bodies * v, def.vertex_m = vertex, def.tet_count = bodies * t, def.tet = tet,
    def.region = region;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(vertex), free(tet), free(region);
    tm_mesh_destroy(block);
    return mesh;
}

static void add_effects(tm_world *world, int effects) {
    tm_error error;
    tm_viscosity_def series = tm_viscosity_def_default();
    series.count = 1, series.term[0] = (tm_viscosity_term){0.1, 0.3, 0.1};
    if (effects & TM_REGION_ROTATION) fix_ok(tm_stage_rotation(world, NULL, &error), &error);
    if (effects & TM_REGION_VISCOSITY) fix_ok(tm_stage_viscosity(world, &series, &error), &error);
}

/* Moves the tissue as a rotation would, by a tenth of a radian. */
static void turn(tm_world *world, const tm_mesh *mesh) {
    tm_state *s = tm_world_state(world);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        s->u_m[3 * v + 1] = s->u_prev_m[3 * v + 1] = -0.1 * mesh->rest_m[3 * v + 2];
        s->u_m[3 * v + 2] = s->u_prev_m[3 * v + 2] = 0.1 * mesh->rest_m[3 * v + 1];
    }
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    const bool without = !strcmp(argv[1], "without"), both = !strcmp(argv[1], "both");
    const int effects = without ? 0 : atoi(argv[2]);
    tm_mesh *mesh = make_bodies(without ? 1 : 0, without || both ? 2 : 1);
    const uint8_t of[2] = {(uint8_t)effects, 0};
    tm_material material[2];
    tm_error error;
    for (int b = 0; b < 2; b++) fix_ok(tm_material_young(4e3, 0.4, material + b, &error), &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = mesh->region_count, def.material = material;
    def.form = TM_FORCE_PLAIN, def.region_effects = of;
    def.rotation = effects & TM_REGION_ROTATION ? 0.02 : 0, def.strain_smoothing = effects & TM_REGION_SMOOTHING;
    tm_tissue *tissue = NULL;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    tm_world *world = fix_world(tissue, false);
    add_effects(world, effects);
    printf("%lld\n", (long long)tm_memory_in_use());
    turn(world, mesh);
    for (int i = 0; i < atoi(argv[3]); i++)
        if (tm_world_step(world, SUBSTEPS)) return 1;
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    return 0;
}
