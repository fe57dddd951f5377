/* The gate: which sender is accepted, and for how long. Fixed cases, then random messages of several peers with
 * wrong clocks, checked after each against docs/controller.md. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "../long.h"
#include "core/gate.h"
#include "libtensormass/numeric/random.h"

static hrt_gate_verdict say(hrt_gate *g, int64_t now_us, int64_t session, uint32_t seq, int64_t utime) {
    const hrt_gate_mark m = {.session = session, .utime = utime, .seq = seq};
    return hrt_gate_accept(g, now_us, false, &m);
}

static hrt_gate_verdict say_pinned(hrt_gate *g, int64_t now_us, int64_t session, uint32_t seq, int64_t utime) {
    const hrt_gate_mark m = {.session = session, .utime = utime, .seq = seq};
    return hrt_gate_accept(g, now_us, true, &m);
}

static void messages_in_order_are_accepted(void **state) {
    (void)state;
    hrt_gate g = {.known = false};
    assert_int_equal(say(&g, 0, 5, 10, 100), HRT_GATE_NEW_SESSION);
    assert_int_equal(say(&g, 10, 5, 11, 110), HRT_GATE_ACCEPTED);
    assert_int_equal(say(&g, 20, 5, 11, 110), HRT_GATE_REPEATED);
    assert_int_equal(say(&g, 30, 5, 9, 120), HRT_GATE_LATE);
    assert_int_equal(say(&g, 40, 5, 12, 109), HRT_GATE_CLOCK_BACK);
    assert_int_equal(say(&g, 50, 5, 12, 110), HRT_GATE_ACCEPTED);
    /* Half the range is the farthest ahead; counting continues over the end. */
    assert_int_equal(say(&g, 60, 5, 12 + 0x7fffffffu, 120), HRT_GATE_ACCEPTED);
    assert_int_equal(say(&g, 70, 5, 12 + 0xffffffffu, 120), HRT_GATE_LATE);
    assert_int_equal(say(&g, 80, 5, 12 + 0xfffffffeu, 120), HRT_GATE_ACCEPTED);
    assert_int_equal(say(&g, 90, 5, 20, 120), HRT_GATE_ACCEPTED);
}

/* Neither the larger nor the smaller session number has priority. */
static void another_sender_is_accepted_after_a_second(void **state) {
    (void)state;
    const int64_t sessions[] = {1, 4, INT64_MAX, INT64_MIN, 0, -1};
    for (size_t i = 0; i < sizeof sessions / sizeof *sessions; i++) {
        hrt_gate g = {.known = false};
        assert_int_equal(say(&g, 1000, 3, 1, 1), HRT_GATE_NEW_SESSION);
        assert_int_equal(say(&g, 1000999, sessions[i], 7, 7), HRT_GATE_FOREIGN);
        assert_int_equal(say(&g, 1001000, sessions[i], 7, 7), HRT_GATE_NEW_SESSION);
        assert_int_equal(say(&g, 1500000, 3, 2, 2), HRT_GATE_FOREIGN);
        assert_int_equal(say(&g, 2001000, 3, 2, 2), HRT_GATE_NEW_SESSION);
    }
}

/* One packet far ahead with the current sender's session: recovers a second later. */
static void seq_far_ahead_recovers(void **state) {
    (void)state;
    hrt_gate g = {.known = false};
    int64_t now_us = 0, taken_us = -1;
    uint32_t seq = 100;
    for (; now_us < 500000; now_us += 2000) say(&g, now_us, 3, seq++, now_us);
    const int64_t struck_us = now_us;
    assert_int_equal(say(&g, now_us, 3, seq + 0x70000000u, INT64_MAX), HRT_GATE_ACCEPTED);
    for (; now_us < 3000000; now_us += 2000)
        if (hrt_gate_open(say(&g, now_us, 3, seq++, now_us)) && taken_us < 0) taken_us = now_us;
    assert_true(taken_us - struck_us <= HRT_GATE_SILENCE_US && taken_us > 0);
    assert_int_equal(say(&g, now_us, 3, seq, now_us), HRT_GATE_ACCEPTED);
}

static void pinned_gate_accepts_no_other_sender(void **state) {
    (void)state;
    hrt_gate g = {.known = false};
    assert_int_equal(say_pinned(&g, 0, 3, 1, 1), HRT_GATE_NEW_SESSION);
    assert_int_equal(say_pinned(&g, 9000000, 4, 1, 1), HRT_GATE_PINNED);
    assert_int_equal(say_pinned(&g, 9000000, 3, 1, 1), HRT_GATE_REPEATED);
    assert_int_equal(say_pinned(&g, 9000000, 3, 2, 1), HRT_GATE_ACCEPTED);
    assert_int_equal(say(&g, 9000001, 4, 1, 1), HRT_GATE_FOREIGN);
}

static void every_verdict_has_a_text(void **state) {
    (void)state;
    for (int v = 0; v < HRT_GATE_VERDICT_COUNT; v++) assert_true(strlen(hrt_gate_text((hrt_gate_verdict)v)) > 5);
    assert_string_equal(hrt_gate_text(HRT_GATE_VERDICT_COUNT), "unknown");
    assert_string_equal(hrt_gate_text((hrt_gate_verdict)-1), "unknown");
}

/* ---------------------------------------------------------------------------------------------- random conversations
 */

enum { PEERS = 4 };
typedef struct peer {
    int64_t session, clock_us, next_us;
    uint32_t seq;
    bool alive;
} peer;

static uint64_t random_state;
static uint64_t draw(void) { return num_xorshift64(&random_state); }
static int64_t below(int64_t n) { return (int64_t)(draw() % (uint64_t)n); }

/* Restarts with any clock: its session may be larger or smaller than any before. */
static void restart(peer *p) {
    p->session = (int64_t)draw();
    p->clock_us = below(4) == 0 ? INT64_MAX / 2 : below(1000000000);
    p->seq = (uint32_t)draw();
}

static void something_happens(peer *p) {
    switch (below(6)) {
    case 0: p->alive = false; break;
    case 1: p->alive = true; break;
    case 2: restart(p), p->alive = true; break;
    case 3: p->clock_us -= below(3600000000LL); break; /* its clock is set back while it runs */
    case 4: p->clock_us += below(3600000000LL); break;
    default: p->seq -= (uint32_t)below(100000); break;
    }
}

typedef struct watch {
    hrt_gate g;
    int64_t accepted_us, told_us;
} watch;

/* Checks what must hold for every message, without reading the gate's state. */
static void hold_to_the_rules(watch *w, int64_t now_us, bool pinned, const hrt_gate_mark *m) {
    const hrt_gate before = w->g;
    const bool silent = !before.known || now_us - w->accepted_us >= HRT_GATE_SILENCE_US;
    const bool same = before.known && m->session == before.last.session;
    const hrt_gate_verdict v = hrt_gate_accept(&w->g, now_us, pinned, m);
    const bool open = hrt_gate_open(v);
    if (silent && !pinned) assert_true(open);
    if (before.known && !same && (pinned || !silent)) assert_false(open);
    if (open && same && (!silent || pinned))
        assert_true((int32_t)(m->seq - before.last.seq) > 0 && m->utime >= before.last.utime);
    if (!open && same) assert_true((int32_t)(m->seq - before.last.seq) <= 0 || m->utime < before.last.utime);
    assert_int_equal(v == HRT_GATE_NEW_SESSION, open && !same);
    if (!open) assert_memory_equal(&before, &w->g, sizeof before);
    if (open) {
        assert_memory_equal(&w->g.last, m, sizeof *m);
        w->accepted_us = now_us;
    }
}

static void conversation(uint64_t number, int messages) {
    peer p[PEERS];
    watch w;
    memset(&w, 0, sizeof w);
    random_state = number * 0x9e3779b97f4a7c15ULL + 1;
    int64_t now_us = below(2) ? below(1000000000) : INT64_MAX / 4, pinned_until_us = 0;
    for (int i = 0; i < PEERS; i++) restart(&p[i]), p[i].alive = i == 0, p[i].next_us = now_us;
    for (int k = 0; k < messages; k++) {
        now_us += below(200) == 0 ? below(3000000) : below(2000); /* the receiver may have been stopped */
        if (below(500) == 0) pinned_until_us = now_us + below(2500000);
        if (below(100) == 0) something_happens(&p[below(PEERS)]);
        peer *who = &p[below(PEERS)];
        who->clock_us += 2000;
        if (!who->alive) continue;
        hrt_gate_mark m;
        memset(&m, 0, sizeof m);
        m.session = who->session;
        m.utime = who->clock_us;
        m.seq = ++who->seq;
        hold_to_the_rules(&w, now_us, now_us < pinned_until_us, &m);
        if (below(20) == 0) hold_to_the_rules(&w, now_us, now_us < pinned_until_us, &m); /* doubled on the way */
    }
    /* Whatever happened before, a sender without competitors is accepted within a second. */
    const int64_t alone_us = now_us;
    for (; now_us - alone_us <= HRT_GATE_SILENCE_US; now_us += 2000) {
        const hrt_gate_mark m = {.session = p[1].session, .utime = p[1].clock_us += 2000, .seq = ++p[1].seq};
        hrt_gate_accept(&w.g, now_us, false, &m);
    }
    assert_int_equal(w.g.last.session, p[1].session);
    assert_int_equal(w.g.last.seq, p[1].seq);
    assert_int_equal(w.g.last.utime, p[1].clock_us);
}

static uint64_t seed, seeds;

static void random_messages_follow_the_rules(void **state) {
    (void)state;
    seeds = test_is_long() ? 20000 : 500;
    for (seed = 1; seed <= seeds; seed++) conversation(seed, 3000);
}

static int tell_the_seed(void **state) {
    (void)state;
    if (seed <= seeds) print_error("seed %d\n", (int)seed);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(messages_in_order_are_accepted),
                                       cmocka_unit_test(another_sender_is_accepted_after_a_second),
                                       cmocka_unit_test(seq_far_ahead_recovers),
                                       cmocka_unit_test(pinned_gate_accepts_no_other_sender),
                                       cmocka_unit_test(every_verdict_has_a_text),
                                       cmocka_unit_test_teardown(random_messages_follow_the_rules, tell_the_seed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
