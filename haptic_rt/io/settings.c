/* Reads and checks the command line of haptic-rt. */
#include "settings.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "app.h"
#include "bus.h"
#include "profile.h"
#include "report.h"

static void usage(void) {
    puts(
        "usage: haptic-rt --bus ADDRESS [options]\n"
        "The controller of one device: 500 times a second encoders in, torques out, forces from tm-sim extrapolated between its frames.\n"
        "\n"
        "  --bus, --device ADDRESS " HRT_BUS_ADDRESSES ",\n"
        "                          or a device that a service or library drives; --list lists them (docs/devices.md)\n"
        "  --workspace SETTINGS     place such a device: scale=S,depth=M,clutch=BUTTON,grip=BUTTON (scale=1,depth=0.1,clutch=0,grip=1)\n"
        "  --instrument N           0 or 1: selects channels TOOL_N, FORCE_N, PATCH_N, CONTROLLER_N and CAN ids (0)\n"
        "  --mode NAME              probe, grasper or cautery (probe)\n"
        "  --extrapolator NAME     " HRT_EXTRAPOLATOR_NAMES " (adaptive)\n"
        "  --no-passivity           switch passivity control off (it is on; --passivity)\n"
        "  --coupling               switch the virtual coupling on\n"
        "  --trocar X,Y,Z --axis X,Y,Z --up X,Y,Z   set the trocar's pose, m, world axes (that of SIM_STATUS)\n"
        "  --free                   the instrument has no trocar: --trocar is its origin, --axis its shaft's direction\n"
        "  --device-type NAME       type of device; --list lists them (impulse_engine)\n"
        "  --profile FILE           read a device profile; it follows --device-type\n"
        "  --set NAME=VALUE         set one parameter; may be repeated\n"
        "  --params                 print all parameters with range and unit, and end\n"
        "  --lcm-url URL            LCM (" APP_LINK_URL "; $LCM_DEFAULT_URL when set)\n"
        "  --key FILE               accept only messages authenticated by this key, shared with tm-sim (docs/trust.md)\n"
        "  --no-key                 accept messages of every sender, even if the URL admits other machines\n"
        "  --samples FILE           read recorded samples (CSV) instead of LCM; with --lcm-url, as well as LCM\n"
        "  --replay                 accept samples of lcm-logplayer, which answered another controller\n"
        "  --rate HZ                ticks a second, 100..4000 (500), as far as the device allows (--list)\n"
        "  --duration S             end after this time (never)\n"
        "  --priority N             SCHED_FIFO 1..99, 0 for normal scheduling (80)\n"
        "  --idle-states            let idle processors sleep: less power, later ticks\n"
        "  --auto-reset S           reset a fault after this time; for demonstrations and tests\n"
        "  --stats                  print timing at the end\n"
        "  --json FILE              write all figures at the end\n"
        "  --record FILE            write every tick as CSV\n"
        "  --quiet                  print warnings and errors only\n"
        "  --setup                  push the tip along each axis with a slowly growing force, then shake it: checks units and signs, estimates mass and friction; hold it loosely\n"
        "  --list                   list extrapolators, modes, buses and the devices that are connected\n"
        "  -h, --help, --version\n"
        "\n"
        "Exit 0: done. 2: bad input. 1: anything else. States, faults and limits: docs/controller.md.");
}

static bool read_vector(const char *option, const char *text, double v[3]) {
    char tail;
    if (sscanf(text, "%lf,%lf,%lf%c", &v[0], &v[1], &v[2], &tail) == 3 && isfinite(v[0]) && isfinite(v[1]) &&
        isfinite(v[2]))
        return true;
    app_bad_input(option, 0, "'%s' is not a vector; write X,Y,Z", text);
    return false;
}

static bool read_mode(const char *text, hrt_mode *mode) {
    if (hrt_mode_find(text, mode)) return true;
    app_bad_input("--mode", 0, "'%s' is not a mode; use one of" HRT_MODE_NAMES, text);
    return false;
}

enum {
    O_MODE = HRT_OPTION_OWN,
    O_EXTRAPOLATOR,
    O_PASSIVITY,
    O_NO_PASSIVITY,
    O_COUPLING,
    O_TROCAR,
    O_FREE,
    O_AXIS,
    O_UP,
    O_SAMPLES,
    O_AUTO_RESET,
    O_RECORD,
    O_REPLAY,
    O_IDLE_STATES,
    O_LIST,
    O_WORKSPACE,
    O_SETUP
};
static const struct option options[] = {HRT_COMMON_OPTIONS,
                                        {"device", 1, 0, HRT_OPTION_DEVICE},
                                        {"mode", 1, 0, O_MODE},
                                        {"extrapolator", 1, 0, O_EXTRAPOLATOR},
                                        {"passivity", 0, 0, O_PASSIVITY},
                                        {"no-passivity", 0, 0, O_NO_PASSIVITY},
                                        {"coupling", 0, 0, O_COUPLING},
                                        {"trocar", 1, 0, O_TROCAR},
                                        {"free", 0, 0, O_FREE},
                                        {"axis", 1, 0, O_AXIS},
                                        {"up", 1, 0, O_UP},
                                        {"samples", 1, 0, O_SAMPLES},
                                        {"auto-reset", 1, 0, O_AUTO_RESET},
                                        {"record", 1, 0, O_RECORD},
                                        {"replay", 0, 0, O_REPLAY},
                                        {"idle-states", 0, 0, O_IDLE_STATES},
                                        {"list", 0, 0, O_LIST},
                                        {"workspace", 1, 0, O_WORKSPACE},
                                        {"setup", 0, 0, O_SETUP},
                                        {0, 0, 0, 0}};

static void list(void) {
    printf("extrapolators");
    for (int i = 0; i < HRT_EXTRAPOLATOR_COUNT; i++) printf(" %s", hrt_extrapolator_name((hrt_extrapolator)i));
    printf("\nmodes" HRT_MODE_NAMES "\nbuses");
#define ROW_LISTED(kind, name, rate) printf(" " #kind ":" name " (up to %d Hz)", rate);
    HRT_BUSES(ROW_LISTED)
    printf("\ndevice types\n");
    for (int32_t t = 0; t < hrt_device_type_count; t++)
        printf("  %-18s %s\n", hrt_device_types[t]->name, hrt_device_types[t]->text);
    printf("devices that a service or library drives\n");
    hrt_drive_list(stdout);
}

static const char *drive_device(const char *address, bool *joints, int *rate_max) {
    const hrt_drive_driver *driver = hrt_drive_find(address);
    *joints = driver && driver->joints;
    if (driver) *rate_max = driver->rate_max;
    return driver ? driver->device : NULL;
}

static int take_workspace(hrt_settings *s, const char *text) {
    char why[200];
    if (hrt_drive_workspace(text, &s->workspace, why, sizeof why)) return -1;
    return app_bad_input("--workspace", 0, "%s", why);
}

static int checked(bool good) { return good ? -1 : APP_BAD_INPUT; }

static int take(void *user, int option, const char *text) {
    hrt_settings *s = user;
    switch (option) {
    case O_MODE: return checked(read_mode(text, &s->node.mode));
    case O_EXTRAPOLATOR:
        if (hrt_extrapolator_find(text, &s->node.extrapolator)) return -1;
        return app_bad_input("--extrapolator", 0, "'%s' is not an extrapolator; use one of" HRT_EXTRAPOLATOR_NAMES,
                             text);
    case O_PASSIVITY:
    case O_NO_PASSIVITY: s->node.passivity = option == O_PASSIVITY; return -1;
    case O_COUPLING: s->node.coupling = true; return -1;
    case O_TROCAR: s->node.pose_known = true; return checked(read_vector("--trocar", text, s->node.pose.trocar_m));
    case O_FREE: s->node.pose.is_free = 1; return -1;
    case O_AXIS: return checked(read_vector("--axis", text, s->node.pose.axis));
    case O_UP: return checked(read_vector("--up", text, s->node.pose.up));
    case O_SAMPLES: s->samples_path = text; return -1;
    case O_AUTO_RESET: return checked(hrt_option_number("--auto-reset", text, 0.05, 1.0e6, &s->auto_reset_s));
    case O_REPLAY: s->replay = true; return -1;
    case O_IDLE_STATES: s->idle_states = true; return -1;
    case O_RECORD: s->record_path = text; return -1;
    case O_LIST: list(); return APP_DONE;
    case O_WORKSPACE: return take_workspace(s, text);
    case O_SETUP: s->setup = s->node.pose_known = true; return -1;
    default: return APP_BAD_INPUT;
    }
}

/* Checks the settings against each other. Returns -1 or the exit code. */
static int consistent(const hrt_settings *s) {
    hrt_axes axes;
    const double *a = s->node.pose.axis, *u = s->node.pose.up;
    const float axis[3] = {(float)a[0], (float)a[1], (float)a[2]}, up[3] = {(float)u[0], (float)u[1], (float)u[2]};
    const int32_t crossed = hrt_params_check(&s->node.params);
    if (!hrt_axes_along(&axes, s->node.params.device, axis, up))
        return app_bad_input("--axis", 0, "is zero or parallel to --up; give two different directions");
    if (crossed < 0) return -1;
    return app_bad_input("--set", 0, "%s: its lower end is not below its upper end; correct it",
                         hrt_param_text[crossed].name);
}

int hrt_settings_read(hrt_settings *s, int argc, char **argv) {
    const hrt_command_line line = {.program = "haptic-rt",
                                   .usage = usage,
                                   .option = options,
                                   .take = take,
                                   .user = s,
                                   .drive_device = drive_device};
    *s = (hrt_settings){.node = hrt_node_config_default(0),
                        .common = {.rate = 500, .priority = 80},
                        .workspace = hrt_workspace_default()};
    s->common.params = s->node.params;
    const int code = hrt_command_read(&line, &s->common, argc, argv);
    if (code >= 0) return code;
    s->node.instrument = s->common.instrument;
    s->node.params = s->common.params;
    s->node.session = app_session();
    return consistent(s);
}
