/* `local_model`: rows against the simulation's own detection, the solution against the conditions of contact,
 * transitions without a jump, patches that are rejected. */
#include "../fixture.h"
#include "held_patch.h"
#include "internal.h"
#include "rig.h"

#include "tensormass/contact.h"
#include "tensormass/patch.h"

enum { SIDE = 5, VERTICES = 24, TRIANGLES = 32 };

static hrt_params params;
static hrt_patch patch;
static float scratch[HRT_PATCH_COMPLIANCE];

static int packed(int n, int i, int j) { return i * (2 * n - i - 1) / 2 + j; }

/* Makes bumpy ground of 5 x 5 vertices less a corner, at depth z0 under the trocar, normals up to it. */
static void make_ground(hrt_patch *p, uint64_t *seed, float spacing, float bump, float z0) {
    memset(p, 0, sizeof *p);
    p->vertex_count = VERTICES;
    for (int v = 0; v < VERTICES; v++) {
        p->vertex_m[3 * v] = spacing * ((float)(v % SIDE) - 2.0f) + rig_uniform(seed, -0.15f, 0.15f) * spacing;
        p->vertex_m[3 * v + 1] = spacing * ((float)(v / SIDE) - 2.0f) + rig_uniform(seed, -0.15f, 0.15f) * spacing;
        p->vertex_m[3 * v + 2] = z0 + rig_uniform(seed, -bump, bump);
    }
    for (int x = 0; x < SIDE - 1; x++)
        for (int y = 0; y < SIDE - 1; y++) {
            const uint8_t a = (uint8_t)(x + SIDE * y), b = (uint8_t)(a + 1), c = (uint8_t)(a + SIDE),
                          d = (uint8_t)(c + 1);
            const uint8_t corner[6] = {a, c, b, b, c, d};
            for (int t = 0; t < 2; t++)
                if (corner[3 * t] < VERTICES && corner[3 * t + 1] < VERTICES && corner[3 * t + 2] < VERTICES)
                    memcpy(&p->triangle[3 * p->triangle_count++], &corner[3 * t], 3);
        }
    /* Fills the compliance of elastic ground with a decaying kernel: positive definite. */
    for (int i = 0; i < 3 * VERTICES; i++)
        for (int j = i; j < 3 * VERTICES; j++) {
            float apart[3];
            for (int c = 0; c < 3; c++) apart[c] = p->vertex_m[3 * (i / 3) + c] - p->vertex_m[3 * (j / 3) + c];
            const float far = sqrtf(apart[0] * apart[0] + apart[1] * apart[1]);
            p->compliance_m_N[packed(3 * VERTICES, i, j)] =
                i % 3 == j % 3 ? 0.003f * expf(-far / (2.0f * spacing)) : 0.0f;
        }
    p->contact_compliance_m_N = 0.0005f;
    p->radius_m = 0.0025f;
    p->contact_length_m = 0.08f;
}

static void take(hrt_extrapolation *x, int64_t t_us, const float tip[3], const hrt_patch *p, uint32_t seq) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = t_us, .seq = seq, .unilateral = true, .patch = p};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    hrt_extrapolation_sample(x, &params, &s);
}

static int set_up(void **state) {
    (void)state;
    hrt_params_default(&params);
    return 0;
}

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

static void ground(float bump) {
    uint64_t seed = 9;
    make_ground(&patch, &seed, 0.004f, bump, 0.12f);
    assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
}

static void settle(hrt_extrapolation *x, const float tip[3], float force[3]) {
    for (int k = 0; k < 60; k++) hrt_extrapolation_force(x, &params, 0, tip, force);
}

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

static float size_of(const float a[3]) { return sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

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

static void take_grasper(hrt_extrapolation *x, int64_t t_us, const float tip[3], const hrt_patch *p, uint32_t seq) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = t_us, .seq = seq, .patch = p};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    hrt_extrapolation_sample(x, &params, &s);
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

static void leaving_the_patch_hands_over_without_a_jump(void **state) {
    (void)state;
    static hrt_extrapolation x;
    ground(0.0002f);
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    float tip[3] = {0.0f, 0.0f, 0.1175f}, force[3], last[3] = {0}, most = 0.0f;
    take(&x, 0, tip, &patch, 1);
    bool left = false;
    int64_t t_us = 0;
    for (int t = 0; t < 1500; t++, t_us += 2000) {
        tip[0] = t < 200 ? 0.0f : 0.00002f * (float)(t - 200); /* 10 mm/s sideways, off the patch after 8 mm */
        tip[2] = 0.1175f + 0.001f * fminf(1.0f, (float)t / 100.0f);
        if (t % 20 == 0) { /* samples continue; the patch stays the same one */
            hrt_sample s = {.session = SIM,
                            .t_us = t_us,
                            .seq = (uint32_t)t,
                            .unilateral = true,
                            .patch = &patch,
                            .stiffness_kind = 2};
            memcpy(s.tip_m, tip, sizeof tip);
            memcpy(s.force_N, last, sizeof last);
            s.stiffness_N_m[8] = -400.0f;
            if (!left) hrt_extrapolation_sample(&x, &params, &s);
        }
        hrt_extrapolation_force(&x, &params, t_us, tip, force);
        if ((x.limits & HRT_LIMIT_PATCH) != 0) left = true;
        for (int i = 0; i < 3 && t > 2; i++) most = fmaxf(most, fabsf(force[i] - last[i]));
        memcpy(last, force, sizeof last);
    }
    assert_true(left);
    print_message("largest change within a tick, hand-over included: %.4f N\n", (double)most);
    assert_true(most < 0.05f);
}

/* Makes the patch without its last column of vertices: the same tissue, of smaller extent. */
static void narrower(const hrt_patch *whole, hrt_patch *to) {
    uint8_t kept[VERTICES], place[VERTICES];
    *to = *whole;
    to->vertex_count = to->triangle_count = 0;
    for (uint8_t v = 0; v < VERTICES; v++) {
        if (v % SIDE == SIDE - 1) continue;
        place[v] = (uint8_t)to->vertex_count;
        memcpy(&to->vertex_m[3 * to->vertex_count], &whole->vertex_m[3 * v], 3 * sizeof(float));
        memcpy(&to->rest_m[3 * to->vertex_count], &whole->rest_m[3 * v], 3 * sizeof(float));
        kept[to->vertex_count++] = v;
    }
    for (int t = 0; t < whole->triangle_count; t++) {
        const uint8_t *corner = &whole->triangle[3 * t];
        if (corner[0] % SIDE == SIDE - 1 || corner[1] % SIDE == SIDE - 1 || corner[2] % SIDE == SIDE - 1) continue;
        for (int k = 0; k < 3; k++) to->triangle[3 * to->triangle_count + k] = place[corner[k]];
        to->triangle_count++;
    }
    const int dofs = 3 * to->vertex_count;
    for (int i = 0; i < dofs; i++)
        for (int j = i; j < dofs; j++)
            to->compliance_m_N[packed(dofs, i, j)] =
                whole->compliance_m_N[packed(3 * VERTICES, 3 * kept[i / 3] + i % 3, 3 * kept[j / 3] + j % 3)];
    assert_int_equal(hrt_patch_prepare(to, scratch), HRT_ACCEPT);
}

/* Beyond the patch's end, compared with a patch that covers the tissue there: a patch that errs by less than 2 % is
 * kept, one that errs by more than 3.5 % is left. */
static void patch_is_left_beyond_its_end_only_if_inaccurate(void **state) {
    (void)state;
    static hrt_extrapolation whole, part;
    static hrt_patch less;
    float best_left = 1.0f, worst_kept = 0.0f, beyond = 0.0f;
    ground(0.0f);
    narrower(&patch, &less);
    for (int line = 0; line < 6; line++) {
        float tip[3] = {0.0f, 0.0007f * (float)(line - 3), 0.1185f}, force[2][3];
        hrt_extrapolation_reset(&whole, HRT_LOCAL_MODEL);
        hrt_extrapolation_reset(&part, HRT_LOCAL_MODEL);
        take(&whole, 0, tip, &patch, 1);
        take(&part, 0, tip, &less, 1);
        for (int t = 0; t < 375; t++) { /* 10 mm/s; the patch ends after 4 mm */
            tip[0] = 0.00002f * fmaxf(0.0f, (float)(t - 100));
            assert_true(hrt_contact_force(&patch, &whole.touch, 2000 * t, tip, force[0]));
            const bool kept = hrt_contact_force(&less, &part.touch, 2000 * t, tip, force[1]);
            if (t < 100) continue; /* both settle */
            for (int i = 0; i < 3; i++) force[1][i] -= force[0][i];
            beyond = size_of(force[1]) / size_of(force[0]);
            if (kept)
                worst_kept = fmaxf(worst_kept, beyond);
            else
                best_left = fminf(best_left, beyond);
        }
    }
    print_message("left when off by %.2f %% or more, kept up to %.2f %%, off by %.0f %% in the end\n",
                  100.0 * (double)best_left, 100.0 * (double)worst_kept, 100.0 * (double)beyond);
    assert_true(best_left > 0.02f && worst_kept < 0.035f && beyond > 0.5f);
}

static void cut_stale_or_missing_patch_blends_to_tangent(void **state) {
    (void)state;
    static hrt_extrapolation x;
    ground(0.0002f);
    float tip[3] = {0.0f, 0.0f, 0.1185f}, force[3];
    for (int what = 0; what < 3; what++) {
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        take(&x, 0, tip, &patch, 1);
        settle(&x, tip, force);
        assert_false((x.limits & HRT_LIMIT_PATCH) != 0);
        const float before = force[2];
        hrt_sample s = {.session = SIM, .t_us = 2000, .seq = 2, .unilateral = true, .force_N = {0, 0, -3.0f}};
        memcpy(s.tip_m, tip, sizeof tip);
        s.patch = what == 0 ? NULL : &patch;
        s.topology_revision = what == 1 ? 1 : 0; /* cut since the patch was made */
        const int64_t now_us = what == 2 ? 2000 + (int64_t)params.patch_stale_us + 1 : 4000;
        hrt_extrapolation_sample(&x, &params, &s);
        hrt_extrapolation_force(&x, &params, now_us, tip, force);
        assert_true((x.limits & HRT_LIMIT_PATCH) != 0);
        assert_float_equal(force[2], before, 0.01f); /* blended */
        for (int t = 1; t < 60; t++) hrt_extrapolation_force(&x, &params, now_us + 2000 * t, tip, force);
        assert_float_equal(force[2], -3.0f, 1e-4f); /* then the force of `tangent` */
    }
}

/* Makes the same ground, cut into something softer. */
static void cut_softer(hrt_patch *to) {
    *to = patch;
    to->topology_revision = 1;
    for (int i = 0; i < HRT_PATCH_COMPLIANCE; i++) to->compliance_m_N[i] *= 1.6f;
    assert_int_equal(hrt_patch_prepare(to, scratch), HRT_ACCEPT);
}

static void take_cut(hrt_extrapolation *x, int64_t t_us, const float tip[3], const hrt_patch *p, uint32_t seq) {
    hrt_sample s = {.session = SIM, .t_us = t_us, .seq = seq, .unilateral = true, .patch = p, .topology_revision = 1};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    hrt_extrapolation_sample(x, &params, &s);
}

/* The tool moves on, deeper or out, slower or faster than the force blends over to cut tissue. A tick changes the
 * force by the blend's rate, or by what the law itself changes, never by both. */
static void blending_to_cut_tissue_is_bounded_while_the_tool_moves(void **state) {
    (void)state;
    static hrt_extrapolation x, twin; /* the twin has cut tissue from the start */
    static hrt_patch softer;
    const float ways[] = {0.0f, 0.0001f, -0.0001f, 0.0003f, -0.0003f}; /* metres per tick */
    ground(0.0002f);
    cut_softer(&softer);
    for (int k = 0; k < 5; k++) {
        float tip[3] = {0.0f, 0.0f, 0.1185f}, force[3], law[3], last, last_law, largest = 0.0f;
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        take(&x, 0, tip, &patch, 1);
        settle(&x, tip, force);
        last = force[2];
        hrt_extrapolation_reset(&twin, HRT_LOCAL_MODEL);
        take_cut(&twin, 0, tip, &softer, 1);
        settle(&twin, tip, law);
        last_law = law[2];
        assert_true(fabsf(last - last_law) > 0.05f);
        take_cut(&x, 50000, tip, &softer, 2);
        for (int t = 1; t < 90; t++) {
            tip[2] += t < 10 ? ways[k] : 0.0f;
            hrt_extrapolation_force(&x, &params, 50000 + 2000 * t, tip, force);
            hrt_extrapolation_force(&twin, &params, 50000 + 2000 * t, tip, law);
            largest = fmaxf(largest, fmaxf(fabsf(last), fabsf(law[2])));
            const float pace = largest * 2000.0f / params.blend_us, own = fabsf(law[2] - last_law);
            if (t > 4) /* the first ticks converge */
                assert_true(fabsf(force[2] - last) < 1.01f * fmaxf(pace, own) + 1e-4f);
            last = force[2], last_law = law[2];
        }
        assert_float_equal(last, last_law, 1e-3f);
    }
}

/* A sample in every tick, the tissue cut in each, the tool on its patch in one and off it in the next: the force
 * follows the samples instead of staying at an old value. */
static void samples_in_every_tick_are_followed(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static hrt_patch cut[2];
    ground(0.0002f);
    for (int what = 0; what < 4; what++) {
        const float tip[3] = {0.0f, 0.0f, 0.1185f};
        float force[3], worst = 0.0f, size;
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        take(&x, 0, tip, &patch, 1);
        settle(&x, tip, force);
        size = force[2];
        for (int t = 1; t < 150; t++) {
            const float is = size * (1.0f + 0.5f * sinf(0.05f * (float)t)); /* 4 Hz */
            hrt_sample s = {.session = SIM, .t_us = 2000 * t, .seq = (uint32_t)t + 1, .unilateral = true};
            memcpy(s.tip_m, tip, sizeof tip);
            s.force_N[2] = is;
            s.topology_revision = what & 1 ? t : 0;
            cut[t % 2] = patch;
            cut[t % 2].topology_revision = s.topology_revision;
            if (what < 2 || t % 2) s.patch = what < 2 ? NULL : &cut[t % 2];
            hrt_extrapolation_sample(&x, &params, &s);
            hrt_extrapolation_force(&x, &params, 2000 * t, tip, force);
            if (t > 40 && what < 2) worst = fmaxf(worst, fabsf(force[2] - is));
            if (t > 40) worst = fmaxf(worst, fabsf(force[2] - is) - fabsf(is - size));
        }
        assert_true(worst < 0.1f * fabsf(size));
    }
}

/* Returns the force at `tip` with a patch whose sample has the force said_N. */
static float denied(hrt_extrapolation *x, const float tip[3], float said_N, uint16_t flags) {
    float force[3];
    hrt_sample s = {.session = SIM, .t_us = 40000, .seq = 2, .unilateral = true, .patch = &patch, .flags = flags};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    s.force_N[2] = said_N;
    hrt_extrapolation_reset(x, HRT_LOCAL_MODEL);
    hrt_extrapolation_sample(x, &params, &s);
    settle(x, tip, force);
    return force[2];
}

/* Under an active cautery, a patch without force where its sample has one (the tool is in a slit that the patch does
 * not contain), or with too much force, is not used; a patch that differs a little is corrected to its sample. For
 * any other tool the patch is used: it crossed an edge before the tissue did. */
static void patch_that_contradicts_its_sample_is_not_used_under_a_cautery(void **state) {
    (void)state;
    static hrt_extrapolation x;
    ground(0.0002f);
    const float tip[3] = {0.0f, 0.0f, 0.1185f};
    float force[3];
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    take(&x, 0, tip, &patch, 1);
    settle(&x, tip, force);
    const float size = force[2], shares[] = {1.0f, 0.8f, 1.3f, 0.3f, 3.0f};
    for (int k = 0; k < 5; k++) {
        const float said = shares[k] * size, cut = denied(&x, tip, said, HRT_FLAG_CUTTING);
        assert_int_equal((x.limits & HRT_LIMIT_PATCH) != 0, k > 2);
        assert_float_equal(cut, k > 2 ? said : said + 0.18f * (size - said), 1e-3f);
        assert_float_equal(denied(&x, tip, said, 0), size, 1e-3f);
        assert_false(x.limits & HRT_LIMIT_PATCH);
    }
}

/* After a cut by another hand the patch still predicts the force of motion; under an active cautery the force hardly
 * follows the patch's prediction. */
static void prediction_is_limited_under_an_active_cautery(void **state) {
    (void)state;
    static hrt_extrapolation x;
    const float at[3] = {0.0f, 0.0f, 0.1185f};
    float force[3], moved[2];
    ground(0.0002f);
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    take(&x, 0, at, &patch, 1);
    settle(&x, at, force);
    for (int cutting = 0; cutting < 2; cutting++) {
        float tip[3] = {0.0f, 0.0f, 0.1185f};
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        for (int k = 0; k < 3; k++) {
            hrt_sample s = {.session = SIM, .t_us = 40000 * k, .seq = (uint32_t)k, .unilateral = true, .patch = &patch};
            s.flags = cutting ? HRT_FLAG_CUTTING : 0;
            patch.topology_revision = s.topology_revision = k;
            memcpy(s.tip_m, tip, sizeof s.tip_m);
            memcpy(s.force_N, force, sizeof force);
            hrt_extrapolation_sample(&x, &params, &s);
            for (int t = 1; t <= 60; t++) hrt_extrapolation_force(&x, &params, s.t_us + 500 * t, tip, force);
        }
        const float before = force[2];
        tip[2] -= 0.0003f;
        for (int t = 1; t <= 60; t++) hrt_extrapolation_force(&x, &params, 110000 + 2000 * t, tip, force);
        moved[cutting] = force[2] - before;
    }
    patch.topology_revision = 0;
    assert_true(moved[0] > 0.05f);
    assert_float_equal(moved[1], 0.18f * moved[0], 0.02f * moved[0]);
}

/* A new patch of the same tissue, chosen a little further on and numbered otherwise, does not change the force. */
static void new_patch_of_the_same_tissue_does_not_change_the_force(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static hrt_patch other;
    ground(0.0006f);
    for (int t = 0; t < TRIANGLES; t++) patch.face[t] = 1000 + t;
    assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
    other = patch;
    const int n = patch.vertex_count, dofs = 3 * n;
    for (int v = 0; v < n; v++) { /* vertex v becomes n-1-v */
        memcpy(&other.vertex_m[3 * (n - 1 - v)], &patch.vertex_m[3 * v], 3 * sizeof(float));
        memcpy(&other.rest_m[3 * (n - 1 - v)], &patch.rest_m[3 * v], 3 * sizeof(float));
    }
    for (int i = 0; i < dofs; i++)
        for (int j = i; j < dofs; j++) {
            const int a = 3 * (n - 1 - i / 3) + i % 3, b = 3 * (n - 1 - j / 3) + j % 3;
            other.compliance_m_N[packed(dofs, a < b ? a : b, a < b ? b : a)] = patch.compliance_m_N[packed(dofs, i, j)];
        }
    for (int t = 0; t < patch.triangle_count; t++) {
        const int u = patch.triangle_count - 1 - t;
        other.face[u] = patch.face[t];
        for (int j = 0; j < 3; j++) other.triangle[3 * u + j] = (uint8_t)(n - 1 - patch.triangle[3 * t + j]);
    }
    assert_int_equal(hrt_patch_prepare(&other, scratch), HRT_ACCEPT);
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    float tip[3] = {0.0006f, 0.0003f, 0.1187f}, force[3], after[3];
    take(&x, 0, tip, &patch, 1);
    settle(&x, tip, force);
    assert_true(force[2] < -0.1f);
    take(&x, 0, tip, &other, 2);
    hrt_extrapolation_force(&x, &params, 0, tip, after);
    for (int i = 0; i < 3; i++) assert_float_equal(after[i], force[i], 2e-4f);
}

/* The first patch arrives with the tool already deep in it, without reactions to start from: the force converges and
 * does not oscillate. */
static void first_patch_under_a_deep_tool_converges(void **state) {
    (void)state;
    static hrt_extrapolation x;
    uint64_t seed = 12;
    int settled = 0, left = 0;
    double over = 0.0, late = 0.0;
    for (int k = 0; k < 200; k++) {
        make_ground(&patch, &seed, 0.004f, 0.0006f, 0.12f);
        assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
        hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
        const float tip[3] = {rig_uniform(&seed, -0.002f, 0.002f), rig_uniform(&seed, -0.002f, 0.002f),
                              0.1175f + rig_uniform(&seed, 0.5f, 2.2f) * 0.0025f};
        float force[40][3];
        double largest = 0.0, off = 0.0, size;
        take(&x, 0, tip, &patch, 1);
        for (int t = 0; t < 40 && (x.limits & HRT_LIMIT_PATCH) == 0; t++)
            hrt_extrapolation_force(&x, &params, 0, tip, force[t]);
        if ((x.limits & HRT_LIMIT_PATCH) != 0) {
            left++;
            continue;
        }
        size = sqrt((double)(force[39][0] * force[39][0] + force[39][1] * force[39][1] + force[39][2] * force[39][2]));
        for (int t = 0; t < 39; t++) {
            double apart = 0.0, here = 0.0;
            for (int i = 0; i < 3; i++) {
                apart += pow((double)(force[t][i] - force[39][i]), 2);
                here += pow((double)force[t][i], 2);
            }
            largest = fmax(largest, sqrt(here) / size);
            if (t >= 15) off = fmax(off, sqrt(apart) / size);
        }
        settled++;
        over = fmax(over, largest);
        late = fmax(late, off);
    }
    print_message("%d settled, %d left the patch; at most %.2f of the last force on the way, after 30 ms %.1e off\n",
                  settled, left, over, late);
    assert_true(left <= 4 && over < 1.5 && late < 0.01);
}

/* ---------------------------------------------------------------------------------------------- rejected patches */

/* The last vertex becomes the tip's node. */
static void hold_something(hrt_patch *p) {
    int32_t kept = 0;
    p->vertex_count--;
    for (int32_t t = 0; t < p->triangle_count; t++) {
        const uint8_t *corner = &p->triangle[3 * t];
        if (corner[0] == p->vertex_count || corner[1] == p->vertex_count || corner[2] == p->vertex_count) continue;
        p->face[kept] = p->face[t];
        memmove(&p->triangle[3 * kept++], corner, 3);
    }
    p->triangle_count = kept;
    p->grasped = 1u << p->vertex_count | 6u << 10;
    for (int i = 0; i < 3 * p->vertex_count; i++)
        for (int c = 0; c < 3; c++)
            p->compliance_m_N[packed(3 * VERTICES, i, 3 * p->vertex_count + c)] = c == i % 3 ? 0.5f : 0.0f;
    for (int i = 0; i < 6; i++)
        p->compliance_m_N[HRT_PATCH_COMPLIANCE - 6 + i] = i == 0 || i == 3 || i == 5 ? -300.0f : 0.0f;
    for (int c = 0; c < 3; c++) {
        p->vertex_m[hrt_patch_tip(p) + c] = c == 2 ? 0.118f : 0.0f;
        p->rest_m[hrt_patch_tip(p) + c] = 1.0f;
    }
}

/* Returns the verdict on the good patch after `spoil` has changed it, for cases 0, 1, ... */
static void refused(void (*spoil)(hrt_patch *p, int what), bool held, const hrt_reject *verdict, int count) {
    static hrt_patch p;
    ground(0.0005f);
    for (int what = 0; what < count; what++) {
        p = patch;
        if (held) hold_something(&p);
        spoil(&p, what);
        const hrt_reject told = hrt_patch_prepare(&p, scratch);
        if (told != verdict[what]) print_message("case %d\n", what);
        assert_int_equal(told, verdict[what]);
    }
}

static void spoil_patch(hrt_patch *p, int what) {
    switch (what) {
    case 1: p->vertex_count = 25; break;
    case 2: p->triangle_count = 33; break;
    case 3: p->triangle[5] = 24; break;
    case 4: p->triangle[1] = p->triangle[0]; break;
    case 5: p->vertex_m[7] = NAN; break;
    case 6: p->compliance_m_N[2627] = INFINITY; break;
    case 7: p->compliance_m_N[0] = -0.001f; break;
    case 8: p->compliance_m_N[3] = 0.01f; break; /* a coupling larger than its diagonal terms */
    case 9: p->radius_m = 1.0f; break;
    case 10: p->contact_compliance_m_N = -1.0f; break;
    case 11: memset(p->compliance_m_N, 0, sizeof p->compliance_m_N); break; /* rigid: semidefinite */
    case 12: p->vertex_count = 2; break;
    case 13: p->rest_m[3] = NAN; break;
    case 14: p->grasped = 1u << VERTICES; break; /* no node for the tip */
    default: break;
    }
}

static void bad_patches_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {HRT_ACCEPT,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_ASYMMETRIC,
                                         HRT_REJECT_ASYMMETRIC,
                                         HRT_REJECT_HUGE,
                                         HRT_REJECT_HUGE,
                                         HRT_ACCEPT,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_INDEX};
    refused(spoil_patch, false, verdict, sizeof verdict / sizeof *verdict);
}

static void spoil_hold(hrt_patch *p, int what) {
    float *stiffness = &p->compliance_m_N[HRT_PATCH_COMPLIANCE - 6];
    switch (what) {
    case 1: p->grasped = 3u; break; /* grasped vertices without a grasp */
    case 2: p->grasped |= 1u << (VERTICES + 4); break;
    case 3: stiffness[0] = 200.0f; break;         /* pushes on instead of resisting */
    case 4: p->compliance_m_N[69] = 11.0f; break; /* a vertex that moves more than the tip */
    case 5: p->compliance_m_N[70] = NAN; break;
    case 6: p->rest_m[hrt_patch_tip(p)] = 1001.0f; break; /* the force */
    case 7: p->vertex_m[hrt_patch_tip(p) + 2] = NAN; break;
    case 8: stiffness[5] = -2.0e9f; break;
    case 9: stiffness[1] = 400.0f; break; /* indefinite */
    default: break;
    }
}

static void bad_grasps_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {
        HRT_ACCEPT,      HRT_REJECT_INDEX,      HRT_REJECT_INDEX, HRT_REJECT_ASYMMETRIC,
        HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE,  HRT_REJECT_NOT_FINITE,
        HRT_REJECT_HUGE, HRT_REJECT_ASYMMETRIC};
    refused(spoil_hold, true, verdict, sizeof verdict / sizeof *verdict);
}

static void spoil_drag(hrt_patch *p, int what) {
    switch (what) {
    case 0: p->radiation_N_s_m = -0.1f; break; /* drives instead of resisting */
    case 1: p->radiation_s = NAN; break;
    case 2: p->radiation_N_s_m = 11.0f; break;
    case 3: p->friction_static = 2.1f; break;
    case 4: p->friction_static = 0.2f, p->friction_kinetic = 0.3f; break;
    case 5: p->friction_static = NAN; break;
    case 6: p->friction_kinetic = -0.1f; break;
    case 7: p->friction_static = 2.0f, p->friction_kinetic = 2.0f; break;
    default: break;
    }
}

static void bad_drags_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE, HRT_REJECT_HUGE,
                                         HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE, HRT_ACCEPT};
    refused(spoil_drag, true, verdict, sizeof verdict / sizeof *verdict);
}

/* For any patch that passes the check, the tick stays finite and bounded. */
static void wild_patches_stay_bounded(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static hrt_patch p[2];
    uint64_t seed = 77;
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    int taken = 0;
    for (int k = 0; k < 3000; k++) {
        hrt_patch *q = &p[k % 2];
        make_ground(q, &seed, rig_uniform(&seed, 0.0f, 0.006f), rig_uniform(&seed, 0.0f, 0.01f), 0.12f);
        if (k % 3 == 0)
            for (int i = 0; i < 96; i++) q->triangle[i] = (uint8_t)(rig_random(&seed) % VERTICES);
        if (k % 5 == 0) memset(q->compliance_m_N, 0, sizeof q->compliance_m_N);
        if (k % 7 == 0) q->contact_compliance_m_N = 0.0f;
        if (k % 4 == 0) hold_something(q);
        if (k / 16 % 2) q->friction_static = 2.0f, q->friction_kinetic = rig_uniform(&seed, 0.0f, 2.0f);
        if (hrt_patch_prepare(q, scratch) != HRT_ACCEPT) continue;
        taken++;
        float tip[3] = {rig_uniform(&seed, -0.01f, 0.01f), rig_uniform(&seed, -0.01f, 0.01f),
                        rig_uniform(&seed, 0.11f, 0.13f)},
              force[3];
        if (k % 4 == 0)
            take_grasper(&x, 2000 * k, tip, q, (uint32_t)k);
        else
            take(&x, 2000 * k, tip, q, (uint32_t)k);
        for (int t = 0; t < 4; t++) {
            for (int i = 0; i < 3; i++) tip[i] += rig_uniform(&seed, -0.001f, 0.001f);
            hrt_extrapolation_force(&x, &params, 2000 * k + t, tip, force);
            for (int i = 0; i < 3; i++)
                assert_true(isfinite(force[i]) &&
                            fabsf(force[i]) <= 50.0f * HRT_CONTACT_ROWS * (1.5f + q->friction_static));
        }
    }
    assert_true(taken > 1500);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rows_are_those_of_the_simulation),
                                       cmocka_unit_test(pressing_flat_ground_gives_springs_in_series),
                                       cmocka_unit_test(viscous_drag_only_dissipates),
                                       cmocka_unit_test(solution_satisfies_complementarity),
                                       cmocka_unit_test(force_equals_the_simulations_solver),
                                       cmocka_unit_test(grasp_force_equals_the_simulations),
                                       cmocka_unit_test(jaws_close_and_open_without_a_jump),
                                       cmocka_unit_test(two_linearisations_suffice),
                                       cmocka_unit_test(leaving_the_patch_hands_over_without_a_jump),
                                       cmocka_unit_test(blending_to_cut_tissue_is_bounded_while_the_tool_moves),
                                       cmocka_unit_test(samples_in_every_tick_are_followed),
                                       cmocka_unit_test(patch_that_contradicts_its_sample_is_not_used_under_a_cautery),
                                       cmocka_unit_test(prediction_is_limited_under_an_active_cautery),
                                       cmocka_unit_test(patch_is_left_beyond_its_end_only_if_inaccurate),
                                       cmocka_unit_test(cut_stale_or_missing_patch_blends_to_tangent),
                                       cmocka_unit_test(new_patch_of_the_same_tissue_does_not_change_the_force),
                                       cmocka_unit_test(first_patch_under_a_deep_tool_converges),
                                       cmocka_unit_test(bad_patches_are_rejected),
                                       cmocka_unit_test(bad_grasps_are_rejected),
                                       cmocka_unit_test(bad_drags_are_rejected),
                                       cmocka_unit_test(wild_patches_stay_bounded)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
