/* Power into a hand: hostile samples push a light hand along its own motion, ever faster. Force times true motion
 * stays within the limit over windows of every length. */
#include "../long.h"
#include "rig.h"

enum { PARTS = 20, WINDOWS = 4 }; /* of a tick, during which the hand moves */
static const int window_ticks[WINDOWS] = {1, 5, 25, 100};
/* Share of the limit: during one tick the hand may move unpredictably; over longer windows this is compensated. */
static const double allowance[WINDOWS] = {1.15, 1.05, 1.01, 1.0};

typedef struct hand {
    double mass[HRT_MOTORS], joint[HRT_MOTORS], rate[HRT_MOTORS], stiffness, damping;
} hand;

/* Applies the joints' torques for one tick; returns their work. */
static double push(hand *h, const float torque[HRT_MOTORS]) {
    double work = 0.0;
    for (int p = 0; p < PARTS; p++)
        for (int j = 0; j < HRT_MOTORS; j++) {
            const double dt = 1e-6 * TICK_US / PARTS, rest = j == HRT_INSERTION ? 0.12 : 0.0;
            const double own = -h->stiffness * h->mass[j] * (h->joint[j] - rest) - h->damping * h->mass[j] * h->rate[j];
            h->rate[j] += dt * ((double)torque[j] + own) / h->mass[j];
            h->joint[j] += dt * h->rate[j];
            work += (double)torque[j] * dt * h->rate[j];
        }
    return work;
}

/* Makes a hostile sample: a force along the motion, of maximum size or at random. */
static void incite(rig *r, const hand *h, uint64_t *seed, int how) {
    float J[9], along[3] = {0};
    hrt_jacobian(&r->c.axes, r->c.joint, J);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < HRT_MOTORS; j++) along[i] += J[3 * i + j] * (float)h->rate[j];
    const float size = sqrtf(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);
    for (int i = 0; i < 3; i++) {
        r->force_N[i] = size > 1e-4f ? 14.0f * along[i] / size : 1.0f;
        if (how > 0 && rig_random(seed) % 8 == 0) r->force_N[i] = rig_uniform(seed, -14.0f, 14.0f);
    }
}

static double worst_W[WINDOWS], longest_J;

static void session(uint64_t seed, bool passivity, hrt_extrapolator law) {
    static rig r;
    static double work[100];
    rig_engage(&r);
    uint64_t random = seed;
    const double light = 0.05 * pow(10.0, rig_uniform(&random, 0.0f, 1.0f));
    hand h = {.stiffness = pow(10.0, rig_uniform(&random, 1.0f, 3.0f)), .damping = rig_uniform(&random, 0.0f, 3.0f)};
    const double lever[HRT_MOTORS] = {0.12, 0.12, 1.0};
    for (int j = 0; j < HRT_MOTORS; j++) {
        h.mass[j] = light * lever[j] * lever[j];
        h.rate[j] = rig_uniform(&random, -0.05f, 0.05f) / lever[j];
    }
    h.joint[HRT_INSERTION] = (double)r.c.joint[HRT_INSERTION];
    r.frame_us = TICK_US * (1 + (int64_t)(rig_random(&random) % 20));
    r.in.extrapolator = law;
    r.in.passivity = passivity;
    double all = 0.0;
    memset(work, 0, sizeof work);
    for (int t = 0; t < 1500; t++) {
        incite(&r, &h, &random, (int)(seed % 3));
        for (int j = 0; j < HRT_MOTORS; j++)
            r.in.count[j] = (int32_t)lround((double)hrt_count_of_joint(&r.params, j, (float)h.joint[j]));
        rig_tick(&r);
        if (r.out.state == HRT_FAULT) break; /* faster than a hand can move: the force is zero */
        work[t % 100] = push(&h, r.out.torque);
        all += work[t % 100];
        for (int w = 0; w < WINDOWS && t >= window_ticks[w]; w++) {
            double sum = 0.0;
            for (int k = 0; k < window_ticks[w]; k++) sum += work[(t - k) % 100];
            worst_W[w] = fmax(worst_W[w], sum / (1e-6 * TICK_US * window_ticks[w]));
        }
        longest_J = fmax(longest_J, all);
    }
}

static void force_times_true_motion_stays_within_the_limit(void **state) {
    (void)state;
    hrt_params p;
    hrt_params_default(&p);
    const hrt_extrapolator laws[] = {HRT_HOLD, HRT_TIME, HRT_TANGENT};
    for (uint64_t seed = 1; seed <= (test_is_long() ? 20000 : 300); seed++)
        session(seed, seed % 2 != 0, laws[seed % 3]);
    print_message("most over 2, 10, 50, 200 ms: %.2f, %.2f, %.2f, %.2f W; the limit is %.1f W\n", worst_W[0],
                  worst_W[1], worst_W[2], worst_W[3], (double)p.power_max_W);
    assert_true(worst_W[3] > 0.5 * (double)p.power_max_W); /* the limit was reached */
    for (int w = 0; w < WINDOWS; w++) assert_true(worst_W[w] < allowance[w] * (double)p.power_max_W);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(force_times_true_motion_stays_within_the_limit)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
