/* Creates tissue: checks its definition and copies it. */
#include "material/hyperelastic.h"

#include <math.h>
#include <string.h>

#include "tissue/cut_work.h"
#include "tissue/strain_smoothing_pairs.h"
#include "tissue/tissue_internal.h"

tm_tissue_def tm_tissue_def_default(void) {
    return (tm_tissue_def){
        .cookie = TM_COOKIE_TISSUE, .size = sizeof(tm_tissue_def), .smoothed_shear_share = 0.4, .scaled_share = 0.2};
}

void tm_tissue_destroy(tm_tissue *tissue) {
    if (!tissue) return;
    tm_pool pool = tissue->pool;
    tm_pool_release(&pool);
}

/* --- building --- */

static tm_status check_volume(const tm_tissue_def *def, tm_error *error) {
    if (!def->strain_smoothing) return TM_OK;
    if (!(def->smoothed_shear_share >= 0 && def->smoothed_shear_share <= 1))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "smoothed_shear_share = %g; give a share from 0 to 1",
                       def->smoothed_shear_share);
    if (def->precision == TM_SINGLE)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "strain smoothing needs double precision; set precision to TM_DOUBLE, or leave strain_smoothing out");
    if (def->extra_mass_kg || def->extra_damping_kg_s || def->condensed)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "strain smoothing cannot average across the interface of a condensed part; leave one of them out");
    return TM_OK;
}

static tm_status check_extra(const tm_mesh *mesh, const double *extra, const char *what, tm_error *error) {
    for (int32_t v = 0; extra && v < mesh->vertex_count; v++)
        if (!(extra[v] >= 0) || !isfinite(extra[v]))
            return tm_fail(error, TM_ERR_ARGUMENT, tm_mesh_original_vertex(mesh, v),
                           "vertex %d: extra %s is %g; give 0 or more", tm_mesh_original_vertex(mesh, v), what,
                           extra[v]);
    return TM_OK;
}

static tm_status check_regions(const tm_tissue_def *def, tm_error *error) {
    if ((def->precision != TM_DOUBLE && def->precision != TM_SINGLE) ||
        (def->form != TM_FORCE_BEST && def->form != TM_FORCE_PLAIN))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "precision is %d, form is %d; give a value of tm_precision and one of tm_force_form",
                       (int)def->precision, (int)def->form);
    if (def->material_count < 1 || !def->material)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the tissue has no material; give at least one");
    for (int32_t i = 0; i < def->material_count; i++) {
        const tm_status status = tm_material_check(def->material + i, error);
        if (status) {
            if (error) error->entity = i;
            return status;
        }
    }
    for (int32_t r = 0; r < def->mesh->region_count; r++) {
        const int32_t m = def->region_material ? def->region_material[r] : r;
        if (m < 0 || m >= def->material_count)
            return tm_fail(error, TM_ERR_ARGUMENT, r, "region %d: has material %d of %d; give every region a material",
                           r, m, def->material_count);
    }
    return TM_OK;
}

static bool has_different_effects(const tm_tissue_def *def) {
    for (int32_t r = 0; def->region_effects && r < def->mesh->region_count; r++)
        if ((def->region_effects[r] & TM_REGION_EFFECTS) != TM_REGION_EFFECTS) return true;
    return false;
}

/* Returns whether both effects act in a region. */
static bool effects_meet(const tm_tissue_def *def, tm_region_effect a, tm_region_effect b) {
    bool meet = !def->region_effects;
    for (int32_t r = 0; !meet && r < def->mesh->region_count; r++)
        meet = (def->region_effects[r] & a) && (def->region_effects[r] & b);
    return meet;
}

static tm_status check_rotation(const tm_tissue_def *def, tm_error *error) {
    if (def->rotation == 0) return TM_OK;
    if (!(def->rotation >= TM_ROTATION_THRESHOLD_MIN && def->rotation <= TM_ROTATION_THRESHOLD_MAX))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the rotation threshold is %g; give 0 (no rotation) or %g to %g",
                       def->rotation, TM_ROTATION_THRESHOLD_MIN, TM_ROTATION_THRESHOLD_MAX);
    if (def->strain_smoothing && has_different_effects(def) &&
        effects_meet(def, TM_REGION_ROTATION, TM_REGION_SMOOTHING))
        return tm_fail(
            error, TM_ERR_EXCLUDED, -1,
            "rotation and strain smoothing act in the same region, and regions differ in an effect: the "
            "averages of rotated tetrahedra are computed for all regions; give all regions the same effects");
    if (def->strain_smoothing && def->smoothed_shear_share != 0 &&
        effects_meet(def, TM_REGION_ROTATION, TM_REGION_SMOOTHING))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "rotation excludes smoothed_shear_share = %g: shears of rotated tetrahedra are not averaged; give "
            "0, or leave rotation or strain_smoothing out",
            def->smoothed_shear_share);
    return TM_OK;
}

/* Refuses effects that differ between regions with a common vertex. */
static tm_status check_effects(const tm_tissue_def *def, tm_error *error) {
    const tm_mesh *mesh = def->mesh;
    for (int32_t v = 0; def->region_effects && v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v] + 1; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t a = mesh->region[mesh->vertex_tet[i - 1]], b = mesh->region[mesh->vertex_tet[i]];
            if (def->region_effects[a] == def->region_effects[b]) continue;
            return tm_fail(error, TM_ERR_ARGUMENT, tm_mesh_original_vertex(mesh, v),
                           "regions %d and %d share vertex %d and have different region_effects; give all regions of a "
                           "body the same effects",
                           (int)a, (int)b, tm_mesh_original_vertex(mesh, v));
        }
    return TM_OK;
}

/* Rejects settings that nonlinear laws do not support yet. */
static tm_status check_law(const tm_tissue_def *def, tm_error *error) {
    int32_t other = -1;
    for (int32_t i = 0; i < def->material_count; i++)
        if (def->material[i].law != TM_LAW_LINEAR) other = i;
    if (other < 0) return TM_OK;
    const char *name = tm_law_name((tm_law_kind)def->material[other].law), *with = NULL;
    if (def->rotation > 0) with = "rotation, which a nonlinear law includes";
    if (def->strain_smoothing && def->smoothed_shear_share != 0)
        with = "averaged shear, which rotated tetrahedra do not support (give smoothed_shear_share = 0)";
    if (def->extra_mass_kg || def->extra_damping_kg_s || def->condensed) with = "a condensed part, which is linear";
    for (int32_t r = 0; def->strain_smoothing && def->region_effects && r < def->mesh->region_count; r++)
        if (!(def->region_effects[r] & TM_REGION_SMOOTHING))
            with = "strain smoothing of some regions only, as its averages are computed for all";
    return with ? tm_fail(error, TM_ERR_EXCLUDED, -1, "law %s excludes %s; leave one of them out", name, with) : TM_OK;
}

static void find_stiffest(tm_tissue *tissue) {
    for (int32_t i = 0; tissue->stiffest_Pa && i < tissue->material_count; i++)
        tissue->stiffest_Pa[i] = tm_law_stiffest_Pa(tissue->material + i, tissue->smoothed);
}

static tm_status check_scaling(const tm_tissue_def *def, tm_error *error) {
    if (def->scaled_step_s == 0) return TM_OK;
    if (!(def->scaled_step_s > 0 && isfinite(def->scaled_step_s)) || !(def->scaled_share >= 0))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "mass scaling to a step of %g s, by at most %g of the physical mass; give a positive step and share",
            def->scaled_step_s, def->scaled_share);
    if (def->extra_mass_kg || def->extra_damping_kg_s || def->condensed)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "mass scaling does not support a condensed part; leave one of them out");
    return TM_OK;
}

static bool has_direction(const tm_material *m) {
    return tm_law_needs_fibre((tm_law_kind)m->law) || !tm_material_is_isotropic(m);
}

static tm_status check_fibres(const tm_tissue_def *def, tm_error *error) {
    for (int32_t t = 0; t < def->mesh->tet_count; t++) {
        const int32_t r = def->mesh->region[t];
        const tm_material *m = def->material + (def->region_material ? def->region_material[r] : r);
        if (!has_direction(m)) continue;
        if (!def->fibre)
            return tm_fail(
                error, TM_ERR_ARGUMENT, t,
                "tetrahedron %d: region %d is anisotropic and has no fibre; give a fibre for each tetrahedron", t, r);
        const double length = sqrt(vdot(def->fibre + 3 * (int64_t)t, def->fibre + 3 * (int64_t)t));
        if (!(fabs(length - 1) <= 1e-3))
            return tm_fail(
                error, TM_ERR_ARGUMENT, t, "tetrahedron %d: its fibre (%g %g %g) has length %g; give unit vectors", t,
                def->fibre[3 * (int64_t)t], def->fibre[3 * (int64_t)t + 1], def->fibre[3 * (int64_t)t + 2], length);
    }
    return TM_OK;
}

static bool any_anisotropic(const tm_tissue_def *def) {
    for (int32_t i = 0; i < def->material_count; i++)
        if (has_direction(def->material + i)) return true;
    return false;
}

static bool any_nonlinear(const tm_tissue_def *def) {
    for (int32_t i = 0; i < def->material_count; i++)
        if (def->material[i].law != TM_LAW_LINEAR) return true;
    return false;
}

/* Tensors of tissue with a nonlinear law stay double: only tangents use them. */
static tm_precision tensor_precision(const tm_tissue_def *def) {
    return any_nonlinear(def) ? TM_DOUBLE : def->precision;
}

static void alloc_graph(tm_force_graph *graph, tm_pool *pool, const tm_mesh *mesh, int32_t pairs,
                        tm_precision precision) {
    graph->vertex_count = mesh->vertex_count;
    graph->active = TM_ALLOC(pool, uint64_t, mesh->vertex_count / 64 + 1);
    graph->upper_begin = TM_ALLOC(pool, int32_t, (int64_t)mesh->vertex_count + 1);
    graph->upper_end = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    graph->upper_vertex = TM_ALLOC(pool, int32_t, pairs);
    graph->vertex_tensor = TM_ALLOC(pool, double, 9 * (int64_t)mesh->vertex_count + TM_FORCE_PADDING);
    if (precision == TM_SINGLE) {
        graph->edge_tensor = TM_ALLOC(pool, float, 9 * (int64_t)pairs + TM_FORCE_PADDING);
        return;
    }
    graph->edge_tensor = TM_ALLOC(pool, double, 8 * (int64_t)pairs);
    graph->edge_last = TM_ALLOC(pool, double, pairs);
}

static void alloc_pairs(tm_tissue *tissue, tm_pool *pool, const tm_tissue_def *def) {
    tissue->pair = def->mesh->edge;
    tissue->pair_count = def->mesh->edge_count;
    if (!def->strain_smoothing) return;
    if (!tm_smoothed_init(tissue, def, pool)) pool->failed = true;
    tissue->pair = pool->failed ? NULL : tissue->rows->pair;
    tissue->pair_count = pool->failed ? 0 : tissue->rows->pair_count;
}

static void init(tm_tissue *tissue, tm_pool *pool, const tm_tissue_def *def) {
    const tm_mesh *mesh = tissue->mesh = def->mesh;
    tissue->material = TM_ALLOC(pool, tm_material, def->material_count);
    tissue->region_material = TM_ALLOC(pool, int32_t, mesh->region_count);
    if (def->fibre && any_anisotropic(def)) tissue->fibre = TM_ALLOC(pool, double, 3 * (int64_t)mesh->tet_count);
    if (any_nonlinear(def)) tissue->stiffest_Pa = TM_ALLOC(pool, double, def->material_count);
    if (has_different_effects(def)) tissue->effects = TM_ALLOC(pool, uint8_t, mesh->region_count);
    tissue->alive = TM_ALLOC(pool, uint8_t, mesh->tet_count);
    tissue->mass_kg = TM_ALLOC(pool, double, mesh->vertex_count);
    tissue->damping_kg_s = TM_ALLOC(pool, double, mesh->vertex_count);
    tissue->physical_mass_kg = tissue->mass_kg;
    if (def->scaled_step_s > 0) {
        tissue->physical_mass_kg = TM_ALLOC(pool, double, mesh->vertex_count);
        tissue->required_mass_kg = TM_ALLOC(pool, double, 4 * (int64_t)mesh->tet_count);
    }
    if (def->condensed) tissue->condensed = TM_ALLOC(pool, uint8_t, mesh->tet_count);
    if (def->extra_mass_kg) tissue->extra_mass_kg = TM_ALLOC(pool, double, mesh->vertex_count);
    if (def->extra_damping_kg_s) tissue->extra_damping_kg_s = TM_ALLOC(pool, double, mesh->vertex_count);
    alloc_pairs(tissue, pool, def);
    alloc_graph(&tissue->graph, pool, mesh, tissue->pair_count, tensor_precision(def));
    if (def->cuttable || def->alive) tissue->edge_index = TM_ALLOC(pool, int32_t, tissue->pair_count);
    if (def->cuttable && !def->strain_smoothing) {
        if (tensor_precision(def) == TM_DOUBLE)
            tissue->vertex_block = TM_ALLOC(pool, double, 36 * (int64_t)mesh->tet_count);
        tissue->edge_block = TM_ALLOC(pool, double, 54 * (int64_t)mesh->tet_count);
    }
    if (def->cuttable) {
        tissue->vertex_share = TM_ALLOC(pool, double, 8 * (int64_t)mesh->tet_count);
        tissue->face_slot = TM_ALLOC(pool, int32_t, 4 * (int64_t)mesh->tet_count);
        tissue->cut = tm_cut_init_work(pool, mesh);
    }
    if (def->cuttable || def->alive) {
        const int64_t faces = tm_tissue_faces_max(mesh);
        tissue->surface_triangle = TM_ALLOC(pool, int32_t, 3 * faces);
        tissue->surface_face = TM_ALLOC(pool, int32_t, faces);
    }
}

static void set_capacities(tm_force_graph *graph, const int32_t *pair, int32_t pairs) {
    int32_t apart = 0;
    for (int32_t p = 0; p < pairs; p++) {
        const int32_t k = pair[2 * (int64_t)p], l = pair[2 * (int64_t)p + 1];
        graph->upper_begin[k + 1]++;
        if (l - k > apart) apart = l - k;
    }
    for (int32_t v = 0; v < graph->vertex_count; v++) graph->upper_begin[v + 1] += graph->upper_begin[v];
    if (apart >= TM_FORCE_RING) return;
    graph->ring = 16;
    while (graph->ring <= apart) graph->ring *= 2;
}

static void copy_constants(tm_tissue *tissue, const tm_tissue_def *def) {
    const tm_mesh *mesh = def->mesh;
    tissue->material_count = def->material_count;
    tissue->precision = tensor_precision(def);
    tissue->has_single_law = def->precision == TM_SINGLE && (any_nonlinear(def) || def->rotation > 0);
    tissue->cuttable = def->cuttable;
    tissue->plain = def->form == TM_FORCE_PLAIN;
    tissue->rotation = def->rotation;
    tissue->scaled_step_s = def->scaled_step_s;
    tissue->force = tm_force_choose(def->form == TM_FORCE_PLAIN, tissue->precision == TM_SINGLE);
    if (def->extra_mass_kg)
        memcpy(tissue->extra_mass_kg, def->extra_mass_kg, sizeof(double) * (size_t)mesh->vertex_count);
    if (def->extra_damping_kg_s)
        memcpy(tissue->extra_damping_kg_s, def->extra_damping_kg_s, sizeof(double) * (size_t)mesh->vertex_count);
    for (int32_t r = 0; tissue->effects && r < mesh->region_count; r++)
        tissue->effects[r] = def->region_effects[r] & TM_REGION_EFFECTS;
    memcpy(tissue->material, def->material, sizeof(tm_material) * (size_t)def->material_count);
    for (int32_t r = 0; r < mesh->region_count; r++)
        tissue->region_material[r] = def->region_material ? def->region_material[r] : r;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        tissue->alive[t] = !def->alive || def->alive[t];
        tissue->alive_count += tissue->alive[t];
        if (def->condensed) tissue->condensed[t] = def->condensed[t] && !tissue->alive[t];
        if (!tissue->fibre) continue;
        const double *a = def->fibre + 3 * (int64_t)t;
        const double length = sqrt(vdot(a, a));
        for (int i = 0; i < 3; i++)
            tissue->fibre[3 * (int64_t)t + i] = length > 0 && isfinite(length) ? a[i] / length : 0;
    }
    set_capacities(&tissue->graph, tissue->pair, tissue->pair_count);
}

tm_status tm_tissue_create(const tm_tissue_def *def, tm_tissue **tissue, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_TISSUE, TM_ERR_ARGUMENT);
    TM_REQUIRE(tissue && def->mesh, "tissue or def->mesh is null", TM_ERR_ARGUMENT);
    tm_status status = check_regions(def, error);
    if (!status) status = check_fibres(def, error);
    if (!status) status = check_effects(def, error);
    if (!status) status = check_volume(def, error);
    if (!status) status = check_rotation(def, error);
    if (!status) status = check_law(def, error);
    if (!status) status = check_scaling(def, error);
    if (!status) status = check_extra(def->mesh, def->extra_mass_kg, "mass", error);
    if (!status) status = check_extra(def->mesh, def->extra_damping_kg_s, "damping", error);
    if (status) return status;

    tm_pool pool = {0};
    tm_tissue *t = TM_ALLOC(&pool, tm_tissue, 1);
    if (t) init(t, &pool, def);
    if (pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "tissue");
    }
    copy_constants(t, def);
    find_stiffest(t);
    if (t->cuttable) tm_tissue_keep_blocks(t);
    if ((t->required_mass_kg && !tm_scaled_demand(t)) || !tm_tissue_assemble(t)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "tissue");
    }
    status = tm_scaled_check(t, def->scaled_share, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    tm_tissue_build_surface(t);
    if (t->cut) tm_cut_count(t);
    t->pool = pool;
    *tissue = t;
    return TM_OK;
}

/* --- tissue with the long-term law: other shares of bulk modulus and shear --- */

tm_status tm_tissue_relaxed(const tm_tissue *tissue, double shear, double volume, tm_tissue **out, tm_error *error) {
    tm_pool pool = {0};
    const int32_t regions = tissue->mesh->region_count;
    tm_material *material = TM_ALLOC(&pool, tm_material, regions);
    if (!material) return tm_fail_memory(error, "relaxed tissue");
    for (int32_t r = 0; r < regions; r++) {
        const tm_material *m = tissue->material + tissue->region_material[r];
        const bool relaxes = !tissue->effects || (tissue->effects[r] & TM_REGION_VISCOSITY);
        material[r] = relaxes ? tm_material_relaxed(m, shear, volume) : *m;
    }
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = tissue->mesh;
    def.material_count = regions, def.material = material, def.fibre = tissue->fibre;
    def.precision = tissue->has_single_law ? TM_SINGLE : tissue->precision;
    def.form = tissue->plain ? TM_FORCE_PLAIN : TM_FORCE_BEST;
    def.alive = tissue->alive;
    def.rotation = tissue->rotation;
    def.region_effects = tissue->effects;
    def.strain_smoothing = tissue->smoothed;
    if (tissue->smoothed) def.smoothed_shear_share = tissue->smoothed->shear;
    const tm_status status = tm_tissue_create(&def, out, error);
    tm_pool_release(&pool);
    return status;
}
