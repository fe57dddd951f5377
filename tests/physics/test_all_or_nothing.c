/* A failed step changes nothing: a number that is not finite, planted in every phase and next to every stage, leaves
 * every bit unchanged, and later steps are as without it. */
#include "../fixture.h"
#include "contact_scene.h"

static const double FRAME_S = 0.005;
enum { PHASES = 6, WORKING = 0, GRASPER = 1 }; /* the first tool cuts, or only presses */

/* Plants bad numbers at the `at`-th substep from now, in one phase. */
typedef struct plant {
    int phase, at, runs; /* at 0: none */
    int32_t dof;
    const tm_contact *contact;
    tm_tool_reaction seen; /* at the end of the spoiled substep */
    int32_t alive;
} plant;

static plant planted;

static void run_plant(void *self, tm_world *world) {
    const int phase = (int)((char *)self - (char *)&planted);
    const tm_state *state = tm_world_state(world);
    if (phase == TM_PHASE_BEGIN) planted.runs++;
    if (planted.runs == planted.at && phase == planted.phase) {
        if (phase == TM_PHASE_BEGIN) state->u_m[planted.dof] = NAN;
        if (phase == TM_PHASE_FORCE || phase == TM_PHASE_LOAD) state->force_N[planted.dof] = -INFINITY;
        if (phase == TM_PHASE_INTEGRATE) state->u_next_m[planted.dof] = NAN;
        if (phase == TM_PHASE_CONSTRAIN) state->u_next_m[planted.dof] = -1e300;
        if (phase == TM_PHASE_END) state->u_next_m[planted.dof] = 1.5e6;
    }
    if (phase != TM_PHASE_END || planted.runs != planted.at) return;
    planted.seen = tm_contact_reaction(planted.contact, 0);
    planted.alive = tm_tissue_alive_count(tm_world_tissue(world));
}

/* Moves a support, like breathing. */
static void run_breath(void *self, tm_world *world) {
    (void)self;
    const tm_state *state = tm_world_state(world);
    for (int32_t i = 0; i < 30; i++) tm_support_move(world, i, 1e-4 * sin(20 * state->time_s + i));
}

typedef struct trial {
    scene s;
    tm_grasp *grasp;
    tm_patch_builder *maker;
} trial;

static trial trial_create(tm_tool_mode first) {
    static const char *name[PHASES] = {"plant0", "plant1", "plant2", "plant3", "plant4", "plant5"};
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 6, def.cells[2] = 4;
    def.tools = 2;
    trial t = {.s = scene_create_full(&def, true, (const tm_tool_mode[2]){first, TM_TOOL_GRASPER})};
    tm_world *world = t.s.world;
    tm_error error;
    tm_stage stage = {.size = sizeof stage, .name = "breath", .phase = TM_PHASE_BEGIN, .run = run_breath};
    fix_ok(tm_world_add_stage(world, &stage, 0, &error), &error);
    tm_cut_def cut = tm_cut_def_default();
    cut.rate_1_s = 400;
    fix_ok(tm_stage_cut(world, t.s.contact, &cut, &error), &error);
    double *force = calloc(3 * (size_t)t.s.mesh->vertex_count, sizeof *force);
    force[3 * (t.s.mesh->vertex_count - 1)] = 1e-3;
    fix_ok(tm_stage_load(world, force, &error), &error);
    free(force);
    fix_ok(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    grasp.reach_m = 0.004;
    fix_ok(tm_stage_grasp(world, t.s.contact, &grasp, &t.grasp, &error), &error);
    tm_patch_def patch = tm_patch_def_default();
    fix_ok(tm_stage_patch(world, t.s.contact, &patch, &t.maker, &error), &error);
    for (int p = 0; p < PHASES; p++) {
        stage = (tm_stage){.size = sizeof stage,
                           .name = name[p],
                           .phase = (tm_phase)p,
                           .run = run_plant,
                           .self = (char *)&planted + p};
        fix_ok(tm_world_add_stage(world, &stage, 0, &error), &error);
    }
    return t;
}

/* Runs frame `i` of a sequence in which the first tool presses (and cuts); the second grasps, pulls and releases. */
static tm_status frame(trial *t, int i) {
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(t->s.world));
    tm_tool_pose working = scene_pose(0.012 + 0.0004 * i, 0.005, 0.046 - 0.0005 * (i < 28 ? i : 28));
    tm_tool_pose jaw = scene_pose(-0.012, -0.003 + 0.0001 * i, 0.044 + 0.0002 * (i > 12 ? i - 12 : 0));
    jaw.grip = i >= 6 && i < 26 ? 1 : 0;
    tm_contact_begin_frame(t->s.contact, substeps, substeps / 2);
    tm_contact_set_target(t->s.contact, WORKING, &working, substeps);
    tm_contact_set_target(t->s.contact, GRASPER, &jaw, substeps);
    return tm_world_step(t->s.world, substeps);
}

static void patches(trial *t) {
    static tm_patch patch;
    tm_patch_compute(t->maker, WORKING, &patch);
    tm_patch_compute(t->maker, GRASPER, &patch);
}

/* Hashes the complete observable state of a world part by part, so that a difference names its part. */
enum { MOTION, FORCE, SNAPSHOT, STIFFNESS, MASS, SURFACE, SUPPORT, HELD, ROWS, PARTS };
static const char *part_name[PARTS] = {"u and u_prev", "force",    "snapshot",     "tensors", "masses",
                                       "surface",      "supports", "what is held", "rows"};

static void look(trial *t, uint64_t part[PARTS]) {
    const tm_mesh *mesh = t->s.mesh;
    const size_t n = (size_t)mesh->vertex_count;
    const tm_state *state = tm_world_state(t->s.world);
    double K[9], *reaction = calloc(3 * n, sizeof *reaction);
    tm_error error;
    for (int i = 0; i < PARTS; i++) part[i] = TM_HASH_SEED;
    part[MOTION] = tm_world_hash(t->s.world);
    part[FORCE] = tm_hash(state->force_N, 24 * n, TM_HASH_SEED);
    const int64_t bytes = tm_snapshot_bytes(t->s.world);
    void *snapshot = aligned_alloc(64, (size_t)(bytes + 63) / 64 * 64);
    fix_ok(tm_snapshot_save(t->s.world, snapshot, bytes, &error), &error); /* step and time too */
    part[SNAPSHOT] = tm_hash(snapshot, (size_t)bytes, TM_HASH_SEED);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(t->s.tissue, v, K);
        part[STIFFNESS] = tm_hash(K, sizeof K, part[STIFFNESS]);
    }
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        tm_tissue_edge_tensor(t->s.tissue, e, K);
        part[STIFFNESS] = tm_hash(K, sizeof K, part[STIFFNESS]);
    }
    part[MASS] = tm_hash(tm_tissue_mass_kg(t->s.tissue), 8 * n, TM_HASH_SEED);
    part[MASS] = tm_hash(tm_tissue_damping_kg_s(t->s.tissue), 8 * n, part[MASS]);
    part[MASS] = tm_hash(tm_world_mobility_s2_kg(t->s.world), 8 * n, part[MASS]);
    const tm_surface_view surface = tm_tissue_surface(t->s.tissue);
    part[SURFACE] = tm_hash(surface.triangle, 12 * (size_t)surface.count, TM_HASH_SEED);
    part[SURFACE] = tm_hash(surface.face, 4 * (size_t)surface.count, part[SURFACE]);
    part[SURFACE] = tm_hash(&surface.revision, sizeof surface.revision, part[SURFACE]);
    part[SURFACE] = tm_hash(tm_tissue_alive(t->s.tissue), (size_t)mesh->tet_count, part[SURFACE]);
    tm_support_reaction(t->s.world, reaction);
    part[SUPPORT] = tm_hash(reaction, 24 * n, TM_HASH_SEED);
    const int32_t *vertex;
    tm_grasp_state grasp;
    const int32_t held = tm_grasp_vertices(t->grasp, GRASPER, &vertex, &grasp);
    part[HELD] = tm_hash(vertex, sizeof *vertex * (size_t)held, tm_hash(&grasp, sizeof grasp, TM_HASH_SEED));
    for (int i = 0; i < 2; i++) {
        const tm_tool_reaction r = tm_contact_reaction(t->s.contact, i);
        const tm_tool_pose pose = tm_contact_pose(t->s.contact, i);
        part[ROWS] = tm_hash(r.force_N, sizeof r.force_N, part[ROWS]);
        part[ROWS] = tm_hash(r.resultant_N, sizeof r.resultant_N, part[ROWS]);
        part[ROWS] = tm_hash(&r.flags, sizeof r.flags, tm_hash(r.stiffness_N_m, sizeof r.stiffness_N_m, part[ROWS]));
        part[ROWS] = tm_hash(pose.tip_m, sizeof pose.tip_m, part[ROWS]);
    }
    free(snapshot);
    free(reaction);
}

static void same(const uint64_t a[PARTS], const uint64_t b[PARTS], const char *where, int phase, int at, int i) {
    for (int p = 0; p < PARTS; p++)
        if (a[p] != b[p]) fail_msg("%s: %s differ (frame %d, phase %d, substep %d)", where, part_name[p], i, phase, at);
}

/* Runs the same sequence twice, the second time with failures between and within the frames; a failed frame is
 * repeated. */
static void nothing_happens(tm_tool_mode first, bool *cut_in_vain) {
    trial plain = trial_create(first), shaken = trial_create(first);
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(plain.s.world));
    const int32_t places[3] = {1, substeps / 2, substeps};
    int32_t tet[2][64];
    int phase = 0, place = 0, held = 0, fading = 0, cuts = 0, told = 0, in_vain = 0;
    planted = (plant){0};
    for (int i = 0; i < 36; i++) {
        uint64_t before[PARTS], after[PARTS], twin[PARTS];
        for (int k = 0; k < 6; k++) {
            const tm_contact_row *row;
            look(&shaken, before);
            planted = (plant){.phase = phase, .at = places[place], .contact = shaken.s.contact};
            planted.dof = 3 * (shaken.s.mesh->vertex_count - 1) + 1; /* a corner, or under the tool */
            if (k % 2 && tm_contact_rows(shaken.s.contact, &row) > 0) planted.dof = 3 * row[0].vertex[0] + 2;
            const bool touched = tm_contact_reaction(shaken.s.contact, WORKING).row_count > 0;
            assert_int_equal(frame(&shaken, i), TM_ERR_UNSTABLE);
            assert_int_equal(planted.runs, planted.at); /* it stopped at once */
            in_vain += planted.alive < tm_tissue_alive_count(shaken.s.tissue);
            for (int c = 0; c < 3; c++) assert_true(isfinite(planted.seen.force_N[c]));
            if (touched && k % 2 && phase == TM_PHASE_INTEGRATE && planted.at == 1 && first == TM_TOOL_PROBE) {
                assert_true(planted.seen.flags & TM_REACTION_UNSTABLE);
                told++;
            }
            /* The frame's begin and the new paths are set by the caller before the step: setting them again changes
             * nothing. */
            planted.at = 0;
            const tm_tool_pose a = tm_contact_pose(shaken.s.contact, 0), b = tm_contact_pose(plain.s.contact, 0);
            assert_memory_equal(a.tip_m, b.tip_m, sizeof a.tip_m);
            look(&shaken, after);
            before[SNAPSHOT] = after[SNAPSHOT]; /* paths and sums were set again; compared below with the twin */
            before[ROWS] = after[ROWS];
            same(before, after, "given back", phase, places[place], i);
            place = (place + 1) % 3;
            if (place == 0) phase = (phase + 1) % PHASES;
        }
        assert_int_equal(frame(&shaken, i), TM_OK);
        assert_int_equal(frame(&plain, i), TM_OK);
        patches(&shaken), patches(&plain);
        look(&plain, twin);
        look(&shaken, after);
        same(twin, after, "twin", phase, places[place], i);
        const int32_t n = tm_cut_fetch_removed(plain.s.world, tet[0], NULL, 64);
        assert_int_equal(tm_cut_fetch_removed(shaken.s.world, tet[1], NULL, 64), n);
        assert_memory_equal(tet[0], tet[1], sizeof(int32_t) * (size_t)n);
        tm_grasp_state state;
        held += tm_grasp_vertices(shaken.grasp, GRASPER, NULL, &state) > 0 && state == TM_GRASP_HOLDING;
        fading += state == TM_GRASP_RELEASING;
        cuts += n;
    }
    assert_true(held > 10 && fading > 3 && (told > 0 || first != TM_TOOL_PROBE));
    print_message("  %d cut, in %d failed frames something\n", cuts, in_vain);
    *cut_in_vain = cuts > 10 && in_vain > 20;
    scene_destroy(&plain.s);
    scene_destroy(&shaken.s);
}

static void failed_step_with_a_probe_changes_nothing(void **state) {
    (void)state;
    bool cut;
    nothing_happens(TM_TOOL_PROBE, &cut);
    assert_false(cut);
}

static void failed_step_with_a_cautery_changes_nothing(void **state) {
    (void)state;
    bool cut;
    nothing_happens(TM_TOOL_CAUTERY, &cut);
    assert_true(cut);
}

/* Nothing changes between two steps: the complete snapshot must be equal. */
static void failed_step_leaves_the_snapshot_bit_identical(void **state) {
    (void)state;
    for (tm_tool_mode first = TM_TOOL_PROBE; first <= TM_TOOL_CAUTERY; first += TM_TOOL_CAUTERY) {
        trial t = trial_create(first);
        uint64_t before[PARTS], after[PARTS];
        planted = (plant){0};
        for (int i = 0; i < 30; i++) {
            assert_int_equal(frame(&t, i), TM_OK);
            patches(&t);
            for (int phase = 0; phase < PHASES; phase++) {
                look(&t, before);
                planted = (plant){
                    .phase = phase, .at = 40, .contact = t.s.contact, .dof = 3 * (t.s.mesh->vertex_count - 1 - i)};
                assert_int_equal(tm_world_step(t.s.world, 50), TM_ERR_UNSTABLE);
                planted.at = 0;
                look(&t, after);
                same(before, after, "whole", phase, 40, i);
            }
        }
        scene_destroy(&t.s);
    }
}

static void nan_gives_no_contact_force(void **state) {
    (void)state;
    assert_true(tm_contact_compliance_reaction(5e-4, 2.5e-3, NAN, 1e-4, 50) == 0);
    assert_true(tm_contact_compliance_reaction(5e-4, 2.5e-3, -1e-3, NAN, 50) == 0);
    assert_true(tm_contact_compliance_reaction(NAN, 2.5e-3, -1e-3, 1e-4, 50) == 0);
    assert_true(tm_contact_compliance_reaction(5e-4, 2.5e-3, -1e-3, 1e-4, 50) > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(failed_step_with_a_probe_changes_nothing),
                                       cmocka_unit_test(failed_step_with_a_cautery_changes_nothing),
                                       cmocka_unit_test(failed_step_leaves_the_snapshot_bit_identical),
                                       cmocka_unit_test(nan_gives_no_contact_force)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
