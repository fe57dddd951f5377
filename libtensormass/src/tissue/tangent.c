/* Tangents on the tissue's graph: of corotated tissue, and of nonlinear laws. */
#include "base/vec.h"

#include <math.h>
#include <string.h>

#include "material/hyperelastic.h"
#include "tissue/tangent.h"

/* --- tangent of averaged dilatation: all pairs of vertices that share a domain --- */

/* Adds to the block of vertices k <= l. */
static void tm_tangent_add(const tm_tissue *tissue, tm_force_graph *graph, int32_t k, int32_t l, const double K[9]) {
    double sum[9];
    if (k == l) {
        for (int i = 0; i < 9; i++) graph->vertex_tensor[9 * (int64_t)k + i] += K[i];
        return;
    }
    const int32_t slot = tm_tissue_edge_index(tissue, tm_tissue_find_pair(tissue, k, l));
    tm_edge_read(graph, slot, sum);
    for (int i = 0; i < 9; i++) sum[i] += K[i];
    tm_edge_write(graph, slot, sum);
}

/* Computes averaged, rotated gradients of one domain's members. */
static void corotated_gradient(const tm_nodal_dilatation *s, int32_t owner, int32_t i, double *gradient) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    const tm_mesh *mesh = s->field.mesh;
    const int32_t from = d->member_at[i];
    memset(gradient, 0, 3 * sizeof(double) * (size_t)(d->member_at[i + 1] - from));
    for (int32_t j = mesh->vertex_tet_begin[owner]; j < mesh->vertex_tet_begin[owner + 1]; j++) {
        const int32_t t = mesh->vertex_tet[j];
        if (!s->field.alive[t] || s->field.smoothed->law[mesh->region[t]] != d->law[i]) continue;
        const double *R = s->rotation + 9 * TM_LANES * (int64_t)(t / TM_LANES) + t % TM_LANES;
        const double share = s->quarter_m3[t] / d->volume_m3[i];
        for (int k = 0; k < 4; k++) {
            const double *alpha = mesh->shape_1_m + 12 * (int64_t)t + 3 * k;
            int32_t m = from;
            while (d->member[m] != mesh->tet[4 * (int64_t)t + k]) m++;
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    gradient[3 * (m - from) + a] += share * R[TM_LANES * (3 * a + b)] * alpha[b];
        }
    }
}

static void add_domain(const tm_tissue *tissue, const tm_nodal_dilatation *s, int32_t i, const double *turned,
                       tm_tangent *tangent) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    const int32_t from = d->member_at[i], to = d->member_at[i + 1];
    /* The tensors' bulk modulus is not the law's while that is the long-term one. */
    const double stiffness = s->field.smoothed->bulk_Pa[d->law[i]] * d->volume_m3[i];
    const bool grows = tangent->definite || tm_nodal_dilatation_grows(s, i, d->law[i]);
    const double steep = grows ? s->bulk_Pa[d->law[i]] * d->volume_m3[i] : 0;
    for (int32_t m = from; m < to; m++)
        for (int32_t n = m; n < to && d->lives[m]; n++) {
            if (!d->lives[n]) continue;
            double K[9];
            const double *a = turned + 3 * (m - from), *b = turned + 3 * (n - from);
            const double *a0 = d->gradient + 3 * (int64_t)m, *b0 = d->gradient + 3 * (int64_t)n;
            for (int k = 0; k < 9; k++) K[k] = steep * a[k / 3] * b[k % 3] - stiffness * a0[k / 3] * b0[k % 3];
            tm_tangent_add(tissue, &tangent->graph, d->member[m], d->member[n], K);
        }
}

void tm_tangent_add_domains(const tm_tissue *tissue, int32_t begin, int32_t end, tm_tangent *tangent) {
    const tm_nodal_dilatation *s = &tangent->nodal_dilatation;
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    const int64_t tets = tissue->mesh->tet_count, vertices = tissue->mesh->vertex_count;
    for (int32_t v = (int32_t)(vertices * begin / tets); v < (int32_t)(vertices * end / tets); v++)
        for (int32_t i = d->begin[v]; i < d->begin[v + 1]; i++) {
            if (!(d->volume_m3[i] > 0)) continue;
            corotated_gradient(s, v, i, tangent->gradient);
            add_domain(tissue, s, i, tangent->gradient, tangent);
        }
}

static int32_t tm_nodal_dilatation_max_members(const tm_nodal_dilatation *s) {
    const tm_domains *d = tm_nodal_dilatation_domains_of(s);
    int32_t most = 0;
    for (int32_t i = 0; i < d->count; i++)
        if (d->member_at[i + 1] - d->member_at[i] > most) most = d->member_at[i + 1] - d->member_at[i];
    return most;
}

bool tm_tangent_take_tensors(tm_tangent *tangent, tm_pool *pool, const tm_tissue *tissue) {
    tangent->graph = tissue->graph;
    tangent->graph.vertex_tensor = TM_ALLOC(pool, double, 9 * (int64_t)tissue->mesh->vertex_count + TM_FORCE_PADDING);
    tangent->graph.edge_tensor = TM_ALLOC(pool, double, 8 * (int64_t)tissue->pair_count);
    tangent->graph.edge_last = TM_ALLOC(pool, double, tissue->pair_count);
    tangent->force = tm_force_choose(tissue->plain, false);
    tangent->definite = false;
    return !pool->failed;
}

bool tm_tangent_take_averaged(tm_tangent *tangent, tm_pool *pool, const tm_tissue *tissue,
                              const tm_nodal_dilatation *averages) {
    const int32_t batches = (tissue->mesh->tet_count + TM_LANES - 1) / TM_LANES;
    if (!tm_nodal_dilatation_init_evaluation(&tangent->nodal_dilatation, pool, averages, batches)) return false;
    if (tm_nodal_dilatation_is_on(averages))
        tangent->gradient = TM_ALLOC(pool, double, 3 * (int64_t)tm_nodal_dilatation_max_members(averages));
    return tm_tangent_take_tensors(tangent, pool, tissue);
}

tm_material_field tm_rotation_field(const tm_tissue *tissue) {
    tm_material_field field = tm_tissue_field(tissue);
    if (!tm_effects_meet(&field, TM_REGION_ROTATION | TM_REGION_SMOOTHING)) field.smoothed = NULL;
    return field;
}

bool tm_tangent_init(tm_tangent *tangent, tm_pool *pool, const tm_rotation *rotation) {
    return tm_tangent_take_averaged(tangent, pool, rotation->tissue, &rotation->nodal_dilatation);
}

/* Computes K_kl of one tetrahedron from its 9x9: rows are the components of k. */
static void block(const double A[81], const double *k, const double *l, double K[9]) {
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < 3; a++) {
            K[3 * i + a] = 0;
            for (int j = 0; j < 3; j++)
                for (int b = 0; b < 3; b++) K[3 * i + a] += A[9 * (3 * i + j) + 3 * a + b] * k[j] * l[b];
        }
}

void tm_tangent_add_pair(const tm_tissue *tissue, int32_t k, int32_t l, const double K[9], tm_tangent *tangent) {
    tm_tangent_add(tissue, &tangent->graph, k, l, K);
}

void tm_tangent_add_tet(const tm_tissue *tissue, int32_t tet, const double A[81], tm_tangent *tangent) {
    const tm_mesh *mesh = tissue->mesh;
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    const int32_t *v = mesh->tet + 4 * (int64_t)tet;
    double K[9];
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++) {
            if (v[l] < v[k]) continue;
            block(A, alpha + 3 * k, alpha + 3 * l, K);
            tm_tangent_add(tissue, &tangent->graph, v[k], v[l], K);
        }
}

/* Adds weight (R K R^T - K) for each block of a tetrahedron. */
static void add_turned(const tm_tissue *tissue, int32_t tet, const tm_corotated_lane *w, tm_force_graph *graph) {
    const tm_mesh *mesh = tissue->mesh;
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    const int32_t *v = mesh->tet + 4 * (int64_t)tet;
    double A[81], K[9], half[9];
    tm_rotation_linear(w, A);
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++) {
            if (v[l] < v[k]) continue;
            block(A, alpha + 3 * k, alpha + 3 * l, K);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) half[3 * i + j] = vdot(K + 3 * i, w->R + 3 * j);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    double turned = 0;
                    for (int m = 0; m < 3; m++) turned += w->R[3 * i + m] * half[3 * m + j];
                    K[3 * i + j] = w->weight * (turned - K[3 * i + j]);
                }
            tm_tangent_add(tissue, graph, v[k], v[l], K);
        }
}

/* Adds the change of one tetrahedron's dilatation with its rotation, under the pressures around it. */
static void add_swelling(const tm_tissue *tissue, int32_t tet, const double *u_m, tm_tangent *tangent) {
    const tm_mesh *mesh = tissue->mesh;
    const tm_nodal_dilatation *s = &tangent->nodal_dilatation;
    const double *turn = s->rotation + 9 * TM_LANES * (int64_t)(tet / TM_LANES) + tet % TM_LANES;
    double H[9] = {0}, R[9], A[81];
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 9; i++)
            H[i] += u_m[3 * (int64_t)mesh->tet[4 * (int64_t)tet + k] + i / 3] *
                    mesh->shape_1_m[12 * (int64_t)tet + 3 * k + i % 3];
    for (int i = 0; i < 9; i++) R[i] = turn[TM_LANES * i];
    tm_stretch_hessian(H, R, s->dilatation[tet] / s->quarter_m3[tet] + 3, A);
    double pull = 0;
    for (int k = 0; k < 4; k++) pull += s->corotated_Pa[s->domain[4 * (int64_t)tet + k]];
    for (int i = 0; i < 81; i++) A[i] *= s->quarter_m3[tet] * pull;
    tm_tangent_add_tet(tissue, tet, A, tangent);
}

void tm_tangent_begin(const tm_tissue *tissue, tm_tangent *tangent) {
    const tm_mesh *mesh = tissue->mesh;
    double K[9];
    memcpy(tangent->graph.vertex_tensor, tissue->graph.vertex_tensor, 9 * sizeof(double) * (size_t)mesh->vertex_count);
    for (int32_t p = 0; p < tissue->pair_count; p++) {
        const int32_t slot = tm_tissue_edge_index(tissue, p);
        if (slot < 0) continue;
        tm_tissue_pair_tensor(tissue, p, K);
        tm_edge_write(&tangent->graph, slot, K);
    }
}

void tm_rotation_tangent_add(const tm_rotation *rotation, const double *u_m, int32_t begin, int32_t end,
                             tm_tangent *tangent) {
    const tm_tissue *tissue = rotation->tissue;
    double A[81];
    tm_corotated_lane lane;
    if (tm_nodal_dilatation_is_on(&rotation->nodal_dilatation)) {
        if (begin == 0)
            tm_nodal_dilatation_evaluate(&tangent->nodal_dilatation, &rotation->batches, tissue->plain, u_m);
        tm_tangent_add_domains(tissue, begin, end, tangent);
        for (int32_t t = begin; t < end && !tangent->definite; t++)
            if (tissue->alive[t]) add_swelling(tissue, t, u_m, tangent);
    }
    for (int32_t t = begin; t < end; t++) {
        if (!tissue->alive[t] || !tm_rotation_lane(&rotation->batches, t, u_m, &lane)) continue;
        if (tangent->definite) {
            add_turned(tissue, t, &lane, &tangent->graph);
            continue;
        }
        tm_rotation_hessian(&lane, A);
        tm_tangent_add_tet(tissue, t, A, tangent);
    }
}

void tm_rotation_tangent(const tm_rotation *rotation, const double *u_m, tm_tangent *tangent) {
    tm_tangent_begin(rotation->tissue, tangent);
    tm_rotation_tangent_add(rotation, u_m, 0, rotation->tissue->mesh->tet_count, tangent);
}

/* --- tissue without a world --- */

double tm_tissue_rotation(const tm_tissue *tissue) {
    TM_REQUIRE(tissue, "tissue is null", 0);
    return tissue->rotation;
}

static void write_tensors(tm_tissue *tissue, const tm_tangent *tangent) {
    memcpy(tissue->graph.vertex_tensor, tangent->graph.vertex_tensor,
           9 * sizeof(double) * (size_t)tissue->mesh->vertex_count);
    memcpy(tissue->graph.edge_tensor, tangent->graph.edge_tensor, 8 * sizeof(double) * (size_t)tissue->pair_count);
    memcpy(tissue->graph.edge_last, tangent->graph.edge_last, sizeof(double) * (size_t)tissue->pair_count);
}

static bool rotate_one(tm_tissue *tissue, const double *u_m, tm_pool *pool) {
    const tm_material_field field = tm_rotation_field(tissue);
    tm_rotation rotation = {.tissue = tissue};
    tm_tangent tangent = {0};
    if (!tm_tet_batches_init(&rotation.batches, pool, &field) ||
        !tm_nodal_dilatation_init(&rotation.nodal_dilatation, pool, &field, rotation.batches.count) ||
        !tm_tangent_init(&tangent, pool, &rotation))
        return false;
    tangent.definite = true;
    tm_rotation_tangent(&rotation, u_m, &tangent);
    write_tensors(tissue, &tangent);
    return true;
}

tm_status tm_tissue_corotate(tm_tissue *tissue, double threshold, const double *u_m, tm_error *error) {
    TM_REQUIRE(tissue && u_m, "tissue or u_m is null", TM_ERR_ARGUMENT);
    if (!(threshold > 0) || tissue->precision != TM_DOUBLE || tm_tissue_smoothed_shear_share(tissue) > 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "corotated tensors with threshold %g; give a threshold above 0, double precision and a smoothed "
                       "shear share of 0",
                       threshold);
    tm_pool pool = {0};
    tissue->rotation = threshold;
    const bool good = rotate_one(tissue, u_m, &pool);
    tm_pool_release(&pool);
    return good ? TM_OK : tm_fail_memory(error, "corotated tensors");
}

/* A := its positive semidefinite part. */
static void drop_negative(double A[81]) {
    double V[81] = {0}, D[81];
    memcpy(D, A, sizeof D);
    for (int i = 0; i < 81; i += 10) V[i] = 1;
    for (int sweep = 0; sweep < 12; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < 81; i++) *(i % 10 ? &off : &diagonal) += D[i] * D[i];
        if (off <= 1e-20 * diagonal) break;
        for (int p = 0; p < 8; p++)
            for (int q = p + 1; q < 9; q++) {
                double c, s;
                tm_jacobi(D, 9, p, q, &c, &s);
                for (int k = 0; k < 9; k++) {
                    const double a = V[9 * k + p], b = V[9 * k + q];
                    V[9 * k + p] = c * a - s * b, V[9 * k + q] = s * a + c * b;
                }
            }
    }
    for (int i = 0; i < 81; i++) {
        A[i] = 0;
        for (int k = 0; k < 9; k++) A[i] += fmax(D[10 * k], 0) * V[9 * (i / 9) + k] * V[9 * (i % 9) + k];
    }
}

/* What the tangent of a law needs: its batches, and with averaged dilatation an evaluation at u. */
typedef struct law_tangent {
    tm_hyperelastic hyper;
    tm_tangent tangent;
    bool averaged;
} law_tangent;

/* The domains are those of `tissue`, whose tetrahedra are averaged, and which no other thread changes. */
static bool evaluate_law(law_tangent *l, const tm_tissue *tissue, const tm_tissue *whole, const double *u_m,
                         tm_pool *pool) {
    tm_material_field field = tm_tissue_field(whole);
    tm_nodal_dilatation averages;
    field.alive = tissue->alive, field.smoothed = tissue->smoothed;
    l->averaged = tissue->smoothed != NULL;
    if (!tm_hyperelastic_take(&l->hyper, pool, &field)) return false;
    const int32_t batches = l->hyper.packs.count;
    if (!tm_nodal_dilatation_init(&averages, pool, &field, batches) ||
        !tm_tangent_take_averaged(&l->tangent, pool, tissue, &averages))
        return false;
    if (!l->averaged) return true;
    tm_viscous work = {.stress_J = TM_ALLOC(pool, double, 9 * TM_LANES * (int64_t)batches)};
    if (pool->failed) return false;
    tm_hyperelastic_evaluate(&l->hyper, &work, &l->tangent.nodal_dilatation, whole->plain, u_m);
    return true;
}

static bool take_law(tm_tissue *tissue, const tm_tissue *whole, const double *u_m, bool definite, tm_pool *pool) {
    law_tangent l = {0};
    const int32_t tets = tissue->mesh->tet_count;
    if (!evaluate_law(&l, tissue, whole, u_m, pool)) return false;
    l.tangent.definite = definite;
    tm_tangent_begin(tissue, &l.tangent);
    if (l.averaged) tm_tangent_add_domains(tissue, 0, tets, &l.tangent);
    for (int32_t t = 0; t < tets; t++) {
        double A[81], linear[81];
        tm_corotated_lane lane;
        if (!tissue->alive[t]) continue;
        tm_hyperelastic_hessian(&l.hyper, t, u_m, A);
        if (l.averaged) tm_hyperelastic_add_bend(&l.hyper, &l.tangent.nodal_dilatation, t, u_m, A);
        if (definite) drop_negative(A);
        tm_rotation_lane_law(&l.hyper.packs, t, &lane);
        tm_rotation_linear(&lane, linear);
        for (int i = 0; i < 81; i++) A[i] -= linear[i];
        tm_tangent_add_tet(tissue, t, A, &l.tangent);
    }
    write_tensors(tissue, &l.tangent);
    return true;
}

tm_status tm_tissue_take_tangent(tm_tissue *tissue, const tm_tissue *whole, const double *u_m, bool definite,
                                 tm_error *error) {
    TM_REQUIRE(tissue && whole && u_m && tissue->mesh == whole->mesh,
               "tissue, whole or u_m is null, or the two have different meshes", TM_ERR_ARGUMENT);
    if (!whole->stiffest_Pa || tissue->stiffest_Pa || !tissue->smoothed != !whole->smoothed ||
        tissue->precision != TM_DOUBLE)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "tangent of a nonlinear law: give linear tissue in double, with strain smoothing if and only if "
                       "the tissue that has the law has it");
    tm_pool pool = {0};
    const bool good = take_law(tissue, whole, u_m, definite, &pool);
    tm_pool_release(&pool);
    return good ? TM_OK : tm_fail_memory(error, "tangent of a nonlinear law");
}
