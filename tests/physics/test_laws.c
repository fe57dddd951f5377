/* Requirements on every material law, row by row of tm_laws. The force is the energy's derivative; the tangent is
 * the force's, and symmetric; a rigid rotation stores no energy; a rotation
 * about the fibre before the deformation changes no energy, nor does the fibre's reversal; the step bound holds in all
 * states; all forms have the plain form's bits; a world computes the same; closed loops return their energy. Isotropic
 * and with fibres, next to a hole. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../long.h"
#include "law_rows.h"
#include "material/law.h"
#include "turning.h"
#include "world/world_internal.h"

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_material material;
    double *fibre;
    tm_law_state law;
    tm_pool pool;
    fix_random random;
    int32_t n;
} body;

static tm_material material(const tm_law *law, bool fibred) {
    tm_material m;
    tm_error error;
    if (fibred)
        fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error), &error);
    else
        fix_ok(tm_material_young(5e3, 0.45, &m, &error), &error);
    law_set(&m, law->kind);
    return m;
}

/* A block with a hole, or one tetrahedron. */
static body make(const tm_law *law, bool fibred, bool averaged, bool alone) {
    body b = {.random = {7}, .material = material(law, fibred)};
    b.mesh = alone ? fix_block((int[]){1, 1, 1}, (double[]){0.01, 0.01, 0.01}, 0.1, &b.random)
                   : fix_block((int[]){3, 2, 2}, (double[]){0.03, 0.02, 0.02}, 0.2, &b.random);
    b.n = 3 * b.mesh->vertex_count;
    b.fibre = malloc(sizeof(double) * 3 * (size_t)b.mesh->tet_count);
    for (int32_t i = 0; i < 3 * b.mesh->tet_count; i++) b.fibre[i] = i % 3 ? 2 / 3.0 : 1 / 3.0;
    tm_tissue_def def = tm_tissue_def_default();
    tm_error error;
    def.mesh = b.mesh, def.material_count = 1, def.material = &b.material,
    def.fibre = fibred || tm_law_needs_fibre(law->kind) ? b.fibre : NULL;
    def.rotation = law->has_constant_tangent || law->kind != TM_LAW_LINEAR ? 0 : TM_ROTATION_THRESHOLD;
    def.strain_smoothing = averaged, def.smoothed_shear_share = 0, def.cuttable = true;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    if (alone)
        for (int32_t t = 1; t < b.mesh->tet_count; t++) tm_cut_remove(b.tissue, &t, 1, NULL, 0);
    else
        assert_true(tm_cut_remove(b.tissue, (int32_t[]){5, 31}, 2, NULL, 0) >= 2);
    assert_true((tm_tissue_alive_count(b.tissue) == 1) == alone);
    const tm_material_field field = tm_tissue_field(b.tissue);
    assert_true(tm_law_of(&field) == law);
    assert_true(tm_law_init(&b.law, &b.pool, law, &field));
    return b;
}

static void destroy(body *b) {
    tm_pool_release(&b->pool);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->fibre);
}

static double *vectors(const body *b, int count) { return calloc((size_t)(count * b->n), sizeof(double)); }

static void noise(body *b, double size, double *u) {
    for (int32_t i = 0; i < b->n; i++) u[i] = size * fix_signed(&b->random);
}

static void force(const body *b, const double *u, double *f) {
    memset(f, 0, sizeof *f * (size_t)b->n);
    b->law.law->force(&b->law, true, u, f);
}

static void tangent(const body *b, const double *u, const double *d, double *change) {
    memset(change, 0, sizeof *change * (size_t)b->n);
    b->law.law->tangent(&b->law, u, d, change);
}

static double dot(const double *a, const double *b, int32_t n) {
    double sum = 0;
    for (int32_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* u + h d */
static const double *along(const double *u, double h, const double *d, int32_t n, double *to) {
    for (int32_t i = 0; i < n; i++) to[i] = u[i] + h * d[i];
    return to;
}

/* Gradients of 1e-3 (linear), 0.03 (in the band where the correction grows) and 0.3. */
static const double SIZE_M[] = {1e-5, 3e-4, 3e-3};
enum { SIZES = sizeof SIZE_M / sizeof *SIZE_M };

static void has_derivatives(body *b) {
    double *u = vectors(b, 7), *d = u + b->n, *e = u + 2 * b->n, *f = u + 3 * b->n, *g = u + 4 * b->n;
    double *near = u + 5 * b->n, *change = u + 6 * b->n;
    const tm_law *law = b->law.law;
    for (int size = 0; size < SIZES; size++) {
        const double h = 1e-4 * SIZE_M[size];
        noise(b, SIZE_M[size], u), noise(b, 1, d), noise(b, 1, e);
        force(b, u, f);
        const double more = law->energy(&b->law, along(u, h, d, b->n, near));
        const double less = law->energy(&b->law, along(u, -h, d, b->n, near));
        const double scale = sqrt(dot(f, f, b->n) * dot(d, d, b->n));
        assert_true(fabs((more - less) / (2 * h) + dot(f, d, b->n)) < 1e-6 * scale);
        force(b, along(u, h, d, b->n, near), f);
        force(b, along(u, -h, d, b->n, near), g);
        tangent(b, u, d, change);
        const double steep = fix_largest(change, b->n);
        assert_true(steep > 0);
        for (int32_t i = 0; i < b->n; i++) assert_true(fabs((f[i] - g[i]) / (2 * h) - change[i]) < 1e-5 * steep);
        const double across = dot(e, change, b->n);
        tangent(b, u, e, f);
        assert_true(fabs(across - dot(d, f, b->n)) < 1e-9 * sqrt(dot(change, change, b->n) * dot(e, e, b->n)));
        if (law->has_constant_tangent) {
            noise(b, SIZE_M[SIZES - 1], u);
            tangent(b, u, e, g);
            assert_memory_equal(f, g, sizeof *f * (size_t)b->n);
        }
    }
    free(u);
}

/* Stretched so that every tetrahedron is corrected in full, then rotated by a radian. */
static void keeps_energy_in_rotation(body *b) {
    double *u = vectors(b, 4), *turned = u + b->n, *f = u + 2 * b->n, *g = u + 3 * b->n;
    const double c = cos(1), s = sin(1), stretch[3] = {0.15, -0.05, -0.08};
    noise(b, 2e-4, u);
    for (int32_t i = 0; i < b->n; i++) u[i] += stretch[i % 3] * b->mesh->rest_m[i];
    for (int32_t v = 0; v < b->n; v += 3) {
        const double *r = b->mesh->rest_m + v, x = r[0] + u[v], y = r[1] + u[v + 1];
        turned[v] = c * x - s * y - r[0], turned[v + 1] = s * x + c * y - r[1], turned[v + 2] = u[v + 2];
    }
    const double before_J = b->law.law->energy(&b->law, u), after_J = b->law.law->energy(&b->law, turned);
    assert_true((fabs(after_J - before_J) < 1e-9 * before_J) == b->law.law->is_objective);
    force(b, u, f), force(b, turned, g);
    double worst = 0;
    for (int32_t v = 0; v < b->n; v += 3)
        worst = fmax(worst, hypot(g[v] - (c * f[v] - s * f[v + 1]), g[v + 1] - (s * f[v] + c * f[v + 1])));
    assert_true((worst < 1e-9 * fix_largest(f, b->n)) == b->law.law->is_objective);
    free(u);
}

/* Computes u of one F everywhere, of F after a rotation by an angle about the axis. */
static void deform(const body *b, const double axis[3], double angle, double *u) {
    static const double F[9] = {1.15, 0.1, -0.05, 0.02, 0.9, 0.12, -0.08, 0.05, 1.02};
    const double c = cos(angle), s = sin(angle);
    for (int32_t v = 0; v < b->n; v += 3) {
        const double *x = b->mesh->rest_m + v, along = axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2];
        double y[3];
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            y[i] = c * x[i] + s * (axis[j] * x[k] - axis[k] * x[j]) + (1 - c) * along * axis[i];
        }
        for (int i = 0; i < 3; i++) u[v + i] = F[3 * i] * y[0] + F[3 * i + 1] * y[1] + F[3 * i + 2] * y[2] - x[i];
    }
}

/* Fibres have no other direction across them, and no sense along; isotropic tissue has no direction. */
static void has_symmetric_fibres(body *b, bool fibred) {
    static const double across[3] = {2 / 3.0, 1 / 3.0, -2 / 3.0}; /* the fibre is at right angles */
    double *u = vectors(b, 1);
    const tm_law *law = b->law.law;
    deform(b, b->fibre, 0, u);
    const double before_J = law->energy(&b->law, u);
    for (int k = 1; k < 4; k++) {
        deform(b, b->fibre, k, u);
        assert_true(fabs(law->energy(&b->law, u) - before_J) < 1e-9 * before_J);
    }
    deform(b, across, M_PI, u); /* reverses the fibre */
    assert_true(fabs(law->energy(&b->law, u) - before_J) < 1e-9 * before_J);
    deform(b, across, 1, u);
    const bool same = fabs(law->energy(&b->law, u) - before_J) < 1e-9 * before_J;
    assert_true(same == !(fibred || tm_law_needs_fibre(law->kind)));
    free(u);
}

/* Returns the largest eigenvalue of M^-1 K at u, from below. */
static double frequency2(body *b, const double *u, double *d, double *change) {
    const double *mass = tm_tissue_mass_kg(b->tissue);
    double value = 0;
    noise(b, 1, d);
    for (int k = 0; k < (test_is_sanitized() ? 10 : 120); k++) {
        double weight = 0, length = 0;
        tangent(b, u, d, change);
        for (int32_t i = 0; i < b->n; i++) weight += mass[i / 3] * d[i] * d[i];
        value = -dot(d, change, b->n) / weight;
        for (int32_t i = 0; i < b->n; i++) d[i] = mass[i / 3] > 0 ? -change[i] / mass[i / 3] : 0;
        for (int32_t i = 0; i < b->n; i++) length = fmax(length, fabs(d[i]));
        for (int32_t i = 0; i < b->n; i++) d[i] /= length;
    }
    return value;
}

/* Ascends from a random state: random states seldom meet the maximum stiffness of a nonlinear law. */
static double climb(body *b, double bound, double *u) {
    double *try = vectors(b, 3), best = 0, size = 6e-3;
    for (int k = 0; k < 150; k++) {
        for (int32_t i = 0; i < b->n; i++) try[i] = u[i] + size * fix_signed(&b->random);
        const double there = frequency2(b, try, try + b->n, try + 2 * b->n) / bound;
        if (there > best) best = there, memcpy(u, try, sizeof *u * (size_t)b->n);
        size = fmax(0.98 * size, 3e-4);
    }
    free(try);
    return best;
}

static void stays_below_its_bound(body *b, bool fibred, double least) {
    double *u = vectors(b, 3), worst = 0, bound = 0;
    for (int32_t t = 0; t < b->mesh->tet_count; t++) {
        const double m = b->material.density_kg_m3 * b->mesh->volume_m3[t] / 4;
        if (b->law.field.alive[t])
            bound = fmax(bound, b->law.law->bound(&b->law.field, t, (const double[4]){m, m, m, m}));
    }
    const int rounds = least > 0 || b->law.law->kind == TM_LAW_LINEAR ? 30 : 10; /* many tetrahedra are far below it */
    for (int round = 0; round < rounds; round++) { /* small ones, in the band, crushed and inside out */
        noise(b, round < SIZES ? SIZE_M[round] : 5e-4 * (round - 2) * 30 / rounds, u);
        worst = fmax(worst, frequency2(b, u, u + b->n, u + 2 * b->n) / bound);
    }
    const bool climbs =
        b->law.law->kind != TM_LAW_LINEAR && least > 0 && !test_is_sanitized(); /* thousands of products */
    if (climbs) worst = fmax(worst, climb(b, bound, u));
    print_message("%s%s: %.2f of the bound\n", b->law.law->name, fibred ? ", fibred" : "", worst);
    assert_true(worst <= 1 + 1e-12 && worst > (test_is_sanitized() ? 0 : least));
    free(u);
}

static void has_one_form(body *b) {
    double *u = vectors(b, 3), *f = u + b->n, *g = u + 2 * b->n;
    for (int size = 0; size < SIZES; size++) {
        noise(b, SIZE_M[size], u);
        force(b, u, f);
        memset(g, 0, sizeof *g * (size_t)b->n);
        b->law.law->force(&b->law, false, u, g);
        assert_memory_equal(f, g, sizeof *f * (size_t)b->n);
    }
    free(u);
}

/* The step's force has the bits of the law's row; its force and energy are the sum of the tensors and of the law's
 * part beyond them. */
static void is_what_a_step_computes(body *b) {
    double *u = vectors(b, 4), *f = u + b->n, *g = u + 2 * b->n, *beyond = u + 3 * b->n;
    tm_world *world = fix_world(b->tissue, true);
    tm_error error;
    const tm_nonlinear *law = world->nonlinear;
    for (int size = 0; size < SIZES; size++) {
        noise(b, SIZE_M[size], u);
        for (int32_t i = 0; i < b->n; i++)
            if (tm_tissue_mass_kg(b->tissue)[i / 3] == 0) u[i] = 0;
        force(b, u, f);
        memcpy(world->state.u_m, u, sizeof *u * (size_t)b->n);
        memcpy(world->state.u_prev_m, u, sizeof *u * (size_t)b->n);
        fix_ok(tm_world_step(world, 1), &error);
        for (int32_t i = 0; i < b->n; i++) assert_true(f[i] == world->state.force_N[i]);
        tm_tissue_force(b->tissue, u, g);
        law->force(law->self, u, beyond);
        for (int32_t i = 0; i < b->n; i++) assert_true(fabs(f[i] - g[i] - beyond[i]) < 1e-10 * fix_largest(f, b->n));
        const double law_J = b->law.law->energy(&b->law, u), tissue_J = tm_tissue_energy(b->tissue, u);
        assert_true(fabs(law_J - tissue_J - law->energy(law->self, u)) < 1e-10 * fmax(law_J, tissue_J));
    }
    tm_world_destroy(world);
    free(u);
}

/* Small strains have the elastic constants. */
static void is_linear_when_small(body *b) {
    double *u = vectors(b, 4), *d = u + b->n, *change = u + 2 * b->n, *linear = u + 3 * b->n;
    noise(b, 1, d);
    tangent(b, u, d, change);
    tm_tissue_force(b->tissue, d, linear);
    for (int32_t i = 0; i < b->n; i++) assert_true(fabs(change[i] - linear[i]) < 1e-12 * fix_largest(linear, b->n));
    free(u);
}

/* The tensors plus the stage "rotation" are the law's force and energy. */
static void is_what_a_world_computes(body *b) {
    double *u = vectors(b, 4), *f = u + b->n, *g = u + 2 * b->n, *scratch = u + 3 * b->n;
    tm_world *world = fix_world(b->tissue, true);
    tm_rotation *rotation = NULL;
    tm_error error;
    if (!b->law.law->has_constant_tangent) fix_ok(tm_stage_rotation(world, &rotation, &error), &error);
    for (int size = 0; size < SIZES; size++) {
        noise(b, SIZE_M[size], u);
        force(b, u, f);
        tm_tissue_force(b->tissue, u, g);
        if (rotation) turning_force(b->tissue, rotation, u, g, scratch);
        for (int32_t i = 0; i < b->n; i++) assert_true(fabs(f[i] - g[i]) < 1e-10 * fix_largest(f, b->n));
        const double law_J = b->law.law->energy(&b->law, u), tissue_J = tm_tissue_energy(b->tissue, u),
                     turned_J = rotation ? tm_rotation_energy(rotation, u) : 0;
        assert_true(fabs(law_J - tissue_J - turned_J) < 1e-10 * fmax(law_J, tissue_J));
    }
    tm_world_destroy(world);
    free(u);
}

/* Regions with two laws in one batch: each tetrahedron has the same bits as in a tissue with only its law. */
static void has_own_laws(tm_material one, tm_material other) {
    fix_random random = {9};
    tm_error error;
    tm_mesh *block = fix_block((int[]){2, 2, 2}, (double[]){0.02, 0.02, 0.02}, 0.2, &random), *mesh;
    int32_t *region = calloc((size_t)block->tet_count, sizeof *region);
    for (int32_t t = 0; t < block->tet_count; t++) region[t] = t % 3 == 0;
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = block->vertex_count, def.tet_count = block->tet_count;
    def.vertex_m = block->rest_m, def.tet = block->tet, def.region = region;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    const tm_material two[3][2] = {{one, other}, {one, one}, {other, other}};
    static const int32_t own[2] = {0, 1};
    double *u = calloc(3 * (size_t)mesh->vertex_count, sizeof *u), *corner[3];
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) u[i] = 2e-3 * fix_signed(&random);
    tm_pool pool = {0};
    uint8_t *alive = calloc((size_t)mesh->tet_count, 1);
    memset(alive, 1, (size_t)mesh->tet_count);
    for (int form = 0; form < 3; form++) {
        const tm_hyper_force pass = tm_hyper_force_form(form);
        for (int k = 0; k < 3 && pass; k++) {
            tm_hyperelastic h;
            const tm_material_field field = {
                .mesh = mesh, .alive = alive, .material = two[k], .region_material = own, .material_count = 2};
            assert_true(tm_hyperelastic_take(&h, &pool, &field));
            corner[k] = TM_ALLOC(&pool, double, 12 * TM_LANES * (int64_t)h.packs.count);
            pass(&h, 0, h.packs.count, u, corner[k]);
        }
        for (int32_t t = 0; t < mesh->tet_count && pass; t++)
            for (int i = 0; i < 12; i++) {
                const int64_t at = TM_LANES * (12 * (int64_t)(t / TM_LANES) + i) + t % TM_LANES;
                assert_true(corner[0][at] == corner[1 + region[t]][at]);
                assert_true(corner[1][at] != corner[2][at]);
            }
    }
    tm_pool_release(&pool);
    free(u), free(alive), free(region);
    tm_mesh_destroy(mesh), tm_mesh_destroy(block);
}

static void every_tetrahedron_has_its_own_law(void **state) {
    (void)state;
    const tm_material neo = material(&tm_law_neo_hooke, false);
    has_own_laws(neo, material(&tm_law_fung, false));
    has_own_laws(neo, material(&tm_law_linear, false));
}

/* Two waves around a stretch of 1.2 along the fibres at constant volume, so that fibres stay taut and no limit is met:
 * the stress is smooth there, and a sum over even times has no error but rounding. |grad u| up to 0.4. (The bands of
 * `rotation` have kinks: test_loops.)
 */
static void returns_energy_in_closed_loops(body *b) {
    enum { POINTS = 240 };
    if (b->law.law->kind == TM_LAW_LINEAR && !b->law.law->has_constant_tangent) return;
    double *u = vectors(b, 8), *way = u + b->n, *f = u + 2 * b->n, *rest = u + 3 * b->n, *wave = u + 4 * b->n;
    for (int32_t i = 0; i < b->n; i++) {
        const double *x = b->mesh->rest_m + i / 3 * 3, *a = b->fibre, across = 1 / sqrt(1.2) - 1;
        rest[i] = across * x[i % 3] + (0.2 - across) * a[i % 3] * (a[0] * x[0] + a[1] * x[1] + a[2] * x[2]);
    }
    for (int loop = test_is_sanitized() ? 2 : 0; loop < 3; loop++) {
        double net_J = 0, sizes_J = 0, strain = 0, most_J = 0, least_J = HUGE_VAL;
        noise(b, 7e-4, wave), noise(b, 7e-4, wave + b->n), noise(b, 2e-4, wave + 2 * b->n),
            noise(b, 2e-4, wave + 3 * b->n);
        for (int k = 0; k < POINTS; k++) {
            const double t = 2 * M_PI * k / POINTS, c = cos(t), s = sin(t), c2 = cos(2 * t), s2 = sin(2 * t);
            for (int32_t i = 0; i < b->n; i++) {
                const double *w = wave + i;
                u[i] = rest[i] + c * w[0] + s * w[b->n] + c2 * w[2 * b->n] + s2 * w[3 * b->n];
                way[i] = c * w[b->n] - s * w[0] + 2 * (c2 * w[3 * b->n] - s2 * w[2 * b->n]);
            }
            force(b, u, f);
            const double power_J = dot(f, way, b->n) * 2 * M_PI / POINTS, stored_J = b->law.law->energy(&b->law, u);
            net_J += power_J, sizes_J += fabs(power_J);
            most_J = fmax(most_J, stored_J), least_J = fmin(least_J, stored_J);
            strain =
                fmax(strain, tm_tissue_deformation(b->tissue, u).nonlinear_strain); /* half of |grad u|^2 at most */
        }
        print_message("%s: %.1e of %.3g J, of which stored %.3g, |grad u| %.2f\n", b->law.law->name, net_J / sizes_J,
                      sizes_J, most_J - least_J, sqrt(2 * strain));
        assert_true(most_J - least_J > 0.05 * sizes_J);
        assert_true(fabs(net_J) < 1e-14 * sizes_J);
    }
    free(u);
}

/* A nonlinear law with averaged dilatation, on several tetrahedra around each vertex. */
static void averages_its_dilatation(const tm_law *law, bool fibred) {
    body b = make(law, fibred, true, true);
    /* Any pressure of the range may occur with any stretch: the bound is farther from the found maximum, but not by
     * much. */
    if (law->kind == TM_LAW_NEO_HOOKE) stays_below_its_bound(&b, fibred, 0.2);
    destroy(&b);
    b = make(law, fibred, true, false);
    has_derivatives(&b);
    keeps_energy_in_rotation(&b);
    returns_energy_in_closed_loops(&b);
    if (tm_law_needs_fibre(law->kind)) stays_below_its_bound(&b, fibred, 0);
    has_one_form(&b);
    is_what_a_step_computes(&b), is_linear_when_small(&b);
    destroy(&b);
}

static void every_law_meets_the_requirements(void **state) {
    (void)state;
    int rows = 0;
    for (const tm_law *const *law = tm_laws; *law; law++, rows++)
        for (int fibred = 0; law_is_tested((*law)->kind) && fibred <= tm_law_has_fibres((*law)->kind); fibred++) {
            body b = make(*law, fibred, (*law)->averages, true);
            /* The bound is close to the maximum, or steps would be unnecessarily short. For fibres that stiffen with
             * a power or an exponential, the bound is that of the worst direction of stretch along them. */
            const bool stiffens = (*law)->kind != TM_LAW_LINEAR && b.tissue->fibre;
            stays_below_its_bound(&b, fibred, stiffens ? 0.05 : 0.2);
            destroy(&b);
            b = make(*law, fibred, (*law)->averages, false);
            has_derivatives(&b);
            keeps_energy_in_rotation(&b);
            if ((*law)->kind != TM_LAW_LINEAR) has_symmetric_fibres(&b, fibred);
            returns_energy_in_closed_loops(&b);
            stays_below_its_bound(&b, fibred, 0);
            has_one_form(&b);
            if ((*law)->kind == TM_LAW_LINEAR)
                is_what_a_world_computes(&b);
            else
                is_what_a_step_computes(&b), is_linear_when_small(&b);
            destroy(&b);
            if ((*law)->kind != TM_LAW_LINEAR) averages_its_dilatation(*law, fibred);
        }
    assert_true(rows >= 8);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_law_meets_the_requirements),
                                       cmocka_unit_test(every_tetrahedron_has_its_own_law)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
