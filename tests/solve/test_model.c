/* One definition, three models, the same calls: frames, reactions, surface, patches, rest and snapshots; unsupported
 * calls are reported. */
#include "../physics/contact_scene.h"
#include "kit.h"

enum { DYNAMIC, PRECOMPUTED, HYBRID, MODELS };
static const char *const model_name[MODELS] = {"dynamic", "precomputed", "hybrid"};

typedef struct organ {
    tm_mesh *mesh;
    tm_material material;
    tm_instrument_def tool;
    tm_contact_def contact;
    tm_grasp_def grasp;
    tm_cut_def cut;
    int32_t *dof;
    double *zero;
    uint8_t *dynamic; /* of the hybrid */
    const char *invalid_member;
    tm_model_def def;
} organ;

static const tm_tool_pose above = {.tip_m = {0.008, 0.003, 0.050}, .active = true},
                          down = {.tip_m = {0.008, 0.003, 0.0405}, .active = true};

/* A block fixed at its bottom, half of which the hybrid condenses. */
static void make_organ(organ *o, tm_tool_mode mode) {
    static const double g[3] = {0, 0, -9.81};
    scene_def block = scene_def_default();
    block.cells[0] = block.cells[1] = 8, block.cells[2] = 5;
    *o = (organ){.mesh = scene_mesh(&block), .material = kit_material(block.young_Pa, block.poisson)};
    const tm_mesh *mesh = o->mesh;
    o->material.damping_1_s = 150;
    o->tool = (tm_instrument_def){
        .mode = mode, .radius_m = block.radius_m, .contact_length_m = block.length_m, .pose = above};
    memcpy(o->tool.trocar_m, block.trocar_m[0], sizeof o->tool.trocar_m);
    o->contact = tm_contact_def_default();
    o->contact.instrument_count = 1;
    o->contact.instrument = &o->tool;
    o->grasp = tm_grasp_def_default();
    o->cut = tm_cut_def_default();
    o->dof = malloc(sizeof *o->dof * 3 * (size_t)mesh->vertex_count);
    o->zero = calloc(3 * (size_t)mesh->vertex_count, sizeof *o->zero);
    o->dynamic = malloc((size_t)mesh->tet_count);
    o->def = tm_model_def_default();
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++)
        if (mesh->rest_m[d / 3 * 3 + 2] < 1e-9) o->dof[o->def.support_count++] = d;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x = 0;
        for (int i = 0; i < 4; i++) x += mesh->rest_m[3 * mesh->tet[4 * t + i]] / 4;
        o->dynamic[t] = x > 0;
    }
    o->def.tissue.mesh = mesh;
    o->def.tissue.material_count = 1;
    o->def.tissue.material = &o->material;
    o->def.tissue.form = TM_FORCE_PLAIN;
    o->def.support_dof = o->dof;
    o->def.support_m = o->zero;
    o->def.gravity_m_s2 = g;
    o->def.contact = &o->contact;
    if (mode == TM_TOOL_GRASPER) o->def.grasp = &o->grasp;
    if (mode == TM_TOOL_CAUTERY) o->def.cut = &o->cut;
    o->def.frame_s = 0.04;
    o->def.invalid_member = &o->invalid_member;
}

static void free_organ(organ *o) {
    free(o->dof), free(o->zero), free(o->dynamic);
    tm_mesh_destroy(o->mesh);
}

static tm_status try_make(organ *o, int which, tm_model **model, tm_error *error) {
    tm_precomputed_def precomputed = tm_precomputed_def_default();
    tm_hybrid_def hybrid = tm_hybrid_def_default();
    hybrid.dynamic = o->dynamic;
    *model = NULL;
    return which == DYNAMIC       ? tm_model_dynamic(&o->def, model, error)
           : which == PRECOMPUTED ? tm_model_precomputed(&o->def, &precomputed, model, NULL, error)
                                  : tm_model_hybrid(&o->def, &hybrid, model, NULL, error);
}

static tm_model *make(organ *o, int which) {
    tm_model *model;
    tm_error error;
    fix_ok(try_make(o, which, &model, &error), &error);
    return model;
}

static void go(tm_model *model, const tm_tool_pose *to, int frames) {
    for (int i = 0; i < frames; i++) {
        assert_int_equal(tm_model_frame(model, to), TM_OK);
        assert_true(tm_model_snapshot_bytes(model) <= tm_model_snapshot_bytes_max(model));
    }
}

/* Exact compliance for the dynamic model; the other models have their own. */
static void allow_patches(organ *o, tm_model *model) {
    tm_error error;
    tm_patch_def def = tm_patch_def_default();
    tm_compliance_source source;
    def.horizon_s = 0;
    if (!model->kind->knows_compliance) {
        uint8_t *fixed = calloc(3 * (size_t)o->mesh->vertex_count, 1);
        tm_compliance_factor *factored;
        for (int32_t i = 0; i < o->def.support_count; i++) fixed[o->dof[i]] = 1;
        tm_compliance_factor_def exact = tm_compliance_factor_def_default();
        exact.tissue = model->tissue;
        exact.fixed = fixed;
        fix_ok(tm_compliance_factor_create(&exact, &factored, &error), &error);
        free(fixed);
        source = tm_compliance_factor_owned_source(factored);
        def.source = &source;
    }
    fix_ok(tm_model_allow_patches(model, &def, &error), &error);
}

/* Returns the force that a controller computes from the patch with its tool there. */
static void felt_at(const tm_patch *patch, const double tip_m[3], double force_N[3]) {
    tm_patch_solver *solver;
    tm_error error;
    bool inside;
    fix_ok(tm_patch_solver_create(&solver, &error), &error);
    tm_patch_force(solver, patch, tip_m, force_N, &inside);
    assert_true(inside);
    tm_patch_solver_destroy(solver);
}
static void felt(const tm_patch *patch, double force_N[3]) { felt_at(patch, down.tip_m, force_N); }

static bool get_patch(tm_model *model, tm_patch *patch) {
    bool made = false;
    for (int i = 0; i < 6 && !made; i++) made = tm_model_patch(model, 0, patch) && patch->kind == 2;
    return made;
}

static double off(const double *a, const double *b, int n) {
    double worst = 0;
    for (int i = 0; i < n; i++) worst = fmax(worst, fabs(a[i] - b[i]));
    return worst / fix_largest(b, n);
}

/* The same calls on all three: at rest they agree. */
static void three_models_agree_at_rest(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    tm_tool_reaction reaction[MODELS];
    static tm_patch patch;
    for (int m = 0; m < MODELS; m++) {
        tm_model *model = make(&o, m);
        double force[3];
        assert_string_equal(model->kind->name, model_name[m]);
        assert_true(model->timing.frame_s == 0.04 && model->timing.substeps >= 1);
        assert_int_equal(tm_model_alive(model), o.mesh->tet_count);
        assert_int_equal(tm_model_surface(model).count, o.mesh->surface_count);
        assert_false(tm_model_patch(model, 0, &patch)); /* not permitted yet */
        allow_patches(&o, model);
        go(model, &above, 2);
        assert_true(fix_largest(tm_model_reaction(model, 0).force_N, 3) == 0);
        go(model, &down, 60);
        assert_true(fabs(tm_model_time_s(model) - 62 * 0.04) < 1e-9);
        assert_true(get_patch(model, &patch));
        reaction[m] = tm_model_reaction(model, 0);
        felt(&patch, force);
        print_message("  %-11s %.4f N on %d rows; patch off by %.1e\n", model_name[m],
                      fix_largest(reaction[m].force_N, 3), reaction[m].row_count, off(force, reaction[m].force_N, 3));
        assert_true(reaction[m].row_count > 0 && fix_largest(reaction[m].force_N, 3) > 0.05);
        assert_int_equal(reaction[m].stiffness_kind, 2);
        assert_int_equal(patch.kind, 2);
        assert_int_equal(patch.topology_revision, tm_model_surface(model).revision);
        assert_true(off(force, reaction[m].force_N, 3) < 1e-4);
        assert_true(off(reaction[m].force_N, reaction[0].force_N, 3) < 1e-4);
        assert_true(off(reaction[m].stiffness_N_m, reaction[0].stiffness_N_m, 9) < 2e-2);
        tm_model_destroy(model);
    }
    free_organ(&o);
}

/* A frame in several pieces equals the frame, and a tool whose pose is set does not sweep. */
static void frame_in_several_calls_equals_the_frame(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    for (int m = 0; m < MODELS; m++) {
        tm_model *whole = make(&o, m), *cut_up = make(&o, m);
        for (int k = 0; k < 4; k++) {
            go(whole, k ? &down : &above, 1);
            tm_model_begin(cut_up, k ? &down : &above, cut_up->timing.substeps);
            for (int32_t done = 0; done < cut_up->timing.substeps; done += 3) {
                const int32_t left = cut_up->timing.substeps - done;
                assert_int_equal(tm_model_step(cut_up, left < 3 ? left : 3), TM_OK);
            }
            tm_model_end(cut_up);
        }
        const tm_tool_reaction a = tm_model_reaction(whole, 0), b = tm_model_reaction(cut_up, 0);
        assert_true(tm_model_hash(whole) == tm_model_hash(cut_up));
        assert_memory_equal(a.force_N, b.force_N, sizeof a.force_N);
        assert_true(fix_largest(a.force_N, 3) > 0.01);
        tm_model_set_pose(whole, 0, &above);
        go(whole, &above, 1);
        assert_true(fix_largest(tm_model_reaction(whole, 0).force_N, 3) < fix_largest(a.force_N, 3));
        tm_model_destroy(whole);
        tm_model_destroy(cut_up);
    }
    free_organ(&o);
}

/* Both do the same: every frame, its reaction and its patch are bit-identical. */
static void go_on_alike(tm_model *model, tm_model *other, const tm_tool_pose *to, int frames) {
    for (int i = 0; i < frames; i++) {
        go(model, to, 1);
        go(other, to, 1);
        const tm_tool_reaction a = tm_model_reaction(model, 0), b = tm_model_reaction(other, 0);
        assert_true(tm_model_hash(model) == tm_model_hash(other) && tm_model_time_s(model) == tm_model_time_s(other));
        assert_memory_equal(a.force_N, b.force_N, sizeof a.force_N);
        assert_memory_equal(a.resultant_N, b.resultant_N, sizeof a.resultant_N);
        assert_true(a.flags == b.flags && a.row_count == b.row_count);
    }
}

/* Restores a snapshot of `model` in `other`, which has another state; a truncated or damaged one changes nothing. */
static void hand_over(tm_model *model, tm_model *other) {
    tm_error error;
    const int64_t bytes = tm_model_snapshot_bytes(model), own = tm_model_snapshot_bytes(other);
    assert_true(tm_model_snapshot_bytes_max(model) == tm_model_snapshot_bytes_max(other)); /* at any position */
    unsigned char *buffer = malloc((size_t)bytes), *before = malloc((size_t)own), *after = malloc((size_t)own);
    fix_ok(tm_model_save(model, buffer, bytes, &error), &error);
    fix_ok(tm_model_save(other, before, own, &error), &error);
    assert_int_not_equal(tm_model_save(model, buffer, bytes - 1, &error), TM_OK);
    assert_int_not_equal(tm_model_restore(other, buffer, bytes - 8, &error), TM_OK);
    for (int64_t i = 0; i < 64; i++) {
        const int64_t at = i * (bytes - 1) / 63;
        buffer[at] ^= 1;
        assert_int_not_equal(tm_model_restore(other, buffer, bytes, &error), TM_OK);
        assert_true(strchr(error.message, ';') != NULL);
        buffer[at] ^= 1;
    }
    assert_int_equal(tm_model_snapshot_bytes(other), own);
    fix_ok(tm_model_save(other, after, own, &error), &error);
    assert_memory_equal(before, after, (size_t)own);
    fix_ok(tm_model_restore(other, buffer, bytes, &error), &error);
    const tm_tool_reaction a = tm_model_reaction(model, 0), b = tm_model_reaction(other, 0);
    assert_true(tm_model_hash(model) == tm_model_hash(other));
    assert_memory_equal(a.force_N, b.force_N, sizeof a.force_N);
    assert_true(a.time_s == b.time_s && a.flags == b.flags && a.row_count == b.row_count);
    free(buffer), free(before), free(after);
}

/* A saved state continues with the same bits, also in a model with another history. */
static void snapshot_goes_on_with_the_same_bits(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    for (int m = 0; m < MODELS; m++) {
        const tm_tool_pose aside = {.tip_m = {0.012, 0.001, 0.0410}, .active = true};
        tm_model *model = make(&o, m), *other = make(&o, m);
        go(model, &above, 1);
        go(model, &down, 3);
        hand_over(model, other);
        go_on_alike(model, other, &aside, 3);
        assert_true(fix_largest(tm_model_reaction(model, 0).force_N, 3) > 0.01);
        tm_model_destroy(model);
        tm_model_destroy(other);
    }
    free_organ(&o);
}

/* While jaws grasp, and while a release fades. */
static void snapshots_while_grasping_continue_identically(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_GRASPER);
    for (int m = 0; m < MODELS; m++) {
        tm_tool_pose at = down;
        tm_model *model = make(&o, m), *other = make(&o, m), *third = make(&o, m);
        go(model, &above, 1);
        go(model, &at, 2);
        at.grip = 1;
        go(model, &at, 2);
        at.tip_m[2] += 0.004;
        go(model, &at, 1);
        assert_true(tm_model_reaction(model, 0).force_N[2] < -0.01);
        hand_over(model, other);
        at.tip_m[0] += 0.002;
        go_on_alike(model, other, &at, 2);
        at.grip = 0;
        go(other, &at, 1);
        go(model, &at, 1);
        hand_over(other, third);
        at.tip_m[2] += 0.001;
        go_on_alike(model, third, &at, 4);
        tm_model_destroy(model);
        tm_model_destroy(other);
        tm_model_destroy(third);
    }
    free_organ(&o);
}

/* Jaws that open in the first frame after the snapshot: the released force is the grasp's less a second tool's force
 * there. */
static void snapshot_before_a_release_continues_identically(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_GRASPER);
    tm_instrument_def two[2] = {o.tool, o.tool};
    two[1].mode = TM_TOOL_PROBE;
    o.contact.instrument = two, o.contact.instrument_count = 2;
    tm_model *model = make(&o, PRECOMPUTED), *other = make(&o, PRECOMPUTED);
    tm_tool_pose at[2] = {above, above};
    at[0] = down, at[1].tip_m[0] = 0.002;
    go(model, at, 2);
    at[0].grip = 1;
    go(model, at, 1);
    at[1].tip_m[2] = 0.039;
    go(model, at, 1);
    assert_true(fix_largest(tm_model_reaction(model, 1).force_N, 3) > 0.01);
    hand_over(model, other);
    at[0].grip = 0;
    go_on_alike(model, other, at, 3);
    tm_model_destroy(model);
    tm_model_destroy(other);
    free_organ(&o);
}

/* Returns how far the only tool is held back across its normal. */
static double held_back_N(tm_model *model) { return fabs(tm_model_reaction(model, 0).force_N[0]); }

/* While the probe sticks and while it slides, friction's displacement continues with the same bits, in patches too. */
static void snapshot_with_friction_continues_identically(void **state) {
    (void)state;
    organ o;
    tm_error error;
    tm_friction_def friction = tm_friction_def_default();
    make_organ(&o, TM_TOOL_PROBE);
    tm_model *without = make(&o, PRECOMPUTED);
    friction.instrument[0] = (tm_friction_coefficient){.mu_static = 0.4, .mu_kinetic = 0.2};
    o.def.friction = &friction;
    tm_model *model = make(&o, PRECOMPUTED), *other = make(&o, PRECOMPUTED), *third = make(&o, PRECOMPUTED);
    static tm_patch a, b;
    tm_tool_pose at = down;
    for (int i = 0; i < 3; i++) allow_patches(&o, i == 0 ? model : i == 1 ? other : third);
    go(other, &at, 2); /* friction there too, with its own coefficients */
    go(model, &above, 1);
    go(model, &at, 4);
    at.tip_m[0] += 0.0001;
    go(model, &at, 1); /* displaced, and sticks */
    const double stuck = held_back_N(model);
    assert_true(stuck > 0.01);
    hand_over(model, other);
    assert_true(get_patch(model, &a) && get_patch(other, &b));
    assert_memory_equal(&a, &b, sizeof a);
    go_on_alike(model, other, &at, 3);
    assert_true(fabs(held_back_N(model) - stuck) < 1e-3 * stuck);
    for (int i = 0; i < 6; i++) {
        at.tip_m[0] -= 0.0005;
        go_on_alike(model, other, &at, 1);
    }
    const double slid = held_back_N(model);
    assert_true(slid > 0.01);
    hand_over(other, third); /* slides */
    for (int i = 0; i < 4; i++) {
        at.tip_m[i % 2] += 0.0006;
        go_on_alike(model, third, &at, 1);
        go(other, &at, 1);
        assert_true(get_patch(model, &a) && get_patch(third, &b));
        assert_memory_equal(&a, &b, sizeof a);
    }
    /* one of a model without friction does not fit */
    const int64_t bytes = tm_model_snapshot_bytes(without);
    unsigned char *buffer = malloc((size_t)bytes);
    fix_ok(tm_model_save(without, buffer, bytes, &error), &error);
    assert_int_not_equal(tm_model_restore(model, buffer, bytes, &error), TM_OK);
    assert_true(tm_model_hash(model) == tm_model_hash(third));
    free(buffer);
    tm_model_destroy(without), tm_model_destroy(model), tm_model_destroy(other), tm_model_destroy(third);
    free_organ(&o);
}

/* Impossible values with a correct checksum are rejected without change, or accepted and continued from. */
static void impossible_friction_snapshots_are_rejected(void **state) {
    (void)state;
    enum { HEAD = 16 + 8 * 13 * TM_MAX_INSTRUMENTS }; /* up to the checksum */
    organ o;
    tm_error error;
    tm_friction_def friction = tm_friction_def_default();
    make_organ(&o, TM_TOOL_PROBE);
    friction.instrument[0] = (tm_friction_coefficient){.mu_static = 0.4, .mu_kinetic = 0.2};
    o.def.friction = &friction;
    tm_model *model = make(&o, PRECOMPUTED);
    tm_tool_pose at = down;
    go(model, &at, 2);
    at.tip_m[0] += 0.0005;
    go(model, &at, 1);
    const int64_t bytes = tm_model_snapshot_bytes(model);
    unsigned char *good = malloc((size_t)bytes), *bad = malloc((size_t)bytes), *now = malloc((size_t)bytes);
    fix_ok(tm_model_save(model, good, bytes, &error), &error);
    fix_random random = {71};
    int refused = 0, taken = 0;
    for (int i = 0; i < 400; i++) {
        const int64_t words = (bytes - HEAD - 8) / 8, word = (int64_t)(fix_uniform(&random) * (double)words);
        const int64_t number = (int64_t)(fix_signed(&random) * 12);
        const double value = i % 4 == 1 ? NAN : 3 * fix_signed(&random);
        memcpy(bad, good, (size_t)bytes);
        memcpy(bad + HEAD + 8 + 8 * word, i % 2 ? (const void *)&value : &number, 8);
        const uint64_t sum = tm_hash(bad + HEAD + 8, (size_t)(bytes - HEAD - 8), TM_HASH_SEED);
        memcpy(bad + HEAD, &sum, 8);
        fix_ok(tm_model_restore(model, good, bytes, &error), &error);
        if (tm_model_restore(model, bad, bytes, &error) == TM_OK) {
            tm_model_frame(model, &at);
            taken++;
            continue;
        }
        refused++;
        assert_true(strchr(error.message, ';') != NULL);
        fix_ok(tm_model_save(model, now, bytes, &error), &error);
        assert_memory_equal(good, now, (size_t)bytes);
    }
    print_message("  %d refused, %d taken\n", refused, taken);
    assert_true(refused > 50 && taken > 50);
    free(good), free(bad), free(now);
    tm_model_destroy(model);
    free_organ(&o);
}

/* A reaction of an unconverged solution is marked as such after restoring, too. */
static void snapshot_of_an_unconverged_solution_stays_marked(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    tm_model *model = make(&o, PRECOMPUTED), *other = make(&o, PRECOMPUTED);
    fix_random random = {57};
    bool solved = true;
    for (int i = 0; i < 40 && solved; i++) {
        const tm_tool_pose thrown = scene_pose(0.02 * fix_signed(&random), 0.02 * fix_signed(&random),
                                               i % 2 ? 0.01 + 0.03 * fix_uniform(&random) : 1);
        go(model, &thrown, 1);
        solved = !(tm_model_reaction(model, 0).flags & TM_REACTION_UNCONVERGED);
    }
    assert_false(solved);
    hand_over(model, other);
    assert_true(tm_model_reaction(other, 0).flags & TM_REACTION_UNCONVERGED);
    go_on_alike(model, other, &above, 2);
    tm_model_destroy(model);
    tm_model_destroy(other);
    free_organ(&o);
}

static void rest_is_found_with_the_tool_away(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    const size_t n = 3 * (size_t)o.mesh->vertex_count;
    double *u = calloc(n, sizeof *u), *first = calloc(n, sizeof *first), *reaction = malloc(n * sizeof *reaction);
    for (int m = 0; m < MODELS; m++) {
        tm_model *model = make(&o, m);
        tm_settle_def def = tm_settle_def_default();
        tm_settle_result result;
        tm_error error;
        double held = 0, weight = 0;
        fix_ok(tm_model_settle(model, &def, u, reaction, &result, &error), &error);
        assert_true((result.steps > 0) == (m == DYNAMIC) && result.energy_J > 0);
        for (int32_t v = 0; v < o.mesh->vertex_count; v++) held += reaction[3 * v + 2];
        for (int32_t t = 0; t < o.mesh->tet_count; t++)
            weight += 9.81 * o.mesh->volume_m3[t] * o.material.density_kg_m3;
        assert_true(fabs(held - weight) < 1e-6 * weight);
        if (m == DYNAMIC) memcpy(first, u, n * sizeof *u);
        assert_true(off(u, first, (int)n) < 1e-6);
        tm_model_destroy(model);
    }
    free(u), free(first), free(reaction);
    free_organ(&o);
}

/* A cut hybrid organ keeps stiffness and patch, and they are those of the remainder. */
static void cut_hybrid_keeps_stiffness_and_patch(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    o.def.tissue.cuttable = true;
    static tm_patch patch;
    double force[MODELS][3], K[MODELS][9];
    const size_t n = 3 * (size_t)o.mesh->vertex_count;
    double *u = malloc(n * sizeof *u), *reaction = malloc(n * sizeof *reaction), held[MODELS] = {0}, energy[MODELS];
    for (int m = 0; m < MODELS; m++) {
        if (m == PRECOMPUTED) continue;
        tm_model *model = make(&o, m);
        allow_patches(&o, model);
        go(model, &down, 8);
        assert_true(get_patch(model, &patch));
        int32_t gone = 0;
        for (int32_t t = 0; t < o.mesh->tet_count; t++) {
            const double *x = o.mesh->rest_m + 3 * (int64_t)o.mesh->tet[4 * (int64_t)t];
            if (x[0] > 0.015 && x[0] < 0.03 && x[2] > 0.02) gone += tm_cut_remove(model->tissue, &t, 1, NULL, 0);
        }
        go(model, &down, 60);
        assert_true(gone > 20 && tm_model_alive(model) == o.mesh->tet_count - gone);
        assert_true(get_patch(model, &patch));
        assert_int_equal(patch.kind, 2);
        assert_int_equal(patch.topology_revision, tm_model_surface(model).revision);
        const tm_tool_reaction r = tm_model_reaction(model, 0);
        memcpy(force[m], r.force_N, sizeof force[m]);
        memcpy(K[m], r.stiffness_N_m, sizeof K[m]);
        double found[3];
        felt(&patch, found);
        print_message("  %-11s after %d were cut: %.4f N, patch off by %.1e\n", model_name[m], gone,
                      fix_largest(force[m], 3), off(found, force[m], 3));
        assert_int_equal(r.stiffness_kind, 2);
        assert_true(off(found, force[m], 3) < 1e-4 && off(force[m], force[0], 3) < 1e-4);
        assert_true(off(K[m], K[0], 9) < 2e-2);
        /* its equilibrium without the tool: removed tissue carries no force and has no weight */
        tm_settle_def settle = tm_settle_def_default();
        tm_settle_result result;
        tm_error error;
        go(model, &above, 20);
        fix_ok(tm_model_settle(model, &settle, u, reaction, &result, &error), &error);
        for (size_t d = 2; d < n; d += 3) held[m] += reaction[d];
        energy[m] = result.energy_J;
        assert_true(fabs(held[m] - held[0]) < 1e-6 * held[0] && fabs(energy[m] - energy[0]) < 1e-6 * energy[0]);
        tm_model_destroy(model);
    }
    free(u), free(reaction);
    free_organ(&o);
}

/* Grasped tissue: the patch contains the grasp. */
static void grasped_tissue_has_a_patch(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_GRASPER);
    static tm_patch patch;
    for (int m = 0; m < MODELS; m++) {
        tm_model *model = make(&o, m);
        tm_tool_pose closed = down, lifted;
        closed.grip = 1;
        lifted = closed;
        lifted.tip_m[2] += 0.004;
        allow_patches(&o, model);
        go(model, &down, 2);
        go(model, &closed, 4);
        go(model, &lifted, 60);
        const bool made = get_patch(model, &patch);
        const tm_tool_reaction r = tm_model_reaction(model, 0);
        assert_true(made && patch.grasps && r.stiffness_kind == 2 && r.force_N[2] < -0.02);
        double here[3], there[3], far[3];
        tm_tool_pose aside = lifted;
        aside.tip_m[0] += 0.0007, aside.tip_m[1] -= 0.0005, aside.tip_m[2] += 0.0004;
        felt_at(&patch, lifted.tip_m, here);
        felt_at(&patch, aside.tip_m, there);
        go(model, &aside, 60);
        const tm_tool_reaction moved = tm_model_reaction(model, 0);
        for (int c = 0; c < 3; c++) far[c] = moved.force_N[c] - r.force_N[c];
        const double change = fix_largest(far, 3) / fix_largest(moved.force_N, 3);
        print_message(
            "  %-11s pulls with %.3f N, %.0f N/m; patch off by %.1e, a millimetre away (%.0f %% of the force) by "
            "%.1e\n",
            model_name[m], r.force_N[2], r.stiffness_N_m[8], off(here, r.force_N, 3), 100 * change,
            off(there, moved.force_N, 3));
        assert_true(change > 0.1 && off(here, r.force_N, 3) < 1e-3 && off(there, moved.force_N, 3) < 1e-2);
        tm_model_destroy(model);
    }
    free_organ(&o);
}

static void refused(organ *o, int which, tm_status status, const char *blame) {
    tm_model *model;
    tm_error error;
    assert_int_equal(try_make(o, which, &model, &error), status);
    assert_null(model);
    assert_non_null(o->invalid_member);
    assert_string_equal(o->invalid_member, blame);
    assert_true(strchr(error.message, ';') != NULL);
}

static void invalid_calls_are_reported(void **state) {
    (void)state;
    organ o;
    tm_error error;
    make_organ(&o, TM_TOOL_CAUTERY);
    const int64_t before = tm_memory_in_use();
    refused(&o, PRECOMPUTED, TM_ERR_EXCLUDED, "cut");
    const tm_friction_def friction = tm_friction_def_default();
    o.def.friction = &friction;
    refused(&o, HYBRID, TM_ERR_EXCLUDED, "friction");
    o.def.friction = NULL;
    o.def.contact = NULL;
    for (int m = 0; m < MODELS; m++) refused(&o, m, TM_ERR_ARGUMENT, "cut");
    o.def.cut = NULL;
    for (int m = 0; m < MODELS; m++) { /* nothing touches it */
        tm_model *model = make(&o, m);
        const tm_patch_def patches = tm_patch_def_default();
        assert_int_equal(tm_model_frame(model, NULL), TM_OK);
        assert_int_equal(tm_model_allow_patches(model, &patches, &error), TM_ERR_ARGUMENT);
        tm_model_destroy(model);
    }
    o.def.step_s = 1;
    refused(&o, DYNAMIC, TM_ERR_STEP, "step_s");
    refused(&o, HYBRID, TM_ERR_STEP, "step_s");
    o.def.step_s = 1e-12;
    refused(&o, DYNAMIC, TM_ERR_LIMIT, "frame_s");
    o.def.step_s = 0;
    o.def.frame_s = -1;
    for (int m = 0; m < MODELS; m++) refused(&o, m, TM_ERR_ARGUMENT, "frame_s");
    o.def.frame_s = 0.04;
    o.def.support_count = 0;
    o.def.tissue.precision = TM_SINGLE;
    refused(&o, DYNAMIC, TM_ERR_SUPPORT, "precision");
    refused(&o, PRECOMPUTED, TM_ERR_SUPPORT, "model");
    o.material.density_kg_m3 = -1;
    for (int m = 0; m < MODELS; m++) refused(&o, m, TM_ERR_MATERIAL, "tissue");
    assert_true(tm_memory_in_use() == before);
    free_organ(&o);
}

static void spoil(void *self, tm_world *world) {
    (void)self;
    tm_world_state(world)->u_next_m[7] = NAN;
}

/* A failed frame sends no force and changes no state. */
static void failed_frame_changes_nothing(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    for (int m = 0; m < MODELS; m += HYBRID) {
        tm_model *model = make(&o, m);
        static tm_patch patch;
        tm_error error;
        allow_patches(&o, model);
        go(model, &down, 8);
        const uint64_t good = tm_model_hash(model);
        const tm_stage stage = {.size = sizeof stage, .name = "spoil", .phase = TM_PHASE_END, .run = spoil};
        fix_ok(tm_world_add_stage(model->world, &stage, 0, &error), &error);
        assert_int_equal(tm_model_frame(model, &above), TM_ERR_UNSTABLE);
        const tm_tool_reaction r = tm_model_reaction(model, 0);
        assert_true(r.flags == TM_REACTION_UNSTABLE && fix_largest(r.force_N, 3) == 0);
        assert_memory_equal(r.tip_m, down.tip_m, sizeof r.tip_m);
        assert_false(tm_model_patch(model, 0, &patch));
        assert_true(tm_model_hash(model) == good);
        fix_ok(tm_world_remove_stage(model->world, "spoil", &error), &error);
        go(model, &down, 1);
        assert_true(tm_model_reaction(model, 0).flags == 0);
        tm_model_destroy(model);
    }
    free_organ(&o);
}

static void models_time_their_stages(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    for (int m = 0; m < MODELS; m++) {
        tm_model *model = make(&o, m);
        tm_stage_report report[TM_MAX_STAGES];
        tm_model_set_timing(model, true);
        go(model, &down, 2);
        const int32_t count = tm_model_stages(model, report);
        double seconds = 0;
        bool found = false;
        for (int32_t i = 0; i < count; i++) {
            seconds += report[i].seconds;
            found |= !strcmp(report[i].name, m == DYNAMIC ? "force" : model_name[m]);
        }
        assert_true(count >= 1 && found && seconds > 0);
        tm_model_destroy(model);
    }
    free_organ(&o);
}

/* The inside of the hybrid model is solved on request, and a frame does not depend on such requests. */
static void queries_change_no_frame(void **state) {
    (void)state;
    organ o;
    make_organ(&o, TM_TOOL_PROBE);
    tm_model *looked = make(&o, HYBRID), *left_alone = make(&o, HYBRID);
    int32_t inside = -1; /* condensed, in the middle of the block */
    for (int32_t v = 0; v < o.mesh->vertex_count && inside < 0; v++)
        if (o.mesh->rest_m[3 * v] < -0.01 && o.mesh->rest_m[3 * v + 2] > 0.01) inside = v;
    assert_true(inside >= 0);
    double before = 0;
    for (int i = 0; i < 12; i++) {
        tm_tool_pose to = down; /* onto the condensed part, and along it */
        to.tip_m[0] = -0.018 + 0.001 * i;
        to.tip_m[2] = fmax(down.tip_m[2], 0.050 - 0.002 * i);
        go(looked, &to, 1);
        go(left_alone, &to, 1);
        const double now = tm_model_displacement(looked)[3 * inside + 2];
        assert_true(now != before);
        before = now;
    }
    const tm_tool_reaction a = tm_model_reaction(looked, 0), b = tm_model_reaction(left_alone, 0);
    assert_true(fix_largest(a.force_N, 3) > 0.01);
    assert_memory_equal(a.force_N, b.force_N, sizeof a.force_N);
    assert_true(tm_model_hash(looked) == tm_model_hash(left_alone));
    assert_memory_equal(tm_model_displacement(looked), tm_model_displacement(left_alone),
                        24 * (size_t)o.mesh->vertex_count);
    tm_model_destroy(looked);
    tm_model_destroy(left_alone);
    free_organ(&o);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(queries_change_no_frame),
                                       cmocka_unit_test(three_models_agree_at_rest),
                                       cmocka_unit_test(frame_in_several_calls_equals_the_frame),
                                       cmocka_unit_test(snapshot_goes_on_with_the_same_bits),
                                       cmocka_unit_test(snapshots_while_grasping_continue_identically),
                                       cmocka_unit_test(snapshot_before_a_release_continues_identically),
                                       cmocka_unit_test(snapshot_with_friction_continues_identically),
                                       cmocka_unit_test(impossible_friction_snapshots_are_rejected),
                                       cmocka_unit_test(snapshot_of_an_unconverged_solution_stays_marked),
                                       cmocka_unit_test(rest_is_found_with_the_tool_away),
                                       cmocka_unit_test(cut_hybrid_keeps_stiffness_and_patch),
                                       cmocka_unit_test(grasped_tissue_has_a_patch),
                                       cmocka_unit_test(invalid_calls_are_reported),
                                       cmocka_unit_test(failed_frame_changes_nothing),
                                       cmocka_unit_test(models_time_their_stages)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
