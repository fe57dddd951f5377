/* Force of the bulk modulus by tetrahedra or, smoothed, by vertices; tissue with the long-term law. */
#include "material/bulk.h"

bool tm_bulk_init(tm_bulk *bulk, tm_pool *pool, const tm_material_field *field) {
    const tm_mesh *mesh = field->mesh;
    bulk->field = *field;
    const int smoothed = field->smoothed ? TM_REGION_SMOOTHING : 0;
    if (!tm_effect_tets(&bulk->tets, pool, field, TM_REGION_VISCOSITY, smoothed)) return false;
    if (bulk->tets.count > 0) {
        const int32_t first = tm_ranges_first(&bulk->tets), last = first + tm_ranges_length(&bulk->tets);
        bulk->stiffness_J = tm_shifted(TM_ALLOC(pool, double, last - first), sizeof(double), first);
        for (int32_t t = first; !pool->failed && t < last; t++)
            bulk->stiffness_J[t] = mesh->volume_m3[t] * tm_material_bulk_Pa(tm_field_material(field, t));
    }
    if (!field->smoothed || field->smoothed->vertex.begin) return !pool->failed;
    tm_domains edge = {0};
    if (!tm_smoothed_build_domains(field, pool, &bulk->own_domains, &edge)) return false;
    tm_smoothed_average_all(field, &bulk->own_domains);
    return true;
}

static bool lies_in(int32_t v, int32_t begin, int32_t end) { return v >= begin && v < end; }

static void add_linear(const tm_bulk *bulk, int32_t first, int32_t last, int32_t begin, int32_t end,
                       const double *TM_RESTRICT u, double *TM_RESTRICT force) {
    const tm_mesh *mesh = bulk->field.mesh;
    for (int32_t t = first; t < last; t++) {
        const double *alpha = mesh->shape_1_m + 12 * (int64_t)t;
        const int32_t *v = mesh->tet + 4 * (int64_t)t;
        double grown = 0;
        bool own = false;
        for (int k = 0; k < 4; k++) own |= lies_in(v[k], begin, end);
        if (!own || !bulk->field.alive[t]) continue;
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
    const tm_smoothed *s = bulk->field.smoothed;
    const tm_domains *d = s->vertex.begin ? &s->vertex : &bulk->own_domains;
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
    if (bulk->field.smoothed) add_smoothed(bulk, begin, end, u_m, force_N);
    for (int32_t i = 0; i < bulk->tets.count; i++)
        add_linear(bulk, bulk->tets.end[2 * i], bulk->tets.end[2 * i + 1], begin, end, u_m, force_N);
}
