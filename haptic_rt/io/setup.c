#include "setup.h"

#include <math.h>
#include <stdio.h>

enum { REST_US = 600000, PAUSE_US = 300000, LONGEST_US = 90000000 };
static const float GROWS_N_S = 1.0f, FALLS_N_S = 5.0f, FORCE_MAX_N = 1.0f;
static const double FAR_M = 1.0e-3, FAR_RAD = 1.0e-3, SHAKE_S = 2.5;

static const char *const push_name[HRT_SETUP_PUSHES] = {"+x", "-x", "+y", "-y", "+z", "-z"};

static double moved_along(const hrt_setup *s, const double tip_m[3]) {
    const int axis = s->push / 2;
    return (s->push % 2 ? -1.0 : 1.0) * (tip_m[axis] - s->start_m[axis]);
}

/* Returns the largest way across the force. */
static double moved_across(const hrt_setup *s, const double tip_m[3]) {
    double most = 0.0;
    for (int i = 0; i < 3; i++)
        if (i != s->push / 2) most = fmax(most, fabs(tip_m[i] - s->start_m[i]));
    return most;
}

/* Returns the turn of the handle towards the force; along the shaft there is no torque. */
static double turned_along(const hrt_setup *s, const double joint[HRT_JOINTS]) {
    const int axis = s->push / 2;
    return axis < 2 && s->turns ? (s->push % 2 ? -1.0 : 1.0) * (joint[HRT_TILT + axis] - s->start_rad[axis]) : 0.0;
}

static void judge(hrt_setup *s, const double tip_m[3], const double joint[HRT_JOINTS]) {
    hrt_setup_push *r = &s->result[s->push];
    const bool unturned = s->turns && s->push < 4 && turned_along(s, joint) < FAR_RAD;
    const double along = moved_along(s, tip_m), across = moved_across(s, tip_m);
    if (along >= FAR_M)
        r->verdict = across >= along ? HRT_SETUP_AGAINST : unturned ? HRT_SETUP_UNTURNED : HRT_SETUP_GOOD;
    else if (-along >= FAR_M || across >= FAR_M)
        r->verdict = HRT_SETUP_AGAINST;
    else if (s->force_N >= FORCE_MAX_N)
        r->verdict = HRT_SETUP_STILL;
    if (r->verdict == HRT_SETUP_PENDING) return;
    r->force_N = s->force_N;
    r->turned_rad = (float)turned_along(s, joint);
    for (int i = 0; i < 3; i++) r->moved_m[i] = (float)(tip_m[i] - s->start_m[i]);
    s->falling = true;
    s->at_N = s->force_N;
}

static bool is_proved(const hrt_setup *s) {
    for (int k = 0; k < HRT_SETUP_PUSHES; k++)
        if (s->result[k].verdict != HRT_SETUP_GOOD) return false;
    return true;
}

static void post(hrt_setup *s, hrt_node *node, const tensormass_tool_state_t *tool) {
    tensormass_force_sample_t sample = hrt_node_sample_for(tool, ++s->seq);
    if (s->push == HRT_SETUP_PUSHES && s->axis < 3) sample.force_N[s->axis] = (double)s->force_N;
    if (s->push < HRT_SETUP_PUSHES) sample.force_N[s->push / 2] = (s->push % 2 ? -1.0 : 1.0) * (double)s->force_N;
    hrt_node_post_sample(node, &sample);
}

static void rest(hrt_setup *s, const double tip_m[3]) {
    for (int i = 0; i < 3; i++) {
        s->low_m[i] = fmin(s->low_m[i], tip_m[i]);
        s->high_m[i] = fmax(s->high_m[i], tip_m[i]);
    }
}

static void begin(hrt_setup *s, const double tip_m[3], int64_t now_us) {
    s->since_us = now_us;
    for (int i = 0; i < 3; i++) s->start_m[i] = tip_m[i];
    if (s->push > 0 || s->force_N > 0.0f) return;
    for (int i = 0; i < 3; i++) s->low_m[i] = s->high_m[i] = tip_m[i];
}

/* Shakes an axis after the other; a pause begins the axis anew. Returns false after the last. */
static bool shake(hrt_setup *s, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us) {
    if (!is_proved(s) || s->axis == 3) return false;
    if (tool->state != HRT_ENGAGED || s->axis_us == 0) {
        s->axis_us = tool->state == HRT_ENGAGED ? now_us : 0;
        s->identify[s->axis] = (hrt_identify){.ticks = 0};
    }
    const double time_s = 1.0e-6 * (double)(now_us - s->axis_us);
    if (s->axis_us != 0 && time_s < SHAKE_S) {
        hrt_identify_take(&s->identify[s->axis], (double)node->result.force_N[s->axis], tool->tip_m[s->axis],
                          s->tick_s);
        s->force_N = (float)hrt_identify_signal(time_s, SHAKE_S);
    } else if (s->axis_us != 0) {
        s->axis++;
        s->axis_us = 0;
        s->force_N = 0.0f;
    }
    post(s, node, tool);
    return true;
}

/* Returns whether to end: after a fault nothing moves any more, and a device that pauses again and again begins anew
 * each time. */
static bool is_over(hrt_setup *s, const tensormass_tool_state_t *tool, int64_t now_us) {
    if (s->begin_us == 0) s->begin_us = now_us;
    if (tool->state == HRT_FAULT)
        s->ended = "a fault ended the test; remedy it as its message says, and repeat";
    else if (now_us - s->begin_us > LONGEST_US)
        s->ended = "the test did not end within 90 s; free the machine, or check that the device sends without pause";
    return s->ended != NULL;
}

bool hrt_setup_feed(hrt_setup *s, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us) {
    if (is_over(s, tool, now_us)) return false;
    s->turns = node->exchange.turns;
    if (s->push == HRT_SETUP_PUSHES) return shake(s, node, tool, now_us);
    if (tool->state != HRT_ENGAGED) { /* a pause takes the force away: the push begins anew */
        s->since_us = 0;
        s->force_N = 0.0f;
        s->falling = false;
        s->result[s->push].verdict = HRT_SETUP_PENDING;
        if (tool->state == HRT_IDLE) post(s, node, tool);
        return true;
    }
    if (s->since_us == 0) begin(s, tool->tip_m, now_us);
    const bool resting = now_us - s->since_us < (s->push == 0 ? REST_US : PAUSE_US);
    const float tick_s = (float)s->tick_s;
    if (resting && !s->falling && s->force_N <= 0.0f) {
        if (s->push == 0) rest(s, tool->tip_m);
        for (int i = 0; i < 3; i++) s->start_m[i] = tool->tip_m[i];
        for (int i = 0; i < 2; i++) s->start_rad[i] = tool->joint[HRT_TILT + i];
    } else if (s->falling) {
        s->force_N -= FALLS_N_S * tick_s;
        if (s->force_N <= 0.0f) {
            s->force_N = 0.0f;
            s->falling = false;
            s->push++;
            s->since_us = now_us;
        }
    } else {
        s->force_N = fminf(s->force_N + GROWS_N_S * tick_s, FORCE_MAX_N);
        judge(s, tool->tip_m, tool->joint);
    }
    post(s, node, tool);
    return true;
}

static void print_identified(const hrt_setup *s) {
    for (int a = 0; a < s->axis; a++) {
        hrt_identified f;
        if (hrt_identify_solve(&s->identify[a], &f))
            printf(
                "with the hand, %c  mass %.3f kg, damping %.1f N s/m, friction %.2f N, stiffness %.0f N/m, delay %.1f "
                "ms; %.0f %% unexplained\n",
                'x' + a, f.mass_kg, f.damping_N_s_m, f.friction_N, f.stiffness_N_m, 1.0e3 * f.delay_s,
                100.0 * f.residual);
        else
            printf(
                "with the hand, %c  not identified: no mass and stiffness above zero fit; hold it loosely and repeat\n",
                'x' + a);
    }
}

bool hrt_setup_print(const hrt_setup *s) {
    static const char *const said[] = {"not tried", "as commanded",
                                       "moved AGAINST the force or across it: correct the axis or the sign",
                                       "did not move: hold it loosely; otherwise its unit of force is wrong",
                                       "did not turn the handle towards it: its torque's unit or sign is wrong"};
    bool good = true;
    printf("without force the tip moved by %.0f, %.0f, %.0f um\n", 1.0e6 * (s->high_m[0] - s->low_m[0]),
           1.0e6 * (s->high_m[1] - s->low_m[1]), 1.0e6 * (s->high_m[2] - s->low_m[2]));
    for (int k = 0; k < HRT_SETUP_PUSHES; k++) {
        const hrt_setup_push *r = &s->result[k];
        const float way_m = fabsf(r->moved_m[k / 2]);
        printf("push %s  %4.0f mN moved it by %+.2f, %+.2f, %+.2f mm", push_name[k], 1.0e3 * (double)r->force_N,
               1.0e3 * (double)r->moved_m[0], 1.0e3 * (double)r->moved_m[1], 1.0e3 * (double)r->moved_m[2]);
        if (way_m > 0.0f) printf(" (%.0f N/m)", (double)(r->force_N / way_m));
        if (s->turns && k < 4) printf(", turned by %+.1f mrad", 1.0e3 * (double)r->turned_rad);
        printf("  %s\n", said[r->verdict]);
        good = good && r->verdict == HRT_SETUP_GOOD;
    }
    print_identified(s);
    if (s->ended) printf("%s\n", s->ended);
    if (good && s->axis < 3) return printf("units and signs are right, but not every axis was identified\n"), false;
    printf(good ? "units and signs are right\n" : "units and signs are NOT confirmed\n");
    return good;
}
