/* Distinguishes a slower machine from a costlier setting: a fixed piece of work is timed next to the frames, at the
 * prediction and at the verification. Extra time in proportion to that work is the machine's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "study.h"

/* Imitates a step's pass over its tetrahedra: each gathers four vertices, multiplies them with ten blocks of 3 x 3 and
 * adds the result to four vertices. 0.7 MB of blocks take some hundred microseconds. Takes the best of three passes,
 * since the first finds caches that other programs used meanwhile. */
enum { WORK_TETS = 1000, WORK_VERTICES = 300, WORK_PASSES = 3 };

/* Without threads that wait for the next step. */
static double thread_s(void) { return app_clock_s(CLOCK_THREAD_CPUTIME_ID); }

static void multiply(const double block[9], const double *u, double *f) {
    for (int r = 0; r < 3; r++) f[r] += block[3 * r] * u[0] + block[3 * r + 1] * u[1] + block[3 * r + 2] * u[2];
}

static double block[WORK_TETS][10][9], u[3 * WORK_VERTICES], f[3 * WORK_VERTICES];

static void fill(void) {
    static bool filled;
    if (filled) return;
    for (int t = 0; t < WORK_TETS; t++)
        for (int k = 0; k < 90; k++) block[t][k / 9][k % 9] = 1e-3 * ((t + 7 * k) % 11 - 5);
    for (int i = 0; i < 3 * WORK_VERTICES; i++) u[i] = 1e-3 * (i % 17);
    filled = true;
}

static void pass(void) {
    for (int t = 0; t < WORK_TETS; t++) {
        int at[4];
        for (int a = 0; a < 4; a++) at[a] = 3 * ((t / 5 + 67 * a + 13 * (t % 5)) % WORK_VERTICES);
        for (int a = 0, k = 0; a < 4; a++)
            for (int b = a; b < 4; b++, k++) {
                multiply(block[t][k], u + at[b], f + at[a]);
                if (a != b) multiply(block[t][k], u + at[a], f + at[b]);
            }
    }
}

double study_work_s(void) {
    double best = INFINITY;
    fill();
    for (int i = 0; i < WORK_PASSES; i++) {
        const double began = thread_s();
        pass();
        best = fmin(best, thread_s() - began);
    }
    for (int i = 0; i < 3 * WORK_VERTICES; i++) f[i] = fmod(f[i], 1); /* neither removed by the compiler nor growing */
    return best;
}

/* Frames to each side that are averaged to find the machine's speed in one: a single one depends on interrupts. */
enum { BESIDE = 12 };

static double work_about(const double *work_s, int frames, int k) {
    double value[2 * BESIDE + 1];
    int n = 0;
    for (int i = k - BESIDE; i <= k + BESIDE; i++)
        if (i >= 0 && i < frames) value[n++] = work_s[i];
    return app_median(value, n);
}

study_speed study_judge_pace(const double *cost_s, const double *work_s, int frames, double work_then_s,
                             double allowed_s) {
    study_speed out = {.slower = 1, .over = frames ? 0 : 1, .costlier = frames ? 0 : 1};
    double *slower = app_zeroed((size_t)frames, sizeof *slower);
    for (int k = 0; k < frames; k++) {
        /* A faster machine does not make the setting costlier. */
        slower[k] = work_then_s > 0 ? fmax(1, work_about(work_s, frames, k) / work_then_s) : 1;
        out.over += cost_s[k] > allowed_s ? 1.0 / frames : 0;
        out.costlier += cost_s[k] / slower[k] > allowed_s ? 1.0 / frames : 0;
    }
    if (frames) out.slower = app_percentile(slower, frames, 0.95);
    free(slower);
    return out;
}

/* Reported from this factor on. */
static const double SLOWER = 1.1;

void study_verdict(const study_choice *c, char *text, size_t size) {
    char machine[200] = "";
    const bool slow = c->held.slower >= SLOWER || (c->kept && c->held.over > STUDY_OVER);
    if (slow)
        snprintf(machine, sizeof machine,
                 " The machine was %.3g times slower than when it was promised: a fixed piece of work took so much "
                 "longer beside the frames.",
                 c->held.slower);
    if (!c->kept)
        snprintf(text, size, "THE PROMISE WAS NOT KEPT.%s%s", machine,
                 slow && c->held.costlier > STUDY_OVER ? " The setting is costlier than that explains." : "");
    else if (c->held.over > STUDY_OVER)
        snprintf(text, size, "The promise was kept: the setting is no costlier.%s%s", machine,
                 c->real_time ? "" : " REAL TIME WAS NOT KEPT for that.");
    else if (c->real_time)
        snprintf(text, size, "The promise was kept, and real time.%s", machine);
    else
        snprintf(text, size, "Force and price were as promised, but REAL TIME WAS NOT KEPT: %s%s",
                 slow ? "run it again when the machine is itself."
                      : "other programs had the processors; run it again "
                        "when they are idle.",
                 machine);
}
