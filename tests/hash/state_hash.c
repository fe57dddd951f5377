/* Prints one hash of a sequence through the library: settling, steps, contact, cutting, single and double tensors. With
 * arguments: tissue with the named effects (double only). With "combinations": every combination of them through
 * another sequence; with "pairs": combinations in which every two effects are on, off, or one of them on. Compilers and
 * processors must agree on it (plain force form, -ffp-contract=off). */
#include "../physics/combination.h"

static uint64_t of_world(const tm_world *world, uint64_t h) {
    const uint64_t now = tm_world_hash(world);
    return tm_hash(&now, sizeof now, h);
}

static bool named(int argc, char **argv, const char *effect) {
    for (int i = 1; i < argc; i++)
        if (!strcmp(argv[i], effect)) return true;
    return false;
}

/* Returns whether none, all or three of the four effects are on: these six combinations contain every state of two. */
static bool covers_pairs(int effects) {
    const int on = __builtin_popcount((unsigned)effects);
    return on == 0 || on >= 3;
}

static uint64_t of_combinations(bool pairs) {
    uint64_t h = TM_HASH_SEED;
    for (int effects = 0; effects < COMBINATIONS; effects++) {
        if (pairs && !covers_pairs(effects)) continue;
        combination c = combination_open(effects);
        while (c.frame < COMBINATION_FRAMES && combination_frame(&c)) h = of_world(c.s.world, h);
        h = tm_hash(&c.frame, sizeof c.frame, h);
        scene_destroy(&c.s);
    }
    return h;
}

int main(int argc, char **argv) {
    uint64_t h = TM_HASH_SEED;
    tm_error error;
    const bool pairs = named(argc, argv, "pairs");
    if (pairs || named(argc, argv, "combinations")) {
        printf("%016llx\n", (unsigned long long)of_combinations(pairs));
        return 0;
    }
    for (tm_precision precision = TM_DOUBLE; precision <= (argc > 1 ? TM_DOUBLE : TM_SINGLE); precision++) {
        scene_def def = scene_def_default();
        def.cells[0] = def.cells[1] = 6, def.cells[2] = 4;
        tm_mesh *mesh = scene_mesh(&def);
        double *fibre = malloc(sizeof(double) * 3 * (size_t)mesh->tet_count);
        for (int32_t i = 0; i < 3 * mesh->tet_count; i++) fibre[i] = i % 3 ? 2 / 3.0 : 1 / 3.0;
        tm_material material;
        scene_must(tm_material_engineering(3e4, 6e3, 0.4, 0.45, 5e3, &material, &error), &error);
        material.damping_1_s = 50;
        tm_tissue_def tissue = tm_tissue_def_default();
        tissue.mesh = mesh, tissue.material_count = 1, tissue.material = &material, tissue.fibre = fibre,
        tissue.precision = precision;
        tissue.form = TM_FORCE_PLAIN, tissue.cuttable = true, tissue.strain_smoothing = named(argc, argv, "volume");
        scene s = {.def = def, .mesh = mesh};
        scene_must(tm_tissue_create(&tissue, &s.tissue, &error), &error);
        tm_world_def world = tm_world_def_default();
        world.tissue = s.tissue;
        scene_must(tm_world_create(&world, &s.world, &error), &error);
        tm_viscosity_def viscosity = tm_viscosity_def_default();
        viscosity.count = 2;
        viscosity.term[0] = (tm_viscosity_term){0.01, 0.3, 0.3}, viscosity.term[1] = (tm_viscosity_term){0.1, 0.3, 0};
        if (named(argc, argv, "viscosity")) scene_must(tm_stage_viscosity(s.world, &viscosity, &error), &error);
        scene_support(&s);
        scene_must(tm_stage_gravity(s.world, (const double[3]){0, 0, -9.81}, &error), &error);
        tm_settle_def settle = tm_settle_def_default();
        scene_must(tm_world_settle(s.world, &settle, NULL, &error), &error);
        h = of_world(s.world, h);
        tm_instrument_def tool = {.mode = TM_TOOL_CAUTERY,
                                  .trocar_m = {0, 0, 0.25},
                                  .radius_m = 0.0025,
                                  .contact_length_m = 0.1,
                                  .pose = {.tip_m = {0.01, 0.005, 0.06}, .active = true}};
        tm_contact_def contact = tm_contact_def_default();
        contact.instrument_count = 1, contact.instrument = &tool;
        scene_must(tm_stage_contact(s.world, &contact, &s.contact, &error), &error);
        tm_friction_def has_friction = tm_friction_def_default();
        has_friction.instrument[0] = (tm_friction_coefficient){0.4, 0.3};
        tm_friction *made;
        if (named(argc, argv, "friction"))
            scene_must(tm_stage_friction(s.world, s.contact, &has_friction, &made, &error), &error);
        tm_cut_def cut = tm_cut_def_default();
        scene_must(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
        for (int i = 0; i < 40; i++) {
            scene_frame(&s, 0, scene_pose(0.01 + 0.0003 * i, 0.005, 0.05 - 0.0007 * i), 0.01);
            h = of_world(s.world, h);
        }
        const int32_t left = tm_tissue_alive_count(s.tissue);
        if (left == mesh->tet_count) return fprintf(stderr, "state_hash: nothing was cut\n"), 1;
        h = tm_hash(&left, sizeof left, h);
        double step_s = tm_critical_step_guaranteed(s.tissue, NULL);
        h = tm_hash(&step_s, sizeof step_s, h);
        tissue.cuttable = false;
        tm_tissue *whole = NULL;
        scene_must(tm_tissue_create(&tissue, &whole, &error), &error);
        step_s = tm_critical_step_guaranteed(whole, NULL);
        h = tm_hash(&step_s, sizeof step_s, h);
        tm_tissue_destroy(whole);
        free(fibre);
        scene_destroy(&s);
    }
    printf("%016llx\n", (unsigned long long)h);
    return 0;
}
