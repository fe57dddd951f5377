/* The bulk modulus' part of the force, tetrahedron by tetrahedron or, smoothed, vertex by vertex; and tissue with
 * other shares of bulk modulus and rest. */
#include "tissue/bulk.h"

bool tm_bulk_take(tm_bulk *bulk, tm_pool *pool, const tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    bulk->tissue = tissue;
    if (!tissue->smoothed) {
        bulk->stiffness_J = TM_TAKE(pool, double, mesh->tet_count);
        for (int32_t t = 0; !pool->failed && t < mesh->tet_count; t++)
            bulk->stiffness_J[t] = mesh->volume_m3[t] * tm_smoothed_bulk_Pa(tm_tissue_tet_material(tissue, t));
        return !pool->failed;
    }
    if (tissue->smoothed->vertex.begin) return true;
    tm_domains edge = {0};
    if (!tm_smoothed_make_domains(tissue, pool, &bulk->own, &edge)) return false;
    tm_smoothed_average_all(tissue, &bulk->own);
    return true;
}

static bool lies_in(int32_t v, int32_t begin, int32_t end) { return v >= begin && v < end; }

static void add_linear(const tm_bulk *bulk, int32_t begin, int32_t end, const double *TM_RESTRICT u,
                       double *TM_RESTRICT force) {
    const tm_mesh *mesh = bulk->tissue->mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const double *alpha = mesh->shape_1_m + 12 * (int64_t)t;
        const int32_t *v = mesh->tet + 4 * (int64_t)t;
        double grown = 0;
        bool own = false;
        for (int k = 0; k < 4; k++) own |= lies_in(v[k], begin, end);
        if (!own || !bulk->tissue->alive[t]) continue;
        for (int k = 0; k < 4; k++) {
            const double *x = u + 3 * (int64_t)v[k];
            grown += alpha[3 * k] * x[0] + alpha[3 * k + 1] * x[1] + alpha[3 * k + 2] * x[2];
        }
        const double pull = bulk->stiffness_J[t] * grown;
        for (int k = 0; k < 4; k++)
            for (int i = 0; i < 3 && lies_in(v[k], begin, end); i++)
                force[3 * (int64_t)v[k] + i] += pull * alpha[3 * k + i];
    }
}

static void add_smoothed(const tm_bulk *bulk, int32_t begin, int32_t end, const double *TM_RESTRICT u,
                         double *TM_RESTRICT force) {
    const tm_smoothed *s = bulk->tissue->smoothed;
    const tm_domains *d = s->vertex.begin ? &s->vertex : &bulk->own;
    for (int32_t i = 0; i < d->count; i++) {
        double grown = 0;
        int32_t m = d->member_at[i];
        const int32_t last = d->member_at[i + 1];
        if (d->member[m] >= end || d->member[last - 1] < begin) continue; /* members ascend */
        for (; m < last; m++) {
            if (!d->lives[m]) continue;
            const double *g = d->gradient + 3 * (int64_t)m, *x = u + 3 * (int64_t)d->member[m];
            grown += g[0] * x[0] + g[1] * x[1] + g[2] * x[2];
        }
        const double pull = s->bulk_Pa[d->law[i]] * d->volume_m3[i] * grown;
        for (m = d->member_at[i]; m < last && d->member[m] < end; m++) {
            if (!d->lives[m] || d->member[m] < begin) continue;
            const double *g = d->gradient + 3 * (int64_t)m;
            for (int c = 0; c < 3; c++) force[3 * (int64_t)d->member[m] + c] += pull * g[c];
        }
    }
}

void tm_bulk_add(const tm_bulk *bulk, int32_t begin, int32_t end, const double *u_m, double *force_N) {
    if (bulk->tissue->smoothed)
        add_smoothed(bulk, begin, end, u_m, force_N);
    else
        add_linear(bulk, begin, end, u_m, force_N);
}

tm_material tm_material_left(const tm_material *m, double shear, double volume) {
    const double bulk = tm_smoothed_bulk_Pa(m);
    tm_material left = *m;
    left.mu_Pa *= shear, left.dlambda_Pa *= shear, left.dmu_Pa *= shear, left.beta_Pa *= shear;
    left.lambda_Pa = shear * (m->lambda_Pa - bulk) + volume * bulk;
    return left;
}

tm_status tm_tissue_relaxed(const tm_tissue *tissue, double shear, double volume, tm_tissue **out, tm_error *error) {
    tm_pool pool = {0};
    tm_material *material = TM_TAKE(&pool, tm_material, tissue->material_count);
    if (!material) return tm_fail_memory(error, "relaxed tissue");
    for (int32_t i = 0; i < tissue->material_count; i++)
        material[i] = tm_material_left(tissue->material + i, shear, volume);
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
