/* Every extrapolator in critical cases: standstill, reversal, jitter of one count, late, lost, doubled and reordered
 * samples, wrap of seq. */
#include "rig.h"

static hrt_params params;
static hrt_extrapolation x;
static const float STEP = 0.0005f; /* between samples: 10 mm/s at 20 Hz */

static int set_up(void **state) {
    (void)state;
    hrt_params_default(&params);
    return 0;
}

/* A spring along z: F = -400 (z - 0.1). */
static hrt_sample spring(int64_t t_us, float z) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = t_us, .stiffness_kind = 2, .unilateral = true};
    s.tip_m[2] = z;
    s.force_N[2] = -400.0f * (z - 0.1f);
    s.stiffness_N_m[8] = -400.0f;
    return s;
}

static void begin(hrt_extrapolator which, float z0, float z1) {
    hrt_extrapolation_reset(&x, which);
    hrt_sample s = spring(0, z0);
    hrt_extrapolation_sample(&x, &params, &s);
    s = spring(50000, z1);
    hrt_extrapolation_sample(&x, &params, &s);
}

static float force_at(int64_t t_us, float z) {
    const float tip[3] = {0.0f, 0.0f, z};
    float force[3];
    hrt_extrapolation_force(&x, &params, t_us, tip, force);
    assert_true(isfinite(force[0]) && isfinite(force[1]) && isfinite(force[2]));
    return force[2];
}

static void names_and_numbers_of_extrapolators_agree(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        hrt_extrapolator found;
        assert_true(hrt_extrapolator_find(hrt_extrapolator_name((hrt_extrapolator)w), &found));
        assert_int_equal(found, w);
    }
    hrt_extrapolator none;
    assert_false(hrt_extrapolator_find("positio", &none));
    assert_false(hrt_extrapolator_find("position_", &none));
    assert_false(hrt_extrapolator_find("", &none));
}

static void force_along_a_line_is_extrapolated(void **state) {
    (void)state;
    const float truth = -400.0f * 3.0f * STEP;
    begin(HRT_HOLD, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), -400.0f * 2 * STEP, 1e-4);
    begin(HRT_TIME, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), truth, 1e-4);
    assert_float_equal(force_at(100000, 0.1f), truth, 1e-4); /* wherever the tool is */
    /* The guard against division by small steps costs (standstill/step)^2 = 1 % of the change. */
    begin(HRT_POSITION, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), truth, 0.02f * 400.0f * STEP);
    begin(HRT_BROYDEN, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), truth, 0.02f * 400.0f * STEP);
    begin(HRT_TANGENT, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), truth, 1e-4);
    begin(HRT_LOCAL_MODEL, 0.1f + STEP, 0.1f + 2 * STEP); /* no patch: tangent */
    assert_float_equal(force_at(100000, 0.1f + 3 * STEP), truth, 1e-4);
    assert_true((x.limits & HRT_LIMIT_PATCH) != 0);
}

static void force_after_a_reversal_is_that_of_the_earlier_place(void **state) {
    (void)state;
    /* The tool returns to an earlier place: signed laws give the force of that place, the printed one grows. */
    const float truth = -400.0f * STEP, tolerance = 0.02f * 400.0f * STEP;
    begin(HRT_POSITION, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + STEP), truth, tolerance);
    begin(HRT_BROYDEN, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + STEP), truth, tolerance);
    begin(HRT_TANGENT, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + STEP), truth, tolerance);
    begin(HRT_PAPER_POSITION, 0.1f + STEP, 0.1f + 2 * STEP);
    assert_float_equal(force_at(100000, 0.1f + STEP), 3.0f * truth, tolerance);
}

static void tissue_never_pulls(void **state) {
    (void)state;
    const hrt_extrapolator signed_laws[] = {HRT_POSITION, HRT_BROYDEN, HRT_TANGENT, HRT_LOCAL_MODEL};
    for (int i = 0; i < 4; i++) {
        begin(signed_laws[i], 0.1f + STEP, 0.1f + 2 * STEP);
        assert_float_equal(force_at(60000, 0.095f), 0.0f, 1e-6); /* far out of the tissue */
        begin(signed_laws[i], 0.1f + STEP, 0.1f + 2 * STEP);
        x.now.unilateral = false; /* a grasper may be pulled, if the sample has the stiffness of the grasp */
        const float pulled = force_at(60000, 0.1f - STEP);
        if (signed_laws[i] == HRT_TANGENT || signed_laws[i] == HRT_LOCAL_MODEL)
            assert_true(pulled > 0.1f);
        else
            assert_float_equal(pulled, 0.0f, 1e-6);
    }
}

static void standstill_keeps_the_force(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        hrt_extrapolation_reset(&x, (hrt_extrapolator)w);
        assert_float_equal(force_at(0, 0.1f), 0.0f, 0.0f); /* before any sample */
        for (int k = 0; k < 5; k++) {
            const hrt_sample s = spring(50000 * k, 0.11f);
            hrt_extrapolation_sample(&x, &params, &s);
            assert_float_equal(force_at(50000 * k + 40000, 0.11f), -4.0f, 1e-5);
        }
    }
}

/* The tool stands still, one encoder count comes and goes, and the force of the samples is rough by 0.05 N: the
 * rendered force stays near. */
static void jitter_of_one_count_hardly_changes_the_force(void **state) {
    (void)state;
    const float count = 1.0f / 40000.0f;
    uint64_t seed = 3;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        if (w == HRT_PAPER_POSITION) continue; /* as printed in the paper; see the bound below */
        hrt_extrapolation_reset(&x, (hrt_extrapolator)w);
        double worst = 0.0;
        for (int k = 0; k < 400; k++) {
            hrt_sample s = spring(50000 * k, 0.11f + (float)(rig_random(&seed) % 2) * count);
            s.force_N[2] = -4.0f + rig_uniform(&seed, -0.025f, 0.025f);
            hrt_extrapolation_sample(&x, &params, &s);
            for (int t = 0; t < 25; t++)
                worst = fmax(
                    worst,
                    fabs((double)force_at(50000 * k + 2000 * t, 0.11f + (float)(rig_random(&seed) % 2) * count) + 4.0));
        }
        print_message("%-8s one count of jitter, 0.05 N of roughness: off by at most %.3f N\n",
                      hrt_extrapolator_name((hrt_extrapolator)w), worst);
        assert_true(worst < (w == HRT_TIME ? 0.08 : 0.1));
    }
}

static void force_is_bounded_for_any_differences(void **state) {
    (void)state;
    uint64_t seed = 11;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        hrt_extrapolation_reset(&x, (hrt_extrapolator)w);
        for (int k = 0; k < 3000; k++) {
            hrt_sample s = spring(2000 * k, 0.1f + rig_uniform(&seed, -1e-6f, 1e-6f));
            for (int i = 0; i < 3; i++) s.force_N[i] = rig_uniform(&seed, -8.0f, 8.0f);
            assert_int_equal(hrt_sample_check(&s, &params), HRT_ACCEPT);
            hrt_extrapolation_sample(&x, &params, &s);
            /* Bound: F_n + ratio_max dF, or F_n + stiffness_max horizon. */
            const float most =
                fmaxf(14.0f + params.ratio_max * 28.0f, 14.0f + params.stiffness_max_N_m * params.horizon_m);
            assert_true(fabsf(force_at(2000 * k + 1000, rig_uniform(&seed, -0.2f, 0.2f))) <= most * 1.001f);
        }
    }
}

static void extrapolation_stops_at_the_horizon(void **state) {
    (void)state;
    begin(HRT_TIME, 0.1f, 0.1f + STEP);
    const float at = force_at(50000 + (int64_t)params.horizon_us, 0.1f);
    assert_false((x.limits & HRT_LIMIT_HORIZON) != 0);
    assert_float_equal(force_at(9000000, 0.1f), at, 1e-6);
    assert_true((x.limits & HRT_LIMIT_HORIZON) != 0);
    begin(HRT_TANGENT, 0.1f, 0.1f + STEP);
    assert_float_equal(force_at(60000, 0.5f), -400.0f * (STEP + params.horizon_m), 1e-3);
    assert_true((x.limits & HRT_LIMIT_HORIZON) != 0);
}

static void changing_the_extrapolator_makes_no_jump(void **state) {
    (void)state;
    for (int from = 0; from < HRT_EXTRAPOLATOR_COUNT; from++)
        for (int to = 0; to < HRT_EXTRAPOLATOR_COUNT; to++) {
            begin((hrt_extrapolator)from, 0.1f + 4 * STEP, 0.1f + 8 * STEP);
            float last = force_at(90000, 0.1f + 10 * STEP);
            hrt_extrapolation_select(&x, (hrt_extrapolator)to);
            float most = 0.0f;
            for (int t = 1; t < 30; t++) {
                const float now = force_at(90000 + 2000 * t, 0.1f + 10 * STEP);
                most = fmaxf(most, fabsf(now - last));
                last = now;
            }
            assert_true(most < 0.2f); /* 2 ms of 30 of a difference of up to 2 N, and `time` extrapolates by itself */
        }
}

/* The force falls because tissue is removed, while the tool hardly moves: no estimator mistakes that for stiffness
 * and raises the force again when the tool is withdrawn. */
static void falling_force_of_a_cut_is_not_taken_for_stiffness(void **state) {
    (void)state;
    const hrt_extrapolator estimating[] = {HRT_BROYDEN, HRT_TANGENT,
                                           HRT_LOCAL_MODEL}; /* the laws without a sent stiffness */
    for (int k = 0; k < 3; k++) {
        hrt_extrapolation_reset(&x, estimating[k]);
        for (int i = 0; i < 6; i++) {
            hrt_sample s = spring(50000 * i, 0.1f + STEP * (float)(i < 3 ? i + 1 : 3));
            s.stiffness_kind = 0;
            s.topology_revision = i < 3 ? 0 : i;
            if (i >= 3) s.force_N[2] *= 0.3f / (float)(i - 2), s.tip_m[2] += 0.02f * STEP * (float)i;
            hrt_extrapolation_sample(&x, &params, &s);
        }
        const float last = 400.0f * 3 * STEP * 0.1f;
        for (int t = 0; t < 100; t++) { /* deeper, and back */
            const float force = force_at(250000 + 500 * t, 0.1f + 3 * STEP * (1.0f - 0.02f * (float)t));
            assert_true(force < 1e-6f && force > -1.2f * last);
        }
    }
}

/* A grasp is pulled until its stiffness is well known, then released while the hand withdraws: the force is the
 * sample's, and the learned stiffness is not used again. */
static void learned_stiffness_ends_with_the_grasp(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++)
        for (int flagged = 1; flagged < 3; flagged++) {
            hrt_extrapolation_reset(&x, (hrt_extrapolator)w);
            for (int k = 0; k < 8; k++) {
                hrt_sample s = spring(40000 * k, 0.1f + STEP * (float)k);
                s.unilateral = false;
                if (k >= 4) {
                    s.flags = k < 4 + flagged ? HRT_FLAG_RELEASING : 0;
                    s.force_N[2] *= 0.1f / (float)(k - 3);
                    s.stiffness_kind = 0;
                }
                hrt_extrapolation_sample(&x, &params, &s);
                if (k < 4) continue;
                for (int t = 0; t < 20; t++) { /* some are a frame late */
                    const float force = force_at(40000 * (k + 1) + 2000 * t, s.tip_m[2] - 0.1f * STEP * (float)t);
                    if (k <= 4 + flagged) assert_float_equal(force, s.force_N[2], 1e-6f);
                    assert_true(fabsf(force) <= 1.5f * fabsf(s.force_N[2]));
                }
            }
        }
}

/* Deep in a cut a stiffness may belong to another equilibrium: 2,000 N/m where the force hardly follows the tool. It
 * is used for at most one sample. */
static void wrong_stiffness_lasts_at_most_one_sample(void **state) {
    (void)state;
    const hrt_extrapolator receiving[] = {HRT_TANGENT, HRT_LOCAL_MODEL};
    for (int i = 0; i < 2; i++)
        for (int cut = 0; cut < 2; cut++) {
            hrt_extrapolation_reset(&x, receiving[i]);
            for (int k = 0; k < 8; k++) {
                hrt_sample s = spring(40000 * k, 0.1f + 2 * STEP * (float)k);
                s.force_N[2] = k % 2 ? -0.05f : -0.06f;
                s.stiffness_N_m[8] = -2000.0f;
                s.topology_revision = cut ? k : 0;
                hrt_extrapolation_sample(&x, &params, &s);
                const float force = force_at(40000 * k + 38000, s.tip_m[2] + 2 * STEP);
                if (k > 0) assert_true(fabsf(force) < 0.09f); /* 2 N by that stiffness */
            }
        }
}

/* With samples in every tick and noise of 10 mN, estimates from differences stay as accurate as with 25 samples a
 * second. */
static void estimates_stay_accurate_with_samples_in_every_tick(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        uint64_t seed = 5;
        float worst = 0.0f;
        hrt_extrapolation_reset(&x, (hrt_extrapolator)w);
        for (int k = 0; k < 500; k++) {
            const float z = 0.11f + 0.002f * sinf(0.02f * (float)k), felt_at = z + 1.0e-4f * cosf(0.02f * (float)k);
            hrt_sample s = spring(2000 * k, z);
            s.stiffness_kind = 0;
            s.force_N[2] += rig_uniform(&seed, -0.01f, 0.01f);
            hrt_extrapolation_sample(&x, &params, &s);
            if (k > 20) worst = fmaxf(worst, fabsf(force_at(2000 * k + 2000, felt_at) + 400.0f * (felt_at - 0.1f)));
        }
        assert_true(worst < 0.08f);
    }
}

/* Broyden's update keeps directions off the line: after probing z, then x, both stiffnesses are known. */
static void broyden_keeps_the_stiffness_of_earlier_directions(void **state) {
    (void)state;
    hrt_extrapolation_reset(&x, HRT_BROYDEN);
    const float path[5][2] = {{0, 0.110f}, {0, 0.112f}, {0.002f, 0.112f}, {0.002f, 0.114f}, {0.004f, 0.114f}};
    for (int k = 0; k < 5; k++) {
        hrt_sample s = spring(50000 * k, path[k][1]);
        s.tip_m[0] = path[k][0];
        s.force_N[0] = -150.0f * path[k][0];
        hrt_extrapolation_sample(&x, &params, &s);
    }
    assert_float_equal(x.broyden_N_m[0], -150.0f, 2.0f);
    assert_float_equal(x.broyden_N_m[8], -400.0f, 2.0f);
}

/* ---------------------------------------------------------------------------------------------- order of samples,
 * through the tick */

static rig r;

static void give(uint32_t seq, int64_t t_us, float force) {
    r.sample.seq = seq;
    r.sample.t_us = t_us;
    r.sample.force_N[2] = force;
    hrt_tick(&r.c, r.now_us, &r.in, &r.sample, &r.out);
    r.now_us += TICK_US;
    r.in.encoder_us = r.now_us;
}

static void lost_late_doubled_and_reordered_samples_are_handled(void **state) {
    (void)state;
    rig_engage(&r);
    r.sim = false;
    const uint32_t at = r.c.sample_seq;
    hrt_counters before = r.c.counters;
    give(at + 1, r.now_us, -1.0f);
    give(at + 1, r.now_us, -9.0f); /* doubled */
    assert_int_equal(r.c.counters.samples_late - before.samples_late, 1);
    assert_float_equal(r.c.extrapolation.now.force_N[2], -1.0f, 0.0f);
    give(at + 4, r.now_us, -2.0f); /* two lost */
    assert_int_equal(r.c.counters.samples_lost - before.samples_lost, 2);
    give(at + 2, r.now_us, -9.0f); /* overtaken */
    assert_int_equal(r.c.counters.samples_late - before.samples_late, 2);
    give(at + 5, r.now_us - 60000, -9.0f); /* newer seq, older time */
    assert_int_equal(r.c.counters.samples_late - before.samples_late, 3);
    assert_float_equal(r.c.extrapolation.now.force_N[2], -2.0f, 0.0f);
    before = r.c.counters;
    give(at + 6, r.now_us + 1000000, -9.0f); /* from the future */
    r.sample.tool_session = SESSION + 1;
    give(at + 7, r.now_us, -9.0f); /* for another controller */
    r.sample.tool_session = SESSION;
    assert_int_equal(r.c.counters.samples_rejected - before.samples_rejected, 2);
    assert_float_equal(r.c.extrapolation.now.force_N[2], -2.0f, 0.0f);
}

static void seq_wraps(void **state) {
    (void)state;
    rig_start(&r);
    r.sample.seq = 0xFFFFFFF0u;
    rig_run(&r, 3.0);
    assert_int_equal(r.out.state, HRT_ENGAGED);
    assert_true(r.c.sample_seq < 0x100u);
    assert_int_equal(r.c.counters.samples_late, 0);
    assert_int_equal(r.c.counters.samples_lost, 0);
    assert_true(hrt_seq_after(2, 0xFFFFFFFEu) && !hrt_seq_after(0xFFFFFFFEu, 2) && !hrt_seq_after(7, 7));
}

/* A damaged seq far ahead blocks the stream until it is stale; then the good stream is accepted again. */
static void damaged_seq_blocks_only_until_stale(void **state) {
    (void)state;
    rig_engage(&r);
    const uint32_t good = r.sample.seq;
    r.sample.seq += 0x40000000u;
    rig_run(&r, 0.04);
    r.sample.seq = good;
    rig_until(&r, HRT_IDLE, 0.3);
    rig_until(&r, HRT_ENGAGED, 0.3);
}

/* ---------------------------------------------------------------------------------------------- rejected before the
 * tick */

static void invalid_samples_are_rejected(void **state) {
    (void)state;
    const hrt_sample good = spring(1000, 0.11f);
    const float wild[] = {NAN, INFINITY, -INFINITY, 3.4e38f};
    for (int k = 0; k < 4; k++)
        for (int f = 0; f < 15; f++) {
            hrt_sample s = good;
            if (f < 3)
                s.tip_m[f] = wild[k];
            else if (f < 6)
                s.force_N[f - 3] = wild[k];
            else
                s.stiffness_N_m[f - 6] = wild[k];
            assert_int_not_equal(hrt_sample_check(&s, &params), HRT_ACCEPT);
        }
    hrt_sample s = good;
    s.stiffness_kind = 3;
    assert_int_equal(hrt_sample_check(&s, &params), HRT_REJECT_INDEX);
    s = good;
    s.stiffness_N_m[8] = -1e6f; /* bounded, not rejected */
    assert_int_equal(hrt_sample_check(&s, &params), HRT_ACCEPT);
    assert_float_equal(s.stiffness_N_m[8], -params.stiffness_max_N_m, 1.0f);
    for (int v = 0; v < HRT_REJECT_COUNT; v++) assert_string_not_equal(hrt_reject_text((hrt_reject)v), "unknown");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(names_and_numbers_of_extrapolators_agree),
                                       cmocka_unit_test(force_along_a_line_is_extrapolated),
                                       cmocka_unit_test(force_after_a_reversal_is_that_of_the_earlier_place),
                                       cmocka_unit_test(tissue_never_pulls),
                                       cmocka_unit_test(standstill_keeps_the_force),
                                       cmocka_unit_test(jitter_of_one_count_hardly_changes_the_force),
                                       cmocka_unit_test(force_is_bounded_for_any_differences),
                                       cmocka_unit_test(extrapolation_stops_at_the_horizon),
                                       cmocka_unit_test(changing_the_extrapolator_makes_no_jump),
                                       cmocka_unit_test(learned_stiffness_ends_with_the_grasp),
                                       cmocka_unit_test(wrong_stiffness_lasts_at_most_one_sample),
                                       cmocka_unit_test(estimates_stay_accurate_with_samples_in_every_tick),
                                       cmocka_unit_test(broyden_keeps_the_stiffness_of_earlier_directions),
                                       cmocka_unit_test(falling_force_of_a_cut_is_not_taken_for_stiffness),
                                       cmocka_unit_test(lost_late_doubled_and_reordered_samples_are_handled),
                                       cmocka_unit_test(seq_wraps),
                                       cmocka_unit_test(damaged_seq_blocks_only_until_stale),
                                       cmocka_unit_test(invalid_samples_are_rejected)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
