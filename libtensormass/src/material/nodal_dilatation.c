/* Averages of turned tetrahedra's changes of volume, between the two passes of nodal_dilatation_kernel.h. All sums
 * ascend over tetrahedra, of which the dead give nothing, so that a cut tissue has the bits of a fresh build. */
#include <math.h>
#include <string.h>

#include "material/material_internal.h"

const tm_domains *tm_swollen_domains_of(const tm_swollen *s) {
    return s->field.smoothed->vertex.begin ? &s->field.smoothed->vertex : &s->own;
}

int32_t tm_swollen_domains(const tm_swollen *s) { return tm_swollen_is_on(s) ? tm_swollen_domains_of(s)->count : 0; }

/* --- room --- */

bool tm_swollen_take_look(tm_swollen *look, tm_pool *pool, const tm_swollen *s, int32_t packs) {
    *look = *s;
    if (!tm_swollen_is_on(s)) return true;
    const int32_t domains = tm_swollen_domains(s);
    const int64_t lanes = TM_LANES * (int64_t)packs;
    look->turn = TM_TAKE(pool, double, 9 * lanes);
    look->grown = TM_TAKE(pool, double, lanes);
    look->straight = TM_TAKE(pool, double, lanes);
    double **of_domains[] = {&look->swelling, &look->plain, &look->turned, &look->unturned};
    for (int i = 0; i < 4; i++) *of_domains[i] = TM_TAKE(pool, double, domains);
    return !pool->failed;
}

static void name_domains(const tm_swollen *s, int32_t tet, int32_t domain[4]) {
    const tm_mesh *mesh = s->field.mesh;
    const tm_domains *d = tm_swollen_domains_of(s);
    const int32_t law = s->field.smoothed->law[mesh->region[tet]];
    for (int k = 0; k < 4; k++) {
        int32_t i = d->begin[mesh->tet[4 * (int64_t)tet + k]];
        while (d->law[i] != law) i++;
        domain[k] = i;
    }
}

/* Who gives to which domain, of all tetrahedra. */
static void list_givers(const tm_swollen *s) {
    const int32_t *domain = s->domain, count = 4 * s->field.mesh->tet_count;
    int32_t *at = s->tet_at + 1; /* for now: where the next one goes */
    for (int32_t i = 0; i < count; i++) s->tet_at[domain[i] + 1]++;
    for (int32_t d = 0, sum = 0; d < tm_swollen_domains(s); d++) {
        const int32_t own = at[d];
        at[d] = sum;
        sum += own;
    }
    for (int32_t i = 0; i < count; i++) s->tet[at[domain[i]]++] = i / 4;
}

bool tm_swollen_take(tm_swollen *s, tm_pool *pool, const tm_material_field *field, int32_t packs) {
    *s = (tm_swollen){0};
    const tm_smoothed *smoothed = field->smoothed;
    if (!smoothed) return true;
    const tm_mesh *mesh = field->mesh;
    s->field = *field;
    tm_domains edge = {0};
    if (!smoothed->vertex.begin) {
        if (!tm_smoothed_make_domains(field, pool, &s->own, &edge)) return false;
        tm_smoothed_average_all(field, &s->own);
    }
    double *most = TM_TAKE(pool, double, mesh->region_count);
    s->domain = TM_TAKE(pool, int32_t, 4 * TM_LANES * (int64_t)packs);
    s->quarter_m3 = TM_TAKE(pool, double, TM_LANES *(int64_t)packs);
    s->tet_at = TM_TAKE(pool, int32_t, (int64_t)tm_swollen_domains(s) + 1);
    s->tet = TM_TAKE(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    if (pool->failed || !tm_swollen_take_look(s, pool, s, packs)) return false;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        name_domains(s, t, s->domain + 4 * (int64_t)t);
        s->quarter_m3[t] = mesh->volume_m3[t] / 4;
    }
    list_givers(s);
    for (int32_t r = 0; r < mesh->region_count; r++)
        most[r] = tm_corotated_tension_max_Pa(field->material + field->region_material[r]);
    s->bulk_Pa = smoothed->bulk_Pa;
    s->most_Pa = most;
    return true;
}

/* --- averages and pressures --- */

/* Of one domain. */
static double average(const tm_swollen *s, int32_t i, const double *of) {
    double sum = 0;
    for (int32_t j = s->tet_at[i]; j < s->tet_at[i + 1]; j++) sum += of[s->tet[j]];
    return sum / tm_swollen_domains_of(s)->volume_m3[i];
}

/* The terms' part of a domain's pressure; they know a change of volume as far as tension grows, and as much the other
 * way, level as in viscous_kernel.h. */
static void relax(const tm_swollen *s, const tm_viscous *v, int32_t i, double bulk, double most) {
    const double tiny = 1e-60, free = 2.0 / 3 * most / bulk, size = fabs(s->swelling[i]);
    const double over = size < free ? 0 : size < 2 * free ? size / free - 1 : 1;
    const double fed = copysign((size < 2 * free ? size : 2 * free) - 0.5 * over * over * free, s->swelling[i]);
    for (int32_t t = 0; t < v->terms; t++) {
        double *memory = v->swelling[t] + i;
        const double h = *memory + v->now[t] * fed;
        s->turned[i] += (1 - over) * v->volume[t] * bulk * (fed - h);
        if (!v->still) *memory = (v->keep[t] * h + v->old[t] * fed + tiny) - tiny;
    }
}

void tm_swollen_average(const tm_swollen *s, const tm_viscous *relaxing, int32_t begin, int32_t end) {
    const tm_domains *d = tm_swollen_domains_of(s);
    for (int32_t i = begin; i < end; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const int32_t law = d->law[i];
        const double most = relaxing ? relaxing->left_most_Pa[law] : s->most_Pa[law];
        s->swelling[i] = average(s, i, s->grown);
        const double pressure = (relaxing ? relaxing->left_bulk_Pa : s->bulk_Pa)[law] * s->swelling[i];
        s->turned[i] = pressure < most ? pressure : most;
        if (relaxing) relax(s, relaxing, i, s->bulk_Pa[law], s->most_Pa[law]);
    }
}

static void average_plain(const tm_swollen *s) {
    const tm_domains *d = tm_swollen_domains_of(s);
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        s->plain[i] = average(s, i, s->straight);
        s->unturned[i] = s->bulk_Pa[d->law[i]] * s->plain[i];
    }
}

void tm_swollen_look(const tm_swollen *s, const tm_packs *packs, bool plain, const double *u_m) {
    tm_swollen_choose(plain).swell(packs, s, u_m);
    tm_swollen_average(s, NULL, 0, tm_swollen_domains(s));
    average_plain(s);
}

void tm_swollen_add(const tm_swollen *s, const tm_packs *packs, bool plain, const double *u_m, double *force_N) {
    if (!tm_swollen_is_on(s)) return;
    tm_swollen_look(s, packs, plain, u_m);
    tm_swollen_choose(plain).press(packs, s, force_N);
}

static double sum_energy(const tm_swollen *s, double less) {
    const tm_domains *d = tm_swollen_domains_of(s);
    double sum = 0;
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const double bulk = s->bulk_Pa[d->law[i]], p = s->turned[i];
        /* Beyond the largest tension energy grows straight on. */
        sum += d->volume_m3[i] * (p * (s->swelling[i] - 0.5 * p / bulk) - less * bulk * s->plain[i] * s->plain[i]);
    }
    return sum;
}

double tm_swollen_energy(const tm_swollen *s, const tm_packs *packs, const double *u_m) {
    if (!tm_swollen_is_on(s)) return 0;
    tm_swollen_look(s, packs, true, u_m);
    return sum_energy(s, 0.5);
}

double tm_swollen_whole_energy(const tm_swollen *s, const tm_packs *packs, const double *u_m) {
    tm_swollen_look(s, packs, true, u_m);
    return sum_energy(s, 0);
}
