/* Timers of corotational, viscous tissue: each effect is attributed its own part of shared passes. Compared within
 * one run, worlds interleaved, minimum of several. */
#include <math.h>

#include "../fixture.h"
#include "material/bulk.h"
#include "world/world_internal.h"

enum { ROUNDS = 9, STEPS = 130 }; /* more than two comparisons of a run */

static const tm_viscosity_term ALIKE[1] = {{0.2, 0.4, 0.4}}, SHEAR[1] = {{0.2, 0.4, 0}};

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
} body;

/* Tissue rotated by a radian, so that every tetrahedron that can be corrected is. */
static body make(bool turned, const tm_viscosity_term *term) {
    fix_random random = {5};
    body b = {.mesh = fix_block((int[]){6, 6, 6}, (double[]){0.06, 0.06, 0.06}, 0.1, &random)};
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.4, &m, &error), &error);
    m.damping_1_s = 40;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b.mesh, def.material_count = 1, def.material = &m, def.rotation = turned ? TM_ROTATION_THRESHOLD : 0;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    b.world = fix_world(b.tissue, true);
    if (turned) {
        tm_state *s = tm_world_state(b.world);
        for (int32_t v = 0; v < b.mesh->vertex_count; v++) {
            const double *x = b.mesh->rest_m + 3 * v, c = cos(1), k = sin(1);
            s->u_m[3 * v] = s->u_prev_m[3 * v] = c * x[0] - k * x[1] - x[0];
            s->u_m[3 * v + 1] = s->u_prev_m[3 * v + 1] = k * x[0] + c * x[1] - x[1];
        }
        fix_ok(tm_stage_rotation(b.world, NULL, &error), &error);
    }
    if (!term) return b;
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 1, viscosity.term[0] = *term;
    fix_ok(tm_stage_viscosity(b.world, &viscosity, &error), &error);
    return b;
}

static void destroy(body *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
}

typedef struct spent {
    double force, rotation, strain, viscosity;
} spent;

static spent read_times(const body *b) {
    tm_stage_report report[TM_MAX_STAGES];
    spent s = {0};
    const int32_t count = tm_world_stages(b->world, report);
    for (int32_t i = 0; i < count; i++) {
        if (!strcmp(report[i].name, "force")) s.force = report[i].seconds;
        if (!strcmp(report[i].name, "rotation")) s.rotation = report[i].seconds;
        if (!strcmp(report[i].name, "viscous strain") || !strcmp(report[i].name, "viscous bulk"))
            s.strain += report[i].seconds;
        if (!strcmp(report[i].name, "viscosity")) s.viscosity = report[i].seconds;
    }
    return s;
}

static void run_in_turns(body *b, int count, spent *least) {
    for (int i = 0; i < count; i++) {
        tm_world_set_timing(b[i].world, true);
        least[i] = (spent){1e9, 1e9, 1e9, 1e9};
    }
    for (int round = 0; round < ROUNDS; round++)
        for (int i = 0; i < count; i++) {
            const spent a = read_times(&b[i]);
            fix_ok(tm_world_step(b[i].world, STEPS), NULL);
            const spent z = read_times(&b[i]);
            least[i].force = fmin(least[i].force, z.force - a.force);
            least[i].rotation = fmin(least[i].rotation, z.rotation - a.rotation);
            least[i].strain = fmin(least[i].strain, z.strain - a.strain);
            least[i].viscosity = fmin(least[i].viscosity, z.viscosity - a.viscosity);
        }
}

static void elastic_part_is_attributed_to_rotation(void **state) {
    (void)state;
    body b[2] = {make(true, NULL), make(true, SHEAR)};
    spent s[2];
    run_in_turns(b, 2, s);
    const double alone = s[0].force + s[0].rotation, both = s[1].rotation;
    print_message("rotation alone %.3g ms with the force pass; with viscosity %.3g ms, and that %.3g ms\n", 1e3 * alone,
                  1e3 * both, 1e3 * s[1].viscosity);
    assert_true(both > 0.2 * alone &&
                both < 5 * alone); /* placement of arrays in memory makes worlds differ by a factor of two */
    assert_true(s[1].viscosity > 0.05 * both && s[1].viscosity < 5 * both);
    for (int i = 0; i < 2; i++) destroy(&b[i]);
}

static void bulk_pass_of_unlike_shares_is_attributed_to_viscosity(void **state) {
    (void)state;
    body b[3] = {make(false, NULL), make(false, ALIKE), make(false, SHEAR)};
    spent s[3];
    run_in_turns(b, 3, s);
    print_message("force alone %.3g ms, with viscosity %.3g and %.3g ms; its strain %.3g and %.3g ms\n",
                  1e3 * s[0].force, 1e3 * s[1].force, 1e3 * s[2].force, 1e3 * s[1].strain, 1e3 * s[2].strain);
    assert_true(s[1].force < 2.5 * s[0].force && s[2].force < 2.5 * s[0].force);
    assert_true(s[2].strain > 4 * s[1].strain);
    for (int i = 0; i < 3; i++) destroy(&b[i]);
}

/* The timers' extra passes change no bit and advance no history variable. */
static void timers_change_no_bit(void **state) {
    (void)state;
    body b[2] = {make(true, SHEAR), make(true, SHEAR)};
    tm_world_set_timing(b[1].world, true);
    for (int i = 0; i < 2; i++) fix_ok(tm_world_step(b[i].world, STEPS), NULL);
    assert_true(tm_world_hash(b[0].world) == tm_world_hash(b[1].world));
    for (int i = 0; i < 2; i++) destroy(&b[i]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(elastic_part_is_attributed_to_rotation),
        cmocka_unit_test(bulk_pass_of_unlike_shares_is_attributed_to_viscosity),
        cmocka_unit_test(timers_change_no_bit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
