/* Tissue with a nonlinear law: uniaxial stretch, press and simple shear by 40 % against closed forms; settling, energy,
 * threads, cuts and snapshots bit-identically, recovery of inverted tetrahedra, and rejected input. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../fixture.h"
#include "released.h"
#include "tensormass/cut.h"
#include "tensormass/rotation.h"

static const double YOUNG_PA = 5e3, SIDE_M = 0.02, JITTER = 0.2;

typedef struct block {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n;
    int32_t *dof, held;
    double *value_m;
} block;

static tm_material material_of(double poisson, tm_law_kind law) {
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(YOUNG_PA, poisson, &m, &error), &error);
    fix_ok(tm_material_set_law(&m, law, NULL, 2, &error), &error);
    return m;
}

static block make(const int cells[3], const tm_material *material, int32_t threads, bool damped) {
    fix_random random = {11};
    tm_error error;
    block b = {.mesh = fix_block(cells, (double[]){SIDE_M, SIDE_M, SIDE_M}, JITTER, &random)};
    b.n = 3 * b.mesh->vertex_count;
    tm_tissue_def def = tm_tissue_def_default();
    double *fibre = fix_fibres(b.mesh, (double[]){1, 0, 0});
    def.mesh = b.mesh, def.material_count = 1, def.material = material, def.cuttable = true, def.fibre = fibre;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    free(fibre);
    tm_world_def world = tm_world_def_default();
    world.tissue = b.tissue, world.threads = threads, world.damped = damped;
    fix_ok(tm_world_create(&world, &b.world, &error), &error);
    b.dof = malloc(sizeof *b.dof * (size_t)b.n);
    b.value_m = malloc(sizeof *b.value_m * (size_t)b.n);
    return b;
}

static void destroy(block *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->dof);
    free(b->value_m);
}

static double *zeros(const block *b) {
    assert_true(b->n > 0);
    return calloc((size_t)b->n, sizeof(double));
}

static bool is_at(const block *b, int32_t i, double place_m) { return fabs(b->mesh->rest_m[i] - place_m) < 1e-9; }

static void hold(block *b, int32_t dof, double value_m) { b->dof[b->held] = dof, b->value_m[b->held++] = value_m; }

static void settle(block *b) {
    tm_support_def support = tm_support_def_default();
    tm_settle_def def = tm_settle_def_default();
    tm_error error;
    support.count = b->held, support.dof = b->dof, support.value_m = b->value_m;
    fix_ok(tm_stage_support(b->world, &support, &error), &error);
    def.tolerance = 1e-9;
    fix_ok(tm_world_settle(b->world, &def, NULL, &error), &error);
}

/* --- closed forms --- */

/* Makes one material of each law; with fibres along x. */
typedef struct sample {
    tm_law_kind law;
    double poisson, constant[TM_LAW_CONSTANTS];
    bool fibred;    /* mu_L = 3 mu_T and a beta */
    double pressed; /* 0: to 0.6. St. Venant-Kirchhoff softens when pressed further along its fibres */
} sample;

static tm_material sample_material(const sample *s) {
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(YOUNG_PA, s->poisson, &m, &error), &error);
    if (s->fibred) m.dmu_Pa = 2 * m.mu_Pa, m.beta_Pa = 3 * m.mu_Pa;
    fix_ok(tm_material_set_law(&m, s->law, s->constant, 2, &error), &error);
    return m;
}

/* Computes the law's energy as its authors write it, Pa. */
static double density(const sample *s, const double F[9]) {
    const tm_material m = sample_material(s);
    const double *c = s->constant, mu = m.mu_Pa, lambda = m.lambda_Pa;
    double C[9], I = 0, tr_C2 = 0, tr_E2 = 0, I1, I4 = 0, I5 = 0;
    for (int i = 0; i < 9; i++) C[i] = F[i / 3] * F[i % 3] + F[3 + i / 3] * F[3 + i % 3] + F[6 + i / 3] * F[6 + i % 3];
    for (int i = 0; i < 9; i++) tr_C2 += C[i] * C[i], tr_E2 += 0.25 * pow(C[i] - (i % 4 ? 0 : 1), 2);
    I = C[0] + C[4] + C[8], I1 = 0.5 * (I - 3), I4 = 0.5 * (C[0] - 1);
    I5 = I4 * I4 + 0.25 * (C[1] * C[1] + C[2] * C[2]);
    const double J =
        F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
    const double II = 0.5 * (I * I - tr_C2), k = 4.0 / 3 * mu, l = lambda + 5.0 / 6 * mu;
    const double neo = k / 2 * (I - 3) - k / 2 * log(I + 1) + l / 2 * pow(J - 1 - k / l + k / (4 * l), 2);
    const double green = mu * tr_E2 + m.dlambda_Pa * I1 * I4 + 2 * m.dmu_Pa * I5 + m.beta_Pa / 2 * I4 * I4;
    const double y = fmax(0, c[2] * (I - 3) + (1 - 3 * c[2]) * (C[0] - 1));
    switch (s->law) {
    case TM_LAW_ST_VENANT_KIRCHHOFF:
        return green + (1 - c[0]) * lambda / 2 * I1 * I1 + c[0] * lambda / 2 * pow(J - 1, 2);
    case TM_LAW_MOONEY_RIVLIN:
        return (1 - c[0]) * mu / 2 * (I - 3) + c[0] * mu / 2 * (II - 3) - (1 + c[0]) * mu * (J - 1) +
               (lambda + (1 - c[0]) * mu) / 2 * pow(J - 1, 2);
    case TM_LAW_FUNG: return c[0] / 2 * (exp(2 * green / c[0]) - 1) + lambda / 2 * pow(J - 1, 2);
    case TM_LAW_HOLZAPFEL: return neo + c[0] / (2 * c[1]) * (exp(c[1] * y * y) - 1);
    default: return neo;
    }
}

/* Computes dW/dF by differences of fourth order. */
static double stress(const sample *s, const double F[9], int i) {
    const double h = 1e-3;
    double G[4][9];
    for (int k = 0; k < 4; k++) memcpy(G[k], F, sizeof G[k]), G[k][i] += h * (double[]){-2, -1, 1, 2}[k];
    return (density(s, G[0]) - 8 * density(s, G[1]) + 8 * density(s, G[2]) - density(s, G[3])) / (12 * h);
}

/* Finds the lateral stretch without lateral stress, by bisection, and the axial stress. */
static double uniaxial(const sample *s, double stretch, double *lateral) {
    double low = 0.5, high = 1.6;
    for (int k = 0; k < 60; k++) {
        *lateral = 0.5 * (low + high);
        *(stress(s, (double[]){stretch, 0, 0, 0, *lateral, 0, 0, 0, *lateral}, 4) < 0 ? &low : &high) = *lateral;
    }
    return stress(s, (double[]){stretch, 0, 0, 0, *lateral, 0, 0, 0, *lateral}, 0);
}

static void stretched(const sample *s, double stretch) {
    const tm_material m = sample_material(s);
    block b = make((int[]){3, 3, 3}, &m, 1, true);
    double lateral, force_N = 0;
    for (int32_t i = 0; i < b.n; i++) {
        if (is_at(&b, i, 0)) hold(&b, i, 0);
        if (i % 3 == 0 && is_at(&b, i, SIDE_M)) hold(&b, i, (stretch - 1) * SIDE_M);
    }
    settle(&b);
    const double expected_N = SIDE_M * SIDE_M * uniaxial(s, stretch, &lateral);
    const double *u = tm_world_state(b.world)->u_m;
    double *reaction = zeros(&b);
    tm_support_reaction(b.world, reaction);
    for (int32_t i = 0; i < b.n; i++) {
        if (i % 3 == 0 && is_at(&b, i, SIDE_M)) force_N += reaction[i];
        const double exact = ((i % 3 ? lateral : stretch) - 1) * b.mesh->rest_m[i];
        assert_true(fabs(u[i] - exact) < 1e-6 * SIDE_M);
    }
    print_message("%s%s, nu %g, stretch %g: %.6g N, closed form %.6g N\n", tm_law_name(s->law),
                  s->fibred ? ", fibred" : "", s->poisson, stretch, force_N, expected_N);
    assert_true(fabs(force_N - expected_N) < 1e-6 * fabs(expected_N));
    assert_int_equal(tm_world_limited_tets(b.world), 0);
    free(reaction);
    destroy(&b);
}

static void uniaxial_stretch_and_press_to_40_percent(void **state) {
    (void)state;
    static const sample samples[] = {{TM_LAW_NEO_HOOKE, 0.3, {0}, false, 0},
                                     {TM_LAW_NEO_HOOKE, 0.45, {0}, false, 0},
                                     {TM_LAW_ST_VENANT_KIRCHHOFF, 0.4, {0.5}, false, 0},
                                     {TM_LAW_ST_VENANT_KIRCHHOFF, 0.4, {1}, true, 0.85},
                                     {TM_LAW_MOONEY_RIVLIN, 0.45, {0.4}, false, 0},
                                     {TM_LAW_FUNG, 0.45, {4e3}, false, 0},
                                     {TM_LAW_FUNG, 0.45, {2e4}, true, 0},
                                     {TM_LAW_HOLZAPFEL, 0.45, {3e3, 0.5, 0.1}, false, 0}};
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++)
        stretched(samples + i, samples[i].pressed > 0 ? samples[i].pressed : 0.6), stretched(samples + i, 1.4);
    stretched(&(sample){TM_LAW_NEO_HOOKE, 0.49, {0}, false, 0}, 0.6);
    stretched(&(sample){TM_LAW_NEO_HOOKE, 0.45, {0}, false, 0}, 1.2);
}

static void simple_shear_by_40_percent(void **state) {
    (void)state;
    const double gamma = 0.4, F[9] = {1, 0, gamma, 0, 1, 0, 0, 0, 1};
    const sample neo = {TM_LAW_NEO_HOOKE, 0.45, {0}, false, 0};
    const tm_material m = sample_material(&neo);
    block b = make((int[]){3, 3, 3}, &m, 1, true);
    double force_N[3] = {0};
    for (int32_t v = 0; v < b.n; v += 3) {
        bool outside = false;
        for (int i = v; i < v + 3; i++) outside = outside || is_at(&b, i, 0) || is_at(&b, i, SIDE_M);
        for (int i = 0; i < 3 && outside; i++) hold(&b, v + i, i ? 0 : gamma * b.mesh->rest_m[v + 2]);
    }
    settle(&b);
    double *reaction = zeros(&b);
    tm_support_reaction(b.world, reaction);
    /* The moment of all reactions about the origin is the volume times P. */
    for (int32_t i = 0; i < b.n; i++) force_N[i % 3] += reaction[i] * b.mesh->rest_m[i / 3 * 3 + 2];
    const double volume = SIDE_M * SIDE_M * SIDE_M;
    for (int i = 0; i < 3; i++)
        assert_true(fabs(force_N[i] - volume * stress(&neo, F, 3 * i + 2)) < 1e-6 * volume * stress(&neo, F, 2));
    free(reaction);
    destroy(&b);
}

/* Both ends of a bar are rotated together, or one is twisted: equilibrium is found from the present state, complete
 * turns except half ones; rotated together the bar stores no energy. */
static void turned(double angle, bool together, double *stored_J, double *moment) {
    const tm_material m = material_of(0.45, TM_LAW_NEO_HOOKE);
    block b = make((int[]){6, 2, 2}, &m, 1, true);
    const double c = cos(angle), s = sin(angle);
    for (int32_t v = 0; v < b.n; v += 3) {
        const bool far = is_at(&b, v, SIDE_M);
        if (!far && !is_at(&b, v, 0)) continue;
        const double y = b.mesh->rest_m[v + 1] - SIDE_M / 2, z = b.mesh->rest_m[v + 2] - SIDE_M / 2;
        const bool turns = far || together;
        hold(&b, v, 0);
        hold(&b, v + 1, turns ? c * y - s * z - y : 0), hold(&b, v + 2, turns ? s * y + c * z - z : 0);
    }
    settle(&b);
    const tm_state *state = tm_world_state(b.world);
    double *reaction = zeros(&b);
    tm_support_reaction(b.world, reaction);
    *moment = 0;
    for (int32_t v = 0; v < b.n; v += 3)
        if (is_at(&b, v, SIDE_M))
            *moment += (b.mesh->rest_m[v + 1] + state->u_m[v + 1] - SIDE_M / 2) * reaction[v + 2] -
                       (b.mesh->rest_m[v + 2] + state->u_m[v + 2] - SIDE_M / 2) * reaction[v + 1];
    *stored_J = 0;
    for (int32_t i = 0; i < b.n; i++) *stored_J = fmax(*stored_J, fabs(state->force_N[i]));
    assert_int_equal(tm_tissue_deformation(b.tissue, state->u_m).inverted, 0);
    free(reaction);
    destroy(&b);
}

static void rotated_ends_settle(void **state) {
    (void)state;
    double most_N, moment, before = 0;
    for (int part = 1; part <= 6; part++) {
        turned(part * acos(-1) / 6, true, &most_N, &moment);
        assert_true(most_N < 1e-7);
    }
    for (int part = 1; part <= 3; part++) {
        turned(part * acos(-1) / 6, false, &most_N, &moment);
        print_message("twisted by %d degrees: %.4g N m\n", 30 * part, moment);
        assert_true(moment > 1.4 * before);
        before = moment;
    }
}

/* --- the step --- */

/* Deformed at random, partly inverted, base fixed: returns to rest. */
static void inverted_tissue_recovers(void **state) {
    (void)state;
    const tm_material base = material_of(0.45, TM_LAW_NEO_HOOKE);
    tm_material m = base;
    m.damping_1_s = 40;
    block b = make((int[]){3, 3, 3}, &m, 1, true);
    fix_random random = {3};
    tm_error error;
    tm_state *s = tm_world_state(b.world);
    for (int32_t i = 0; i < b.n; i++)
        if (is_at(&b, i / 3 * 3 + 2, 0)) hold(&b, i, 0);
    tm_support_def support = tm_support_def_default();
    support.count = b.held, support.dof = b.dof, support.value_m = b.value_m;
    fix_ok(tm_stage_support(b.world, &support, &error), &error);
    for (int32_t i = 0; i < b.n; i++)
        if (!is_at(&b, i / 3 * 3 + 2, 0)) s->u_m[i] = s->u_prev_m[i] = 0.4 * SIDE_M * fix_signed(&random);
    assert_true(tm_tissue_deformation(b.tissue, s->u_m).inverted > 20);
    fix_ok(tm_world_step(b.world, 1), &error);
    assert_true(tm_world_limited_tets(b.world) > 20);
    fix_ok(tm_world_step(b.world, (int32_t)(1.5 / s->dt_s)), &error);
    assert_true(fix_largest(s->u_m, b.n) < 1e-6 * SIDE_M);
    destroy(&b);
}

static void energy_account_closes_and_energy_is_conserved(void **state) {
    (void)state;
    const tm_material m = material_of(0.45, TM_LAW_NEO_HOOKE);
    block b = make((int[]){3, 3, 3}, &m, 1, false);
    released_conserves_energy(tm_law_name(m.law), b.world, b.mesh, SIDE_M, 0.4, 40, 0.02);
    destroy(&b);
}

/* Shaken, and cut on the way. */
static uint64_t story(int32_t threads, int32_t snapshot_at) {
    const tm_material m = material_of(0.45, TM_LAW_NEO_HOOKE);
    block b = make((int[]){12, 12, 8}, &m, threads, true);
    fix_random random = {5};
    tm_error error;
    tm_state *s = tm_world_state(b.world);
    assert_int_equal(tm_world_partitions(b.world), threads);
    for (int32_t i = 0; i < b.n; i++) s->u_m[i] = s->u_prev_m[i] = 0.02 * SIDE_M * fix_signed(&random);
    for (int32_t k = 0; k < 30; k++) {
        if (k == 10) assert_true(tm_cut_remove(b.tissue, (int32_t[]){100, 700, 1200}, 3, NULL, 0) >= 3);
        fix_ok(tm_world_step(b.world, 1), &error);
        if (k == snapshot_at) step_and_go_back(b.world, 5);
    }
    const uint64_t hash = tm_world_hash(b.world);
    destroy(&b);
    return hash;
}

static void has_the_same_bits_by_threads_and_snapshots(void **state) {
    (void)state;
    const uint64_t one = story(1, -1);
    assert_true(one == story(2, -1));
    assert_true(one == story(3, 20));
}

/* After a cut the force equals that of a fresh build of the remaining tetrahedra, bit for bit. */
static void a_cut_equals_a_fresh_build(void **state) {
    (void)state;
    const tm_material m = material_of(0.45, TM_LAW_NEO_HOOKE);
    block b = make((int[]){4, 4, 4}, &m, 1, true);
    fix_random random = {5};
    tm_error error;
    tm_tissue *fresh;
    assert_true(tm_cut_remove(b.tissue, (int32_t[]){5, 31, 90}, 3, NULL, 0) >= 3);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b.mesh, def.material_count = 1, def.material = &m, def.cuttable = true,
    def.alive = tm_tissue_alive(b.tissue);
    fix_ok(tm_tissue_create(&def, &fresh, &error), &error);
    tm_world_def whole = tm_world_def_default();
    tm_world *other;
    whole.tissue = fresh, whole.dt_s = tm_world_step_s(b.world);
    fix_ok(tm_world_create(&whole, &other, &error), &error);
    tm_state *s = tm_world_state(b.world), *t = tm_world_state(other);
    for (int32_t i = 0; i < b.n; i++)
        if (tm_tissue_mass_kg(fresh)[i / 3] > 0)
            t->u_m[i] = t->u_prev_m[i] = s->u_m[i] = s->u_prev_m[i] = 0.1 * SIDE_M * fix_signed(&random);
    fix_ok(tm_world_step(b.world, 20), &error);
    fix_ok(tm_world_step(other, 20), &error);
    assert_memory_equal(s->u_m, t->u_m, sizeof *s->u_m * (size_t)b.n);
    tm_world_destroy(other);
    tm_tissue_destroy(fresh);
    destroy(&b);
}

/* --- rejected input --- */

static void tissue_is_refused(tm_tissue_def def, tm_status expected, const char *what) {
    tm_tissue *tissue;
    tm_error error;
    assert_int_equal(tm_tissue_create(&def, &tissue, &error), expected);
    assert_non_null(strstr(error.message, what));
}

static void refusals_say_why(void **state) {
    (void)state;
    fix_random random = {1};
    tm_error error;
    tm_mesh *mesh = fix_block((int[]){1, 1, 1}, (double[]){1, 1, 1}, 0, &random);
    const tm_material law = material_of(0.3, TM_LAW_NEO_HOOKE), linear = material_of(0.3, TM_LAW_LINEAR);
    tm_tissue_def def = tm_tissue_def_default(), other;
    def.mesh = mesh, def.material_count = 1, def.material = &law;
    other = def, other.rotation = TM_ROTATION_THRESHOLD;
    tissue_is_refused(other, TM_ERR_EXCLUDED, "rotation");
    other = def, other.strain_smoothing = true; /* by default it averages shear too */
    tissue_is_refused(other, TM_ERR_EXCLUDED, "averaged shear");
    other = def, other.smoothed_shear_share = 0, other.strain_smoothing = true, other.precision = TM_SINGLE;
    tissue_is_refused(other, TM_ERR_ARGUMENT, "double precision");
    tm_material m = linear;
    assert_int_equal(tm_material_set_law(&m, TM_LAW_NEO_HOOKE, NULL, 1.1, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "1.2 <= stretch <= 4 is violated"));
    fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error), &error);
    assert_int_equal(tm_material_set_law(&m, TM_LAW_NEO_HOOKE, NULL, 0, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "dlambda = dmu = beta = 0 is violated"));
    assert_int_equal(m.law, TM_LAW_LINEAR);
    static const struct {
        tm_law_kind law;
        double constant[TM_LAW_CONSTANTS];
        const char *violated;
    } bad[] = {{TM_LAW_ST_VENANT_KIRCHHOFF, {1.5}, "0 <= compression <= 1"},
               {TM_LAW_MOONEY_RIVLIN, {-0.1}, "0 <= second <= 1"},
               {TM_LAW_FUNG, {0}, "C > 0"},
               {TM_LAW_FUNG, {100}, "2 w/C <= 6"},
               {TM_LAW_FUNG, {1e4, 1.5}, "0 <= slack <= 1"},
               {TM_LAW_FUNG, {INFINITY}, "constant 0 = inf is not finite"},
               {TM_LAW_HOLZAPFEL, {INFINITY, 1, 0}, "constant 0 = inf is not finite"},
               {TM_LAW_HOLZAPFEL, {1e3, NAN, 0}, "constant 1 ="},
               {TM_LAW_HOLZAPFEL, {1e3, 1, -0.1}, "0 <= dispersion <= 0.333333"},
               {TM_LAW_MOONEY_RIVLIN, {NAN}, "is not finite"},
               {TM_LAW_HOLZAPFEL, {-1, 1, 0}, "0 <= k1 <= 1e+15"},
               {TM_LAW_HOLZAPFEL, {1e3, 0, 0}, "k2 > 0"},
               {TM_LAW_HOLZAPFEL, {1e3, 1, 0.4}, "dispersion <= 0.333333"},
               {TM_LAW_HOLZAPFEL, {1e3, 9, 0}, "k2 y^2 <= 6"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        m = linear;
        assert_int_equal(tm_material_set_law(&m, bad[i].law, bad[i].constant, 0, &error), TM_ERR_MATERIAL);
        assert_non_null(strstr(error.message, bad[i].violated));
    }
    fix_ok(tm_material_young(YOUNG_PA, -0.45, &m, &error), &error);
    assert_int_equal(tm_material_set_law(&m, TM_LAW_MOONEY_RIVLIN, (double[4]){1}, 0, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "lambda + (1 - second) mu > 0 is violated"));
    assert_int_equal(tm_material_set_law(&m, TM_LAW_FUNG, (double[4]){1e4}, 0, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "lambda > 0 is violated; give a larger Poisson's ratio"));
    fix_ok(tm_material_five(6e3, 2e3, 20e3, 2e3, 90e3, &m, &error), &error);
    m.dlambda_Pa = 14e3, m.beta_Pa = 20e3;
    assert_int_equal(tm_material_set_law(&m, TM_LAW_FUNG, (double[4]){1e6}, 0, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "> dlambda^2 is violated"));
    /* Fibres of length zero, not finite, or missing, with each law that needs them. */
    static const double none[3] = {0, 0, 0}, nan[3] = {NAN, 0, 0};
    static const tm_law_kind fibred[] = {TM_LAW_ST_VENANT_KIRCHHOFF, TM_LAW_FUNG, TM_LAW_HOLZAPFEL};
    for (int i = 0; i < 3; i++) {
        const sample s = {fibred[i], 0.45, {i == 0 ? 1 : 2e4, 0.5, 0.1}, i < 2, 0};
        const tm_material of_fibres = sample_material(&s);
        other = def, other.material = &of_fibres;
        tissue_is_refused(other, TM_ERR_ARGUMENT, "no fibre");
        for (int k = 0; k < 2; k++) {
            double *fibre = fix_fibres(mesh, k ? nan : none);
            other.fibre = fibre;
            tissue_is_refused(other, TM_ERR_ARGUMENT, "give unit vectors");
            free(fibre);
        }
    }
    assert_int_equal(tm_material_set_law(&m, TM_LAW_COUNT, NULL, 0, &error), TM_ERR_MATERIAL);
    tm_mesh_destroy(mesh);
}

static void holzapfels_fibres_have_a_limit_of_their_own(void **state) {
    (void)state;
    tm_material m;
    tm_error error;
    const double plain[4] = {1e3, 0.8, 0.1}, own[4] = {1e3, 0.8, 0.1, 1.3}, bad[4] = {1e3, 0.8, 0.1, 0.9};
    fix_ok(tm_material_young(5e3, 0.45, &m, &error), &error);
    fix_ok(tm_material_set_law(&m, TM_LAW_HOLZAPFEL, plain, 0, &error), &error);
    assert_true(m.stretch_max == 1.8 && m.law_constant[3] == 1.45);
    fix_ok(tm_material_set_law(&m, TM_LAW_HOLZAPFEL, plain, 1.5, &error), &error);
    assert_true(m.stretch_max == 1.5 && m.law_constant[3] == 1.5);
    fix_ok(tm_material_set_law(&m, TM_LAW_HOLZAPFEL, own, 1.5, &error), &error);
    assert_true(m.stretch_max == 1.5 && m.law_constant[3] == 1.3);
    assert_int_equal(tm_material_set_law(&m, TM_LAW_HOLZAPFEL, bad, 0, &error), TM_ERR_MATERIAL);
    assert_non_null(strstr(error.message, "fibre_stretch > 1 is violated"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(uniaxial_stretch_and_press_to_40_percent),
        cmocka_unit_test(simple_shear_by_40_percent),
        cmocka_unit_test(rotated_ends_settle),
        cmocka_unit_test(inverted_tissue_recovers),
        cmocka_unit_test(energy_account_closes_and_energy_is_conserved),
        cmocka_unit_test(has_the_same_bits_by_threads_and_snapshots),
        cmocka_unit_test(a_cut_equals_a_fresh_build),
        cmocka_unit_test(refusals_say_why),
        cmocka_unit_test(holzapfels_fibres_have_a_limit_of_their_own),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
