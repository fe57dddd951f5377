/* Nonlinear laws in single precision: the distance from double at any size of strain, the same bits in every form and
 * for any number of threads, numbers that are not finite, energy, rest, and what excludes it. */
#include "law_body.h"
#include "material/hyperelastic_single.h"
#include "tensormass/cut.h"
#include "tensormass/viscosity.h"
#include "world/world_internal.h"

/* A law, isotropic or with fibres: rows 2 k and 2 k + 1 of nonlinear law k. */
typedef struct row {
    tm_law_kind law;
    bool fibred;
} row;
enum { LAWS = 2 * (TM_LAW_COUNT - 1) };

static row row_at(int k) { return (row){(tm_law_kind)(1 + k / 2), k % 2}; }
static bool is_row(row r) { return law_is_tested(r.law) && (!r.fibred || tm_law_has_fibres(r.law)); }

static tm_material material_in(row r, double poisson) {
    tm_material m = material_of(r.law, poisson, r.fibred);
    m.density_kg_m3 = 1000;
    return m;
}

typedef struct passes {
    tm_pool pool;
    tm_hyperelastic wide;
    tm_single_law narrow;
    double *u, *of_wide;
    float *of_narrow[2];
    int64_t corners;
} passes;

/* Both passes of a tissue; a cut left a hole. */
static passes passes_of(const body *b) {
    passes s = {0};
    const tm_material_field field = tm_tissue_field(b->tissue);
    assert_true(tm_hyperelastic_take(&s.wide, &s.pool, &field));
    assert_true(tm_single_law_init(&s.narrow, &s.pool, &s.wide));
    s.corners = 12 * TM_LANES * (int64_t)s.wide.packs.count;
    s.u = TM_ALLOC(&s.pool, double, b->n);
    s.of_wide = TM_ALLOC(&s.pool, double, s.corners);
    for (int k = 0; k < 2; k++) s.of_narrow[k] = TM_ALLOC(&s.pool, float, s.corners);
    return s;
}

static body block_of(const tm_material *material, const int cells[3], tm_precision precision, int32_t threads) {
    fix_random random = {7};
    tm_tissue_def def = tm_tissue_def_default();
    def.material_count = 1, def.material = material, def.cuttable = true, def.precision = precision;
    return make(fix_block(cells, (double[]){0.003 * cells[0], 0.003 * cells[1], 0.003 * cells[2]}, 0.2, &random), def,
                threads, false);
}

/* Computes corner forces in double, and in every form of single; returns the largest difference relative to the largest
 * force. */
static double compare(passes *s) {
    double most = 0, apart = 0;
    const int32_t beyond = tm_hyper_force_choose(false)(&s->wide, 0, s->wide.packs.count, s->u, s->of_wide);
    int32_t count[2];
    for (int form = 0; form < 2; form++) {
        const tm_single_force pass = tm_single_force_form(form) ? tm_single_force_form(form) : tm_single_force_form(0);
        count[form] = pass(&s->narrow, 0, s->wide.packs.count, s->u, s->of_narrow[form]);
    }
    assert_memory_equal(s->of_narrow[0], s->of_narrow[1], sizeof(float) * (size_t)s->corners);
    assert_true(count[0] == count[1] && abs(count[0] - beyond) <= 1);
    for (int64_t i = 0; i < s->corners; i++) {
        most = fmax(most, fabs(s->of_wide[i]));
        apart = fmax(apart, fabs((double)s->of_narrow[0][i] - s->of_wide[i]));
    }
    return apart / most;
}

/* Of the largest corner force: 2e-6 at strains from 1e-9 to beyond the limit, also far from the origin. Where the bulk
 * modulus is 5,000 times the shear modulus it is that ratio which the rounding of the strain meets. */
static void is_near_double(void **state) {
    (void)state;
    static const double size_m[] = {1e-12, 1e-8, 1e-5, 3e-4, 1e-3, 4e-3};
    double worst = 0, worst_stiff = 0;
    for (int k = 0; k < 2 * LAWS; k++) {
        if (!is_row(row_at(k / 2))) continue;
        const tm_material m = material_in(row_at(k / 2), k % 2 ? 0.4999 : 0.45);
        body b = block_of(&m, (int[]){3, 3, 2}, TM_SINGLE, 1);
        fix_random random = {3};
        assert_true(tm_cut_remove(b.tissue, (int32_t[]){5, 31}, 2, NULL, 0) >= 2);
        passes s = passes_of(&b);
        for (int i = 0; i < 2 * (int)(sizeof size_m / sizeof *size_m); i++) {
            for (int32_t d = 0; d < b.n; d++) s.u[d] = (i % 2) * 0.125 + size_m[i / 2] * fix_signed(&random);
            if (i % 2 && size_m[i / 2] < 1e-6) continue; /* double itself rounds the displacement */
            double *to = k % 2 ? &worst_stiff : &worst;
            *to = fmax(*to, compare(&s));
        }
        tm_pool_release(&s.pool);
        destroy(&b);
    }
    print_message("single from double: %.1e of the largest force, at nu 0.4999 %.1e\n", worst, worst_stiff);
    assert_true(worst < 2e-6 && worst > 1e-8 && worst_stiff < 1e-5);
}

/* A displacement that is no number reaches the forces of its own tetrahedra, and no other bit; a step refuses it. */
static void not_a_number_stays_visible(void **state) {
    (void)state;
    for (int k = 0; k < LAWS; k++) {
        if (!is_row(row_at(k))) continue;
        const tm_material m = material_in(row_at(k), 0.45);
        body b = block_of(&m, (int[]){3, 3, 2}, TM_SINGLE, 1);
        fix_random random = {5};
        passes s = passes_of(&b);
        float *before = TM_ALLOC(&s.pool, float, s.corners);
        const int32_t broken = 7;
        for (int32_t d = 0; d < b.n; d++) s.u[d] = 5e-4 * fix_signed(&random);
        tm_single_force_choose(false)(&s.narrow, 0, s.wide.packs.count, s.u, before);
        s.u[3 * broken + 1] = NAN;
        tm_single_force_choose(false)(&s.narrow, 0, s.wide.packs.count, s.u, s.of_narrow[0]);
        int32_t reached = 0;
        for (int32_t t = 0; t < b.mesh->tet_count; t++) {
            bool has = false, all = true, same = true;
            for (int c = 0; c < 4; c++) has = has || b.mesh->tet[4 * t + c] == broken;
            for (int i = 0; i < 12; i++) {
                const int64_t at = TM_LANES * (12 * (int64_t)(t / TM_LANES) + i) + t % TM_LANES;
                all = all && isnan(s.of_narrow[0][at]), same = same && s.of_narrow[0][at] == before[at];
            }
            assert_true(has ? all : same);
            reached += has;
        }
        assert_true(reached > 3);
        tm_world_state(b.world)->u_m[3 * broken + 1] = NAN;
        assert_int_equal(tm_world_step(b.world, 1), TM_ERR_UNSTABLE);
        tm_pool_release(&s.pool);
        destroy(&b);
    }
}

static void clamp_floor(body *b) {
    for (int32_t d = 0; d < b->n; d++)
        if (is_at(b, d / 3 * 3 + 2, 0)) hold(b, d, 0);
    support(b);
}

/* Pulled along by a tenth and let go. */
static void let_go(body *b) {
    tm_state *s = tm_world_state(b->world);
    for (int32_t d = 0; d < b->n; d++)
        s->u_m[d] = s->u_prev_m[d] = d % 3 == 2 ? 0.1 * b->mesh->rest_m[d] : 0.05 * b->mesh->rest_m[d / 3 * 3 + 2];
}

static void threads_have_the_same_bits(void **state) {
    (void)state;
    const tm_material m = material_in(row_at(0), 0.45);
    body b[3];
    for (int k = 0; k < 3; k++) {
        b[k] = block_of(&m, (int[]){10, 9, 9}, TM_SINGLE, k + 1);
        clamp_floor(b + k);
        let_go(b + k);
        assert_int_equal(tm_world_step(b[k].world, 60), TM_OK);
        assert_memory_equal(tm_world_state(b[k].world)->u_m, tm_world_state(b[0].world)->u_m,
                            sizeof(double) * (size_t)b[0].n);
    }
    assert_true(tm_world_partitions(b[0].world) == 1 && tm_world_partitions(b[1].world) == 2);
    for (int k = 0; k < 3; k++) destroy(b + k);
}

static double energy_J(const body *b) {
    const tm_state *s = tm_world_state(b->world);
    const tm_nonlinear *law = b->world->nonlinear;
    double sum = tm_tissue_energy(b->tissue, s->u_m) + law->energy(law->self, s->u_m);
    for (int32_t d = 0; d < b->n; d++) {
        const double v = (s->u_m[d] - s->u_prev_m[d]) / tm_world_step_s(b->world);
        sum += 0.5 * tm_tissue_mass_kg(b->tissue)[d / 3] * v * v;
    }
    return sum;
}

/* The same undamped motion as in double to 1e-3 of its amplitude after 400 steps, and energies as far from the first.
 */
static void moves_as_double(void **state) {
    (void)state;
    const tm_material m = material_in(row_at(0), 0.45);
    body b[2];
    double drift[2] = {0}, off = 0, most = 0;
    for (int k = 0; k < 2; k++) {
        b[k] = block_of(&m, (int[]){4, 4, 6}, k ? TM_SINGLE : TM_DOUBLE, 1);
        clamp_floor(b + k);
        let_go(b + k);
        tm_world_step(b[k].world, 1);
        const double first = energy_J(b + k);
        for (int i = 0; i < 40; i++) {
            assert_int_equal(tm_world_step(b[k].world, 10), TM_OK);
            drift[k] = fmax(drift[k], fabs(energy_J(b + k) / first - 1));
        }
    }
    for (int32_t d = 0; d < b[0].n; d++) {
        most = fmax(most, fabs(tm_world_state(b[0].world)->u_m[d]));
        off = fmax(off, fabs(tm_world_state(b[0].world)->u_m[d] - tm_world_state(b[1].world)->u_m[d]));
    }
    print_message("400 steps: %.1e of the amplitude from double; energy within %.5f, double's %.5f\n", off / most,
                  drift[1], drift[0]);
    assert_true(off < 1e-3 * most && off > 0 && fabs(drift[1] - drift[0]) < 1e-3 * drift[0]);
    for (int k = 0; k < 2; k++) destroy(b + k);
}

/* Rest is computed in double: the single pass is at rest there, to its rounding. */
static void rests_where_double_does(void **state) {
    (void)state;
    for (int k = 0; k < LAWS; k++) {
        if (!is_row(row_at(k))) continue;
        const tm_material m = material_in(row_at(k), 0.45);
        body b = block_of(&m, (int[]){3, 3, 4}, TM_SINGLE, 1);
        tm_settle_def def = tm_settle_def_default();
        tm_error error;
        for (int32_t d = 0; d < b.n; d++)
            if (is_at(&b, d / 3 * 3 + 2, 0) || is_at(&b, d / 3 * 3 + 2, 0.012))
                hold(&b, d, d % 3 == 2 && !is_at(&b, d, 0) ? -0.002 : 0);
        support(&b);
        fix_ok(tm_world_settle(b.world, &def, NULL, &error), &error);
        fix_ok(tm_world_step(b.world, 1), &error);
        const double *force = tm_world_state(b.world)->force_N, most = fix_largest(force, b.n);
        bool *held = calloc((size_t)b.mesh->vertex_count, 3 * sizeof *held);
        for (int32_t i = 0; i < b.held; i++) held[b.dof[i]] = true;
        for (int32_t d = 0; d < b.n; d++) assert_true(held[d] || fabs(force[d]) < 1e-5 * most);
        free(held);
        destroy(&b);
    }
}

static void what_relaxes_is_refused(void **state) {
    (void)state;
    const tm_material m = material_in(row_at(0), 0.45);
    body b = block_of(&m, (int[]){2, 2, 2}, TM_SINGLE, 1);
    tm_viscosity_def def = tm_viscosity_def_default();
    tm_error error;
    def.count = 1, def.term[0] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.2};
    assert_int_equal(tm_stage_viscosity(b.world, &def, &error), TM_ERR_EXCLUDED);
    assert_non_null(strstr(error.message, "TM_DOUBLE"));
    destroy(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(is_near_double),
                                       cmocka_unit_test(not_a_number_stays_visible),
                                       cmocka_unit_test(threads_have_the_same_bits),
                                       cmocka_unit_test(moves_as_double),
                                       cmocka_unit_test(rests_where_double_does),
                                       cmocka_unit_test(what_relaxes_is_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
