/* The rate of force samples: the scene's request, and its adaptation to the costs of a simulated machine. */
#include "../../apps/sim/stream.h"

#include <math.h>

#include "../fixture.h"
#include "../long.h"

/* Makes a stream of 20 base samples of 2 ms, as `auto` does for a frame of 40 ms, on a machine whose first
 * measurement is base_cost_s. */
static sim_stream stream_of(double base_cost_s) {
    sim_stream stream = {.per_frame = 20,
                         .batch = 1,
                         .adapts = true,
                         .frame_s = 0.04,
                         .base_cost_s = base_cost_s,
                         .sample_cost_s = 100e-6};
    return stream;
}

/* Runs a frame on a machine with these costs; time beyond the frame's own is dropped. */
static bool frame(sim_stream *stream, double base_s, double sample_s, double patch_s, double rest_s) {
    const int32_t samples = stream->per_frame / stream->batch;
    const bool patches = sim_stream_rate_Hz(stream) <= 50;
    sim_stream_spent spent = {.bases = stream->per_frame,
                              .samples = samples,
                              .bases_s = stream->per_frame * base_s,
                              .samples_s = samples * sample_s,
                              .patches = patches ? samples : 0,
                              .patches_s = patches ? samples * patch_s : 0,
                              .frame_s = rest_s};
    spent.dropped = spent.bases_s + spent.samples_s + spent.patches_s + rest_s > stream->frame_s;
    return sim_stream_adapt(stream, &spent);
}

static int changes(sim_stream *stream, int frames, double base_s, double sample_s, double patch_s) {
    int count = 0;
    for (int f = 0; f < frames; f++) count += frame(stream, base_s, sample_s, patch_s, 1e-3);
    return count;
}

static void fast_machine_keeps_the_highest_rate(void **state) {
    (void)state;
    sim_stream stream = stream_of(0.4e-3);
    assert_int_equal(changes(&stream, 2000, 0.4e-3, 80e-6, 10e-3), 0);
    assert_true(fabs(sim_stream_rate_Hz(&stream) - 500) < 1e-9);
}

static void expensive_samples_lower_the_rate(void **state) {
    (void)state;
    sim_stream stream = stream_of(0.4e-3);
    changes(&stream, 500, 0.4e-3, 1.6e-3, 1e-3); /* 20 samples take 32 ms of 40, with 8 ms of simulation */
    assert_true(sim_stream_rate_Hz(&stream) < 500);
    assert_true(sim_stream_load(&stream, stream.batch) <= 0.8);
    const int32_t held = stream.batch;
    assert_int_equal(changes(&stream, 5000, 0.4e-3, 1.6e-3, 1e-3), 0); /* without oscillation */
    assert_int_equal(stream.batch, held);
}

static void the_rate_rises_again_when_the_machine_is_free(void **state) {
    (void)state;
    sim_stream stream = stream_of(0.4e-3);
    changes(&stream, 500, 0.4e-3, 1.6e-3, 1e-3);
    assert_true(stream.batch > 1);
    changes(&stream, 1000, 0.4e-3, 80e-6, 1e-3);
    assert_int_equal(stream.batch, 1);
}

static void a_machine_too_slow_for_any_rate_takes_the_cheapest(void **state) {
    (void)state;
    sim_stream stream = stream_of(3e-3);
    assert_true(changes(&stream, 2000, 3e-3, 80e-6, 10e-3) <= 5);
    /* Patches at 50 and 25 Hz cost more than the samples that they replace. */
    assert_true(sim_stream_rate_Hz(&stream) > 50);
    sim_stream cheap = stream_of(3e-3);
    changes(&cheap, 2000, 3e-3, 1e-3, 0);
    assert_true(cheap.batch >= 4); /* the remaining gain is below a twentieth */
}

static void random_costs_keep_a_divisor_and_change_seldom(void **state) {
    (void)state;
    fix_random random = {7};
    const int frames = test_is_long() ? 1000000 : 50000;
    sim_stream stream = stream_of(1e-3);
    int count = 0;
    for (int f = 0; f < frames; f++) {
        const double noise = 0.5 + fix_uniform(&random);
        count += frame(&stream, 1.2e-3 * noise, 200e-6 * noise, 5e-3 * noise, 1e-3 * noise);
        assert_true(stream.batch >= 1 && stream.per_frame % stream.batch == 0);
        assert_true(isfinite(sim_stream_load(&stream, stream.batch)));
    }
    assert_true(count < frames / 50); /* never before a second of stable times */
}

static void numeric_rate_is_not_adapted(void **state) {
    (void)state;
    sim_stream stream = stream_of(0.4e-3);
    stream.adapts = false;
    assert_int_equal(changes(&stream, 500, 3e-3, 1e-3, 1e-3), 0);
    assert_int_equal(stream.batch, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fast_machine_keeps_the_highest_rate),
        cmocka_unit_test(expensive_samples_lower_the_rate),
        cmocka_unit_test(the_rate_rises_again_when_the_machine_is_free),
        cmocka_unit_test(a_machine_too_slow_for_any_rate_takes_the_cheapest),
        cmocka_unit_test(random_costs_keep_a_divisor_and_change_seldom),
        cmocka_unit_test(numeric_rate_is_not_adapted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
