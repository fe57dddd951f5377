/* Compares a cut tissue with a fresh build of the remaining tetrahedra: all bits of tensors, masses and forces, the
 * surface as a set, and that it is manifold. */
#ifndef TM_TEST_CUT_CHECK_H
#define TM_TEST_CUT_CHECK_H

#include "fixture.h"
#include "libtensormass/numeric/order.h"

static inline void cut_same_surface(const tm_tissue *cut, const tm_tissue *fresh) {
    const tm_surface_view a = tm_tissue_surface(cut), b = tm_tissue_surface(fresh);
    assert_int_equal(a.count, b.count);
    int32_t *sorted = malloc(sizeof(int32_t) * (size_t)(a.count + 1));
    memcpy(sorted, a.face, sizeof(int32_t) * (size_t)a.count);
    qsort(sorted, (size_t)a.count, sizeof *sorted, num_ascending_int32);
    if (a.count) assert_memory_equal(sorted, b.face, sizeof(int32_t) * (size_t)a.count);
    const tm_mesh *mesh = tm_tissue_mesh(cut);
    for (int32_t s = 0; s < a.count; s++)
        for (int i = 0; i < 3; i++)
            assert_int_equal(a.triangle[3 * s + i], mesh->tet[4 * (a.face[s] / 4) + tm_face_vertex[a.face[s] % 4][i]]);
    free(sorted);
}

static inline void cut_same_bits(tm_tissue *cut, const tm_tissue_def *def) {
    tm_tissue_def again = *def;
    again.cuttable = false;
    again.alive = tm_tissue_alive(cut);
    tm_tissue *fresh = NULL;
    tm_error error;
    fix_ok(tm_tissue_create(&again, &fresh, &error), &error);
    const tm_mesh *mesh = def->mesh;
    const size_t n = (size_t)mesh->vertex_count;
    assert_memory_equal(tm_tissue_mass_kg(cut), tm_tissue_mass_kg(fresh), sizeof(double) * n);
    assert_memory_equal(tm_tissue_damping_kg_s(cut), tm_tissue_damping_kg_s(fresh), sizeof(double) * n);
    double A[9], B[9];
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(cut, v, A), tm_tissue_vertex_tensor(fresh, v, B);
        assert_memory_equal(A, B, sizeof A);
    }
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        tm_tissue_edge_tensor(cut, e, A), tm_tissue_edge_tensor(fresh, e, B);
        assert_memory_equal(A, B, sizeof A);
    }
    for (int32_t p = 0; p < tm_tissue_pairs(cut).count; p++) {
        tm_tissue_pair_tensor(cut, p, A), tm_tissue_pair_tensor(fresh, p, B);
        assert_memory_equal(A, B, sizeof A);
    }
    double *u = malloc(sizeof(double) * 3 * n), *f = malloc(sizeof(double) * 3 * n),
           *g = malloc(sizeof(double) * 3 * n);
    fix_random random = {(uint64_t)tm_tissue_alive_count(cut)};
    for (size_t i = 0; i < 3 * n; i++) u[i] = fix_signed(&random);
    tm_tissue_force(cut, u, f), tm_tissue_force(fresh, u, g);
    assert_memory_equal(f, g, sizeof(double) * 3 * n);
    assert_int_equal(tm_tissue_alive_count(cut), tm_tissue_alive_count(fresh));
    cut_same_surface(cut, fresh);
    free(u), free(f), free(g);
    tm_tissue_destroy(fresh);
}

/* Checks that every edge of the surface is in two triangles, once each way, and that every vertex has one fan.
 * Returns 0, or describes the defect. */
static inline const char *cut_view_not_manifold(const tm_surface_view s, int32_t n) {
    int32_t *begin = calloc((size_t)n + 2, sizeof(int32_t)),
            *corner = malloc(sizeof(int32_t) * (size_t)(3 * s.count + 1));
    const char *wrong = NULL;
    for (int32_t i = 0; i < 3 * s.count; i++) begin[s.triangle[i] + 2]++;
    for (int32_t v = 0; v < n; v++) begin[v + 2] += begin[v + 1];
    for (int32_t i = 0; i < 3 * s.count; i++) corner[begin[s.triangle[i] + 1]++] = i;
    for (int32_t v = 0; v < n && !wrong; v++) {
        const int32_t first = begin[v], count = begin[v + 1] - first;
        int32_t at = first, walked = 0;
        while (count > 0 && !wrong) {
            /* Steps from the triangle (v, a, b) to the one that leaves v towards b. */
            const int32_t c = corner[at], b = s.triangle[c / 3 * 3 + (c % 3 + 2) % 3];
            int32_t next = -1, found = 0;
            for (int32_t i = first; i < first + count; i++)
                if (s.triangle[corner[i] / 3 * 3 + (corner[i] % 3 + 1) % 3] == b) next = i, found++;
            if (found != 1) wrong = found ? "an edge of more than two triangles" : "an edge of one triangle";
            walked++;
            at = next;
            if (at == first || walked > count) break;
        }
        if (!wrong && walked != count) wrong = "a vertex of two fans";
    }
    free(begin), free(corner);
    return wrong;
}

static inline const char *cut_not_manifold(const tm_tissue *tissue) {
    return cut_view_not_manifold(tm_tissue_surface(tissue), tm_tissue_mesh(tissue)->vertex_count);
}

static inline void cut_shuffle(int32_t *item, int32_t count, fix_random *random) {
    for (int32_t i = count - 1; i > 0; i--) {
        const int32_t j = (int32_t)(fix_uniform(random) * (i + 1)), keep = item[i];
        item[i] = item[j], item[j] = keep;
    }
}

/* Sorts tetrahedra by their distance from a point, nearest first, with some noise, like the progress of an
 * instrument. */
static inline void cut_order_from(const tm_mesh *mesh, int32_t *order, fix_random *random) {
    double p[3], *key = malloc(sizeof(double) * (size_t)mesh->tet_count);
    const double *at = mesh->rest_m + 3 * (int32_t)(fix_uniform(random) * mesh->vertex_count);
    memcpy(p, at, sizeof p);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        key[t] = fix_uniform(random) * 1e-6;
        for (int i = 0; i < 3; i++) {
            const double d = mesh->rest_m[3 * mesh->tet[4 * t] + i] - p[i];
            key[t] += d * d;
        }
        int32_t j = t;
        for (; j > 0 && key[order[j - 1]] > key[t]; j--) order[j] = order[j - 1];
        order[j] = t;
    }
    free(key);
}

/* Removes `fraction` of a tissue in the given order, `batch` at a time, checking everything after each batch.
 * Returns the number of calls. */
static inline int32_t cut_down(tm_tissue *tissue, const tm_tissue_def *def, tm_world *world, const int32_t *order,
                               double fraction, int32_t batch, bool manifold_at_first) {
    const tm_mesh *mesh = def->mesh;
    const int32_t target = (int32_t)(mesh->tet_count * (1 - fraction));
    int32_t calls = 0, revision = tm_tissue_surface(tissue).revision;
    int32_t *removed = malloc(sizeof(int32_t) * (size_t)mesh->tet_count);
    for (int32_t i = 0; i < mesh->tet_count && tm_tissue_alive_count(tissue) > target; i += batch, calls++) {
        const int32_t before = tm_tissue_alive_count(tissue),
                      count = i + batch < mesh->tet_count ? batch : mesh->tet_count - i;
        const int32_t gone = tm_cut_remove(tissue, order + i, count, removed, mesh->tet_count);
        assert_int_equal(gone, before - tm_tissue_alive_count(tissue));
        for (int32_t k = 0; k < gone; k++) assert_false(tm_tissue_alive(tissue)[removed[k]]);
        assert_int_equal(tm_tissue_surface(tissue).revision, revision + (gone > 0));
        revision += gone > 0;
        cut_same_bits(tissue, def);
        const char *wrong = manifold_at_first ? cut_not_manifold(tissue) : NULL;
        if (wrong) fail_msg("surface after %d removals: %s", mesh->tet_count - tm_tissue_alive_count(tissue), wrong);
        if (world) assert_int_equal(tm_world_step(world, 3), TM_OK);
    }
    free(removed);
    return calls;
}

#endif
