/* Coupling of the hybrid model: its stiffness is between the condensed part's and the interface's own, and the
 * energy account closes with the losses of full solves. */
#include "../../libtensormass/solve/hybrid.h"
#include "kit.h"

typedef struct set {
    tm_mesh *mesh;
    tm_tissue *whole, *tissue;
    uint8_t *fixed, *dynamic;
    tm_hybrid *hybrid;
    tm_world *world;
    double *x, *y; /* [3*vertex_count] */
} set;

/* A distorted block with two stiffnesses, fixed at one end; the other half is dynamic: 147 or more components
 * between them. At the guaranteed step, undamped. */
static set make(void) {
    fix_random random = {23};
    set s = {.mesh = fix_block((int[]){8, 6, 6}, (double[]){0.08, 0.06, 0.06}, 0.25, &random)};
    const size_t n = 3 * (size_t)s.mesh->vertex_count;
    const tm_material material = kit_material(10e3, 0.45);
    tm_error error;
    s.fixed = kit_clamp(s.mesh, 1e-9);
    s.dynamic = malloc((size_t)s.mesh->tet_count);
    for (int32_t t = 0; t < s.mesh->tet_count; t++) {
        double x = 0;
        for (int i = 0; i < 4; i++) x += s.mesh->rest_m[3 * s.mesh->tet[4 * t + i]] / 4;
        s.dynamic[t] = x > 0.04;
    }
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = s.mesh, def.material_count = 1, def.material = &material, def.form = TM_FORCE_PLAIN;
    fix_ok(tm_tissue_create(&def, &s.whole, &error), &error);
    tm_hybrid_def hybrid = tm_hybrid_def_default();
    hybrid.problem = kit_problem(s.whole, s.fixed);
    hybrid.dynamic = s.dynamic;
    fix_ok(tm_hybrid_create(&hybrid, &s.hybrid, NULL, &error), &error);
    tm_hybrid_tissue(s.hybrid, &def);
    fix_ok(tm_tissue_create(&def, &s.tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = s.tissue;
    world.dt_s = tm_hybrid_critical_step(s.hybrid, NULL);
    world.damped = false;
    fix_ok(tm_world_create(&world, &s.world, &error), &error);
    fix_ok(tm_stage_hybrid(s.world, s.hybrid, NULL, &error), &error);
    s.x = calloc(n, 8), s.y = calloc(n, 8);
    return s;
}

static void free_set(set *s) {
    tm_world_destroy(s->world);
    tm_hybrid_destroy(s->hybrid);
    tm_tissue_destroy(s->tissue);
    tm_tissue_destroy(s->whole);
    tm_mesh_destroy(s->mesh);
    free(s->fixed), free(s->dynamic), free(s->x), free(s->y);
}

/* Computes x^T S x and x^T (K - W W^T) x for the interface's part of a displacement. */
static double condensed_form(const set *s, const double *border_x) {
    const int32_t n = s->hybrid->interface_count;
    double *zero = calloc((size_t)n, 8), *f = calloc((size_t)n, 8);
    tms_whole_force(s->hybrid->schur, zero, border_x, n, f);
    const double form = -tms_dot(border_x, f, n);
    free(zero), free(f);
    return form;
}
static double followed_form(const set *s, const double *border_x) {
    tms_coupling *c = &s->hybrid->coupling;
    double form = 0;
    for (int32_t i = 0; i < c->n; i++) c->moved[i] = (float)border_x[i];
    tms_follow(c);
    for (int32_t i = 0; i < c->n; i++) form += border_x[i] * (double)c->answer[i];
    return form;
}

/* --- S <= K - W W^T <= K --- */

/* Returns whether R + `room` times its largest entry is positive. */
static bool rest_is_positive(const set *s, double room) {
    tms_coupling *c = &s->hybrid->coupling;
    const int32_t n = c->n;
    double *R = malloc(8 * (size_t)n * (size_t)n), *x = calloc((size_t)n, 8), *f = calloc((size_t)n, 8),
           *zero = calloc((size_t)n, 8), most = 0;
    for (int32_t j = 0; j < n; j++) {
        for (int32_t i = 0; i < n; i++) c->moved[i] = i == j, x[i] = i == j;
        tms_follow(c);
        tms_whole_force(s->hybrid->schur, zero, x, n, f);
        for (int32_t i = 0; i < n; i++) R[(int64_t)i * n + j] = (double)c->answer[i] + f[i];
        most = fmax(most, R[(int64_t)j * n + j]);
    }
    bool positive = true;
    for (int32_t j = 0; positive && j < n; j++)
        for (int32_t i = 0; positive && i <= j; i++) {
            double sum = 0.5 * (R[(int64_t)j * n + i] + R[(int64_t)i * n + j]) + (i == j ? room * most : 0);
            for (int32_t k = 0; k < i; k++) sum -= R[(int64_t)j * n + k] * R[(int64_t)i * n + k];
            positive = i < j || sum > 0;
            R[(int64_t)j * n + i] = i < j ? sum / R[(int64_t)i * n + i] : sqrt(sum);
        }
    free(R), free(x), free(f), free(zero);
    return positive;
}

static void coupling_stiffness_is_between_its_bounds(void **state) {
    (void)state;
    set s = make();
    tms_coupling *c = &s.hybrid->coupling;
    assert_true(c->n >= 147 && c->rank > 0 && c->every > 1);
    assert_true(rest_is_positive(&s, 2e-6));
    /* the softest shapes, which move the complete interface, are represented well; a rough one is not */
    fix_random random = {3};
    double *shape = calloc((size_t)c->n, 8);
    double worst = 0;
    for (int k = 0; k < 12; k++) { /* constant, sheared, bent once along either side */
        for (int32_t i = 0; i < c->n; i++) {
            const double *at = s.mesh->rest_m + s.hybrid->interface[i] / 3 * 3, y = at[1] / 0.06, z = at[2] / 0.06;
            shape[i] = i % 3 == k % 3 ? (k < 3 ? 1 : k < 6 ? y - 0.5 : k < 9 ? sin(3.14159 * y) : sin(3.14159 * z)) : 0;
        }
        const double soft = condensed_form(&s, shape), followed = followed_form(&s, shape);
        assert_true(followed >= soft * (1 - 1e-4));
        worst = fmax(worst, followed / soft);
    }
    print_message("  smooth shapes are at most %.3f times as stiff in between\n", worst);
    assert_true(worst < 1.25);
    for (int32_t i = 0; i < c->n; i++) shape[i] = fix_signed(&random);
    const double rough = condensed_form(&s, shape), stiff = followed_form(&s, shape);
    print_message("  %d components, %d shapes, whole every %d steps: a rough shape is %.2f times as stiff in between\n",
                  c->n, c->rank, c->every, stiff / rough);
    assert_true(stiff > 1.01 * rough);
    /* a shape softer than the inside would be detected */
    for (int64_t i = 0; i < (int64_t)c->rank * c->padded; i++) c->smooth[i] *= 1.05f;
    assert_false(rest_is_positive(&s, 2e-6));
    free(shape);
    free_set(&s);
}

/* --- energy --- */

static double border_of(const set *s, const double *u, double *border_x, double (*form)(const set *, const double *)) {
    for (int32_t i = 0; i < s->hybrid->interface_count; i++) border_x[i] = u[s->hybrid->interface[i]];
    return 0.5 * form(s, border_x);
}

/* Returns the leapfrog scheme's own energy between the last two shapes; writes their middle to s->x. */
static double energy(const set *s, double *border_x) {
    const tm_state *at = tm_world_state(s->world);
    const double *mass = tm_tissue_mass_kg(s->tissue), dt = tm_world_step_s(s->world);
    double sum = 0;
    for (int32_t d = 0; d < 3 * s->mesh->vertex_count; d++) {
        s->y[d] = at->u_m[d] - at->u_prev_m[d];
        s->x[d] = 0.5 * (at->u_m[d] + at->u_prev_m[d]);
        sum += 0.5 * mass[d / 3] * s->y[d] * s->y[d] / (dt * dt);
    }
    sum -= 0.25 * (tm_tissue_energy(s->tissue, s->y) + border_of(s, s->y, border_x, followed_form));
    return sum + tm_tissue_energy(s->tissue, s->x) + border_of(s, s->x, border_x, condensed_form);
}

static void energy_account_closes(void **state) {
    (void)state;
    set s = make();
    const tms_coupling *c = &s.hybrid->coupling;
    const int32_t n = c->n;
    fix_random random = {41};
    tm_state *at = tm_world_state(s.world);
    double *border_x = calloc((size_t)n, 8), *before_x = calloc((size_t)n, 8), *d = calloc((size_t)n, 8);
    for (int32_t i = 0; i < 3 * s.mesh->vertex_count; i++)
        if (tm_tissue_mass_kg(s.tissue)[i / 3] > 0) at->u_m[i] = 1e-3 * fix_signed(&random);
    memcpy(at->u_prev_m, at->u_m, 24 * (size_t)s.mesh->vertex_count);
    double last = energy(&s, before_x), first = last, worst = 0, taken = 0;
    for (int k = 0; k < 400; k++) {
        assert_int_equal(tm_world_step(s.world, c->every), TM_OK);
        const double now = energy(&s, border_x);
        for (int32_t i = 0; i < n; i++) d[i] = border_x[i] - before_x[i];
        const double took = 0.5 * (followed_form(&s, d) - condensed_form(&s, d));
        worst = fmax(worst, fabs(now - last + took) / first);
        assert_true(now < last + 1e-7 * first);
        taken += took;
        last = now;
        memcpy(before_x, border_x, 8 * (size_t)n);
    }
    print_message("  %d undamped steps at the guaranteed step: %.3f of the energy is left, account closes to %.1e\n",
                  400 * c->every, last / first, worst);
    assert_true(worst < 1e-6);
    assert_true(taken > 0 && last > 0);
    free(border_x), free(before_x), free(d);
    free_set(&s);
}

/* --- increments in single --- */

/* Between two full forces in double, the force is updated by increments in single: as accurate, and tissue at rest
 * has the force of its shape to the last bit. */
static void single_changes_reach_the_double_force(void **state) {
    (void)state;
    set s = make();
    tms_coupling *c = &s.hybrid->coupling;
    fix_random random = {5};
    double *u = calloc((size_t)c->n, 8), *f = calloc((size_t)c->n, 8), *exact = calloc((size_t)c->n, 8), worst = 0;
    int32_t most = 0;
    for (int k = 0; k < 40 * c->every; k++) {
        const bool rests = k >= 20 * c->every;
        for (int32_t i = 0; !rests && i < c->n; i++) u[i] += 1e-5 * fix_signed(&random);
        tms_coupling_force(c, u, u, f);
        if (c->age != 0) continue;
        tms_whole_force(s.hybrid->schur, s.hybrid->responses.interface_N, u, c->n, exact);
        for (int32_t i = 0; i < c->n; i++)
            worst = fmax(worst, fabs(f[i] - exact[i]) / fix_largest(exact, (size_t)c->n));
        most = c->changes > most ? c->changes : most;
    }
    print_message("  up to %d changes in single: off by %.1e of the largest force\n", most, worst);
    assert_true(most == 7 && worst > 0 && worst < 1e-6);
    assert_memory_equal(f, exact, 8 * (size_t)c->n);
    free(u), free(f), free(exact);
    free_set(&s);
}

/* Removed vertices of the world's tissue are checked too, though not in every substep. */
static void removed_vertices_are_checked_too(void **state) {
    (void)state;
    set s = make();
    tm_state *at = tm_world_state(s.world);
    int32_t v = 0;
    while (s.hybrid->vertex_kind[v] != TMS_CONDENSED) v++;
    assert_int_equal(tm_world_step(s.world, 20), TM_OK);
    at->u_m[3 * v] = 1e7;
    assert_int_equal(tm_world_step(s.world, 20), TM_ERR_UNSTABLE);
    free_set(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coupling_stiffness_is_between_its_bounds), cmocka_unit_test(energy_account_closes),
        cmocka_unit_test(single_changes_reach_the_double_force), cmocka_unit_test(removed_vertices_are_checked_too)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
