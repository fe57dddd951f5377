/* Shared by C tests: reproducible random numbers, block meshes, and short calls that create a tissue. */
#ifndef TM_TEST_FIXTURE_H
#define TM_TEST_FIXTURE_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h> /* requires some of the headers above */

#include "tensormass.h"

typedef struct fix_random {
    uint64_t state;
} fix_random;

/* Returns a uniform number in [0,1). */
static inline double fix_uniform(fix_random *random) {
    random->state += 0x9e3779b97f4a7c15ULL;
    uint64_t z = random->state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}
static inline double fix_signed(fix_random *random) { return 2 * fix_uniform(random) - 1; }

/* The status must be TM_OK; prints the message if not. */
static inline void fix_ok(tm_status status, const tm_error *error) {
    if (status != TM_OK) fail_msg("%s: %s", tm_status_name(status), error->message);
}

/* Finds rows of a capsule against given triangles (tm_contact_find), with memory for this call only. */
static inline int32_t fix_find(const double *rest_m, const double *u_m, const int32_t *triangle, const int32_t *face,
                               const int32_t *candidate, int32_t count, const tm_capsule *capsule, double margin_m,
                               tm_contact_row *row, int32_t max_rows, bool *overflowed) {
    tm_contact_search *work = NULL;
    tm_error error;
    fix_ok(tm_contact_search_create(&work, &error), &error);
    const int32_t found = tm_contact_find(work, rest_m, u_m, triangle, face, candidate, count, capsule, margin_m, row,
                                          max_rows, overflowed);
    tm_contact_search_destroy(work);
    return found;
}

/* Makes a block of cells[0] x cells[1] x cells[2] boxes, six tetrahedra each; inner vertices are moved at random by
 * `jitter` times the cell. */
static inline tm_mesh *fix_block(const int cells[3], const double size_m[3], double jitter, fix_random *random) {
    static const int path[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
    const int nx = cells[0] + 1, ny = cells[1] + 1, nz = cells[2] + 1;
    const int stride[3] = {ny * nz, nz, 1};
    const int32_t n = nx * ny * nz, m = 6 * cells[0] * cells[1] * cells[2];
    double *vertex = malloc(sizeof(double) * 3 * (size_t)n);
    int32_t *tet = malloc(sizeof(int32_t) * 4 * (size_t)m);
    for (int32_t v = 0; v < n; v++) {
        const int at[3] = {v / stride[0], v / stride[1] % ny, v % nz};
        for (int i = 0; i < 3; i++) {
            const bool inner =
                at[0] > 0 && at[0] < nx - 1 && at[1] > 0 && at[1] < ny - 1 && at[2] > 0 && at[2] < nz - 1;
            vertex[3 * v + i] =
                size_m[i] / cells[i] * (at[i] + (inner && jitter > 0 ? jitter * fix_signed(random) : 0));
        }
    }
    int32_t *next = tet;
    for (int x = 0; x < cells[0]; x++)
        for (int y = 0; y < cells[1]; y++)
            for (int z = 0; z < cells[2]; z++)
                for (int p = 0; p < 6; p++, next += 4) {
                    next[0] = x * stride[0] + y * stride[1] + z;
                    for (int i = 0; i < 3; i++) next[i + 1] = next[i] + stride[path[p][i]];
                    if (p < 3) continue;
                    const int32_t swap = next[1]; /* odd permutations have the opposite orientation */
                    next[1] = next[2];
                    next[2] = swap;
                }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = n;
    def.vertex_m = vertex;
    def.tet_count = m;
    def.tet = tet;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(vertex);
    free(tet);
    return mesh;
}

/* Makes one tetrahedron from its vertices. */
static inline tm_status fix_one_tet(const double vertex_m[12], tm_mesh **mesh, tm_error *error) {
    static const int32_t tet[4] = {0, 1, 2, 3};
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = 4;
    def.vertex_m = vertex_m;
    def.tet_count = 1;
    def.tet = tet;
    return tm_mesh_create(&def, mesh, error);
}

/* Returns the same fibre for every tetrahedron; free it. */
static inline double *fix_fibres(const tm_mesh *mesh, const double a[3]) {
    double *fibre = malloc(sizeof(double) * 3 * (size_t)mesh->tet_count);
    const double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int32_t i = 0; i < 3 * mesh->tet_count; i++) fibre[i] = a[i % 3] / length;
    return fibre;
}

/* Makes a tissue with one material and uniform fibre `a` (null if isotropic). */
static inline tm_tissue *fix_tissue(const tm_mesh *mesh, const tm_material *material, const double a[3],
                                    tm_precision precision, bool cuttable) {
    double *fibre = a ? fix_fibres(mesh, a) : NULL;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh;
    def.material_count = 1;
    def.material = material;
    def.fibre = fibre;
    def.precision = precision;
    def.form = TM_FORCE_PLAIN;
    def.cuttable = cuttable;
    tm_tissue *tissue = NULL;
    tm_error error;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    free(fibre);
    return tissue;
}

static inline tm_world *fix_world(tm_tissue *tissue, bool damped) {
    tm_world_def def = tm_world_def_default();
    def.tissue = tissue;
    def.damped = damped;
    tm_world *world = NULL;
    tm_error error;
    fix_ok(tm_world_create(&def, &world, &error), &error);
    return world;
}

static inline double fix_largest(const double *a, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++) most = fmax(most, fabs(a[i]));
    return most;
}

#endif
