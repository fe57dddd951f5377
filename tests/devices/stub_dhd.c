/* A stub of libdhd with the documented calls. x towards the user, y right, z up; m. STUB_FALCON: the device is a
 * Falcon. */
#include <pthread.h>

#include "stub_device.h"

static int is_open, is_on, sets;
static pthread_t servo;
static int servo_known;

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
const char *dhdGetSystemName(char id) { return (void)id, getenv("STUB_FALCON") ? "Novint Falcon" : "omega.3"; }
int dhdEnableForce(unsigned char on, char id) {
    rule(id == 0 && is_open, "dhdEnableForce of an open device");
    if (is_trouble("start")) return -1;
    if (!on) {
        rule(in_trouble("force") || (force[0] == 0.0 && force[1] == 0.0 && force[2] == 0.0),
             "zero force before dhdEnableForce(DHD_OFF)");
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
int dhdGetButton(int number, char id) { return (void)number, (void)id, 0; }
const char *dhdErrorGetLastStr(void) { return "communication error"; }
