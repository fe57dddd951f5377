/* Shared by both stub libraries: a cursor that a hand holds, troubles selected by environment variables, a log. User
 * axes: right, away, up; m and N.
 *
 * STUB_LOG: file; lines "time_us,force x,y,z (N, user axes),cursor x,y,z (m),torque x,y,z (N m)", "# broken RULE", "#
 * trouble TIME". STUB_SWING: m, the hand moves up and down by this every two seconds, and nowhere else. STUB_TROUBLE:
 * open, start, position, orientation, force, frozen, late, nonsense, still; STUB_AFTER: s from the first force. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static FILE *stub_log;
static double cursor[3] = {0.0, 0.0, 0.02}, speed[3], force[3], torque[3];
static long long begin_us, last_us, first_force_us, frozen_us;

static long long now_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000LL + t.tv_nsec / 1000;
}

static void note(const char *format, ...) {
    va_list words;
    const char *path = getenv("STUB_LOG");
    if (!stub_log && path) stub_log = fopen(path, "w");
    if (!stub_log) return;
    va_start(words, format);
    vfprintf(stub_log, format, words);
    va_end(words);
    fflush(stub_log);
}

static void rule(int holds, const char *what) {
    if (!holds) note("# broken %s\n", what);
}

static int is_trouble(const char *name) {
    const char *set = getenv("STUB_TROUBLE");
    return set && strcmp(set, name) == 0;
}

/* Returns whether the selected trouble has begun; the first call after that logs its time. */
static int in_trouble(const char *name) {
    static int noted;
    const double after_s = getenv("STUB_AFTER") ? atof(getenv("STUB_AFTER")) : 0.5;
    if (!is_trouble(name) || first_force_us == 0 || now_us() - first_force_us < 1e6 * after_s) return 0;
    if (!noted++) note("# trouble %lld\n", now_us());
    return 1;
}

static void pause_ms(long ms) {
    const struct timespec t = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&t, NULL);
}

/* Blocks for 0.4 s, once. */
static void freeze(void) {
    if (!in_trouble("frozen") || frozen_us) return;
    frozen_us = now_us();
    pause_ms(400);
    note("# thawed %lld\n", now_us());
}

static void move_cursor(void) {
    const long long now = now_us();
    if (!begin_us) begin_us = last_us = now;
    const double time_s = 1e-6 * (double)(now - begin_us), dt = fmin(1e-6 * (double)(now - last_us), 0.005),
                 mass = 0.15;
    last_us = now;
    const double share = fmin(fmax(time_s - 1.0, 0.0), 1.0),
                 swing = getenv("STUB_SWING") ? atof(getenv("STUB_SWING")) : 0.0,
                 down = swing > 0.0 ? 0.5 * swing * (1.0 - cos(3.14159265358979 * time_s)) : 0.03 * share,
                 goal[3] = {swing > 0.0 ? 0.0 : 0.02 * share, swing > 0.0 ? 0.0 : -0.01 * share, 0.02 - down};
    for (int i = 0; i < 3; i++) {
        const double push = force[i] + 300.0 * (goal[i] - cursor[i]);
        speed[i] = (speed[i] + dt * push / mass) / (1.0 + dt * 11.5 / mass);
        cursor[i] += dt * speed[i];
    }
}

static void set_force(double right, double away, double up) {
    force[0] = right, force[1] = away, force[2] = up;
    if (!first_force_us && (right != 0.0 || away != 0.0 || up != 0.0)) first_force_us = now_us();
    note("%lld,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f\n", now_us(), right, away, up, cursor[0], cursor[1],
         cursor[2], torque[0], torque[1], torque[2]);
}
