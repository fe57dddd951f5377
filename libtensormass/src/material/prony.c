/* The Prony series: checks of a definition, the coefficients of a step, and the terms of batches. */
#include "material/prony.h"

#include <math.h>

#include "libtensormass/numeric/elementary.h"

tm_viscosity_def tm_viscosity_def_default(void) {
    return (tm_viscosity_def){.cookie = TM_COOKIE_VISCOSITY, .size = sizeof(tm_viscosity_def)};
}

tm_status tm_viscosity_check(const tm_viscosity_def *def, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_VISCOSITY, TM_ERR_ARGUMENT);
    if (def->count < 1 || def->count > TM_VISCOSITY_TERMS)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "viscosity has %d terms; give 1 to %d", (int)def->count,
                       TM_VISCOSITY_TERMS);
    double shear = 0, volume = 0;
    for (int32_t i = 0; i < def->count; i++) {
        const tm_viscosity_term *t = def->term + i;
        if (!(t->time_s >= TM_VISCOSITY_TIME_MIN_S && t->time_s <= TM_VISCOSITY_TIME_MAX_S) || !(t->shear >= 0) ||
            !(t->bulk >= 0))
            return tm_fail(
                error, TM_ERR_ARGUMENT, i,
                "viscosity: term %d has shear share %g, bulk share %g, time %g s; give shares from 0 to 1 and a time "
                "from %g to %g s",
                (int)i, t->shear, t->bulk, t->time_s, TM_VISCOSITY_TIME_MIN_S, TM_VISCOSITY_TIME_MAX_S);
        shear += t->shear, volume += t->bulk;
    }
    if (!(shear <= TM_VISCOSITY_SHARES_MAX && volume <= TM_VISCOSITY_SHARES_MAX))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "viscosity: the shares add up to %g for shear and %g for bulk; keep each sum at or below %g, so that "
            "some stiffness does not relax",
            shear, volume, TM_VISCOSITY_SHARES_MAX);
    return TM_OK;
}

tm_fading tm_fading_of(double dt_s, double time_s) {
    const double x = dt_s / time_s, gone = -tm_exponential_less_1(-x);
    /* 1 - gone/x cancels where x is small; its series does not. */
    const double now =
        x < 0.01 ? x * (1.0 / 2 - x * (1.0 / 6 - x * (1.0 / 24 - x * (1.0 / 120 - x / 720)))) : 1 - gone / x;
    return (tm_fading){tm_exponential(-x), gone - now, now};
}

/* --- batches --- */

/* Builds the long-term law, in batches and, where dilatation is averaged, by domains. The field with these materials
 * exists during this call only: batches keep only data of the tissue. */
static bool take_long_term(tm_viscous *v, tm_tet_batches *left, tm_pool *pool, const tm_material_field *field,
                           double shear, double volume) {
    const int32_t regions = field->mesh->region_count;
    tm_material_field long_term = *field;
    tm_smoothed smoothed;
    tm_material *material = TM_ALLOC(pool, tm_material, field->material_count);
    if (!material) return false;
    for (int32_t i = 0; i < field->material_count; i++)
        material[i] = tm_material_relaxed(field->material + i, shear, volume);
    long_term.material = material;
    if (field->smoothed) {
        double *bulk_Pa = TM_ALLOC(pool, double, regions), *max_Pa = TM_ALLOC(pool, double, regions);
        tm_material *rest = TM_ALLOC(pool, tm_material, regions);
        for (int32_t i = 0; !pool->failed && i < regions; i++) {
            rest[i] = material[field->region_material[i]];
            bulk_Pa[i] = tm_material_bulk_Pa(rest + i);
            max_Pa[i] = tm_corotated_tension_max_Pa(rest + i);
            rest[i].lambda_Pa -= bulk_Pa[i];
        }
        smoothed = *field->smoothed;
        smoothed.remainder = rest;
        long_term.smoothed = &smoothed;
        v->relaxed_bulk_Pa = bulk_Pa, v->relaxed_max_Pa = max_Pa;
    }
    return !pool->failed && tm_tet_batches_init_where(left, pool, &long_term, TM_REGION_ROTATION | TM_REGION_VISCOSITY);
}

static void share_out(tm_viscous *v, const tm_viscosity_def *def, double shear, double volume) {
    v->terms = def->count;
    v->whole = 1 / shear, v->whole_more = 1 - volume / shear;
    for (int32_t t = 0; t < def->count; t++) {
        const tm_viscosity_term *term = def->term + t;
        v->shear[t] = term->shear / shear;
        v->more[t] = term->bulk - term->shear * volume / shear;
        v->volume[t] = term->bulk;
    }
}

bool tm_prony_init(tm_viscous *v, tm_tet_batches *left, tm_pool *pool, const tm_material_field *field,
                   const tm_viscosity_def *def, double *const *kept) {
    double shear, volume;
    tm_viscosity_relaxed(def, &shear, &volume);
    share_out(v, def, shear, volume);
    if (!take_long_term(v, left, pool, field, shear, volume)) return false;
    const int64_t lanes = TM_LANES * (int64_t)left->count;
    v->bulk_J = TM_ALLOC(pool, double, lanes);
    if (pool->failed) return false;
    for (int32_t t = 0; t < def->count; t++) {
        v->history[t] = kept[t];
        v->swelling[t] = kept[t] + 6 * lanes;
    }
    for (int32_t t = 0; !field->smoothed && t < field->mesh->tet_count; t++) {
        const int64_t slot = tm_tet_slot(left, t);
        if (slot < 0) continue;
        v->bulk_J[slot] = field->mesh->volume_m3[t] * tm_material_bulk_Pa(tm_field_material(field, t));
    }
    return true;
}
