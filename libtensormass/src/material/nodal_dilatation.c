/* Averages dilatations of corotated tetrahedra, between the two passes of nodal_dilatation_kernel.h. All sums ascend
 * over tetrahedra, with 0 for removed ones, so that a cut tissue is bit-identical to a fresh build. */
#include <math.h>
#include <string.h>

#include "material/material_internal.h"

const tm_domains *tm_nodal_dilatation_domains_of(const tm_nodal_dilatation *s) {
    return s->field.smoothed->vertex.begin ? &s->field.smoothed->vertex : &s->own_domains;
}

int32_t tm_nodal_dilatation_domains(const tm_nodal_dilatation *s) {
    return tm_nodal_dilatation_is_on(s) ? tm_nodal_dilatation_domains_of(s)->count : 0;
}

/* --- memory --- */

bool tm_nodal_dilatation_init_evaluation(tm_nodal_dilatation *look, tm_pool *pool, const tm_nodal_dilatation *s,
                                         int32_t batches) {
    *look = *s;
    if (!tm_nodal_dilatation_is_on(s)) return true;
    const int32_t domains = tm_nodal_dilatation_domains(s);
    const int64_t lanes = TM_LANES * (int64_t)batches;
    look->rotation = TM_ALLOC(pool, double, 9 * lanes);
    look->dilatation = TM_ALLOC(pool, double, lanes);
    look->linear_dilatation = TM_ALLOC(pool, double, lanes);
    double **of_domains[] = {&look->averaged_dilatation, &look->averaged_linear_dilatation, &look->corotated_Pa,
                             &look->linear_Pa};
    for (int i = 0; i < 4; i++) *of_domains[i] = TM_ALLOC(pool, double, domains);
    return !pool->failed;
}

static void name_domains(const tm_nodal_dilatation *s, int32_t tet, int32_t domain[4]) {
    const tm_mesh *mesh = s->field.mesh;
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    const int32_t law = s->field.smoothed->law[mesh->region[tet]];
    for (int k = 0; k < 4; k++) {
        int32_t i = d->begin[mesh->tet[4 * (int64_t)tet + k]];
        while (d->law[i] != law) i++;
        domain[k] = i;
    }
}

/* Lists the tetrahedra that contribute to each domain. */
static void list_givers(const tm_nodal_dilatation *s) {
    const int32_t *domain = s->domain, count = 4 * s->field.mesh->tet_count;
    int32_t *at = s->tet_at + 1; /* meanwhile: index of the next entry */
    for (int32_t i = 0; i < count; i++) s->tet_at[domain[i] + 1]++;
    for (int32_t d = 0, sum = 0; d < tm_nodal_dilatation_domains(s); d++) {
        const int32_t own = at[d];
        at[d] = sum;
        sum += own;
    }
    for (int32_t i = 0; i < count; i++) s->tet[at[domain[i]]++] = i / 4;
}

/* Sets the limits of nonlinear laws: the pressure of the volume ratios between which it grows. */
static bool limit_laws(tm_nodal_dilatation *s, tm_pool *pool, double *most) {
    double *least = TM_ALLOC(pool, double, s->field.mesh->region_count);
    for (int32_t r = 0; least && r < s->field.mesh->region_count; r++) {
        const bool linear = s->field.material[s->field.region_material[r]].law == TM_LAW_LINEAR;
        most[r] = linear ? HUGE_VAL : s->bulk_Pa[r] * (TM_VOLUME_MOST - 1);
        least[r] = linear ? -HUGE_VAL : s->bulk_Pa[r] * (TM_VOLUME_LEAST - 1);
    }
    s->min_Pa = least;
    return least;
}

bool tm_nodal_dilatation_init(tm_nodal_dilatation *s, tm_pool *pool, const tm_material_field *field, int32_t batches) {
    *s = (tm_nodal_dilatation){0};
    const tm_smoothed *smoothed = field->smoothed;
    if (!smoothed) return true;
    const tm_mesh *mesh = field->mesh;
    s->field = *field;
    tm_domains edge = {0};
    if (!smoothed->vertex.begin) {
        if (!tm_smoothed_build_domains(field, pool, &s->own_domains, &edge)) return false;
        tm_smoothed_average_all(field, &s->own_domains);
    }
    double *most = TM_ALLOC(pool, double, mesh->region_count);
    s->domain = TM_ALLOC(pool, int32_t, 4 * TM_LANES * (int64_t)batches);
    s->quarter_m3 = TM_ALLOC(pool, double, TM_LANES *(int64_t)batches);
    s->tet_at = TM_ALLOC(pool, int32_t, (int64_t)tm_nodal_dilatation_domains(s) + 1);
    s->tet = TM_ALLOC(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    if (pool->failed || !tm_nodal_dilatation_init_evaluation(s, pool, s, batches)) return false;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        name_domains(s, t, s->domain + 4 * (int64_t)t);
        s->quarter_m3[t] = mesh->volume_m3[t] / 4;
    }
    list_givers(s);
    for (int32_t r = 0; r < mesh->region_count; r++)
        most[r] = tm_corotated_tension_max_Pa(field->material + field->region_material[r]);
    s->bulk_Pa = smoothed->bulk_Pa;
    s->max_Pa = most;
    return !field->stiffest_Pa || limit_laws(s, pool, most);
}

/* --- averages and pressures --- */

/* Averages over one domain. */
static double average(const tm_nodal_dilatation *s, int32_t i, const double *of) {
    double sum = 0;
    for (int32_t j = s->tet_at[i]; j < s->tet_at[i + 1]; j++) sum += of[s->tet[j]];
    return sum / tm_nodal_dilatation_domains_of(s)->volume_m3[i];
}

/* Computes the terms' part of a domain's pressure. They see a dilatation only within the range of the tension, and as
 * much in compression: `level` as in viscous_kernel.h. */
static void relax(const tm_nodal_dilatation *s, const tm_viscous *v, int32_t i, double bulk, double most) {
    const double tiny = 1e-60, free = 2.0 / 3 * most / bulk, size = fabs(s->averaged_dilatation[i]);
    const double over = size < free ? 0 : size < 2 * free ? size / free - 1 : 1;
    const double fed =
        copysign((size < 2 * free ? size : 2 * free) - 0.5 * over * over * free, s->averaged_dilatation[i]);
    for (int32_t t = 0; t < v->terms; t++) {
        double *memory = v->swelling[t] + i;
        const double h = *memory + v->now[t] * fed;
        s->corotated_Pa[i] += (1 - over) * v->volume[t] * bulk * (fed - h);
        if (!v->history_frozen) *memory = (v->history_kept[t] * h + v->old[t] * fed + tiny) - tiny;
    }
}

/* The same under nonlinear laws: a share of the pressure itself relaxes (hyperelastic_terms.h). */
static void relax_law(const tm_nodal_dilatation *s, const tm_viscous *v, int32_t i) {
    const double tiny = 1e-60, *range = v->history_Pa + 2 * tm_nodal_dilatation_domains_of(s)->law[i];
    const double pressure = fmin(fmax(s->corotated_Pa[i], range[0]), range[1]);
    for (int32_t t = 0; t < v->terms; t++) {
        double *memory = v->swelling[t] + i;
        const double q = *memory + v->now[t] * pressure;
        s->corotated_Pa[i] -= v->volume[t] * q;
        if (!v->history_frozen) *memory = (v->history_kept[t] * q + v->old[t] * pressure + tiny) - tiny;
    }
}

void tm_nodal_dilatation_average(const tm_nodal_dilatation *s, const tm_viscous *relaxing, int32_t begin, int32_t end) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    for (int32_t i = begin; i < end; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const int32_t law = d->law[i];
        const bool corotates = relaxing && !s->min_Pa; /* with the long-term law in place */
        const double most = corotates ? relaxing->relaxed_max_Pa[law] : s->max_Pa[law];
        s->averaged_dilatation[i] = average(s, i, s->dilatation);
        const double pressure = (corotates ? relaxing->relaxed_bulk_Pa : s->bulk_Pa)[law] * s->averaged_dilatation[i];
        s->corotated_Pa[i] = pressure < most ? pressure : most;
        if (s->min_Pa && pressure < s->min_Pa[law]) s->corotated_Pa[i] = s->min_Pa[law];
        if (corotates) relax(s, relaxing, i, s->bulk_Pa[law], s->max_Pa[law]);
        if (relaxing && !corotates) relax_law(s, relaxing, i);
    }
}

static void average_plain(const tm_nodal_dilatation *s) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        s->averaged_linear_dilatation[i] = average(s, i, s->linear_dilatation);
        s->linear_Pa[i] = s->bulk_Pa[d->law[i]] * s->averaged_linear_dilatation[i];
    }
}

void tm_nodal_dilatation_evaluate(const tm_nodal_dilatation *s, const tm_tet_batches *batches, bool plain,
                                  const double *u_m) {
    tm_nodal_dilatation_choose(plain).average(batches, s, u_m);
    tm_nodal_dilatation_average(s, NULL, 0, tm_nodal_dilatation_domains(s));
    average_plain(s);
}

void tm_nodal_dilatation_add(const tm_nodal_dilatation *s, const tm_tet_batches *batches, bool plain, const double *u_m,
                             double *force_N) {
    if (!tm_nodal_dilatation_is_on(s)) return;
    tm_nodal_dilatation_evaluate(s, batches, plain, u_m);
    tm_nodal_dilatation_choose(plain).press(batches, s, force_N);
}

static double sum_energy(const tm_nodal_dilatation *s, double less) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    double sum = 0;
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const double bulk = s->bulk_Pa[d->law[i]], p = s->corotated_Pa[i];
        /* Beyond the limits of pressure energy grows linearly. */
        sum += d->volume_m3[i] * (p * (s->averaged_dilatation[i] - 0.5 * p / bulk) -
                                  less * bulk * s->averaged_linear_dilatation[i] * s->averaged_linear_dilatation[i]);
    }
    return sum;
}

double tm_nodal_dilatation_stored(const tm_nodal_dilatation *s) { return sum_energy(s, 0); }

double tm_nodal_dilatation_energy(const tm_nodal_dilatation *s, const tm_tet_batches *batches, const double *u_m) {
    if (!tm_nodal_dilatation_is_on(s)) return 0;
    tm_nodal_dilatation_evaluate(s, batches, true, u_m);
    return sum_energy(s, 0.5);
}

double tm_nodal_dilatation_total_energy(const tm_nodal_dilatation *s, const tm_tet_batches *batches,
                                        const double *u_m) {
    tm_nodal_dilatation_evaluate(s, batches, true, u_m);
    return sum_energy(s, 0);
}
