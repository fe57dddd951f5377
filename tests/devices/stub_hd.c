/* A stub of libHD with the documented calls; checks the order and the threads that OpenHaptics' manual requires. x
 * right, y up, z towards the user; mm. */
#include <pthread.h>
#include <stdatomic.h>

#include "stub_device.h"

typedef struct {
    unsigned code;
    int internal;
    unsigned device;
} HDErrorInfo;
enum { SUCCESS = 0, COMM_ERROR = 0x0201, DEVICE_FAULT = 0x0302, TIMER_ERROR = 0x0203, HANDLE = 7 };

static unsigned pending, enabled;
static int is_open, scheduled, in_frame, frames;
static _Atomic int running;
static pthread_t thread, opener;
static unsigned (*call)(void *);
static void *call_user;

static void *scheduler(void *user) {
    (void)user;
    while (atomic_load(&running)) {
        if (in_trouble("late")) pause_ms(50);
        freeze();
        rule(call(call_user) == 1, "the callback continues");
        rule(!in_frame, "hdEndFrame follows hdBeginFrame");
        pause_ms(1);
    }
    return NULL;
}

static void in_servo(const char *what) { rule(in_frame && pthread_equal(pthread_self(), thread), what); }

unsigned hdInitDevice(const char *name) {
    if (is_trouble("open") || (name && strcmp(name, "right") != 0)) return pending = COMM_ERROR, 0xFFFFFFFFu;
    rule(!is_open, "hdInitDevice is called once");
    is_open = 1;
    opener = pthread_self();
    return HANDLE;
}
void hdMakeCurrentDevice(unsigned d) { rule(d == HANDLE && is_open, "hdMakeCurrentDevice after hdInitDevice"); }
void hdEnable(unsigned what) {
    rule(is_open && !atomic_load(&running), "hdEnable between hdInitDevice and hdStartScheduler");
    enabled |= what == 0x4000 ? 1 : 0;
}
unsigned long hdScheduleAsynchronous(unsigned (*c)(void *), void *user, unsigned short priority) {
    rule(is_open && priority == 0xffff, "hdScheduleAsynchronous after hdInitDevice, with a forces callback's priority");
    call = c, call_user = user, scheduled = 1;
    return 3;
}
void hdStartScheduler(void) {
    rule(scheduled && (enabled & 1), "hdStartScheduler after hdScheduleAsynchronous and hdEnable(HD_FORCE_OUTPUT)");
    if (is_trouble("start")) {
        pending = TIMER_ERROR;
        return;
    }
    atomic_store(&running, 1);
    pthread_create(&thread, NULL, scheduler, NULL);
}
void hdStopScheduler(void) {
    rule(force[0] == 0.0 && force[1] == 0.0 && force[2] == 0.0, "zero force before hdStopScheduler");
    if (atomic_exchange(&running, 0)) pthread_join(thread, NULL);
}
void hdUnschedule(unsigned long h) {
    rule(h == 3 && !atomic_load(&running), "hdUnschedule after hdStopScheduler"), scheduled = 0;
}
void hdDisableDevice(unsigned d) {
    rule(d == HANDLE && is_open && !scheduled && pthread_equal(opener, pthread_self()), "hdDisableDevice last");
    is_open = 0;
    note("# closed after %d frames\n", frames);
}
void hdBeginFrame(unsigned d) {
    rule(d == HANDLE && !in_frame && pthread_equal(pthread_self(), thread), "hdBeginFrame in the servo thread");
    in_frame = 1;
    if (in_trouble("force")) pending = DEVICE_FAULT;
}
void hdEndFrame(unsigned d) { rule(d == HANDLE && in_frame, "hdEndFrame after hdBeginFrame"), in_frame = 0, frames++; }
void hdGetDoublev(unsigned what, double *v) {
    in_servo("hdGetDoublev within a frame");
    if (what == 0x2050) {
        if (!in_trouble("still")) move_cursor();
        const int mad = in_trouble("nonsense");
        v[0] = mad ? NAN : 1e3 * cursor[0], v[1] = 1e3 * cursor[2], v[2] = -1e3 * cursor[1];
        if (in_trouble("position")) v[0] = v[1] = v[2] = 1e9, pending = COMM_ERROR;
    } else if (what == 0x2052)
        for (int i = 0; i < 16; i++) v[i] = i % 5 == 0;
    else
        rule(0, "a known value");
}
void hdGetIntegerv(unsigned what, int *v) {
    in_servo("hdGetIntegerv within a frame"), rule(what == 0x2000, "buttons"), *v = 0;
}
const char *hdGetString(unsigned what) { return rule(what == 0x2501, "the model"), "PHANTOM Omni"; }
void hdSetDoublev(unsigned what, const double *v) {
    in_servo("hdSetDoublev within a frame");
    rule(what == 0x2700, "the force");
    set_force(v[0], -v[2], v[1]);
}
HDErrorInfo hdGetError(void) {
    const HDErrorInfo e = {pending, 0, HANDLE};
    pending = SUCCESS;
    return e;
}
const char *hdGetErrorString(unsigned code) {
    return code == COMM_ERROR    ? "communication error"
           : code == TIMER_ERROR ? "timer error"
           : code                ? "device fault"
                                 : "no error";
}
