/* 3D Systems Touch (Phantom Omni), by the maker's library libHD (OpenHaptics), opened at run time. The declarations are
 * our own, of the documented calls. The library calls `servo` a thousand times a second in a thread of its own: a frame
 * of position, buttons and force. Its axes: x right, y up, z towards the user, mm and N. */
#include <dlfcn.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "clock.h"
#include "drive.h"
#include "drive_library.h"

typedef struct hd_error {
    unsigned code;
    int internal;
    unsigned device;
} hd_error;

enum {
    HD_BUTTONS = 0x2000,
    HD_POSITION = 0x2050,
    HD_TRANSFORM = 0x2052,
    HD_MODEL = 0x2501,
    HD_FORCE = 0x2700,
    HD_FORCE_OUTPUT = 0x4000,
    HD_FORCE_CLAMPING = 0x4001,
    HD_CONTINUE = 1,
    HD_PRIORITY = 0xffff
};
static const unsigned HD_INVALID = 0xFFFFFFFFu;

static struct {
    void *library;
    unsigned (*init)(const char *name);
    void (*disable)(unsigned device);
    void (*make_current)(unsigned device);
    void (*begin)(unsigned device);
    void (*end)(unsigned device);
    void (*get_double)(unsigned what, double *value);
    void (*get_integer)(unsigned what, int *value);
    const char *(*get_string)(unsigned what);
    void (*set_double)(unsigned what, const double *value);
    void (*enable)(unsigned what);
    hd_error (*error)(void);
    const char *(*error_text)(unsigned code);
    unsigned long (*schedule)(unsigned (*call)(void *user), void *user, unsigned short priority);
    void (*unschedule)(unsigned long call);
    void (*start)(void);
    void (*stop)(void);
} hd;

typedef struct touch {
    hrt_drive *drive;
    unsigned device;
    unsigned long call;
    _Atomic bool last, said; /* the next frame sends zero force; it has */
    int failures;
    char why[160];
} touch;

static bool load(char *why, int why_size) {
    static const char *const names[] = {"libHD.so", "libHD.so.3.4", "libHD.so.3.0", NULL};
    const hrt_symbol symbol[] = {{"hdInitDevice", (void **)&hd.init},
                                 {"hdDisableDevice", (void **)&hd.disable},
                                 {"hdMakeCurrentDevice", (void **)&hd.make_current},
                                 {"hdBeginFrame", (void **)&hd.begin},
                                 {"hdEndFrame", (void **)&hd.end},
                                 {"hdGetDoublev", (void **)&hd.get_double},
                                 {"hdGetIntegerv", (void **)&hd.get_integer},
                                 {"hdGetString", (void **)&hd.get_string},
                                 {"hdSetDoublev", (void **)&hd.set_double},
                                 {"hdEnable", (void **)&hd.enable},
                                 {"hdGetError", (void **)&hd.error},
                                 {"hdGetErrorString", (void **)&hd.error_text},
                                 {"hdScheduleAsynchronous", (void **)&hd.schedule},
                                 {"hdUnschedule", (void **)&hd.unschedule},
                                 {"hdStartScheduler", (void **)&hd.start},
                                 {"hdStopScheduler", (void **)&hd.stop},
                                 {NULL, NULL}};
    if (!hd.library) hd.library = hrt_library_open("TM_LIBHD", names, "OpenHaptics (libHD)", symbol, why, why_size);
    return hd.library != NULL;
}

static void fail(touch *t, const char *what, unsigned code) {
    snprintf(t->why, sizeof t->why, "libHD: %s: %s", what, hd.error_text(code));
    hrt_drive_fail(t->drive, HRT_DRIVE_FAILS, NULL);
    hrt_drive_up(t->drive, false, t->why);
}

/* Reads the quaternion of a rotation matrix, stored by columns, about the user's vertical alone: what the roll needs.
 */
static void read_orientation(const double m[16], double q[4]) {
    const double about_up = atan2(m[8], m[0]); /* of the handle's x axis from x towards -z, the user's away */
    q[2] = sin(0.5 * about_up);
    q[3] = cos(0.5 * about_up);
}

/* Reads the complete quaternion along the user's axes. The stylus points along -z of its own axes. */
static void read_handle(const double m[16], double q[4]) {
    /* r[i][j]: component along user axis i of the stylus's axis j; the user's y is the library's -z, its z the y */
    const double r[3][3] = {{m[0], m[4], m[8]}, {-m[2], -m[6], -m[10]}, {m[1], m[5], m[9]}};
    hrt_quaternion_of(r, q);
}

static void take(touch *t) {
    double mm[3] = {NAN, NAN, NAN}, m[16] = {0};
    int buttons = 0;
    hrt_drive_state state = {.time_us = app_monotonic_us(), .trigger = -1.0};
    hd.get_double(HD_POSITION, mm);
    hd.get_double(HD_TRANSFORM, m);
    hd.get_integer(HD_BUTTONS, &buttons);
    state.cursor_m[0] = 1.0e-3 * mm[0];
    state.cursor_m[1] = -1.0e-3 * mm[2];
    state.cursor_m[2] = 1.0e-3 * mm[1];
    if (t->drive->type->tilts)
        read_handle(m, state.orientation);
    else
        read_orientation(m, state.orientation);
    for (int b = 0; b < HRT_DRIVE_BUTTONS; b++) state.button[b] = (buttons >> b & 1) != 0;
    hrt_drive_post(t->drive, &state);
}

static unsigned servo(void *user) {
    touch *t = user;
    float force_N[3] = {0};
    hd.begin(t->device);
    hd_error error = hd.error();
    if (error.code == 0) take(t);
    if (!atomic_load(&t->last)) hrt_drive_force(t->drive, app_monotonic_us(), force_N);
    const double force[3] = {(double)force_N[0], (double)force_N[2], -(double)force_N[1]};
    hd.set_double(HD_FORCE, force);
    hd.end(t->device);
    const hd_error ended = hd.error();
    if (error.code == 0) error = ended;
    t->failures = error.code ? t->failures + 1 : 0;
    if (t->failures == 3) fail(t, "a frame failed", error.code); /* the library itself forgives one */
    if (t->failures == 0 && atomic_load(&t->drive->fault) == HRT_DRIVE_FINE) hrt_drive_up(t->drive, true, NULL);
    atomic_store(&t->said, atomic_load(&t->last));
    return HD_CONTINUE;
}

static bool touch_open(hrt_drive *d, const char *name, char *why, int why_size) {
    if (!load(why, why_size)) return false;
    touch *t = calloc(1, sizeof *t);
    if (!t) return snprintf(why, (size_t)why_size, "out of memory; close other programs"), false;
    t->drive = d;
    /* The number 0 is the default device; else the name that the maker's setup gave it. */
    t->device = hd.init(strcmp(name, "0") == 0 ? NULL : name);
    hd_error error = hd.error();
    if (error.code != 0 || t->device == HD_INVALID) {
        snprintf(why, (size_t)why_size,
                 "libHD cannot open device '%s': %s; run the maker's setup, or give the name from it", name,
                 hd.error_text(error.code));
        return free(t), false;
    }
    hd.make_current(t->device);
    hd.enable(HD_FORCE_OUTPUT);
    hd.enable(HD_FORCE_CLAMPING);
    t->call = hd.schedule(servo, t, HD_PRIORITY);
    hd.start();
    error = hd.error();
    if (error.code == 0) return d->own = t, true;
    snprintf(why, (size_t)why_size,
             "libHD cannot start its scheduler: %s; restart the device, or install OpenHaptics again",
             hd.error_text(error.code));
    hd.unschedule(t->call);
    hd.disable(t->device);
    return free(t), false;
}

static void touch_close(hrt_drive *d) {
    touch *t = d->own;
    const struct timespec ms = {0, 1000000};
    atomic_store(&t->last, true);
    for (int i = 0; i < 100 && !atomic_load(&t->said); i++) nanosleep(&ms, NULL); /* a frame of zero force */
    hd.stop();
    hd.unschedule(t->call);
    hd.disable(t->device);
    free(t);
    d->own = NULL;
}

static void touch_list(FILE *file) {
    char why[200];
    if (!load(why, sizeof why)) {
        fprintf(file, "  touch            %s\n", why);
        return;
    }
    const unsigned device = hd.init(NULL);
    const hd_error error = hd.error();
    if (error.code != 0 || device == HD_INVALID) {
        fprintf(file, "  touch            libHD finds no default device: %s\n", hd.error_text(error.code));
        return;
    }
    hd.make_current(device);
    const char *model = hd.get_string(HD_MODEL);
    fprintf(file, "  touch:0          %s\n", model ? model : "the default device");
    hd.disable(device);
}

const hrt_drive_driver hrt_drive_touch = {.kind = "touch",
                                          .address = "touch:0|NAME",
                                          .device = "touch",
                                          .text = "3D Systems Touch, by libHD",
                                          .rate_max = 1000,
                                          .open = touch_open,
                                          .close = touch_close,
                                          .list = touch_list};
