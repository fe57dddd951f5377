/* A device's hand that messages move: in order of their seq with and without a key, one sender at a time. */
#include "../fixture.h"

#include "io/peer.h"

static double at;
static int moves;

static void hand(void *user, const double joint[HRT_JOINTS], bool active) {
    (void)user, (void)active;
    at = joint[0];
    moves++;
}

static app_link *listener, *sender;
static app_queue *queue;
static hrt_peer peer;

static void open_links(const app_key *key) {
    app_topic topic[HRT_PEER_TOPICS];
    queue = app_queue_create(1000000);
    hrt_peer_init(&peer, &(hrt_peer_def){.joints = 5, .hand = hand, .key = key});
    const app_link_def hears = {.topic = topic, .topics = hrt_peer_topics(&peer, topic), .key = key},
                       says = {.key = key};
    listener = peer.link = app_link_join(queue, &hears, NULL);
    sender = app_link_join(queue, &says, NULL);
    assert_non_null(listener);
    assert_non_null(sender);
    moves = 0;
}

static void close_links(void) {
    app_link_close(listener);
    app_link_close(sender);
    app_queue_destroy(queue);
}

static void say(int64_t now_us, int64_t session, int32_t seq, double joint) {
    tensormass_hand_command_t m = {.utime = now_us, .seq = seq, .session = session, .joints = 5, .joint = {joint}};
    app_queue_set_clock(queue, now_us);
    app_link_publish(sender, APP_HAND, 0, m.utime, &m);
    app_link_receive(listener, 0, 16);
}

static void messages_out_of_order_do_not_move_the_hand(void **state) {
    (void)state;
    open_links(NULL);
    say(1000000, 7, 1, 0.1);
    say(1010000, 7, 3, 0.3);
    say(1011000, 7, 2, 0.2); /* overtaken */
    assert_true(at == 0.3);
    say(1012000, 7, 3, 0.9); /* doubled */
    assert_true(at == 0.3);
    say(1020000, 8, 9, -0.5); /* another sender while this one is active */
    assert_true(at == 0.3);
    say(1030000, 7, 4, 0.4);
    assert_true(at == 0.4 && moves == 3);
    say(2030000, 8, 1, -0.1); /* a second of silence: any session is accepted */
    assert_true(at == -0.1 && moves == 4);
    close_links();
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(messages_out_of_order_do_not_move_the_hand)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
