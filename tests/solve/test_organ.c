/* Direct solution, superposed responses and hybrid model on the generated organ, against the settled tensor/mass
 * model. */
#include "organ.h"

static tm_tissue *part(const tm_mesh *mesh, const tm_material *material, const tm_hybrid *hybrid) {
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = material;
    int32_t regions[8] = {0};
    def.region_material = regions;
    if (hybrid) def.cuttable = true, tm_hybrid_tissue(hybrid, &def);
    tm_tissue *tissue;
    tm_error error;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

typedef struct rest {
    double *u, *reaction;
    double seconds;
} rest;

static rest settle(const organ *o, tm_tissue *tissue, const double g[3]) {
    const size_t n = 3 * (size_t)o->mesh->vertex_count;
    rest r = {malloc(8 * n), calloc(n, 8), 0};
    tm_error error;
    tm_world *world = fix_world(tissue, true);
    kit_support(world, o->fixed, NULL);
    fix_ok(tm_stage_gravity(world, g, &error), &error);
    kit_settle(world);
    memcpy(r.u, tm_world_state(world)->u_m, 8 * n);
    tm_support_reaction(world, r.reaction);
    tm_world_destroy(world);
    return r;
}

/* Prescribes a vertex of the free surface far from the supports: the settled world with this additional support
 * gives the reference. */
static void check_imposed(const organ *o, tm_tissue *tissue, const double *load, const double g[3]) {
    const size_t n = 3 * (size_t)o->mesh->vertex_count;
    tm_precomputed_def def = tm_precomputed_def_default();
    def.problem = kit_problem(tissue, o->fixed);
    def.problem.load_N = load;
    tm_precomputed *model;
    tm_error error;
    tm_solve_report report;
    fix_ok(tm_precomputed_create(&def, &model, &report, &error), &error);
    const int32_t *surface, count = tm_precomputed_surface(model, &surface);
    int32_t far = 0;
    for (int32_t i = 1; i < count; i++) /* the left lobe's end */
        if (o->mesh->rest_m[3 * surface[i]] > o->mesh->rest_m[3 * surface[far]]) far = i;
    far = surface[far];
    const double to[3] = {0.002, -0.004, 0.012};
    fix_ok(tm_precomputed_impose(model, 1, &far, to, 0, &error), &error);
    assert_true(tm_precomputed_update(model, NULL) >= 0);
    uint8_t *fixed = malloc(n);
    double *value = calloc(n, 8), *reaction = calloc(n, 8), hand[3], worst = 0;
    memcpy(fixed, o->fixed, n);
    for (int c = 0; c < 3; c++) fixed[3 * far + c] = 1, value[3 * far + c] = to[c];
    tm_world *world = fix_world(tissue, true);
    kit_support(world, fixed, value);
    fix_ok(tm_stage_gravity(world, g, &error), &error);
    kit_settle(world);
    tm_support_reaction(world, reaction);
    const double *u = tm_world_state(world)->u_m, *v = tm_precomputed_displacement(model);
    for (int32_t i = 0; i < 3 * count; i++)
        worst = fmax(worst, fabs(u[3 * surface[i / 3] + i % 3] - v[3 * surface[i / 3] + i % 3]));
    tm_precomputed_imposed_force(model, 0, hand);
    const double off = worst / fix_largest(u, (int32_t)n), force_off = kit_difference(hand, reaction + 3 * far, 3);
    print_message("    a vertex moved by hand: shape off by %.1e, its reaction by %.1e of %.3f N (%d columns in %.1f "
                  "s, %.0f MB)\n",
                  off, force_off, fix_largest(hand, 3), report.columns, report.seconds,
                  1e-6 * (double)report.responses_bytes);
    assert_true(off < 1e-6);
    assert_true(force_off < 1e-6);
    tm_world_destroy(world);
    tm_precomputed_destroy(model);
    free(fixed), free(value), free(reaction);
}

static double largest_off(const organ *o, const tm_tissue *among, const double *a, const double *b) {
    double worst = 0;
    for (int32_t d = 0; d < 3 * o->mesh->vertex_count; d++)
        if (tm_tissue_mass_kg(among)[d / 3] > 0) worst = fmax(worst, fabs(a[d] - b[d]));
    return worst / fix_largest(b, 3 * o->mesh->vertex_count);
}

/* The right lobe's front is dynamic; twenty of its tetrahedra are cut out. */
static void check_hybrid(const organ *o, const tm_material *material, tm_tissue *whole, const double *load,
                         const double g[3], const double *full, double seconds) {
    const tm_mesh *mesh = o->mesh;
    uint8_t *dynamic = calloc((size_t)mesh->tet_count, 1), *outside = calloc(3 * (size_t)mesh->vertex_count, 1),
            *alive = malloc((size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x[3] = {0};
        for (int i = 0; i < 12; i++) x[i % 3] += mesh->rest_m[3 * mesh->tet[4 * t + i / 3] + i % 3] / 4;
        dynamic[t] = x[0] > -0.065 && x[0] < -0.028 && x[1] > -0.04 && x[1] < 0.03 && x[2] > 0.0;
    }
    tm_hybrid_def def = tm_hybrid_def_default();
    def.problem = kit_problem(whole, o->fixed);
    def.problem.load_N = load;
    def.dynamic = dynamic;
    tm_hybrid *hybrid;
    tm_error error;
    tm_solve_report report;
    fix_ok(tm_hybrid_create(&def, &hybrid, &report, &error), &error);
    tm_tissue *tissue = part(mesh, material, hybrid);
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = tissue;
    world_def.dt_s = 0.98 * tm_hybrid_critical_step(hybrid, NULL);
    tm_world *world;
    fix_ok(tm_world_create(&world_def, &world, &error), &error);
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++)
        outside[d] = o->fixed[d] && tm_tissue_mass_kg(tissue)[d / 3] > 0;
    kit_support(world, outside, NULL);
    fix_ok(tm_stage_gravity(world, g, &error), &error);
    fix_ok(tm_stage_hybrid(world, hybrid, NULL, &error), &error);
    const int32_t steps = (int32_t)(seconds / world_def.dt_s);
    assert_int_equal(tm_world_step(world, steps), TM_OK);
    tm_hybrid_recover(hybrid, world);
    const double before = largest_off(o, whole, tm_world_state(world)->u_m, full);
    int32_t cut[20], cuts = 0;
    for (int32_t t = 0; t < mesh->tet_count && cuts < 20; t++) {
        const bool top = mesh->tet_neighbour[4 * t] < 0 || mesh->tet_neighbour[4 * t + 1] < 0 ||
                         mesh->tet_neighbour[4 * t + 2] < 0 || mesh->tet_neighbour[4 * t + 3] < 0;
        if (dynamic[t] && top) cut[cuts++] = t;
    }
    const int32_t removed = tm_cut_remove(tissue, cut, cuts, NULL, 0);
    assert_true(removed >= cuts && cuts > 3);
    assert_int_equal(tm_world_step(world, steps), TM_OK);
    tm_hybrid_recover(hybrid, world);
    for (int32_t t = 0; t < mesh->tet_count; t++) alive[t] = !dynamic[t] || tm_tissue_alive(tissue)[t];
    tm_tissue_def left_def = tm_tissue_def_default();
    int32_t regions[8] = {0};
    left_def.mesh = mesh, left_def.material_count = 1, left_def.material = material, left_def.alive = alive,
    left_def.region_material = regions;
    tm_tissue *left;
    fix_ok(tm_tissue_create(&left_def, &left, &error), &error);
    rest after = settle(o, left, g);
    const double in_part = largest_off(o, tissue, tm_world_state(world)->u_m, after.u),
                 everywhere = largest_off(o, left, tm_world_state(world)->u_m, after.u);
    print_message("    hybrid, %d tetrahedra tensor/mass, %d interface components: at rest off by %.1e; %d cut: %.1e "
                  "in its tensor/mass part, %.1e everywhere\n",
                  tm_tissue_alive_count(tissue) + removed, report.interface_dofs, before, removed, in_part, everywhere);
    assert_true(before < 1e-6);
    assert_true(in_part < 1e-6);
    assert_true(everywhere < 1e-6);
    free(after.u), free(after.reaction);
    tm_world_destroy(world);
    tm_hybrid_destroy(hybrid);
    tm_tissue_destroy(tissue);
    tm_tissue_destroy(left);
    free(dynamic), free(outside), free(alive);
}

static void check_organ(const char *size, bool hybrid_too) {
    const double g[3] = {0, 0, -9.81};
    organ o = organ_read(size);
    tm_material material = kit_material(20e3, 0.4);
    material.damping_1_s = 45; /* close to critical damping of the organ's lowest mode */
    tm_tissue *tissue = part(o.mesh, &material, NULL);
    const size_t n = 3 * (size_t)o.mesh->vertex_count;
    double *load = malloc(8 * n), *u = malloc(8 * n), *reaction = malloc(8 * n);
    for (size_t d = 0; d < n; d++) load[d] = tm_tissue_mass_kg(tissue)[d / 3] * g[d % 3];
    rest settled = settle(&o, tissue, g);
    tm_solve_def def = kit_problem(tissue, o.fixed);
    def.load_N = load;
    tm_error error;
    fix_ok(tm_solve_static(&def, u, reaction, NULL, &error), &error);
    const double off = kit_difference(u, settled.u, (int32_t)n),
                 force_off = kit_difference(reaction, settled.reaction, (int32_t)n);
    print_message("  liver of %d tetrahedra: direct solution off the settled one by %.1e, reactions by %.1e\n",
                  o.mesh->tet_count, off, force_off);
    assert_true(off < 1e-6);
    assert_true(force_off < 1e-6);
    check_imposed(&o, tissue, load, g);
    if (hybrid_too) check_hybrid(&o, &material, tissue, load, g, settled.u, 1.5);
    free(settled.u), free(settled.reaction), free(load), free(u), free(reaction);
    tm_tissue_destroy(tissue);
    organ_free(&o);
}

static void organ_of_1k_agrees_with_the_settled_model(void **state) { (void)state, check_organ("1k", true); }
static void organ_of_10k_agrees_with_the_settled_model(void **state) {
    (void)state, check_organ("10k", test_is_long());
}
static void organ_of_50k_agrees_with_the_settled_model(void **state) {
    (void)state;
    check_organ("50k", true);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(organ_of_1k_agrees_with_the_settled_model),
                                       cmocka_unit_test(organ_of_10k_agrees_with_the_settled_model)};
    const struct CMUnitTest more[] = {
        cmocka_unit_test(organ_of_50k_agrees_with_the_settled_model)}; /* the long form's */
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return test_is_long() ? failed + cmocka_run_group_tests(more, NULL, NULL) : failed;
}
