/* Force Dimension and Novint Falcon, by libdhd, opened at run time. The declarations are our own, of the documented
 * calls. A thread of ours reads and commands; the library's calls wait for the device. Its axes: x towards the user, y
 * right, z up; m, N and N m. A wrist's axes are those where it is centred: the handle then points along -x. */
#include <dlfcn.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "clock.h"
#include "drive.h"
#include "drive_library.h"

enum { DHD_ON = 1, DHD_OFF = 0, DHD_FALCON = 60, FAILURES_MAX = 3 };

static struct {
    void *library;
    int (*count)(void);
    int (*open_id)(char number);
    int (*close_id)(char id);
    int (*system_type)(char id);
    const char *(*system_name)(char id);
    int (*position)(double *x, double *y, double *z, char id);
    int (*set_force)(double x, double y, double z, char id);
    int (*enable_force)(unsigned char on, char id);
    int (*button)(int number, char id);
    const char *(*error_text)(void);
    /* of a device type with a handle */
    bool (*has_wrist)(char id);
    bool (*has_wrist_motors)(char id);
    int (*orientation)(double matrix[3][3], char id);
    int (*set_wrench)(double x, double y, double z, double about_x, double about_y, double about_z, double gripper,
                      char id);
} dhd;

typedef struct delta {
    hrt_drive *drive;
    char id;
    bool tilts, turns; /* a wrist is read; its motors are driven */
    char why[160];
} delta;

static bool load(char *why, int why_size) {
    static const char *const names[] = {"libdhd.so.3", "libdhd.so", "libdrd.so.3", "libdrd.so", NULL};
    const hrt_symbol symbol[] = {{"dhdGetDeviceCount", (void **)&dhd.count},
                                 {"dhdOpenID", (void **)&dhd.open_id},
                                 {"dhdClose", (void **)&dhd.close_id},
                                 {"dhdGetSystemType", (void **)&dhd.system_type},
                                 {"dhdGetSystemName", (void **)&dhd.system_name},
                                 {"dhdGetPosition", (void **)&dhd.position},
                                 {"dhdSetForce", (void **)&dhd.set_force},
                                 {"dhdEnableForce", (void **)&dhd.enable_force},
                                 {"dhdGetButton", (void **)&dhd.button},
                                 {"dhdErrorGetLastStr", (void **)&dhd.error_text},
                                 {NULL, NULL}};
    if (!dhd.library)
        dhd.library = hrt_library_open("TM_LIBDHD", names, "Force Dimension's SDK (libdhd)", symbol, why, why_size);
    return dhd.library != NULL;
}

/* Finds the calls for a wrist, and whether the open device has what the type needs. Returns false with `why`. */
static bool load_wrist(delta *t, const char *name, char *why, int why_size) {
    const hrt_symbol symbol[] = {{"dhdHasWrist", (void **)&dhd.has_wrist},
                                 {"dhdHasActiveWrist", (void **)&dhd.has_wrist_motors},
                                 {"dhdGetOrientationFrame", (void **)&dhd.orientation},
                                 {"dhdSetForceAndTorqueAndGripperForce", (void **)&dhd.set_wrench},
                                 {NULL, NULL}};
    const hrt_device_type *type = t->drive->type;
    t->tilts = type->tilts;
    t->turns = type->handle_torque_max_Nm > 0.0f;
    if (!t->tilts) return true;
    const char *missing = hrt_library_find(dhd.library, symbol);
    if (missing)
        return snprintf(why, (size_t)why_size, "libdhd has no %s, which '%s' requires; install a later version",
                        missing, type->name),
               false;
    if (t->turns ? dhd.has_wrist_motors(t->id) : dhd.has_wrist(t->id)) return true;
    return snprintf(why, (size_t)why_size, "device %s (%s) has no %s; choose --device-type %s", name,
                    dhd.system_name(t->id), t->turns ? "motors at its wrist" : "wrist",
                    dhd.has_wrist(t->id) ? "omega_wrist" : t->drive->driver->device),
           false;
}

/* Reads the handle's orientation along the user's axes. The tool's axes are x right, y up and z back where the wrist is
 * centred: the frame's y, z and x. */
static bool read_wrist(const delta *t, double q[4]) {
    double m[3][3], r[3][3];
    if (dhd.orientation(m, t->id) < 0) return false;
    for (int j = 0; j < 3; j++) {
        const int from = (j + 1) % 3;
        r[0][j] = m[1][from];
        r[1][j] = -m[0][from];
        r[2][j] = m[2][from];
    }
    hrt_quaternion_of(r, q);
    return true;
}

/* Sends force and torque, along the user's axes. */
static int send(const delta *t, const float f[3], const float m[3]) {
    const double x = -(double)f[1], y = (double)f[0], z = (double)f[2];
    if (!t->turns) return dhd.set_force(x, y, z, t->id);
    return dhd.set_wrench(x, y, z, -(double)m[1], (double)m[0], (double)m[2], 0.0, t->id);
}

/* Exchanges a state and a force. Returns false, with `what`, if a call failed. Positive results are hints of the
 * library. */
static bool exchange(delta *t, bool last, const char **what) {
    static const float none[3];
    double x, y, z;
    float force_N[3] = {0}, torque_Nm[3] = {0};
    hrt_drive_state state = {.time_us = app_monotonic_us(), .trigger = -1.0};
    *what = "dhdGetPosition";
    if (dhd.position(&x, &y, &z, t->id) < 0) return send(t, none, none), false;
    *what = "dhdGetOrientationFrame";
    if (t->tilts && !read_wrist(t, state.orientation)) return send(t, none, none), false;
    state.cursor_m[0] = y;
    state.cursor_m[1] = -x;
    state.cursor_m[2] = z;
    for (int b = 0; b < HRT_DRIVE_BUTTONS; b++) state.button[b] = dhd.button(b, t->id) == DHD_ON;
    hrt_drive_post(t->drive, &state);
    if (!last) hrt_drive_wrench(t->drive, app_monotonic_us(), force_N, torque_Nm);
    *what = t->turns ? "dhdSetForceAndTorqueAndGripperForce" : "dhdSetForce";
    return send(t, force_N, torque_Nm) >= 0;
}

/* Switches the force off where calls fail, and on again after a reset. */
static void give_up(delta *t, const char *what) {
    hrt_drive *d = t->drive;
    const struct timespec wait = {0, 10000000};
    snprintf(t->why, sizeof t->why, "libdhd: %s: %s", what, dhd.error_text());
    hrt_drive_fail(d, HRT_DRIVE_FAILS, NULL);
    hrt_drive_up(d, false, t->why);
    dhd.enable_force(DHD_OFF, t->id);
    while (atomic_load(&d->fault) && !atomic_load(&d->stop)) nanosleep(&wait, NULL);
    dhd.enable_force(DHD_ON, t->id);
}

static void *run(void *user) {
    delta *t = user;
    hrt_drive *d = t->drive;
    const char *what;
    int failures = 0;
    int64_t next_us = app_monotonic_us();
    while (!atomic_load(&d->stop)) {
        failures = exchange(t, false, &what) ? 0 : failures + 1;
        if (failures == FAILURES_MAX) {
            give_up(t, what);
            failures = 0;
        } else if (failures == 0 && atomic_load(&d->fault) == HRT_DRIVE_FINE)
            hrt_drive_up(d, true, NULL);
        const int64_t now_us = app_monotonic_us();
        next_us = next_us + d->period_us > now_us ? next_us + d->period_us : now_us + 50;
        const struct timespec wait = {0, 1000 * (next_us - now_us)};
        nanosleep(&wait, NULL);
    }
    exchange(t, true, &what);
    return NULL;
}

static bool is_falcon(char id) { return dhd.system_type(id) == DHD_FALCON; }

/* Opens device `number` of the kind. */
static bool delta_open(hrt_drive *d, const char *name, char *why, int why_size) {
    const bool falcon = strcmp(d->driver->kind, "falcon") == 0;
    if (!load(why, why_size)) return false;
    if (strlen(name) != 1 || name[0] < '0' || name[0] > '9')
        return snprintf(why, (size_t)why_size, "'%s:%s' is not a device address; write %s:0", d->driver->kind, name,
                        d->driver->kind),
               false;
    const int id = dhd.open_id((char)(name[0] - '0'));
    if (id < 0)
        return snprintf(why, (size_t)why_size, "libdhd cannot open device %s: %s; see haptic-rt --list", name,
                        dhd.error_text()),
               false;
    delta *t = calloc(1, sizeof *t);
    if (is_falcon((char)id) != falcon || !t) {
        snprintf(why, (size_t)why_size, "device %s is a %s; choose %s:%s", name, dhd.system_name((char)id),
                 falcon ? "omega" : "falcon", name);
        dhd.close_id((char)id);
        return free(t), false;
    }
    t->drive = d;
    t->id = (char)id;
    const bool fits = load_wrist(t, name, why, why_size);
    if (!fits || dhd.enable_force(DHD_ON, t->id) < 0) {
        if (fits)
            snprintf(why, (size_t)why_size, "the force of device %s (%s) cannot be enabled: %s; restart the device",
                     name, dhd.system_name(t->id), dhd.error_text());
        dhd.close_id(t->id);
        return free(t), false;
    }
    if (pthread_create(&d->thread, NULL, run, t) == 0) return d->own = t, true;
    snprintf(why, (size_t)why_size, "no thread can be started; close other programs");
    dhd.enable_force(DHD_OFF, t->id);
    dhd.close_id(t->id);
    return free(t), false;
}

static void delta_close(hrt_drive *d) {
    delta *t = d->own;
    atomic_store(&d->stop, true);
    pthread_join(d->thread, NULL);
    dhd.enable_force(DHD_OFF, t->id);
    dhd.close_id(t->id);
    free(t);
    d->own = NULL;
}

static void list(FILE *file, bool falcons) {
    char why[200];
    const char *kind = falcons ? "falcon" : "omega";
    if (!load(why, sizeof why)) {
        fprintf(file, "  %-16s %s\n", kind, why);
        return;
    }
    int found = 0;
    const int count = dhd.count();
    for (int i = 0; i < count && i < 10; i++) {
        const int id = dhd.open_id((char)i);
        if (id < 0 || is_falcon((char)id) != falcons) {
            if (id >= 0) dhd.close_id((char)id);
            continue;
        }
        fprintf(file, "  %s:%d%*s %s\n", kind, i, 14 - (int)strlen(kind), "", dhd.system_name((char)id));
        dhd.close_id((char)id);
        found++;
    }
    if (found == 0) fprintf(file, "  %-16s libdhd finds none\n", kind);
}

static void list_omegas(FILE *file) { list(file, false); }
static void list_falcons(FILE *file) { list(file, true); }

const hrt_drive_driver hrt_drive_omega = {.kind = "omega",
                                          .address = "omega:NUMBER",
                                          .device = "omega",
                                          .text = "Force Dimension, by libdhd",
                                          .rate_max = 4000,
                                          .torque = true,
                                          .open = delta_open,
                                          .close = delta_close,
                                          .list = list_omegas};
const hrt_drive_driver hrt_drive_falcon = {.kind = "falcon",
                                           .address = "falcon:NUMBER",
                                           .device = "falcon",
                                           .text = "Novint Falcon, by libdhd",
                                           .rate_max = 1000,
                                           .open = delta_open,
                                           .close = delta_close,
                                           .list = list_falcons};
