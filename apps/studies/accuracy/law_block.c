/* Meshes, supports and measured quantities of the nonlinear laws' verification. */
#include "law_block.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"

static const double SIDE_M = 0.03, BAR_M[3] = {0.02, 0.02, 0.06};
static const double FIBRE[3] = {0.6, 0, 0.8};
static const double ANGLE = 6; /* of the twist, at level 1 */

const law_sample law_samples[LAW_SAMPLES] = {
    {"neo-hooke", TM_LAW_NEO_HOOKE, {0}, false},
    {"st-venant-kirchhoff", TM_LAW_ST_VENANT_KIRCHHOFF, {0.5}, false},
    {"mooney-rivlin", TM_LAW_MOONEY_RIVLIN, {0.3}, false},
    {"fung", TM_LAW_FUNG, {1e4}, false},
    {"fung, fibred", TM_LAW_FUNG, {1e4}, true},
    {"holzapfel", TM_LAW_HOLZAPFEL, {4e3, 0.8, 0.1}, false},
};

const char *law_case_name(law_case which) {
    return (const char *[LAW_CASES]){"press", "shear", "twist", "bend", "indent"}[which];
}

static bool is_bar(law_case which) { return which == LAW_TWIST || which == LAW_BEND; }

static tm_material material(const law_sample *s, const law_form *form) {
    tm_material m = material_liver();
    if (s->fibred) m.dmu_Pa = m.beta_Pa = m.mu_Pa;
    if (form->nonlinear && tm_material_set_law(&m, s->law, s->constant, form->stretch_max, NULL) != TM_OK)
        abort(); /* constants of this file */
    return m;
}

app_bench_def law_bench(law_case which, const law_sample *s, const law_form *form, bool small) {
    const int across = is_bar(which) ? 4 : 6;
    app_bench_def def = app_bench_default(small ? across : 2 * across, SIDE_M);
    if (is_bar(which)) def.cells[2] *= 3, memcpy(def.size_m, BAR_M, sizeof BAR_M);
    def.material[0] = material(s, form);
    def.fibre = s->fibred || (form->nonlinear && s->law == TM_LAW_HOLZAPFEL) ? FIBRE : NULL;
    def.rotation = form->rotation ? TM_ROTATION_THRESHOLD : 0;
    def.volume = form->smoothing, def.smoothed_shear_share = 0;
    def.held = APP_HELD_NOT;
    return def;
}

/* --- supports --- */

/* One prescribed component, and its displacement at a level. */
typedef struct rule {
    law_case which;
    double x[2], size_m[2], length_m;
    int axis;
} rule;

static double moved_m(const rule *r, double level) {
    const double s = (r->x[0] * r->x[0] + r->x[1] * r->x[1]) / (INDENTER_M * INDENTER_M);
    const double p[2] = {r->x[0] - r->size_m[0] / 2, r->x[1] - r->size_m[1] / 2};
    const double c = cos(ANGLE * level), q = sin(ANGLE * level);
    switch (r->which) {
    case LAW_INDENT: return -level * r->length_m * (1 - s) * (1 - s);
    case LAW_PRESS: return r->axis == 2 ? -level * r->length_m : 0;
    case LAW_TWIST: return r->axis == 0 ? c * p[0] - q * p[1] - p[0] : q * p[0] + c * p[1] - p[1];
    default: return r->axis == 0 ? level * r->length_m : 0;
    }
}

/* Returns whether the component of the far face is led. */
static bool is_led(law_case which, const double x[3], int axis) {
    if (which == LAW_INDENT) return axis == 2 && x[0] * x[0] + x[1] * x[1] < INDENTER_M * INDENTER_M * (1 - 1e-9);
    if (which == LAW_TWIST) return axis < 2;
    return which != LAW_BEND || axis == 0;
}

typedef struct held {
    int32_t count, *dof;
    double *value_m;
    bool *leads;
} held;

static held take_supports(law_case which, const app_bench_def *def, const tm_mesh *mesh) {
    const size_t n = 3 * (size_t)mesh->vertex_count;
    held h = {0, app_zeroed(n, sizeof *h.dof), app_zeroed(n, sizeof *h.value_m), app_zeroed(n, sizeof *h.leads)};
    const bool quarter = which == LAW_PRESS || which == LAW_INDENT;
    for (int32_t d = 0; d < (int32_t)n; d++) {
        const double *x = mesh->rest_m + d / 3 * 3;
        const int axis = d % 3;
        const bool far = x[2] > def->size_m[2] - 1e-9, leads = far && is_led(which, x, axis);
        if (!leads && x[2] > 1e-9 && !(quarter && axis < 2 && x[axis] < 1e-9)) continue;
        h.leads[h.count] = leads, h.dof[h.count++] = d;
    }
    return h;
}

static void free_supports(held *h) {
    free(h->dof);
    free(h->value_m);
    free(h->leads);
}

static void lead(law_case which, const app_bench_def *def, const tm_mesh *mesh, double level, held *h) {
    for (int32_t i = 0; i < h->count; i++) {
        if (!h->leads[i]) continue;
        const double *x = mesh->rest_m + h->dof[i] / 3 * 3;
        const rule r = {which, {x[0], x[1]}, {def->size_m[0], def->size_m[1]}, def->size_m[2], h->dof[i] % 3};
        h->value_m[i] = moved_m(&r, level);
    }
}

/* --- quantities --- */

static void measure(law_case which, const app_bench_def *def, const app_bench *b, law_measured *m) {
    const double *u = tm_world_state(b->world)->u_m;
    double *reaction = app_zeroed(3 * (size_t)b->mesh->vertex_count, sizeof *reaction);
    tm_support_reaction(b->world, reaction);
    m->force = 0;
    for (int32_t v = 0; v < b->mesh->vertex_count; v++) {
        const double *x = b->mesh->rest_m + 3 * v, *f = reaction + 3 * v;
        if (x[2] < def->size_m[2] - 1e-9) continue;
        const double at[2] = {x[0] + u[3 * v] - def->size_m[0] / 2, x[1] + u[3 * v + 1] - def->size_m[1] / 2};
        m->force += which == LAW_TWIST                        ? at[0] * f[1] - at[1] * f[0]
                    : which == LAW_SHEAR || which == LAW_BEND ? f[0]
                                                              : f[2];
    }
    free(reaction);
    int probe = 0;
    for (int k = 1; k <= 3; k++)
        for (int j = 0; j < 2; j++)
            for (int i = 0; i < 2; i++, probe++) {
                const int n = def->cells[0], short_of = is_bar(which) ? n / 2 : n / 3;
                const int32_t v =
                    (i ? n : short_of) + (n + 1) * ((j ? n : short_of) + (n + 1) * (def->cells[2] * k / 3));
                memcpy(m->u_m + 3 * probe, u + 3 * v, 3 * sizeof *u);
            }
    m->limited = tm_world_limited_tets(b->world), m->tets = b->mesh->tet_count;
}

tm_status law_rest(law_case which, const law_sample *s, const law_form *form, bool small, const double *level,
                   int count, law_measured *out, tm_error *error) {
    const app_bench_def def = law_bench(which, s, form, small);
    app_bench b;
    tm_status status = app_bench_open(&def, &b, error);
    if (status != TM_OK) return status;
    held h = take_supports(which, &def, b.mesh);
    tm_support_def support = tm_support_def_default();
    support.count = h.count, support.dof = h.dof, support.value_m = h.value_m;
    status = tm_stage_support(b.world, &support, error);
    tm_settle_def settle = tm_settle_def_default();
    settle.tolerance = 1e-8;
    for (int i = 0; i < count && status == TM_OK; i++) {
        tm_settle_result result;
        lead(which, &def, b.mesh, level[i], &h);
        for (int32_t c = 0; c < h.count; c++) tm_support_move(b.world, c, h.value_m[c]);
        status = tm_world_settle(b.world, &settle, &result, error);
        if (status != TM_OK) break;
        measure(which, &def, &b, out + i);
        out[i].energy_J = result.energy_J;
    }
    free_supports(&h);
    app_bench_close(&b);
    return status;
}
