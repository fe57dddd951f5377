/* Reads the options that haptic-rt and tm-device share. */
#include "command.h"

#include <stdio.h>
#include <stdlib.h>

#include "app.h"
#include "bus.h"
#include "loop.h"
#include "network.h"
#include "profile.h"
#include "report.h"
#include "tensormass/base.h"

static int whole_number(const char *option, const char *text, double low, double high, int *value) {
    double number;
    if (!hrt_option_number(option, text, low, high, &number)) return APP_BAD_INPUT;
    *value = (int)number;
    return -1;
}

/* Selects the device and its default parameters. */
static int take_device_type(hrt_common *c, const char *name) {
    const int32_t type = hrt_device_type_find(name);
    if (type < 0)
        return app_bad_input("--device-type", 0, "'%s' is not a device type; haptic-rt --list lists them", name);
    if (c->params_read) return app_bad_input("--device-type", 0, "comes after --profile or --set; put it before them");
    hrt_params_of_device(&c->params, hrt_device_types[type]);
    return -1;
}

/* Takes the address; a drive's selects the device that it drives. */
static int take_address(const hrt_command_line *line, hrt_common *c, int option, const char *text) {
    c->rate_max = hrt_bus_rate_max(text);
    const char *device = line->drive_device ? line->drive_device(text, &c->joints, &c->rate_max) : NULL;
    c->bus = text;
    c->bus_option = option == HRT_OPTION_DEVICE ? "--device" : "--bus";
    c->drive = device != NULL;
    return device && !c->typed ? take_device_type(c, device) : -1;
}

/* Sets the counts of a drive, whose positions are numbers and not 16 bits of a frame, unless the profile sets others.
 */
static int refine_counts(hrt_common *c) {
    const hrt_device_type *device = c->params.device;
    if (!device->slides && !c->joints)
        return app_bad_input(
            "--device-type", 0,
            "%s has joints, which this device does not move; leave --device-type out, or choose a cursor's (--list)",
            device->name);
    for (int32_t j = 0; j < device->motors; j++)
        if (c->params.counts_per_unit[j] == device->joint[j].counts_per_unit) c->params.counts_per_unit[j] = 500000.0f;
    return -1;
}

static int check_rate(const hrt_common *c) {
    if (c->rate_max == 0 || c->rate <= c->rate_max) return -1; /* an address of no kind is refused where it is opened */
    return app_bad_input("--rate", 0, "%s takes at most %d ticks a second; give %d to %d", c->bus, c->rate_max,
                         HRT_RATE_MIN, c->rate_max);
}

/* Handles a shared option. Returns -1 to continue, else the exit code. */
static int take(const hrt_command_line *line, hrt_common *c, int option, const char *text) {
    int number = c->instrument, code;
    switch (option) {
    case HRT_OPTION_BUS:
    case HRT_OPTION_DEVICE: return take_address(line, c, option, text);
    case HRT_OPTION_INSTRUMENT:
        code = whole_number("--instrument", text, 0, 1, &number);
        c->instrument = number;
        return code;
    case HRT_OPTION_DEVICE_TYPE: c->typed = true; return take_device_type(c, text);
    case HRT_OPTION_PROFILE: return (c->params_read = hrt_profile_read(text, &c->params)) ? -1 : APP_BAD_INPUT;
    case HRT_OPTION_SET: return (c->params_read = hrt_profile_set(text, &c->params)) ? -1 : APP_BAD_INPUT;
    case HRT_OPTION_PARAMS: hrt_profile_write(stdout, &c->params); return APP_DONE;
    case HRT_OPTION_URL: c->url = text; return -1;
    case HRT_OPTION_KEY: c->key_path = text; return -1;
    case HRT_OPTION_NO_KEY: c->no_key = true; return -1;
    case HRT_OPTION_RATE: return whole_number("--rate", text, HRT_RATE_MIN, HRT_RATE_MAX, &c->rate);
    case HRT_OPTION_DURATION:
        return hrt_option_number("--duration", text, 0.01, 1.0e6, &c->duration_s) ? -1 : APP_BAD_INPUT;
    case HRT_OPTION_PRIORITY: return whole_number("--priority", text, 0, 99, &c->priority);
    case HRT_OPTION_STATS: c->stats = true; return -1;
    case HRT_OPTION_JSON: c->json = text; return -1;
    case HRT_OPTION_QUIET: app_be_quiet(); return -1;
    case HRT_OPTION_HELP: line->usage(); return APP_DONE;
    case HRT_OPTION_VERSION: printf("%s %s\n", line->program, tm_version()); return APP_DONE;
    default: return line->take(line->user, option, text);
    }
}

int hrt_command_read(const hrt_command_line *line, hrt_common *common, int argc, char **argv) {
    opterr = 0;
    for (int option; (option = getopt_long(argc, argv, ":h", line->option, NULL)) != -1;) {
        if (option == '?') return app_bad_input(argv[optind - 1], 0, "unknown option; see %s --help", line->program);
        if (option == ':') return app_bad_input(argv[optind - 1], 0, "needs a value; see %s --help", line->program);
        const int code = take(line, common, option, optarg);
        if (code >= 0) return code;
    }
    if (optind < argc) return app_bad_input(argv[optind], 0, "not an option; see %s --help", line->program);
    if (!common->bus)
        return app_bad_input("--bus", 0, "is missing; name one, for example --bus virtual:demo (see --help)");
    char why[200];
    const int too_fast = check_rate(common);
    if (too_fast >= 0) return too_fast;
    common->params.period_us = 1.0e6f / (float)common->rate;
    if (common->drive) return refine_counts(common);
    if (!hrt_bus_carries(common->params.device, why, sizeof why)) return app_bad_input("--device-type", 0, "%s", why);
    return -1;
}

const char *hrt_common_url(const hrt_common *common) {
    const char *set = getenv("LCM_DEFAULT_URL");
    return common->url ? common->url : set && *set ? set : APP_LINK_URL;
}

int hrt_common_join(const hrt_common *common, hrt_peer_def *def, app_key *key, hrt_live **live) {
    char why[300];
    tm_error error = {.status = TM_OK};
    const char *url = hrt_common_url(common);
    if (!app_key_for(url, common->key_path, common->no_key, key, why, sizeof why))
        return app_bad_input("--key", 0, "%s", why);
    app_network_opener *network = hrt_network(&error);
    if (!network) return app_report("--lcm-url", 0, &error), APP_FAILED;
    def->key = key;
    /* Receive threads inherit this scheduling: real-time, but below the loop. */
    const bool raised =
        def->node && common->priority > 1 && hrt_priority(common->priority > 20 ? common->priority - 20 : 1);
    *live = hrt_live_open(network, url, def, why, sizeof why);
    if (raised) hrt_priority(0);
    return *live ? APP_DONE : app_bad_input("--lcm-url", 0, "%s", why);
}
