/* Viscous tissue (tensormass/viscosity.h): relaxation and creep against closed forms, long-term equilibrium, the
 * guaranteed step, snapshots, cutting, rollback of a failed step. */
#include <complex.h>

#include "../fixture.h"
#include "material/bulk.h"
#include "world/world_internal.h"

static const tm_viscosity_term SERIES[3] = {{0.02, 0.3, 0.3}, {0.2, 0.2, 0.2}, {5, 0.1, 0.1}};
static const tm_viscosity_term SHEAR[2] = {{0.02, 0.5, 0}, {0.5, 0.3, 0.1}};

static const double FIBRE[3] = {1, 0.3, -0.2};

static tm_viscosity_def terms(const tm_viscosity_term *term, int32_t count) {
    tm_viscosity_def def = tm_viscosity_def_default();
    def.count = count;
    if (count) memcpy(def.term, term, sizeof *term * (size_t)count);
    return def;
}

typedef struct relaxing {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n;
} relaxing;

typedef struct plan {
    bool fibred, volume, cuttable, damped, rotation_of;
    const tm_viscosity_term *term;
    int32_t count;
    const uint8_t *alive;
} plan;

static tm_material material(const plan *p) {
    tm_material m;
    tm_error error;
    if (p->fibred)
        fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error), &error);
    else
        fix_ok(tm_material_young(5e3, 0.45, &m, &error), &error);
    m.damping_1_s = p->damped ? 40 : 0;
    return m;
}

static relaxing make(const plan *p) {
    fix_random random = {5};
    relaxing r = {.mesh = fix_block((int[]){3, 2, 2}, (double[]){0.03, 0.02, 0.02}, 0.2, &random)};
    const tm_material m = material(p);
    double *fibre = p->fibred ? fix_fibres(r.mesh, FIBRE) : NULL;
    tm_tissue_def def = tm_tissue_def_default();
    tm_error error;
    def.mesh = r.mesh, def.material_count = 1, def.material = &m, def.fibre = fibre;
    def.form = TM_FORCE_PLAIN, def.strain_smoothing = p->volume,
    def.rotation = p->rotation_of ? TM_ROTATION_THRESHOLD : 0;
    if (p->rotation_of) def.smoothed_shear_share = 0;
    def.cuttable = p->cuttable, def.alive = p->alive;
    fix_ok(tm_tissue_create(&def, &r.tissue, &error), &error);
    free(fibre);
    r.world = fix_world(r.tissue, p->damped);
    r.n = 3 * r.mesh->vertex_count;
    if (p->rotation_of) fix_ok(tm_stage_rotation(r.world, NULL, &error), &error);
    if (p->count) {
        const tm_viscosity_def viscosity = terms(p->term, p->count);
        fix_ok(tm_stage_viscosity(r.world, &viscosity, &error), &error);
    }
    return r;
}

static void destroy(relaxing *r) {
    tm_world_destroy(r->world);
    tm_tissue_destroy(r->tissue);
    tm_mesh_destroy(r->mesh);
}

/* Prescribes every component of every vertex, or of those at x = 0. */
static int32_t hold(const relaxing *r, bool all, int32_t *dof) {
    int32_t count = 0;
    for (int32_t i = 0; i < r->n; i++)
        if (all || r->mesh->rest_m[i / 3 * 3] == 0) dof[count++] = i;
    return count;
}

static void support(const relaxing *r, bool all) {
    int32_t *dof = malloc(sizeof *dof * (size_t)r->n);
    double *zero = calloc((size_t)r->n, sizeof *zero);
    tm_support_def def = tm_support_def_default();
    tm_error error;
    def.count = hold(r, all, dof), def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(r->world, &def, &error), &error);
    free(dof);
    free(zero);
}

/* --- relaxation --- */

/* All vertices follow u = s(t) G x, s a ramp that ends at a step; the forces are known at all times. */
static double ramp_share(const tm_viscosity_term *t, double ramp_s, double now_s) {
    /* Returns the remaining stress of the term, per unit of strain: the integral of exp(-(now - s)/time) over the
     * ramp. */
    const double end = fmin(now_s, ramp_s);
    return t->time_s / ramp_s * (exp(-(now_s - end) / t->time_s) - exp(-now_s / t->time_s));
}

static void lead(relaxing *r, const double *whole, double s) {
    for (int32_t i = 0; i < r->n; i++) tm_support_move(r->world, i, s * whole[i]);
}

/* A stretch by 3e-3 along the fibre and 1e-3 across it: its stress has the same axes, and its strain is U - 1. */
static void stretched(const relaxing *r, double *whole) {
    const double size = 1 + 0.3 * 0.3 + 0.2 * 0.2;
    for (int32_t i = 0; i < r->n; i++) {
        const double *x = r->mesh->rest_m + i / 3 * 3;
        const double along = (FIBRE[0] * x[0] + FIBRE[1] * x[1] + FIBRE[2] * x[2]) / size;
        whole[i] = 1e-3 * x[i % 3] + 2e-3 * along * FIBRE[i % 3];
    }
}

/* Returns the error of the forces, relative to the largest. size_m: of random displacements; 0: a stretch. */
static double relaxation_error(const plan *p, double size_m) {
    relaxing r = make(p);
    support(&r, true);
    double *whole = malloc(sizeof *whole * (size_t)r.n), *truth = malloc(sizeof *truth * (size_t)r.n), worst = 0;
    fix_random random = {3};
    for (int32_t i = 0; i < r.n; i++) whole[i] = size_m * fix_signed(&random);
    if (size_m == 0) stretched(&r, whole);
    const tm_state *s = tm_world_state(r.world);
    const int ramp = 100;
    for (int step = 0; step < 2000; step++) {
        lead(&r, whole, fmin(1, (step + 1.0) / ramp));
        fix_ok(tm_world_step(r.world, 1), NULL);
        if ((step + 1) % 50) continue;
        /* force_N was computed before the step, at one step less. */
        const double now = step * s->dt_s, end = ramp * s->dt_s, elastic = fmin(1, (double)step / ramp);
        double shear = elastic, volume = elastic;
        for (int32_t t = 0; t < p->count; t++) {
            const double gone = elastic - ramp_share(p->term + t, end, now);
            shear -= p->term[t].shear * gone, volume -= p->term[t].bulk * gone;
        }
        /* Tissue of a law with these shares of its moduli, loaded as one law. */
        tm_material m = material(p), left = m;
        const double across = m.lambda_Pa + m.mu_Pa, mixed = m.lambda_Pa + m.dlambda_Pa;
        const double along = m.lambda_Pa + 2 * m.mu_Pa + 2 * m.dlambda_Pa + 4 * m.dmu_Pa + m.beta_Pa;
        const double bulk = (across * along - mixed * mixed) / (along - 2 * mixed + across);
        left.mu_Pa *= shear, left.dlambda_Pa *= shear, left.dmu_Pa *= shear, left.beta_Pa *= shear;
        left.lambda_Pa = shear * (m.lambda_Pa - bulk) + volume * bulk;
        double *fibre = p->fibred ? fix_fibres(r.mesh, FIBRE) : NULL;
        tm_tissue_def def = tm_tissue_def_default();
        tm_tissue *other = NULL;
        tm_error error;
        def.mesh = r.mesh, def.material_count = 1, def.material = &left, def.fibre = fibre,
        def.strain_smoothing = p->volume;
        fix_ok(tm_tissue_create(&def, &other, &error), &error);
        tm_tissue_force(other, whole, truth);
        tm_tissue_destroy(other);
        free(fibre);
        double most = 0;
        for (int32_t i = 0; i < r.n; i++) most = fmax(most, fabs(s->force_N[i] - truth[i]));
        worst = fmax(worst, most / fix_largest(truth, r.n));
    }
    free(whole), free(truth);
    destroy(&r);
    return worst;
}

static void check_relaxation(const plan *p) { assert_true(relaxation_error(p, 1e-4) < 1e-9); }

/* Terms of corotational tissue use U - 1 to second order. They agree with the closed form's linear strain in a
 * stretch; otherwise the difference falls with the displacement. */
static void check_turned_relaxation(const plan *p) {
    const double stretch = relaxation_error(p, 0), far = relaxation_error(p, 1e-5), near = relaxation_error(p, 1e-6);
    print_message("%s: %.1e off in a stretch, %.1e and %.1e at random\n", p->fibred ? "fibred" : "isotropic", stretch,
                  far, near);
    assert_true(stretch < 1e-9);
    assert_true(far < 5e-3 && near < 0.11 * far);
}

static void relaxation_is_the_closed_form(void **state) {
    (void)state;
    check_relaxation(&(plan){.term = SERIES, .count = 3});
    check_relaxation(&(plan){.term = SHEAR, .count = 2});
    check_relaxation(&(plan){.term = SHEAR, .count = 2, .volume = true});
    check_relaxation(&(plan){.term = SHEAR, .count = 2, .volume = true, .cuttable = true});
    check_relaxation(&(plan){.term = SHEAR, .count = 2, .fibred = true});
    check_relaxation(&(plan){.term = SERIES, .count = 1, .fibred = true, .cuttable = true});
    check_turned_relaxation(&(plan){.term = SERIES, .count = 3, .rotation_of = true});
    check_turned_relaxation(&(plan){.term = SHEAR, .count = 2, .rotation_of = true, .fibred = true});
}

/* --- creep: one vertex of one tetrahedron, free along x, under a load applied at once --- */

/* Finds the roots of m z^2 + c z + k (1 - g/(1 + z time)) = 0 and the initial u at the elastic equilibrium: three
 * exponentials. */
static double crept(double mass, double drag, double stiffness, const tm_viscosity_term *t, double now_s) {
    const double g = t->shear, tau = t->time_s, left = 1 - g;
    double slow = -left / tau;
    for (int i = 0; i < 50; i++) {
        const double value = (mass * slow * slow + drag * slow + stiffness) * (1 + slow * tau) - stiffness * g;
        const double slope =
            (2 * mass * slow + drag) * (1 + slow * tau) + tau * (mass * slow * slow + drag * slow + stiffness);
        slow -= value / slope;
    }
    /* The other two: sum and product from the cubic's coefficients. */
    const double sum = -(drag * tau + mass) / (mass * tau) - slow;
    const double product = -stiffness * left / (mass * tau) / slow;
    const double complex root = csqrt(sum * sum / 4 - product);
    const double complex z[3] = {slow, sum / 2 + root, sum / 2 - root};
    const double start = 1 - 1 / left; /* u - u_infinity, in units of f/k; no velocity and no force at the start */
    double complex u = 1 / left;
    for (int i = 0; i < 3; i++) {
        const double complex a = z[(i + 1) % 3], b = z[(i + 2) % 3];
        u += start * a * b / ((z[i] - a) * (z[i] - b)) * cexp(z[i] * now_s);
    }
    return creal(u);
}

static void creep_is_the_closed_form(void **state) {
    (void)state;
    static const double corner[12] = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01};
    const tm_viscosity_term one = {0.7, 0.6, 0.6};
    const plan p = {.damped = true};
    const tm_material m = material(&p);
    tm_mesh *mesh;
    tm_error error;
    fix_ok(fix_one_tet(corner, &mesh, &error), &error);
    tm_tissue *tissue = fix_tissue(mesh, &m, NULL, TM_DOUBLE, false);
    tm_world_def world_def = tm_world_def_default();
    tm_world *world;
    world_def.tissue = tissue, world_def.step_fraction = 0.03;
    fix_ok(tm_world_create(&world_def, &world, &error), &error);
    const tm_viscosity_def def = terms(&one, 1);
    fix_ok(tm_stage_viscosity(world, &def, &error), &error);
    int32_t free_vertex = 0, dof[11];
    while (mesh->rest_m[3 * free_vertex] == 0) free_vertex++;
    double zero[11] = {0}, load[12] = {0}, K[9];
    tm_support_def support_def = tm_support_def_default();
    for (int32_t i = 0; i < 12; i++)
        if (i != 3 * free_vertex) dof[support_def.count++] = i;
    support_def.dof = dof, support_def.value_m = zero;
    fix_ok(tm_stage_support(world, &support_def, &error), &error);
    load[3 * free_vertex] = 1e-3;
    fix_ok(tm_stage_load(world, load, &error), &error);
    tm_tissue_vertex_tensor(tissue, free_vertex, K);
    const tm_state *s = tm_world_state(world);
    const double sudden = 1e-3 / K[0];
    s->u_m[3 * free_vertex] = s->u_prev_m[3 * free_vertex] = sudden;
    double most = 0;
    while (s->time_s < 3) {
        fix_ok(tm_world_step(world, 200), NULL);
        const double truth = crept(tm_tissue_mass_kg(tissue)[free_vertex], tm_tissue_damping_kg_s(tissue)[free_vertex],
                                   K[0], &one, s->time_s);
        most = fmax(most, fabs(s->u_m[3 * free_vertex] / sudden / truth - 1));
    }
    print_message("creep: %.2e off, steps of %g s\n", most, s->dt_s);
    assert_true(most < 1e-6);
    assert_true(fabs(s->u_m[3 * free_vertex] / sudden - 2.5) < 0.5);
    tm_world_destroy(world), tm_tissue_destroy(tissue), tm_mesh_destroy(mesh);
}

/* --- rotation --- */

static void rotation_about(double angle, double R[9]) {
    const double a[3] = {0.6, -0.64, 0.48}, c = cos(angle), s = sin(angle);
    const double skew[9] = {0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0};
    for (int i = 0; i < 9; i++) R[i] = (i % 4 ? 0 : c) + (1 - c) * a[i / 3] * a[i % 3] + s * skew[i];
}

/* Computes u of the mesh stretched by 1 + s G and then rotated. */
static void lead_turned(const relaxing *r, double s, double angle, double *u) {
    static const double G[9] = {0.05, 0.02, -0.01, 0.02, -0.04, 0.03, -0.01, 0.03, 0.02};
    double R[9];
    rotation_about(angle, R);
    for (int32_t v = 0; v < r->mesh->vertex_count; v++) {
        const double *x = r->mesh->rest_m + 3 * v;
        double y[3];
        for (int i = 0; i < 3; i++) y[i] = x[i] + s * (G[3 * i] * x[0] + G[3 * i + 1] * x[1] + G[3 * i + 2] * x[2]);
        for (int i = 0; i < 3; i++) u[3 * v + i] = R[3 * i] * y[0] + R[3 * i + 1] * y[1] + R[3 * i + 2] * y[2] - x[i];
    }
}

/* Tissue that is stretched by 1 % while it begins to rotate, through the band of the threshold, relaxes like tissue
 * rotated before: a history stores almost nothing of the rotation. */
static void history_excludes_a_beginning_rotation(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        const plan bare = {.rotation_of = true, .fibred = fibred};
        const tm_viscosity_def def = terms(SHEAR, 2);
        const int steps = 200;
        relaxing r[2];
        double u[3000], R[9], worst = 0;
        for (int k = 0; k < 2; k++) {
            tm_error error;
            r[k] = make(&bare);
            support(&r[k], true);
            lead_turned(&r[k], 0, k ? 0 : 1, u);
            memcpy(tm_world_state(r[k].world)->u_m, u, sizeof *u * (size_t)r[k].n);
            fix_ok(tm_stage_viscosity(r[k].world, &def, &error), &error);
            for (int step = 0; step < steps; step++) {
                lead_turned(&r[k], 0.2 * fmin(1, step / 50.0), k ? 1.2 * step / steps : 1, u);
                for (int32_t i = 0; i < r[k].n; i++) tm_support_move(r[k].world, i, u[i]);
                fix_ok(tm_world_step(r[k].world, 1), NULL);
            }
        }
        const double *a = tm_world_state(r[0].world)->force_N, *b = tm_world_state(r[1].world)->force_N;
        rotation_about(1.2 * (steps - 2) / steps - 1, R);
        for (int32_t i = 0; i < r[0].n; i++) {
            const double *f = a + i / 3 * 3, *of = R + 3 * (i % 3);
            worst = fmax(worst, fabs(of[0] * f[0] + of[1] * f[1] + of[2] * f[2] - b[i]));
        }
        worst /= fix_largest(a, r[0].n);
        print_message("%s, through the band: %.1e off\n", fibred ? "fibred" : "isotropic", worst);
        assert_true(worst < 1e-6); /* of the strain's second order in the band: 2e-8; of the linear strain 3e-5 */
        destroy(&r[0]), destroy(&r[1]);
    }
}

/* Tissue that is stretched while it rotates by 70 degrees relaxes in its own axes as it does at rest; for any
 * history its forces have no sum and no moment. */
static void rotating_tissue_relaxes_in_its_own_axes(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        const plan still_plan = {.term = SHEAR, .count = 2, .rotation_of = true, .fibred = fibred};
        const plan plan_of[2] = {still_plan, still_plan};
        relaxing r[2];
        double *u = malloc(sizeof *u * 3000), R[9];
        const int steps = 200;
        for (int k = 0; k < 2; k++) {
            plan bare = plan_of[k];
            bare.count = 0;
            r[k] = make(&bare);
            support(&r[k], true);
            lead_turned(&r[k], 0, k ? 1 : 0, u); /* the other one starts rotated, by a radian */
            memcpy(tm_world_state(r[k].world)->u_m, u, sizeof *u * (size_t)r[k].n);
            const tm_viscosity_def def = terms(SHEAR, 2);
            tm_error error;
            fix_ok(tm_stage_viscosity(r[k].world, &def, &error), &error);
            for (int step = 0; step < steps; step++) {
                lead_turned(&r[k], fmin(1, step / 50.0), k ? 1 + 1.2 * step / steps : 0, u);
                for (int32_t i = 0; i < r[k].n; i++) tm_support_move(r[k].world, i, u[i]);
                fix_ok(tm_world_step(r[k].world, 1), NULL);
            }
        }
        const double *a = tm_world_state(r[0].world)->force_N, *b = tm_world_state(r[1].world)->force_N;
        const double size = fix_largest(a, r[0].n);
        rotation_about(1 + 1.2 * (steps - 2) / steps, R);
        double worst = 0;
        for (int32_t i = 0; i < r[0].n; i++) {
            const double *f = a + i / 3 * 3;
            worst =
                fmax(worst, fabs(R[3 * (i % 3)] * f[0] + R[3 * (i % 3) + 1] * f[1] + R[3 * (i % 3) + 2] * f[2] - b[i]));
        }
        print_message("%s: %.1e off\n", fibred ? "fibred" : "isotropic", worst / size);
        assert_true(worst < (fibred ? 1e-6 : 1e-9) * size); /* the rotation of least energy is found to 1e-8 */
        /* Random corners after that history. */
        fix_random random = {8};
        tm_state *s = tm_world_state(r[0].world);
        for (int32_t i = 0; i < r[0].n; i++) s->u_m[i] += 2e-3 * fix_signed(&random);
        fix_ok(tm_world_step(r[0].world, 1), NULL); /* its force is that of the earlier u */
        double sum[3] = {0}, moment[3] = {0}, most = 0;
        for (int32_t v = 0; v < r[0].mesh->vertex_count; v++) {
            const double *f = s->force_N + 3 * v;
            double x[3];
            for (int i = 0; i < 3; i++) x[i] = r[0].mesh->rest_m[3 * v + i] + s->u_prev_m[3 * v + i], sum[i] += f[i];
            moment[0] += x[1] * f[2] - x[2] * f[1], moment[1] += x[2] * f[0] - x[0] * f[2];
            moment[2] += x[0] * f[1] - x[1] * f[0];
            most += 0.01 * fix_largest(f, 3);
        }
        print_message("moment %.1e of what forces could have\n", fix_largest(moment, 3) / most);
        assert_true(fix_largest(sum, 3) < 1e-10 * most / 0.01);
        assert_true(fibred || fix_largest(moment, 3) < 1e-4 * most);
        free(u);
        destroy(&r[0]), destroy(&r[1]);
    }
}

/* --- equilibrium --- */

static double *loads(const relaxing *r) {
    fix_random random = {9};
    double *load = malloc(sizeof *load * (size_t)r->n);
    for (int32_t i = 0; i < r->n; i++) load[i] = 1e-4 * fix_signed(&random);
    return load;
}

static void check_rest(const plan *p) {
    relaxing r = make(p), l = {0};
    double shear = 1, volume = 1, *load = loads(&r);
    tm_error error;
    for (int32_t t = 0; t < p->count; t++) shear -= p->term[t].shear, volume -= p->term[t].bulk;
    tm_tissue *left = NULL;
    fix_ok(tm_tissue_relaxed(r.tissue, shear, volume, &left, &error), &error);
    l = (relaxing){r.mesh, left, fix_world(left, p->damped), r.n};
    if (p->rotation_of) fix_ok(tm_stage_rotation(l.world, NULL, &error), &error);
    const relaxing *both[2] = {&r, &l};
    const tm_settle_def settle = tm_settle_def_default();
    tm_settle_result result[2];
    for (int i = 0; i < 2; i++) {
        support(both[i], false);
        fix_ok(tm_stage_load(both[i]->world, load, &error), &error);
        fix_ok(tm_world_settle(both[i]->world, &settle, result + i, &error), &error);
    }
    const double *u = tm_world_state(r.world)->u_m, *truth = tm_world_state(l.world)->u_m;
    const double size = fix_largest(truth, r.n);
    for (int32_t i = 0; i < r.n; i++) assert_true(fabs(u[i] - truth[i]) < 1e-8 * size);
    assert_true(fabs(result[0].energy_J / result[1].energy_J - 1) < 1e-8);
    /* It is an equilibrium: steps do not leave it. */
    fix_ok(tm_world_step(r.world, 200), NULL);
    for (int32_t i = 0; i < r.n; i++) assert_true(fabs(tm_world_state(r.world)->u_m[i] - truth[i]) < 1e-7 * size);
    free(load);
    tm_world_destroy(l.world), tm_tissue_destroy(left);
    destroy(&r);
}

static void settles_to_the_relaxed_equilibrium(void **state) {
    (void)state;
    check_rest(&(plan){.term = SERIES, .count = 3, .damped = true});
    check_rest(&(plan){.term = SHEAR, .count = 2, .damped = true, .cuttable = true});
    check_rest(&(plan){.term = SHEAR, .count = 2, .damped = true, .volume = true, .fibred = true});
    check_rest(&(plan){.term = SHEAR, .count = 2, .damped = true, .rotation_of = true});
}

/* --- the step --- */

static void shake(const relaxing *r, uint64_t seed) {
    fix_random random = {seed};
    const tm_state *s = tm_world_state(r->world);
    for (int32_t i = 0; i < r->n; i++) s->u_prev_m[i] = s->u_m[i] - 1e-5 * fix_signed(&random);
}

/* Just below the estimated critical step of the instantaneous law, undamped and free: nothing grows, for any terms. */
static void guaranteed_step_needs_no_change(void **state) {
    (void)state;
    static const tm_viscosity_term hard[][2] = {{{1e-6, 0.9999, 0.9999}}, {{1e6, 0.9999, 0.9999}},
                                                {{3e-3, 0.9999, 0.9999}}, {{1e-3, 0.9, 0}, {1e-2, 0.0999, 0.9999}},
                                                {{1e-2, 0, 0.9999}},      {{3e-4, 0.5, 0.2}, {3e-3, 0.4, 0.7}}};
    for (size_t k = 0; k < sizeof hard / sizeof *hard; k++)
        for (int volume = 0; volume < 2; volume++) {
            const plan p = {.term = hard[k], .count = hard[k][1].time_s > 0 ? 2 : 1, .volume = volume};
            relaxing r = make(&p);
            tm_error error;
            double estimate;
            fix_ok(tm_critical_step_estimate(r.tissue, NULL, 1e-9, 100000, &estimate, &error), &error);
            r.world->guaranteed_step_s = estimate;
            fix_ok(tm_world_set_step(r.world, 0.9995 * estimate, &error), &error);
            shake(&r, 4 + k);
            double early = 0, late = 0;
            for (int i = 0; i < 4000; i++) {
                fix_ok(tm_world_step(r.world, 1), &error);
                double moved = 0; /* of free tissue: without its drift */
                const tm_state *s = tm_world_state(r.world);
                for (int32_t c = 0; c < r.n; c++) moved = fmax(moved, fabs(s->u_m[c] - s->u_prev_m[c]));
                if (i < 1000) early = fmax(early, moved);
                if (i >= 3000) late = fmax(late, moved);
            }
            assert_true(late < 1.05 * early);
            destroy(&r);
        }
}

/* --- snapshots, failure, cutting --- */

static void pull(const relaxing *r, const double *load) {
    tm_error error;
    support(r, false);
    fix_ok(tm_stage_load(r->world, load, &error), &error);
}

static void check_snapshot(bool turned) {
    const plan p = {.term = SHEAR, .count = 2, .damped = true, .cuttable = true, .rotation_of = turned};
    const int32_t gone[3] = {70, 65, 61};
    relaxing a = make(&p), b = make(&p);
    double *load = loads(&a);
    tm_error error;
    pull(&a, load), pull(&b, load);
    fix_ok(tm_world_step(a.world, 40), NULL);
    tm_cut_remove(a.tissue, gone, 3, NULL, 0);
    fix_ok(tm_world_step(a.world, 40), NULL);
    const int64_t bytes = tm_snapshot_bytes(a.world);
    void *buffer = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(a.world, buffer, bytes, &error), &error);
    fix_ok(tm_snapshot_restore(b.world, buffer, bytes, &error), &error);
    fix_ok(tm_world_step(a.world, 100), NULL);
    fix_ok(tm_world_step(b.world, 100), NULL);
    assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
    /* Another series is another scene. */
    const plan other = {.term = SERIES, .count = 2, .damped = true, .cuttable = true, .rotation_of = turned};
    relaxing c = make(&other);
    pull(&c, load);
    assert_int_equal(tm_snapshot_restore(c.world, buffer, bytes, &error), TM_ERR_ARGUMENT);
    free(buffer), free(load);
    destroy(&a), destroy(&b), destroy(&c);
}

static void snapshots_go_on_with_the_same_bits(void **state) {
    (void)state;
    check_snapshot(false);
    check_snapshot(true);
}

static struct tm_stage_entry *stage_of(const relaxing *r) {
    for (int32_t i = 0; i < r->world->stage_count; i++)
        if (!strcmp(r->world->entry[i].stage.name, "viscosity")) return r->world->entry + i;
    return NULL;
}

/* Sets the same state in tissue built without the removed tetrahedra. */
static void check_cut(const plan *p) {
    const int32_t gone[3] = {70, 65, 61};
    plan fresh_plan = *p;
    relaxing a = make(p);
    double *load = loads(&a);
    pull(&a, load);
    fix_ok(tm_world_step(a.world, 60), NULL);
    tm_cut_remove(a.tissue, gone, 3, NULL, 0);
    uint8_t *alive = malloc((size_t)a.mesh->tet_count);
    memcpy(alive, tm_tissue_alive(a.tissue), (size_t)a.mesh->tet_count);
    fresh_plan.alive = alive;
    relaxing b = make(&fresh_plan);
    pull(&b, load);
    fix_ok(tm_world_set_step(b.world, tm_world_step_s(a.world), NULL), NULL);
    const size_t bytes = sizeof(double) * (size_t)a.n;
    memcpy(b.world->state.u_m, a.world->state.u_m, bytes);
    memcpy(b.world->state.u_prev_m, a.world->state.u_prev_m, bytes);
    b.world->state.step = a.world->state.step, b.world->state.time_s = a.world->state.time_s;
    const tm_stage *from = &stage_of(&a)->stage, *to = &stage_of(&b)->stage;
    const int64_t kept = from->snapshot(from->self, NULL);
    void *history = malloc((size_t)kept);
    from->snapshot(from->self, history);
    assert_true(to->restore(to->self, b.world, history, kept, true));
    fix_ok(tm_world_step(a.world, 100), NULL);
    fix_ok(tm_world_step(b.world, 100), NULL);
    assert_memory_equal(a.world->state.force_N, b.world->state.force_N, bytes);
    assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
    free(history), free(alive), free(load);
    destroy(&a), destroy(&b);
}

static void a_cut_is_a_fresh_build_in_the_same_state(void **state) {
    (void)state;
    check_cut(&(plan){.term = SERIES, .count = 3, .damped = true, .cuttable = true});
    check_cut(&(plan){.term = SHEAR, .count = 2, .damped = true, .cuttable = true, .fibred = true});
    check_cut(&(plan){.term = SHEAR, .count = 2, .damped = true, .cuttable = true, .volume = true});
    check_cut(&(plan){.term = SHEAR, .count = 2, .damped = true, .cuttable = true, .rotation_of = true});
}

static void check_failure(bool turned, bool volume) {
    const plan p = {.term = SHEAR, .count = 2, .damped = true, .rotation_of = turned, .volume = volume};
    relaxing a = make(&p), b = make(&p);
    double *load = loads(&a);
    pull(&a, load), pull(&b, load);
    fix_ok(tm_world_step(a.world, 30), NULL);
    fix_ok(tm_world_step(b.world, 30), NULL);
    const double was = a.world->state.u_prev_m[a.n - 1];
    a.world->state.u_prev_m[a.n - 1] = 1e300;
    assert_int_equal(tm_world_step(a.world, 5), TM_ERR_UNSTABLE);
    a.world->state.u_prev_m[a.n - 1] = was;
    fix_ok(tm_world_step(a.world, 30), NULL);
    fix_ok(tm_world_step(b.world, 30), NULL);
    assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
    free(load);
    destroy(&a), destroy(&b);
}

static void failed_step_is_rolled_back(void **state) {
    (void)state;
    for (int k = 0; k < 4; k++) check_failure(k & 1, k & 2);
}

static void removed_stage_returns_its_memory(void **state) {
    (void)state;
    const plan with = {.term = SHEAR, .count = 2, .damped = true}, without = {.damped = true};
    relaxing a = make(&with), b = make(&without);
    double *load = loads(&a);
    tm_error error;
    pull(&a, load), pull(&b, load);
    fix_ok(tm_world_remove_stage(a.world, "viscosity", &error), &error);
    fix_ok(tm_world_step(a.world, 30), NULL);
    fix_ok(tm_world_step(b.world, 30), NULL);
    assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
    assert_int_equal(a.world->stage_count, b.world->stage_count);
    free(load);
    destroy(&a), destroy(&b);
}

static void refuses(tm_viscosity_def def, const char *says) {
    const plan p = {.damped = true};
    relaxing r = make(&p);
    tm_error error = {0};
    assert_int_equal(tm_stage_viscosity(r.world, &def, &error), TM_ERR_ARGUMENT);
    if (!strstr(error.message, says)) fail_msg("%s", error.message);
    destroy(&r);
}

static void invalid_terms_are_rejected(void **state) {
    (void)state;
    refuses(terms(NULL, 0), "1 to 3");
    refuses(terms(&(tm_viscosity_term){0, 0.5, 0.5}, 1), "term 0");
    refuses(terms(&(tm_viscosity_term){1, -0.5, 0.5}, 1), "term 0");
    refuses(terms(&(tm_viscosity_term){1, 0.5, NAN}, 1), "term 0");
    refuses(terms((tm_viscosity_term[]){{1, 0.6, 0}, {2, 0.6, 0}}, 2), "so that some stiffness does not relax");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(relaxation_is_the_closed_form),
        cmocka_unit_test(creep_is_the_closed_form),
        cmocka_unit_test(history_excludes_a_beginning_rotation),
        cmocka_unit_test(rotating_tissue_relaxes_in_its_own_axes),
        cmocka_unit_test(settles_to_the_relaxed_equilibrium),
        cmocka_unit_test(guaranteed_step_needs_no_change),
        cmocka_unit_test(snapshots_go_on_with_the_same_bits),
        cmocka_unit_test(a_cut_is_a_fresh_build_in_the_same_state),
        cmocka_unit_test(failed_step_is_rolled_back),
        cmocka_unit_test(removed_stage_returns_its_memory),
        cmocka_unit_test(invalid_terms_are_rejected),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
