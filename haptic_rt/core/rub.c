/* Coulomb friction on the patch, from tick to tick: the law of the simulation (law/friction.h; docs/friction.md)
 * at the stations of the tool. How far the tissue under one has gone is read from the displacements of the
 * patch's vertices now and in the last tick, so what a new sample corrects is in it too. */
#include "internal.h"

#if HRT_WITH_FRICTION
#include "law/friction.h"

static const float HARDEST_SKIN_m_N = 1.0e-6f; /* none has no stretch to tell a force by */

static const uint8_t *corners(const hrt_rub *rub, const hrt_contact_row *row) {
    return &rub->patch->triangle[HRT_XYZ * row->triangle];
}

static law_v3 on_axis(uint8_t station, float radius_m, law_v3 tip) {
    return vtimes(1.0f - (float)station * radius_m / vsize(tip), tip);
}

/* Its rows: what they bear, their normal, what presses along it. False: none bears. */
static bool press(hrt_grip *g, const hrt_contact_row *row, int32_t count) {
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    g->bears_N = 0.0f;
    for (; count > 0; count--, row++) {
        if (row->station != g->is.station || !(row->lambda_N > 0.0f)) continue;
        g->bears_N += row->lambda_N;
        sum = vplus(sum, vtimes(row->lambda_N, vget(row->normal)));
    }
    vput(sum, g->normal);
    g->pressed_N = vunit(g->normal, g->normal);
    return g->bears_N > 0.0f;
}

const hrt_grip *hrt_rub_grip(const hrt_rub *rub, const hrt_contact_row *row) {
    for (int32_t k = 0; k < rub->count; k++)
        if (rub->grip[k].is.station == row->station && row->lambda_N > 0.0f) return &rub->grip[k];
    return NULL;
}

void hrt_rub_begin(hrt_rub *rub, const hrt_patch *patch, hrt_rubbing *was, const float tip_m[3]) {
    rub->patch = patch;
    rub->was = was;
    rub->tip = vget(tip_m);
    rub->count = was->count;
    for (int32_t k = 0; k < was->count; k++) rub->grip[k].is = was->at[k];
    if (was->known == 0) vset(tip_m, was->tip_m);
}

void hrt_rub_shape(hrt_rub *rub, const float *shift_m) {
    for (int32_t i = 0; i < 3 * rub->patch->vertex_count; i++) {
        rub->u_m[i] = rub->patch->vertex_m[i] - rub->patch->rest_m[i] + shift_m[i];
        if ((rub->was->known >> i / 3 & 1u) == 0) rub->was->u_m[i] = rub->u_m[i];
    }
    rub->was->known |= (1u << rub->patch->vertex_count) - 1u;
}

void hrt_rub_add(const hrt_rub *rub, const hrt_contact_row *row, int32_t count, float sign, float *force_N) {
    for (; count > 0; count--, row++) {
        const hrt_grip *g = hrt_rub_grip(rub, row);
        for (int k = 0; g && k < 3; k++)
            vadd(&force_N[HRT_XYZ * corners(rub, row)[k]], sign * row->weight[k] * row->lambda_N / g->bears_N,
                 g->is.force_N);
    }
}

void hrt_rub_press(hrt_rub *rub, const hrt_contact_row *row, int32_t count) {
    int32_t kept = 0;
    for (int32_t k = 0; k < rub->count; k++)
        if (press(&rub->grip[k], row, count)) rub->grip[kept++] = rub->grip[k];
    rub->count = kept;
    for (int32_t r = 0; r < count; r++) {
        if (!(row[r].lambda_N > 0.0f) || hrt_rub_grip(rub, &row[r])) continue;
        hrt_grip *g = &rub->grip[rub->count++];
        *g = (hrt_grip){.is = {.station = row[r].station, .rest = 1.0f}};
        press(g, row, count);
    }
}

/* How far the tissue under it goes where the vertices go by u_m. */
static law_v3 under(const hrt_rub *rub, const hrt_grip *g, const hrt_contact_row *row, int32_t count,
                    const float *u_m) {
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    for (; count > 0; count--, row++) {
        if (row->station != g->is.station || !(row->lambda_N > 0.0f)) continue;
        for (int k = 0; k < 3; k++)
            if (row->weight[k] > 0.0f)
                sum = vplus(sum, vtimes(row->weight[k] * row->lambda_N / g->bears_N,
                                        vget(&u_m[HRT_XYZ * corners(rub, row)[k]])));
    }
    return sum;
}

/* What a newton along `e` at every station does along it under each. */
static void give(hrt_rub *rub, const hrt_contact_row *row, int32_t count, law_v3 e) {
    float load[HRT_PATCH_DOFS] = {0}, shift_m[HRT_PATCH_DOFS] = {0};
    uint8_t from[HRT_PATCH_MAX_VERTICES];
    law_v3 force[HRT_PATCH_MAX_VERTICES];
    int32_t loaded = 0;
    for (int32_t r = 0; r < count; r++) {
        const hrt_grip *g = hrt_rub_grip(rub, &row[r]);
        for (int k = 0; g && k < 3; k++)
            load[corners(rub, &row[r])[k]] += row[r].weight[k] * row[r].lambda_N / g->bears_N;
    }
    for (int32_t v = 0; v < rub->patch->vertex_count; v++) {
        if (!(load[v] > 0.0f)) continue;
        from[loaded] = (uint8_t)v;
        force[loaded++] = vtimes(load[v], e);
    }
    for (int32_t i = 0; i < loaded; i++) hrt_patch_respond(rub->patch, from[i], from, force, loaded, shift_m);
    for (int32_t k = 0; k < rub->count; k++)
        rub->grip[k].gives_m_N =
            law_max(rub->grip[k].gives_m_N, vinner(e, under(rub, &rub->grip[k], row, count, shift_m)));
}

/* Twice, so that tissue that is softer one way than another is not asked for too much: the larger is what next_force
 * divides by. */
static void give_across(hrt_rub *rub, const hrt_contact_row *row, int32_t count) {
    if (rub->count == 0) return;
    const law_v3 normal = vget(rub->grip[0].normal);
    law_v3 e = {0.0f, -normal.z, normal.y};
    if (normal.x * normal.x > 0.5f) e = (law_v3){-normal.y, normal.x, 0.0f};
    e = vtimes(1.0f / law_max(vsize(e), 1.0e-9f), e);
    for (int32_t k = 0; k < rub->count; k++) rub->grip[k].gives_m_N = 0.0f;
    give(rub, row, count, e);
    give(rub, row, count, vouter(normal, e));
}

/* The force that holds with this shape, c (t - stretch) = way of the tool - way of the tissue, where the tissue has
 * gone by the force before: t' = P((c stretch + way + B t) / (c + B)), P into the cone, B what the tissue gives. What
 * has not come true of a force that sticks is not lost: its skin's stretch is kept apart. */
static void next_force(const hrt_rub *rub, hrt_grip *g, law_v3 went) {
    const hrt_patch *p = rub->patch;
    const hrt_rubbing *was = rub->was;
    const float skin = law_max(p->skin_compliance_m_N, HARDEST_SKIN_m_N);
    hrt_rubbed before = {.rest = 1.0f};
    for (int32_t k = 0; k < was->count; k++)
        if (was->at[k].station == g->is.station) before = was->at[k];
    const law_v3 moved = vminus(on_axis(g->is.station, p->radius_m, rub->tip),
                                on_axis(g->is.station, p->radius_m, vget(was->tip_m))),
                 way = vminus(moved, went), force = vget(g->is.force_N), stretch = vget(before.stretch_N);
    vput(vplus(force, vtimes(1.0f / (skin + g->gives_m_N), vplus(vtimes(skin, vminus(stretch, force)), way))),
         g->is.force_N);
    vput(vplus(stretch, vtimes(1.0f / skin, way)), g->is.stretch_N);
    law_across(g->normal, g->is.force_N);
    law_across(g->normal, g->is.stretch_N);
    g->slipped_m = 0.0f;
    g->is.rest = before.rest;
    const float most = law_friction_coefficient(p->friction_static, p->friction_sliding, before.rest) * g->pressed_N;
    if (!law_friction_slips(most, g->is.force_N)) return;
    g->slipped_m = skin * vsize(vminus(vget(g->is.stretch_N), vget(g->is.force_N)));
    vset(g->is.force_N, g->is.stretch_N);
}

void hrt_rub_round(hrt_rub *rub, const hrt_contact_row *row, int32_t count, float *residual_N) {
    hrt_rub_press(rub, row, count);
    give_across(rub, row, count);
    for (int32_t k = 0; k < rub->count; k++) {
        hrt_grip *g = &rub->grip[k];
        next_force(rub, g, vminus(under(rub, g, row, count, rub->u_m), under(rub, g, row, count, rub->was->u_m)));
    }
    hrt_rub_add(rub, row, count, 1.0f, residual_N);
}

void hrt_rub_settle(hrt_rub *rub, float passed_s) {
    hrt_rubbing *to = rub->was;
    to->count = rub->count;
    for (int32_t k = 0; k < rub->count; k++) {
        to->at[k] = rub->grip[k].is;
        to->at[k].rest = law_friction_rest(to->at[k].rest, rub->grip[k].slipped_m, passed_s);
    }
    for (int32_t i = 0; i < 3 * rub->patch->vertex_count; i++) to->u_m[i] = rub->u_m[i];
    vput(rub->tip, to->tip_m);
}
#endif
