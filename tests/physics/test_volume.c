/* The effect "strain_smoothing": blocks against the definition of its energy, cutting, the guaranteed step, modes,
 * pressures, and correct bending of nearly incompressible beams. */
#include "../cut_check.h"
#include "dense.h"

enum { LAWS = 3 };

/* Two isotropic laws of different nu, and fibres. */
static void make_laws(tm_material law[LAWS]) {
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.3, law, &error), &error);
    fix_ok(tm_material_young(4e3, 0.49, law + 1, &error), &error);
    fix_ok(tm_material_engineering(3e4, 6e3, 0.4, 0.45, 5e3, law + 2, &error), &error);
    law[0].damping_1_s = law[1].damping_1_s = law[2].damping_1_s = 20;
}

/* A jittered block of three regions, the third of which has the first one's law; or of one. */
static tm_mesh *make_mesh(const int cells[3], int regions, fix_random *random) {
    tm_mesh *plain = fix_block(cells, (double[3]){0.01 * cells[0], 0.01 * cells[1], 0.01 * cells[2]}, 0.2, random);
    int32_t *region = malloc(sizeof *region * (size_t)plain->tet_count);
    for (int32_t t = 0; t < plain->tet_count; t++) region[t] = t * regions / plain->tet_count;
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = plain->vertex_count, def.vertex_m = plain->rest_m, def.tet_count = plain->tet_count,
    def.tet = plain->tet, def.region = region;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(region);
    tm_mesh_destroy(plain);
    return mesh;
}

/* Fibres whose direction changes from tetrahedron to tetrahedron. */
static double *turning_fibres(const tm_mesh *mesh, fix_random *random) {
    double *fibre = malloc(sizeof *fibre * 3 * (size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double a[3] = {1, 0.5 * fix_signed(random), 0.5 * fix_signed(random)};
        const double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        for (int i = 0; i < 3; i++) fibre[3 * t + i] = a[i] / length;
    }
    return fibre;
}

static tm_tissue *build(const tm_tissue_def *def) {
    tm_tissue *tissue = NULL;
    tm_error error;
    fix_ok(tm_tissue_create(def, &tissue, &error), &error);
    return tissue;
}

/* --- the energy by its definition --- */

/* 1 / (m.C^-1 m) by elimination. */
static double bulk_of(const double C[36]) {
    double A[6][7];
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++) A[i][j] = C[6 * i + j];
        A[i][6] = i < 3;
    }
    for (int p = 0; p < 6; p++)
        for (int i = 0; i < 6; i++) {
            const double f = i == p ? 0 : A[i][p] / A[p][p];
            for (int j = p; j < 7; j++) A[i][j] -= f * A[p][j];
        }
    return 1 / (A[0][6] / A[0][0] + A[1][6] / A[1][1] + A[2][6] / A[2][2]);
}

static void strain_of(const tm_mesh *mesh, int32_t t, const double *u, double e[6]) {
    double g[9] = {0};
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 9; i++)
            g[i] += u[3 * mesh->tet[4 * t + k] + i / 3] * mesh->shape_1_m[12 * t + 3 * k + i % 3];
    const double voigt[6] = {g[0], g[4], g[8], g[5] + g[7], g[2] + g[6], g[1] + g[3]};
    memcpy(e, voigt, sizeof voigt);
}

static double quadratic(const double C[36], const double e[6]) {
    double sum = 0;
    for (int i = 0; i < 36; i++) sum += e[i / 6] * C[i] * e[i % 6];
    return sum / 2;
}

typedef struct average {
    double volume, e[6], C[36];
} average;

static bool has(const tm_mesh *mesh, int32_t t, int32_t a, int32_t b) {
    bool first = false, second = false;
    for (int k = 0; k < 4; k++) first |= mesh->tet[4 * t + k] == a, second |= mesh->tet[4 * t + k] == b;
    return first && second;
}

/* Sums over the active tetrahedra of one law with both vertices (a vertex: the same twice), by the `share` of each. */
static average averaged(const tm_tissue *tissue, const int *law_of_region, const tm_material *law, int which,
                        const double *u, int32_t a, int32_t b, double share) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    average sum = {0};
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        if (!tm_tissue_alive(tissue)[t] || law_of_region[mesh->region[t]] != which || !has(mesh, t, a, b)) continue;
        double e[6], C[36];
        const double volume = share * mesh->volume_m3[t];
        strain_of(mesh, t, u, e);
        tm_material_voigt(law + which, tm_tissue_tet_fibre(tissue, t), C);
        const double bulk = bulk_of(C);
        sum.volume += volume;
        for (int i = 0; i < 6; i++) sum.e[i] += volume * e[i];
        for (int i = 0; i < 36; i++) sum.C[i] += volume * (C[i] - (i / 6 < 3 && i % 6 < 3 ? bulk : 0));
    }
    for (int i = 0; sum.volume > 0 && i < 6; i++) sum.e[i] /= sum.volume;
    for (int i = 0; sum.volume > 0 && i < 36; i++) sum.C[i] /= sum.volume;
    return sum;
}

static double defined_energy(const tm_tissue *tissue, const int *law_of_region, const tm_material *law, double shear,
                             const double *u) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    double sum = 0;
    for (int which = 0; which < LAWS; which++) {
        double C[36];
        tm_material_voigt(law + which, (const double[3]){1, 0, 0}, C);
        const double bulk = bulk_of(C);
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            const average a = averaged(tissue, law_of_region, law, which, u, v, v, 0.25);
            const double change = a.e[0] + a.e[1] + a.e[2];
            sum += a.volume * bulk * change * change / 2;
        }
        for (int32_t i = 0; i < mesh->edge_count; i++) {
            const average a =
                averaged(tissue, law_of_region, law, which, u, mesh->edge[2 * i], mesh->edge[2 * i + 1], 1.0 / 6);
            sum += shear * a.volume * quadratic(a.C, a.e);
        }
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        if (!tm_tissue_alive(tissue)[t]) continue;
        double e[6], C[36];
        strain_of(mesh, t, u, e);
        tm_material_voigt(law + law_of_region[mesh->region[t]], tm_tissue_tet_fibre(tissue, t), C);
        const double bulk = bulk_of(C);
        for (int i = 0; i < 36; i++) C[i] -= i / 6 < 3 && i % 6 < 3 ? bulk : 0;
        sum += (1 - shear) * mesh->volume_m3[t] * quadratic(C, e);
    }
    return sum;
}

static void stiffness_blocks_equal_the_energys_definition(void **state) {
    (void)state;
    static const int law_of_region[4] = {0, 1, 2, 0};
    static const int32_t material[4] = {0, 1, 2, 0};
    tm_material law[LAWS];
    make_laws(law);
    fix_random random = {41};
    tm_mesh *mesh = make_mesh((int[3]){4, 2, 2}, 4, &random);
    double *fibre = turning_fibres(mesh, &random);
    const size_t n = 3 * (size_t)mesh->vertex_count;
    double *u = malloc(sizeof *u * n), *f = malloc(sizeof *f * n), *w = malloc(sizeof *w * n);
    uint8_t *alive = malloc((size_t)mesh->tet_count);
    for (int trial = 0; trial < 6; trial++) {
        tm_tissue_def def = tm_tissue_def_default();
        def.mesh = mesh, def.material_count = LAWS, def.material = law, def.region_material = material;
        def.fibre = fibre, def.strain_smoothing = true, def.smoothed_shear_share = trial % 3 / 2.0;
        def.form = trial % 2 ? TM_FORCE_PLAIN : TM_FORCE_BEST;
        for (int32_t t = 0; t < mesh->tet_count; t++) alive[t] = fix_uniform(&random) < 0.8;
        def.alive = trial < 3 ? NULL : alive;
        tm_tissue *tissue = build(&def);
        for (size_t i = 0; i < n; i++) u[i] = fix_signed(&random), w[i] = fix_signed(&random);
        const double defined = defined_energy(tissue, law_of_region, law, def.smoothed_shear_share, u);
        assert_true(fabs(tm_tissue_energy(tissue, u) - defined) < 1e-12 * defined);
        /* The force is its gradient: the energy is quadratic, so differences are exact. */
        double along = 0, change;
        tm_tissue_force(tissue, u, f);
        for (size_t i = 0; i < n; i++) along += f[i] * w[i], u[i] += w[i];
        change = defined_energy(tissue, law_of_region, law, def.smoothed_shear_share, u);
        for (size_t i = 0; i < n; i++) u[i] -= 2 * w[i];
        change -= defined_energy(tissue, law_of_region, law, def.smoothed_shear_share, u);
        assert_true(fabs(along + change / 2) < 1e-11 * defined);
        tm_tissue_destroy(tissue);
    }
    free(u), free(f), free(w), free(alive), free(fibre);
    tm_mesh_destroy(mesh);
}

/* --- cutting, snapshots, steps --- */

static tm_tissue_def three_laws(const tm_mesh *mesh, const tm_material *law, const double *fibre, double shear) {
    static const int32_t material[3] = {0, 1, 2};
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = LAWS, def.material = law, def.region_material = material;
    def.fibre = fibre, def.strain_smoothing = true, def.smoothed_shear_share = shear, def.form = TM_FORCE_PLAIN;
    return def;
}

static void cut_tissue_is_a_fresh_build(void **state) {
    (void)state;
    tm_material law[LAWS];
    make_laws(law);
    fix_random random = {43};
    tm_mesh *mesh = make_mesh((int[3]){4, 4, 4}, 3, &random);
    double *fibre = turning_fibres(mesh, &random);
    int32_t *order = malloc(sizeof *order * (size_t)mesh->tet_count);
    for (int trial = 0; trial < 6; trial++) {
        tm_tissue_def def = three_laws(mesh, law, fibre, trial % 3 / 2.0);
        def.cuttable = true;
        tm_tissue *tissue = build(&def);
        tm_world *world = fix_world(tissue, true);
        for (int32_t t = 0; t < mesh->tet_count; t++) order[t] = t;
        if (trial % 2)
            cut_order_from(mesh, order, &random);
        else
            cut_shuffle(order, mesh->tet_count, &random);
        cut_down(tissue, &def, world, order, 1, 1 + trial * 5, true);
        assert_int_equal(tm_tissue_alive_count(tissue), 0);
        tm_world_destroy(world);
        tm_tissue_destroy(tissue);
    }
    free(order), free(fibre);
    tm_mesh_destroy(mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void snapshots_go_on_to_the_last_bit(void **state) {
    (void)state;
    tm_material law[LAWS];
    make_laws(law);
    fix_random random = {47};
    tm_mesh *mesh = make_mesh((int[3]){4, 3, 3}, 3, &random);
    double *fibre = turning_fibres(mesh, &random);
    tm_tissue_def def = three_laws(mesh, law, fibre, 0.5);
    def.cuttable = true;
    tm_tissue *tissue = build(&def);
    tm_world *world = fix_world(tissue, true);
    tm_error error;
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 1, -9.81}, &error), &error);
    int32_t some[12];
    for (int i = 0; i < 12; i++) some[i] = (int32_t)(fix_uniform(&random) * mesh->tet_count);
    assert_int_equal(tm_world_step(world, 50), TM_OK);
    tm_cut_remove(tissue, some, 12, NULL, 0);
    assert_int_equal(tm_world_step(world, 50), TM_OK);
    const int64_t bytes = tm_snapshot_bytes(world);
    const size_t n = sizeof(double) * 3 * (size_t)mesh->vertex_count;
    void *saved = malloc((size_t)bytes), *after = malloc(n);
    fix_ok(tm_snapshot_save(world, saved, bytes, &error), &error);
    assert_int_equal(tm_world_step(world, 50), TM_OK);
    memcpy(after, tm_world_state(world)->u_m, n);
    for (int i = 0; i < 12; i++) some[i] = (int32_t)(fix_uniform(&random) * mesh->tet_count);
    tm_cut_remove(tissue, some, 12, NULL, 0);
    fix_ok(tm_snapshot_restore(world, saved, bytes, &error), &error);
    cut_same_bits(tissue, &def);
    assert_int_equal(tm_world_step(world, 50), TM_OK);
    assert_memory_equal(after, tm_world_state(world)->u_m, n);
    free(saved), free(after), free(fibre);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

static void guaranteed_step_is_below_the_sharp_one(void **state) {
    (void)state;
    tm_material law[LAWS];
    make_laws(law);
    fix_random random = {53};
    double nearest = 0, gain = 0;
    for (int trial = 0; trial < 6; trial++) {
        tm_mesh *mesh = make_mesh((int[3]){3, 2, 1 + trial % 2}, 3, &random);
        double *fibre = turning_fibres(mesh, &random);
        tm_tissue_def def = three_laws(mesh, law, fibre, trial % 3 / 2.0), plain = def;
        def.cuttable = true;
        tm_tissue *cut = build(&def);
        const double at_first = tm_critical_step_guaranteed(cut, NULL);
        while (tm_tissue_alive_count(cut) > 0) {
            def.cuttable = plain.strain_smoothing = false;
            def.alive = plain.alive = tm_tissue_alive(cut);
            tm_tissue *fixed = build(&def), *linear = build(&plain);
            int32_t tet = -1;
            const double step = tm_critical_step_guaranteed(fixed, &tet), estimate = dense_step(cut);
            assert_true(tet >= 0 && tm_tissue_alive(cut)[tet]);
            assert_true(at_first <= step && step <= estimate);
            if (tm_tissue_alive_count(cut) == mesh->tet_count)
                gain = fmax(gain, step / tm_critical_step_guaranteed(linear, NULL));
            nearest = fmax(nearest, step / estimate);
            tm_tissue_destroy(fixed), tm_tissue_destroy(linear);
            int32_t some[6];
            for (int i = 0; i < 6; i++) some[i] = (int32_t)(fix_uniform(&random) * mesh->tet_count);
            tm_cut_remove(cut, some, 6, NULL, 0);
        }
        tm_tissue_destroy(cut);
        free(fibre);
        tm_mesh_destroy(mesh);
    }
    print_message("  at most %.3f of the estimated step, at most %.2f of the linear tetrahedra's\n", nearest, gain);
    assert_true(gain > 1.1);
}

/* --- modes and pressures --- */

/* Free tissue has exactly six modes without energy; the seventh mode is as stiff as that of linear tetrahedra,
 * except for their locking. */
static void only_rigid_modes_have_no_energy(void **state) {
    (void)state;
    fix_random random = {59};
    tm_mesh *mesh = make_mesh((int[3]){3, 3, 2}, 1, &random);
    const int n = 3 * mesh->vertex_count;
    double seventh[4];
    for (int form = 0; form < 4; form++) {
        tm_material m;
        tm_error error;
        fix_ok(tm_material_young(1e4, 0.3, &m, &error), &error);
        tm_tissue_def def = tm_tissue_def_default();
        def.mesh = mesh, def.material_count = 1, def.material = &m, def.strain_smoothing = form > 0,
        def.smoothed_shear_share = (form - 1) / 2.0 * (form > 0);
        tm_tissue *tissue = build(&def);
        double *A = dense_matrix(tissue), most = 0;
        dense_diagonalise(A, n);
        int still = 0;
        seventh[form] = HUGE_VAL;
        for (int i = 0; i < n; i++) most = fmax(most, A[i * (n + 1)]);
        for (int i = 0; i < n; i++) {
            const double value = A[i * (n + 1)];
            if (value < 1e-9 * most)
                still++;
            else
                seventh[form] = fmin(seventh[form], value);
        }
        assert_int_equal(still, 6);
        assert_true(seventh[form] > 0.5 * seventh[0]);
        free(A);
        tm_tissue_destroy(tissue);
    }
    print_message("  first elastic mode: %.3f %.3f %.3f of the linear tetrahedra's\n", seventh[1] / seventh[0],
                  seventh[2] / seventh[0], seventh[3] / seventh[0]);
    tm_mesh_destroy(mesh);
}

/* Supports the vertices of `held`, and settles. */
static void support(tm_world *world, const tm_mesh *mesh, bool (*held)(const double x[3], int axis)) {
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)mesh->vertex_count), count = 0;
    double *rest = calloc(3 * (size_t)mesh->vertex_count, sizeof *rest);
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++)
        if (held(mesh->rest_m + d / 3 * 3, d % 3)) dof[count++] = d;
    tm_support_def def = tm_support_def_default();
    def.count = count, def.dof = dof, def.value_m = rest;
    tm_error error;
    fix_ok(tm_stage_support(world, &def, &error), &error);
    free(dof), free(rest);
}

static void settle(tm_world *world) {
    tm_settle_def def = tm_settle_def_default();
    tm_settle_result result;
    tm_error error;
    def.tolerance = 1e-8;
    fix_ok(tm_world_settle(world, &def, &result, &error), &error);
}

static const double BOX_M = 0.06;
static bool slippery_box(const double x[3], int axis) {
    return axis < 2 ? x[axis] < 1e-9 || x[axis] > BOX_M - 1e-9 : x[2] < 1e-9;
}

/* A box of nearly incompressible tissue under its own weight has the pressure of water. The pressures of vertices,
 * which the law uses, follow the depth: their error and their roughness (a vertex against the mean of its
 * neighbours) are a few thousandths. */
static void pressures_under_gravity_are_hydrostatic(void **state) {
    (void)state;
    const double young = 5e3, nu = 0.499, bulk = young / (3 * (1 - 2 * nu)), weight = 1000 * 9.81;
    fix_random random = {61};
    tm_mesh *mesh = fix_block((int[3]){6, 6, 6}, (double[3]){BOX_M, BOX_M, BOX_M}, 0.1, &random);
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(young, nu, &m, &error), &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &m, def.strain_smoothing = true;
    tm_tissue *tissue = build(&def);
    tm_world *world = fix_world(tissue, false);
    support(world, mesh, slippery_box);
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    settle(world);
    double *p = calloc((size_t)mesh->vertex_count, sizeof *p), off = 0, rough = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        double volume = 0, change = 0, e[6];
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            strain_of(mesh, mesh->vertex_tet[i], tm_world_state(world)->u_m, e);
            volume += mesh->volume_m3[mesh->vertex_tet[i]];
            change += mesh->volume_m3[mesh->vertex_tet[i]] * (e[0] + e[1] + e[2]);
        }
        p[v] = -bulk * change / volume - weight * (BOX_M - mesh->rest_m[3 * v + 2]);
        off += p[v] * p[v];
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        double mean = 0;
        const int32_t first = mesh->vertex_edge_begin[v], count = mesh->vertex_edge_begin[v + 1] - first;
        for (int32_t i = first; i < first + count; i++) {
            const int32_t *ends = mesh->edge + 2 * mesh->vertex_edge[i];
            mean += p[ends[0] == v ? ends[1] : ends[0]] / count;
        }
        rough += (p[v] - mean) * (p[v] - mean);
    }
    off = sqrt(off / mesh->vertex_count) / (weight * BOX_M);
    rough = sqrt(rough / mesh->vertex_count) / (weight * BOX_M);
    print_message("  pressures off by %.4f, rough by %.4f of the deepest\n", off, rough);
    assert_true(off < 0.01);
    assert_true(rough < 0.01);
    free(p);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* --- bending --- */

static bool clamped(const double x[3], int axis) {
    (void)axis;
    return x[2] < 1e-9;
}

/* A cantilever 1 x 1 x 6 of 2,304 tetrahedra with a lateral load at its end; returns the load's work over
 * Timoshenko's. */
static double tip(double nu, bool volume, double shear) {
    const double young = 1e4, length = 0.6, side = 0.1, pull = 1e-3;
    fix_random random = {1};
    tm_mesh *mesh = fix_block((int[3]){4, 4, 24}, (double[3]){side, side, length}, 0, &random);
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(young, nu, &m, &error), &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &m, def.strain_smoothing = volume,
    def.smoothed_shear_share = shear;
    tm_tissue *tissue = build(&def);
    tm_world *world = fix_world(tissue, false);
    support(world, mesh, clamped);
    double *load = calloc(3 * (size_t)mesh->vertex_count, sizeof *load), moved = 0;
    for (int32_t s = 0; s < mesh->surface_count; s++) { /* 32 equal triangles at the end */
        const int32_t *v = mesh->surface + 3 * s;
        const double *x = mesh->rest_m;
        if (x[3 * v[0] + 2] + x[3 * v[1] + 2] + x[3 * v[2] + 2] < 3 * length - 1e-9) continue;
        for (int k = 0; k < 3; k++) load[3 * v[k]] += pull / 32 / 3;
    }
    fix_ok(tm_stage_load(world, load, &error), &error);
    settle(world);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) moved += load[i] * tm_world_state(world)->u_m[i] / pull;
    free(load);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    const double inertia = pow(side, 4) / 12;
    return moved / (pull * pow(length, 3) / (3 * young * inertia) +
                    pull * length / (young / (2 * (1 + nu)) * 5 / 6 * side * side));
}

static void nearly_incompressible_beams_bend_correctly(void **state) {
    (void)state;
    static const double nu[] = {0.3, 0.45, 0.49, 0.499};
    for (int i = 0; i < 4; i++) {
        const double linear = tip(nu[i], false, 0), half = tip(nu[i], true, 0.4), whole = tip(nu[i], true, 1);
        print_message("  nu %.3f: linear %.3f, shear 0.4 %.3f, shear 1 %.3f of Timoshenko's\n", nu[i], linear, half,
                      whole);
        assert_true(fabs(whole - 1) < 0.08);
        assert_true(fabs(half - 1) < 0.17 && half > linear);
    }
}

static void invalid_settings_are_rejected(void **state) {
    (void)state;
    tm_material law[LAWS];
    make_laws(law);
    fix_random random = {67};
    tm_mesh *mesh = make_mesh((int[3]){1, 1, 1}, 1, &random);
    double *mass = calloc((size_t)mesh->vertex_count, sizeof *mass);
    for (int i = 0; i < 4; i++) {
        tm_tissue_def def = tm_tissue_def_default();
        def.mesh = mesh, def.material_count = 1, def.material = law, def.strain_smoothing = true;
        if (i == 0) def.precision = TM_SINGLE;
        if (i == 1) def.extra_mass_kg = mass;
        if (i == 2) def.smoothed_shear_share = 1.01;
        if (i == 3) def.smoothed_shear_share = NAN;
        tm_tissue *tissue = NULL;
        tm_error error;
        assert_int_equal(tm_tissue_create(&def, &tissue, &error), TM_ERR_ARGUMENT);
        assert_non_null(strstr(error.message, i < 2 ? "leave" : "from 0 to 1"));
        assert_null(tissue);
    }
    free(mass);
    tm_mesh_destroy(mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stiffness_blocks_equal_the_energys_definition),
        cmocka_unit_test(cut_tissue_is_a_fresh_build),
        cmocka_unit_test(snapshots_go_on_to_the_last_bit),
        cmocka_unit_test(guaranteed_step_is_below_the_sharp_one),
        cmocka_unit_test(only_rigid_modes_have_no_energy),
        cmocka_unit_test(pressures_under_gravity_are_hydrostatic),
        cmocka_unit_test(nearly_incompressible_beams_bend_correctly),
        cmocka_unit_test(invalid_settings_are_rejected),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
