/* The mailbox: one thread posts samples, patches, poses and commands while another ticks; none is torn or freed
 * during a read. Run with config=tsan too. */
#include <pthread.h>
#include <time.h>

#include "loop.h"

static loop l;
static _Atomic bool stop;
static _Atomic int64_t tool_us;
static _Atomic int64_t posted;
static int64_t refused;

/* Every number of the sample and of its patch is derived from seq: a mixture of two would be detected. */
static float mark(uint32_t seq) { return 0.001f * (float)(seq % 997u + 1u); }

static void make_patch(uint32_t seq, tensormass_contact_patch_t *m) {
    *m = loop_patch(7, seq, 0.001f * mark(seq));
    m->contact_compliance_m_N = mark(seq);
    for (int i = 0; i < 9; i++)
        m->vertex_m[i] = (i == 3 || i == 7 ? 0.01f : 0.0f) + (i % 3 == 2 ? 0.2f : 0.0f) + 0.001f * mark(seq);
}

static void *poster(void *user) {
    (void)user;
    for (uint32_t seq = 1; !atomic_load(&stop); seq++) {
        tensormass_contact_patch_t patch;
        make_patch(seq, &patch);
        if (hrt_node_post_patch(&l.node, &patch) != HRT_ACCEPT) refused++;
        const double f = (double)mark(seq);
        const tensormass_force_sample_t s = {.session = 7,
                                             .tool_session = l.node.config.session,
                                             .tool_utime = atomic_load(&tool_us),
                                             .seq = (int32_t)seq,
                                             .tip_m = {f, f, f},
                                             .force_N = {f, f, f},
                                             .stiffness_kind = 2,
                                             .stiffness_N_m = {f, f, f, f, f, f, f, f, f}};
        if (hrt_node_post_sample(&l.node, &s) == HRT_ACCEPT) posted++;
        if (seq % 1000 == 0) {
            const hrt_command c = {.extrapolator = (int32_t)(seq / 1000 % HRT_EXTRAPOLATOR_COUNT),
                                   .passivity = (int32_t)(seq / 1000 % 2),
                                   .coupling = -1,
                                   .enable = -1};
            hrt_node_post_command(&l.node, &c);
        }
        if (seq % 3 == 0) { /* not always ahead of the reader */
            const struct timespec wait = {0, 20000};
            nanosleep(&wait, NULL);
        }
    }
    return NULL;
}

static bool enough(uint32_t taken, uint32_t with_patch) { return taken > 500 && with_patch > 500 && posted > taken; }

static void samples_are_never_torn(void **state) {
    (void)state;
    const hrt_device_config d = loop_device_config();
    hrt_node_config n = loop_node_config();
    n.extrapolator = HRT_LOCAL_MODEL;
    pthread_t thread;
    uint32_t taken = 0, last = 0, with_patch = 0;
    loop_start(&l, &d, &n);
    l.sim_alive = false;
    atomic_store(&tool_us, l.now_us);
    assert_int_equal(pthread_create(&thread, NULL, poster, NULL), 0);
    const time_t begin = time(NULL); /* waits for a poster that the scheduler delays */
    for (int tick = 0; tick < 60000 || (!enough(taken, with_patch) && time(NULL) - begin < 120); tick++) {
        loop_tick(&l);
        atomic_store(&tool_us, l.now_us - 2000);
        const hrt_sample *s = &l.node.controller.extrapolation.now;
        if (!l.node.controller.sample_seen || s->seq == last) continue;
        last = s->seq;
        taken++;
        for (int i = 0; i < 3; i++)
            assert_true(s->force_N[i] == mark(last) && s->tip_m[i] == mark(last) &&
                        s->stiffness_N_m[4 * i] == mark(last));
        const hrt_patch *p = l.node.controller.extrapolation.patch;
        if (!p) continue;
        with_patch++;
        assert_int_equal(p->seq, last);
        assert_true(p->contact_compliance_m_N == mark(last) && p->compliance_m_N[0] == 0.001f * mark(last) &&
                    p->vertex_m[0] == 0.001f * mark(last));
    }
    atomic_store(&stop, true);
    pthread_join(thread, NULL);
    print_message("%lld posted, %u taken, %u with their patch\n", (long long)atomic_load(&posted), taken, with_patch);
    assert_int_equal(refused, 0);
    assert_true(enough(taken, with_patch));
}

/* Simulation and controller both run at 500 Hz, each by its own clock, so sometimes two samples arrive between two
 * ticks. The newest is used; the other one does not count as lost by the network. */
static void superseded_samples_do_not_count_as_lost(void **state) {
    (void)state;
    const hrt_device_config d = loop_device_config();
    hrt_node_config n = loop_node_config();
    loop_start(&l, &d, &n);
    l.sim_alive = false; /* sent by this test */
    loop_run(&l, 0.5);
    uint32_t sent = 0, dropped = 0;
    const uint32_t superseded = l.node.superseded;
    double next_us = (double)l.now_us;
    uint32_t seq = l.seq;
    for (int tick = 0; tick < 2000; tick++) {
        for (; next_us < (double)l.now_us; next_us += 1800) { /* a tenth faster than the ticks */
            tensormass_force_sample_t s = loop_sample(&l, &l.tool);
            s.seq = (int32_t)++seq;
            if (seq % 97 == 0) {
                dropped++;
                continue;
            }
            sent++;
            assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_ACCEPT);
        }
        loop_tick(&l);
    }
    tensormass_controller_status_t status;
    hrt_node_status(&l.node, &status);
    print_message("  %u sent, %u superseded, %u dropped, %lld lost\n", sent, l.node.superseded - superseded, dropped,
                  (long long)status.samples_lost);
    assert_in_range(l.node.superseded - superseded, 150, 250);
    assert_in_range(status.samples_received, sent - 1, sent); /* the last may be unread */
    assert_in_range(status.samples_lost, dropped - 1, dropped);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(samples_are_never_torn),
                                       cmocka_unit_test(superseded_samples_do_not_count_as_lost)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
