/* Corotated tissue in single precision (material/corotated_single.c): the distance from double and the same bits in
 * every form, the threshold, closed loops, rest, threads, cutting, snapshots, and what excludes it. */
#include "turning.h"

#include "law_body.h"
#include "material/single_batches.h"
#include "tensormass/cut.h"
#include "tensormass/viscosity.h"
#include "world/world_internal.h"

static tm_material material(bool fibred, double damping_1_s) {
    tm_material m;
    tm_error error;
    if (fibred)
        fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error), &error);
    else
        fix_ok(tm_material_young(YOUNG_PA, 0.45, &m, &error), &error);
    m.damping_1_s = damping_1_s;
    return m;
}

/* A block of 5 mm cells; `rotation` is null, or gets the stage. */
static body block(bool fibred, const int cells[3], double threshold, tm_precision precision, int32_t threads,
                  double damping_1_s) {
    fix_random random = {7};
    const tm_material m = material(fibred, damping_1_s);
    tm_tissue_def def = tm_tissue_def_default();
    tm_error error;
    def.material_count = 1, def.material = &m, def.cuttable = true, def.precision = precision, def.rotation = threshold;
    body b = make(fix_block(cells, (double[]){0.005 * cells[0], 0.005 * cells[1], 0.005 * cells[2]}, 0.2, &random), def,
                  threads, damping_1_s > 0);
    fix_ok(tm_stage_rotation(b.world, NULL, &error), &error);
    return b;
}

static const tm_rotation *rotation_of(const body *b) { return b->world->nonlinear->self; /* the stage's self */ }

/* Twists the block by `turn` radians a metre about z, and moves each vertex by up to `noise_m`. */
static void twist(const body *b, double turn, double noise_m, fix_random *random, double *u) {
    for (int32_t v = 0; v < b->mesh->vertex_count; v++) {
        const double *x = b->mesh->rest_m + 3 * v, a = turn * x[2], c = cos(a), s = sin(a);
        u[3 * v] = c * x[0] - s * x[1] - x[0], u[3 * v + 1] = s * x[0] + c * x[1] - x[1], u[3 * v + 2] = 0;
        for (int i = 0; i < 3; i++) u[3 * v + i] += noise_m * fix_signed(random);
    }
}

typedef struct both {
    double *u, *force[2], *energy[2]; /* in double, and in single */
    int32_t *every, count;
} both;

static both both_of(const body *b) {
    const tm_rotation *r = rotation_of(b);
    both t = {.u = calloc((size_t)b->n, 8), .count = r->batches.count, .every = r->every};
    for (int k = 0; k < 2; k++) t.force[k] = calloc((size_t)b->n, 8), t.energy[k] = calloc((size_t)r->batches.count, 8);
    return t;
}

static void free_both(both *t) {
    free(t->u);
    for (int k = 0; k < 2; k++) free(t->force[k]), free(t->energy[k]);
}

static void pass(const body *b, both *t, tm_rotation_kernel kernel, int k) {
    memset(t->force[k], 0, sizeof(double) * (size_t)b->n);
    kernel(&rotation_of(b)->batches, t->every, t->count, t->u, t->force[k], t->energy[k]);
}

static double difference(const double *a, const double *b, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++) most = fmax(most, fabs(a[i] - b[i]));
    return most;
}

/* Forces relative to the largest one of the tensors, energies to the largest correction: at the smallest threshold and
 * the default, in the band, rotated and inside out. In the band the energy is of third order, and terms of second order
 * are rounded. */
static void is_near_double(void **state) {
    (void)state;
    static const double noise_m[] = {1e-6, 1e-5, 1e-4, 1e-3, 6e-3};
    double worst_N = 0, worst_J = 0;
    for (int k = 0; k < 4; k++) {
        body b =
            block(k % 2, (int[]){3, 3, 2}, k < 2 ? TM_ROTATION_THRESHOLD_MIN : TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
        fix_random random = {3};
        assert_true(tm_cut_remove(b.tissue, (int32_t[]){5, 31}, 2, NULL, 0) >= 2);
        both t = both_of(&b);
        double *linear = calloc((size_t)b.n, 8);
        for (int i = 0; i < 10; i++) {
            twist(&b, i % 2 ? 100 : 0, noise_m[i / 2], &random, t.u);
            if (i % 2 == 0)
                for (int32_t d = 0; d < b.n; d++) t.u[d] = noise_m[i / 2] * fix_signed(&random);
            pass(&b, &t, tm_rotation_choose(false), 0);
            if (!(fix_largest(t.force[0], b.n) > 0)) continue;
            for (int form = 1; form >= 0; form--) {
                const tm_rotation_kernel kernel = tm_single_rotation_form(form);
                if (!kernel) continue;
                pass(&b, &t, kernel, 1);
                tm_tissue_force(b.tissue, t.u, linear);
                worst_N = fmax(worst_N, difference(t.force[0], t.force[1], b.n) / fix_largest(linear, b.n));
                worst_J =
                    fmax(worst_J, difference(t.energy[0], t.energy[1], t.count) /
                                      (fix_largest(t.energy[0], t.count) + 1e-6 * tm_tissue_energy(b.tissue, t.u)));
            }
        }
        free(linear);
        free_both(&t);
        destroy(&b);
    }
    print_message("single from double: forces %.1e of the largest, energies %.1e\n", worst_N, worst_J);
    assert_true(worst_N < 1e-5 && worst_N > 1e-8 && worst_J < 1e-2);
}

static void all_forms_have_the_same_bits(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        body b = block(k, (int[]){3, 3, 3}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
        fix_random random = {11};
        both t = both_of(&b);
        for (double noise_m = 1e-5; noise_m < 0.02; noise_m *= 3) {
            twist(&b, 50, noise_m, &random, t.u);
            pass(&b, &t, tm_single_rotation_form(0), 0);
            pass(&b, &t, tm_single_rotation_choose(false), 1);
            assert_memory_equal(t.force[0], t.force[1], sizeof(double) * (size_t)b.n);
            assert_memory_equal(t.energy[0], t.energy[1], sizeof(double) * (size_t)t.count);
            /* One batch at a time, with the corner forces that threads store. */
            memset(t.force[1], 0, sizeof(double) * (size_t)b.n);
            for (int32_t p = 0; p < t.count; p++) {
                double corner_N[12 * TM_LANES], energy_J;
                uint8_t who;
                tm_single_corner_force_choose(false)(&rotation_of(&b)->batches, &p, 1, t.u, corner_N, &who, &energy_J);
                assert_true(energy_J == t.energy[0][p]);
                for (int l = 0; l < TM_LANES; l++)
                    for (int i = 0; who >> l & 1 && i < 12; i++)
                        t.force[1][rotation_of(&b)->batches.batch[p].component[i / 3][l] + i % 3] -=
                            corner_N[TM_LANES * i + l];
            }
            assert_memory_equal(t.force[0], t.force[1], sizeof(double) * (size_t)b.n);
        }
        free_both(&t);
        destroy(&b);
    }
}

/* Through the band, and through inversion: increments of the force are those of double, to its rounding. */
static void the_force_has_no_jump(void **state) {
    (void)state;
    for (int inverts = 0; inverts < 2; inverts++) {
        body b = block(false, (int[]){2, 2, 2}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
        both t = both_of(&b);
        double *before[2] = {calloc((size_t)b.n, 8), calloc((size_t)b.n, 8)}, *linear = calloc((size_t)b.n, 8);
        double off = 0, most = 0;
        for (int k = 0; k <= 1000; k++) {
            fix_random random = {5};
            twist(&b, inverts ? 0 : 0.01 * k, 1e-4, &random, t.u);
            for (int32_t v = 0; inverts && v < b.mesh->vertex_count; v++)
                t.u[3 * v + 2] -= 0.002 * k * b.mesh->rest_m[3 * v + 2]; /* to its mirror image */
            pass(&b, &t, tm_rotation_choose(false), 0);
            pass(&b, &t, tm_single_rotation_choose(false), 1);
            tm_tissue_force(b.tissue, t.u, linear);
            most = fmax(most, fix_largest(linear, b.n));
            for (int32_t d = 0; k > 0 && d < b.n; d++)
                off = fmax(off, fabs((t.force[1][d] - before[1][d]) - (t.force[0][d] - before[0][d])));
            for (int f = 0; f < 2; f++) memcpy(before[f], t.force[f], sizeof(double) * (size_t)b.n);
        }
        print_message("%s: increments off by %.1e of the tensors' largest force\n", inverts ? "inversion" : "band",
                      off / most);
        assert_true(off < 1e-5 * most && off > 0);
        for (int f = 0; f < 2; f++) free(before[f]);
        free(linear);
        free_both(&t);
        destroy(&b);
    }
}

/* The complete force in single does no work over a closed loop, inside out and back: as in test_loops.c, by less. */
static void loops_return_their_energy(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        body b = block(k, (int[]){1, 1, 1}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
        both t = both_of(&b);
        fix_random random = {9};
        double *wave = calloc((size_t)b.n * 4, 8), worst = 0;
        for (double size_m = 1e-4; size_m < 0.02; size_m *= 3) {
            double net = 0, sizes = 0;
            const int points = 4000;
            for (int32_t i = 0; i < 4 * b.n; i++) wave[i] = size_m * fix_signed(&random);
            for (int p = 0; p < points; p++) {
                const double a = 2 * M_PI * p / points;
                double power = 0;
                for (int32_t i = 0; i < b.n; i++)
                    t.u[i] = cos(a) * wave[i] + sin(a) * wave[b.n + i] + cos(2 * a) * wave[2 * b.n + i];
                pass(&b, &t, tm_single_rotation_choose(false), 1);
                tm_tissue_force(b.tissue, t.u, t.force[0]);
                for (int32_t i = 0; i < b.n; i++)
                    power += (t.force[0][i] + t.force[1][i]) *
                             (cos(a) * wave[b.n + i] - sin(a) * wave[i] - 2 * sin(2 * a) * wave[2 * b.n + i]);
                net += power, sizes += fabs(power);
            }
            worst = fmax(worst, fabs(net) / sizes);
        }
        print_message("a loop leaves %.1e of its work\n", worst);
        assert_true(worst < 1e-6);
        free(wave);
        free_both(&t);
        destroy(&b);
    }
}

static void start_twisted(const body *b, double turn, double noise_m) {
    fix_random random = {31};
    tm_state *s = tm_world_state(b->world);
    twist(b, turn, noise_m, &random, s->u_m);
    memcpy(s->u_prev_m, s->u_m, sizeof(double) * (size_t)b->n);
}

static void threads_have_the_same_bits(void **state) {
    (void)state;
    body b[2];
    for (int k = 0; k < 2; k++) {
        b[k] = block(false, (int[]){10, 9, 9}, TM_ROTATION_THRESHOLD, TM_SINGLE, k + 1, 0);
        start_twisted(b + k, 20, 1e-4);
        assert_int_equal(tm_world_step(b[k].world, 60), TM_OK);
        assert_true(tm_world_hash(b[k].world) == tm_world_hash(b[0].world));
    }
    assert_true(rotation_of(b + 1)->divided);
    for (int k = 0; k < 2; k++) destroy(b + k);
}

/* Batches are skipped, and a cut tissue and a restored world have seen others: no bit depends on it. */
static void cuts_and_snapshots_keep_the_bits(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        body a = block(k, (int[]){2, 2, 40}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0),
             b = block(k, (int[]){2, 2, 40}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
        tm_error error;
        bool mixed = false;
        start_twisted(&a, 5, 1e-6);
        for (int32_t d = 0; d < a.n; d++) /* the lower half is at rest: waves reach its end later */
            if (a.mesh->rest_m[d / 3 * 3 + 2] < 0.1)
                tm_world_state(a.world)->u_prev_m[d] = tm_world_state(a.world)->u_m[d] = 0;
        assert_int_equal(tm_world_step(a.world, 10), TM_OK);
        assert_true(tm_cut_remove(a.tissue, (int32_t[]){3, 600, 700}, 3, NULL, 0) >= 3);
        assert_int_equal(tm_world_step(a.world, 10), TM_OK);
        assert_int_equal(tm_world_step(b.world, 7), TM_OK);
        const int64_t bytes = tm_snapshot_bytes(a.world);
        void *kept = malloc((size_t)bytes);
        fix_ok(tm_snapshot_save(a.world, kept, bytes, &error), &error);
        fix_ok(tm_snapshot_restore(b.world, kept, bytes, &error), &error);
        for (int i = 0; i < 40; i++) {
            assert_int_equal(tm_world_step(a.world, 2), TM_OK);
            assert_int_equal(tm_world_step(b.world, 2), TM_OK);
            assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
            const tm_rotation_report report = tm_rotation_last(rotation_of(&a));
            mixed |= report.active > 0 && report.checked < report.batches;
        }
        assert_true(mixed);
        free(kept);
        destroy(&a);
        destroy(&b);
    }
}

static void hold_ends(body *b, double length_m) {
    for (int32_t d = 0; d < b->n; d++) {
        const double *x = b->mesh->rest_m + d / 3 * 3, a = 1.6, c = cos(a), s = sin(a);
        const double end[3] = {c * x[0] - s * x[1] - x[0], s * x[0] + c * x[1] - x[1], -0.004};
        if (is_at(b, d / 3 * 3 + 2, 0) || is_at(b, d / 3 * 3 + 2, length_m)) hold(b, d, x[2] > 0 ? end[d % 3] : 0);
    }
}

/* Twisted by 92 degrees and pressed. Rest is that of double to the tensors' rounding, the step is at rest there, and
 * stays: energies that are rounding alone are not restored. */
static void rests_where_double_does(void **state) {
    (void)state;
    double *u[2];
    for (int k = 0; k < 2; k++) {
        body b = block(false, (int[]){4, 4, 10}, TM_ROTATION_THRESHOLD, k ? TM_SINGLE : TM_DOUBLE, 1, 20);
        tm_settle_def def = tm_settle_def_default();
        tm_error error;
        tm_state *s = tm_world_state(b.world);
        const size_t bytes = sizeof(double) * (size_t)b.n;
        hold_ends(&b, 0.05);
        support(&b);
        def.tolerance = 1e-9;
        fix_ok(tm_world_settle(b.world, &def, NULL, &error), &error);
        u[k] = malloc(bytes);
        memcpy(u[k], s->u_m, bytes);
        fix_ok(tm_world_step(b.world, 1), &error);
        double worst = 0;
        bool *held = calloc((size_t)b.n, sizeof *held);
        for (int32_t i = 0; i < b.held; i++) held[b.dof[i]] = true;
        for (int32_t d = 0; d < b.n; d++) worst = fmax(worst, held[d] ? 0 : fabs(s->force_N[d]));
        worst /= fix_largest(s->force_N, b.n);
        if (k) {
            fix_ok(tm_world_step(b.world, 3000), &error);
            const double size_m = fix_largest(u[0], b.n), off = difference(u[0], u[1], b.n) / size_m,
                         later = difference(u[0], s->u_m, b.n) / size_m;
            double speed_m_s = 0;
            for (int32_t d = 0; d < b.n; d++) speed_m_s = fmax(speed_m_s, fabs(s->u_m[d] - s->u_prev_m[d]) / s->dt_s);
            print_message("rest: force %.1e, place %.1e from double, after 3000 steps %.1e and %.1e m/s\n", worst, off,
                          later, speed_m_s);
            assert_true(worst < 5e-5 && off < 2e-6 && later < 5e-6 && speed_m_s < 3e-5);
        }
        free(held);
        destroy(&b);
    }
    for (int k = 0; k < 2; k++) free(u[k]);
}

static void what_relaxes_is_refused(void **state) {
    (void)state;
    body b = block(false, (int[]){2, 2, 2}, TM_ROTATION_THRESHOLD, TM_SINGLE, 1, 0);
    tm_viscosity_def def = tm_viscosity_def_default();
    tm_error error;
    def.count = 1, def.term[0] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.2};
    assert_int_equal(tm_stage_viscosity(b.world, &def, &error), TM_ERR_EXCLUDED);
    assert_non_null(strstr(error.message, "TM_DOUBLE"));
    destroy(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(is_near_double),
                                       cmocka_unit_test(all_forms_have_the_same_bits),
                                       cmocka_unit_test(the_force_has_no_jump),
                                       cmocka_unit_test(loops_return_their_energy),
                                       cmocka_unit_test(threads_have_the_same_bits),
                                       cmocka_unit_test(cuts_and_snapshots_keep_the_bits),
                                       cmocka_unit_test(rests_where_double_does),
                                       cmocka_unit_test(what_relaxes_is_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
