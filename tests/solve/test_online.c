/* Online contact of the precomputed model: against the dynamic model at rest and its own derivative; smoothness,
 * grasped vertices. */
#include "../physics/contact_scene.h"
#include "kit.h"

#include <time.h>

/* A contact-test scene, and its precomputed model. */
typedef struct pair {
    scene scene;
    uint8_t *fixed;
    tm_precomputed *model;
} pair;

static pair make_pair_with(const scene_def *def, tm_precision precision, const tm_grasp_def *grasp,
                           tm_tool_mode second) {
    const tm_tool_mode mode[2] = {grasp ? TM_TOOL_GRASPER : TM_TOOL_PROBE, second};
    pair p = {.scene = scene_create_full(def, false, mode)};
    p.fixed = calloc(3 * (size_t)p.scene.mesh->vertex_count, 1);
    tm_support_mask(p.scene.world, p.fixed);
    tm_instrument_def tool[2];
    for (int t = 0; t < def->tools; t++) {
        tool[t] = (tm_instrument_def){.mode = mode[t], .radius_m = def->radius_m, .contact_length_m = def->length_m};
        memcpy(tool[t].trocar_m, def->trocar_m[t], 24);
        memcpy(tool[t].pose.tip_m, def->tip_m[t], 24);
        tool[t].pose.active = true;
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = def->tools;
    contact.instrument = tool;
    if (def->row_compliance_m_N >= 0) contact.contact_compliance_m_N = def->row_compliance_m_N;
    tm_precomputed_def model = tm_precomputed_def_default();
    model.problem = kit_problem(p.scene.tissue, p.fixed);
    model.contact = &contact;
    model.precision = precision;
    model.grasp = grasp;
    tm_error error;
    fix_ok(tm_precomputed_create(&model, &p.model, NULL, &error), &error);
    return p;
}

static pair make_pair_of(const scene_def *def, tm_precision precision, const tm_grasp_def *grasp) {
    return make_pair_with(def, precision, grasp, TM_TOOL_PROBE);
}

static pair make_pair(const scene_def *def, tm_precision precision) { return make_pair_of(def, precision, NULL); }

static void free_pair(pair *p) {
    tm_precomputed_destroy(p->model);
    free(p->fixed);
    scene_destroy(&p->scene);
}

static double distance3(const double *a, const double *b) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}
static double length3(const double *a) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/* --- the dynamic model at rest --- */

static void rest_case(const char *what, scene_def def, int tools, const tm_tool_pose *to) {
    def.tools = tools;
    pair p = make_pair(&def, TM_DOUBLE);
    tm_tool_reaction dynamic[2];
    for (int frame = 0; frame < 100; frame++) /* down in the first ten frames, then at rest */
        for (int t = 0; t < tools; t++) {
            const double s = frame < 10 ? (frame + 1) / 10.0 : 1;
            tm_tool_pose at = to[t];
            for (int c = 0; c < 3; c++) at.tip_m[c] = def.tip_m[t][c] + s * (to[t].tip_m[c] - def.tip_m[t][c]);
            if (t == tools - 1)
                dynamic[t] = scene_frame(&p.scene, t, at, 0.04);
            else
                tm_contact_set_target(p.scene.contact, t, &at, (int32_t)ceil(0.04 / tm_world_step_s(p.scene.world)));
        }
    for (int t = 0; t < tools; t++) dynamic[t] = tm_contact_reaction(p.scene.contact, t);
    const int32_t steps = tm_precomputed_update(p.model, to);
    const double *u = tm_precomputed_displacement(p.model), *v = tm_world_state(p.scene.world)->u_m;
    const int32_t *surface, count = tm_precomputed_surface(p.model, &surface);
    double worst = 0, most = 0;
    for (int32_t i = 0; i < 3 * count; i++) {
        const int32_t d = 3 * surface[i / 3] + i % 3;
        worst = fmax(worst, fabs(u[d] - v[d]));
        most = fmax(most, fabs(v[d]));
    }
    for (int t = 0; t < tools; t++) {
        const tm_tool_reaction r = tm_precomputed_reaction(p.model, t);
        const double off = distance3(r.force_N, dynamic[t].force_N) / length3(dynamic[t].force_N);
        print_message("  %s: tool %d %.3f N, %d rows, %d steps: force off by %.1e, shape by %.1e\n", what, t,
                      length3(r.force_N), r.row_count, steps, off, worst / most);
        assert_true(length3(r.force_N) > 0.01);
        assert_true(off < 1e-6);
    }
    assert_true(steps >= 0);
    assert_true(worst < 1e-6 * most);
    free_pair(&p);
}

static void online_contact_agrees_with_the_dynamic_model_at_rest(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    rest_case("tip", def, 1, (tm_tool_pose[]){scene_pose(0.004, 0.003, 0.040)});
    scene_def lying = def; /* the shaft across a bulge */
    lying.bulge_m = 0.01;
    lying.trocar_m[0][0] = -0.12, lying.trocar_m[0][2] = 0.075;
    lying.tip_m[0][0] = 0.05, lying.tip_m[0][1] = 0.003, lying.tip_m[0][2] = 0.06;
    rest_case("shaft", lying, 1, (tm_tool_pose[]){scene_pose(0.045, 0.003, 0.042)});
    rest_case("two tools", def, 2,
              (tm_tool_pose[]){scene_pose(0.006, 0.002, 0.0405), scene_pose(-0.006, -0.003, 0.041)});
}

/* --- derivative --- */

static void force_at(tm_precomputed *model, const double tip[3], double force[3]) {
    const tm_tool_pose pose = scene_pose(tip[0], tip[1], tip[2]);
    assert_true(tm_precomputed_update(model, &pose) >= 0);
    tm_precomputed_force(model, 0, force);
}

static void stiffness_is_the_forces_derivative(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    def.bulge_m = 0.006;
    def.trocar_m[0][0] = -0.06;
    pair p = make_pair(&def, TM_DOUBLE);
    fix_random random = {9};
    int checked = 0;
    double worst_off = 0;
    for (int i = 0; i < 30; i++) {
        double tip[3] = {0.015 * fix_signed(&random), 0.015 * fix_signed(&random), 0.060}, K[9], up[3], down[3],
               force[3];
        const double depth = 0.001 + 0.004 * fix_uniform(&random);
        force_at(p.model, tip, force);
        tip[2] = 0.0505 - 0.006 * (tip[0] * tip[0] + tip[1] * tip[1]) / 0.0013 - depth;
        force_at(p.model, tip, force);
        const uint64_t before =
            tm_hash(tm_precomputed_displacement(p.model), 24 * (size_t)p.scene.mesh->vertex_count, TM_HASH_SEED);
        const tm_tool_reaction r = tm_precomputed_reaction(p.model, 0);
        assert_int_equal(r.stiffness_kind, 2);
        assert_true(tm_hash(tm_precomputed_displacement(p.model), 24 * (size_t)p.scene.mesh->vertex_count,
                            TM_HASH_SEED) == before);
        if (length3(force) < 1e-3) continue;
        double off = 0;
        for (int a = 0; a < 3; a++) {
            const double h = 1e-7, x = tip[a];
            tip[a] = x + h, force_at(p.model, tip, up);
            tip[a] = x - h, force_at(p.model, tip, down);
            tip[a] = x;
            for (int c = 0; c < 3; c++) K[3 * c + a] = (up[c] - down[c]) / (2 * h);
        }
        off = kit_difference(r.stiffness_N_m, K, 9);
        worst_off = fmax(worst_off, off);
        if (off > 1e-4)
            print_message("  tip (%.4f %.4f %.4f) %.3f N %d rows: off by %.1e of %.0f N/m\n", tip[0], tip[1], tip[2],
                          length3(force), r.row_count, off, fix_largest(K, 9));
        assert_true(off < 1e-3);
        checked++;
    }
    print_message("  %d places, stiffness against differences of the converged force: off by %.1e at worst\n", checked,
                  worst_off);
    assert_true(checked > 20);
    free_pair(&p);
}

/* --- the patch --- */

/* The controller's force near the sample, from the patch alone, against the model itself. */
static double patch_off(pair *p, tm_patch_solver *solver, const tm_tool_pose *at, int tools, double step_m,
                        fix_random *random) {
    static tm_patch patch;
    assert_true(tm_precomputed_update(p->model, at) >= 0);
    assert_true(
        tm_precomputed_patch(p->model, 0, (double[]){0, 0, 0}, 0, TM_PATCH_VERTICES, TM_PATCH_TRIANGLES, &patch));
    assert_int_equal(patch.kind, 2);
    double worst = 0, most = 0;
    for (int i = 0; i < 10; i++) {
        tm_tool_pose moved[2] = {at[0], at[tools - 1]};
        double force[3], felt[3];
        bool inside;
        for (int c = 0; c < 3; c++) moved[0].tip_m[c] += i ? step_m * fix_signed(random) : 0;
        assert_true(tm_precomputed_update(p->model, moved) >= 0);
        tm_precomputed_force(p->model, 0, force);
        tm_patch_force(solver, &patch, moved[0].tip_m, felt, &inside);
        assert_true(inside);
        worst = fmax(worst, distance3(force, felt));
        most = fmax(most, length3(force));
    }
    return worst / most;
}

static void patch_gives_the_models_force(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    tm_patch_solver *solver;
    tm_error error;
    fix_random random = {21};
    fix_ok(tm_patch_solver_create(&solver, &error), &error);
    pair p = make_pair(&def, TM_DOUBLE);
    const double alone = patch_off(&p, solver, (tm_tool_pose[]){scene_pose(0.004, 0.003, 0.0415)}, 1, 3e-4, &random);
    free_pair(&p);
    def.tools = 2;
    p = make_pair(&def, TM_DOUBLE);
    const tm_tool_pose both[2] = {scene_pose(0.0055, 0.003, 0.0415), scene_pose(-0.0055, 0.001, 0.0405)};
    const double beside = patch_off(&p, solver, both, 2, 3e-4, &random);
    free_pair(&p);
    print_message(
        "  force from the patch, tip moved by up to 0.3 mm: off by %.1e alone, %.1e with another tool 11 mm away\n",
        alone, beside);
    assert_true(alone < 1e-5);  /* the tool stays on the same triangles: only the solver's tolerance remains */
    assert_true(beside < 1e-2); /* the other tool's rows to first order */
    tm_patch_solver_destroy(solver);
}

/* --- grasping --- */

/* Down, close, lift and rotate, release; the dynamic model at rest at each. */
static void grasp_agrees_with_dynamic_at_rest(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    def.damping_1_s = 150;
    const tm_grasp_def how = tm_grasp_def_default();
    pair p = make_pair_of(&def, TM_DOUBLE, &how);
    tm_grasp *dynamic;
    tm_error error;
    fix_ok(tm_stage_grasp(p.scene.world, p.scene.contact, &how, &dynamic, &error), &error);
    tm_tool_pose way[4] = {scene_pose(0.004, 0.003, 0.0425), scene_pose(0.004, 0.003, 0.0425),
                           scene_pose(0.006, 0.002, 0.0480), scene_pose(0.006, 0.002, 0.0480)};
    way[1].grip = way[2].grip = 1;
    way[2].roll_rad = way[3].roll_rad = 0.3;
    for (int i = 0; i < 4; i++) {
        tm_tool_reaction settled = {0};
        for (int frame = 0; frame < 40; frame++) settled = scene_frame(&p.scene, 0, way[i], 0.04);
        for (int k = 0; k < (i == 3 ? 60 : 1); k++)
            assert_true(tm_precomputed_update(p.model, way + i) >= 0); /* the release takes 50 updates */
        const tm_tool_reaction r = tm_precomputed_reaction(p.model, 0);
        const int32_t *held, *theirs;
        tm_grasp_state mine_is, theirs_is;
        const int32_t count = tm_precomputed_grasped(p.model, 0, &held, &mine_is),
                      their_count = tm_grasp_vertices(dynamic, 0, &theirs, &theirs_is);
        const double *u = tm_precomputed_displacement(p.model), *v = tm_world_state(p.scene.world)->u_m;
        double worst = 0, most = 0;
        const int32_t *surface, n = tm_precomputed_surface(p.model, &surface);
        for (int32_t k = 0; k < 3 * n; k++)
            worst = fmax(worst, fabs(u[3 * surface[k / 3] + k % 3] - v[3 * surface[k / 3] + k % 3])),
            most = fmax(most, fabs(v[3 * surface[k / 3] + k % 3]));
        print_message("  %s: %.4f N, %d held; off the dynamic model by %.1e N, shape by %.1e m of %.1e\n",
                      (const char *[]){"touching", "closed", "lifted", "let go"}[i], length3(r.force_N), count,
                      distance3(r.force_N, settled.force_N), worst, most);
        assert_int_equal(count > 0, i == 1 || i == 2);
        if (i == 1 || i == 2) {
            double K[9], up[3], down[3];
            assert_int_equal(count, their_count);
            assert_memory_equal(held, theirs, sizeof *held * (size_t)count);
            assert_int_equal(mine_is, theirs_is);
            for (int a = 0; a < 3; a++) {
                tm_tool_pose at = way[i];
                at.tip_m[a] += 1e-6;
                assert_true(tm_precomputed_update(p.model, &at) >= 0);
                tm_precomputed_force(p.model, 0, up);
                at.tip_m[a] -= 2e-6;
                assert_true(tm_precomputed_update(p.model, &at) >= 0);
                tm_precomputed_force(p.model, 0, down);
                for (int c = 0; c < 3; c++) K[3 * c + a] = (up[c] - down[c]) / 2e-6;
            }
            assert_true(kit_difference(r.stiffness_N_m, K, 9) < 1e-3);
        }
        assert_true(distance3(r.force_N, settled.force_N) < 1e-6 * fmax(length3(settled.force_N), 0.01));
        assert_true(worst < 1e-6 * fmax(most, 1e-3));
    }
    free_pair(&p);
}

/* Releasing while a second tool presses on the grasped tissue: the shape never goes farther than before, and the
 * grasper's force never exceeds the share that is left. */
static void release_under_a_second_tool_is_bounded(void **state) {
    (void)state;
    const struct {
        const char *name;
        tm_tool_mode mode;
        bool there;
    } second[4] = {{"nothing", TM_TOOL_PROBE, false},
                   {"a probe", TM_TOOL_PROBE, true},
                   {"a grasper", TM_TOOL_GRASPER, true},
                   {"a cautery", TM_TOOL_CAUTERY, true}};
    /* In steps of two: each tool and each release time. */
    for (int k = test_is_sanitized() ? 8 : 0; k < (test_is_sanitized() ? 9 : 12); k += test_is_long() ? 1 : 2) {
        scene_def def = scene_def_default();
        def.cells[0] = def.cells[1] = 8, def.cells[2] = 5, def.tools = 2;
        memcpy(def.trocar_m, (double[2][3]){{0.1, 0, 0.2}, {-0.1, 0, 0.2}}, sizeof def.trocar_m);
        memcpy(def.tip_m, (double[2][3]){{0, 0, 0.046}, {-0.003, 0, 0.065}}, sizeof def.tip_m);
        tm_grasp_def how = tm_grasp_def_default();
        how.release_time_s = (const double[]){0, 0.05, 0.2}[k % 3];
        pair p = make_pair_with(&def, TM_DOUBLE, &how, second[k / 3].mode);
        const int32_t *surface, n = tm_precomputed_surface(p.model, &surface);
        const double *u = tm_precomputed_displacement(p.model);
        tm_tool_pose at[2] = {scene_pose(0, 0, 0.0425), scene_pose(-0.003, 0, 0.065)};
        at[1].active = second[k / 3].there;
        int stalled = tm_precomputed_update(p.model, at) < 0;
        at[0].grip = 1;
        const bool grasps = second[k / 3].mode == TM_TOOL_GRASPER;
        for (int i = 1; i <= 60; i++) { /* up 5 mm, while the second presses on it, or grasps it too and pulls away */
            at[0].tip_m[2] = 0.0425 + 0.005 * fmin(1, i / 20.0);
            if (second[k / 3].there) at[1].tip_m[2] = grasps ? 0.0425 : fmax(0.042, 0.065 - 0.0005 * i);
            if (grasps) at[1].tip_m[0] = -0.003 - 1e-4 * i, at[1].grip = i > 2;
            stalled += tm_precomputed_update(p.model, at) < 0;
        }
        double most = 0, after = 0, first[3], force[3], over = 0;
        for (int32_t i = 0; i < n; i++) most = fmax(most, length3(u + 3 * surface[i]));
        tm_precomputed_force(p.model, 0, first);
        at[0].grip = 0;
        for (int i = 0; i < 150; i++) {
            if (grasps && i == 20) at[1].grip = 0; /* 40 ms later */
            stalled += tm_precomputed_update(p.model, at) < 0;
            for (int32_t v = 0; v < n; v++) after = fmax(after, length3(u + 3 * surface[v]));
            tm_precomputed_force(p.model, 0, force);
            const double left = how.release_time_s > 0 ? fmax(0, 1 - 0.002 * (i - 1) / how.release_time_s)
                                : i > 0                ? 0
                                                       : 1;
            tm_grasp_state is;
            if (tm_precomputed_grasped(p.model, 0, NULL, &is) > 0 && is == TM_GRASP_RELEASING)
                over = fmax(over, length3(force) / length3(first) - left);
        }
        print_message(
            "  %-9s fade %3.0f ms: %.2f N, %.1f mm before, at most %.1f mm after, force %.3f over its share, %d "
            "not converged\n",
            second[k / 3].name, 1e3 * how.release_time_s, length3(first), 1e3 * most, 1e3 * after, over, stalled);
        assert_true(most > 0.003 && length3(first) > 0.1);
        assert_true(after < 1.1 * most && over < 0.1);
        free_pair(&p);
    }
}

/* --- smoothness: a stroke at 500 Hz --- */

static void stroke_at_500_Hz_is_smooth(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    pair p = make_pair(&def, TM_DOUBLE);
    double force[3], before[3] = {0}, jump[3] = {0}, second = 0, peak = 0, first = 0;
    int32_t most_steps = 0;
    double seconds = 0;
    for (int i = 0; i < 1500; i++) { /* 10 mm/s down 2 mm, then along */
        const double s = i * 2e-5;
        const tm_tool_pose pose = scene_pose(-0.012 + fmax(0, s - 0.006), 0.003, 0.0455 - fmin(s, 0.006));
        struct timespec a, b;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
        const int32_t steps = tm_precomputed_update(p.model, &pose);
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
        seconds += (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
        assert_true(steps >= 0);
        most_steps = steps > most_steps ? steps : most_steps;
        tm_precomputed_force(p.model, 0, force);
        peak = fmax(peak, length3(force));
        for (int c = 0; c < 3; c++) {
            const double now = force[c] - before[c];
            if (i > 1) second = fmax(second, fabs(now - jump[c])), first = fmax(first, fabs(now));
            jump[c] = now;
            before[c] = force[c];
        }
    }
    print_message("  peak %.3f N; largest change in a tick %.2f %%, largest second difference %.2f %% of it; at most "
                  "%d steps; %.0f us an update\n",
                  peak, 100 * first / peak, 100 * second / peak, most_steps, seconds / 1500 * 1e6);
    assert_true(second < 0.02 * peak);
    free_pair(&p);
}

/* --- each tool's own size --- */

/* The size of a tool without contact does not affect the other one: no bit of its force or stiffness. */
static void size_of_an_idle_tool_changes_no_bit(void **state) {
    (void)state;
    tm_tool_reaction r[3];
    const double radius[3] = {2.5e-3, 2e-4, 3e-2};
    for (int i = 0; i < 3; i++) {
        scene_def def = scene_def_default();
        tm_mesh *mesh = scene_mesh(&def);
        const tm_material material = kit_material(def.young_Pa, def.poisson);
        tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
        uint8_t *fixed = calloc(3 * (size_t)mesh->vertex_count, 1);
        for (int32_t d = 0; d < 3 * mesh->vertex_count; d++) fixed[d] = mesh->rest_m[d / 3 * 3 + 2] < 1e-9;
        tm_instrument_def tool[2];
        for (int t = 0; t < 2; t++) {
            tool[t] = (tm_instrument_def){.mode = TM_TOOL_PROBE,
                                          .radius_m = t ? 2.5e-3 : radius[i],
                                          .contact_length_m = def.length_m,
                                          .pose = {.tip_m = {0.002, 0.001, t ? 0.06 : 0.2}, .active = t == 1}};
            memcpy(tool[t].trocar_m, def.trocar_m[0], 24);
        }
        tm_contact_def contact = tm_contact_def_default();
        contact.instrument_count = 2;
        contact.instrument = tool;
        tm_precomputed_def full = tm_precomputed_def_default();
        full.problem = kit_problem(tissue, fixed);
        full.contact = &contact;
        tm_precomputed *model;
        tm_error error;
        fix_ok(tm_precomputed_create(&full, &model, NULL, &error), &error);
        for (int step = 1; step <= 40; step++) {
            tm_tool_pose pose[2] = {tool[0].pose, tool[1].pose};
            pose[1].tip_m[2] = 0.06 - 5.5e-4 * step;
            pose[1].tip_m[0] = 0.002 + 2e-4 * (step % 3);
            assert_true(tm_precomputed_update(model, pose) >= 0);
        }
        r[i] = tm_precomputed_reaction(model, 1);
        tm_precomputed_destroy(model);
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh);
        free(fixed);
    }
    assert_true(length3(r[0].force_N) > 0.05);
    for (int i = 1; i < 3; i++) {
        assert_memory_equal(r[i].force_N, r[0].force_N, sizeof r[0].force_N);
        assert_memory_equal(r[i].stiffness_N_m, r[0].stiffness_N_m, sizeof r[0].stiffness_N_m);
    }
}

/* --- hard use: two tools at random, up to 0.3 m/s, in and out --- */

static void random_tools_stay_bounded(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.tools = 2;
    def.bulge_m = 0.008;
    pair p = make_pair(&def, TM_DOUBLE);
    fix_random random = {33};
    double at[2][3] = {{0.01, 0, 0.055}, {-0.01, 0, 0.055}}, v[2][3] = {{0}};
    const int ticks = test_is_long() ? 6000 : test_is_sanitized() ? 400 : 2000;
    int stalled = 0, touching = 0;
    for (int i = 0; i < ticks; i++) {
        tm_tool_pose pose[2];
        for (int t = 0; t < 2; t++) {
            for (int c = 0; c < 3; c++) {
                const double low = c == 2 ? 0.038 : -0.03, high = c == 2 ? 0.06 : 0.03;
                v[t][c] = 0.98 * v[t][c] + 0.012 * fix_signed(&random);
                at[t][c] += 0.002 * v[t][c];
                if (at[t][c] < low) at[t][c] = low, v[t][c] = fabs(v[t][c]);
                if (at[t][c] > high) at[t][c] = high, v[t][c] = -fabs(v[t][c]);
            }
            pose[t] = scene_pose(at[t][0], at[t][1], at[t][2]);
        }
        stalled += tm_precomputed_update(p.model, pose) < 0;
        double force[3];
        tm_precomputed_force(p.model, 0, force);
        assert_true(length3(force) < 10); /* and so is finite */
        touching += length3(force) > 0;
    }
    print_message("  %d ticks, %d touching, %d not converged\n", ticks, touching, stalled);
    assert_true(touching > ticks / 4);
    assert_true(stalled <= ticks / 200);
    free_pair(&p);
}

/* --- failed convergence is reported --- */

/* Thrown into the block from a metre away, farther than an update's path steps reach. The result is finite and
 * bounded. If it is no solution, both the count of steps and every tool's reaction report it. A tool that comes from
 * outside again is felt as if nothing had happened. */
static void thrown_tool_is_bounded_and_reported(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    def.tools = 2;
    pair p = make_pair(&def, TM_DOUBLE);
    fix_random random = {57};
    int failed = 0, solved = 0;
    double force[2][3];
    for (int i = 0; i < (test_is_sanitized() ? 4 : test_is_long() ? 12 : 6); i++) {
        tm_tool_pose at[2] = {scene_pose(0.02 * fix_signed(&random), 0.02 * fix_signed(&random), 0),
                              scene_pose(0.02 * fix_signed(&random), 0.02 * fix_signed(&random), 0)};
        for (int t = 0; t < 2; t++) at[t].tip_m[2] = i % 2 ? 0.01 + 0.03 * fix_uniform(&random) : 1;
        const int32_t steps = tm_precomputed_update(p.model, at);
        failed += steps < 0, solved += steps >= 0;
        for (int t = 0; t < 2; t++) {
            const tm_tool_reaction r = tm_precomputed_reaction(p.model, t);
            const bool flagged = (r.flags & TM_REACTION_UNCONVERGED) != 0;
            assert_int_equal(flagged, steps < 0);
            assert_int_equal(tm_precomputed_force(p.model, t, force[t]), r.flags);
            for (int c = 0; c < 3; c++) assert_true(isfinite(r.force_N[c]) && r.force_N[c] == force[t][c]);
        }
    }
    print_message("  %d of %d updates did not converge, each told\n", failed, failed + solved);
    assert_true(failed > 0 && solved > 0);
    pair fresh = make_pair(&def, TM_DOUBLE);
    for (int i = 0; i < 2; i++) {
        const pair *q = i ? &fresh : &p;
        tm_tool_pose at[2] = {scene_pose(0.006, 0.002, 0.06), scene_pose(-0.006, -0.003, 0.06)};
        assert_true(tm_precomputed_update(q->model, at) >= 0);
        at[0].tip_m[2] = 0.0405, at[1].tip_m[2] = 0.041;
        assert_true(tm_precomputed_update(q->model, at) >= 0);
        assert_int_equal(tm_precomputed_force(q->model, 0, force[i]), 0);
    }
    assert_true(length3(force[1]) > 0.01 && distance3(force[0], force[1]) < 1e-6 * length3(force[1]));
    free_pair(&fresh);
    free_pair(&p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(size_of_an_idle_tool_changes_no_bit),
                                       cmocka_unit_test(online_contact_agrees_with_the_dynamic_model_at_rest),
                                       cmocka_unit_test(stiffness_is_the_forces_derivative),
                                       cmocka_unit_test(patch_gives_the_models_force),
                                       cmocka_unit_test(grasp_agrees_with_dynamic_at_rest),
                                       cmocka_unit_test(release_under_a_second_tool_is_bounded),
                                       cmocka_unit_test(stroke_at_500_Hz_is_smooth),
                                       cmocka_unit_test(random_tools_stay_bounded),
                                       cmocka_unit_test(thrown_tool_is_bounded_and_reported)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
