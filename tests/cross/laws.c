/* Corner forces of nonlinear laws on another machine: every SIMD form that it has against the plain one, in double and
 * in single precision, to the bit; and the correction of rotation in single precision. Prints hashes, the same
 * everywhere, and how many forms were compared. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "material/hyperelastic_single.h"
#include "tensormass.h"

enum { TETS = 108 };

/* Returns a number in [-1, 1), the same everywhere. */
static double number(void) {
    static uint64_t state = 7;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(int64_t)(state >> 11) * 0x1p-52 - 1;
}

/* Tetrahedra of 3 mm that share no vertex. */
static tm_mesh *tetrahedra(void) {
    static double vertex_m[12 * TETS];
    static int32_t tet[4 * TETS];
    for (int i = 0; i < 12 * TETS; i++) {
        const bool far = i % 12 >= 3 && i % 12 / 3 - 1 == i % 3;
        vertex_m[i] = (far ? 3e-3 : 0) + 4e-4 * number() + 4e-3 * (i / 12);
    }
    for (int i = 0; i < 4 * TETS; i++) tet[i] = i;
    tm_mesh_def def = tm_mesh_def_default();
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    def.vertex_count = 4 * TETS, def.vertex_m = vertex_m, def.tet_count = TETS, def.tet = tet;
    if (tm_mesh_create(&def, &mesh, &error)) printf("%s\n", error.message);
    return mesh;
}

typedef struct forces {
    tm_pool pool;
    tm_hyperelastic wide;
    tm_single_law narrow;
    int64_t count;
    double *u_m, *in_double;
    float *in_single;
    int compared, differ;
} forces;

static uint64_t in_double(forces *f, int form, uint64_t hash) {
    const tm_hyper_force pass = tm_hyper_force_form(form);
    if (!pass) return 0;
    const int32_t beyond = pass(&f->wide, 0, f->wide.packs.count, f->u_m, f->in_double);
    return tm_hash(f->in_double, sizeof(double) * (size_t)f->count, tm_hash(&beyond, sizeof beyond, hash));
}

static uint64_t in_single(forces *f, int form, uint64_t hash) {
    const tm_single_force pass = tm_single_force_form(form);
    if (!pass) return 0;
    const int32_t beyond = pass(&f->narrow, 0, f->wide.packs.count, f->u_m, f->in_single);
    return tm_hash(f->in_single, sizeof(float) * (size_t)f->count, tm_hash(&beyond, sizeof beyond, hash));
}

/* Strains from small to beyond the limit. */
static void compare(forces *f, int32_t displacements, uint64_t hash[2]) {
    static const double size_m[] = {1e-8, 1e-4, 1e-3, 5e-3};
    for (int i = 0; i < 4; i++) {
        for (int32_t d = 0; d < displacements; d++) f->u_m[d] = size_m[i] * number();
        const uint64_t plain[2] = {in_double(f, 0, hash[0]), in_single(f, 0, hash[1])};
        for (int form = 1; form < 3; form++) {
            const uint64_t own[2] = {in_double(f, form, hash[0]), in_single(f, form, hash[1])};
            for (int k = 0; k < 2; k++) f->compared += own[k] != 0, f->differ += own[k] && own[k] != plain[k];
        }
        memcpy(hash, plain, sizeof plain);
    }
}

static int one_law(const tm_mesh *mesh, tm_law_kind law, int *compared) {
    static const int32_t only[1] = {0};
    tm_material m;
    tm_error error;
    forces f = {0};
    const tm_law_constant *c;
    double constant[TM_LAW_CONSTANTS] = {0};
    for (int i = 0; (c = tm_law_constant_at(law, i)); i++) constant[i] = c->example;
    uint8_t *alive = malloc((size_t)mesh->tet_count);
    double *fibre = malloc(sizeof(double) * 3 * (size_t)mesh->tet_count);
    memset(alive, 1, (size_t)mesh->tet_count);
    alive[5] = 0;
    for (int32_t i = 0; i < 3 * mesh->tet_count; i++) fibre[i] = i % 3 ? 2 / 3.0 : 1 / 3.0;
    const tm_material_field field = {
        .mesh = mesh, .alive = alive, .material = &m, .region_material = only, .fibre = fibre, .material_count = 1};
    if (tm_material_young(5e3, 0.45, &m, &error) || tm_material_set_law(&m, law, constant, 0, &error) ||
        !tm_hyperelastic_take(&f.wide, &f.pool, &field) || !tm_single_law_init(&f.narrow, &f.pool, &f.wide))
        return 1;
    f.count = 12 * TM_LANES * (int64_t)f.wide.packs.count;
    f.u_m = TM_ALLOC(&f.pool, double, 3 * (int64_t)mesh->vertex_count);
    f.in_double = TM_ALLOC(&f.pool, double, f.count);
    f.in_single = TM_ALLOC(&f.pool, float, f.count);
    uint64_t hash[2] = {TM_HASH_SEED, TM_HASH_SEED};
    compare(&f, 3 * mesh->vertex_count, hash);
    printf("%s %016llx %016llx\n", tm_law_name(law), (unsigned long long)hash[0], (unsigned long long)hash[1]);
    *compared += f.compared;
    tm_pool_release(&f.pool);
    free(alive), free(fibre);
    return f.differ;
}

/* The correction of fibred tissue. Returns how many forms differ, or -1. */
static int one_rotation(const tm_mesh *mesh, int *compared) {
    static const double size_m[] = {2e-5, 1e-4, 1e-3, 5e-3};
    static const int32_t only[1] = {0};
    const int32_t n = 3 * mesh->vertex_count;
    tm_pool pool = {0};
    tm_tet_batches batches;
    tm_material m;
    tm_error error;
    uint8_t *alive = TM_ALLOC(&pool, uint8_t, mesh->tet_count);
    double *fibre = TM_ALLOC(&pool, double, n), *u_m = TM_ALLOC(&pool, double, n);
    if (pool.failed || tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error)) return -1;
    memset(alive, 1, (size_t)mesh->tet_count);
    for (int32_t i = 0; i < 3 * mesh->tet_count; i++) fibre[i] = i % 3 ? 2 / 3.0 : 1 / 3.0;
    const tm_material_field field = {.mesh = mesh,
                                     .alive = alive,
                                     .material = &m,
                                     .region_material = only,
                                     .fibre = fibre,
                                     .material_count = 1,
                                     .rotation = TM_ROTATION_THRESHOLD};
    if (!tm_tet_batches_init(&batches, &pool, &field) || !tm_single_rotation_init(&batches, &pool)) return -1;
    int32_t *every = TM_ALLOC(&pool, int32_t, batches.count), differ = 0;
    for (int32_t p = 0; p < batches.count; p++) every[p] = p;
    uint64_t hash = TM_HASH_SEED;
    for (int i = 0; i < 4; i++) {
        uint64_t own[2] = {0};
        for (int32_t d = 0; d < n; d++) u_m[d] = size_m[i] * number();
        for (int form = 0; form < 2; form++) {
            const tm_rotation_kernel pass = tm_single_rotation_form(form);
            double *force_N = TM_ALLOC(&pool, double, n), *energy_J = TM_ALLOC(&pool, double, batches.count);
            if (!pass || pool.failed) continue;
            pass(&batches, every, batches.count, u_m, force_N, energy_J);
            own[form] = tm_hash(energy_J, sizeof *energy_J * (size_t)batches.count,
                                tm_hash(force_N, sizeof *force_N * (size_t)n, hash));
        }
        *compared += own[1] != 0, differ += own[1] && own[1] != own[0];
        hash = own[0];
    }
    printf("rotation %016llx\n", (unsigned long long)hash);
    tm_pool_release(&pool);
    return differ;
}

int main(void) {
    int compared = 0, differ = 0;
    tm_mesh *mesh = tetrahedra();
    if (!mesh) return 1;
    for (int law = 1; law < TM_LAW_COUNT; law++) differ += one_law(mesh, (tm_law_kind)law, &compared);
    differ += one_rotation(mesh, &compared);
    printf("compared %d\n", compared);
    if (differ) printf("failed: %d differ\n", differ);
    tm_mesh_destroy(mesh);
    return differ != 0;
}
