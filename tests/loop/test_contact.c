/* `local_model`: rows against the simulation's own detection, the solution against the conditions of contact. */
#include "ground_patch.h"
#include "held_patch.h"

#include "tensormass/contact.h"
#include "tensormass/patch.h"

/* ---------------------------------------------------------------------------------------------- rows */

typedef struct doubles {
    double rest_m[HRT_PATCH_DOFS], u_m[HRT_PATCH_DOFS];
    int32_t triangle[3 * HRT_PATCH_MAX_TRIANGLES], face[HRT_PATCH_MAX_TRIANGLES];
} doubles;

static void to_doubles(const hrt_patch *p, const float *shift, doubles *d) {
    for (int i = 0; i < 3 * p->vertex_count; i++) {
        d->rest_m[i] = (double)p->rest_m[i];
        d->u_m[i] = (double)p->vertex_m[i] + (double)shift[i] - d->rest_m[i];
    }
    for (int i = 0; i < 3 * p->triangle_count; i++) d->triangle[i] = p->triangle[i];
    for (int t = 0; t < p->triangle_count; t++) d->face[t] = t;
}

static hrt_shaft shaft; /* of find_rows */

static int32_t find_rows(const float *shift_m, const float tip_m[3], const hrt_contact_row *before,
                         int32_t before_count, hrt_contact_row *row) {
    hrt_hits hits = {.count = -1};
    return hrt_contact_rows(&patch, shift_m, tip_m, &shaft, before, before_count, &hits, row);
}

static void rows_are_those_of_the_simulation(void **state) {
    (void)state;
    uint64_t seed = 4;
    int rows = 0, faces = 0, edges = 0, vertices = 0, missed = 0, worst_count = 0;
    double worst_gap = 0.0, worst_normal = 0.0, worst_share = 0.0, worst_weight = 0.0;
    for (int k = 0; k < 4000; k++) {
        if (k % 50 == 0) {
            make_ground(&patch, &seed, 0.004f, k % 100 ? 0.0015f : 0.0001f, 0.12f);
            for (int i = 0; i < 3 * VERTICES; i++)
                patch.rest_m[i] = patch.vertex_m[i] + rig_uniform(&seed, -0.0004f, 0.0004f);
            assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
        }
        float shift[HRT_PATCH_DOFS];
        for (int i = 0; i < 3 * VERTICES; i++) shift[i] = rig_uniform(&seed, -0.0003f, 0.0003f);
        float tip[3] = {rig_uniform(&seed, -0.006f, 0.006f), rig_uniform(&seed, -0.006f, 0.006f),
                        0.12f - rig_uniform(&seed, 0.0005f, 0.004f)};
        hrt_contact_row row[HRT_CONTACT_ROWS];
        tm_contact_row truth[64];
        static doubles d;
        to_doubles(&patch, shift, &d);
        shaft.is_free = k % 2 == 1; /* leaning up to 70 degrees, so that many stations touch */
        float lean[3] = {rig_uniform(&seed, -2.0f, 2.0f), rig_uniform(&seed, -2.0f, 2.0f), 1.0f};
        const float size = sqrtf(lean[0] * lean[0] + lean[1] * lean[1] + 1.0f);
        for (int i = 0; i < 3; i++) shaft.direction[i] = lean[i] / size;
        const tm_instrument_def def = {.is_free = shaft.is_free,
                                       .radius_m = (double)patch.radius_m,
                                       .contact_length_m = (double)patch.contact_length_m};
        const tm_tool_pose pose = {.tip_m = {(double)tip[0], (double)tip[1], (double)tip[2]},
                                   .direction = {(double)lean[0], (double)lean[1], (double)lean[2]}};
        const tm_capsule capsule = tm_tool_capsule(&def, &pose, 0);
        const int32_t expected = fix_find(d.rest_m, d.u_m, d.triangle, d.face, NULL, patch.triangle_count, &capsule,
                                          0.2 * def.radius_m, truth, 64, NULL);
        const int32_t found = find_rows(shift, tip, NULL, 0, row);
        worst_count = expected > worst_count ? expected : worst_count;
        for (int32_t e = 0; e < expected; e++) {
            const hrt_contact_row *same = NULL;
            for (int32_t i = 0; i < found; i++)
                if (row[i].station == truth[e].station && row[i].triangle == truth[e].face &&
                    row[i].feature == truth[e].feature)
                    same = &row[i];
            if (!same) {
                missed += truth[e].share > 1e-3 && truth[e].gap_m < 0.19 * def.radius_m && expected <= HRT_CONTACT_ROWS;
                continue;
            }
            rows++;
            faces += same->feature == 0, edges += same->feature >= 1 && same->feature < 4,
                vertices += same->feature >= 4;
            worst_gap = fmax(worst_gap, fabs((double)same->gap_m - truth[e].gap_m));
            worst_share = fmax(worst_share, fabs((double)same->share - truth[e].share));
            for (int i = 0; i < 3; i++) {
                worst_normal = fmax(worst_normal, fabs((double)same->normal[i] - truth[e].normal[i]));
                worst_weight = fmax(worst_weight, fabs((double)same->weight[i] - truth[e].weight[i]));
            }
        }
    }
    print_message(
        "%d rows (%d faces, %d edges, %d vertices), at most %d at once: gap off by %.1e m, normal %.1e, share %.1e, weight %.1e\n",
        rows, faces, edges, vertices, worst_count, worst_gap, worst_normal, worst_share, worst_weight);
    shaft.is_free = false;
    assert_int_equal(missed, 0);
    assert_true(rows > 8000 && faces > 1000 && edges > 100 && vertices > 50);
    assert_true(worst_gap < 1e-7 && worst_normal < 3e-3 && worst_share < 1e-3 && worst_weight < 1e-4);
}

/* ---------------------------------------------------------------------------------------------- the solution */

/* On flat, even ground the reaction points straight up and equals that of springs in series. */
static void pressing_flat_ground_gives_springs_in_series(void **state) {
    (void)state;
    static hrt_extrapolation x;
    ground(0.0f);
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    float tip[3] = {0.0f, 0.0f, 0.11f}, force[3];
    take(&x, 0, tip, &patch, 1);
    settle(&x, tip, force);
    assert_float_equal(force[2], 0.0f, 0.0f); /* above the ground */
    float last = 0.0f;
    for (int k = 0; k < 40; k++) {
        tip[2] = 0.1176f + 0.0001f * (float)k;
        settle(&x, tip, force);
        assert_false((x.limits & HRT_LIMIT_PATCH) != 0);
        assert_true(force[2] <= last + 1e-6f); /* pushes towards the trocar, increasingly */
        last = force[2];
    }
    /* 4 mm deep, less the radius: compliance of the point and contact compliance in series */
    assert_true(last < -0.8f && last > -2.0f);
    assert_true(fabsf(force[0]) < 0.05f * fabsf(last) && fabsf(force[1]) < 0.05f * fabsf(last));
}

/* Viscous drag on the tip's motion along the force: zero at rest, at a steady speed and across; at most half of the
 * force; over a cycle it dissipates energy. Each is compared with a twin whose patch has no drag. */
static void viscous_drag_only_dissipates(void **state) {
    (void)state;
    static hrt_extrapolation x[2];
    static hrt_patch with;
    const float dashpot = 0.1f, memory_s = 0.005f;
    ground(0.0f);
    with = patch;
    with.radiation_N_s_m = dashpot, with.radiation_s = memory_s;
    assert_int_equal(hrt_patch_prepare(&with, scratch), HRT_ACCEPT);
    float tip[3] = {0.0f, 0.0f, 0.1185f}, force[2][3], more = 0.0f, taken_J = 0.0f, half = 0.0f;
    for (int i = 0; i < 2; i++) {
        hrt_extrapolation_reset(&x[i], HRT_LOCAL_MODEL);
        take(&x[i], 0, tip, i ? &with : &patch, 1);
    }
    for (int tick = 1; tick < 145; tick++) {
        const float before = tip[2], across = tip[0];
        if (tick == 60) tip[2] += 0.00002f;                                                  /* one encoder count */
        if (tick > 75 && tick <= 95) tip[2] += 0.00002f;                                     /* 10 mm/s */
        if (tick > 100 && tick <= 140) tip[2] += 0.00003f * sinf(0.31415927f * (float)tick); /* 25 Hz */
        if (tick == 142) tip[0] += 0.0005f;
        if (tick == 143) tip[2] += 0.02f; /* thrown */
        for (int i = 0; i < 2; i++) hrt_extrapolation_force(&x[i], &params, 2000 * tick, tip, force[i]);
        more = force[1][2] - force[0][2];
        const float swing = (tip[2] - before) / 0.002f * memory_s / (0.002f + memory_s);
        if (tick == 59 || tick == 75) assert_float_equal(more, 0.0f, tick == 59 ? 1e-6f : 0.03f * dashpot * 0.01f);
        if (tick == 60) assert_float_equal(more, -dashpot * swing, 0.03f * dashpot * swing);
        if (tick == 95) assert_float_equal(more, 0.0f, 0.02f * dashpot * 0.01f);
        if (tick > 100 && tick <= 140) taken_J -= more * (tip[2] - before);
        if (tick == 142) assert_true(fabsf(more) < 0.1f * dashpot * (tip[0] - across) / 0.002f);
        if (tick == 143) half = size_of(force[1]) / size_of(force[0]);
    }
    assert_true(taken_J > 1e-8f);
    assert_true(half <= 1.5001f && half > 1.0f);
}

/* Checks 0 <= gap + depth(lambda) _|_ lambda >= 0 at the converged shape, with rows of the simulation's own
 * detection. */
static void solution_satisfies_complementarity(void **state) {
    (void)state;
    static hrt_extrapolation x;
    uint64_t seed = 21;
    for (int k = 0; k < 30; k++) {
        make_ground(&patch, &seed, 0.004f, 0.0006f, 0.12f);
        assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        float tip[3] = {rig_uniform(&seed, -0.003f, 0.003f), rig_uniform(&seed, -0.003f, 0.003f), 0.1172f}, force[3];
        take(&x, 0, tip, &patch, 1);
        for (int step = 0; step < 40; step++) { /* in small steps, like a hand */
            tip[2] += 0.00005f;
            settle(&x, tip, force);
        }
        float shift[HRT_PATCH_DOFS] = {0};
        for (int i = 0; i < 3 * VERTICES; i++)
            for (int j = 0; j < 3 * VERTICES; j++)
                shift[i] +=
                    patch.compliance_m_N[packed(3 * VERTICES, i < j ? i : j, i < j ? j : i)] * x.touch.patch_force_N[j];
        hrt_contact_row row[HRT_CONTACT_ROWS];
        const int32_t found = find_rows(shift, tip, x.touch.row, x.touch.row_count, row);
        double sum = 0.0;
        for (int32_t i = 0; i < x.touch.row_count; i++) {
            assert_true(x.touch.row[i].lambda_N >= 0.0f);
            sum += (double)x.touch.row[i].lambda_N;
        }
        assert_true(sum > 0.3);
        for (int32_t i = 0; i < found; i++)
            for (int32_t b = 0; b < x.touch.row_count; b++) {
                if (row[i].station != x.touch.row[b].station || row[i].triangle != x.touch.row[b].triangle ||
                    row[i].feature != x.touch.row[b].feature)
                    continue;
                const double compliance = (double)patch.contact_compliance_m_N / (double)row[i].share;
                const double left =
                    (double)row[i].gap_m +
                    tm_contact_compliance_depth(compliance, (double)patch.radius_m, (double)x.touch.row[b].lambda_N);
                if (x.touch.row[b].lambda_N > 0.01f)
                    assert_true(fabs(left) < 2e-5);
                else
                    assert_true(left > -2e-5);
            }
    }
}

/* The simulation's own patch solver, in double and to convergence, gives the same force. */
static void force_equals_the_simulations_solver(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static tm_patch truth;
    tm_patch_solver *solver = NULL;
    tm_error error = {0};
    uint64_t seed = 33;
    double worst = 0.0, most = 0.0;
    int compared = 0;
    assert_int_equal(tm_patch_solver_create(&solver, &error), TM_OK);
    for (int k = 0; k < 20; k++) {
        make_ground(&patch, &seed, 0.004f, 0.0006f, 0.12f);
        for (int i = 0; i < 3 * VERTICES; i++)
            patch.rest_m[i] = patch.vertex_m[i] + rig_uniform(&seed, -0.0001f, 0.0001f);
        assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
        memset(&truth, 0, sizeof truth);
        truth.kind = 2;
        truth.vertex_count = patch.vertex_count;
        truth.triangle_count = patch.triangle_count;
        for (int v = 0; v < VERTICES; v++) truth.vertex[v] = 100 * k + v; /* another patch each time */
        for (int i = 0; i < 3 * VERTICES; i++) {
            truth.vertex_m[i] = (double)patch.vertex_m[i];
            truth.rest_m[i] = (double)patch.rest_m[i];
        }
        for (int t = 0; t < patch.triangle_count; t++) truth.face[t] = t;
        for (int i = 0; i < 3 * patch.triangle_count; i++) truth.triangle[i] = (int8_t)patch.triangle[i];
        for (int i = 0; i < 3 * VERTICES * (3 * VERTICES + 1) / 2; i++)
            truth.compliance_m_N[i] = (double)patch.compliance_m_N[i];
        truth.contact_compliance_m_N = (double)patch.contact_compliance_m_N;
        truth.force_cap_N = 50.0;
        truth.radius_m = (double)patch.radius_m;
        truth.contact_length_m = (double)patch.contact_length_m;
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        float tip[3] = {rig_uniform(&seed, -0.003f, 0.003f), rig_uniform(&seed, -0.003f, 0.003f), 0.1172f}, force[3];
        take(&x, 0, tip, &patch, 1);
        for (int step = 0; step < 50; step++) { /* in, and sideways */
            double at[3], expected[3];
            bool inside;
            tip[0] += 0.00002f;
            tip[2] += 0.00004f;
            for (int i = 0; i < 3; i++) at[i] = (double)tip[i];
            settle(&x, tip, force);
            tm_patch_force(solver, &truth, at, expected, &inside);
            if (!inside || (x.limits & HRT_LIMIT_PATCH) != 0) break;
            for (int i = 0; i < 3; i++) {
                worst = fmax(worst, fabs((double)force[i] - expected[i]));
                most = fmax(most, fabs(expected[i]));
            }
            compared++;
        }
    }
    tm_patch_solver_destroy(solver);
    print_message("%d forces up to %.2f N: at most %.1e N off the simulation's\n", compared, most, worst);
    assert_true(compared > 500 && most > 0.5 && worst < 0.005 * most);
}

static bool ground_block(void *self, int32_t a, int32_t b, double C[9]) {
    const hrt_patch *p = self;
    for (int i = 0; i < 9; i++) {
        const int r = 3 * a + i / 3, c = 3 * b + i % 3;
        C[i] = (double)p->compliance_m_N[packed(3 * VERTICES, r < c ? r : c, r < c ? c : r)];
    }
    return true;
}

/* Sets jaws that hold five vertices of the ground, without its last vertex; as the library stores it and as a
 * message carries it. */
static void hold_ground(tm_patch_solver *solver, uint64_t *seed, const double tip_m[3], int name, tm_patch *truth,
                        hrt_patch *held) {
    static const int32_t vertex[] = {11, 12, 13, 16, 17};
    enum { HELD = 5 };
    double target_m[3 * HELD], force_N[3 * HELD];
    memset(truth, 0, sizeof *truth);
    truth->kind = 2;
    truth->vertex_count = VERTICES - 1;
    for (int v = 0; v < VERTICES - 1; v++) truth->vertex[v] = v;
    for (int i = 0; i < 3 * (VERTICES - 1); i++) {
        truth->vertex_m[i] = (double)patch.vertex_m[i];
        truth->rest_m[i] = (double)patch.rest_m[i];
    }
    for (int t = 0; t < patch.triangle_count; t++) {
        const uint8_t *corner = &patch.triangle[3 * t];
        if (corner[0] == VERTICES - 1 || corner[1] == VERTICES - 1 || corner[2] == VERTICES - 1) continue;
        for (int j = 0; j < 3; j++) truth->triangle[3 * truth->triangle_count + j] = (int8_t)corner[j];
        truth->face[truth->triangle_count++] = t;
    }
    truth->contact_compliance_m_N = (double)patch.contact_compliance_m_N;
    truth->force_cap_N = 50.0;
    truth->radius_m = (double)patch.radius_m;
    truth->contact_length_m = (double)patch.contact_length_m;
    for (int i = 0; i < 3 * HELD; i++) {
        force_N[i] = (double)rig_uniform(seed, -0.1f, 0.1f) - (i % 3 == 2 ? 0.2 : 0.0);
        target_m[i] = truth->vertex_m[3 * vertex[i / 3] + i % 3] + 0.2e-3 * force_N[i];
    }
    const tm_patch_grasp hold = {HELD, vertex, target_m, force_N, 0.2e-3};
    assert_true(tm_patch_fill_grasped(solver, truth, &hold, tip_m, ground_block, &patch, NULL, 0));
    for (int v = 0; v < VERTICES - 1; v++) truth->vertex[v] += 100 * name; /* another patch each time */
    patch_to_controller(truth, held);
}

/* A grasper that pulls, and one that presses tissue next to its jaws: the library's law in double equals the
 * controller's. */
static void grasp_force_equals_the_simulations(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static tm_patch truth;
    static hrt_patch held;
    tm_patch_solver *solver = NULL;
    tm_error error = {0};
    uint64_t seed = 35;
    double worst = 0.0, most = 0.0, beside = 0.0;
    int compared = 0;
    assert_int_equal(tm_patch_solver_create(&solver, &error), TM_OK);
    for (int k = 0; k < 20; k++) {
        make_ground(&patch, &seed, 0.004f, 0.0006f, 0.12f);
        memcpy(patch.rest_m, patch.vertex_m, sizeof patch.rest_m);
        float tip[3] = {rig_uniform(&seed, -0.003f, 0.003f), rig_uniform(&seed, -0.003f, 0.003f), 0.1172f}, force[3];
        const float start[3] = {tip[0], tip[1], tip[2]};
        const double at_start[3] = {(double)tip[0], (double)tip[1], (double)tip[2]};
        hold_ground(solver, &seed, at_start, k, &truth, &held);
        assert_int_equal(hrt_patch_prepare(&held, scratch), HRT_ACCEPT);
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        take_grasper(&x, 0, tip, &held, 1);
        for (int step = 0; step < 50; step++) { /* every other one pulls; the others press in and sideways */
            double at[3], expected[3], along = 0.0;
            tip[0] += 0.00005f;
            tip[2] += k % 2 ? -0.00004f : 0.00005f;
            for (int i = 0; i < 3; i++) at[i] = (double)tip[i];
            settle(&x, tip, force);
            tm_patch_force(solver, &truth, at, expected, NULL);
            if ((x.limits & HRT_LIMIT_PATCH) != 0) break;
            for (int i = 0; i < 3; i++) {
                double hold = truth.grasp_N[i];
                for (int j = 0; j < 3; j++)
                    hold += truth.grasp_stiffness_N_m[3 * i + j] * (at[j] - truth.grasp_tip_m[j]);
                along += pow(expected[i] - hold, 2);
                worst = fmax(worst, fabs((double)force[i] - expected[i]));
                most = fmax(most, fabs(expected[i]));
            }
            beside = fmax(beside, sqrt(along));
            compared++;
        }
        /* A probe cannot be pulled: such a patch does not exist for it. */
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        take(&x, 0, start, &held, 1);
        hrt_extrapolation_force(&x, &params, 0, start, force);
        assert_true((x.limits & HRT_LIMIT_PATCH) != 0 && force[2] == 0.0f);
    }
    tm_patch_solver_destroy(solver);
    print_message("%d forces up to %.2f N, up to %.2f N beside the jaws: at most %.1e N off the simulation's\n",
                  compared, most, beside, worst);
    assert_true(compared > 900 && most > 0.5 && beside > 0.05 && worst < 1e-4 * most);
}

/* Jaws that close and open between two samples: the force changes without a jump. */
static void jaws_close_and_open_without_a_jump(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static tm_patch truth;
    static hrt_patch held;
    tm_patch_solver *solver = NULL;
    tm_error error = {0};
    uint64_t seed = 5;
    const float tip[3] = {0.0005f, 0.0003f, 0.1185f};
    const double at[3] = {(double)tip[0], (double)tip[1], (double)tip[2]};
    float force[3], last[3] = {0.0f, 0.0f, 0.0f}, settled[2] = {0.0f, 0.0f}, most = 0.0f;
    assert_int_equal(tm_patch_solver_create(&solver, &error), TM_OK);
    ground(0.0004f);
    hold_ground(solver, &seed, at, 0, &truth, &held);
    tm_patch_solver_destroy(solver);
    assert_int_equal(hrt_patch_prepare(&held, scratch), HRT_ACCEPT);
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    for (int t = 0; t < 120; t++) {
        if (t % 20 == 0) take_grasper(&x, 2000 * t, tip, t / 20 % 2 ? &held : &patch, (uint32_t)t + 1);
        hrt_extrapolation_force(&x, &params, 2000 * t, tip, force);
        assert_false((x.limits & HRT_LIMIT_PATCH) != 0);
        for (int i = 0; i < 3; i++)
            if (t > 10) most = fmaxf(most, fabsf(force[i] - last[i]));
        if (t % 20 == 19) settled[t / 20 % 2] = force[2];
        memcpy(last, force, sizeof last);
    }
    const float apart = fabsf(settled[1] - settled[0]);
    print_message("pushed with %.2f N, held with %.2f N: largest change within a tick %.3f N\n", (double)settled[0],
                  (double)settled[1], (double)most);
    assert_true(apart > 0.5f && most < 0.25f * apart);
}

/* Pressing and sliding at 500 Hz: accuracy and roughness of two linearisations of ten sweeps, against the converged
 * solution. */
static void two_linearisations_suffice(void **state) {
    (void)state;
    static hrt_extrapolation fast, slow;
    ground(0.0006f);
    hrt_extrapolation_reset(&fast, HRT_LOCAL_MODEL);
    hrt_extrapolation_reset(&slow, HRT_LOCAL_MODEL);
    float tip[3] = {-0.004f, 0.0f, 0.1172f}, f[2][3], past[2][2][3] = {0};
    take(&fast, 0, tip, &patch, 1);
    take(&slow, 0, tip, &patch, 1);
    double peak = 0.0, square = 0.0, rough[2] = {0.0, 0.0};
    const int ticks = 500;
    for (int t = 0; t < ticks; t++) { /* 8 mm in a second, 1.5 mm deep */
        tip[0] = -0.004f + 0.008f * (float)t / (float)ticks;
        tip[2] = 0.1174f + 0.0015f * fminf(1.0f, (float)t / 100.0f);
        hrt_extrapolation_force(&fast, &params, 0, tip, f[0]);
        settle(&slow, tip, f[1]);
        assert_false((fast.limits & HRT_LIMIT_PATCH) != 0);
        double error = 0.0, size = 0.0, bend[2] = {0.0, 0.0};
        for (int i = 0; i < 3; i++) {
            error += pow((double)(f[0][i] - f[1][i]), 2);
            size += pow((double)f[1][i], 2);
            for (int w = 0; w < 2; w++) {
                bend[w] += pow((double)(f[w][i] - 2.0f * past[w][0][i] + past[w][1][i]), 2);
                past[w][1][i] = past[w][0][i];
                past[w][0][i] = f[w][i];
            }
        }
        peak = fmax(peak, sqrt(size));
        square += error / ticks;
        for (int w = 0; w < 2 && t > 20; w++) rough[w] = fmax(rough[w], sqrt(bend[w]));
    }
    print_message(
        "sliding at 8 mm/s over bumps: RMS off the converged force %.4f %% of peak %.2f N; roughness %.2f %%, converged %.2f %%\n",
        100.0 * sqrt(square) / peak, peak, 100.0 * rough[0] / peak, 100.0 * rough[1] / peak);
    assert_true(peak > 0.2 && sqrt(square) / peak < 0.001 && rough[0] < 1.1 * rough[1] + 0.0005 * peak);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rows_are_those_of_the_simulation),
                                       cmocka_unit_test(pressing_flat_ground_gives_springs_in_series),
                                       cmocka_unit_test(viscous_drag_only_dissipates),
                                       cmocka_unit_test(solution_satisfies_complementarity),
                                       cmocka_unit_test(force_equals_the_simulations_solver),
                                       cmocka_unit_test(grasp_force_equals_the_simulations),
                                       cmocka_unit_test(jaws_close_and_open_without_a_jump),
                                       cmocka_unit_test(two_linearisations_suffice)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
