/* Steps a block under callgrind, for tests/effects/test_plain_step.py.
 *
 * plain_step library|driver|returned|pressed|untouched FRAMES
 * library: the world's step, isotropic, undamped, gravity-free. driver: force and integration written by hand.
 * returned: the library's step after every effect was added and removed again; prints the remaining bytes. pressed:
 * with supports, a cautery's contact, cutting, energy account and patches. untouched: the same after touch and ties
 * were added and removed again; prints the remaining bytes. */
#include "../fixture.h"

enum { SUBSTEPS = 25 };

static tm_mesh *mesh;
static tm_tissue *tissue;

static void by_hand(double *u, double *u_prev, double *u_next, double *f, const double *mobility, int substeps) {
    for (int s = 0; s < substeps; s++) {
        tm_tissue_force(tissue, u, f);
        for (int32_t v = 0; v < mesh->vertex_count; v++)
            for (int32_t i = 3 * v; i < 3 * v + 3; i++) u_next[i] = u[i] + (u[i] - u_prev[i]) + mobility[v] * f[i];
        double *oldest = u_prev;
        u_prev = u, u = u_next, u_next = oldest;
    }
}

/* Adds and removes contact of tissue, and a tie from the first vertex to the first triangle without it. */
static void touch_and_part(tm_world *world) {
    tm_error error;
    tm_touching_def touch = tm_touching_def_default();
    tm_touching *touching = NULL;
    fix_ok(tm_stage_touch(world, &touch, &touching, &error), &error);
    tm_tie tie = {.stiffness_N_m = 10};
    assert_true(tm_tie_lead(mesh, 0, mesh->surface, mesh->surface_count, &tie));
    tm_ties_def def = tm_ties_def_default();
    def.count = 1, def.tie = &tie;
    tm_ties *ties = NULL;
    fix_ok(tm_stage_ties(world, &def, &ties, &error), &error);
    fix_ok(tm_world_remove_stage(world, "ties", &error), &error);
    fix_ok(tm_world_remove_stage(world, "touch", &error), &error);
}

/* Adds and removes all effects of the library. */
static int64_t add_and_remove(tm_world *world) {
    const int64_t before = tm_memory_in_use();
    tm_error error;
    double *force = calloc(3 * (size_t)mesh->vertex_count, sizeof(double));
    const double zero[3] = {0};
    const int32_t dof[3] = {0, 1, 2};
    tm_support_def support = tm_support_def_default();
    support.count = 3, support.dof = dof, support.value_m = zero;
    tm_instrument_def tool = {.mode = TM_TOOL_CAUTERY,
                              .trocar_m = {0, 0, 0.5},
                              .radius_m = 0.0025,
                              .contact_length_m = 0.1,
                              .pose = {.tip_m = {0, 0, 0.4}}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    tm_contact *handle = NULL;
    tm_cut_def cut = tm_cut_def_default();
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    fix_ok(tm_stage_load(world, force, &error), &error);
    fix_ok(tm_stage_support(world, &support, &error), &error);
    fix_ok(tm_stage_contact(world, &contact, &handle, &error), &error);
    fix_ok(tm_stage_cut(world, handle, &cut, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    tm_grasp *hold = NULL;
    fix_ok(tm_stage_grasp(world, handle, &grasp, &hold, &error), &error);
    tm_patch_def patch = tm_patch_def_default();
    tm_patch_builder *maker = NULL;
    fix_ok(tm_stage_patch(world, handle, &patch, &maker, &error), &error);
    touch_and_part(world);
    static const char *const name[] = {"patch", "grasp", "cut", "contact", "support", "load", "gravity"};
    for (int i = 0; i < 7; i++) fix_ok(tm_world_remove_stage(world, name[i], &error), &error);
    free(force);
    return tm_memory_in_use() - before;
}

/* Holds the lower face and lowers a cautery into the upper one. */
static void press(tm_world *world) {
    tm_error error;
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)mesh->vertex_count), count = 0;
    double *zero = calloc(3 * (size_t)mesh->vertex_count, sizeof *zero);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++)
        if (mesh->rest_m[3 * (i / 3) + 2] < 1e-9) dof[count++] = i;
    tm_support_def support = tm_support_def_default();
    support.count = count, support.dof = dof, support.value_m = zero;
    fix_ok(tm_stage_support(world, &support, &error), &error);
    tm_instrument_def tool = {.mode = TM_TOOL_CAUTERY,
                              .trocar_m = {0.03, 0.025, 0.2},
                              .radius_m = 0.0025,
                              .contact_length_m = 0.1,
                              .pose = {.tip_m = {0.03, 0.025, 0.06}}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    tm_contact *handle = NULL;
    fix_ok(tm_stage_contact(world, &contact, &handle, &error), &error);
    tm_cut_def cut = tm_cut_def_default();
    fix_ok(tm_stage_cut(world, handle, &cut, &error), &error);
    fix_ok(tm_stage_energy(world, &error), &error);
    free(dof), free(zero);
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    const bool untouched = !strcmp(argv[1], "untouched"), pressed = untouched || !strcmp(argv[1], "pressed");
    const bool returned = !strcmp(argv[1], "returned"), driver = !strcmp(argv[1], "driver");
    const int frames = atoi(argv[2]);
    fix_random random = {3};
    mesh = fix_block((int[3]){6, 5, 6}, (double[3]){0.06, 0.05, 0.06}, 0.2, &random);
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.45, &material, &error), &error);
    tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, returned || pressed);
    tm_world *world = fix_world(tissue, false);
    if (returned) printf("%lld\n", (long long)add_and_remove(world));
    if (pressed) press(world);
    if (untouched) {
        const int64_t before = tm_memory_in_use();
        touch_and_part(world);
        printf("%lld\n", (long long)(tm_memory_in_use() - before));
    }
    tm_state *s = tm_world_state(world);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) s->u_m[i] = s->u_prev_m[i] = 1e-6 * fix_signed(&random);
    for (int frame = 0; frame < frames; frame++) {
        if (driver)
            by_hand(s->u_m, s->u_prev_m, s->u_next_m, s->force_N, tm_world_mobility_s2_kg(world), SUBSTEPS);
        else if (tm_world_step(world, SUBSTEPS) != TM_OK)
            return 1;
    }
    return 0;
}
