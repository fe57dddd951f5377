/* One interface over queue and log: messages arrive unchanged, authenticated or not; impairments follow their seed;
 * a log equals liblcm's byte by byte. (The network: test_trust.py, on running programs.) */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>
// clang-format on

#include <lcm/eventlog.h>

#include "link.h"

typedef struct heard {
    int count;
    int32_t seq[4096];
    int64_t utime[4096];
    app_verdict verdict;
} heard;

static app_verdict take_force(void *user, int instrument, int64_t utime, const void *message) {
    heard *h = user;
    const tensormass_force_sample_t *m = message;
    assert_true(m->instrument == instrument && m->force_N[2] == 0.1 * m->seq && m->session == -3);
    h->seq[h->count] = m->seq;
    h->utime[h->count++] = utime;
    return h->verdict;
}

static app_verdict take_status(void *user, int instrument, int64_t utime, const void *message) {
    heard *h = user;
    assert_int_equal(instrument, 0);
    assert_string_equal(((const tensormass_sim_status_t *)message)->scene, "a scene");
    h->utime[h->count++] = utime;
    return APP_TAKEN;
}

static tensormass_force_sample_t sample(int32_t seq, int instrument) {
    return (tensormass_force_sample_t){
        .seq = seq, .session = -3, .instrument = (int8_t)instrument, .force_N = {0, 0, 0.1 * seq}};
}

static void publish(app_link *link, int32_t seq, int instrument, int64_t utime) {
    const tensormass_force_sample_t m = sample(seq, instrument);
    assert_true(app_link_publish(link, APP_FORCE, instrument, utime, &m));
}

static void queue_keeps_the_order(void **state) {
    (void)state;
    static heard one, both, status;
    app_queue *queue = app_queue_create(5);
    const app_topic first[] = {{APP_FORCE, 1, take_force, &one}},
                    second[] = {{APP_FORCE, 0, take_force, &both},
                                {APP_FORCE, 1, take_force, &both},
                                {APP_SIM_STATUS, 0, take_status, &status}};
    app_link *from = app_link_join(queue, &(app_link_def){0}, NULL);
    app_link *a = app_link_join(queue, &(app_link_def){.topic = first, .topics = 1}, NULL);
    app_link *b = app_link_join(queue, &(app_link_def){.topic = second, .topics = 3}, NULL);
    char scene[] = "a scene", model[] = "";
    const tensormass_sim_status_t words = {.scene = scene, .model = model};
    for (int k = 0; k < 10; k++) publish(from, k, k % 2, k);
    assert_true(app_link_publish(from, APP_SIM_STATUS, 0, 3, &words));
    assert_true(app_link_wanted(from, APP_FORCE, 1) && !app_link_wanted(from, APP_TISSUE, 0));
    app_queue_set_clock(queue, 9);
    assert_int_equal(app_link_receive(a, 1000000, 2), 2); /* never waits, gives no more than requested */
    assert_int_equal(app_link_receive(a, 0, 100), 3);
    assert_int_equal(app_link_receive(b, 0, 100), 11);
    assert_int_equal(app_link_receive(b, 0, 100), 0);
    assert_true(one.count == 5 && one.seq[0] == 1 && one.seq[4] == 9 && one.utime[0] == 9);
    assert_true(both.count == 10 && both.seq[9] == 9 && status.count == 1);
    assert_true(app_link_now_us(a) == 9);
    app_link_close(a);
    publish(from, 1, 1, 0); /* a receiver that left gets nothing */
    app_link_close(b);
    app_link_close(from);
    app_queue_destroy(queue);
}

/* Sends 2,000 frames of two messages each through a lossy line. */
static void bad_line(uint64_t seed, heard *h) {
    memset(h, 0, sizeof *h);
    uint64_t random = seed;
    app_queue *queue = app_queue_create(0);
    const app_topic topic[] = {{APP_FORCE, 0, take_force, h}};
    const app_impairments impairments = {.latency_s = 0.040, .jitter_s = 0.100, .loss = 0.25, .random = &random};
    app_link *from = app_link_join(queue, &(app_link_def){0}, NULL);
    app_link *to = app_link_join(queue, &(app_link_def){.topic = topic, .topics = 1}, &impairments);
    for (int64_t frame = 0; frame < 2010; frame++) {
        app_queue_set_clock(queue, 40000 * frame);
        if (frame < 2000)
            for (int32_t k = 0; k < 2; k++) publish(from, (int32_t)(2 * frame) + k, 0, 0);
        app_link_receive(to, 0, 100);
    }
    app_link_close(to);
    app_link_close(from);
    app_queue_destroy(queue);
}

static void impairments_follow_their_seed(void **state) {
    (void)state;
    static heard first, again, other;
    bad_line(5, &first);
    bad_line(5, &again);
    bad_line(6, &other);
    assert_memory_equal(&first, &again, sizeof first);
    assert_true(memcmp(&first, &other, sizeof first) != 0);
    assert_in_range(first.count, 2900, 3100); /* 4,000, of which a quarter is lost */
    int64_t most_us = 0;
    for (int i = 0; i < first.count; i++) {
        const int64_t late_us = first.utime[i] - 40000 * (first.seq[i] / 2);
        assert_true(late_us >= 40000);
        if (late_us > most_us) most_us = late_us;
        if (i) assert_true(first.seq[i] > first.seq[i - 1]); /* nothing overtakes */
        assert_true(first.seq[i] % 2 == 1 ||
                    first.seq[i + 1] == first.seq[i] + 1); /* messages of one instant stay together */
    }
    assert_in_range(most_us, 120000, 160000); /* 140 ms, seen at the next frame */
}

static void authentication_requires_the_key(void **state) {
    (void)state;
    static heard h;
    const app_key key = {.known = true, .byte = {1, 2, 3}}, wrong = {.known = true, .byte = {1, 2, 4}};
    app_queue *queue = app_queue_create(0);
    const app_topic topic[] = {{APP_FORCE, 0, take_force, &h}};
    app_link *to = app_link_join(queue, &(app_link_def){.topic = topic, .topics = 1, .key = &key}, NULL);
    app_link *own = app_link_join(queue, &(app_link_def){.key = &key}, NULL);
    app_link *bare = app_link_join(queue, &(app_link_def){0}, NULL);
    app_link *forger = app_link_join(queue, &(app_link_def){.key = &wrong}, NULL);
    publish(own, 1, 0, 0);
    publish(bare, 2, 0, 0);
    publish(forger, 3, 0, 0);
    app_link_receive(to, 0, 100);
    assert_true(h.count == 1 && h.seq[0] == 1);
    const app_link_counts *c = app_link_counted(to);
    assert_true(c->taken == 1 && c->forged == 2 && c->malformed == 0);
    app_link_give(to, "FORCE_0", 0, "none of ours", 12);
    assert_int_equal(c->forged, 3);
    h.verdict = APP_FORGED; /* a receiver also refuses repeated messages and those for another receiver */
    publish(own, 4, 0, 0);
    app_link_receive(to, 0, 100);
    assert_true(c->forged == 4 && c->taken == 1);
    app_link *all[] = {to, own, bare, forger};
    for (int i = 0; i < 4; i++) app_link_close(all[i]);
    app_queue_destroy(queue);
}

static char folder[] = "/tmp/tm-link-XXXXXX";

static void log_equals_liblcms_byte_for_byte(void **state) {
    (void)state;
    static heard h;
    char own[64], theirs[64];
    snprintf(own, sizeof own, "%s/own", folder);
    snprintf(theirs, sizeof theirs, "%s/theirs", folder);
    app_link *log = app_link_write_log(own, &(app_link_def){0});
    lcm_eventlog_t *reference = lcm_eventlog_create(theirs, "w");
    assert_non_null(log);
    assert_non_null(reference);
    for (int k = 0; k < 20; k++) {
        const tensormass_force_sample_t m = sample(k, k % 2);
        uint8_t bytes[512];
        const int size = tensormass_force_sample_t_encode(bytes, 0, sizeof bytes, &m);
        lcm_eventlog_event_t event = {.timestamp = 1000000000000 + k,
                                      .channellen = 7,
                                      .datalen = size,
                                      .channel = k % 2 ? "FORCE_1" : "FORCE_0",
                                      .data = bytes};
        publish(log, k, k % 2, 1000000000000 + k);
        assert_int_equal(lcm_eventlog_write_event(reference, &event), 0);
    }
    assert_true(app_link_close(log));
    lcm_eventlog_destroy(reference);
    FILE *a = fopen(own, "rb"), *b = fopen(theirs, "rb");
    for (int c = 0; c != EOF;) assert_int_equal(c = getc(a), getc(b));
    fclose(a);
    fclose(b);
    const app_topic topic[] = {{APP_FORCE, 1, take_force, &h}};
    log = app_link_read_log(own, &(app_link_def){.topic = topic, .topics = 1});
    for (int pass = 0; pass < 2; pass++) {
        memset(&h, 0, sizeof h);
        assert_true(app_link_next_utime(log) == 1000000000000);
        assert_int_equal(app_link_receive(log, 0, 3), 3);
        assert_true(app_link_now_us(log) == 1000000000002 && app_link_next_utime(log) == 1000000000003);
        assert_int_equal(app_link_receive(log, 0, 100), 17);
        assert_true(app_link_next_utime(log) == INT64_MAX && h.count == 10 && h.utime[9] == 1000000000019);
        assert_true(!app_link_damaged(log) && app_link_rewind(log));
    }
    app_link_close(log);
    unlink(own);
    unlink(theirs);
}

/* Sent and accepted messages, and no others. */
static void a_link_is_copied_into_its_log(void **state) {
    (void)state;
    static heard h, sent;
    char path[64];
    snprintf(path, sizeof path, "%s/copy", folder);
    app_queue *queue = app_queue_create(7);
    app_link *log = app_link_write_log(path, &(app_link_def){0});
    const app_topic topic[] = {{APP_FORCE, 0, take_force, &h}};
    app_link *link = app_link_join(queue, &(app_link_def){.topic = topic, .topics = 1, .copy = log}, NULL);
    app_link *other = app_link_join(queue, &(app_link_def){0}, NULL);
    publish(link, 1, 1, 6); /* no receiver */
    publish(other, 2, 0, 6);
    publish(other, 3, 1, 6); /* not subscribed */
    app_link_receive(link, 0, 100);
    h.verdict = APP_LEFT;
    publish(other, 4, 0, 6);
    app_link_receive(link, 0, 100);
    app_link_give(link, "FORCE_0", 7, "short", 5);
    app_link_close(link);
    app_link_close(other);
    app_queue_destroy(queue);
    assert_true(app_link_close(log));
    const app_topic all[] = {{APP_FORCE, 0, take_force, &sent}, {APP_FORCE, 1, take_force, &sent}};
    log = app_link_read_log(path, &(app_link_def){.topic = all, .topics = 2});
    assert_int_equal(app_link_receive(log, 0, 100), 2);
    assert_true(sent.seq[0] == 1 && sent.utime[0] == 6 && sent.seq[1] == 2 && sent.utime[1] == 7);
    app_link_close(log);
    unlink(path);
}

static void full_disk_is_reported(void **state) {
    (void)state;
    app_link *log = app_link_write_log("/dev/full", &(app_link_def){0});
    assert_non_null(log);
    for (int k = 0; k < 100; k++) {
        const tensormass_force_sample_t m = sample(k, 0);
        app_link_publish(log, APP_FORCE, 0, k, &m);
    }
    assert_false(app_link_close(log));
    assert_null(app_link_write_log("/dev/null/none", &(app_link_def){0}));
    assert_null(app_link_read_log("/dev/null/none", &(app_link_def){0}));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(queue_keeps_the_order),           cmocka_unit_test(impairments_follow_their_seed),
        cmocka_unit_test(authentication_requires_the_key), cmocka_unit_test(log_equals_liblcms_byte_for_byte),
        cmocka_unit_test(a_link_is_copied_into_its_log),   cmocka_unit_test(full_disk_is_reported)};
    if (!mkdtemp(folder)) return 1;
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    rmdir(folder);
    return failed;
}
