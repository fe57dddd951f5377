/* The table of laws. */
#include "material/law.h"

#define ROW(NAME, name) &tm_law_##name,
const tm_law *const tm_laws[] = {&tm_law_linear, &tm_law_corotated, &tm_law_corotated_averaged,
                                 TM_NONLINEAR_LAWS(ROW) NULL};

const tm_law *tm_law_of(const tm_material_field *field) {
    int32_t first = 0; /* of a nonlinear law: all share passes and bound, with linear materials beside them too */
    while (field->stiffest_Pa && field->material[first].law == TM_LAW_LINEAR) first++;
    for (const tm_law *const *law = tm_laws; field->stiffest_Pa && *law; law++)
        if ((*law)->kind == (tm_law_kind)field->material[first].law) return *law;
    if (!(field->rotation > 0)) return &tm_law_linear;
    return field->smoothed ? &tm_law_corotated_averaged : &tm_law_corotated;
}

const tm_law *tm_law_of_tet(const tm_material_field *field, int32_t tet) {
    const bool linear = field->rotation > 0 && !tm_field_has(field, tet, TM_REGION_ROTATION);
    return linear ? &tm_law_linear : tm_law_of(field);
}

bool tm_law_init(tm_law_state *state, tm_pool *pool, const tm_law *law, const tm_material_field *field) {
    static const double NEVER = 1e100; /* |grad u| that no tetrahedron exceeds */
    *state = (tm_law_state){.law = law, .field = *field};
    if (law->kind != TM_LAW_LINEAR) {
        if (!tm_hyperelastic_take(&state->hyper, pool, field)) return false;
        const int64_t all = TM_LANES * (int64_t)state->hyper.packs.count;
        state->work.corner_N = TM_ALLOC(pool, double, 12 * all);
        if (field->smoothed) state->work.stress_J = TM_ALLOC(pool, double, 9 * all);
        return tm_nodal_dilatation_init(&state->averages, pool, field, state->hyper.packs.count) && !pool->failed;
    }
    if (law->has_constant_tangent) state->field.rotation = NEVER;
    if (!law->averages) state->field.smoothed = NULL;
    if (!tm_tet_batches_init(&state->batches, pool, &state->field)) return false;
    const int64_t lanes = TM_LANES * (int64_t)state->batches.count;
    if (!tm_nodal_dilatation_init(&state->averages, pool, &state->field, state->batches.count)) return false;
    state->work.corner_N = TM_ALLOC(pool, double, 12 * lanes);
    if (law->averages) state->work.stress_J = TM_ALLOC(pool, double, 9 * lanes);
    return !pool->failed;
}
