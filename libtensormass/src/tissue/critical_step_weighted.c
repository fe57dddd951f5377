/* Irons' bound with the mass of a vertex divided among its tetrahedra by demand, not evenly.
 *
 * Every K_e is bounded by a diagonal: K_e <= diag(demand_e), demand_e = lambda_max(diag(w)^-1 K_e) w for any four
 * weights w > 0. The sum over tetrahedra gives K <= diag(sum of demand) <= most M with most = max over vertices of (sum
 * of demand) / m: that bounds omega^2. With w = rho V/4 throughout it never exceeds max lambda_e, the even bound; other
 * weights are allowed. A few sweeps reduce them at vertices of high demand and increase them at the others, in the
 * tetrahedra around the worst vertices. The lowest bound found is used. */
#include "tissue/tissue_internal.h"

#include <math.h>
#include <string.h>

#include "material/law.h"

/* --- largest eigenvalues of single tetrahedra, the basis of critical steps (Irons) --- */

/* Returns a bound of the largest eigenvalue of a symmetric A, by the norm of its square: 3 % above it if the next one
 * is half as large. It costs a twentieth of the eigenvalues. */
static double largest_at_most(const double A[36]) {
    double sum = 0;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double square = 0;
            for (int k = 0; k < 6; k++) square += A[6 * i + k] * A[6 * j + k];
            sum += (i == j ? 1 : 2) * square * square;
        }
    return sqrt(sqrt(sum));
}

/* K_e = V B^T C B and M_e = rho V/4: the eigenvalues are 4/rho times those of L^T (B B^T) L, C = L L^T. */
double tm_element_eigenvalue_above(const tm_tissue *tissue, int32_t tet, double floor) {
    const tm_material *material = tm_tissue_tet_material(tissue, tet);
    const tm_material_field field = tm_tissue_field(tissue);
    double G[36] = {0}, A[36];
    if (!tm_law_of_tet(&field, tet)->has_constant_tangent) {
        const double mass = material->density_kg_m3 * tissue->mesh->volume_m3[tet] / 4;
        return tm_law_of_tet(&field, tet)->bound(&field, tet, (const double[4]){mass, mass, mass, mass});
    }
    for (int k = 0; k < 4; k++) tm_strain_gram_add(tissue->mesh->shape_1_m + 12 * (int64_t)tet + 3 * k, 1, G);
    const double scale = 4 / material->density_kg_m3;
    double trace = 0;
    for (int i = 0; i < 6; i++) trace += G[7 * i];
    if (!tissue->smoothed && scale * trace * tm_material_stiffest_Pa(material) <= floor) return 0;
    tm_linear_gram(&field, tet, G, A);
    if (scale * largest_at_most(A) <= (1 - 1e-12) * floor) return 0;
    tm_diagonalise6(A);
    double most = 0;
    for (int i = 0; i < 6; i++) most = fmax(most, A[7 * i]);
    return scale * most;
}

double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]) {
    const tm_material_field field = tm_tissue_field(tissue);
    return tm_law_of_tet(&field, tet)->bound(&field, tet, mass_kg);
}

double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet) {
    return tm_element_eigenvalue_above(tissue, tet, 0);
}

typedef struct sharing {
    tm_pool pool;
    const tm_tissue *tissue;
    double *demand; /* [4*tet_count] kg/s2 */
    double *load;   /* [vertex_count] sum of demand over mass, 1/s2 */
    int64_t evaluations;
} sharing;

/* Five sweeps bring most of the gain. Uniform meshes gain nothing, and there every tetrahedron is near a worst vertex:
 * so idle sweeps end the search, and evaluations are limited to a few microseconds per tetrahedron. */
enum { SWEEPS = 12, IDLE = 3, EVALUATIONS_PER_TET = 4 };
static const double HOT = 0.9, MIN_LOAD = 0.05;

static void ask(sharing *s, int32_t tet, const double weight[4]) {
    const double most = tm_element_eigenvalue_over(s->tissue, tet, weight);
    for (int k = 0; k < 4; k++) s->demand[4 * (int64_t)tet + k] = most * weight[k];
    s->evaluations++;
}

static double even_share(const tm_tissue *tissue, int32_t tet) {
    return tm_tissue_tet_material(tissue, tet)->density_kg_m3 * tissue->mesh->volume_m3[tet] / 4;
}

/* Computes loads from demands. Returns the largest, and the tetrahedron there with the largest demand relative to its
 * own mass. */
static double balance(sharing *s, int32_t *tet) {
    const tm_mesh *mesh = s->tissue->mesh;
    double most = 0, worst = 0;
    int32_t at = -1;
    memset(s->load, 0, sizeof(double) * (size_t)mesh->vertex_count);
    for (int64_t i = 0; i < 4 * (int64_t)mesh->tet_count; i++)
        if (s->tissue->alive[i / 4]) s->load[mesh->tet[i]] += s->demand[i];
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        if (!(s->tissue->mass_kg[v] > 0)) continue;
        s->load[v] /= s->tissue->mass_kg[v];
        if (s->load[v] > most) most = s->load[v], at = v;
    }
    for (int32_t i = at < 0 ? 0 : mesh->vertex_tet_begin[at]; at >= 0 && i < mesh->vertex_tet_begin[at + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i];
        for (int k = 0; k < 4 && s->tissue->alive[t]; k++) {
            const double over = s->demand[4 * (int64_t)t + k] / even_share(s->tissue, t);
            if (mesh->tet[4 * (int64_t)t + k] != at || over <= worst) continue;
            worst = over;
            *tet = t;
        }
    }
    return most;
}

/* Sets new weights near the vertices whose load is close to `most`: demand over load. */
static void sweep(sharing *s, double most) {
    const tm_mesh *mesh = s->tissue->mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double weight[4], hottest = 0;
        for (int k = 0; k < 4 && s->tissue->alive[t]; k++) {
            const double load = s->load[mesh->tet[4 * (int64_t)t + k]] / most;
            hottest = fmax(hottest, load);
            weight[k] = s->demand[4 * (int64_t)t + k] / fmax(load, MIN_LOAD);
        }
        if (hottest >= HOT) ask(s, t, weight);
    }
}

bool tm_shared_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet) {
    const tm_mesh *mesh = tissue->mesh;
    sharing s = {.tissue = tissue};
    s.demand = TM_ALLOC(&s.pool, double, 4 * (int64_t)mesh->tet_count);
    s.load = TM_ALLOC(&s.pool, double, mesh->vertex_count);
    const bool room = !s.pool.failed;
    for (int32_t t = 0; room && t < mesh->tet_count; t++) {
        const double even = even_share(tissue, t), weight[4] = {even, even, even, even};
        if (tissue->alive[t]) ask(&s, t, weight);
    }
    const int64_t enough = EVALUATIONS_PER_TET * (int64_t)mesh->tet_count;
    for (int k = 0, idle = 0; room && k < SWEEPS && idle < IDLE && s.evaluations < enough; k++) {
        int32_t at = *tet;
        const double now = balance(&s, &at);
        idle = now < *most * (1 - 1e-3) ? 0 : idle + 1;
        if (now < *most) {
            *most = now;
            *tet = at;
        }
        sweep(&s, now);
    }
    tm_pool_release(&s.pool);
    return room;
}
