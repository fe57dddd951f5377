/* Time integration: closed form of one free vertex, its energy, growth past the critical step, changes of the step,
 * divergence. */
#include "../fixture.h"
#include "../long.h"

/* Makes one tetrahedron with every component fixed except `dof`: a scalar oscillator k, m, d. */
typedef struct oscillator {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    double k, m, d, dt;
} oscillator;

enum { FREE_DOF = 10 };

static oscillator make_oscillator(double damping) {
    oscillator o;
    tm_error error;
    tm_material material;
    fix_ok(tm_material_young(1e4, 0.4, &material, &error), &error);
    material.damping_1_s = damping;
    fix_ok(fix_one_tet((const double[12]){0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0.002, 0.001, 0.012}, &o.mesh, &error),
           &error);
    o.tissue = fix_tissue(o.mesh, &material, NULL, TM_DOUBLE, false);
    o.world = fix_world(o.tissue, damping > 0);
    int32_t dof[11], n = 0;
    const double zero[11] = {0};
    for (int32_t i = 0; i < 12; i++)
        if (i != FREE_DOF) dof[n++] = i;
    tm_support_def def = tm_support_def_default();
    def.count = n, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(o.world, &def, &error), &error);
    double K[9];
    tm_tissue_vertex_tensor(o.tissue, FREE_DOF / 3, K);
    o.k = K[4 * (FREE_DOF % 3)];
    o.m = tm_tissue_mass_kg(o.tissue)[FREE_DOF / 3];
    o.d = damping;
    o.dt = tm_world_step_s(o.world);
    return o;
}

static void destroy_oscillator(oscillator *o) {
    tm_world_destroy(o->world);
    tm_tissue_destroy(o->tissue);
    tm_mesh_destroy(o->mesh);
}

/* Computes u_n = rho^n (A cos n theta + B sin n theta): roots of (1+g) z^2 - (2 - w^2) z + (1-g) = 0, g = d dt/2,
 * w^2 = k dt^2/m. */
static void check_closed_form(double damping) {
    oscillator o = make_oscillator(damping);
    const double g = o.d * o.dt / 2, w2 = o.k / o.m * o.dt * o.dt;
    const double rho = sqrt((1 - g) / (1 + g)), theta = acos((2 - w2) / (2 * (1 + g) * rho));
    const double u0 = 1e-3, before = 0.4e-3; /* u_0 and u_-1 */
    tm_world_state(o.world)->u_m[FREE_DOF] = u0;
    tm_world_state(o.world)->u_prev_m[FREE_DOF] = before;
    const double B = (u0 * cos(theta) - before * rho) / sin(theta);
    for (int n = 1; n <= 1000; n++) {
        assert_int_equal(tm_world_step(o.world, 1), TM_OK);
        const double exact = pow(rho, n) * (u0 * cos(n * theta) + B * sin(n * theta));
        const double u = tm_world_state(o.world)->u_m[FREE_DOF];
        if (fabs(u - exact) > 1e-12 * u0) fail_msg("step %d: %.17g, closed form %.17g", n, u, exact);
    }
    assert_true(fabs(tm_world_state(o.world)->time_s / (1000 * o.dt) - 1) < 1e-12);
    destroy_oscillator(&o);
}

static void free_vertex_follows_the_closed_form(void **state) {
    (void)state;
    check_closed_form(0);
    check_closed_form(40);
    check_closed_form(2000);
}

/* Returns half v M v at n+1/2 plus half u_n K u_{n+1}, which the undamped scheme conserves. `force` is work space. */
static double scheme_energy(tm_world *world, double *force) {
    const tm_state *s = tm_world_state(world);
    const tm_tissue *tissue = tm_world_tissue(world);
    const int32_t n = 3 * tm_tissue_mesh(tissue)->vertex_count;
    double sum = 0;
    tm_tissue_force(tissue, s->u_prev_m, force);
    for (int32_t i = 0; i < n; i++) {
        const double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        sum += 0.5 * tm_tissue_mass_kg(tissue)[i / 3] * v * v - 0.5 * s->u_m[i] * force[i];
    }
    return sum;
}

enum { HELD = 12 }; /* components of the four vertices at x = 0 */

/* Makes a clamped block with random velocities at `fraction` of the estimated step. No user may request that, as the
 * guaranteed step is below the estimated one: the step is written into the state, with its mobilities. */
static tm_world *thrown(tm_mesh *mesh, tm_tissue **tissue, double fraction) {
    tm_error error;
    tm_material material;
    fix_ok(tm_material_paper(1e4, 3e3, 1.2e4, 9e3, &material, &error), &error);
    *tissue = fix_tissue(mesh, &material, (const double[3]){1, 2, 2}, TM_DOUBLE, false);
    int32_t dof[HELD];
    uint8_t fixed[100] = {0};
    const double zero[HELD] = {0};
    for (int i = 0; i < HELD; i++) dof[i] = i, fixed[i] = 1;
    double estimate = 0;
    fix_ok(tm_critical_step_estimate(*tissue, fixed, 1e-10, 100000, &estimate, &error), &error);
    tm_world *world = fix_world(*tissue, false);
    tm_support_def def = tm_support_def_default();
    def.count = HELD, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(world, &def, &error), &error);
    tm_state *s = tm_world_state(world);
    const double ratio = fraction * estimate / s->dt_s;
    assert_true(ratio > 1);
    double *mobility = (double *)tm_world_mobility_s2_kg(world);
    for (int32_t v = 0; v < mesh->vertex_count; v++) mobility[v] *= ratio * ratio;
    s->dt_s *= ratio;
    fix_random random = {23};
    for (int32_t i = HELD; i < 3 * mesh->vertex_count; i++) s->u_prev_m[i] = -s->dt_s * 0.1 * fix_signed(&random);
    return world;
}

static void undamped_energy_is_conserved(void **state) {
    (void)state;
    const int32_t steps = 1000000;
    fix_random random = {29};
    tm_mesh *mesh = fix_block((int[3]){2, 1, 1}, (double[3]){0.02, 0.01, 0.01}, 0, &random);
    tm_tissue *tissue = NULL;
    tm_world *world = thrown(mesh, &tissue, 0.95);
    double *force = malloc(sizeof(double) * 3 * (size_t)mesh->vertex_count);
    const double before = scheme_energy(world, force);
    double worst = 0;
    for (int32_t n = 0; n < steps; n += 1000) {
        assert_int_equal(tm_world_step(world, 1000), TM_OK);
        worst = fmax(worst, fabs(scheme_energy(world, force) / before - 1));
    }
    print_message("  energy of %d steps at 0.95 of the estimated step: within %.1e\n", steps, worst);
    assert_true(worst <= 1e-9);
    free(force);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

static void motion_grows_past_the_estimated_step(void **state) {
    (void)state;
    fix_random random = {31};
    tm_mesh *mesh = fix_block((int[3]){2, 1, 1}, (double[3]){0.02, 0.01, 0.01}, 0, &random);
    tm_tissue *tissue = NULL;
    tm_world *world = thrown(mesh, &tissue, 1.05);
    double before = 0;
    tm_status status = TM_OK;
    int calls = 0;
    while (!status && calls < 100) {
        before = fix_largest(tm_world_state(world)->u_m, 3 * mesh->vertex_count);
        status = tm_world_step(world, 20);
        calls += !status;
    }
    assert_int_equal(status, TM_ERR_UNSTABLE);
    /* The state before the failing call is restored, finite. */
    assert_true(before > 1 && isfinite(before));
    assert_true(fix_largest(tm_world_state(world)->u_m, 3 * mesh->vertex_count) == before);
    assert_int_equal(tm_world_state(world)->step, 20 * calls);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* Damping only removes energy; a change of the step keeps the velocity. */
static void damping_dissipates_and_step_changes_keep_velocity(void **state) {
    (void)state;
    oscillator o = make_oscillator(50);
    tm_state *s = tm_world_state(o.world);
    s->u_m[FREE_DOF] = s->u_prev_m[FREE_DOF] = 1e-3;
    double force[12], last = scheme_energy(o.world, force);
    for (int i = 0; i < 400; i++) {
        assert_int_equal(tm_world_step(o.world, 1), TM_OK);
        const double now = scheme_energy(o.world, force);
        assert_true(now <= last * (1 + 1e-12));
        last = now;
    }
    /* The velocity belongs to the middle of a step: a shorter step moves that middle, and half of its impulse with
     * it. */
    tm_error error;
    const double velocity = (s->u_m[FREE_DOF] - s->u_prev_m[FREE_DOF]) / s->dt_s, u = s->u_m[FREE_DOF],
                 fine = 0.37 * o.dt;
    const double kicked = velocity + 0.5 * (o.dt - fine) * (-o.k * u / o.m - o.d * velocity);
    fix_ok(tm_world_set_step(o.world, fine, &error), &error);
    assert_true(tm_world_step_s(o.world) == fine && s->u_m[FREE_DOF] == u);
    assert_true(fabs((s->u_m[FREE_DOF] - s->u_prev_m[FREE_DOF]) / s->dt_s / kicked - 1) < 1e-9);
    assert_int_equal(tm_world_set_step(o.world, 1.2 * o.dt, &error), TM_ERR_STEP);
    assert_int_equal(error.entity, 0);
    assert_non_null(strstr(error.message, "tetrahedron 0"));
    assert_int_equal(tm_world_set_step(o.world, NAN, &error), TM_ERR_STEP);
    assert_int_equal(tm_world_set_step(o.world, 0, &error), TM_ERR_STEP);
    destroy_oscillator(&o);
}

static void damped_world_comes_to_the_settled_rest(void **state) {
    (void)state;
    tm_error error;
    tm_material material;
    fix_ok(tm_material_young(1e4, 0.4, &material, &error), &error);
    material.damping_1_s = 60;
    fix_random random = {37};
    tm_mesh *mesh = fix_block((int[3]){3, 1, 1}, (double[3]){0.03, 0.01, 0.01}, 0, &random);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    tm_world *world = fix_world(tissue, true);
    int32_t dof[12];
    const double zero[12] = {0};
    for (int i = 0; i < 12; i++) dof[i] = i; /* the face x = 0 */
    tm_support_def def = tm_support_def_default();
    def.count = 12, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(world, &def, &error), &error);
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    assert_int_equal(tm_world_step(world, 40000), TM_OK);
    const int32_t n = 3 * mesh->vertex_count;
    double *u = malloc(sizeof(double) * (size_t)n), *a = calloc((size_t)n, sizeof(double)),
           *b = calloc((size_t)n, sizeof(double));
    memcpy(u, tm_world_state(world)->u_m, sizeof(double) * (size_t)n);
    tm_support_reaction(world, a);
    tm_settle_result result;
    tm_settle_def settle = tm_settle_def_default();
    fix_ok(tm_world_settle(world, &settle, &result, &error), &error);
    tm_support_reaction(world, b);
    double weight = 0;
    for (int32_t i = 0; i < n; i++) {
        assert_true(fabs(u[i] - tm_world_state(world)->u_m[i]) < 1e-8 * fix_largest(u, n));
        assert_true(fabs(a[i] - b[i]) < 1e-7 * fix_largest(b, n));
        weight += i % 3 == 2 ? b[i] : 0;
    }
    assert_true(fabs(weight / (1000 * 3e-6 * 9.81) - 1) < 1e-9);
    /* A settled state is an equilibrium of the steps too, and the hash distinguishes states. */
    const uint64_t hash = tm_world_hash(world);
    memcpy(u, tm_world_state(world)->u_m, sizeof(double) * (size_t)n);
    assert_int_equal(tm_world_step(world, 100), TM_OK);
    for (int32_t i = 0; i < n; i++) assert_true(fabs(u[i] - tm_world_state(world)->u_m[i]) < 1e-9 * fix_largest(u, n));
    assert_true(hash != tm_world_hash(world));
    free(u), free(a), free(b);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* Damped tissue without loads comes to rest in exactly its own shape, without denormals. Steps are independent of
 * their grouping. */
static void damped_motion_ends_at_exactly_zero(void **state) {
    (void)state;
    oscillator o = make_oscillator(400), p = make_oscillator(400);
    tm_world_state(o.world)->u_m[FREE_DOF] = tm_world_state(p.world)->u_m[FREE_DOF] = 1e-3;
    for (int steps = 0; steps < 1000; steps += 25) assert_int_equal(tm_world_step(o.world, 25), TM_OK);
    for (int steps = 0; steps < 1000; steps += 8) assert_int_equal(tm_world_step(p.world, 8), TM_OK);
    assert_true(tm_world_hash(o.world) == tm_world_hash(p.world));
    assert_true(tm_world_state(o.world)->u_m[FREE_DOF] != 0);
    double before = 1;
    for (int call = 0; call < 4000 && before != 0; call++) {
        assert_int_equal(tm_world_step(o.world, 256), TM_OK);
        before = tm_world_state(o.world)->u_m[FREE_DOF];
        assert_true(before == 0 || fabs(before) > 1e-77);
    }
    assert_true(before == 0 && tm_world_state(o.world)->u_prev_m[FREE_DOF] == 0);
    destroy_oscillator(&p);
    destroy_oscillator(&o);
}

static void invalid_steps_and_supports_are_rejected(void **state) {
    (void)state;
    oscillator o = make_oscillator(50);
    tm_error error;
    tm_world *world = NULL;
    tm_world_def def = tm_world_def_default();
    def.tissue = o.tissue, def.damped = false;
    assert_int_equal(tm_world_create(&def, &world, &error), TM_ERR_ARGUMENT);
    def.damped = true, def.dt_s = 1;
    assert_int_equal(tm_world_create(&def, &world, &error), TM_ERR_STEP);
    def.dt_s = 0, def.step_fraction = 1.5;
    assert_int_equal(tm_world_create(&def, &world, &error), TM_ERR_STEP);
    assert_null(world);
    assert_int_equal(tm_stage_gravity(o.world, (const double[3]){0, NAN, 0}, &error), TM_ERR_ARGUMENT);
    tm_support_def support = tm_support_def_default();
    world = NULL;
    def.step_fraction = 0.9;
    fix_ok(tm_world_create(&def, &world, &error), &error);
    support.count = 2, support.dof = (const int32_t[2]){4, 4}, support.value_m = (const double[2]){0, 1e-3};
    assert_int_equal(tm_stage_support(world, &support, &error), TM_ERR_SUPPORT);
    assert_int_equal(error.entity, 1);
    support.dof = (const int32_t[2]){4, 12};
    assert_int_equal(tm_stage_support(world, &support, &error), TM_ERR_ARGUMENT);
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    assert_int_equal(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), TM_ERR_ARGUMENT);
    /* Two fixed vertices leave a rotation about their line. */
    const double zero[6] = {0};
    support.count = 6, support.dof = (const int32_t[6]){0, 1, 2, 3, 4, 5}, support.value_m = zero;
    fix_ok(tm_stage_support(world, &support, &error), &error);
    tm_settle_def settle = tm_settle_def_default();
    assert_int_equal(tm_world_settle(world, &settle, NULL, &error), TM_ERR_SUPPORT);
    settle.max_steps = 1;
    fix_ok(tm_world_remove_stage(world, "support", &error), &error);
    support.count = 3, support.dof = (const int32_t[3]){0, 1, 2};
    fix_ok(tm_stage_support(world, &support, &error), &error);
    assert_int_equal(tm_world_settle(world, &settle, NULL, &error), TM_ERR_SUPPORT);
    fix_ok(tm_world_remove_stage(world, "gravity", &error), &error);
    assert_int_equal(tm_world_remove_stage(world, "gravity", &error), TM_ERR_ARGUMENT);
    tm_world_destroy(world);
    destroy_oscillator(&o);
    assert_int_equal(tm_memory_in_use(), 0);
}

/* Rotates an undamped body with `held` prescribed vertices. Returns the growth of its largest displacement in this
 * many steps; `status` is the library's verdict on its supports. */
static double turned(tm_precision precision, int held, int32_t steps, tm_status *status) {
    fix_random random = {5};
    tm_mesh *mesh = fix_block((int[3]){2, 2, 2}, (double[3]){0.02, 0.02, 0.02}, 0.2, &random);
    tm_material material;
    tm_error error = {0};
    fix_ok(tm_material_young(1e4, 0.45, &material, &error), &error);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, precision, false);
    tm_world *world = fix_world(tissue, false);
    tm_state *s = tm_world_state(world);
    const double w[3] = {1e-6, -2e-6, 1.5e-6};
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const double *p = mesh->rest_m + 3 * v;
        for (int i = 0; i < 3; i++)
            s->u_m[3 * v + i] = s->u_prev_m[3 * v + i] =
                w[(i + 1) % 3] * p[(i + 2) % 3] - w[(i + 2) % 3] * p[(i + 1) % 3];
    }
    const int32_t corner[3] = {0, 2, 6}; /* not in one line */
    int32_t dof[9];
    double value[9];
    for (int i = 0; i < 9; i++) dof[i] = 3 * corner[i / 3] + i % 3, value[i] = s->u_m[dof[i]];
    tm_support_def def = tm_support_def_default();
    def.count = 3 * held, def.dof = dof, def.value_m = value;
    if (held) fix_ok(tm_stage_support(world, &def, &error), &error);
    *status = tm_world_check_constrained(world, &error);
    assert_true(!*status || strstr(error.message, "leave its connected piece free to move"));
    const double before = fix_largest(s->u_m, 3 * mesh->vertex_count);
    assert_int_equal(tm_world_step(world, steps), TM_OK);
    const double grown = fix_largest(tm_world_state(world)->u_m, 3 * mesh->vertex_count) / before;
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    return grown;
}

/* Rounded tensors rotate free tissue, so single precision requires supports, and the library checks them. */
static void single_precision_requires_supports(void **state) {
    (void)state;
    tm_status status;
    const int32_t steps = test_is_long() ? 1000000 : 150000;
    assert_true(turned(TM_DOUBLE, 0, steps, &status) < 1 + 1e-6 && status == TM_ERR_SUPPORT);
    print_message("  single and free: %.3g times in 100000 steps\n", turned(TM_SINGLE, 0, 100000, &status));
    assert_int_equal(status, TM_ERR_SUPPORT);
    turned(TM_SINGLE, 1, 1, &status);
    assert_int_equal(status, TM_ERR_SUPPORT);
    turned(TM_SINGLE, 2, 1, &status); /* a hinge */
    assert_int_equal(status, TM_ERR_SUPPORT);
    assert_true(turned(TM_SINGLE, 3, steps, &status) < 1 + 1e-3);
    assert_int_equal(status, TM_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(free_vertex_follows_the_closed_form),
                                       cmocka_unit_test(undamped_energy_is_conserved),
                                       cmocka_unit_test(motion_grows_past_the_estimated_step),
                                       cmocka_unit_test(damping_dissipates_and_step_changes_keep_velocity),
                                       cmocka_unit_test(damped_world_comes_to_the_settled_rest),
                                       cmocka_unit_test(damped_motion_ends_at_exactly_zero),
                                       cmocka_unit_test(invalid_steps_and_supports_are_rejected),
                                       cmocka_unit_test(single_precision_requires_supports)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
