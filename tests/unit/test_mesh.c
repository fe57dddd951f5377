/* Topology against brute force, and every rejection of tm_mesh_create. */
#include "../fixture.h"

static void topology_agrees_with_brute_force(void **state) {
    (void)state;
    fix_random random = {1};
    tm_mesh *mesh = fix_block((int[3]){3, 2, 4}, (double[3]){0.03, 0.02, 0.04}, 0.2, &random);
    double volume = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) volume += mesh->volume_m3[t];
    assert_true(fabs(volume / 24e-6 - 1) < 1e-12);
    assert_int_equal(mesh->tet_count, 144);
    assert_int_equal(mesh->surface_count, 2 * 2 * (3 * 2 + 2 * 4 + 3 * 4));
    /* Euler: V - E + F - T = 1 for a ball. */
    assert_int_equal(
        mesh->vertex_count - mesh->edge_count + (4 * mesh->tet_count + mesh->surface_count) / 2 - mesh->tet_count, 1);
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        const int32_t *a = mesh->edge + 2 * e;
        assert_true(a[0] < a[1]);
        if (e) assert_true(a[-2] < a[0] || (a[-2] == a[0] && a[-1] < a[1]));
        for (int32_t i = mesh->edge_tet_begin[e] + 1; i < mesh->edge_tet_begin[e + 1]; i++)
            assert_true(mesh->edge_tet[i - 1] < mesh->edge_tet[i]);
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const int32_t *v = mesh->tet + 4 * t;
        for (int e = 0; e < 6; e++) {
            const int32_t a = v[tm_edge_vertex[e][0]], b = v[tm_edge_vertex[e][1]],
                          *edge = mesh->edge + 2 * mesh->tet_edge[6 * t + e];
            assert_true((edge[0] == a && edge[1] == b) || (edge[0] == b && edge[1] == a));
        }
        for (int f = 0; f < 4; f++) {
            const int32_t other = mesh->tet_neighbour[4 * t + f];
            if (other < 0) continue;
            int shared = 0;
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 4; j++) shared += v[tm_face_vertex[f][i]] == mesh->tet[4 * other + j];
            assert_int_equal(shared, 3);
        }
        /* alpha_k . (p_j - p_i) = delta_jk - delta_ik */
        for (int k = 0; k < 4; k++)
            for (int j = 1; j < 4; j++) {
                double d = 0;
                for (int i = 0; i < 3; i++)
                    d +=
                        mesh->shape_1_m[12 * t + 3 * k + i] * (mesh->rest_m[3 * v[j] + i] - mesh->rest_m[3 * v[0] + i]);
                assert_true(fabs(d - (k == j) + (k == 0)) < 1e-12);
            }
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_edge_begin[v]; i < mesh->vertex_edge_begin[v + 1]; i++) {
            const int32_t *a = mesh->edge + 2 * mesh->vertex_edge[i];
            assert_true(a[0] == v || a[1] == v);
            if (i == mesh->vertex_edge_begin[v]) continue;
            const int32_t *b = mesh->edge + 2 * mesh->vertex_edge[i - 1];
            assert_true(b[0] + b[1] < a[0] + a[1]);
        }
    /* Outward: the divergence theorem gives the volume back. */
    double flux = 0;
    for (int32_t s = 0; s < mesh->surface_count; s++) {
        const double *p = mesh->rest_m + 3 * mesh->surface[3 * s], *q = mesh->rest_m + 3 * mesh->surface[3 * s + 1],
                     *r = mesh->rest_m + 3 * mesh->surface[3 * s + 2];
        flux += (p[0] * (q[1] * r[2] - q[2] * r[1]) + p[1] * (q[2] * r[0] - q[0] * r[2]) +
                 p[2] * (q[0] * r[1] - q[1] * r[0])) /
                6;
    }
    assert_true(fabs(flux / volume - 1) < 1e-12);
    tm_mesh_destroy(mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void quality_of_tetrahedra_is_exact(void **state) {
    (void)state;
    const double a = 0.01, regular[12] = {a, a, a, -a, a, -a, a, -a, -a, -a, -a, a};
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(fix_one_tet(regular, &mesh, &error), &error);
    const tm_tet_quality q = tm_mesh_tet_quality(mesh, 0);
    assert_true(fabs(q.aspect - 1) < 1e-12);
    assert_true(fabs(q.min_dihedral_rad - acos(1 / 3.0)) < 1e-12 && fabs(q.max_dihedral_rad - acos(1 / 3.0)) < 1e-12);
    assert_true(fabs(q.min_altitude_m / (sqrt(8) * a * sqrt(2 / 3.0)) - 1) < 1e-12);
    tm_mesh_destroy(mesh);
}

static const double cube[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2};

static void refuse(int32_t vertices, int32_t tets, const double *vertex, const int32_t *tet, int64_t entity,
                   const char *says) {
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = vertices, def.vertex_m = vertex, def.tet_count = tets, def.tet = tet;
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    assert_int_equal(tm_mesh_create(&def, &mesh, &error), TM_ERR_MESH);
    assert_null(mesh);
    assert_int_equal(error.status, TM_ERR_MESH);
    if (error.entity != entity || !strstr(error.message, says) || !strstr(error.message, "; "))
        fail_msg("entity %lld, message: %s; wanted entity %lld and '%s'", (long long)error.entity, error.message,
                 (long long)entity, says);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void bad_meshes_are_rejected(void **state) {
    (void)state;
    const int32_t good[8] = {0, 1, 2, 3, 1, 2, 3, 4};
    refuse(0, 0, cube, good, -1, "empty");
    refuse(5, 0, cube, good, -1, "empty");
    refuse(4, 2, cube, good, 1, "vertex 4 of 4");
    refuse(4, 1, cube, (int32_t[4]){0, 1, -2, 3}, 0, "vertex -2");
    refuse(4, 1, cube, (int32_t[4]){0, 1, 1, 3}, 0, "vertex 1 twice");
    refuse(4, 1, cube, (int32_t[4]){0, 2, 1, 3}, 0, "in negative order");
    refuse(6, 1, cube, good, 4, "no tetrahedron");
    refuse(4, 2, cube, (int32_t[8]){0, 1, 2, 3, 1, 2, 0, 3}, 1, "same vertices as tetrahedron 0");
    refuse(6, 3, cube, (int32_t[12]){0, 1, 2, 3, 1, 2, 3, 4, 1, 2, 3, 5}, 2, "tetrahedra 0 and 1 share its face");
    refuse(5, 2, cube, (int32_t[8]){0, 1, 2, 3, 0, 1, 2, 4}, 1, "overlaps tetrahedron 0");
    double bad[12];
    memcpy(bad, cube, sizeof bad);
    bad[7] = NAN;
    refuse(4, 1, bad, good, 2, "y coordinate is nan");
    bad[7] = INFINITY;
    refuse(4, 1, bad, good, 2, "y coordinate is inf");
    memcpy(bad, cube, sizeof bad);
    bad[11] = 0;
    refuse(4, 1, bad, good, 0, "flat");
    /* Flat to rounding, in any direction. */
    for (int i = 0; i < 3; i++) bad[9 + i] = (bad[i] + bad[3 + i] + bad[6 + i]) / 3 + 0.1;
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++) bad[3 * v + i] = 0.1 + cube[3 * v + i] * 0.7;
    for (int i = 0; i < 3; i++) bad[9 + i] = 0.3 * bad[i] + 0.3 * bad[3 + i] + 0.4 * bad[6 + i];
    refuse(4, 1, bad, good, 0, "flat");
    /* Thin is not flat. */
    memcpy(bad, cube, sizeof bad);
    bad[11] = 1e-9;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(fix_one_tet(bad, &mesh, &error), &error);
    tm_mesh_destroy(mesh);
    /* Without an error struct. */
    bad[11] = 0;
    assert_int_equal(fix_one_tet(bad, &mesh, NULL), TM_ERR_MESH);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(topology_agrees_with_brute_force),
                                       cmocka_unit_test(quality_of_tetrahedra_is_exact),
                                       cmocka_unit_test(bad_meshes_are_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
