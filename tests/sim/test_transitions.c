/* Rendered force when a tool touches, grasps, releases, cuts and loses its patch, on shipped scenes: recorded at the
 * scene's rate and at every tick, and replayed through every extrapolator.
 *
 * No transition creates a new peak: the force stays within 1.1 times the largest reference or sample force around
 * that time, plus SLACK_N for changes that no sample contains yet. */
// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "../long.h"
#include "studies/replay/replay.h"

enum { SCENES = 2, HANDS = 2, TICKS_A_FRAME = 20 };
static const double SLACK_N = 0.045; /* a twentieth of the 0.85 N that these scenes reach */
/* Both scenes grasp, cut and release; the lifted lobe rotates and is far more expensive: long form only. */
static const struct {
    const char *file;
    double length_s;
} scene[SCENES] = {{"apps/scenes/liver-cut.yaml", 9.0}, {"apps/scenes/liver-lift.yaml", 9.0}};
static int scenes(void) { return test_is_long() ? SCENES : 1; }
static recording rec[SCENES][TM_MAX_INSTRUMENTS];

static double size_of(const float v[3]) {
    return sqrt((double)v[0] * (double)v[0] + (double)v[1] * (double)v[1] + (double)v[2] * (double)v[2]);
}

static int record_all(void **state) {
    (void)state;
    for (int k = 0; k < scenes(); k++) {
        char file[2048];
        static const char *const set[] = {"threads=1", NULL};
        app_shared_file(scene[k].file, file, sizeof file);
        const double length_s = test_is_sanitized() ? 4.5 : scene[k].length_s; /* grasps, and has begun to cut */
        const scene_record of = {.scene = file, .set = set, .duration_s = length_s};
        int instruments = 0;
        if (record_scene(&of, 25.0, rec[k], &instruments) || record_scene_truth(&of, rec[k])) return -1;
    }
    return 0;
}

static int free_all(void **state) {
    (void)state;
    for (int k = 0; k < scenes(); k++)
        for (int i = 0; i < HANDS; i++) recording_free(&rec[k][i]);
    return 0;
}

/* --- transitions --- */

typedef enum tool_state { FREE, TOUCHES, HOLDS, LETS_GO, STATES } tool_state;
static const char *const state_name[STATES] = {"free", "touching", "held", "releasing"};

static tool_state state_of(const hrt_sample *s) {
    if ((s->flags & HRT_FLAG_RELEASING) != 0) return LETS_GO;
    if (s->patch && hrt_patch_grasps(s->patch)) return HOLDS;
    return size_of(s->force_N) > 0 ? TOUCHES : FREE;
}

/* Finds samples at which the tool's state, the tissue or the patch has changed. */
static bool is_transition(const recording *r, int k, int count[STATES][STATES]) {
    const hrt_sample *a = &r->sample[k - 1].sample, *b = &r->sample[k].sample;
    const tool_state from = state_of(a), to = state_of(b);
    if (from != to) count[from][to]++;
    return from != to || a->topology_revision != b->topology_revision || !a->patch != !b->patch;
}

/* Returns the largest reference force from the oldest sample in use to two ticks from now. */
static double allowed(const recording *r, int tick, int late) {
    double most = 0;
    for (int j = tick - (late + 2) * TICKS_A_FRAME; j <= tick + 2; j++)
        if (j >= 0 && j < r->ticks) most = fmax(most, size_of(r->truth_N + 3 * j));
    return most;
}

/* Returns the excess of the force over its limit around the recording's transitions, N. */
static double beyond(const recording *r, const float *force_N, int late, int count[STATES][STATES], double *at_s) {
    double worst = 0;
    for (int k = 1; k < r->samples; k++) {
        if (!is_transition(r, k, count)) continue;
        const int from = (int)(r->sample[k].sample.t_us / TICK_US) - TICKS_A_FRAME;
        for (int t = from; t < from + (3 + late) * TICKS_A_FRAME; t++) {
            if (t < 0 || t >= r->ticks) continue;
            const double over = size_of(force_N + 3 * t) - 1.1 * allowed(r, t, late);
            if (over > worst) worst = over, *at_s = t * 1e-6 * TICK_US;
        }
    }
    return worst;
}

static void no_transition_makes_a_new_peak(void **state) {
    (void)state;
    int count[STATES][STATES] = {{0}};
    for (int k = 0; k < scenes(); k++) {
        for (int i = 0; i < HANDS; i++) {
            const recording *r = &rec[k][i];
            float *force_N = calloc(3 * (size_t)r->ticks, sizeof *force_N);
            assert_non_null(force_N);
            for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++)
                for (int late = 0; late < 2; late++) {
                    const conditions line = {.latency_frames = late, .seed = 1};
                    double at_s = 0;
                    replay(r, (hrt_extrapolator)w, &line, force_N);
                    const double over_N = beyond(r, force_N, late, count, &at_s);
                    if (over_N > 0.5 * SLACK_N)
                        print_message("%s, instrument %d, %s, %d late: %.3f N beyond at %.3f s\n", scene[k].file, i,
                                      hrt_extrapolator_name((hrt_extrapolator)w), late, over_N, at_s);
                    assert_true(over_N < SLACK_N);
                }
            free(force_N);
        }
    }
    /* Only useful if the scenes have these transitions. */
    for (int a = 0; a < STATES; a++)
        for (int b = 0; b < STATES; b++)
            if (count[a][b])
                print_message("%s -> %s: %d\n", state_name[a], state_name[b],
                              count[a][b] / (2 * HRT_EXTRAPOLATOR_COUNT));
    assert_true(count[FREE][TOUCHES] && count[TOUCHES][FREE] && count[FREE][HOLDS] + count[TOUCHES][HOLDS] &&
                count[HOLDS][LETS_GO] + count[TOUCHES][LETS_GO] && count[LETS_GO][FREE]);
}

/* --- accuracy --- */

static void local_model_is_as_accurate_as_position(void **state) {
    (void)state;
    for (int k = 0; k < scenes(); k++)
        for (int i = 0; i < HANDS; i++)
            for (int late = 0; late < 2; late++) {
                const conditions line = {.latency_frames = late, .seed = 1};
                const double position = replay(&rec[k][i], HRT_POSITION, &line, NULL).rms,
                             contact = replay(&rec[k][i], HRT_LOCAL_MODEL, &line, NULL).rms;
                print_message("%s, instrument %d, %d late: hold %.2f, position %.2f, contact %.2f %%\n", scene[k].file,
                              i, late, 100 * replay(&rec[k][i], HRT_HOLD, &line, NULL).rms, 100 * position,
                              100 * contact);
                assert_true(contact < 1.001 * position);
                assert_true(replay(&rec[k][i], HRT_ADAPTIVE, &line, NULL).rms <
                            1.01 * replay(&rec[k][i], HRT_HOLD, &line, NULL).rms);
            }
}

/* A lagging simulation: each sample is up to three frames late at random, some are lost, so one may last for half a
 * second. The force from old samples stays within 1.5 times their forces, however small. */
static void lagging_samples_create_no_force(void **state) {
    (void)state;
    static const hrt_extrapolator law[] = {HRT_ADAPTIVE, HRT_LOCAL_MODEL};
    const int seeds = test_is_long() ? 40 : test_is_sanitized() ? 1 : 4;
    for (int k = 0; k < scenes(); k++)
        for (int i = 0; i < HANDS; i++)
            for (int w = 0; w < 2; w++) {
                const recording *r = &rec[k][i];
                double worst = 0, largest = 0;
                for (int seed = 1; seed <= seeds; seed++) {
                    const conditions line = {
                        .latency_frames = seed % 2, .jitter = 3.0, .loss = 0.1 * (seed % 4), .seed = (uint64_t)seed};
                    const errors hold = replay(r, HRT_HOLD, &line, NULL), own = replay(r, law[w], &line, NULL);
                    worst = fmax(worst, own.rms / hold.rms);
                    largest = fmax(largest, own.largest);
                }
                print_message("%s, instrument %d, %s, at most: %.2f of hold's error, %.2f of the peak\n", scene[k].file,
                              i, hrt_extrapolator_name(law[w]), worst, largest);
                assert_true(worst < 1.5 && largest < 1.5);
            }
}

/* A cautery's samples carry the flag "cutting" while its pedal is down; a grasper's never do. */
static void active_cautery_sets_its_flag(void **state) {
    (void)state;
    int cutting[HANDS] = {0};
    for (int i = 0; i < HANDS; i++)
        for (int k = 0; k < rec[0][i].samples; k++)
            cutting[i] += (rec[0][i].sample[k].sample.flags & HRT_FLAG_CUTTING) != 0;
    assert_int_equal(cutting[0], 0);
    assert_in_range(cutting[1], 50, 100); /* of 225; the pedal is down from 3.6 to 6.6 s at most */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_transition_makes_a_new_peak), cmocka_unit_test(local_model_is_as_accurate_as_position),
        cmocka_unit_test(lagging_samples_create_no_force), cmocka_unit_test(active_cautery_sets_its_flag)};
    return cmocka_run_group_tests(tests, record_all, free_all);
}
