/* A stub of libdhd with the documented calls. x towards the user, y right, z up; m. STUB_FALCON: the device is a
 * Falcon. STUB_WRIST: it has a wrist, or, "motors", a wrist with motors; STUB_LEAN: rad, by which the wrist points down
 * from where it is centred. STUB_OLD at compile time: a version without the wrist's calls. */
#include <pthread.h>
#include <stdbool.h>

#include "stub_device.h"

static int is_open, is_on, sets;
static pthread_t servo;
static int servo_known;

static int has_motors(void) { return getenv("STUB_WRIST") && strcmp(getenv("STUB_WRIST"), "motors") == 0; }
static const char *name(void) {
    return getenv("STUB_FALCON")  ? "Novint Falcon"
           : has_motors()         ? "sigma.7"
           : getenv("STUB_WRIST") ? "omega.6"
                                  : "omega.3";
}
static void one_thread(void) {
    if (!servo_known) servo = pthread_self(), servo_known = 1;
    rule(pthread_equal(servo, pthread_self()), "position and force from one thread");
}
int dhdGetDeviceCount(void) { return is_trouble("open") ? 0 : 1; }
int dhdOpenID(char number) {
    if (is_trouble("open") || number != 0) return -1;
    rule(!is_open, "dhdOpenID is called once");
    return is_open = 1, 0;
}
int dhdClose(char id) {
    rule(id == 0 && is_open && !is_on, "dhdClose after dhdEnableForce(DHD_OFF)");
    note("# closed after %d forces\n", sets);
    return is_open = 0;
}
int dhdGetSystemType(char id) {
    return rule(id == 0 && is_open, "dhdGetSystemType of an open device"), getenv("STUB_FALCON") ? 60 : 33;
}
const char *dhdGetSystemName(char id) { return (void)id, name(); }
int dhdEnableForce(unsigned char on, char id) {
    rule(id == 0 && is_open, "dhdEnableForce of an open device");
    if (is_trouble("start")) return -1;
    if (!on) {
        int zero = 1;
        for (int i = 0; i < 3; i++) zero &= force[i] == 0.0 && torque[i] == 0.0;
        rule(in_trouble("force") || zero, "zero force and torque before dhdEnableForce(DHD_OFF)");
        torque[0] = torque[1] = torque[2] = 0.0;
        set_force(0.0, 0.0, 0.0);
    }
    return is_on = on, 0;
}
int dhdGetPosition(double *x, double *y, double *z, char id) {
    rule(id == 0 && is_on, "dhdGetPosition after dhdEnableForce(DHD_ON)");
    one_thread();
    if (in_trouble("position")) return -1;
    if (in_trouble("late")) pause_ms(50);
    freeze();
    if (!in_trouble("still")) move_cursor();
    *x = in_trouble("nonsense") ? NAN : -cursor[1], *y = cursor[0], *z = cursor[2];
    return 0;
}
int dhdSetForce(double x, double y, double z, char id) {
    rule(id == 0 && is_on, "dhdSetForce after dhdEnableForce(DHD_ON)");
    one_thread();
    sets++;
    if (in_trouble("force")) return -1;
    set_force(y, -x, z);
    return 0;
}
#ifndef STUB_OLD
bool dhdHasWrist(char id) {
    return rule(id == 0 && is_open, "dhdHasWrist of an open device"), getenv("STUB_WRIST") != NULL;
}
bool dhdHasActiveWrist(char id) {
    return rule(id == 0 && is_open, "dhdHasActiveWrist of an open device"), has_motors();
}
int dhdGetOrientationFrame(double m[3][3], char id) {
    const double lean = getenv("STUB_LEAN") ? atof(getenv("STUB_LEAN")) : 0.0, c = cos(lean), s = sin(lean);
    const double frame[3][3] = {{c, 0.0, -s}, {0.0, 1.0, 0.0}, {s, 0.0, c}};
    rule(id == 0 && is_on && getenv("STUB_WRIST"), "dhdGetOrientationFrame of a wrist after dhdEnableForce(DHD_ON)");
    one_thread();
    if (in_trouble("orientation")) return -1;
    memcpy(m, frame, sizeof frame);
    if (in_trouble("nonsense")) m[1][1] = NAN;
    return 0;
}
int dhdSetForceAndTorqueAndGripperForce(double x, double y, double z, double tx, double ty, double tz, double gripper,
                                        char id) {
    rule(id == 0 && is_on && has_motors() && gripper == 0.0,
         "torque after dhdEnableForce(DHD_ON), to motors, and no grip");
    one_thread();
    sets++;
    if (in_trouble("force")) return -1;
    torque[0] = ty, torque[1] = -tx, torque[2] = tz;
    set_force(y, -x, z);
    return in_trouble("saturated") ? 2 : 0;
}
#endif
int dhdGetButton(int number, char id) { return (void)number, (void)id, 0; }
const char *dhdErrorGetLastStr(void) { return "communication error"; }
