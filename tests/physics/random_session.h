/* Random sessions of two hands, for the tests that draw, run and shrink them (test_sessions.c, test_windows.c).
 *
 * The including file first defines `session` with the members seed, mode[2], fade_s, count and action[], `verdict`
 * with the members good, action (of the failure) and why[], and the functions declared here. */
#ifndef RANDOM_SESSION_H
#define RANDOM_SESSION_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

static session random_session(uint64_t seed);
static void print_session(const session *s);
static verdict run_session(const session *s, bool tell);
/* Removes the i-th option of a session other than its actions, 0 first; returns false if it does not have that
 * option. EFFECTS: all tried. */
static bool drop_effect(session *s, int i);

/* --- drawing --- */

/* Draws every number of a session here, so that a seed determines a session. */
static void begin_drawing(uint64_t seed) {
    scene_seed = 0x9e3779b97f4a7c15ULL * (seed + 1);
    for (int i = 0; i < 4; i++) scene_random();
}

static double between(double low, double high) { return low + (high - low) * scene_random(); }
static int whole(int low, int high) { return low + (int)((high - low + 1) * scene_random()); }

static tm_tool_mode draw_mode(double graspers, double probes) {
    const double which = scene_random();
    return which < graspers ? TM_TOOL_GRASPER : which < graspers + probes ? TM_TOOL_PROBE : TM_TOOL_CAUTERY;
}

static double draw_fade_s(void) { return (const double[]){0, 0.02, 0.1, 0.3}[whole(0, 3)]; }

/* --- moving --- */

/* Sets the k-th of n positions on the way; grip and mode are those of its end. */
static tm_tool_pose on_the_way(const tm_tool_pose *from, const tm_tool_pose *to, int k, int n) {
    tm_tool_pose at = *to;
    for (int c = 0; c < 3; c++) at.tip_m[c] = from->tip_m[c] + (to->tip_m[c] - from->tip_m[c]) * k / n;
    at.roll_rad = from->roll_rad + (to->roll_rad - from->roll_rad) * k / n;
    return at;
}

/* --- shrinking --- */

static bool still_fails(const session *less, session *s, verdict *v) {
    const verdict w = run_session(less, false);
    if (!w.good) *s = *less, *v = w;
    return !w.good;
}

/* Reduces a session to the fewest actions and effects that still fail. */
static session shrink(session s, verdict *v) {
    if (v->action + 1 < s.count) s.count = v->action + 1;
    for (bool helped = true; helped;) {
        helped = false;
        for (int i = s.count - 1; i >= 0; i--) {
            session less = s;
            memmove(less.action + i, less.action + i + 1, sizeof *less.action * (size_t)(less.count - i - 1));
            less.count--;
            helped |= still_fails(&less, &s, v);
        }
        for (int i = 0; i < EFFECTS; i++) {
            session less = s;
            if (drop_effect(&less, i)) helped |= still_fails(&less, &s, v);
        }
    }
    return s;
}

/* --- running --- */

/* TM_LONG=1: 10,000 sessions. TM_SESSIONS=COUNT and TM_SESSIONS_FROM=SEED: this many, from that seed on.
 * TM_SESSION=SEED: only that one, with details. Else the first `few` and those that once exceeded a bound. */
typedef struct session_range {
    uint64_t first, count, again;
    const uint64_t *once_broke;
    bool tell;
} session_range;

static session_range sessions_to_run(uint64_t few, const uint64_t *once_broke, size_t again) {
    const char *one = getenv("TM_SESSION"), *count = getenv("TM_SESSIONS"), *from = getenv("TM_SESSIONS_FROM");
    return (session_range){.first = one    ? strtoull(one, NULL, 10)
                                    : from ? strtoull(from, NULL, 10)
                                           : 1,
                           .count = one              ? 1
                                    : count          ? strtoull(count, NULL, 10)
                                    : test_is_long() ? 10000
                                                     : few,
                           .again = one || count || test_is_long() ? 0 : again,
                           .once_broke = once_broke,
                           .tell = one != NULL};
}

/* Runs all sessions and passes each verdict to `take`; prints failures, the first three shrunk. Returns their
 * number. */
static int run_sessions(const session_range *r, void (*take)(void *to, uint64_t seed, const verdict *v), void *to) {
    int failed = 0;
    for (uint64_t i = 0; i < r->count + r->again; i++) {
        const session s = random_session(i < r->count ? r->first + i : r->once_broke[i - r->count]);
        const unsigned long long seed = s.seed;
        if (r->tell) print_session(&s);
        verdict v = run_session(&s, r->tell);
        take(to, s.seed, &v);
        if (v.good) continue;
        print_message("session %llu: %s\n", seed, v.why);
        if (++failed > 3) continue;
        const session less = shrink(s, &v);
        print_message("  shrunk: %s (TM_SESSION=%llu shows the whole)\n", v.why, seed);
        print_session(&less);
    }
    return failed;
}

#endif
