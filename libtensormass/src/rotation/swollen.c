/* Averages of turned tetrahedra's changes of volume, between the two passes of swollen_kernel.h. All sums ascend over
 * living tetrahedra, so that a cut tissue has the bits of a fresh build. */
#include <math.h>
#include <string.h>

#include "rotation/rotation_internal.h"

const tm_domains *tm_swollen_domains_of(const tm_swollen *s) {
    return s->tissue->smoothed->vertex.begin ? &s->tissue->smoothed->vertex : &s->own;
}

int32_t tm_swollen_domains(const tm_swollen *s) { return s->tissue ? tm_swollen_domains_of(s)->count : 0; }

/* --- room --- */

bool tm_swollen_take_look(tm_swollen *look, tm_pool *pool, const tm_swollen *s, int32_t packs) {
    *look = *s;
    if (!s->tissue) return true;
    const int32_t domains = tm_swollen_domains(s);
    const int64_t lanes = TM_LANES * (int64_t)packs;
    look->turn = TM_TAKE(pool, double, 9 * lanes);
    double **of_tets[] = {&look->grown, &look->straight, &look->pull_J, &look->drawn_J};
    for (int i = 0; i < 4; i++) *of_tets[i] = TM_TAKE(pool, double, lanes);
    double **of_domains[] = {&look->swelling, &look->plain, &look->turned, &look->unturned};
    for (int i = 0; i < 4; i++) *of_domains[i] = TM_TAKE(pool, double, domains);
    return !pool->failed;
}

static void name_domains(const tm_swollen *s, int32_t tet, int32_t domain[4]) {
    const tm_mesh *mesh = s->tissue->mesh;
    const tm_domains *d = tm_swollen_domains_of(s);
    const int32_t law = s->tissue->smoothed->law[mesh->region[tet]];
    for (int k = 0; k < 4; k++) {
        int32_t i = d->begin[mesh->tet[4 * (int64_t)tet + k]];
        while (d->law[i] != law) i++;
        domain[k] = i;
    }
}

bool tm_swollen_take(tm_swollen *s, tm_pool *pool, const tm_tissue *tissue, int32_t packs) {
    *s = (tm_swollen){0};
    const tm_smoothed *smoothed = tissue->smoothed;
    if (!smoothed) return true;
    const tm_mesh *mesh = tissue->mesh;
    s->tissue = tissue;
    tm_domains edge = {0};
    if (!smoothed->vertex.begin) {
        if (!tm_smoothed_make_domains(tissue, pool, &s->own, &edge)) return false;
        tm_smoothed_average_all(tissue, &s->own);
    }
    double *most = TM_TAKE(pool, double, mesh->region_count);
    s->domain = TM_TAKE(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    s->quarter_m3 = TM_TAKE(pool, double, mesh->tet_count);
    if (pool->failed || !tm_swollen_take_look(s, pool, s, packs)) return false;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        name_domains(s, t, s->domain + 4 * (int64_t)t);
        s->quarter_m3[t] = mesh->volume_m3[t] / 4;
    }
    for (int32_t r = 0; r < mesh->region_count; r++)
        most[r] = tm_turned_most_Pa(tissue->material + tissue->region_material[r]);
    s->bulk_Pa = smoothed->bulk_Pa;
    s->most_Pa = most;
    return true;
}

/* --- averages and pressures --- */

static void average(const tm_swollen *s) {
    const tm_domains *d = tm_swollen_domains_of(s);
    memset(s->swelling, 0, sizeof(double) * (size_t)d->count);
    memset(s->plain, 0, sizeof(double) * (size_t)d->count);
    for (int32_t t = 0; t < s->tissue->mesh->tet_count; t++) {
        if (!s->tissue->alive[t]) continue;
        const double grown = s->quarter_m3[t] * s->grown[t], straight = s->quarter_m3[t] * s->straight[t];
        for (int k = 0; k < 4; k++) {
            const int32_t i = s->domain[4 * (int64_t)t + k];
            s->swelling[i] += grown;
            s->plain[i] += straight;
        }
    }
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        s->swelling[i] /= d->volume_m3[i];
        s->plain[i] /= d->volume_m3[i];
        s->turned[i] = fmin(s->bulk_Pa[d->law[i]] * s->swelling[i], s->most_Pa[d->law[i]]);
        s->unturned[i] = s->bulk_Pa[d->law[i]] * s->plain[i];
    }
}

/* What has relaxed of each domain's pressure; a change of volume is remembered as far as tension grows, and as much
 * the other way, as in viscous_kernel.h. */
static void relax(const tm_swollen *s, const tm_viscous *v) {
    const tm_domains *d = tm_swollen_domains_of(s);
    const double tiny = 1e-60;
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const double bulk = s->bulk_Pa[d->law[i]], limit = s->most_Pa[d->law[i]] / bulk;
        const double fed = fmax(fmin(s->swelling[i], limit), -limit);
        for (int32_t t = 0; t < v->terms; t++) {
            double *memory = v->swelling[t] + i;
            const double h = *memory + v->now[t] * fed;
            s->turned[i] -= (v->shear[t] + v->more[t]) * bulk * h;
            if (!v->still) *memory = (v->keep[t] * h + v->old[t] * fed + tiny) - tiny;
        }
    }
}

/* Pressures of the domains onto their tetrahedra. */
static void hand_out(const tm_swollen *s) {
    for (int32_t t = 0; t < s->tissue->mesh->tet_count; t++) {
        if (!s->tissue->alive[t]) continue;
        const int32_t *i = s->domain + 4 * (int64_t)t;
        s->pull_J[t] = s->quarter_m3[t] * (s->turned[i[0]] + s->turned[i[1]] + s->turned[i[2]] + s->turned[i[3]]);
        s->drawn_J[t] =
            s->quarter_m3[t] * (s->unturned[i[0]] + s->unturned[i[1]] + s->unturned[i[2]] + s->unturned[i[3]]);
    }
}

void tm_swollen_look(const tm_swollen *s, const tm_packs *packs, bool plain, const double *u_m) {
    tm_swollen_choose(plain).swell(packs, s, u_m);
    average(s);
    hand_out(s);
}

void tm_swollen_add(const tm_swollen *s, const tm_packs *packs, const tm_viscous *relaxing, bool plain,
                    const double *u_m, double *force_N) {
    if (!s->tissue) return;
    const tm_swollen_passes passes = tm_swollen_choose(plain);
    passes.swell(packs, s, u_m);
    average(s);
    if (relaxing) relax(s, relaxing);
    if (!force_N) return;
    hand_out(s);
    passes.press(packs, s, force_N);
}

double tm_swollen_energy(const tm_swollen *s, const tm_packs *packs, const double *u_m) {
    if (!s->tissue) return 0;
    const tm_domains *d = tm_swollen_domains_of(s);
    double sum = 0;
    tm_swollen_look(s, packs, true, u_m);
    for (int32_t i = 0; i < d->count; i++) {
        if (!(d->volume_m3[i] > 0)) continue;
        const double bulk = s->bulk_Pa[d->law[i]], p = s->turned[i];
        /* Beyond the largest tension energy grows straight on. */
        sum += d->volume_m3[i] * (p * (s->swelling[i] - 0.5 * p / bulk) - 0.5 * bulk * s->plain[i] * s->plain[i]);
    }
    return sum;
}
