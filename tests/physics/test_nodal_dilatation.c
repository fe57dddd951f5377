/* Corotational tissue with nodal dilatation (effects "rotation" and "strain_smoothing" together): derivatives, rigid
 * motions, small strains, cuts, snapshots, forms and threads, the guaranteed step, the energy account, equilibrium,
 * and a strongly bent beam of nearly incompressible tissue. */
#include "tensormass/viscosity.h"
#include "turning.h"

static const double FIBRE[3] = {0.48, -0.6, 0.64};

typedef struct turning {
    tm_mesh *mesh;
    tm_material material[2];
    bool fibred;
    tm_tissue *tissue;
    tm_world *world;
    tm_rotation *rotation;
    int32_t n;
} turning;

typedef struct how {
    bool linear, plain_volume, cuttable, damped,
        best; /* linear: without rotation; plain_volume: without strain smoothing */
    const uint8_t *alive;
    int32_t threads;
    double dt_s, scaled_step_s;
} how;

/* Makes two regions with different laws, divided across x; `poisson` is that of the first. */
static tm_mesh *regions(const int cells[3], const double size_m[3], double jitter, fix_random *random) {
    tm_mesh *one = fix_block(cells, size_m, jitter, random);
    int32_t *region = calloc((size_t)one->tet_count, sizeof *region);
    for (int32_t t = 0; t < one->tet_count; t++) {
        double x = 0;
        for (int k = 0; k < 4; k++) x += one->rest_m[3 * one->tet[4 * t + k]] / 4;
        region[t] = x > size_m[0] / 2;
    }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = one->vertex_count, def.vertex_m = one->rest_m;
    def.tet_count = one->tet_count, def.tet = one->tet, def.region = region;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(region);
    tm_mesh_destroy(one);
    return mesh;
}

static tm_tissue *make_tissue(const turning *t, const how *h) {
    tm_tissue_def def = tm_tissue_def_default();
    double *fibre = t->fibred ? fix_fibres(t->mesh, FIBRE) : NULL;
    def.mesh = t->mesh, def.material_count = 2, def.material = t->material, def.fibre = fibre;
    def.cuttable = h->cuttable, def.alive = h->alive, def.form = h->best ? TM_FORCE_BEST : TM_FORCE_PLAIN;
    def.rotation = h->linear ? 0 : TM_ROTATION_THRESHOLD;
    def.strain_smoothing = !h->plain_volume, def.smoothed_shear_share = 0;
    def.scaled_step_s = h->scaled_step_s, def.scaled_share = 100;
    tm_tissue *tissue = NULL;
    tm_error error;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    free(fibre);
    return tissue;
}

/* Transfers the mesh to the corotational form. */
static turning make(tm_mesh *mesh, bool fibred, double poisson, const how *h) {
    turning t = {.mesh = mesh, .n = 3 * mesh->vertex_count, .fibred = fibred};
    tm_error error;
    fix_ok(tm_material_young(5e3, poisson, t.material, &error), &error);
    fix_ok(tm_material_young(9e3, 0.4, t.material + 1, &error), &error);
    if (fibred) fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, t.material, &error), &error);
    t.material[0].damping_1_s = h->damped ? 30 : 0;
    t.material[1].damping_1_s = h->damped ? 30 : 0;
    t.tissue = make_tissue(&t, h);
    tm_world_def def = tm_world_def_default();
    def.tissue = t.tissue, def.damped = h->damped, def.threads = h->threads ? h->threads : 1;
    def.dt_s = h->dt_s;
    fix_ok(tm_world_create(&def, &t.world, &error), &error);
    if (!h->linear) fix_ok(tm_stage_rotation(t.world, &t.rotation, &error), &error);
    return t;
}

static turning block(bool fibred, double poisson, const how *h) {
    fix_random random = {7};
    return make(regions((int[]){3, 2, 2}, (double[]){0.03, 0.02, 0.02}, 0.2, &random), fibred, poisson, h);
}

static void destroy(turning *t) {
    tm_world_destroy(t->world);
    tm_tissue_destroy(t->tissue);
    tm_mesh_destroy(t->mesh);
}

static double *vectors(const turning *t, int count) { return calloc((size_t)(count * t->n), sizeof(double)); }

static void force_at(const turning *t, const double *u, double *f, double *scratch) {
    turning_force(t->tissue, t->rotation, u, f, scratch);
}

static double energy_at(const turning *t, const double *u) { return turning_energy(t->tissue, t->rotation, u); }

static const double AXIS[3] = {0.6, -0.64, 0.48};

/* Rotates a about the axis into b. */
static void turn_vector(double angle, const double a[3], double b[3]) {
    const double c = cos(angle), s = sin(angle), along = AXIS[0] * a[0] + AXIS[1] * a[1] + AXIS[2] * a[2];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        b[i] = c * a[i] + s * (AXIS[j] * a[k] - AXIS[k] * a[j]) + AXIS[i] * along * (1 - c);
    }
}

/* Computes u of the points x + d under a rigid rotation and translation. */
static void turn(const turning *t, double angle, double far_m, const double *d, double *u) {
    for (int32_t v = 0; v < t->mesh->vertex_count; v++) {
        double x[3], y[3];
        for (int i = 0; i < 3; i++) x[i] = t->mesh->rest_m[3 * v + i] + (d ? d[3 * v + i] : 0);
        turn_vector(angle, x, y);
        for (int i = 0; i < 3; i++) u[3 * v + i] = y[i] - t->mesh->rest_m[3 * v + i] + far_m;
    }
}

static void force_and_tangent_are_derivatives(void **state) {
    (void)state;
    for (int law = 0; law < 3; law++) {
        turning t = block(law == 2, law ? 0.3 : 0.49, &(how){.cuttable = law == 1});
        double *u = vectors(&t, 5), *d = u + 2 * t.n, *s = u + 4 * t.n;
        fix_random random = {3};
        tm_pool pool = {0};
        tm_tangent tangent;
        if (law == 1) assert_true(tm_cut_remove(t.tissue, (int32_t[]){5, 31}, 2, NULL, 0) >= 2);
        assert_true(tm_tangent_init(&tangent, &pool, t.rotation));
        for (double size = 1e-5; size < 3e-3; size *= 2) {
            for (int32_t i = 0; i < t.n; i++) u[i] = size * fix_signed(&random), d[i] = fix_signed(&random);
            turn(&t, size * 500, 0, u, s);
            memcpy(u, s, sizeof(double) * (size_t)t.n);
            turning_has_derivatives(t.tissue, t.rotation, &tangent, u, &random, 1e-4, 2e-6);
        }
        tm_pool_release(&pool);
        free(u);
        destroy(&t);
    }
}

static void a_rigid_motion_gives_no_force(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        turning t = block(fibred, 0.49, &(how){0});
        double *u = vectors(&t, 3), *f = u + t.n, *s = u + 2 * t.n;
        for (double angle = 0.1; angle < 3.3; angle += 0.2) {
            turn(&t, angle, 0.03 * angle, NULL, u);
            force_at(&t, u, f, s);
            tm_tissue_force(t.tissue, u, s);
            assert_true(fix_largest(f, t.n) < 1e-12 * fix_largest(s, t.n));
            assert_true(fabs(energy_at(&t, u)) < 1e-10 * tm_tissue_energy(t.tissue, u));
        }
        free(u);
        destroy(&t);
    }
}

/* Small strains on a large rotation equal those of strain smoothing alone, rotated; a stretch without rotation does
 * so at any size below the tension bound. */
static void small_strains_and_stretches_equal_strain_smoothing(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        turning t = block(fibred, 0.49, &(how){0});
        double *u = vectors(&t, 4), *f = u + t.n, *s = u + 2 * t.n, *g = u + 3 * t.n, worst = 0;
        fix_random random = {5};
        for (int32_t i = 0; i < t.n; i++) s[i] = 1e-9 * fix_signed(&random);
        turn(&t, 1.3, 0, s, u);
        tm_tissue_force(t.tissue, s, g);
        force_at(&t, u, f, s);
        for (int32_t v = 0; v < t.mesh->vertex_count; v++) {
            double turned[3];
            turn_vector(1.3, g + 3 * v, turned);
            for (int i = 0; i < 3; i++) worst = fmax(worst, fabs(f[3 * v + i] - turned[i]));
        }
        assert_true(worst < 1e-5 * fix_largest(g, t.n));
        for (int32_t i = 0; i < t.n; i++) { /* by 1.15, 0.9 and sheared, symmetric */
            const double stretch[9] = {0.15, 0.03, 0, 0.03, -0.1, 0.02, 0, 0.02, 0.05}, *x = t.mesh->rest_m + i / 3 * 3;
            u[i] = stretch[3 * (i % 3)] * x[0] + stretch[3 * (i % 3) + 1] * x[1] + stretch[3 * (i % 3) + 2] * x[2];
        }
        tm_tissue_force(t.tissue, u, g);
        force_at(&t, u, f, s);
        worst = 0;
        for (int32_t i = 0; i < t.n; i++) worst = fmax(worst, fabs(f[i] - g[i]));
        assert_true(fibred ||
                    worst < 1e-12 * fix_largest(g, t.n)); /* fibres rotate by the energy's rotation, not by F alone */
        assert_true(fibred || fabs(tm_rotation_energy(t.rotation, u)) < 1e-12 * tm_tissue_energy(t.tissue, u));
        free(u);
        destroy(&t);
    }
}

static void cut_and_snapshot_go_on_to_the_last_bit(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        turning t = block(fibred, 0.49, &(how){.cuttable = true, .damped = true});
        double *u = vectors(&t, 1);
        fix_random random = {17};
        tm_error error;
        tm_state *s = tm_world_state(t.world);
        for (int32_t i = 0; i < t.n; i++) u[i] = 5e-4 * fix_signed(&random);
        turn(&t, 0.8, 0, u, s->u_m);
        memcpy(s->u_prev_m, s->u_m, sizeof(double) * (size_t)t.n);
        assert_int_equal(tm_world_step(t.world, 20), TM_OK);
        assert_true(tm_cut_remove(t.tissue, (int32_t[]){3, 17, 18, 40}, 4, NULL, 0) >= 4);
        assert_int_equal(tm_world_step(t.world, 1), TM_OK);
        turning again = block(
            fibred, 0.49,
            &(how){.alive = tm_tissue_alive(t.tissue), .damped = true, .threads = 3, .dt_s = tm_world_step_s(t.world)});
        memcpy(tm_world_state(again.world)->u_m, s->u_m, sizeof(double) * (size_t)t.n);
        memcpy(tm_world_state(again.world)->u_prev_m, s->u_prev_m, sizeof(double) * (size_t)t.n);
        turning third = block(fibred, 0.49, &(how){.cuttable = true, .damped = true});
        const int64_t bytes = tm_snapshot_bytes(t.world);
        void *kept = malloc((size_t)bytes);
        fix_ok(tm_snapshot_save(t.world, kept, bytes, &error), &error);
        fix_ok(tm_snapshot_restore(third.world, kept, bytes, &error), &error);
        for (int k = 0; k < 30; k++) {
            assert_int_equal(tm_world_step(t.world, 3), TM_OK);
            assert_int_equal(tm_world_step(again.world, 3), TM_OK);
            assert_int_equal(tm_world_step(third.world, 3), TM_OK);
            assert_memory_equal(s->u_m, tm_world_state(again.world)->u_m, sizeof(double) * (size_t)t.n);
            assert_true(tm_world_hash(third.world) == tm_world_hash(t.world));
        }
        free(kept);
        free(u);
        destroy(&t), destroy(&again), destroy(&third);
    }
}

static void all_forms_give_the_same_bits(void **state) {
    (void)state;
    turning t = block(false, 0.49, &(how){0});
    double *u = vectors(&t, 3), *f = u + t.n, *g = u + 2 * t.n;
    fix_random random = {11};
    for (double size = 1e-6; size < 0.1; size *= 3) {
        memset(f, 0, sizeof(double) * 2 * (size_t)t.n);
        for (int32_t i = 0; i < t.n; i++) u[i] = size * fix_signed(&random);
        tm_nodal_dilatation_add(&t.rotation->nodal_dilatation, &t.rotation->batches, true, u, f);
        tm_nodal_dilatation_add(&t.rotation->nodal_dilatation, &t.rotation->batches, false, u, g);
        assert_true(fix_largest(f, t.n) > 0);
        assert_memory_equal(f, g, sizeof(double) * (size_t)t.n);
    }
    free(u);
    destroy(&t);
}

/* The stage "viscosity" does not apply the tensors: with zero shares its force is the tensors' plus the corotational
 * correction. */
static void zero_relaxation_gives_the_force_of_both_parts(void **state) {
    (void)state;
    for (int law = 0; law < 4; law++) {
        turning t = block(law % 2, 0.45, &(how){.plain_volume = law > 1, .cuttable = law == 0});
        double *u = vectors(&t, 4), *f = u + t.n, *s = u + 2 * t.n;
        fix_random random = {29};
        tm_error error;
        tm_viscosity_def viscosity = tm_viscosity_def_default();
        viscosity.count = 1, viscosity.term[0].time_s = 1;
        fix_ok(tm_stage_viscosity(t.world, &viscosity, &error), &error);
        for (double size = 1e-6; size < 3e-3; size *= 6) {
            for (int32_t i = 0; i < t.n; i++) s[i] = size * fix_signed(&random);
            turn(&t, size * 500, 0, s, u);
            force_at(&t, u, f, s);
            memcpy(tm_world_state(t.world)->u_m, u, sizeof(double) * (size_t)t.n);
            memcpy(tm_world_state(t.world)->u_prev_m, u, sizeof(double) * (size_t)t.n);
            assert_int_equal(tm_world_step(t.world, 1), TM_OK);
            double worst = 0;
            for (int32_t i = 0; i < t.n; i++) worst = fmax(worst, fabs(f[i] - tm_world_state(t.world)->force_N[i]));
            tm_tissue_force(t.tissue, u, s); /* contributions that cancel in the sum */
            assert_true(worst < 1e-13 * fix_largest(s, t.n));
        }
        free(u);
        destroy(&t);
    }
}

/* Estimates the largest eigenvalue of M^-1 K of the complete tangent by power iteration: the largest of all states. */
static double most_of(const tm_tangent *tangent, const double *mass, int32_t n, double shift, double *x, double *y) {
    double value = 0;
    for (int32_t i = 0; i < n; i++) x[i] = sin(1 + (double)i * i);
    for (int pass = 0; pass < 150; pass++) {
        double norm = 0, top = 0;
        for (int32_t i = 0; i < n; i++) norm += mass[i / 3] * x[i] * x[i];
        for (int32_t i = 0; i < n; i++) x[i] /= sqrt(norm);
        tm_force_pass(tangent->force, &tangent->graph, x, y);
        for (int32_t i = 0; i < n; i++) top -= x[i] * y[i], x[i] = shift * x[i] - y[i] / mass[i / 3];
        value = top;
    }
    return value;
}

static void no_state_needs_a_shorter_step(void **state) {
    (void)state;
    double scaled_step_s = 0;
    for (int law = 0; law < 6; law++) { /* the last two: made heavier for a longer step */
        fix_random random = {23};
        turning t = make(regions((int[]){2, 2, 1}, (double[]){0.02, 0.02, 0.01}, 0.1, &random),
                         law % 4 == 3 || law == 5, (const double[]){0.0, 0.3, 0.49, 0, 0.49, 0}[law],
                         &(how){.cuttable = law % 2,
                                .dt_s = law > 3 ? scaled_step_s : 0,
                                .scaled_step_s = law > 3 ? scaled_step_s : 0});
        double *u = vectors(&t, 3), worst = 0;
        const double step = tm_critical_step_guaranteed(t.tissue, NULL);
        assert_true(law < 4 || step >= scaled_step_s);
        if (law < 4) scaled_step_s = 2 * step;
        tm_pool pool = {0};
        tm_tangent tangent;
        assert_true(tm_tangent_init(&tangent, &pool, t.rotation));
        for (int round = 0; round < 36; round++) { /* a stretch and some noise, around the band or far beyond */
            const double size = (const double[]){0.03, 0.2, 0.7}[round % 3];
            double F[9];
            for (int i = 0; i < 9; i++) F[i] = size * fix_signed(&random);
            for (int32_t i = 0; i < t.n; i++) {
                const double *x = t.mesh->rest_m + i / 3 * 3;
                u[i] = F[3 * (i % 3)] * x[0] + F[3 * (i % 3) + 1] * x[1] + F[3 * (i % 3) + 2] * x[2];
                u[i] += 0.003 * size * fix_signed(&random);
            }
            tm_rotation_tangent(t.rotation, u, &tangent);
            const double own = most_of(&tangent, t.tissue->mass_kg, t.n, 4 / (step * step), u + t.n, u + 2 * t.n);
            worst = fmax(worst, own * step * step / 4);
        }
        print_message("  law %d: a step of %.3f of the guaranteed one was asked for\n", law, 1 / sqrt(worst));
        assert_true(worst < 1 && worst > 0.15);
        tm_pool_release(&pool);
        free(u);
        destroy(&t);
    }
}

static void the_account_of_energy_closes(void **state) {
    (void)state;
    double residual[2];
    for (int half = 0; half < 2; half++) { /* undamped, twisted by 40 degrees and let go */
        fix_random random = {7};
        tm_mesh *mesh = regions((int[]){2, 2, 5}, (double[]){0.02, 0.02, 0.05}, 0.1, &random);
        turning t = make(mesh, false, 0.45, &(how){0});
        tm_error error;
        tm_energy e;
        tm_world_destroy(t.world);
        tm_world_def def = tm_world_def_default();
        def.tissue = t.tissue, def.damped = false;
        def.dt_s = 0.9 * tm_critical_step_guaranteed(t.tissue, NULL) / (half + 1);
        fix_ok(tm_world_create(&def, &t.world, &error), &error);
        fix_ok(tm_stage_rotation(t.world, &t.rotation, &error), &error);
        fix_ok(tm_stage_energy(t.world, &error), &error);
        tm_state *s = tm_world_state(t.world);
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            const double *x = mesh->rest_m + 3 * v, a = 0.7 * x[2] / 0.05, p = x[0] - 0.01, q = x[1] - 0.01;
            s->u_m[3 * v] = s->u_prev_m[3 * v] = p * (cos(a) - 1) - q * sin(a);
            s->u_m[3 * v + 1] = s->u_prev_m[3 * v + 1] = p * sin(a) + q * (cos(a) - 1);
        }
        const double stored = energy_at(&t, s->u_m);
        residual[half] = 0;
        for (int k = 0; k < 1000; k++) {
            assert_int_equal(tm_world_step(t.world, half + 1), TM_OK);
            fix_ok(tm_world_energy(t.world, &e, &error), &error);
            residual[half] = fmax(residual[half], fabs(e.residual_J) / stored);
        }
        assert_true(fabs(e.load_J) < 1e-9 * stored);
        assert_true(fabs(e.kinetic_J + e.elastic_J - e.start_J) < 0.05 * stored);
        destroy(&t);
    }
    assert_true(residual[0] < 0.05 && residual[1] < 0.35 * residual[0]);
}

/* Every vertex is moved anywhere in a box of half the size; damped, the tissue recovers. */
static void inverted_tissue_recovers(void **state) {
    (void)state;
    for (int fibred = 0; fibred < 2; fibred++) {
        fix_random random = {29};
        turning t = make(regions((int[]){3, 3, 3}, (double[]){0.03, 0.03, 0.03}, 0.1, &random), fibred, 0.49,
                         &(how){.damped = true, .best = true});
        tm_state *s = tm_world_state(t.world);
        for (int32_t i = 0; i < t.n; i++) s->u_m[i] = s->u_prev_m[i] = 0.015 * fix_uniform(&random) - t.mesh->rest_m[i];
        const double crushed = energy_at(&t, s->u_m);
        assert_int_equal(tm_world_step(t.world, (int32_t)(2.5 / tm_world_step_s(t.world))), TM_OK);
        print_message("  left %.2g of %.3g J\n", energy_at(&t, s->u_m) / crushed, crushed);
        assert_true(energy_at(&t, s->u_m) < 1e-6 * crushed);
        destroy(&t);
    }
}

/* --- equilibrium --- */

static void clamp(turning *t) {
    int32_t *dof = malloc(sizeof(int32_t) * (size_t)t->n), count = 0;
    tm_error error;
    for (int32_t i = 0; i < t->n; i++)
        if (t->mesh->rest_m[i / 3 * 3 + 2] == 0) dof[count++] = i;
    double *value = calloc((size_t)count, sizeof *value);
    tm_support_def def = tm_support_def_default();
    def.count = count, def.dof = dof, def.value_m = value;
    fix_ok(tm_stage_support(t->world, &def, &error), &error);
    free(dof);
    free(value);
}

static void settle(turning *t) {
    tm_settle_def def = tm_settle_def_default();
    tm_settle_result result;
    tm_error error;
    def.tolerance = 1e-9;
    fix_ok(tm_world_settle(t->world, &def, &result, &error), &error);
    assert_true(result.residual <= 1e-9);
}

/* Relaxed tissue is at equilibrium as tissue with the remaining moduli, and stays there. */
static void relaxed_tissue_rests_by_the_remaining_moduli(void **state) {
    (void)state;
    turning t[2];
    double *u = NULL;
    for (int left = 0; left < 2; left++) {
        fix_random random = {3};
        t[left] = make(regions((int[]){2, 2, 4}, (double[]){0.02, 0.02, 0.04}, 0.1, &random), false, 0.45,
                       &(how){.damped = true, .linear = left});
        tm_error error;
        if (left) { /* built with other constants: G and kappa by shares */
            tm_world_destroy(t[1].world);
            tm_tissue_destroy(t[1].tissue);
            for (int i = 0; i < 2; i++) {
                tm_material *m = t[1].material + i;
                const double bulk = m->lambda_Pa + 2.0 / 3 * m->mu_Pa;
                m->mu_Pa *= 0.5, m->lambda_Pa = 0.8 * bulk - 2.0 / 3 * m->mu_Pa;
            }
            t[1].tissue = make_tissue(t + 1, &(how){0});
            t[1].world = fix_world(t[1].tissue, true);
            fix_ok(tm_stage_rotation(t[1].world, &t[1].rotation, &error), &error);
        } else {
            tm_viscosity_def viscosity = tm_viscosity_def_default();
            viscosity.count = 2;
            viscosity.term[0] = (tm_viscosity_term){0.05, 0.3, 0.2},
            viscosity.term[1] = (tm_viscosity_term){0.5, 0.2, 0};
            fix_ok(tm_stage_viscosity(t[0].world, &viscosity, &error), &error);
        }
        fix_ok(tm_stage_gravity(t[left].world, (const double[]){8, 0, 3}, &error), &error); /* it bends far */
        clamp(t + left);
        settle(t + left);
    }
    u = tm_world_state(t[0].world)->u_m;
    const double *other = tm_world_state(t[1].world)->u_m, largest = fix_largest(u, t[0].n);
    assert_true(largest > 0.005);
    for (int32_t i = 0; i < t[0].n; i++) assert_true(fabs(u[i] - other[i]) < 1e-7 * largest);
    assert_int_equal(tm_world_step(t[0].world, 2000), TM_OK);
    double worst = 0;
    for (int32_t i = 0; i < t[0].n; i++) worst = fmax(worst, fabs(u[i] - other[i]));
    print_message("  moved on by %.2g of %.3g m\n", worst, largest);
    assert_true(worst < 1e-9 * largest);
    destroy(t), destroy(t + 1);
}

/* Euler's elastica under a dead load at its tip, alpha = P L^2 / EI: tip over L, across and back, and its angle.
 * Found by shooting with small steps. */
static void elastica(double alpha, double tip[3]) {
    double low = 0, high = M_PI / 2;
    for (int k = 0; k < 60; k++) { /* the tip angle with zero curvature at the tip */
        const double end = 0.5 * (low + high), h = 1.0 / 4000;
        double angle = 0, bend = sqrt(2 * alpha * sin(end)), x = 0, y = 0;
        for (int i = 0; i < 4000; i++) {
            const double mid = angle + 0.5 * h * bend, mid_bend = bend - 0.5 * h * alpha * cos(angle);
            x += h * cos(mid), y += h * sin(mid);
            angle += h * mid_bend, bend -= h * alpha * cos(mid);
        }
        tip[0] = y, tip[1] = 1 - x, tip[2] = angle;
        *(bend > 0 ? &high : &low) = end;
    }
}

static void cantilever(int cells, double load_N, bool volume, double tip_m[3]) {
    const double size[3] = {0.01, 0.01, 0.1};
    fix_random random = {1};
    turning t = make(fix_block((int[]){cells, cells, 10 * cells}, size, 0, &random), false, 0.49,
                     &(how){.plain_volume = !volume});
    double *load = vectors(&t, 1), share = 0;
    tm_error error;
    clamp(&t);
    for (int i = 0; i < 3; i++) tip_m[i] = 0;
    for (int32_t v = 0; v < t.mesh->vertex_count; v++) share += t.mesh->rest_m[3 * v + 2] > 0.999 * size[2];
    for (int32_t v = 0; v < t.mesh->vertex_count; v++)
        if (t.mesh->rest_m[3 * v + 2] > 0.999 * size[2]) load[3 * v] = load_N / share;
    fix_ok(tm_stage_load(t.world, load, &error), &error);
    settle(&t);
    for (int32_t i = 0; i < t.n; i++)
        if (t.mesh->rest_m[i / 3 * 3 + 2] > 0.999 * size[2]) tip_m[i % 3] += tm_world_state(t.world)->u_m[i] / share;
    free(load);
    destroy(&t);
}

/* Past 60 degrees at nu 0.49. As for `rotation` alone (test_rotation.c), the mesh is too stiff by its error under a
 * thousandth of the load. With that stiffness the beam follows Euler's elastica; a refined mesh does so without the
 * correction. */
static void a_nearly_incompressible_beam_follows_the_elastica(void **state) {
    (void)state;
    const double length = 0.1, alpha = 5, load = alpha * 5e3 * 1e-8 / 12 / (length * length);
    double off[2], small[3], tip[3], truth[3], own[3];
    elastica(alpha, truth);
    for (int fine = 0; fine < 2; fine++) {
        cantilever(fine ? 3 : 2, 1e-3 * load, true, small);
        cantilever(fine ? 3 : 2, load, true, tip);
        const double softness = small[0] / (1e-3 * alpha / 3 * length);
        elastica(alpha * softness, own);
        off[fine] = hypot(tip[0] / length - truth[0], -tip[2] / length - truth[1]);
        print_message("  softness %.3f, tip %.4f %.4f, elastica of that %.4f %.4f at %.0f degrees\n", softness,
                      tip[0] / length, -tip[2] / length, own[0], own[1], own[2] * 180 / M_PI);
        assert_true(fabs(tip[0] / length - own[0]) < 0.02 && fabs(-tip[2] / length - own[1]) < 0.02);
    }
    cantilever(2, 1e-3 * load, false, small);
    print_message("  without volume, coarse: softness %.3f\n", small[0] / (1e-3 * alpha / 3 * length));
    assert_true(truth[2] > 65 * M_PI / 180 && off[1] < 0.65 * off[0]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(force_and_tangent_are_derivatives),
                                       cmocka_unit_test(a_rigid_motion_gives_no_force),
                                       cmocka_unit_test(small_strains_and_stretches_equal_strain_smoothing),
                                       cmocka_unit_test(cut_and_snapshot_go_on_to_the_last_bit),
                                       cmocka_unit_test(all_forms_give_the_same_bits),
                                       cmocka_unit_test(zero_relaxation_gives_the_force_of_both_parts),
                                       cmocka_unit_test(no_state_needs_a_shorter_step),
                                       cmocka_unit_test(the_account_of_energy_closes),
                                       cmocka_unit_test(inverted_tissue_recovers),
                                       cmocka_unit_test(relaxed_tissue_rests_by_the_remaining_moduli),
                                       cmocka_unit_test(a_nearly_incompressible_beam_follows_the_elastica)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
