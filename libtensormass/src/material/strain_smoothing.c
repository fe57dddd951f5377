/* Smoothing domains of vertices and edges, their members and averaged gradients. */
#include "material/strain_smoothing.h"

#include <string.h>

static int32_t law_of(const tm_material_field *field, int32_t tet) {
    return field->smoothed->law[field->mesh->region[tet]];
}

/* --- the tetrahedra around an owner --- */

typedef struct star {
    const int32_t *tet;
    int32_t count;
} star;

static int32_t owners(const tm_mesh *mesh, const tm_domains *d) {
    return d->of_edges ? mesh->edge_count : mesh->vertex_count;
}

static star star_of(const tm_mesh *mesh, const tm_domains *d, int32_t owner) {
    const int32_t *begin = d->of_edges ? mesh->edge_tet_begin : mesh->vertex_tet_begin;
    return (star){(d->of_edges ? mesh->edge_tet : mesh->vertex_tet) + begin[owner], begin[owner + 1] - begin[owner]};
}

static int32_t most_around(const tm_mesh *mesh) {
    int32_t most = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const int32_t n = mesh->vertex_tet_begin[v + 1] - mesh->vertex_tet_begin[v];
        if (n > most) most = n;
    }
    return most;
}

/* Returns whether the i-th tetrahedron of a star is the first with its law. */
static bool opens_domain(const tm_material_field *field, star s, int32_t i) {
    if (law_of(field, s.tet[i]) < 0) return false;
    for (int32_t j = 0; j < i; j++)
        if (law_of(field, s.tet[j]) == law_of(field, s.tet[i])) return false;
    return true;
}

/* Lists the vertices of the star's tetrahedra of one law, ascending. */
static int32_t collect(const tm_material_field *field, star s, int32_t law, int32_t *list) {
    int32_t count = 0;
    for (int32_t i = 0; i < s.count; i++)
        for (int k = 0; k < 4 && law_of(field, s.tet[i]) == law; k++) {
            const int32_t v = field->mesh->tet[4 * (int64_t)s.tet[i] + k];
            int32_t at = count;
            while (at > 0 && list[at - 1] > v) at--;
            if (at > 0 && list[at - 1] == v) continue;
            memmove(list + at + 1, list + at, sizeof *list * (size_t)(count - at));
            list[at] = v;
            count++;
        }
    return count;
}

/* --- building --- */

/* Counts, or with `fill` writes, domains and members. */
static void walk_domains(const tm_material_field *field, tm_domains *d, int32_t *list, bool fill) {
    d->count = d->member_count = 0;
    for (int32_t o = 0; o < owners(field->mesh, d); o++) {
        const star s = star_of(field->mesh, d, o);
        if (fill) d->begin[o] = d->count;
        for (int32_t i = 0; i < s.count; i++) {
            if (!opens_domain(field, s, i)) continue;
            const int32_t law = law_of(field, s.tet[i]), members = collect(field, s, law, list);
            if (fill) {
                d->law[d->count] = law;
                d->member_at[d->count] = d->member_count;
                memcpy(d->member + d->member_count, list, sizeof *list * (size_t)members);
            }
            d->count++;
            d->member_count += members;
        }
    }
    if (!fill) return;
    d->begin[owners(field->mesh, d)] = d->count;
    d->member_at[d->count] = d->member_count;
}

static void invert_members(const tm_mesh *mesh, tm_domains *d) {
    for (int32_t m = 0; m < d->member_count; m++) d->held_at[d->member[m] + 1]++;
    for (int32_t v = 0; v < mesh->vertex_count; v++) d->held_at[v + 1] += d->held_at[v];
    for (int32_t i = d->count - 1; i >= 0; i--) /* backwards, so that each list ascends */
        for (int32_t m = d->member_at[i + 1] - 1; m >= d->member_at[i]; m--) {
            const int32_t at = --d->held_at[d->member[m] + 1];
            d->held_by[at] = i;
            d->held_as[at] = m;
        }
    for (int32_t v = 0; v < mesh->vertex_count; v++) d->held_at[v] = d->held_at[v + 1];
    d->held_at[mesh->vertex_count] = d->member_count;
}

static bool alloc_domains(const tm_material_field *field, tm_pool *pool, tm_domains *d, int32_t *list) {
    const tm_mesh *mesh = field->mesh;
    walk_domains(field, d, list, false);
    d->begin = TM_ALLOC(pool, int32_t, (int64_t)owners(mesh, d) + 1);
    d->law = TM_ALLOC(pool, int32_t, d->count);
    d->member_at = TM_ALLOC(pool, int32_t, (int64_t)d->count + 1);
    d->member = TM_ALLOC(pool, int32_t, d->member_count);
    d->lives = TM_ALLOC(pool, uint8_t, d->member_count);
    d->gradient = TM_ALLOC(pool, double, 3 * (int64_t)d->member_count);
    d->volume_m3 = TM_ALLOC(pool, double, d->count);
    if (d->of_edges && field->fibre) d->law_Pa = TM_ALLOC(pool, double, 36 * (int64_t)d->count);
    d->held_at = TM_ALLOC(pool, int32_t, (int64_t)mesh->vertex_count + 1);
    d->held_by = TM_ALLOC(pool, int32_t, d->member_count);
    d->held_as = TM_ALLOC(pool, int32_t, d->member_count);
    if (pool->failed) return false;
    walk_domains(field, d, list, true);
    invert_members(mesh, d);
    return true;
}

bool tm_smoothed_build_domains(const tm_material_field *field, tm_pool *pool, tm_domains *vertex, tm_domains *edge) {
    tm_pool scratch = {0};
    int32_t *list = TM_ALLOC(&scratch, int32_t, 4 * (int64_t)most_around(field->mesh));
    *vertex = (tm_domains){.of_edges = false};
    *edge = (tm_domains){.of_edges = true};
    const bool good = list && alloc_domains(field, pool, vertex, list) &&
                      (field->smoothed->shear == 0 || alloc_domains(field, pool, edge, list));
    tm_pool_release(&scratch);
    return good;
}

/* --- averages --- */

static void add_law(const tm_material_field *field, int32_t tet, double share_m3, double *law_Pa) {
    double C[36];
    tm_material_voigt(field->smoothed->remainder + field->mesh->region[tet], tm_field_fibre(field, tet), C);
    for (int i = 0; i < 36; i++) law_Pa[i] += share_m3 * C[i];
}

void tm_smoothed_average(const tm_material_field *field, tm_domains *d, int32_t owner) {
    const tm_mesh *mesh = field->mesh;
    const star s = star_of(mesh, d, owner);
    for (int32_t i = d->begin[owner]; i < d->begin[owner + 1]; i++) {
        const int32_t from = d->member_at[i], to = d->member_at[i + 1];
        double *law_Pa = d->law_Pa ? d->law_Pa + 36 * (int64_t)i : NULL, volume = 0;
        memset(d->lives + from, 0, (size_t)(to - from));
        memset(d->gradient + 3 * (int64_t)from, 0, 3 * sizeof(double) * (size_t)(to - from));
        if (law_Pa) memset(law_Pa, 0, 36 * sizeof(double));
        for (int32_t j = 0; j < s.count; j++) {
            const int32_t t = s.tet[j];
            if (!field->alive[t] || law_of(field, t) != d->law[i]) continue;
            const double share = mesh->volume_m3[t] / (d->of_edges ? 6 : 4);
            volume += share;
            for (int k = 0; k < 4; k++) {
                int32_t m = from;
                while (d->member[m] != mesh->tet[4 * (int64_t)t + k]) m++;
                d->lives[m] = 1;
                for (int a = 0; a < 3; a++)
                    d->gradient[3 * (int64_t)m + a] += share * mesh->shape_1_m[12 * (int64_t)t + 3 * k + a];
            }
            if (law_Pa) add_law(field, t, share, law_Pa);
        }
        d->volume_m3[i] = volume;
        for (int64_t m = 3 * (int64_t)from; volume > 0 && m < 3 * (int64_t)to; m++) d->gradient[m] /= volume;
        for (int k = 0; law_Pa && volume > 0 && k < 36; k++) law_Pa[k] /= volume;
    }
}

void tm_smoothed_average_all(const tm_material_field *field, tm_domains *d) {
    for (int32_t o = 0; d->begin && o < owners(field->mesh, d); o++) tm_smoothed_average(field, d, o);
}

/* --- upper bound of the averaged law --- */

const tm_material *tm_smoothed_cover(const tm_material_field *field, int32_t tet, tm_material *cover) {
    const tm_smoothed *s = field->smoothed;
    const int32_t region = field->mesh->region[tet];
    if (!tm_field_is_smoothed(field, tet)) return NULL;
    if (tm_material_is_isotropic(s->remainder + region)) return NULL;
    *cover = (tm_material){.lambda_Pa = s->bulk_Pa[region],
                           .mu_Pa = tm_material_stiffest_Pa(s->remainder + region) / 2,
                           .density_kg_m3 = s->remainder[region].density_kg_m3};
    return cover;
}
