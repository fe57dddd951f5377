/* Tissue with the long-term law: other shares of bulk modulus and rest. */
#include "tissue/tissue_internal.h"

tm_status tm_tissue_relaxed(const tm_tissue *tissue, double shear, double volume, tm_tissue **out, tm_error *error) {
    tm_pool pool = {0};
    tm_material *material = TM_TAKE(&pool, tm_material, tissue->material_count);
    if (!material) return tm_fail_memory(error, "relaxed tissue");
    for (int32_t i = 0; i < tissue->material_count; i++)
        material[i] = tm_material_relaxed(tissue->material + i, shear, volume);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = tissue->mesh;
    def.material_count = tissue->material_count, def.material = material;
    def.region_material = tissue->region_material, def.fibre = tissue->fibre;
    def.precision = tissue->precision, def.form = tissue->plain ? TM_FORCE_PLAIN : TM_FORCE_BEST;
    def.alive = tissue->alive;
    def.rotation = tissue->rotation;
    def.volume = tissue->smoothed;
    if (tissue->smoothed) def.volume_shear = tissue->smoothed->shear;
    const tm_status status = tm_tissue_create(&def, out, error);
    tm_pool_release(&pool);
    return status;
}
