/* Converts keys and mouse to target joints. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "play/controls.h"

enum { HEIGHT = 600 };

/* An instrument inclined into the body, seen from the front. */
static void scene(view_picture *p, view_camera *camera) {
    const view_instrument probe = {.shown = true,
                                   .device = hrt_device_types[0],
                                   .mode = 0,
                                   .tip_m = {0.01, 0.02, 0.05},
                                   .trocar_m = {0, -0.05, 0.15},
                                   .radius_m = 0.0025,
                                   .axis = {0, 0.5, -0.8},
                                   .up = {0, 0, 1},
                                   .extrapolator = "position",
                                   .grip = 0.25,
                                   .roll_rad = 0.1};
    memset(p, 0, sizeof *p);
    p->instrument[0] = p->instrument[1] = probe;
    p->instrument[1].mode = 2;
    p->instrument[1].tip_m[0] = -0.04;
    *camera = (view_camera){
        .eye_m = {0, -0.5f, 0.05f}, .at_m = {0, 0, 0.05f}, .up = {0, 0, 1}, .fov_rad = 0.5f, .radius_m = 0.1f};
}

static void key(play_controls *c, const view_picture *p, int code, bool down) {
    play_event e = {.type = PLAY_KEY, .code = code, .down = down};
    play_controls_event(c, p, &e);
}

/* Computes the tip position that the hand requests, world axes. */
static void wanted_tip(const play_controls *c, const view_picture *p, int i, double tip_m[3]) {
    const view_instrument *t = &p->instrument[i];
    hrt_axes axes;
    float joint[HRT_JOINTS], tip[3];
    const float axis[3] = {(float)t->axis[0], (float)t->axis[1], (float)t->axis[2]},
                up[3] = {(float)t->up[0], (float)t->up[1], (float)t->up[2]};
    assert_true(hrt_axes_along(&axes, t->device, axis, up));
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = (float)c->hand[i].joint[j];
    hrt_tip(&axes, joint, tip);
    for (int k = 0; k < 3; k++) tip_m[k] = t->trocar_m[k] + (double)tip[k];
}

static void begin(play_controls *c, view_picture *p, view_camera *camera) {
    scene(p, camera);
    play_controls_begin(c);
    play_controls_step(c, p, camera, HEIGHT, 0.01);
}

static void hand_begins_where_the_instrument_is(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    begin(&c, &p, &camera);
    for (int i = 0; i < 2; i++) {
        double tip[3];
        wanted_tip(&c, &p, i, tip);
        for (int k = 0; k < 3; k++) assert_float_equal(tip[k], p.instrument[i].tip_m[k], 1e-6);
    }
    assert_float_equal(c.hand[0].joint[3], 0.1, 1e-9);
}

/* Another simulation may run another device: its joints are counted, and the hand begins at the instrument. */
static void hand_restarts_with_another_device(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    view_hand hand;
    double tip[3];
    begin(&c, &p, &camera);
    const hrt_device_type *desk = hrt_device_types[hrt_device_type_find("desk")];
    p.instrument[0].device = desk;
    play_controls_step(&c, &p, &camera, HEIGHT, 0.01);
    assert_true(play_controls_hand(&c, &p, 0, &hand));
    assert_int_equal(hand.joints, desk->joints);
    for (int j = desk->joints; j < HRT_JOINTS; j++) assert_float_equal(hand.joint[j], 0, 0);
    wanted_tip(&c, &p, 0, tip);
    for (int k = 0; k < 3; k++) assert_float_equal(tip[k], p.instrument[0].tip_m[k], 1e-6);
}

static void unknown_instruments_send_nothing(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    view_hand hand;
    scene(&p, &camera);
    memset(p.instrument[0].axis, 0, sizeof p.instrument[0].axis);
    p.instrument[1].shown = false;
    play_controls_begin(&c);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.01);
    assert_false(play_controls_hand(&c, &p, 0, &hand));
    assert_false(play_controls_hand(&c, &p, 1, &hand));
}

/* The tip follows the mouse in the picture; the insertion is unchanged. */
static void drag_moves_the_tip_with_the_mouse(void **state) {
    (void)state;
    static const float drag[4][2] = {{10, 0}, {-10, 0}, {0, -10}, {0, 10}};
    for (int d = 0; d < 4; d++) {
        play_controls c;
        view_picture p;
        view_camera camera;
        begin(&c, &p, &camera);
        double insertion = c.hand[0].joint[2], before[3], after[3];
        float a[2], b[2];
        wanted_tip(&c, &p, 0, before);
        play_event press = {.type = PLAY_BUTTON, .code = 1, .down = true},
                   move = {.type = PLAY_MOTION, .dx = drag[d][0], .dy = drag[d][1]};
        play_controls_event(&c, &p, &press);
        play_controls_event(&c, &p, &move);
        play_controls_step(&c, &p, &camera, HEIGHT, 0.01);
        wanted_tip(&c, &p, 0, after);
        assert_true(view_camera_project(&camera, HEIGHT, HEIGHT, before, a) &&
                    view_camera_project(&camera, HEIGHT, HEIGHT, after, b));
        float along = ((b[0] - a[0]) * drag[d][0] + (b[1] - a[1]) * drag[d][1]) / 10;
        assert_true(along > 7 && along < 12); /* ten pixels, less the damping */
        assert_float_equal(c.hand[0].joint[2], insertion, 1e-9);
    }
}

static void motion_without_button_moves_nothing(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    begin(&c, &p, &camera);
    play_hand before = c.hand[0];
    play_event move = {.type = PLAY_MOTION, .dx = 50, .dy = 50};
    play_controls_event(&c, &p, &move);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.01);
    assert_memory_equal(before.joint, c.hand[0].joint, 3 * sizeof(double));
}

static void keys_insert_and_roll_within_the_workspace(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    begin(&c, &p, &camera);
    double from = c.hand[0].joint[2];
    key(&c, &p, 'w', true);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.5);
    assert_float_equal((float)c.hand[0].joint[2], (float)(from + 0.015), 1e-6f);
    for (int i = 0; i < 100; i++) play_controls_step(&c, &p, &camera, HEIGHT, 0.5);
    assert_float_equal((float)c.hand[0].joint[2], c.hand[0].params.joint_max[2], 1e-9f);
    key(&c, &p, 'w', false);
    key(&c, &p, 'e', true);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.1);
    assert_float_equal(c.hand[0].joint[3], 0.25, 1e-6);
}

static void losing_the_focus_releases_all_keys(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    view_hand hand;
    begin(&c, &p, &camera);
    key(&c, &p, '2', true);
    key(&c, &p, ' ', true);
    assert_true(play_controls_hand(&c, &p, 1, &hand) && hand.active);
    play_event lost = {.type = PLAY_FOCUS_LOST};
    play_controls_event(&c, &p, &lost);
    assert_true(play_controls_hand(&c, &p, 1, &hand) && !hand.active);
}

/* Current flows only in a cautery and only while the key is held, and ends when the hand selects another instrument. */
static void current_follows_key_and_instrument(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    view_hand hand;
    begin(&c, &p, &camera);
    key(&c, &p, ' ', true);
    assert_true(play_controls_hand(&c, &p, 0, &hand) && !hand.active); /* a probe */
    key(&c, &p, ' ', false);
    key(&c, &p, PLAY_TAB, true);
    key(&c, &p, ' ', true);
    assert_true(play_controls_hand(&c, &p, 1, &hand) && hand.active);
    key(&c, &p, '1', true);
    assert_true(play_controls_hand(&c, &p, 1, &hand) && !hand.active);
}

static void jaws_close_while_held_and_stay_when_latched(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    begin(&c, &p, &camera);
    p.instrument[0].mode = 1;
    key(&c, &p, ' ', true);
    for (int i = 0; i < 10; i++) play_controls_step(&c, &p, &camera, HEIGHT, 0.05);
    assert_float_equal(c.hand[0].joint[4], 1, 1e-9);
    key(&c, &p, 'f', true);
    key(&c, &p, ' ', false);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.5);
    assert_float_equal(c.hand[0].joint[4], 1, 1e-9);
    key(&c, &p, 'f', true);
    play_controls_step(&c, &p, &camera, HEIGHT, 0.5);
    assert_float_equal(c.hand[0].joint[4], 0, 1e-9);
}

static void commands_share_one_message(void **state) {
    (void)state;
    play_controls c;
    view_picture p;
    view_camera camera;
    begin(&c, &p, &camera);
    key(&c, &p, 'x', true);
    key(&c, &p, 'p', true);
    assert_true(c.has_command);
    assert_int_equal(c.command.instrument, 0);
    assert_string_equal(c.command.extrapolator, "broyden");
    assert_int_equal(c.command.passivity, 1);
    assert_false(c.command.reset_fault);
    key(&c, &p, PLAY_ESCAPE, true);
    assert_true(c.quit);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hand_begins_where_the_instrument_is),
        cmocka_unit_test(hand_restarts_with_another_device),
        cmocka_unit_test(unknown_instruments_send_nothing),
        cmocka_unit_test(drag_moves_the_tip_with_the_mouse),
        cmocka_unit_test(motion_without_button_moves_nothing),
        cmocka_unit_test(keys_insert_and_roll_within_the_workspace),
        cmocka_unit_test(losing_the_focus_releases_all_keys),
        cmocka_unit_test(current_follows_key_and_instrument),
        cmocka_unit_test(jaws_close_while_held_and_stay_when_latched),
        cmocka_unit_test(commands_share_one_message),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
