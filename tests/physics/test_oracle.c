/* Three laws, three loads each, against solutions of other programs (oracle/README.md). */
#include "oracle.h"

/* Clamps x = 0; moves the face x = x_max too if `press`. */
static void support(tm_world *world, const oracle *o, const double *press) {
    int32_t *dof = malloc(sizeof(int32_t) * 3 * (size_t)o->vertex_count), n = 0;
    double *value = malloc(sizeof(double) * 3 * (size_t)o->vertex_count), far = 0;
    for (int32_t v = 0; v < o->vertex_count; v++) far = fmax(far, o->vertex[3 * v]);
    for (int32_t i = 0; i < 3 * o->vertex_count; i++) {
        const double x = o->vertex[3 * (i / 3)];
        if (x > 1e-12 && !(press && x > far - 1e-12)) continue;
        dof[n] = i;
        value[n++] = x > 1e-12 ? press[i % 3] : 0;
    }
    tm_support_def def = tm_support_def_default();
    def.count = n, def.dof = dof, def.value_m = value;
    tm_error error;
    fix_ok(tm_stage_support(world, &def, &error), &error);
    free(dof), free(value);
}

static void check_case(const oracle *o, int kase, tm_tissue *tissue, double tolerance) {
    tm_error error;
    tm_world *world = fix_world(tissue, true);
    support(world, o, kase == 1 ? o->press : NULL);
    if (kase == 0) fix_ok(tm_stage_gravity(world, o->g, &error), &error);
    if (kase == 2) {
        double *force = calloc(3 * (size_t)o->vertex_count, sizeof(double));
        memcpy(force + 3 * o->poke_vertex, o->poke, sizeof o->poke);
        fix_ok(tm_stage_load(world, force, &error), &error);
        free(force);
    }
    tm_settle_def settle = tm_settle_def_default();
    settle.tolerance = 1e-11;
    tm_settle_result result;
    fix_ok(tm_world_settle(world, &settle, &result, &error), &error);

    const double *u = tm_world_state(world)->u_m, most = fix_largest(o->u[kase], 3 * o->vertex_count);
    double worst = 0, clamp[3] = {0}, tip[3] = {0}, largest = 0, off = 0;
    for (int32_t i = 0; i < 3 * o->vertex_count; i++) worst = fmax(worst, fabs(u[i] - o->u[kase][i]) / most);
    double *reaction = calloc(3 * (size_t)o->vertex_count, sizeof(double));
    tm_support_reaction(world, reaction);
    for (int32_t i = 0; i < 3 * o->vertex_count; i++)
        *(o->vertex[3 * (i / 3)] < 1e-12 ? clamp + i % 3 : tip + i % 3) += reaction[i];
    for (int i = 0; i < 3; i++) largest = fmax(largest, fabs(o->clamp[kase][i]));
    for (int i = 0; i < 3; i++)
        off = fmax(off, fmax(fabs(clamp[i] - o->clamp[kase][i]), fabs(tip[i] - o->tip[kase][i])) / largest);
    const double energy = fabs(result.energy_J / o->energy[kase] - 1);
    print_message("  case %d: displacement %.1e, reaction %.1e, energy %.1e, %lld steps\n", kase, worst, off, energy,
                  (long long)result.steps);
    assert_true(worst <= tolerance);
    assert_true(off <= tolerance);
    assert_true(energy <= 10 * tolerance);
    free(reaction);
    tm_world_destroy(world);
}

static void check_set(const char *name) {
    oracle o = {0};
    oracle_load(name, &o);
    tm_material material[2];
    tm_error error;
    int laws = 1;
    fix_ok(tm_material_five(o.lame[0], o.lame[1], o.lame[2], o.lame[3], o.lame[4], material, &error), &error);
    if (!strcmp(name, "iso")) laws = 2, fix_ok(tm_material_young(10e3, 0.45, material + 1, &error), &error);
    if (!strcmp(name, "fibre"))
        laws = 2, fix_ok(tm_material_paper(o.lame[0], o.lame[1], o.lame[2], o.lame[3], material + 1, &error), &error);
    if (o.engineering[0] > 0) {
        const double *e = o.engineering;
        laws = 2, fix_ok(tm_material_engineering(e[0], e[1], e[2], e[3], e[4], material + 1, &error), &error);
    }
    assert_int_equal(laws, 2);
    for (int law = 0; law < laws; law++)
        for (tm_precision precision = TM_DOUBLE; precision <= TM_SINGLE; precision++) {
            material[law].density_kg_m3 = o.density;
            print_message("%s, constants %d, %s\n", name, law, precision == TM_DOUBLE ? "double" : "single");
            tm_tissue *tissue = fix_tissue(o.mesh, material + law,
                                           tm_material_is_isotropic(material + law) ? NULL : o.fibre, precision, false);
            for (int kase = 0; kase < 3; kase++) check_case(&o, kase, tissue, precision == TM_DOUBLE ? 1e-7 : 1e-4);
            tm_tissue_destroy(tissue);
        }
    oracle_unload(&o);
    assert_int_equal(tm_memory_in_use(), 0);
}

static void isotropic_law_agrees_with_reference(void **state) { (void)state, check_set("iso"); }
static void paper_law_agrees_with_reference(void **state) { (void)state, check_set("fibre"); }
static void engineering_constants_agree_with_reference(void **state) { (void)state, check_set("muscle"); }

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(isotropic_law_agrees_with_reference),
                                       cmocka_unit_test(paper_law_agrees_with_reference),
                                       cmocka_unit_test(engineering_constants_agree_with_reference)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
