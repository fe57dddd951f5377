/* Exact compliance during a simulation: equals the static solver's before, during and after a cut. */
#include "kit.h"

#include <pthread.h>
#include <time.h>

#include "tensormass/cut.h"

typedef struct bench {
    tm_mesh *mesh;
    tm_tissue *tissue;
    uint8_t *fixed;
    tm_compliance_factor *factored;
    tm_compliance_source source;
    int32_t want[TM_COMPLIANCE_REQUEST_MAX], count;
} bench;

static void set_up_as(bench *b, const int cells[3], bool volume, bool turns) {
    fix_random random = {7};
    const double size[3] = {0.05, 0.04, 0.03}, a[3] = {1, 2, 2};
    tm_material material;
    tm_error error;
    fix_ok(tm_material_five(3000, 2000, 4000, 3000, 900, &material, &error), &error);
    b->mesh = fix_block(cells, size, 0.2, &random);
    double *fibre = fix_fibres(b->mesh, a);
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = b->mesh, tissue.material_count = 1, tissue.material = &material, tissue.fibre = fibre,
    tissue.form = TM_FORCE_PLAIN, tissue.cuttable = true, tissue.strain_smoothing = volume;
    if (turns) tissue.rotation = TM_ROTATION_THRESHOLD, tissue.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&tissue, &b->tissue, &error), &error);
    free(fibre);
    b->fixed = kit_clamp(b->mesh, 1e-9);
    tm_compliance_factor_def def = tm_compliance_factor_def_default();
    def.tissue = b->tissue;
    def.fixed = b->fixed;
    def.corotated = turns;
    fix_ok(tm_compliance_factor_create(&def, &b->factored, &error), &error);
    b->source = tm_compliance_factor_source(b->factored);
}

static void set_up(bench *b, const int cells[3]) { set_up_as(b, cells, false, false); }

static void tear_down(bench *b) {
    tm_compliance_factor_destroy(b->factored);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->fixed);
}

/* Lists active surface vertices around one that moves on with `k`. */
static void choose(bench *b, int k) {
    const tm_surface_view surface = tm_tissue_surface(b->tissue);
    const double *rest = b->mesh->rest_m, *centre = rest + 3 * (int64_t)surface.triangle[3 * (k * 37 % surface.count)];
    b->count = 0;
    for (double radius = 0.004; b->count < 24 && radius < 0.1; radius += 0.002) {
        b->count = 0;
        for (int32_t i = 0; i < 3 * surface.count && b->count < 40; i++) {
            const int32_t v = surface.triangle[i];
            double d2 = 0;
            bool known = false;
            for (int c = 0; c < 3; c++) d2 += (rest[3 * v + c] - centre[c]) * (rest[3 * v + c] - centre[c]);
            for (int32_t j = 0; j < b->count; j++) known = known || b->want[j] == v;
            if (!known && d2 < radius * radius) b->want[b->count++] = v;
        }
    }
}

static const tm_compliance *ask_for(const bench *b, int32_t owner, const int32_t *vertex, int32_t count) {
    const tm_compliance_request request = {.count = count, .needed = count, .vertex = vertex};
    return b->source.exchange(b->source.self, owner, &request);
}

static const tm_compliance *ask(const bench *b) { return ask_for(b, 0, b->want, b->count); }

static int32_t place(const tm_compliance *c, int32_t vertex) {
    for (int32_t i = 0; i < c->count; i++)
        if (c->vertex[i] == vertex) return i;
    return -1;
}

/* Compares columns of some requested vertices with static solutions of the present tissue; returns the largest
 * relative difference. */
static double off_by(const bench *b, const tm_compliance *c) {
    const int32_t n = 3 * b->mesh->vertex_count;
    double *load = calloc((size_t)n, 8), *u = malloc(8 * (size_t)n), worst = 0;
    tm_error error;
    for (int32_t k = 0; k < b->count; k += 7) {
        const int32_t dof = 3 * b->want[k] + k % 3, column = place(c, b->want[k]);
        double most = 0, off = 0;
        assert_true(column >= 0);
        load[dof] = 1;
        tm_solve_def def = kit_problem(b->tissue, b->fixed);
        def.load_N = load;
        tm_solve_report report;
        fix_ok(tm_solve_static(&def, u, NULL, &report, &error), &error);
        load[dof] = 0;
        for (int32_t i = 0; i < 3 * c->count; i++) {
            const double is = c->C_m_N[(int64_t)i * 3 * c->count + 3 * column + k % 3],
                         should = u[3 * c->vertex[i / 3] + i % 3];
            most = fmax(most, fabs(should));
            off = fmax(off, fabs(is - should));
        }
        if (most > 0) worst = fmax(worst, off / most);
    }
    free(load), free(u);
    return worst;
}

/* Calls until the newest result has all requested columns of this very tissue; returns the number of calls. */
static const tm_compliance *until_ready(bench *b, int *calls) {
    const int32_t revision = tm_tissue_surface(b->tissue).revision;
    for (*calls = 1; *calls < 50; ++*calls) {
        const tm_compliance *c = ask(b);
        bool all = c && c->revision == revision;
        for (int32_t i = 0; all && i < b->count; i++) all = place(c, b->want[i]) >= 0;
        if (all) return c;
    }
    fail_msg("nothing after 50 calls");
    return NULL;
}

/* Makes a hole deeper and wider from step to step, under and next to the requested vertices; never a detached
 * fragment. */
static void cut_more(bench *b, fix_random *random, int32_t tets) {
    for (int tries = 0; tets > 0 && tries < 1000; tries++) {
        const int32_t t = (int32_t)(fix_uniform(random) * b->mesh->tet_count);
        double x = 0;
        for (int i = 0; i < 4; i++) x += 0.25 * b->mesh->rest_m[3 * b->mesh->tet[4 * t + i]];
        if (!tm_tissue_alive(b->tissue)[t] || x < 0.02) continue;
        tets -= tm_cut_remove(b->tissue, &t, 1, NULL, 0);
    }
}

/* Checks that all active tissue has supports: the static solver accepts it. */
static bool whole(const bench *b) {
    double *u = malloc(24 * (size_t)b->mesh->vertex_count);
    tm_solve_def def = kit_problem(b->tissue, b->fixed);
    tm_solve_report report;
    const tm_status status = tm_solve_static(&def, u, NULL, &report, NULL);
    free(u);
    return status == TM_OK;
}

/* A few cuts at a time up to the `renewed`-th state, then so many that the factor is renewed. */
static void exact_as(bool volume, int states, int renewed, int32_t few) {
    bench b;
    fix_random random = {11};
    int calls;
    set_up_as(&b, test_is_sanitized() ? (int[3]){7, 6, 5} : (int[3]){10, 8, 6}, volume, false);
    double worst = 0;
    int32_t compared = 0;
    for (int k = 0; k < states; k++) {
        if (k > 0) cut_more(&b, &random, k < renewed ? few : 12);
        if (!whole(&b)) break;
        choose(&b, k);
        const double off = off_by(&b, until_ready(&b, &calls));
        worst = fmax(worst, off);
        compared++;
        assert_true(off < 1e-6);
        assert_true(calls <= 3);
    }
    print_message("  %d states, %d tetrahedra left, worst difference %.1e\n", compared, tm_tissue_alive_count(b.tissue),
                  worst);
    assert_true(compared > states / 2);
    tear_down(&b);
}

static void compliance_is_exact_before_and_after_cuts(void **state) {
    (void)state;
    exact_as(false, test_is_sanitized() ? 8 : 24, test_is_sanitized() ? 4 : 12, 3);
}

/* A cut changes the stiffness of every domain that was averaged with it. */
static void compliance_is_exact_with_strain_smoothing(void **state) {
    (void)state;
    exact_as(true, 6, 5, 1);
}

/* Without a thread, the call after a cut returns the compliance of the present tissue. */
static void compliance_is_current_after_a_cut(void **state) {
    (void)state;
    bench b;
    fix_random random = {3};
    int calls;
    set_up(&b, (int[3]){6, 5, 4});
    choose(&b, 1);
    const int32_t before = until_ready(&b, &calls)->revision;
    cut_more(&b, &random, 2);
    const tm_compliance *c = ask(&b);
    assert_int_equal(c->revision, tm_tissue_surface(b.tissue).revision);
    assert_true(c->revision != before);
    assert_true(off_by(&b, c) < 1e-6);
    tear_down(&b);
}

/* Cut completely through: the part on the support stays exact (held only by inertia its values would be
 * meaningless); the part without support is so compliant that it cannot be mistaken for tissue. */
static void detached_part_is_recognisably_compliant(void **state) {
    (void)state;
    bench b;
    int calls;
    set_up(&b, (int[3]){6, 5, 4});
    choose(&b, 0);
    until_ready(&b, &calls);
    for (int32_t t = 0; t < b.mesh->tet_count; t++) {
        double x = 0;
        for (int i = 0; i < 4; i++) x += 0.25 * b.mesh->rest_m[3 * b.mesh->tet[4 * t + i]];
        if (x > 0.025 && x < 0.034) tm_cut_remove(b.tissue, &t, 1, NULL, 0);
    }
    assert_false(whole(&b));
    b.count = 0;
    const tm_surface_view surface = tm_tissue_surface(b.tissue);
    for (int32_t k = 0; k < 40; k++) b.want[b.count++] = surface.triangle[3 * (k * surface.count / 40)];
    const tm_compliance *c = until_ready(&b, &calls);
    int loose = 0, held = 0;
    for (int32_t i = 0; i < c->count; i++) {
        const double x = b.mesh->rest_m[3 * c->vertex[i]], give = c->C_m_N[(int64_t)(3 * i) * (3 * c->count + 1)];
        if (x > 0.035) loose++, assert_true(give > 10);
        if (x > 0.001 && x < 0.024) held++, assert_true(give > 0 && give < 1);
    }
    assert_true(loose > 3 && held > 3);
    tear_down(&b);
}

/* Computes R about x + y by the angle, and u of a body rotated by it. */
static void turn_all(const tm_mesh *mesh, double angle, double R[9], double *u) {
    const double a[3] = {sqrt(0.5), sqrt(0.5), 0}, c = cos(angle), s = sin(angle);
    const double cross[9] = {0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0};
    for (int i = 0; i < 9; i++) R[i] = (i % 4 ? 0 : c) + s * cross[i] + (1 - c) * a[i / 3] * a[i % 3];
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        const double *x = mesh->rest_m + i / 3 * 3, *row = R + 3 * (i % 3);
        u[i] = row[0] * x[0] + row[1] * x[1] + row[2] * x[2] - x[i % 3];
    }
}

/* Returns the largest relative difference of `c` from R C R^T, R of the angle, over the first blocks. */
static double off_turned(const tm_compliance *c, const double *C, const double R[9]) {
    const int32_t width = 3 * c->count;
    double off = 0, most = 0;
    for (int32_t i = 0; i < width; i++)
        for (int32_t j = 0; j < width; j++) {
            double is = c->C_m_N[(int64_t)i * width + j], should = 0;
            for (int k = 0; k < 9; k++)
                should += R[3 * (i % 3) + k / 3] * R[3 * (j % 3) + k % 3] *
                          C[(int64_t)(3 * (i / 3) + k / 3) * width + 3 * (j / 3) + k % 3];
            off = fmax(off, fabs(is - should)), most = fmax(most, fabs(should));
        }
    return off / most;
}

/* A rotated body has the rotated compliance, with fibres and strain smoothing too; until the factor is renewed, by
 * the rotation that the caller reports. */
static void compliance_rotates_with_the_tissue(void **state) {
    (void)state;
    for (int volume = 0; volume < 2; volume++) {
        bench b;
        set_up_as(&b, (int[3]){5, 4, 3}, volume, true);
        choose(&b, 0);
        const size_t n = 3 * (size_t)b.mesh->vertex_count;
        double R[9], *u = calloc(n, sizeof *u);
        const tm_compliance_request request = {.count = b.count, .needed = b.count, .vertex = b.want, .u_m = u};
        const tm_compliance *c = b.source.exchange(b.source.self, 0, &request);
        assert_non_null(c);
        double *C = malloc(sizeof *C * 9 * (size_t)c->count * (size_t)c->count), unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        memcpy(C, c->C_m_N, sizeof *C * 9 * (size_t)c->count * (size_t)c->count);
        turn_all(b.mesh, 1.2, R, u);
        c = b.source.exchange(b.source.self, 0, &request);
        assert_true(off_turned(c, C, unit) == 0); /* the factor is the previous one */
        for (int32_t i = 0; i < c->count; i++)
            for (int k = 0; k < 9; k++) assert_true(fabs(c->rotation[9 * i + k] - R[k]) < 1e-9);
        for (int k = 0; k < 20; k++) c = b.source.exchange(b.source.self, 0, &request);
        print_message("  turned by 1.2: %.1e\n", off_turned(c, C, R));
        assert_true(off_turned(c, C, R) < 1e-6);
        for (int32_t i = 0; i < c->count; i++)
            for (int k = 0; k < 9; k++) assert_true(fabs(c->rotation[9 * i + k] - unit[k]) < 1e-9);
        memcpy(C, c->C_m_N, sizeof *C * 9 * (size_t)c->count * (size_t)c->count);
        turn_all(b.mesh, 1.2 + 0.04, R, u); /* by 2.3 degrees, and more than a tenth of an edge: no new factor */
        for (int k = 0; k < 20; k++) c = b.source.exchange(b.source.self, 0, &request);
        assert_true(off_turned(c, C, unit) == 0);
        free(C), free(u);
        tear_down(&b);
    }
}

/* The same calls give the same bits. */
static void same_calls_give_the_same_bits(void **state) {
    (void)state;
    uint64_t hash[2];
    for (int run = 0; run < 2; run++) {
        bench b;
        fix_random random = {5};
        set_up(&b, (int[3]){6, 5, 4});
        hash[run] = TM_HASH_SEED;
        for (int k = 0; k < 8; k++) {
            choose(&b, k / 2);
            const tm_compliance *c = ask_for(&b, k % 2, b.want, b.count);
            if (c) hash[run] = tm_hash(c->C_m_N, sizeof(double) * 9 * (size_t)c->count * (size_t)c->count, hash[run]);
            if (k % 3 == 2) cut_more(&b, &random, 2);
        }
        tear_down(&b);
    }
    assert_true(hash[0] == hash[1] && hash[0] != TM_HASH_SEED);
}

/* With a thread: no call waits for the work, and each result is exact for the revision that it names. */
static void with_a_thread_no_call_waits(void **state) {
    (void)state;
    bench b;
    fix_random random = {13};
    tm_error error;
    const struct timespec frame = {0, 2000000};
    set_up(&b, (int[3]){10, 8, 6});
    fix_ok(tm_compliance_factor_start(b.factored, &error), &error);
    int exact = 0;
    for (int k = 0; k < 6; k++) {
        if (k > 0) cut_more(&b, &random, 4);
        choose(&b, k);
        const int32_t revision = tm_tissue_surface(b.tissue).revision;
        const tm_compliance *c = NULL;
        bool all = false;
        for (int i = 0; i < 5000 && !all; i++) { /* ten seconds: a loaded machine */
            c = ask(&b);
            all = c && c->revision == revision;
            for (int32_t v = 0; all && v < b.count; v++) all = place(c, b.want[v]) >= 0;
            nanosleep(&frame, NULL);
        }
        assert_true(all);
        assert_true(off_by(&b, c) < 1e-6);
        exact++;
    }
    assert_int_equal(exact, 6);
    tear_down(&b);
}

static int broken;
static void on_broken(const char *function, const char *sentence, void *user) {
    (void)function, (void)sentence, (void)user;
    broken++;
}

static void contract_errors_reach_the_handler(void **state) {
    (void)state;
    bench b;
    tm_error error;
    int calls, expected = 0;
    set_up(&b, (int[3]){4, 3, 3});
    choose(&b, 0);
    until_ready(&b, &calls);
    tm_set_contract_handler(on_broken, NULL);
    tm_compliance_factor *other = NULL;
    tm_compliance_factor_def def = {.tissue = b.tissue, .fixed = b.fixed}; /* not filled by its _default function */
    assert_int_equal(tm_compliance_factor_create(&def, &other, &error), TM_ERR_ARGUMENT), expected++;
    def = tm_compliance_factor_def_default(), def.tissue = b.tissue;
    assert_int_equal(tm_compliance_factor_create(&def, &other, &error), TM_ERR_ARGUMENT), expected++;
    assert_null(other);
    assert_int_equal(tm_compliance_factor_start(NULL, &error), TM_ERR_ARGUMENT), expected++;
    assert_int_equal(tm_compliance_factor_bytes(NULL), 0), expected++;
    assert_null(tm_compliance_factor_source(NULL).exchange), expected++;
    const int32_t foreign[2] = {b.want[0], b.mesh->vertex_count};
    const tm_compliance_request good = {.count = b.count, .needed = b.count, .vertex = b.want};
    assert_null(b.source.exchange(NULL, 0, &good)), expected++;
    assert_null(b.source.exchange(b.source.self, 0, NULL)), expected++;
    assert_null(ask_for(&b, -1, b.want, b.count)), expected++;
    assert_null(ask_for(&b, TM_MAX_INSTRUMENTS, b.want, b.count)), expected++;
    assert_null(ask_for(&b, 0, b.want, -1)), expected++;
    assert_null(ask_for(&b, 0, b.want, TM_COMPLIANCE_REQUEST_MAX + 1)), expected++;
    assert_null(ask_for(&b, 0, foreign, 2)), expected++;
    assert_null(ask_for(&b, 0, NULL, 2)), expected++;
    const tm_compliance_request greedy = {.count = b.count, .needed = b.count + 1, .vertex = b.want};
    assert_null(b.source.exchange(b.source.self, 0, &greedy)), expected++;
    assert_int_equal(broken, expected);
    tm_set_contract_handler(NULL, NULL);
    until_ready(&b, &calls); /* rejected input has changed nothing */
    tear_down(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(compliance_is_exact_before_and_after_cuts),
                                       cmocka_unit_test(compliance_is_exact_with_strain_smoothing),
                                       cmocka_unit_test(compliance_is_current_after_a_cut),
                                       cmocka_unit_test(detached_part_is_recognisably_compliant),
                                       cmocka_unit_test(compliance_rotates_with_the_tissue),
                                       cmocka_unit_test(same_calls_give_the_same_bits),
                                       cmocka_unit_test(with_a_thread_no_call_waits),
                                       cmocka_unit_test(contract_errors_reach_the_handler)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
